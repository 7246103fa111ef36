"""One step of a matrix-fraction fit, in polynomials that the data make orthonormal: nothing is left to solve."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import lengths
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.node_fraction import NOTHING_HELD, Held, NodeFraction
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials, orthonormal_polynomials

# Equations that contradict each other leave this much of themselves.
_CONTRADICTION = 1e-6
_RETRACTIONS = 8  # cheap SK steps on a noise-free response; two suffice up to order 40
_REPRODUCED = 1e-3  # of what counts as an exact fit: a response reproduced to this needs no further step
_SETTLED, _ENOUGH = 0.5, 1e8  # SK on a noise-free response has converged after two steps: what is left then is rounding
_FREE = 1e8  # times easier for polynomials that vanish on the data
_LINES = 100  # that hold a relaxed fraction away from zero; all of them would cost as much as the basis


def sk_step(
    problem: FractionProblem, denominators: np.ndarray, held: Held = NOTHING_HELD
) -> tuple[NodeFraction, float]:
    """One Sanathanan-Koerner step: minimise ``sum |W (D_old^{-T} kron [P_o -I]) vec([D; N])|^2``.

    In the basis that these data make orthonormal the solution is the leading term made orthogonal to the free ones;
    linear constraints add the shortest correction that fulfils them.

    `denominators` is D_old at the frequency points, (F, nu, nu): any function that is nonsingular there will do; `held` is
    that of the last fraction. Second comes the condition number of the normal matrix.
    """
    basis = problem.basis(denominators, problem.values)
    terms = _constrained(problem, held, [basis], [basis.monic(problem.leading)[:3]])
    return problem.tie(problem.polynomial(basis, terms[0], problem.directions(held))), basis.condition


Terms = tuple[np.ndarray, np.ndarray, np.ndarray]


def _constrained(
    problem: FractionProblem, held: Held, bases: list[VectorPolynomials], terms: list[Terms]
) -> list[Terms]:
    """The polynomials moved as little as it takes to fulfil the conditions, in one basis for vec X or one for each column of X."""
    conditions = problem.conditions_at(held)
    if not conditions:
        return terms
    columns = [None] if len(bases) == 1 and bases[0].limits.size == problem.leading.size else list(range(len(bases)))
    rows = np.hstack(
        [np.concatenate([c.on(b, column) for c in conditions]) for b, column in zip(bases, columns, strict=True)]
    )
    fixed = np.sum(
        [
            np.concatenate([c.of(b, (np.zeros(b.size), *term[1:]), column) for c in conditions])
            for b, term, column in zip(bases, terms, columns, strict=True)
        ],
        axis=0,
    )
    ends = np.cumsum([basis.size for basis in bases])[:-1]
    moved = _nearest(np.concatenate([term[0] for term in terms]), rows, fixed)
    return [(part, term[1], term[2]) for part, term in zip(np.split(moved, ends), terms, strict=True)]


def _nearest(coordinates: np.ndarray, rows: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """The nearest coordinates with ``rows coordinates + fixed = 0``."""
    size = lengths(rows, axis=1)
    rows, fixed = rows / size[:, None], fixed / size
    inverse = scipy.linalg.pinv(rows, rtol=1e-13)
    for _ in range(2):  # the second pass takes away what rounding left of the first
        coordinates = coordinates - inverse @ (rows @ coordinates + fixed)
    left = np.abs(rows @ coordinates + fixed)
    if np.any(left > _CONTRADICTION * (np.abs(fixed) + np.linalg.norm(coordinates))):
        raise InputError(
            "`constraints` and rigid-body modes contradict each other, or the order is too small for them; take some"
            " away or raise `order`"
        )
    return coordinates


class Direction(NamedTuple):
    """A Gauss-Newton direction."""

    fraction: NodeFraction
    slope: float  # part of the residual in the tangent space: 0 at a stationary point, at most 1
    condition: float  # of the normal matrix


def gauss_newton_direction(problem: FractionProblem, fraction: NodeFraction) -> Direction:
    """Gauss-Newton direction of the true criterion, from ``d vec(P) = -(D^{-T} kron [P -I]) vec(d[D; N])``. The Jacobian's columns
    are orthonormal: it is minus the projection of the residual, and Levenberg-Marquardt's damping is a shorter step along it.
    Constraints and turning rigid-body directions leave the tangent space of the constrained set.
    """
    response = fraction.response
    basis = problem.basis(fraction.denominators, response)
    residual = problem.residual(response)
    coordinates = -basis.project(residual)
    forbidden = problem.forbidden(basis, fraction)
    coordinates -= forbidden.T @ (forbidden @ coordinates)
    size = float(np.linalg.norm(residual))
    slope = float(np.linalg.norm(coordinates)) / size if size > 0 else 0.0
    turn = problem.turn(basis, fraction, coordinates)
    return Direction(problem.polynomial(basis, (coordinates,), turn), slope, basis.condition)


def retract(
    problem: FractionProblem,
    response: np.ndarray,
    denominators: np.ndarray,
    held: Held = NOTHING_HELD,
    *,
    steps: int = 2,
    columnwise: int = 0,
    settled: float = math.inf,
    enough: float = 1.0,
) -> NodeFraction:
    """A fraction of the problem's form close to a response that almost has one.

    SK with the response in place of the data: exact data are reproduced in about two steps from any start, and what is
    off by e comes back with an error of the order of e.

    From `denominators` (F, nu, nu) on, with the rigid-body directions of the last fraction `held`: `columnwise` steps
    column by column (`column_step`), then full `steps`. One that leaves more than the part `settled` of the squared error
    is the last of its kind, and none is taken below `enough` times the squared error that counts as reproduced.
    """
    target = dataclasses.replace(problem, values=response)
    best, error = None, np.inf
    rounding, done = target.rounding * _REPRODUCED**2, 0
    for take, count in ((column_step, columnwise), (_full_step, steps)):
        for _ in range(count):
            try:
                fraction = take(target, denominators, held)
            except np.linalg.LinAlgError:  # singular at a point: no way on from there
                if best is None:
                    raise
                return best
            reached, done, before = target.cost(fraction), done + 1, error
            if best is None or reached < error:
                best, error = fraction, reached
            if done > 1 and error <= enough * rounding:
                return best
            if reached > settled * before:
                break
            denominators, held = fraction.denominators, fraction.held
    if best is None:
        raise InputError("`steps` must be at least 1")
    return best


def _full_step(problem: FractionProblem, denominators: np.ndarray, held: Held) -> NodeFraction:
    return sk_step(problem, denominators, held)[0]


def into_form(problem: FractionProblem, response: np.ndarray, held: Held = NOTHING_HELD) -> NodeFraction:
    """The fraction of the problem's form that is nearest to a response, as far as a few SK steps find it."""
    return nearest_form([problem], response, held)[1]


def nearest_form(
    problems: Sequence[FractionProblem], response: np.ndarray, held: Held = NOTHING_HELD, *, full: bool = True
) -> tuple[FractionProblem, NodeFraction]:
    """The form among those of some problems, and the fraction of that form, nearest to a response: steps column by column of
    each; with `full` one more of the best, which costs nu^2 times as much, where they leave more than rounding.
    """
    lines, nu = response.shape[0], response.shape[2]
    identity = np.broadcast_to(np.eye(nu), (lines, nu, nu))
    found: list[tuple[float, FractionProblem, NodeFraction]] = []
    for problem in problems:
        fraction = retract(
            problem, response, identity, held, columnwise=_RETRACTIONS, steps=0, settled=_SETTLED, enough=_ENOUGH
        )
        found.append((dataclasses.replace(problem, values=response).cost(fraction), problem, fraction))
    error, problem, fraction = min(found, key=lambda item: item[0])
    if full and error > _ENOUGH * _REPRODUCED**2 * dataclasses.replace(problem, values=response).rounding:
        fraction = formed_further(problem, fraction, response)
    return problem, fraction


def formed_further(problem: FractionProblem, fraction: NodeFraction, response: np.ndarray) -> NodeFraction:
    """The fraction, or what a full SK step on the response makes of it where that is nearer."""
    target = dataclasses.replace(problem, values=response)
    try:
        other = sk_step(target, fraction.denominators, fraction.held)[0]
    except np.linalg.LinAlgError:  # singular at a point
        return fraction
    return other if target.cost(other) < target.cost(fraction) else fraction


def scalar_form(problem: FractionProblem, poles: np.ndarray, response: np.ndarray) -> NodeFraction:
    """The fraction of one input with these poles (in the unit of the nodes) and this response: D is known without a step."""
    D = np.prod(problem.xi[:, None] - poles, axis=1)[:, None, None]
    return NodeFraction(D, response * D)


def column_step(problem: FractionProblem, denominators: np.ndarray, held: Held = NOTHING_HELD) -> NodeFraction:
    """SK step with ``|W| |D_old^{-1}|``, a number per frequency point, as weight: the columns of [D; N] come apart. It is nu^2
    times cheaper than `sk_step`, and as exact where the data are those of a fraction; with noise it weighs them wrongly
    wherever D_old is ill-conditioned.
    """
    lines, ny, nu = problem.values.shape
    smallest = np.linalg.svd(denominators, compute_uv=False)[:, -1]
    if not np.all(smallest > 0):
        raise np.linalg.LinAlgError("D is singular at a frequency point")
    weight = problem.weight.size / smallest
    left = np.concatenate([problem.values, np.broadcast_to(-np.eye(ny), (lines, ny, ny))], axis=2)
    limits = problem.limits.reshape(nu, -1)
    groups: dict[tuple[int, ...], VectorPolynomials] = {}
    for row in limits:
        if tuple(row) not in groups:
            groups[tuple(row)] = orthonormal_polynomials(weight[:, None, None] * left, problem.xi, row)
    bases = [groups[tuple(row)] for row in limits]
    ones = np.eye(nu, nu + ny)
    terms = [basis.monic(one)[:3] for basis, one in zip(bases, ones, strict=True)]
    return problem.tie(problem.assembled(bases, _constrained(problem, held, bases, terms), problem.directions(held)))


def relaxed_step(
    problem: FractionProblem, denominators: np.ndarray, held: Held = NOTHING_HELD
) -> tuple[NodeFraction, float]:
    """SK step under ``mean_k Re(D D_old^{-1}) = I`` instead of monic D (`gustavsen2006`, as a matrix), so that noise does not
    decide on the leading term: the shortest solution of these few equations in the orthonormal basis of the full degrees. The
    fraction comes as D U, N U with a constant U, which no response sees.
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
    coordinates = ease * np.asarray(np.linalg.lstsq(system / size[:, None], right / size, rcond=1e-13)[0], dtype=float)
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
    """vec(D D_old^{-1}) of every polynomial at some frequency points, (m, nu*nu, n)."""
    ny, nu = problem.values.shape[1:]
    values = basis.polynomials(problem.xi[lines]).reshape(lines.size, nu, nu + ny, -1)[:, :, :nu]
    # vec(D X) = (X^T kron I) vec D
    return np.einsum("kij,kian->kjan", inverse, values).reshape(lines.size, nu * nu, -1)
