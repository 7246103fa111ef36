"""The noise that a fit leaves, as a level beside a relative part: what a relative weight can't know before."""

from __future__ import annotations

import numpy as np

from robustid.core import Complex, Real
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.problem import FractionProblem

_RATIOS = np.concatenate(
    [[0.0], np.geomspace(1e-8, 1e8, 65)]
)  # squares of level over relative part times the median of |P|
_BOTH = 2.0  # what a second number must gain (Akaike)
_TELLING = 0.1  # so much log-likelihood a sample says that there is a level
_MOSTLY_WHITE = 0.5  # neighbouring residuals that are correlated more are a model error's
# Residuals of a fit at the noise floor are independent and Gaussian: this many standard deviations from that are too much.
_WHITE = 5.0
_NOTHING_LEFT = 1e-6  # a residual of this part of the data is no measurement noise


def level_weight(problem: FractionProblem, response: Complex, *, alone: bool = False) -> Weight | None:
    """Inverse standard deviations ``(a^2 + b^2 |P|^2)^(-1/2)`` per entry, from the residuals of a relative fit.

    a and b are those of the greatest likelihood, for every entry its own; |P| is that of the model. None where the residuals
    speak of no level, or of what the model misses rather than of noise.

    Parameters
    ----------
    problem : FractionProblem
        Its weight has a number an entry.
    response : (F, ny, nu) complex array
        Of the model that was fitted.
    alone : bool
        Leave the relative part out of entries that have a level: a poor fit errs where the response is large, which looks like one.
    """
    residual, used = problem.values - response, problem.weight.entries > 0
    weighted = problem.residual(response)
    if np.linalg.norm(weighted) <= _NOTHING_LEFT * np.linalg.norm(problem.weight.apply(problem.values)):
        return None
    if _correlation(weighted) > _MOSTLY_WHITE:
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


def white(residual: Complex) -> bool:
    """Tell whether neighbouring weighted residuals (F, n) are as independent as those of noise."""
    if not np.any(residual):
        return True
    return _correlation(residual) * np.sqrt(2 * np.count_nonzero(residual)) <= _WHITE


def gaussian(residual: Complex) -> bool:
    """Tell whether weighted residuals (F, n) have no heavier tails than Gaussian noise: ``E|e|^4 = 2 (E|e|^2)^2``.

    What a model of too low an order misses is large near few resonances, however little neighbours there resemble each other.
    """
    power: Real = np.abs(residual) ** 2
    size: Real = power.mean(axis=0)
    relative: Real = power[:, size > 0] / size[size > 0]
    return not relative.size or float(np.mean(relative**2) - 2) * np.sqrt(relative.size / 20) <= _WHITE


def _correlation(residual: Complex) -> float:
    """Correlation of neighbouring residuals, real part."""
    return float(np.real(np.vdot(residual[1:], residual[:-1]))) / float(np.linalg.norm(residual)) ** 2
