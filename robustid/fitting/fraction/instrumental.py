"""Instrumental variables: SK's equations seen by the gradient of the model, in polynomials that are bi-orthonormal."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
import scipy.linalg

from robustid.core import as_array
from robustid.errors import InputError, RobustIdError
from robustid.fitting.fraction.krylov_blocks import (
    NULL,
    block_layout,
    check_equations,
    gemm,
    orthonormal_columns,
    raised,
    stacked,
    without,
)
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials

# Smallest cosine between the new directions of both sides: rounding over it is what is left of bi-orthonormality, and
# 1e-9 gave 4e-8 already. Steps on noisy 4 x 4 systems of order 40 met 6e-5 and more.
_BREAKDOWN = 1e-8


class BreakdownError(RobustIdError, np.linalg.LinAlgError):
    """The two-sided process can't go on: the tests don't see a new direction of the trial side."""


@dataclasses.dataclass(frozen=True, eq=False)
class BiorthonormalPolynomials(VectorPolynomials):
    """Trial polynomials phi_c with tests psi_c: ``Re sum_k (J_k psi_c(xi_k))^H A_k phi_d(xi_k) = delta_cd``.

    The matrix of the oblique equations ``Re sum_k (J_k psi)^H A_k x(xi_k) = 0`` for all psi is the identity. Both sides
    span all vector polynomials whose l-th component has a degree of at most ``limits[l]``. The polynomials themselves
    are the trial side, everything inherited is about them; `project` is oblique, and `monic` so gives the x with the
    leading term asked that solves the equations.

    Attributes
    ----------
    columns : (F, r, b) complex array
        A_k.
    values : (2*F*r, n) array
        ``A_k phi_c(xi_k)``, real parts above imaginary parts. Not orthonormal: lengths up to 1/sqrt(cosine), as those of
        the tests.
    tests : (2*F*r, n) array
        ``J_k psi_c(xi_k)``.
    cosine : float
        How near the process came to a breakdown: smallest cosine between the two sides in what a block adds.

    Notes
    -----
    Source: `vanherpen2014`, `voorhoeve2016` section IV.
    """

    tests: np.ndarray
    cosine: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.tests.flags.writeable = False

    @cached_property
    def condition(self) -> float:
        """Measured condition number of ``tests^T values``."""
        gram = scipy.linalg.svdvals(gemm(1.0, self.tests, self.values, trans_a=1))
        return float(gram[0] / gram[-1])

    def project(self, vector: np.ndarray) -> np.ndarray:
        """Coordinates (n,) of the oblique projection on the trial side: what the tests see is left out."""
        return self.tests.T @ (stacked(vector) if np.iscomplexobj(vector) else vector)


def biorthonormal_polynomials(
    trial: np.ndarray, test: np.ndarray, xi: np.ndarray, limits: np.ndarray
) -> BiorthonormalPolynomials:
    """Pair of vector polynomials that the data make bi-orthonormal, by a two-sided block Krylov process.

    Both sides grow by multiplication with xi, as in `orthonormal_polynomials`; every new block is made orthogonal to
    the other side twice, then ``tests^T values`` of the block is brought to the identity by its singular values.

    Parameters
    ----------
    trial, test : (F, r, b) complex arrays
        A_k and J_k: what the equations and the tests see of each component.
    xi : (F,) complex array
        Nodes from `polynomial_nodes`.
    limits : (b,) int array
        Largest degree per component; -1 leaves it out.

    Returns
    -------
    BiorthonormalPolynomials

    Raises
    ------
    InputError
        On wrong shapes, or when there are fewer real equations than coefficients.
    BreakdownError
        When the block Gram matrix is singular to 1e-8, or a column of one side vanishes on the data (an exact fit of
        an order too high).

    Notes
    -----
    A breakdown may be one of the process alone, the whole system being regular; there is no look-ahead.
    Source: `vanherpen2014`.

    Examples
    --------
    >>> from robustid.fitting.fraction.vector_polynomials import polynomial_nodes
    >>> xi, _ = polynomial_nodes(np.linspace(1, 9, 30), None)
    >>> test = (1 / (1 + xi))[:, None, None]
    >>> pair = biorthonormal_polynomials(np.ones((30, 1, 1)), test, xi, np.array([5]))
    >>> pair.size, bool(np.max(np.abs(pair.tests.T @ pair.values - np.eye(6))) < 1e-13)
    (6, True)
    """
    trial, test = (as_array(name, value, dtype=complex, ndim=3) for name, value in (("trial", trial), ("test", test)))
    xi = as_array("xi", xi, dtype=complex, ndim=1)
    limits = np.asarray(limits, dtype=int)
    wanted = (xi.size, trial.shape[1], limits.size)
    if trial.shape != wanted or test.shape != wanted:
        raise InputError(
            f"`trial` and `test` must both have shape (F, r, b) with F = {xi.size} from `xi` and b = {limits.size} from"
            f" `limits`; got {trial.shape} and {test.shape}"
        )
    rows, size = check_equations(limits, trial)
    values, tests = np.empty((rows, size), order="F"), np.empty((rows, size), order="F")
    recursion: list[np.ndarray] = []
    cosine = 1.0
    for before, here, fresh in block_layout(limits):
        grown = [raised(xi, side[:, before], columns[..., fresh]) for side, columns in ((values, trial), (tests, test))]
        G, smallest = _append(values, tests, grown, here.start)
        recursion.append(G)
        cosine = min(cosine, smallest)
    null = np.zeros(size, dtype=bool)
    return BiorthonormalPolynomials(xi, limits, tuple(recursion), trial, values, null, tests, cosine)


def _append(values: np.ndarray, tests: np.ndarray, blocks: list[np.ndarray], start: int) -> tuple[np.ndarray, float]:
    """Bi-orthonormalise two blocks into columns `start` on; returns the trial block's coordinates and the cosine."""
    count = blocks[0].shape[1]
    G = np.zeros((start + count, count))
    sides = [(values[:, :start], tests[:, :start]), (tests[:, :start], values[:, :start])]
    triangles: list[np.ndarray] = []
    for side, (older, seen) in enumerate(sides):
        length, triangle = np.linalg.norm(blocks[side], axis=0), np.eye(count)
        for _ in range(2):
            blocks[side], coordinates = without(older, seen, blocks[side])
            if side == 0:
                G[:start] += coordinates @ triangle
            blocks[side], factor = orthonormal_columns(blocks[side])
            triangle = factor @ triangle
        if np.any(np.abs(np.diag(triangle)) <= NULL * length):
            raise BreakdownError(
                f"column {start} or one of the next {count - 1} of the {'tests' if side else 'trial side'} is a"
                " combination of the former ones on the data; lower the order, or use another method for an exact fit"
            )
        triangles.append(triangle)
    left, cosines, right = scipy.linalg.svd(gemm(1.0, blocks[1], blocks[0], trans_a=1))
    if not cosines[-1] > _BREAKDOWN:
        raise BreakdownError(
            f"the tests don't see all that column {start} of the trial side and its {count - 1} neighbours add"
            f" (cosine {cosines[-1]:.1e}); start from a fraction nearer to the data, or use another method"
        )
    # Both sides get the factor cosine^(-1/2) and the same rotation, that which makes the recursion triangular.
    root = np.sqrt(cosines)
    rotation, G[start:] = np.linalg.qr(root[:, None] * (right @ triangles[0]))
    values[:, start : start + count] = gemm(1.0, blocks[0], right.T / root @ rotation)
    tests[:, start : start + count] = gemm(1.0, blocks[1], left / root @ rotation)
    return G, float(cosines[-1])


def iv_step(problem: FractionProblem, fraction: NodeFraction) -> tuple[NodeFraction, float]:
    """One instrumental-variable step, whose fixed points are the stationary points of the criterion.

    ``Re sum_k (J_k psi(xi_k))^H A_k x(xi_k) = 0`` for x = vec([D; N]) and all polynomials psi of its free degrees, with
    ``A = W (D_old^{-T} kron [P_o -I])`` and ``J = W (D_old^{-T} kron [P_old -I])``. At x = x_old, A x is the residual
    and J psi (but for the sign) the change of the model along psi: the equations are those of a vanishing gradient.

    Parameters
    ----------
    problem : FractionProblem
    fraction : NodeFraction
        D_old and N_old, in the form of the problem. Constraints and rigid-body modes of the problem are not looked at.

    Returns
    -------
    fraction : NodeFraction
    condition : float
        Of the matrix of the equations.

    Raises
    ------
    BreakdownError
        When the pair of bases does not exist (see `biorthonormal_polynomials`); numpy's LinAlgError, of which it is
        one, when D_old is singular at a frequency point.

    Notes
    -----
    It is no descent method and need not converge: keep the best fraction met. Source: `vanherpen2014`, `voorhoeve2016`.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.fitting import Weight
    >>> from robustid.fitting.fraction.steps import gauss_newton_direction, sk_step
    >>> omega = np.linspace(1, 9, 40)
    >>> values = ((1 + 0.1 * np.cos(9 * omega)) / ((1j * omega) ** 2 + 0.2j * omega + 16))[:, None, None]
    >>> problem = FractionProblem(omega, values, 2, Weight.relative(values))
    >>> fraction, _ = sk_step(problem, np.ones((40, 1, 1)))
    >>> for _ in range(20):
    ...     fraction, condition = iv_step(problem, fraction)
    >>> gauss_newton_direction(problem, fraction).slope < 1e-8, condition - 1 < 1e-12
    (True, True)
    """
    pair = instrumental_pair(problem, fraction)
    solution = pair.monic(problem.leading)
    return problem.split(pair.evaluate(pair.xi, *solution[:3])), pair.condition


def instrumental_pair(problem: FractionProblem, fraction: NodeFraction) -> BiorthonormalPolynomials:
    """Polynomials bi-orthonormal for ``W(k) (D^{-T} kron [P_o -I])`` and, as tests, the same with the model's P."""
    trial, test = (
        problem.regressor(fraction.denominators, response) for response in (problem.values, fraction.response)
    )
    return biorthonormal_polynomials(trial, test, problem.xi, problem.limits)
