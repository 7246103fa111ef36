"""Choice of one of several weights: the one whose fit predicts frequency points best that were withheld from it."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from robustid.core import StateMatrices
from robustid.errors import InputError
from robustid.fitting.fraction.iteration import FitStatus
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.state_space.descent import Settings, dear, flipped, refinable, start_of, with_rigid_modes
from robustid.fitting.state_space.left_out import withheld_residuals
from robustid.fitting.state_space.refinement import Budget, refine
from robustid.fitting.state_space.state_fit import Samples

_STEPS, _OTHERS = 20, 3  # of the fit that is judged, and of those without a quarter of the points
_BETTER = 0.95  # another weight must lower the error to this part: below, chance decides
# What the error of a fit with a pole at the stability boundary counts: such a pole serves single points, and the points beside it
# hardly tell. On measured data another weight without one was worse by 6 %, and right, or by more than 60 %, and wrong.
_AT_BOUNDARY = 1.25
# Squares of an entry's level that a point counts with beside its own |P|^2. On measured data 10 to 20 chose best: with few the
# antiresonances decide, with many more the one point that happens to lie on a narrow resonance.
_LEVELS = 10.0
_TIME = 0.25  # part of what is left of a time limit

Question = tuple[FractionProblem, Samples]


def chosen(
    questions: Sequence[Question], first: Callable[[FractionProblem, Samples], StateMatrices], settings: Settings
) -> Question:
    """The question in the weight whose fit predicts best; the first one unless another is better by 5 %.

    All are judged by the same measure, none of their own weights: the root of the mean of ``11 |e|^2/(|P|^2 + 10 mean |P|^2)``
    over entries and frequency points, each point withheld once (`predicted_error`), and a quarter more with a pole at the
    stability boundary. Not where steps are dear: so many states miss little, and the choice would take as long as half the fit.

    Parameters
    ----------
    questions : sequence of (FractionProblem, Samples)
        The same in several weights.
    first : callable
        The first model for a question.
    settings : Settings

    Raises
    ------
    KeyboardInterrupt
        Nothing is known then that could be returned.
    """
    own = questions[0][0]
    unknowns = own.order * sum(own.values.shape[1:])
    judgeable = settings.phases == ["lm"] and refinable(own) and unknowns <= own.equations // 2 and not dear(own)
    if len(questions) < 2 or not judgeable:
        return questions[0]
    now = time.monotonic()
    budget = Budget(now + _TIME * (settings.deadline - now))
    errors: list[float] = []
    for problem, data in questions:
        try:
            error = predicted_error(problem, data, first(problem, data), settings, budget)
        except (InputError, np.linalg.LinAlgError):
            error = math.inf
        errors.append(error if math.isfinite(error) else math.inf)
        if budget.spent:
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
    """Error at frequency points that are withheld, a quarter of them at a time, of a short fit refined on the others.

    A quarter more where the short fit ends at the stability boundary.
    """
    problem, model = with_rigid_modes(problem, data, model, settings.body)
    if len(model.A) != problem.order:
        return math.nan
    if flipped(problem):
        problem, model = problem.transposed(), model.transposed()
    start = start_of(problem, model, stable=settings.stable)
    found = refine(problem, start, stable=settings.stable, limit=_STEPS, budget=budget)
    if found.status is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt
    power = np.abs(problem.values) ** 2
    size = (power + _LEVELS * power.mean(axis=0)) / (1 + _LEVELS)
    left = withheld_residuals(problem, found.fitted.model, stable=settings.stable, steps=_OTHERS, budget=budget)
    judged = (problem.weight.entries > 0) & (left != 0)
    error = math.sqrt(np.sum(np.where(judged, np.abs(left) ** 2 / size, 0.0)) / max(np.count_nonzero(judged), 1))
    return error * (_AT_BOUNDARY if found.status is FitStatus.BOUNDARY else 1.0)
