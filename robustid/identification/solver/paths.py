"""The programs that an identification poses: smallest margin, smallest gain, analytic centre, extreme of a functional."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from robustid.core import Budget, Real
from robustid.errors import SolverError
from robustid.identification.formulation.columns import DenseColumns, IntervalDesign
from robustid.identification.formulation.convex import Candidate, ConvexData
from robustid.identification.formulation.taylor_columns import ShiftColumns
from robustid.identification.solver.cones import Cones, Pair
from robustid.identification.solver.interior_point import center, factored, path, path_from, start
from robustid.identification.solver.newton import Iterate, Limits, Program, State, cholesky

_ROOM = 1e-8  # of a ball of radius 1: far more than what its quick blocks differ by
_LAST = 1e-10  # relative gap at which a path ends: digits run out soon after
_FEW = 2**14  # entries up to which products with stored columns are two to six times as quick as transforms (measured)


def barrier_program(data: ConvexData, limits: Limits, cost: float | None, quick: bool = False) -> Program:
    """The program of the samples with these limits; the intervals of the parameters join them, with a reach of 1."""
    rows, (Q, _), (a, B) = data.rows, data.orthonormal, data.intervals
    E, ball, y, cones = rows.E, data.sarason.ball(data.axes, quick), data.y, Cones(rows.cones, rows.cone)
    if data.axes is not None:
        E = E.turned(data.axes)
    elif quick and isinstance(E, ShiftColumns) and E.shape[0] * E.shape[1] <= _FEW:
        E = DenseColumns(E.dense())
    design = E.design(Q, rows.discs)
    if a.size:
        cones = cones.followed_by(a.size)
        design, y = IntervalDesign(design, y.size, B), np.concatenate([y, a])
        constant, slope = limits.reach
        reach = np.concatenate([constant, np.ones(a.size)]), np.concatenate([slope, np.zeros(a.size)])
        limits = dataclasses.replace(limits, reach=reach)
    unknowns = int(ball.size) + int(Q.shape[1])
    return Program(ball, design, cones, y, limits, cost, np.zeros(unknowns), quick)


def _candidate(data: ConvexData, program: Program, at: Iterate) -> Candidate:
    """The point with its multipliers: <l, e> <= s sum|l| for l = -z1, and <Y, X> <= ||Y||_*."""
    n = data.sarason.size
    Y = data.sarason.turned(program.ball.multiplier(at.Z))
    x = at.v[:n] if data.axes is None else data.axes.away(at.v[:n])
    return Candidate(x, data.scaled_parameters(at.v[n:]), -at.z[1][: data.rows.y.size], Y, "structured")


def _unknowns(data: ConvexData, point: Candidate) -> Real:
    """(y, q) of a point, y its coefficients along the axes."""
    y = point.x if data.axes is None else data.axes.along(point.x)
    return np.concatenate([y, data.orthonormal_parameters(point.p)])


def margin_path(data: ConvexData) -> Iterator[tuple[Candidate, float, float]]:
    """Points on the way to min s, ||X|| <= 1, |e_k| <= s: (candidate, s, estimated gap to the smallest margin).

    The tails are left out of s. Ends at the limit of working precision.
    """
    rows, n = data.rows, data.sarason.size
    count = rows.cones
    program = barrier_program(data, Limits((1.0, 0.0), (np.zeros(count), np.ones(count))), 1.0)
    v = np.concatenate([np.zeros(n), data.orthonormal_parameters(data.least_squares)])
    worst = float(rows.sizes(data.y - program.design.apply(v)[: rows.y.size]).max(initial=0.0))
    # Residuals are known to the rounding of y, in units of the bounds: no path goes below.
    floor = 4 * np.finfo(float).eps * max(1.0, float(np.abs(rows.y).max(initial=0.0)))
    for at in path(program, start(program, v, 2 * max(worst, floor))):
        yield _candidate(data, program, at), at.t, at.estimate
        if at.estimate < _LAST * at.t or at.t <= 4 * floor:
            return


def gain_path(data: ConvexData, inside: Candidate, level: float) -> Iterator[tuple[Candidate, float, float]]:
    """Points on the way to min kappa, ||X|| <= kappa, |e_k| <= level * (the bound at gain kappa K) - kappa * tail."""
    fixed, tail = data.rows.fixed, data.rows.tail
    reach = level * fixed, level * (1 - fixed) - tail
    program = barrier_program(data, Limits((0.0, 1.0), reach), 1.0)
    v = _unknowns(data, inside)
    for at in path(program, start(program, v, 1.0)):
        yield _candidate(data, program, at), at.t, at.estimate
        if at.estimate < _LAST * at.t or at.t <= 1e-12:
            return


def analytic_center(
    data: ConvexData, level: float, passed: Sequence[Candidate] = (), budget: Budget | None = None, quick: bool = False
) -> Candidate:
    """Analytic centre of {||X(x)|| <= 1, |e_k| <= level - tail_k}: maximises log det(I - X'X) + sum log(reach_k^2 - |e_k|^2).

    `level` must exceed the smallest margin strictly. Where the time is over: a point inside on the way. `quick`
    as in `SarasonMap.ball`.
    """
    # From the first of the points `passed` on the way to the smallest margin that is strictly inside: it is far from the
    # borders; else goes that way again.
    count, tail, best = data.rows.cones, data.rows.tail, np.inf
    program = barrier_program(data, Limits((1.0, 0.0), (level - tail, np.zeros(count))), None, quick)
    for point in itertools.chain(passed, (point for point, _, _ in margin_path(data))):
        worst = data.margin(point.x, point.p)
        best = min(best, worst)
        if worst >= level:
            continue
        try:
            at = center(program, _unknowns(data, point), budget)
        except np.linalg.LinAlgError:
            continue  # on the border of the ball, to working precision
        return dataclasses.replace(_candidate(data, program, at), solver="analytic centre")
    raise SolverError(f"no point with every |residual| <= {level:.9g} * bound was found; the best is {best:.9g}")


@dataclasses.dataclass(frozen=True, eq=False)
class Place:
    """A strictly feasible point on a path to an extreme, with multipliers inside the cones, as the path knows them."""

    v: Real
    Z: tuple[Real, ...]
    z: Pair

    @classmethod
    def between(cls, places: Sequence[tuple[float, Place]]) -> Place:
        """A place on the way to the sum of the functionals of some places, times positive factors.

        The factors times the multipliers are those of the sum; any mean of the points is inside.
        """
        total, blocks = sum(factor for factor, _ in places), range(len(places[0][1].Z))
        return cls(
            np.asarray(sum(factor / total * one.v for factor, one in places)),
            tuple(np.asarray(sum(factor * one.Z[k] for factor, one in places)) for k in blocks),
            (
                np.asarray(sum(factor * one.z[0] for factor, one in places)),
                np.asarray(sum(factor * one.z[1] for factor, one in places)),
            ),
        )


class Step(NamedTuple):
    """A point on the way to an extreme: value of the functional, estimated gap to the extreme, and where it is."""

    candidate: Candidate
    value: float
    gap: float
    place: Place


class Supports:
    """Extremes of linear functionals over {||X|| <= 1, |e_k| <= level -+ tail}: paths from one point, with one Newton matrix.

    The set is the inner one, with "-", or the outer one, which contains the coefficients of every consistent system.
    """

    def __init__(self, data: ConvexData, inside: Candidate, level: float, outer: bool = False):
        reach = level + data.rows.tail if outer else level - data.rows.tail
        limits = Limits((1.0, 0.0), (reach, np.zeros(data.rows.cones)))
        self._data = data
        self._first = factored(barrier_program(data, limits, None, quick=True), _unknowns(data, inside))

    def path(self, direction: tuple[Real, Real], near: Place | None = None) -> Iterator[Step]:
        """Points on the way to max <direction, (x, p)>, from the point inside or a place on the way to it.

        With the multipliers l and Y of each: direction = (E'l + (<Y, X(e_j)>)_j, P'l), approximately.
        """
        data = self._data
        direct = direction[0] if data.axes is None else data.axes.along(direction[0])
        w, offset = np.concatenate([direct, data.direction(direction[1])]), float(direction[1] @ data.origin)
        # In units of what the functional does in the ellipsoid of the barrier at the start, so that mu = 1 suits it.
        size = float(np.sqrt(max(w @ self._first.solve(w), 0.0)))
        if size == 0:
            return
        first = self._first.towards(-w / size)
        for at in path_from(self._state(first, near, size)):
            value, gap, found = offset + float(w @ at.v), size * at.estimate, _candidate(data, first.program, at)
            candidate = dataclasses.replace(found, samples=-size * found.samples, ball=size * found.ball)
            place = Place(at.v, tuple(size * Z for Z in at.Z), (size * at.z[0], size * at.z[1]))
            yield Step(candidate, value, gap, place)
            if gap < _LAST * max(abs(value), size):
                return

    def surely_inside(self, x: Real) -> bool:
        """Return whether the blocks of the ball at x are positive definite by more than what rounding makes of them."""
        ball, x = self._first.program.ball, x if self._data.axes is None else self._data.axes.along(x)
        try:
            for A in ball.matrices(x):
                cholesky(A + (1 - _ROOM) * np.eye(len(A)))
        except np.linalg.LinAlgError:
            return False
        return True

    @staticmethod
    def _state(first: State, near: Place | None, size: float) -> State:
        """The state at a place; the first one where that is too near to a border for its digits."""
        if near is not None:
            at = Iterate(near.v, 0.0, [Z / size for Z in near.Z], (near.z[0] / size, near.z[1] / size))
            with contextlib.suppress(np.linalg.LinAlgError):
                return State(first.program, at)
        return first


def barrier_extents(data: ConvexData, inside: Candidate, level: float, X: Real, P: Real) -> Real:
    """The matrix (k, k) of directions (x, p), columns of X and P, in the ellipsoid of the barrier at a point inside."""
    # Its diagonal has the squares of their half-widths in an ellipsoid that the set contains; the set is at most as many times
    # larger as the barrier has terms. One Newton matrix serves any number of directions.
    along = X if data.axes is None else data.axes.along(X)
    W = np.vstack([along, np.column_stack([data.direction(p) for p in P.T])])
    limits = Limits((1.0, 0.0), (level - data.rows.tail, np.zeros(data.rows.cones)))
    program = barrier_program(data, limits, None, quick=True)
    state = factored(program, _unknowns(data, inside))
    return W.T @ np.column_stack([state.solve(w) for w in W.T])
