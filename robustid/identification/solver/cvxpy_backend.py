"""Semidefinite programs through cvxpy: the only module that knows it."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import functools
import itertools
import logging
import warnings
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, Record
from robustid.errors import InputError, SolverError
from robustid.identification.formulation.ball import Inequalities
from robustid.identification.formulation.convex import Candidate, ConvexData
from robustid.identification.formulation.rows import Rows

_Expression = Any  # or a constraint or a program of cvxpy, which states no types
_log = logging.getLogger("robustid.identification.solver")

_CLARABEL = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9, "accept_unknown": True}
# Settings that ask each solver for more digits than its default, tried in turn. The data are scaled already:
# Clarabel's own equilibration makes its first step fail on some of these problems.
_SETTINGS: dict[str, list[Record]] = {
    "CLARABEL": [_CLARABEL | {"equilibrate_enable": False}, _CLARABEL],
    "CVXOPT": [{"abstol": 1e-9, "reltol": 1e-9, "feastol": 1e-9}, {}],
    "SCS": [{"eps_abs": 1e-7, "eps_rel": 1e-7, "max_iters": 50000}],
}
_LIMITS = {"CLARABEL": "time_limit", "SCS": "time_limit_secs"}
_SEMIDEFINITE = ("CLARABEL", "SCS", "CVXOPT", "MOSEK", "SDPA", "COPT")
_NAMES = {"auto": "CLARABEL", "cvxpy": "CLARABEL"}


def _cvxpy() -> ModuleType:
    """The package: its types are incomplete, and it is loaded on first use."""
    import cvxpy

    return cvxpy


@functools.cache
def available_solvers() -> tuple[str, ...]:
    """Installed cvxpy solvers that take semidefinite programs."""
    installed = _cvxpy().installed_solvers()  # looks for the package of every one
    return tuple(name for name in _SEMIDEFINITE if name in installed)


def solver_name(solver: object) -> str:
    """The cvxpy name of a solver, checked."""
    if not isinstance(solver, str):
        raise InputError(
            f'`solver` must be "auto", "structured", "cvxpy" or the name of a cvxpy solver; got {solver!r}'
        )
    name = _NAMES.get(solver, solver.upper())
    if name not in available_solvers():
        raise InputError(
            f'`solver` must be "auto", "structured", "cvxpy" or an installed SDP solver {list(available_solvers())}; got {solver!r}'
        )
    return name


def solve_conic(
    data: ConvexData, objective: str, *, solver: str, factor: float = 1.0, seconds: float = np.inf
) -> Candidate:
    """Solve for the smallest "margin", "gain" (K) or Hankel nuclear norm ("order"), with the parameters in their intervals."""
    # "margin": min s, |e_k| <= s, ||X|| <= 1. "gain": min kappa, |e_k| <= factor * (the bound at K kappa), ||X|| <= kappa.
    # "order": min ||N(x)||_*, |e_k| <= factor, ||X|| <= 1, N the off-diagonal block of X, a Loewner/Hankel matrix whose rank is
    # the order of the simplest interpolant. The status of the solver is not looked at: the caller evaluates the numbers.
    # Clarabel and SCS return what they have after some seconds.
    cp = _cvxpy()

    name = solver_name(solver)
    rows, (Q, _), (a, B) = data.rows, data.orthonormal, data.intervals
    y, E, Q = rows.real(data.y), rows.real(rows.E.dense()), rows.real(Q)
    n, samples = data.sarason.size, rows.y.size
    unknown, q, level = cp.Variable(n), cp.Variable(Q.shape[1]), cp.Variable()
    condition = data.sarason.inequalities() if n else None
    x = unknown if condition is None or condition.change is None else condition.change @ unknown
    residual = y - E @ x - (Q @ q if Q.shape[1] else 0)
    if objective == "margin":
        reach, ball = level * np.ones(rows.cones), 1.0
    elif objective == "gain":
        reach, ball = factor * (rows.fixed + level * (1 - rows.fixed)) - level * rows.tail, level
    else:
        reach, ball = factor - rows.tail, 1.0
    groups = _sample_groups(rows)
    limits = [_limit(reach, residual, samples, *group) for group in groups]
    cones = [] if condition is None else _ball_cones(condition, unknown, ball)
    inside = [cp.abs(a - B @ q) <= 1] if a.size else []
    cost: _Expression = level
    if objective == "order":
        half = data.sarason.pair.order // 2
        block = data.sarason.unit_matrices[
            :, half * data.sarason.entries.outputs :, : half * data.sarason.entries.inputs
        ]
        cost = (
            cp.normNuc(cp.reshape(block.reshape(n, -1).T @ x, block.shape[1:], order="C")) if half else cp.Constant(0.0)
        )
    program = cp.Problem(cp.Minimize(cost), [*itertools.chain(*limits), *cones, *inside])
    _run(program, name, seconds)
    if unknown.value is None and level.value is None:
        raise SolverError(
            f"{name} returned no numbers ({program.status}); try another `solver`, or rescale the problem"
        )
    coefficients = np.zeros(0) if not n else np.asarray(x.value)
    parameters = data.scaled_parameters(np.zeros(0) if q.value is None else np.asarray(q.value))
    multipliers = _sample_multipliers(limits, groups, samples)
    return Candidate(coefficients, parameters, multipliers, _ball_multiplier(cones, condition, data), name)


def _run(program: _Expression, name: str, seconds: float) -> None:
    failure: BaseException | None = None
    limit = {_LIMITS[name]: max(seconds, 1e-3)} if name in _LIMITS and np.isfinite(seconds) else {}
    for settings in _SETTINGS.get(name, [{}]):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # its doubts do not matter: the numbers are checked
                program.solve(solver=name, **settings, **limit)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of a compiled solver is no Exception
            failure = error
            continue
        _log.debug("%s: %s", name, program.status)
        return
    raise SolverError(f"{name} failed: {failure}") from None


_Group = tuple[NDArray[np.intp], NDArray[np.intp], bool]


def _sample_groups(rows: Rows) -> list[_Group]:
    """Bounds of a kind, and their samples (d, M): complex ones by how many samples share a bound, then the real ones."""
    cone = np.arange(rows.y.size) if rows.cone is None else rows.cone
    order = np.argsort(cone[: rows.discs], kind="stable")
    numbers, first, count = np.unique(cone[: rows.discs][order], return_index=True, return_counts=True)
    groups: list[_Group] = []
    for d in np.unique(count):
        some = count == d
        groups.append((numbers[some], order[first[some] + np.arange(d)[:, None]], True))
    if rows.y.size > rows.discs:
        groups.append((cone[rows.discs :], np.arange(rows.discs, rows.y.size)[None], False))
    return groups


def _limit(
    reach: _Expression,
    residual: _Expression,
    samples: int,
    bounds: NDArray[np.intp],
    members: NDArray[np.intp],
    complex_: bool,
) -> list[_Expression]:
    """The constraints |e| <= reach of a group."""
    cp = _cvxpy()

    if not complex_:
        return [residual[members[0]] <= reach[bounds], -residual[members[0]] <= reach[bounds]]
    parts = cp.vstack([residual[row] for row in (*members, *(samples + members))])
    return [cp.SOC(reach[bounds], parts, axis=0)]


def _ball_cones(condition: Inequalities, unknown: _Expression, ball: _Expression) -> list[_Expression]:
    """||X|| <= ball as semidefinite constraints."""
    cp = _cvxpy()

    cones: list[_Expression] = []
    for constant, coefficients in zip(condition.constants, condition.coefficients, strict=True):
        flat, shape = coefficients.reshape(coefficients.shape[0], -1), constant.shape
        cones.append(ball * constant + cp.reshape(flat.T @ unknown, shape, order="C") >> 0)
    return cones


def _sample_multipliers(limits: list[list[_Expression]], groups: list[_Group], samples: int) -> Complex:
    """Multipliers l with Re<l, e> <= s sum|l|, in the order of the samples."""
    out = np.zeros(samples, complex)
    for constraints, (_, members, complex_) in zip(limits, groups, strict=True):
        if constraints[0].dual_value is None:
            continue
        if complex_:
            vector = np.asarray(constraints[0].dual_value[1])
            wanted = 2 * members.shape[0], members.shape[1]
            vector = vector if vector.shape == wanted else vector.reshape(wanted[::-1]).T
            out[members] = -(vector[: members.shape[0]] + 1j * vector[members.shape[0] :])
        else:
            out[members[0]] = np.asarray(constraints[0].dual_value) - np.asarray(constraints[1].dual_value)
    return out


def _ball_multiplier(cones: list[_Expression], condition: Inequalities | None, data: ConvexData) -> Real:
    """Y with <Y, X> <= ||Y||_* on the ball, from the multipliers of the semidefinite blocks."""
    if condition is None or any(c.dual_value is None for c in cones):
        return np.zeros(data.sarason.shape)
    return condition.multiplier([np.asarray(c.dual_value) for c in cones])
