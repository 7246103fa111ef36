"""Matrix-fraction fitting: frequency-domain subspace start, orthonormal vector polynomials, realisation."""
