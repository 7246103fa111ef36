"""How many periods at the start of a record still hold a transient."""

from __future__ import annotations

import numpy as np

_SIGNIFICANT = 5.0  # standard deviations
_BAND = 8  # lines over which a transient is looked for: that of a lightly damped mode fills a few only


def transient_periods(spectra: np.ndarray, index: np.ndarray) -> tuple[int, bool]:
    """Number of periods at the start that differ from the later ones more than these among themselves.

    ``x_k = |Y_p(k) - mean|^2/(s^2 (1 + 1/m))``, mean and variance s^2 over the m periods after p, is F(2, 2(m-1)) distributed in
    steady state; the mean of log x over all lines and over every few of them is compared with what it would be.

    Parameters
    ----------
    spectra : (R, P, K, n) array
        Of every record and period.
    index : (F,) array
        Lines that are used: the lines in between count too.

    Returns
    -------
    int, bool
        Periods, at most half of them, and whether the rest is steady.
    """
    from scipy.special import polygamma, psi

    periods = spectra.shape[1]
    if periods < 4:
        return 0, True
    band = spectra[:, :, index.min() : index.max() + 1]
    channels = band.shape[0] * band.shape[3]
    # Well above rounding: periods that are the same up to it are steady.
    floor = (64 * np.finfo(float).eps * np.abs(spectra).max(axis=(1, 2), keepdims=True)) ** 2
    last = periods // 2
    for p in range(last + 1):
        later = band[:, p + 1 :]
        m = later.shape[1]
        if m < 2:
            return p, True
        scatter = later.var(axis=1, ddof=1) * (1 + 1 / m)
        away = np.abs(band[:, p] - later.mean(axis=1)) ** 2
        # Signals that repeat up to rounding, as an ideal input does, say nothing either way.
        alive = np.maximum(scatter, away) > floor[:, 0]
        ratio = np.where(alive, away, 1) / np.where(alive, scatter + floor[:, 0], 1)
        mean, variance = psi(1) - psi(m - 1) + np.log(m - 1), polygamma(1, 1) + polygamma(1, m - 1)
        log = np.log(np.maximum(ratio, np.finfo(float).tiny)) - mean
        each = np.where(alive, log, 0).sum(axis=(0, 2))  # (K,): all records and channels
        width = min(_BAND, each.size)
        local = np.convolve(each, np.ones(width), mode="valid").max() / np.sqrt(variance * channels * width)
        whole = each.sum() / np.sqrt(variance * channels * each.size)
        if max(local, whole) <= _SIGNIFICANT:
            return p, True
    return last, False
