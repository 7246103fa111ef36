"""Descent in state-space coordinates: from a first model of any order to the end, over local minima and the stability boundary."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robustid.core import Budget, Complex, Interruptible, StateMatrices, response_at
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep, fit_fraction
from robustid.fitting.fraction.fraction_model import realise
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.fraction_steps import nearest_form, scalar_form
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.fraction.rigid_body import RigidBody, rigid_modes, rigid_start
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.given_poles import Samples, diagonal_blocks
from robustid.fitting.state_space.integrator_chains import input_priority
from robustid.fitting.state_space.pole_distances import RESOLVED, SEVERAL
from robustid.fitting.state_space.state_refinement import PER_ROUND, UNLIMITED, Outputs, Refined, exchange_modes, refine
from robustid.fitting.state_space.subspace import subspace_estimate
from robustid.fitting.state_space.withheld_points import left_out_cost, withheld_residuals

NOTHING_LEFT = 1e-6  # a residual of this part of the data is no measurement noise
# Residuals of a fit at the noise floor are independent and Gaussian: this many standard deviations from that are too much.
WHITE = 5.0
_WORK = 2e10  # products of equations and squared coordinates that a fit may take before it tries no further way
_BY_ITSELF = 100.0  # the criterion with every point left out, over the criterion: single points decide modes
_WORTH = 2.0  # a mode that the points don't resolve lowers the criterion at least by this factor
_FEW, _MANY = 40, 300  # steps, whatever they cost
_MUCH = 0.99  # an unstable fit of this part of the cost says that the stability boundary ended the descent
_STEPS, _BEYOND = 100, 30  # of the refinement; beyond the stability boundary, and back


@dataclasses.dataclass(frozen=True)
class Settings:
    """Choices of a fit; see `fit_mfd`."""

    phases: list[str]
    body: RigidBody | None
    form: str
    stable: bool
    progress: Callable[[FitStep], None] | None
    rounds: int = 0  # of the way out of local minima
    budget: Budget = UNLIMITED
    # Whether a refined model is enough: no mode is exchanged then, and nothing is tried beyond the stability boundary.
    enough: Callable[[FractionProblem, Complex], bool] | None = None


class Descent(NamedTuple):
    """End of a descent in state-space coordinates."""

    problem: FractionProblem  # with the directions of rigid-body modes that were found
    model: StateMatrices
    refined: Refined
    start: Complex  # response of the start
    reflected: int
    unstable_cost: float
    early: bool


def refinable(problem: FractionProblem) -> bool:
    """Tell whether a state space can keep what is asked for by its outputs alone, for any poles and inputs: entries that are
    zero, and rigid-body modes inside, are conditions on poles and inputs, which need the fraction.
    """
    return not np.any(problem.zeros) and (problem.rigid is None or problem.rigid.outside)


def with_rigid_modes(
    problem: FractionProblem, data: Samples, model: StateMatrices, body: RigidBody | None
) -> tuple[FractionProblem, StateMatrices]:
    """The problem with the rigid-body modes that are asked for, and a first model that has them."""
    if body is None:
        return problem, model
    model, directions = rigid_start(data, model.A, model.C, body, feedthrough=problem.feedthrough)
    return rigid_modes(problem, data, model, directions, body), model


def descended(problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings) -> Descent:
    """Descent in state-space coordinates from a first model of any order."""
    start = response_at(model, data.points)
    if len(model.A) < problem.order and problem.rigid is None:
        model = _completed(problem, data, model)
    if len(model.A) != problem.order:
        form, first = best_form(problem, model, data, True)
        model = realise(form, first).matrices
    if problem.response_conditions:  # which the start need not meet
        start = _best_response(problem, model)
    refined, count, free_cost, early = _descended(problem, data, model, settings)
    if problem.response_conditions and _may_go_on(problem, refined, settings):
        other = _by_fractions(problem, data, model)
        if other is not None:
            second = _descended(problem, data, other, settings)
            if second[0].fitted.cost < refined.fitted.cost:
                history = refined.history + second[0].history
                refined, (count, free_cost, early) = second[0]._replace(history=history), second[1:]
    fitted = refined.fitted
    end = fitted.state_space(problem.scale)
    end = end.transposed() if flipped(problem) else end
    if problem.rigid is not None:
        problem = dataclasses.replace(
            problem, rigid=dataclasses.replace(problem.rigid, directions=fitted.model.directions)
        )
    return Descent(problem, end, refined, start, count, free_cost, early)


def _may_go_on(problem: FractionProblem, found: Refined, settings: Settings) -> bool:
    """Tell whether another start is worth its time: the residual still has a shape, and there is time."""
    response = found.fitted.response
    if flipped(problem):
        response = response.transpose(0, 2, 1)
    stopped = found.status is FitStatus.INTERRUPTED or settings.budget.over
    return bool(settings.rounds) and not stopped and suspicious(problem, response, found.status)


def _by_fractions(problem: FractionProblem, data: Samples, model: StateMatrices) -> StateMatrices | None:
    """A model that SK steps make of a first one, as a fraction that meets the conditions; None where there is none. The poles
    of a start that doesn't know the conditions may be far from those that are best with them.
    """
    try:
        form, first = best_form(problem, model, data, True)
        other = realise(form, fit_fraction(form, start=first, method="sk").fraction).matrices
    except (InputError, np.linalg.LinAlgError):
        return None
    return other if len(other.A) == problem.order and all(np.all(np.isfinite(part)) for part in other) else None


def _completed(problem: FractionProblem, data: Samples, model: StateMatrices) -> StateMatrices:
    """A model of too low an order, with the missing poles where what it leaves of the data asks for them."""
    residual = problem.values - response_at(model, data.points)
    missing = problem.order - len(model.A)
    try:
        more = subspace_estimate(residual, data.points, missing, weight=data.weight, domain=data.domain)
    except (InputError, np.linalg.LinAlgError):
        return model
    A, B = diagonal_blocks(model.A, more.A), np.vstack([model.B, more.B])
    return StateMatrices(A, B, np.hstack([model.C, more.C]), model.D)


def _best_response(problem: FractionProblem, model: StateMatrices) -> Complex:
    """Response of the poles and inputs of a state space with the best outputs that meet the conditions."""
    turned = flipped(problem)
    if turned:
        problem, model = problem.transposed(), model.transposed()
    best = Outputs(problem).fitted(blocks_of(problem, model))
    if not np.isfinite(best.cost):
        raise InputError(
            "`constraints` contradict each other, or the order is too small for them; take some away or raise `order`"
        )
    return best.response.transpose(0, 2, 1) if turned else best.response


def flipped(problem: FractionProblem) -> bool:
    """Tell whether the transposed response is refined: the larger side is the one that is projected out."""
    return problem.rigid is None and problem.values.shape[2] > problem.values.shape[1]


def _descended(
    problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings
) -> tuple[Refined, int, float, bool]:
    """End of the refinement; number and cost of the unstable poles of a better fit without stability; whether it ended early."""
    if flipped(problem):
        problem, data, model = problem.transposed(), data.transposed(), model.transposed()
    start = start_of(problem, model, stable=settings.stable)
    found = _first(problem, start, settings, RESOLVED)
    ended = found.status is FitStatus.INTERRUPTED or settings.budget.over
    if settings.enough is not None and not ended and settings.enough(problem, found.fitted.response):
        return found, 0, np.nan, True
    found = _further(problem, data, found, settings, RESOLVED)
    if settings.stable and found.status is not FitStatus.INTERRUPTED and not settings.budget.over:
        found, resolved = _seen_by_several(problem, data, start, settings, found)
        if found.bound and not settings.budget.over:
            return *_beyond(problem, found, resolved, settings), False
    return found, 0, np.nan, False


def _first(problem: FractionProblem, start: BlockModel, settings: Settings, resolved: float) -> Refined:
    """End of the refinement from the start."""
    steps = min(_STEPS, _allowance(problem))
    return refine(
        problem,
        start,
        stable=settings.stable,
        limit=steps,
        resolved=resolved,
        budget=settings.budget,
        report=settings.progress,
    )


def _further(problem: FractionProblem, data: Samples, found: Refined, settings: Settings, resolved: float) -> Refined:
    """End of the exchange of modes, and of the steps that are left."""
    steps = _allowance(problem)
    rounds = min(settings.rounds, (steps - len(found.history)) // PER_ROUND)
    if rounds > 0 and suspicious(problem, found.fitted.response, found.status):
        found = exchange_modes(
            problem,
            data,
            found,
            stable=settings.stable,
            rounds=rounds,
            resolved=resolved,
            budget=settings.budget,
            report=settings.progress,
        )
        steps -= rounds * PER_ROUND
    left = steps - len(found.history)
    if found.status is FitStatus.SLOW and left > 0 and not settings.budget.over:
        more = refine(
            problem,
            found.fitted.model,
            stable=settings.stable,
            limit=left,
            resolved=resolved,
            patient=True,
            budget=settings.budget,
            report=settings.progress,
        )
        found = more._replace(history=found.history + more.history)
    return found


def _seen_by_several(
    problem: FractionProblem, data: Samples, start: BlockModel, settings: Settings, found: Refined
) -> tuple[Refined, float]:
    """The fit, or where single points decide modes between them, one whose modes are as wide as half the points' spacing. Such
    a mode may follow the noise of its point, and is free between the points; then the wider ones predict better what is
    withheld. Where it is worth more than a factor of two it is a mode of the plant.
    """
    outputs, model = Outputs(problem), found.fitted.model
    narrow = model.distances < SEVERAL * model.spacing(problem.xi)
    if not np.any(narrow) or left_out_cost(outputs, found.fitted) <= _BY_ITSELF * found.fitted.cost:
        return found, RESOLVED
    wide = _first(problem, start.resolved(problem.xi, SEVERAL), settings, SEVERAL)
    wide = _further(problem, data, wide, settings, SEVERAL)
    if settings.budget.over or wide.fitted.cost > min(_WORTH * found.fitted.cost, outputs.fitted(start).cost):
        return found, RESOLVED
    costs: list[float] = []
    with Interruptible() as judging:
        for part, one in ((RESOLVED, found), (SEVERAL, wide)):
            left = withheld_residuals(problem, one.fitted.model, stable=True, resolved=part, budget=settings.budget)
            costs.append(float(np.linalg.norm(problem.weight.apply(left))))
    if judging.interrupted:
        return found._replace(status=FitStatus.INTERRUPTED), RESOLVED
    if costs[0] <= costs[1]:
        return found, RESOLVED
    return wide._replace(history=found.history + wide.history), SEVERAL


def _beyond(
    problem: FractionProblem, found: Refined, resolved: float, settings: Settings
) -> tuple[Refined, int, float]:
    """Look beyond the boundary: the end of the way back where it is lower, unstable poles of the best model there, its cost."""
    free = refine(problem, found.fitted.model, stable=False, limit=_BEYOND, budget=settings.budget)
    poles = free.fitted.model.poles
    unstable = int(np.sum(np.abs(poles) >= 1 if problem.dt is not None else poles.real >= 0))
    inside = free.fitted.model.resolved(problem.xi, resolved)
    back = refine(
        problem, inside, stable=True, limit=_BEYOND, resolved=resolved, budget=settings.budget, report=settings.progress
    )
    if back.fitted.cost < found.fitted.cost:
        found = back._replace(history=found.history + back.history)
    if not unstable or free.fitted.cost >= found.fitted.cost:
        return found, 0, np.nan
    if free.fitted.cost < _MUCH * found.fitted.cost:
        found = found._replace(status=FitStatus.BOUNDARY)
    return found, unstable, free.fitted.cost


def start_of(problem: FractionProblem, model: StateMatrices, *, stable: bool) -> BlockModel:
    """A realisation as blocks; stable, the better one of its reflected poles as they are and with all modes resolved."""
    start = blocks_of(problem, model)
    if not stable:
        return start
    inside, outputs = start.reflected(), Outputs(problem)
    return min(inside, inside.resolved(problem.xi), key=lambda model: outputs.fitted(model).cost)


def blocks_of(problem: FractionProblem, model: StateMatrices) -> BlockModel:
    """A realisation in s or z as blocks in the unit of the nodes, its rigid-body chains (at the end) as the problem says."""
    directions, free = directions_of(problem)
    flexible = len(model.A) - 2 * len(directions)
    A, B = model.A[:flexible, :flexible] / problem.scale, model.B[:flexible] / problem.scale
    return BlockModel.of(A, B, discrete=problem.dt is not None, directions=directions, free=free)


def directions_of(problem: FractionProblem) -> tuple[np.ndarray, np.ndarray]:
    """Directions (count, nu) of the rigid-body modes, and which of their entries are free."""
    nu = problem.values.shape[2]
    if problem.rigid is None:
        return np.zeros((0, nu)), np.zeros((0, nu), dtype=bool)
    free = np.zeros(problem.rigid.directions.shape, dtype=bool)
    free[:, problem.rigid.others(nu)] = problem.rigid.free
    return problem.rigid.directions, free


def dear(problem: FractionProblem) -> bool:
    """Tell whether the number of steps is limited by what one costs."""
    return _allowance(problem) < _MANY


def _allowance(problem: FractionProblem) -> int:
    """Number of steps, by what one costs: the same on every machine, some seconds on most."""
    directions = problem.order * min(problem.values.shape[1:])
    return int(np.clip(_WORK / (problem.equations * directions**2), _FEW, _MANY))


def suspicious(problem: FractionProblem, response: np.ndarray, status: FitStatus) -> bool:
    """Tell whether the residual still has a shape over frequency: a mode missed by a poor start, or an order too small."""
    residual = problem.residual(response)
    size = float(np.linalg.norm(residual)) ** 2
    if size <= (NOTHING_LEFT * float(np.linalg.norm(problem.weight.apply(problem.values)))) ** 2:
        return False
    return not status.converged or not white(residual)


def white(residual: Complex) -> bool:
    """Tell whether neighbouring weighted residuals (F, n) are as independent as those of noise."""
    if not np.any(residual):
        return True
    return correlation(residual) * np.sqrt(2 * np.count_nonzero(residual)) <= WHITE


def correlation(residual: Complex) -> float:
    """Correlation of neighbouring residuals, real part."""
    return float(np.real(np.vdot(residual[1:], residual[:-1]))) / float(np.linalg.norm(residual)) ** 2


def best_form(
    problem: FractionProblem, model: StateMatrices, data: Samples, may_pair: bool, *, full: bool = True
) -> tuple[FractionProblem, NodeFraction]:
    """Degrees by ones or by twos, whichever reproduces the first model better."""
    states = response_at((model.A, model.B, np.eye(len(model.A)), np.zeros(model.B.shape)), data.points)
    values = model.C @ states + model.D
    if problem.free and problem.rigid is None and problem.values.shape[2] == 1 and len(model.A) == problem.order:
        form = dataclasses.replace(problem, pairs=False, priority=(0,))
        return form, scalar_form(form, np.linalg.eigvals(model.A) / problem.scale, values)
    states = states / np.linalg.norm(values, axis=(1, 2), keepdims=True)
    forms: list[FractionProblem] = []
    for pairs in (False, True)[: 1 + may_pair]:
        priority = input_priority(model, states, 2 if pairs else 1)
        form = dataclasses.replace(problem, pairs=pairs, priority=priority)
        if not forms or not np.array_equal(form.degrees, forms[0].degrees):
            forms.append(form)
    return nearest_form(forms, values, full=full)
