"""Sanathanan-Koerner steps in other bases than the data-dependent one, to show what that one is for.

No user of the library needs them: `voorhoeve2016.py` and the benchmark `matrix_fractions.py` do.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

import robustid as rid
from robustid.fitting import FractionProblem, NodeFraction, orthonormal_polynomials, polynomial_nodes, sk_step

(_gejsv,) = scipy.linalg.get_lapack_funcs(("gejsv",), dtype=np.float64)
BASES = ("monomial", "scaled", "scalar", "orthonormal")


def sk_in_basis(problem: FractionProblem, denominators: np.ndarray, basis: str) -> tuple[NodeFraction, float]:
    """One Sanathanan-Koerner step, solved by least squares on the coefficients of a chosen basis.

    ``min_c sum_k |M_k (x_0 + sum_lj c_lj f_j e_l)(xi_k)|^2`` with ``M_k = W(k) (D_old^{-T} kron [P_o -I])`` and x_0 the
    fixed leading term. All bases span the same polynomials: in exact arithmetic the fraction is that of `sk_step`.

    Parameters
    ----------
    problem : FractionProblem
        Its degrees and leading coefficients hold; other constraints don't.
    denominators : (F, nu, nu) complex array
        D_old at the lines.
    basis : {"monomial", "scaled", "scalar", "orthonormal"}
        f_j: powers of s (rad/s) or z; powers of the nodes ``problem.xi``, at most 1 in modulus; polynomials of one
        variable orthonormal on the lines (Arnoldi). The last two of these with every column of the regression scaled to
        length one. "orthonormal" is `sk_step` itself: vector polynomials that the data make orthonormal.

    Returns
    -------
    fraction : NodeFraction
        Monic in the nodes ``problem.xi``. NaN where the numbers overflow or the regression is exactly singular.
    condition : float
        Of the normal matrix: the squared ratio of the extreme singular values of the real regression matrix; inf where
        it is singular, nan where it overflows.

    Raises
    ------
    InputError
        On an unknown basis.
    numpy.linalg.LinAlgError
        When D_old is singular on a line.

    Notes
    -----
    Solved by Householder QR, which no scaling of the columns disturbs, and without the cut-off of `numpy.linalg.lstsq`,
    which would take the low powers of s for rounding. Singular values by one-sided Jacobi rotations, which keep their
    relative accuracy under any scaling of the columns: 1e70 for powers of s is meant. What no scaling mends ends near
    1e30, where rounding of the entries hides the rest: read "singular to working precision".

    Source: `voorhoeve2016` figure 5; `bultheel2005`; `drmac2008`.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.fitting import Weight
    >>> omega = np.linspace(10, 90, 40)
    >>> values = (1 / ((1j * omega) ** 2 + 2j * omega + 1600))[:, None, None]
    >>> problem = FractionProblem(omega, values, 2, Weight.relative(values))
    >>> [round(np.log10(sk_in_basis(problem, np.ones((40, 1, 1)), basis)[1])) for basis in BASES]
    [11, 1, 1, 0]
    """
    if basis not in BASES:
        raise rid.InputError(f"`basis` must be one of {', '.join(map(repr, BASES))}; got {basis!r}")
    if basis == "orthonormal":
        return sk_step(problem, denominators)
    with np.errstate(over="ignore", invalid="ignore"):
        functions, factors = _functions(problem, basis)
        matrix, target = _regression(problem, denominators, functions, factors)
        length = np.linalg.norm(matrix, axis=0)
    if not np.all(np.isfinite(length)):
        return _nowhere(problem), np.nan
    if basis == "monomial":
        length = np.ones(length.size)
    length[length == 0] = 1.0
    Q, R = np.linalg.qr(matrix / length)
    condition = _condition(R)
    if not np.all(np.diag(R)):
        return _nowhere(problem), condition
    with np.errstate(over="ignore", invalid="ignore"):
        c = -scipy.linalg.solve_triangular(R, Q.T @ target) / length
        return _polynomials(problem, functions, factors, c), condition


def conditioning(problem: FractionProblem, denominators: np.ndarray, *, steps: int, basis: str) -> np.ndarray:
    """Condition numbers of the normal matrix along a Sanathanan-Koerner iteration in a chosen basis.

    Parameters
    ----------
    problem : FractionProblem
    denominators : (F, nu, nu) complex array
        Where the iteration starts; another basis goes on from its own solutions.
    steps : int
    basis : {"monomial", "scaled", "scalar", "orthonormal"}
        See `sk_in_basis`.

    Returns
    -------
    (steps,) array
        NaN from the step on at which nothing finite is left to go on from.

    Raises
    ------
    InputError
        On an unknown basis, or less than one step.

    Notes
    -----
    Source: `voorhoeve2016` figure 5.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.fitting import Weight
    >>> omega = np.linspace(10, 90, 40)
    >>> values = (1 / ((1j * omega) ** 2 + 2j * omega + 1600))[:, None, None]
    >>> problem = FractionProblem(omega, values, 1, Weight.relative(values))
    >>> bool(np.all(conditioning(problem, np.ones((40, 1, 1)), steps=3, basis="orthonormal") < 1 + 1e-12))
    True
    """
    if steps < 1:
        raise rid.InputError(f"`steps` must be at least 1; got {steps}")
    out = np.full(steps, np.nan)
    for k in range(out.size):
        try:
            fraction, out[k] = sk_in_basis(problem, denominators, basis)
        except np.linalg.LinAlgError:
            break
        denominators = fraction.denominators
        if not np.all(np.isfinite(denominators)):
            break
    return out


def _functions(problem: FractionProblem, basis: str) -> tuple[np.ndarray, np.ndarray]:
    """f_j of degree j on the lines (F, n), and the factors (n,) that make them monic in xi; n - 1 = highest degree."""
    xi, scale = polynomial_nodes(problem.omega, problem.dt)
    degrees = np.arange(int(problem.limits.max()) + 2)
    if basis == "monomial":
        return (scale * xi[:, None]) ** degrees, scale ** -degrees.astype(float)
    if basis == "scaled":
        return xi[:, None] ** degrees, np.ones(degrees.size)
    scalar = orthonormal_polynomials(np.ones((xi.size, 1, 1)), xi, degrees[-1:])
    # xi phi_{j-1} = G[j] phi_j + lower ones
    return scalar.values[: xi.size] + 1j * scalar.values[xi.size :], np.cumprod([G[-1, 0] for G in scalar.recursion])


def _regression(
    problem: FractionProblem, denominators: np.ndarray, functions: np.ndarray, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The real matrix, columns by component and then by degree, and the fixed leading term on the data."""
    lines, ny = problem.values.shape[:2]
    inverse = np.linalg.inv(denominators).transpose(0, 2, 1)
    left = np.concatenate([problem.values, np.broadcast_to(-np.eye(ny), (lines, ny, ny))], axis=2)
    columns = problem.weight.linearised(inverse, left)
    blocks = [columns[:, :, i, None] * functions[:, None, : top + 1] for i, top in enumerate(problem.limits)]
    top = problem.limits + 1
    leading = problem.leading * factors[top] * functions[:, top]
    return _stacked(np.concatenate(blocks, axis=2)), _stacked(np.einsum("kri,ki->kr", columns, leading))


def _stacked(vector: np.ndarray) -> np.ndarray:
    """(F, r, ...) complex as (2*F*r, ...) real: real parts above imaginary parts."""
    flat = vector.reshape(vector.shape[0] * vector.shape[1], *vector.shape[2:])
    return np.concatenate([np.real(flat), np.imag(flat)])


def _polynomials(problem: FractionProblem, functions: np.ndarray, factors: np.ndarray, c: np.ndarray) -> NodeFraction:
    """The leading term plus the combination c, on the lines."""
    top = problem.limits + 1
    parts = np.split(c, np.cumsum(top)[:-1])
    free = np.stack([functions[:, : part.size] @ part for part in parts], axis=1)
    return problem.split(free + problem.leading * factors[top] * functions[:, top])


def _condition(R: np.ndarray) -> float:
    # Columns of very different length: the usual bidiagonalisation would report rounding for the small singular values.
    values, *_, info = _gejsv(R, joba=0, jobu=3, jobv=3, jobr=0)
    if info != 0 or values[-1] <= 0:
        return np.inf
    with np.errstate(over="ignore"):
        return float((values[0] / values[-1]) ** 2)


def _nowhere(problem: FractionProblem) -> NodeFraction:
    return problem.split(np.full((problem.omega.size, problem.limits.size), np.nan, dtype=complex))
