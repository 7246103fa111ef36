"""Choice of the weight: before a fit the one that predicts withheld points best, after it the one that its residuals ask for.

A relative weight can't know before that the noise has a level; the residuals of the fit tell it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from robustid.core import Budget, Complex, Real, StateMatrices, pass_on
from robustid.errors import InputError
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.first_models import first_model
from robustid.fitting.fraction.fit_search import FitEnd
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep, former, former_weight
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.state_descent import (
    NOTHING_LEFT,
    WHITE,
    Settings,
    correlation,
    dear,
    flipped,
    refinable,
    start_of,
    white,
    with_rigid_modes,
)
from robustid.fitting.state_space.state_refinement import refine
from robustid.fitting.state_space.withheld_points import withheld_residuals

_STEPS, _OTHERS = 20, 3  # of the fit that is judged, and of those without a quarter of the points
_BETTER = 0.95  # another weight must lower the error to this part: below, chance decides
# What the error of a fit with a pole at the stability boundary counts: such a pole serves single points, and the points beside it
# hardly tell. On measured data another weight without one was worse by 6 %, and right, or by more than 60 %, and wrong.
_AT_BOUNDARY = 1.25
# Squares of an entry's level that a point counts with beside its own |P|^2. On measured data 10 to 20 chose best: with few the
# antiresonances decide, with many more the one point that happens to lie on a narrow resonance.
_LEVELS = 10.0
_TIME = 0.25  # part of what is left of a time limit

_TIMES = 4  # fits in a weight that residuals ask for, each by those of the last one
_RATIOS = np.concatenate(
    [[0.0], np.geomspace(1e-8, 1e8, 65)]
)  # squares of level over relative part times the median of |P|
_BOTH = 2.0  # what a second number must gain (Akaike)
_TELLING = 0.1  # so much log-likelihood a sample says that there is a level
_MOSTLY_WHITE = 0.5  # neighbouring residuals that are correlated more are a model error's

Question = tuple[FractionProblem, Samples]


def chosen(
    questions: Sequence[Question], first: Callable[[FractionProblem, Samples], StateMatrices], settings: Settings
) -> Question:
    """The question in the weight whose fit predicts best; the first one unless another is better by 5 %. All are judged by one
    measure, none of their own weights: the root of the mean of ``11 |e|^2/(|P|^2 + 10 mean |P|^2)`` over entries and frequency
    points, each point withheld once, and a quarter more with a pole at the stability boundary.
    """
    # Not where steps are dear: so many states miss little, and the choice would take as long as half the fit. Ctrl-C is not
    # kept back, as nothing is known then that could be returned.
    own = questions[0][0]
    unknowns = own.order * sum(own.values.shape[1:])
    judgeable = settings.phases == ["lm"] and refinable(own) and unknowns <= own.equations // 2 and not dear(own)
    if len(questions) < 2 or not judgeable:
        return questions[0]
    budget = settings.budget.share(_TIME)
    errors: list[float] = []
    for problem, data in questions:
        try:
            error = predicted_error(problem, data, first(problem, data), settings, budget)
        except (InputError, np.linalg.LinAlgError):
            error = math.inf
        errors.append(error if math.isfinite(error) else math.inf)
        if budget.over:
            return questions[0]
    best = int(np.argmin(errors))
    if not errors[best] < _BETTER * errors[0]:
        return questions[0]
    problem, data = questions[best]
    note = (
        f"{problem.weight.note}: it predicts withheld frequency points to {100 * errors[best]:.3g} % of their level, the covariance"
        f" with room for what the model misses to {100 * errors[0]:.3g} %"
    )
    return dataclasses.replace(problem, weight=dataclasses.replace(problem.weight, note=note)), data


def predicted_error(
    problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings, budget: Budget
) -> float:
    """Error at frequency points that are withheld, a quarter of them at a time, of a short fit refined on the others; a quarter
    more where the short fit ends at the stability boundary.
    """
    problem, model = with_rigid_modes(problem, data, model, settings.body)
    if len(model.A) != problem.order:
        return math.nan
    if flipped(problem):
        problem, model = problem.transposed(), model.transposed()
    start = start_of(problem, model, stable=settings.stable)
    found = refine(problem, start, stable=settings.stable, limit=_STEPS, budget=budget)
    pass_on(found.status is FitStatus.INTERRUPTED)
    power = np.abs(problem.values) ** 2
    size = (power + _LEVELS * power.mean(axis=0)) / (1 + _LEVELS)
    left = withheld_residuals(problem, found.fitted.model, stable=settings.stable, steps=_OTHERS, budget=budget)
    judged = (problem.weight.entries > 0) & (left != 0)
    error = math.sqrt(np.sum(np.where(judged, np.abs(left) ** 2 / size, 0.0)) / max(np.count_nonzero(judged), 1))
    return error * (_AT_BOUNDARY if found.status is FitStatus.BOUNDARY else 1.0)


def asks_for_level(problem: FractionProblem, response: Complex) -> bool:
    """Tell whether the residuals of a relative fit speak of noise of a level."""
    return level_weight(problem, response, alone=True) is not None


def levelled(
    best: FitEnd,
    problem: FractionProblem,
    data: Samples,
    start: object,
    settings: Settings,
    search: Callable[..., FitEnd],
) -> FitEnd | None:
    """The fit in the weight that the residuals of a relative fit ask for; None unless noise of a level is all that is left
    then. From the start anew, as the relative fit may lie in another valley; then in the weights that the better residuals ask
    for.
    """
    level = best
    history: tuple[FitStep, ...] = ()
    for again in range(_TIMES):
        weight = level_weight(level.fit.problem, level.fit.fraction.response, alone=not again)
        if weight is None or level.fit.status is FitStatus.INTERRUPTED or settings.budget.over:
            break
        history += former(level.fit.history, former_weight(again + 1))
        problem, data = dataclasses.replace(problem, weight=weight), data._replace(weight=weight.entrywise)
        model = level.found.matrices
        if not again and start is None:
            model = first_model(problem, data, None, settings.form, settings.body, settings.stable, settings.budget)
        level = search(problem, data, model, settings if not again else dataclasses.replace(settings, rounds=0))
        if not white(level.fit.problem.residual(level.fit.fraction.response)):
            return None
    if level is best or not gaussian(level.fit.problem.residual(level.fit.fraction.response)):
        return None
    return level._replace(fit=dataclasses.replace(level.fit, history=history + level.fit.history), start=best.start)


def level_weight(problem: FractionProblem, response: Complex, *, alone: bool = False) -> Weight | None:
    """Inverse standard deviations ``(a^2 + b^2 |P|^2)^(-1/2)`` of the greatest likelihood, every entry its own, from the
    residuals of a relative fit of response P; None where they speak of no level, or of what the model misses rather than of
    noise. `alone` leaves b out of entries that have a level: a poor fit errs where the response is large, which looks like one.
    """
    residual, used = problem.values - response, problem.weight.entries > 0
    weighted = problem.residual(response)
    if np.linalg.norm(weighted) <= NOTHING_LEFT * np.linalg.norm(problem.weight.apply(problem.values)):
        return None
    if correlation(weighted) > _MOSTLY_WHITE:
        return None
    size, error, samples = np.abs(response) ** 2, np.where(used, np.abs(residual) ** 2, 0.0), used.sum(axis=0)
    if samples.min() < 1 or not np.all(size[used] > 0):
        return None
    median = np.array(
        [[np.median(size[used[:, i, j], i, j]) for j in range(used.shape[2])] for i in range(used.shape[1])]
    )
    heights: list[np.ndarray] = []
    shapes: list[np.ndarray] = []
    for ratio in _RATIOS:  # twice the negative logarithm of the likelihood, but for a constant, at the best b
        shape = np.where(used, ratio * median + size, 1.0)
        variance = (error / shape).sum(axis=0) / samples
        heights.append(2 * np.log(shape).sum(axis=0) + 2 * samples * np.log(variance))
        shapes.append(variance)
    heights[1:-1] = [height + _BOTH for height in heights[1:-1]]
    best = np.argmin(heights, axis=0)
    if float(np.sum(heights[0] - np.min(heights, axis=0))) / 2 <= _TELLING * int(samples.sum()):
        return None
    variance = np.take_along_axis(np.array(shapes), best[None], axis=0)[0]
    level = _RATIOS[best] * median
    shape = variance * (level + np.where(alone & (level > 0), 0.0, size))
    note = "a level and a relative part, found in the residuals of a relative fit: the data have no covariance"
    return Weight(np.where(used, 1 / np.sqrt(shape), 0.0), note=note)


def gaussian(residual: Complex) -> bool:
    """Tell whether weighted residuals (F, n) have no heavier tails than Gaussian noise, ``E|e|^4 = 2 (E|e|^2)^2``: what a model
    of too low an order misses is large near few resonances, however little neighbours there resemble each other.
    """
    power: Real = np.abs(residual) ** 2
    size: Real = power.mean(axis=0)
    relative: Real = power[:, size > 0] / size[size > 0]
    return not relative.size or float(np.mean(relative**2) - 2) * np.sqrt(relative.size / 20) <= WHITE
