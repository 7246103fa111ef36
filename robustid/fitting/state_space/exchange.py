"""The way out of a local minimum: a block more where the residual asks for it, the least important one away."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from robustid.core import Complex
from robustid.errors import InputError
from robustid.fitting.fraction.iteration import FitStatus
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.outputs import LocalModel
from robustid.fitting.state_space.pole_distances import RESOLVED
from robustid.fitting.state_space.refinement import Budget, Outputs, Refined, refine
from robustid.fitting.state_space.state_fit import Samples
from robustid.fitting.state_space.subspace import subspace_estimate

_GAIN = 1e-3  # an exchange that lowers the criterion by less than this part was not worth it
_PART = 4  # blocks for one that is exchanged first
_RICHER, _AFTER = 12, 40  # steps with the blocks more, and after as many were taken away
PER_ROUND = 2 * _RICHER + _AFTER  # the richer ones cost more


def exchange(
    problem: FractionProblem,
    data: Samples,
    found: Refined,
    *,
    stable: bool,
    rounds: int,
    budget: Budget,
    resolved: float = RESOLVED,
    outputs: Outputs | None = None,
    structured: Callable[[BlockModel, Complex], LocalModel] = lambda model, _: model,
) -> Refined:
    """Add poles that a subspace estimate finds in the residual, refine, drop as many of the least important, refine.

    A quarter of the blocks first, then half as many. The criterion never rises: an exchange that doesn't lower it isn't
    made. With a structure of the model its own `outputs` are given, and the way of blocks for a response into it (`structured`).
    """
    outputs = Outputs(problem) if outputs is None else outputs
    count = max(found.fitted.model.centre.size // _PART, 1)
    for _ in range(rounds):
        if budget.spent or found.status in (FitStatus.EXACT, FitStatus.INTERRUPTED):
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
            budget=budget._replace(report=None),
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
