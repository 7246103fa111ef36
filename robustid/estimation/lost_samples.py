"""Samples that are missing in the middle of a record: from there on, an output comes early."""

from __future__ import annotations

import math

import numpy as np

from robustid.core import Real, counted
from robustid.data import Fault, FaultKind
from robustid.estimation.innovations import Predictors, filtered
from robustid.estimation.stretch import LONG

_FEWEST = 300  # samples of a part that is compared
_LAGS = 500  # samples that may be missing, at most
_LEAST = 2  # one sample may be the drift of a clock
_CERTAIN = 8.0  # standard deviations by which another shift fits better
_MOVED, _SAME, _WIDE = 0.01, 0.5, 9  # of the power at a line, and of all lines; lines that are taken together
_END = LONG // 4  # samples at the end of a very long record
_BESIDE = 0.12  # of the record, on either side of the place, where the shift has to be what it says


def lost_samples(y: Real, u: Real, where: str) -> Fault | None:
    """Samples that are missing, by the shift between input and output that fits the last third of a record."""
    third = y.size // 3
    if third < _FEWEST or np.ptp(y) == 0 or not _moves_as_before(u[:third][:LONG], u[-third:][-LONG:]):
        return None
    first = min(third, LONG)
    predictors = Predictors(u[:first])
    if predictors.order < 2:
        return None
    found = predictors.of(y[:first])
    if y.size > 3 * LONG:  # the end tells whether any are missing
        last = slice(y.size - _END - 3 * _LAGS, y.size)
        (w, v), (w0, v0) = (_sides(found.a, found.b, y[part], u[part]) for part in (last, slice(0, _END)))
        shift, sure = _best_shift(w - w0.mean(), v - v0.mean(), slice(2 * _LAGS, w.size - _LAGS), _LAGS)
        if not _shifted(shift, sure):
            return None
    w, v = _sides(found.a, found.b, y, u)
    return _found(w - w[:third].mean(), v - v[:third].mean(), where, _LAGS)


def lost_in_periods(y: Real, period: int, where: str) -> Fault | None:
    """Samples that are missing, by the first period where the others follow it, shifted."""
    if y.size < 2 * period or period < _LEAST * 8 or np.ptp(y) == 0:
        return None
    first, lags = y[:period] - y[:period].mean(), min(_LAGS, period // 2 - 1)
    if y.size > 3 * LONG:
        n = np.arange(y.size - _END - 2 * lags, y.size)
        w, v = y[n[0] :] - y[n[0] :].mean(), first[n % period]
        if not _shifted(*_best_shift(w, v, slice(lags, w.size - lags), lags)):
            return None
    pattern = np.tile(first, y.size // period + 1)[: y.size]
    return _found(y - y.mean(), pattern, where, lags)


def _moves_as_before(first: Real, last: Real) -> bool:
    """Tell whether the inputs (T, nu) have most of their power at lines that moved the first part too.

    Of others its model says nothing: in a sweep what it foretells of later frequencies follows nothing, and some shift is the best.
    """
    taper, wide = np.hanning(len(first))[:, None], np.ones(_WIDE) / _WIDE
    powers = (
        np.sum(np.abs(np.fft.rfft(taper * (part - part.mean(axis=0)), axis=0)) ** 2, axis=1) for part in (first, last)
    )
    before, now = (np.convolve(power, wide, mode="same") for power in powers)
    return bool(np.sum(now[before >= _MOVED * now]) >= _SAME * np.sum(now))


def _sides(a: Real, b: Real, y: Real, u: Real) -> tuple[Real, Real]:
    v = np.zeros(y.size)
    for taps, one in zip(b, u.T, strict=True):
        v += filtered(taps, one)
    return filtered(a, y), v


def _shifted(shift: int, sure: float) -> bool:
    return abs(shift) >= _LEAST and sure >= _CERTAIN


def _found(w: Real, v: Real, where: str, lags: int) -> Fault | None:
    """Fault where `w` follows `v` at first, and `v` that comes so many samples later at last."""
    samples = w.size
    lags = min(lags, samples // 4)
    last = slice(samples - min(samples // 3, LONG), samples)
    shift, sure = _best_shift(w, v, last, lags)
    if not _shifted(shift, sure):
        return None
    before = (w - v) ** 2
    after = (w - np.roll(v, -shift)) ** 2
    usable = slice(lags, samples - lags)
    # Left of the place the first fits, right of it the other.
    gain = np.cumsum((before - after)[usable])
    at = int(np.argmin(gain)) + usable.start + 1
    beside = min(max(round(_BESIDE * samples), _FEWEST // 2), LONG)
    if at - beside < 0 or at + beside > samples:
        return None
    if _best_shift(w, v, slice(at - beside, at), lags)[0] != 0:
        return None
    if _best_shift(w, v, slice(at, at + beside), lags)[0] != shift:
        return None
    many, one = counted(abs(shift), "sample"), abs(shift) == 1
    what = f"{many} {'is' if one else 'are'} missing" if shift > 0 else f"{many} {'was' if one else 'were'} put in"
    words = (
        f"{where}: {what} at about sample {at}: from there on it comes {many} too"
        f" {'early' if shift > 0 else 'late'}; use the part before it or after it as a record of its own, or measure again"
    )
    return Fault(FaultKind.LOST, words, where=where, size=float(shift))


def _best_shift(w: Real, v: Real, part: slice, lags: int) -> tuple[int, float]:
    """Shift of v that fits w best in a part, and by how many standard deviations it fits better than none."""
    reach = min(lags, (part.stop - part.start) // 2)
    own = w[part]
    start, stop = part.start - reach, part.stop + reach
    padded = np.concatenate([np.zeros(max(-start, 0)), v[max(start, 0) : stop], np.zeros(max(stop - v.size, 0))])
    products = np.correlate(padded, own, mode="valid") if own.size < 64 else correlated(padded, own)
    squares = np.concatenate([[0.0], np.cumsum(padded**2)])
    power = squares[own.size :] - squares[: -own.size]
    errors = np.maximum(float(own @ own) + power - 2 * products, 0.0)
    errors += 1e-12 * float(own @ own)
    best = int(np.argmin(errors))
    if errors[best] <= 0:
        return 0, 0.0
    better = math.log(float(errors[reach]) / float(errors[best]))
    return best - reach, better / math.sqrt(2 / own.size) / 2


def correlated(long: Real, short: Real) -> Real:
    """Sums of a short signal times a long one, at every place where it lies in it."""
    import scipy.fft

    size = scipy.fft.next_fast_len(long.size + short.size - 1, True)
    product = scipy.fft.rfft(long, size) * scipy.fft.rfft(short[::-1], size)
    return np.asarray(scipy.fft.irfft(product, size), dtype=float)[short.size - 1 : long.size]
