"""The fit in the weight that the residuals of a relative fit ask for."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

from robustid.core import Complex
from robustid.fitting.fraction.attempt import Attempt
from robustid.fitting.fraction.iteration import FitStatus, FitStep, former, former_weight
from robustid.fitting.fraction.noise_level import gaussian, level_weight, white
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.fraction.starts import first_model
from robustid.fitting.state_space.descent import Settings
from robustid.fitting.state_space.state_fit import Samples

_TIMES = 4  # fits in a weight that residuals ask for, each by those of the last one


def asks_for_level(problem: FractionProblem, response: Complex) -> bool:
    """Tell whether the residuals of a relative fit speak of noise of a level."""
    return level_weight(problem, response, alone=True) is not None


def levelled(
    best: Attempt,
    problem: FractionProblem,
    data: Samples,
    start: Any,
    settings: Settings,
    search: Callable[..., Attempt],
) -> Attempt | None:
    """The fit in the weight that the residuals of a relative fit ask for; None unless noise of a level is all that is left then.

    From the start anew, as the relative fit may lie in another valley; then in the weights that the better residuals ask for.
    """
    level = best
    history: tuple[FitStep, ...] = ()
    for again in range(_TIMES):
        weight = level_weight(level.fit.problem, level.fit.fraction.response, alone=not again)
        if weight is None or level.fit.status is FitStatus.INTERRUPTED or time.monotonic() > settings.deadline:
            break
        history += former(level.fit.history, former_weight(again + 1))
        problem, data = dataclasses.replace(problem, weight=weight), data._replace(weight=weight.entrywise)
        model = level.found.matrices
        if not again and start is None:
            model = first_model(problem, data, None, settings.form, settings.body, settings.deadline)
        level = search(problem, data, model, settings if not again else dataclasses.replace(settings, rounds=0))
        if not white(level.fit.problem.residual(level.fit.fraction.response)):
            return None
    if level is best or not gaussian(level.fit.problem.residual(level.fit.fraction.response)):
        return None
    return level._replace(fit=dataclasses.replace(level.fit, history=history + level.fit.history), start=best.start)
