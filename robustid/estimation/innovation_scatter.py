"""Scatter of the innovations of a record without periods: sample instants that are off."""

from __future__ import annotations

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind
from robustid.estimation.innovations import Predictor

_CHANCE = 1e-4
_PARTS, _FEWEST = 20, 60  # of a record; samples of each
_SMALLEST = 1e-3  # samples
_SHARE = 0.15  # of the power of the innovations that goes with the slope


def jitter_of_innovations(predictor: Predictor, w: Real, y: Real, u: Real, dt: float, where: str) -> list[Fault]:
    """Output (T,) whose innovations (T - n,) scatter with the square of its slope, filtered as the predictor filters noise.

    A sample instant that is off by t adds ``e = t dy/dt`` to one sample, and ``a(q) e`` to the innovations, whose mean square is
    that of t times ``sum_k a_k^2 (dy/dt)^2[k back]``. Every part of the record gives an estimate of the mean square of t, beside
    what goes with the squares of the signals themselves; by Student's t they are above zero together.
    """
    from scipy.special import stdtrit

    length = w.size // _PARTS
    power = float(np.mean(w**2))
    if length < _FEWEST or power == 0:
        return []
    # The slope and the output before the sample: what the noise has not made yet.
    last = np.insert(y[:-1], 0, y[0])
    foreseen = y - np.concatenate([np.zeros(y.size - w.size), w])
    squares = [(foreseen - last) ** 2, (last - y.mean()) ** 2]
    squares += [(one - one.mean()) ** 2 for one in u.T if np.ptp(one) > 0]
    patterns = np.stack([np.convolve(one, predictor.a**2)[y.size - w.size : y.size] for one in squares], axis=1)
    columns = np.hstack([patterns / patterns.mean(axis=0), np.ones((w.size, 1))])
    each = np.array(
        [
            np.linalg.lstsq(columns[rows], w[rows] ** 2, rcond=None)[0][0]
            for rows in (slice(k * length, (k + 1) * length) for k in range(_PARTS))
        ]
    )
    share = float(each.mean()) / power
    sure = float(stdtrit(_PARTS - 1, 1 - _CHANCE)) * float(each.std(ddof=1)) / np.sqrt(_PARTS) / power
    if share < max(sure, _SHARE):
        return []
    samples = float(np.sqrt(share * power / patterns[:, 0].mean()))
    if samples < _SMALLEST:
        return []
    words = (
        f"{where} scatters where it moves fast: its sample instants are off by {samples:.2g} samples ({samples * dt:.2g} s) rms;"
        " sample it by the clock of the input"
    )
    return [Fault(FaultKind.JITTER, words, where=where, size=samples)]
