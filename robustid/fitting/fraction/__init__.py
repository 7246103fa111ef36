"""Matrix fractions on data-dependent orthonormal polynomials."""
