"""Instrumental variables: SK's equations seen by the gradient of the model, in polynomials that are bi-orthonormal."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
import scipy.linalg

from robustid.core import as_array
from robustid.errors import InputError, RobustIdError
from robustid.fitting.fraction.fraction_problem import FractionProblem
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
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials

# Smallest cosine between the new directions of both sides: rounding over it is what is left of bi-orthonormality, and
# 1e-9 gave 4e-8 already. Steps on noisy 4 x 4 systems of order 40 met 6e-5 and more.
_BREAKDOWN = 1e-8


class BreakdownError(RobustIdError, np.linalg.LinAlgError):
    """The two-sided process can't go on: the tests don't see a new direction of the trial side."""


@dataclasses.dataclass(frozen=True, eq=False)
class BiorthonormalPolynomials(VectorPolynomials):
    """Trial polynomials phi_c with tests psi_c: ``Re sum_k (J_k psi_c(xi_k))^H A_k phi_d(xi_k) = delta_cd``, so that the matrix
    of the oblique equations ``Re sum_k (J_k psi)^H A_k x(xi_k) = 0`` for all psi is the identity. Inherited is the trial side;
    `project` is oblique, and `monic` gives the x that solves the equations (`vanherpen2014`, `voorhoeve2016` section IV).
    """

    # Both sides span all vector polynomials whose l-th component has a degree of at most `limits[l]`. `columns` are A_k; the
    # `values` A_k phi_c(xi_k) are not orthonormal: lengths up to 1/sqrt(cosine), as those of the tests.
    tests: np.ndarray  # J_k psi_c(xi_k) (2*F*r, n)
    cosine: float  # smallest between the two sides in what a block adds: how near a breakdown was

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
    """Pair of vector polynomials that the data make bi-orthonormal, by a two-sided block Krylov process (`vanherpen2014`), of
    trial and test (F, r, b). Both sides grow by multiplication with xi; every new block is made orthogonal to the other side
    twice, then its ``tests^T values`` is brought to the identity by its singular values.
    """
    # A BreakdownError is raised when the block Gram matrix is singular to 1e-8, or a column of one side vanishes on the data
    # (an exact fit of an order too high). It may be one of the process alone, the whole system being regular; there is no
    # look-ahead.
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
    """One instrumental-variable step and the condition of its matrix: ``Re sum_k (J_k psi(xi_k))^H A_k x(xi_k) = 0`` for x =
    vec([D; N]) and all psi of its free degrees, ``A = W (D_old^{-T} kron [P_o -I])``, ``J = W (D_old^{-T} kron [P_old -I])``. No
    descent method, it need not converge: keep the best fraction met (`vanherpen2014`, `voorhoeve2016`).
    """
    # At x = x_old, A x is the residual and J psi (but for the sign) the change of the model along psi: the equations are those
    # of a vanishing gradient, and fixed points are the stationary points of the criterion. Constraints and rigid-body modes of
    # the problem are not looked at. Where the pair of bases does not exist a BreakdownError is raised, and its base, numpy's
    # LinAlgError, where D_old is singular at a frequency point.
    pair = instrumental_pair(problem, fraction)
    solution = pair.monic(problem.leading)
    return problem.split(pair.evaluate(pair.xi, *solution[:3])), pair.condition


def instrumental_pair(problem: FractionProblem, fraction: NodeFraction) -> BiorthonormalPolynomials:
    """Polynomials bi-orthonormal for ``W(k) (D^{-T} kron [P_o -I])`` and, as tests, the same with the model's P."""
    trial, test = (
        problem.regressor(fraction.denominators, response) for response in (problem.values, fraction.response)
    )
    return biorthonormal_polynomials(trial, test, problem.xi, problem.limits)
