"""Search for a pair of consistent systems whose loop is not stable: what refutes that all pairs are."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Budget, Complex, Real, StateMatrices, closed_loop, is_well_posed
from robustid.data import FrequencyResponse
from robustid.guarantees.loop_sides import Side
from robustid.identification import Identification, identify, largest_ratio
from robustid.reduction import doubtful_distance, is_stable

if TYPE_CHECKING:
    import control

_PAST = (0.1, 0.4, 0.9)  # of the way from the least error that closes the loop to the whole bound
_ROUNDED = 1e-5  # of a bound: what a model of a consistent system may miss it by more
_NEAR = 0.3  # of that way beyond: how near a system comes to the value that it is asked to have


class LoopPoles(NamedTuple):
    """Poles of a loop, those that are not stable, and whether stable ones and unstable ones are so by more than rounding."""

    poles: Complex
    unstable: Complex
    stable: bool


class Pair(NamedTuple):
    """Two systems of one loop with its poles that are not stable."""

    source: control.StateSpace
    load: control.StateSpace
    poles: Complex


def in_units(states: Real) -> Real:
    """The matrix with states scaled by powers of two: the units of the signals of a loop say nothing about its poles."""
    return np.asarray(scipy.linalg.matrix_balance(states, permute=False)[0], dtype=float) if states.size else states


def poles_of_loop(source: control.StateSpace, load: control.StateSpace, dt: float) -> LoopPoles:
    """Poles of the loop of two systems; those on the edge but for rounding are neither stable nor unstable."""
    systems = StateMatrices.of(source), StateMatrices.of(load)
    if not is_well_posed(*systems):
        return LoopPoles(np.zeros(0, complex), np.zeros(0, complex), False)
    poles, doubt = doubtful_distance(in_units(closed_loop(*systems).A))
    distance = 1 - np.abs(poles) if dt else -poles.real
    return LoopPoles(poles, poles[distance < -doubt], bool(np.all(distance > doubt)))


@dataclasses.dataclass(frozen=True)
class Edge:
    """Errors of both sides at a frequency whose loop is on its edge there, as parts of the bounds: `factor` times these."""

    omega: float
    factor: float
    values: tuple[Complex, Complex]  # of the models, (ny, nu)
    errors: tuple[Complex, Complex]
    bounds: tuple[Real, Real]


def unstable_pair(sides: tuple[Side, Side], edge: Edge, dt: float, budget: Budget) -> Pair | None:
    """A pair of consistent systems whose loop is unstable: those at hand, then such with values that go past the edge.

    A system with a wanted value is that of the same data with one more sample: it is consistent with the former ones, and verified
    as any other. None where nothing was found within the time.
    """
    found = _members(sides, budget)
    if found is None:
        return None
    pair = _judged(sides, found, dt)
    if pair is not None or not edge.factor < 1 or not np.isfinite(edge.omega):
        return pair
    for part in _PAST:
        if budget.over:
            break
        room = part * (1 - edge.factor)
        further = [_with_value(one, edge, k, edge.factor + room, _NEAR * room, budget) for k, one in enumerate(found)]
        if any(new is None and old is not None for new, old in zip(further, found, strict=True)):
            break
        pair = _judged(sides, further, dt)
        if pair is not None:
            return pair
    return None


def pair_again(sides: tuple[Side, Side], models: tuple[control.StateSpace, control.StateSpace], dt: float) -> Pair:
    """The pair of systems that were found before, judged again: stable ones with every sample inside its bound.

    ValueError: a system that is not, or a loop that is stable.
    """
    for side, model in zip(sides, models, strict=True):
        problem = side.problem
        if side.known:
            continue
        if problem is None or largest_ratio(problem, model) > 1 + _ROUNDED or not np.all(is_stable(model.A, dt)[1]):
            raise ValueError(f"the {side.name} of its unstable pair does not agree with the data")
    known = [side.model if side.known else model for side, model in zip(sides, models, strict=True)]
    poles = poles_of_loop(known[0], known[1], dt)
    if not poles.unstable.size:
        raise ValueError("the loop of its unstable pair is stable")
    return Pair(known[0], known[1], poles.unstable)


def _members(sides: tuple[Side, Side], budget: Budget) -> list[Identification | None] | None:
    """An identification of each side that is not known; None where one has no consistent system to show."""
    found: list[Identification | None] = []
    for side in sides:
        if side.known:
            found.append(None)
            continue
        if budget.over:
            return None
        one = side.identified(budget.seconds)
        if one is None or not one.consistent:
            return None
        found.append(one)
    return found


def _judged(sides: tuple[Side, Side], found: list[Identification | None], dt: float) -> Pair | None:
    """The pair of these systems, if its loop is unstable."""
    models: list[Any] = [side.model if one is None else one.model for side, one in zip(sides, found, strict=True)]
    poles = poles_of_loop(models[0], models[1], dt)
    return Pair(models[0], models[1], poles.unstable) if poles.unstable.size else None


def _with_value(
    one: Identification | None, edge: Edge, side: int, factor: float, near: float, budget: Budget
) -> Identification | None:
    """The same data with a value beside those of the model at the frequency; None where no system has it."""
    if one is None:
        return None
    problem, size = one.problem, edge.values[side].shape
    wanted = edge.values[side] + factor * edge.errors[side]
    top = np.pi / problem.dt if problem.dt else np.inf
    if edge.omega in (0.0, top):
        wanted = wanted.real + 0j
    bound = np.where(np.isfinite(edge.bounds[side]), edge.bounds[side], np.abs(edge.errors[side]))
    radius = np.maximum(near * bound, 1e-9 * np.abs(wanted)).reshape(1, *size)
    sample = FrequencyResponse(
        np.array([edge.omega]),
        wanted.reshape(1, *size),
        bound=radius,
        dt=problem.dt or None,
        inputs=problem.inputs,
        outputs=problem.outputs,
    )
    further = dataclasses.replace(problem, frequency=(*problem.frequency, sample))
    found = identify(further, time_limit=budget.seconds)
    return found if found.consistent else None
