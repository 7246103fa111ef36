"""The largest response, of what is measured and bounded: its frequency, and the error there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Real, exponents_of
from robustid.guarantees import Band, WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification, MixedProblem
from robustid.report.identified import model_size
from robustid.report.words import HZ, in_hz

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

_ROUNDING = 1e-9  # of frequencies, as shares
_TINY = np.finfo(float).tiny
_LIGHT = 0.5  # damping ratio, below which a mode has a resonance
_PEAK = 1.1  # times the smallest response to either side
_NEARLY = 0.9  # of the highest frequency of sampled data: up to there they say it all


def at_largest(identification: Identification, error: WorstCaseError | WorstCaseOverPoles | Band) -> tuple[str, float]:
    """Say where the response is largest in the measured band, of what is bounded, and the error there as a share of it."""
    size, upper = model_size(error), error.sigma_upper
    bounded = error.bounded if isinstance(error, Band) else np.isfinite(upper)
    known, beside = np.flatnonzero(bounded), "" if bounded.all() else " that is bounded"
    place = int(known[np.argmax(size[known])])
    inside = known[in_measured_band(identification, error.omega[known])]
    if inside.size and place not in inside:
        known, beside = inside, f" in the measured band{beside}"
        place = int(known[np.argmax(size[known])])
    model = identification.model if error.model is None else error.model
    where = f"at the largest response{beside}, {in_hz(error.omega[place] / HZ, 4)}"
    if error.omega[place] == 0:
        where = "at 0 Hz: the static gain"
    elif is_resonance(model, error.omega[known], size[known]):
        where = f"at the resonance, {in_hz(error.omega[place] / HZ, 4)}"
    return where, float(upper[place] / max(size[place], _TINY))


def measured_band(problem: MixedProblem) -> tuple[float, float] | None:
    """Lowest and highest sample of the responses, rad/s; None where samples in time are used too."""
    points = _points(problem)
    return None if problem.time or not points.size else (float(points.min()), float(points.max()))


def _points(problem: MixedProblem) -> Real:
    """Frequencies of all samples of the responses that are used, rad/s, ascending."""
    used = [one.omega[one.bound.used.any(axis=(1, 2))] for one in problem.frequency]
    return np.unique(np.concatenate([np.zeros(0), *used]))


def beyond_measured(problem: MixedProblem) -> str:
    """Words on the frequencies below and above all samples, "below 2 Hz and above 30 Hz"; empty where samples are up to the ends.

    The lowest sample is at the end where the next one is half as far from it as it is from 0 Hz, or farther.
    """
    low, high = measured_band(problem) or (0.0, np.inf)  # of records: no end
    points, dt = _points(problem), problem.dt
    found = [f"below {in_hz(low / HZ, 4)}"] if points.size > 1 and low > 2 * (points[1] - low) else []
    if not np.isinf(high) and (not dt or high < _NEARLY * np.pi / dt):
        found.append(f"above {in_hz(high / HZ, 4)}")
    return " and ".join(found)


def in_measured_band(identification: Identification, omega: Real) -> NDArray[np.bool_]:
    """Frequencies between the lowest and the highest sample of the responses; all of them where samples in time are used too."""
    low, high = measured_band(identification.problem) or (0.0, np.inf)
    return (omega >= low * (1 - _ROUNDING)) & (omega <= high * (1 + _ROUNDING))


def is_resonance(model: control.StateSpace, omega: Real, size: Real) -> bool:
    """Return whether the largest of the sizes at `omega` [rad/s] is a peak, of a light mode of the model between its neighbours.

    A peak is 10 % above the smallest size to either side: a mode of damping 0.5 alone stands 15 % above its static gain.
    """
    place = int(np.argmax(size))
    if not 0 < place < size.size - 1 or size[place] <= _PEAK * max(size[:place].min(), size[place + 1 :].min()):
        return False
    poles = model.poles()
    s = exponents_of(poles[(poles.imag > 0) & (poles != 0)], model.dt or None)
    damping, natural = -s.real / np.abs(s), np.abs(s)
    reach = 1 + np.clip(damping, 0.0, 1.0)[:, None] * [-1.0, 1.0]
    low, high = (natural[:, None] * reach).T
    return bool(np.any((damping < _LIGHT) & (low <= omega[place + 1]) & (high >= omega[place - 1])))
