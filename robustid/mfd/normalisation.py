"""Sanathanan-Koerner steps that do not fix the leading coefficients: relaxed, and of minimum norm."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from robustid.errors import InputError
from robustid.mfd.node_fraction import NOTHING_HELD, Held, NodeFraction
from robustid.mfd.problem import FractionProblem
from robustid.mfd.vector_polynomials import VectorPolynomials, orthonormal_polynomials

_FREE = 1e8
_LINES = 100  # that hold the fraction away from zero; all of them would cost as much as the basis


def relaxed_step(
    problem: FractionProblem, denominators: np.ndarray, held: Held = NOTHING_HELD
) -> tuple[NodeFraction, float]:
    """SK step under ``mean_k Re(D D_old^{-1}) = I`` instead of monic D, so that noise does not decide on the leading term.

    In the orthonormal basis of the full degrees it is the shortest solution of these few equations. The fraction comes
    as D U, N U with a constant U, which no response sees.

    Notes
    -----
    Source: the relaxed nontriviality of `gustavsen2006`, as a matrix.
    """
    basis, rows_held, pattern = _full(problem, denominators, held)
    wanted = np.eye(problem.values.shape[2]).T.ravel()[pattern]
    lines = _held_lines(problem)
    inverse = np.linalg.inv(denominators[lines])
    rows = np.real(_denominator_rows(problem, basis, lines, inverse)).mean(axis=0)[pattern]
    system = np.vstack([rows_held, rows])
    right = np.concatenate([np.zeros(len(rows_held)), wanted])
    ease = _ease(basis)
    system = system * ease
    size = np.linalg.norm(system, axis=1)
    coordinates = ease * np.linalg.lstsq(system / size[:, None], right / size, rcond=1e-13)[0]
    fraction = problem.polynomial(basis, (coordinates,), problem.directions(held))
    return problem.tie(_monic(problem, fraction)), basis.condition


def minimum_norm_step(
    problem: FractionProblem, denominators: np.ndarray, held: Held = NOTHING_HELD
) -> tuple[NodeFraction, float]:
    """SK step with ``sum_k |D D_old^{-1}|^2 = 1`` (single input): the coordinates that D sees most for their length."""
    if problem.values.shape[2] != 1:
        raise InputError('`method` "sk-minimum-norm" is for one input (right) or one output (left); use "sk-relaxed"')
    basis, rows_held, _ = _full(problem, denominators, held)
    lines = _held_lines(problem)
    rows = _denominator_rows(problem, basis, lines, np.linalg.inv(denominators[lines]))[:, 0]
    ease = _ease(basis)
    rows, rows_held = rows * ease, rows_held * ease
    free = scipy.linalg.null_space(rows_held) if len(rows_held) else np.eye(basis.size)
    stacked = np.vstack([np.real(rows), np.imag(rows)]) @ free
    coordinates = ease * (free @ np.linalg.svd(stacked)[2][0])
    return problem.polynomial(basis, (coordinates,)), basis.condition


def _full(
    problem: FractionProblem, denominators: np.ndarray, held: Held
) -> tuple[VectorPolynomials, np.ndarray, np.ndarray]:
    """Basis with the leading coefficients free, the conditions as rows on it, and the entries of U that may differ from 0."""
    ny, nu = problem.values.shape[1:]
    degrees = problem.degrees
    limits = problem.limits.copy().reshape(nu, nu + ny)
    # D U keeps the degrees when U mixes columns of equal degree, or a column into one of higher degree.
    pattern = (degrees[:, None] <= degrees[None, :]) & ~problem.zeros[:nu]
    limits[:, :nu] = np.where(pattern, degrees[:, None], limits[:, :nu].T).T
    basis = orthonormal_polynomials(problem.regressor(denominators, problem.values), problem.xi, limits.ravel())
    rows = [c.on(basis) for c in problem.conditions_at(held)]
    return basis, np.concatenate([np.zeros((0, basis.size)), *rows]), pattern.T.ravel()


def _ease(basis: VectorPolynomials) -> np.ndarray:
    """Polynomials that vanish on the data cost nothing: an exact fit is made of them."""
    return np.where(basis.null, _FREE, 1.0)


def _monic(problem: FractionProblem, fraction: NodeFraction) -> NodeFraction:
    """D U and N U as D and N, where tied coefficients need them; elsewhere U does no harm."""
    low = problem.tied[1]
    highest = fraction.held.highest
    if not low.size or highest is None:
        return fraction
    nu = problem.values.shape[2]
    degrees = problem.degrees
    U = np.where(degrees[:, None] <= degrees[None, :], highest[:nu], 0.0)
    inverse = np.linalg.inv(U)
    equal = np.where(degrees[:, None] == degrees[None, :], U, 0.0)
    return NodeFraction(
        fraction.denominators @ inverse,
        fraction.numerators @ inverse,
        None if fraction.anchor is None else fraction.anchor @ inverse,
        fraction.held._replace(highest=highest @ np.linalg.inv(equal)),
    )


def _held_lines(problem: FractionProblem) -> np.ndarray:
    lines = problem.omega.size
    return np.unique(np.linspace(0, lines - 1, min(lines, _LINES)).astype(int))


def _denominator_rows(
    problem: FractionProblem, basis: VectorPolynomials, lines: np.ndarray, inverse: np.ndarray
) -> np.ndarray:
    """vec(D D_old^{-1}) of every polynomial at some lines, (m, nu*nu, n)."""
    ny, nu = problem.values.shape[1:]
    values = basis.polynomials(problem.xi[lines]).reshape(lines.size, nu, nu + ny, -1)[:, :, :nu]
    # vec(D X) = (X^T kron I) vec D
    return np.einsum("kij,kian->kjan", inverse, values).reshape(lines.size, nu * nu, -1)
