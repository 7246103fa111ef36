"""Slow drifts of sensors in periodic records, estimated jointly with the periodic response and removed."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

from robustid.core import Real

_DEGREE = 3  # of the polynomial in time, at most; and below the number of periods
_SIGNIFICANT = 6.0  # standard deviations of white noise


def without_drift(signals: np.ndarray, period: int) -> tuple[Real, Real]:
    """Signals of whole periods without what drifts, and how much that was.

    ``y(t) = s(t mod period) + sum_j c_j t^j + e(t)``, least squares over s and c together: the powers of t, less their mean over
    the periods at every sample of a period, are regressed on y less its own. A drift repeats in every period as a sawtooth, which
    no scatter between periods shows; it is removed as well. Exact for a polynomial of third degree, or of one less than there are
    periods.

    Parameters
    ----------
    signals : (R, T, n) array
        Of R records, each a whole number of periods in steady state.
    period : int

    Returns
    -------
    (R, T, n) array, (R, n) array
        The signals, and the range of the drift that was removed; 0 where none stood out of the noise.
    """
    records, samples, count = signals.shape
    degree = min(_DEGREE, samples // period - 1)
    powers = legendre.legvander(np.linspace(-1, 1, samples), degree)[:, 1:]
    size = np.zeros((records, count))
    if degree < 1:
        return signals, size
    basis, mix = np.linalg.qr(_between(powers[None], period)[0])
    left = _between(signals, period)
    found = basis.T @ left  # (R, degree, n)
    spare = samples - samples // (samples // period) - degree
    noise = (np.sum(left**2, axis=1) - np.sum(found**2, axis=1)) / max(spare, 1)
    rounding = (64 * np.finfo(float).eps * np.abs(signals).max(axis=1)) ** 2
    there = found**2 > _SIGNIFICANT**2 * np.maximum(noise, rounding)[:, None]
    # All powers up to the highest that stands out.
    kept = np.where(np.cumsum(there[:, ::-1], axis=1)[:, ::-1] > 0, found, 0.0)
    drift = powers @ np.linalg.solve(mix, kept)
    drift -= drift.mean(axis=1, keepdims=True)
    return signals - drift, np.ptp(drift, axis=1)


def _between(signals: np.ndarray, period: int) -> Real:
    """(R, T, n) less the mean over the periods."""
    cut = signals.reshape(len(signals), -1, period, signals.shape[2])
    return (cut - cut.mean(axis=1, keepdims=True)).reshape(signals.shape)
