"""A primal-dual interior-point method for spectral-norm balls and discs, condensed to the unknowns themselves."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np

from robustid.core import Budget, Real
from robustid.identification.solver.newton import Iterate, Program, State, cholesky, inverse_of, slacks

_log = logging.getLogger("robustid.identification.solver")

_SYSTEMS = 60  # Newton systems per problem: 15 to 30 are usual
_PATIENCE, _SLOW = 8, 0.95  # so many iterates in which the gap falls by less than 5 %: the limit of precision is met
_CENTERED, _INSIDE = 1e-16, 1e-4  # squared Newton decrement at which a centre is accepted, and one to start from
_NEAR = 1e-2  # squared decrement of quadratic convergence


def start(program: Program, v: Real, t: float) -> Iterate:
    """A strictly feasible (v, t) with multipliers mu (slack)^-1, mu such that those of t sum to its cost (1 without t).

    They are the gradient of mu times the barrier -sum log det S_k - sum log(r^2 - |e|^2).
    """
    limits = program.limits
    S, s = slacks(program, v, t)
    inverse = [inverse_of(cholesky(block)) for block in S]
    back, mu = program.cones.inverse(s), 1.0
    z = 2 * back[0], 2 * back[1]
    if program.cost is not None:
        weight = float(limits.reach[1] @ z[0] + limits.ball[1] * sum(map(np.trace, inverse)))
        mu = program.cost / weight if weight > 0 else 1.0
    return Iterate(v, t, [mu * block for block in inverse], (mu * z[0], mu * z[1]))


def path(program: Program, at: Iterate) -> Iterator[Iterate]:
    """Iterates of the predictor-corrector method of `mehrotra1992`, primal feasible; ends at the limit of precision."""
    return path_from(_state(program, at))


def path_from(state: State | None) -> Iterator[Iterate]:
    """The iterates of `path` from a state, which may have its Newton matrix."""
    best, waited = np.inf, 0
    for _ in range(_SYSTEMS):
        if state is None:
            return
        at, program = state.at, state.program
        yield at
        waited = 0 if at.estimate < _SLOW * best else waited + 1
        best = min(best, at.estimate)
        if waited == _PATIENCE:
            return
        try:
            state.factorise()
            affine = state.affine()
            primal, dual = (min(1.0, step) for step in state.longest_steps(affine))
            left = min(1.0, max(state.gap_after(affine, primal, dual) / at.gap, 0.0))
            shrink = left if min(primal, dual) < 0.1 else left ** max(1.0, 3 * min(primal, dual) ** 2)
            ahead = state.centring(shrink * state.mu, affine)
            primal, dual = state.longest_steps(ahead)
        except (np.linalg.LinAlgError, FloatingPointError):
            return
        short = 0.9 + 0.09 * min(1.0, primal, dual)
        primal, dual = min(1.0, short * primal), min(1.0, short * dual)
        _log.debug("t %.9g, gap %.2g, dual %.1g; steps %.2f %.2f", at.t, at.gap, at.dual, primal, dual)
        if not np.isfinite(primal + dual):
            return
        # Lanczos may have found the border of a cone a little too far away.
        tries = (_state(program, ahead.moved(at, part * primal, part * dual)) for part in (1.0, 0.7, 0.3))
        state = next((state for state in tries if state is not None), None)


def _state(program: Program, at: Iterate) -> State | None:
    """The state at an iterate; None where it has left a cone."""
    try:
        return State(program, at)
    except np.linalg.LinAlgError:
        return None


def center(program: Program, v: Real, budget: Budget | None = None) -> Iterate:
    """The analytic centre of a program without objective, from a strictly feasible v; a point on the way where time is over.

    Newton's method on the barrier of `start`, whose Hessian is the condensed matrix at multipliers slack^-1.
    """
    state, last = State(program, start(program, v, 0.0)), np.inf
    enough = _INSIDE if program.quick else _CENTERED
    for _ in range(_SYSTEMS):
        at = state.at
        if budget is not None and budget.over:
            break
        try:
            state.factorise()
            step = state.direction([0 * Z for Z in at.Z], (0 * at.z[0], 0 * at.z[1]), state.residual)
        except np.linalg.LinAlgError:
            break
        decrement = float(-state.residual @ step.dv)
        if not decrement > enough or (decrement < _NEAR and decrement > 0.25 * last):
            break
        last = decrement
        # The damped step of self-concordance always descends; longer ones are kept while the barrier falls along them.
        damped, size = 1 / (1 + np.sqrt(decrement)), 1.0
        if decrement > _NEAR:
            size = min(1.0, 0.95 * state.longest_primal(step))
        ahead = _on_barrier(program, at.v + size * step.dv)
        while size > damped and (ahead is None or ahead.residual @ step.dv > 0.5 * decrement):
            size = max(damped, size / 2)
            ahead = _on_barrier(program, at.v + size * step.dv)
        if ahead is None:
            break
        state = ahead
    return state.at


def factored(program: Program, v: Real) -> State:
    """The state at v with multipliers slack^-1, with its Newton matrix: the Hessian F of the barrier."""
    state = State(program, start(program, v, 0.0))
    state.factorise()
    return state


def _on_barrier(program: Program, v: Real) -> State | None:
    """The state at v with multipliers slack^-1; None where v is outside."""
    try:
        return State(program, start(program, v, 0.0))
    except np.linalg.LinAlgError:
        return None
