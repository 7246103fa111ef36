"""Refinement of a state space: Levenberg-Marquardt in local coordinates, with the outputs projected out, and the exchange of modes.

The exchange leads out of a local minimum: a block more where the residual asks for it, the least important one away.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robustid.core import Budget, Complex, DampedSteps, Interruptible, Real
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.pole_distances import RESOLVED
from robustid.fitting.state_space.projected_outputs import Criterion, Fitted, LocalModel, Outputs
from robustid.fitting.state_space.subspace import subspace_estimate

_RTOL = 1e-10
_TINY = 1e-2  # length of a step in standard deviations of the parameters, all together: slope^2 = length^2/equations
_WINDOW = 6  # so many steps must together lower the criterion by what counts:
_WORTH = 0.3  # by so many standard deviations, or all is within the noise,
_SLOW = 1e-3  # and by this part of it, or a model of another order or start is worth more than further steps
_GOOD, _POOR, _LEAST_GAIN = 0.75, 0.25, 1e-4  # of what the linear model promised
_LONGER, _SHORTER, _FAR_SHORTER = 2.5, 0.5, 0.25
_SHORTEST = 1e-6  # in reaches (`BlockModel.reach`): no step so short lowers the criterion by what counts
_ROUNDS = 4  # of poles that a step would take too near to the stability boundary
_SEEN = 1e-13  # directions that the response sees less than this are not moved along
_GAIN = 1e-3  # an exchange that lowers the criterion by less than this part was not worth it
_PART = 4  # blocks for one that is exchanged first
_RICHER, _AFTER = 12, 40  # steps with the blocks more, and after as many were taken away
PER_ROUND = 2 * _RICHER + _AFTER  # the richer ones cost more


UNLIMITED = Budget()
Report = Callable[[FitStep], None]  # told of every step


class Refined(NamedTuple):
    """End of a refinement."""

    fitted: Fitted
    status: FitStatus
    history: tuple[FitStep, ...]
    bound: bool = False  # poles were held inside by the stability boundary at the end


def refine(
    problem: FractionProblem | Criterion,
    start: LocalModel,
    *,
    stable: bool,
    limit: int,
    resolved: float = RESOLVED,
    patient: bool = False,
    budget: Budget = UNLIMITED,
    report: Report | None = None,
    outputs: Outputs | None = None,
) -> Refined:
    """Levenberg-Marquardt from a realisation; every accepted step is the best so far. C and D are fitted anew at every trial;
    the tangent space of what is left is made orthonormal, ``J = Q R``, so that every step is a projection, its length that of
    changes that the response notices: the distance of a pole from the nearest point (`mckelvey2004`, `golub1973`, `more1978`).
    """
    # With `stable`, poles that a step would take out of the stability region, or nearer to the boundary than the data resolve,
    # end on their way (`BlockModel.least_distances`). `limit` is the largest number of steps; `resolved` the part of the
    # spacing of the frequency points that the damping of a mode has at least, if it began with more; `patient` goes on when the
    # last steps together lowered the criterion by less than 0.1 %; `outputs` are given where they are tied to the inputs.
    outputs = Outputs(problem) if outputs is None else outputs
    descent = _Descent(problem, start, resolved if stable else None, 0.0 if patient else _SLOW, budget, report, outputs)
    status = FitStatus.LIMIT
    with Interruptible() as steps:
        while len(descent.history) < limit:
            ended = descent.advance()
            if ended is not None:
                status = ended
                break
    if steps.interrupted:
        status = FitStatus.INTERRUPTED
    if descent.bound and status in (FitStatus.FLAT, FitStatus.STALLED):
        status = FitStatus.BOUNDARY
    return Refined(descent.best, status, tuple(descent.history), descent.bound)


class _Descent:
    """State of a refinement: the best so far, how far the linear model is trusted, and the history."""

    def __init__(
        self,
        problem: FractionProblem | Criterion,
        start: LocalModel,
        resolved: float | None,
        slow: float,
        budget: Budget,
        report: Report | None,
        outputs: Outputs,
    ) -> None:
        self.problem, self.resolved, self.slow, self.budget = problem, resolved, slow, budget
        self.report, self.outputs = report, outputs
        self.best = self.outputs.fitted(start)
        self.radius, self.bound = math.sqrt(problem.order), False
        self.history: list[FitStep] = []
        self.tiny = max(_RTOL, _TINY**2 / problem.equations)
        self.worth = max(_RTOL, _WORTH**2 / problem.equations)

    def advance(self) -> FitStatus | None:
        """One step that lowers the criterion; the status where there is none, or none is worth it."""
        problem, best = self.problem, self.best
        if best.cost <= problem.rounding:
            return FitStatus.EXACT
        reach = best.model.reach(problem.xi)
        if not reach.size:  # a rigid body alone: nothing but the outputs
            return FitStatus.STATIONARY
        R, gradient = _orthonormal(self.outputs.directions(best), best.residual.ravel())
        slope = float(np.linalg.norm(gradient)) / math.sqrt(best.cost)
        if slope**2 <= self.tiny:
            return FitStatus.STATIONARY
        least = None if self.resolved is None else best.model.least_distances(problem.xi, self.resolved)
        promised = math.inf
        while self.radius >= _SHORTEST:
            step, self.bound = _step(R * reach, gradient, self.radius, best.model, reach, least)
            length = float(np.linalg.norm(step))
            promised = float(np.sum(gradient**2) - np.sum((gradient - R @ (reach * step)) ** 2))
            if promised <= self.tiny * best.cost and length < self.radius:
                return FitStatus.FLAT
            trial = self.outputs.fitted(best.model.moved(reach * step, least))
            if self._trusted(trial, promised, length):
                return self._record(trial, min(1.0, length), slope)
            if self.budget.over:
                return FitStatus.TIME
        return FitStatus.FLAT if promised <= self.worth * best.cost else FitStatus.STALLED

    def _trusted(self, trial: Fitted, promised: float, length: float) -> bool:
        """Tell whether a trial keeps enough of what was promised; the radius follows what it kept."""
        fall = self.best.cost - trial.cost
        gain = fall / max(promised, 1e-300) if math.isfinite(trial.cost) else -1.0
        if gain > _GOOD:
            self.radius = max(self.radius, _LONGER * length)
        elif gain < _POOR:
            part = _SHORTER if gain > 0 else _FAR_SHORTER
            # Where poles are held a step may be so much longer than the radius that a part of it is no less.
            self.radius = part * (length if part * length < self.radius else self.radius)
        return gain > _LEAST_GAIN and fall > 0

    def _record(self, trial: Fitted, step: float, slope: float) -> FitStatus | None:
        """Take the trial; the status where the last steps together, or the time, say that it is the last."""
        self.best = trial
        self.history.append(FitStep("lm", trial.cost, trial.condition, step, slope))
        if self.report is not None:
            self.report(self.history[-1])
        fall = self.history[-1 - _WINDOW].cost / trial.cost - 1 if len(self.history) > _WINDOW else math.inf
        if fall <= self.worth:
            return FitStatus.FLAT
        if fall <= self.slow:
            return FitStatus.SLOW
        return FitStatus.TIME if self.budget.over else None


def _orthonormal(J: Real, r: Real) -> tuple[Real, Real]:
    """R (T, T) and Q' r of J = Q R."""
    T = J.shape[1]
    few = triangle(np.column_stack([J, r]))
    R = np.pad(few, ((0, max(T + 1 - len(few), 0)), (0, 0)))
    return R[:T, :T], R[:T, T]


def _step(
    R: Real, gradient: Real, radius: float, model: LocalModel, reach: Real, least: Real | None
) -> tuple[Real, bool]:
    """Minimise ``|gradient - R step|`` within the radius; poles that would pass their least distance end on it."""
    step = DampedSteps.of(R, gradient, _SEEN).within(radius)
    if least is None or not least.size:
        return step, False
    normals = model.normals() * reach[: model.pole_coordinates]
    size = np.linalg.norm(normals, axis=1)
    normals = np.pad(normals / size[:, None], ((0, 0), (0, len(reach) - normals.shape[1])))
    room = np.minimum((model.distances - least) / size, radius)
    held = np.zeros(len(normals), dtype=bool)
    for _ in range(_ROUNDS):
        beyond = ~held & (normals @ step < -room * (1 + 1e-9))
        if not np.any(beyond):
            break
        held |= beyond
        N = normals[held]
        fixed = -room[held] @ N
        step = fixed + DampedSteps.of(R - (R @ N.T) @ N, gradient - R @ fixed, _SEEN).within(radius)
    return step, bool(np.any(held))


def exchange_modes(
    problem: FractionProblem,
    data: Samples,
    found: Refined,
    *,
    stable: bool,
    rounds: int,
    budget: Budget,
    report: Report | None = None,
    resolved: float = RESOLVED,
    outputs: Outputs | None = None,
    structured: Callable[[BlockModel, Complex], LocalModel] = lambda model, _: model,
) -> Refined:
    """Add poles that a subspace estimate finds in the residual, refine, drop as many of the least important, refine: a quarter
    of the blocks first, then half as many. An exchange that doesn't lower the criterion isn't made. With a structure of the
    model its own `outputs` are given, and the way of blocks for a response into it (`structured`).
    """
    outputs = Outputs(problem) if outputs is None else outputs
    count = max(found.fitted.model.centre.size // _PART, 1)
    for _ in range(rounds):
        if budget.over or found.status in (FitStatus.EXACT, FitStatus.INTERRUPTED):
            break
        more = _blocks(problem, data, found, count)
        if more is None:
            break
        new = structured(more, problem.values - found.fitted.response)
        richer = refine(
            problem,
            found.fitted.model.joined(new.resolved(problem.xi, resolved) if stable else new),
            stable=stable,
            limit=_RICHER,
            resolved=resolved,
            budget=budget,
            outputs=outputs,
        )
        fitted = richer.fitted
        for _ in range(new.centre.size):  # one by one: of two equal blocks each seems needless beside the other
            fitted = outputs.fitted(fitted.model.without(int(np.argmin(outputs.importance(fitted)))))
        other = refine(
            problem,
            fitted.model,
            stable=stable,
            limit=_AFTER,
            resolved=resolved,
            budget=budget,
            report=report,
            outputs=outputs,
        )
        before = found.fitted.cost
        if other.fitted.cost < before:
            found = other._replace(history=found.history + other.history)
        if FitStatus.INTERRUPTED in (richer.status, other.status):
            return found._replace(status=FitStatus.INTERRUPTED)
        if found.fitted.cost > (1 - _GAIN) * before and count == 1:
            break
        count = max(count // 2, 1)
    return found


def _blocks(problem: FractionProblem, data: Samples, found: Refined, count: int) -> BlockModel | None:
    """Blocks that the residual shows; None where the data don't carry as many."""
    unknowns = (problem.order + 2 * count) * sum(problem.values.shape[1:])
    if unknowns > problem.equations // 2:
        return None
    residual = problem.values - found.fitted.response
    try:
        more = subspace_estimate(residual, data.points, 2 * count, weight=data.weight, domain=data.domain)
    except (InputError, np.linalg.LinAlgError):
        return None
    if not math.isfinite(more.residual):
        return None
    model = BlockModel.of(more.A / problem.scale, more.B / problem.scale, discrete=data.domain == "z")
    return model if model.centre.size else None
