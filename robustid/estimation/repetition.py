"""Period of an excitation that nobody states."""

from __future__ import annotations

import numpy as np

from robustid.core import Real
from robustid.data import TimeRecord
from robustid.estimation.lost_samples import correlated
from robustid.estimation.stretch import LONG, liveliest

_REPEATS, _DIFFERS = 0.15, 0.5  # share of a signal's power by which periods may differ; by which something else does
_SHORTEST = 8  # samples of a period that is looked for
_DIPS, _ALIKE = 3, 0.1  # places that are looked at; part of what the earlier ones differ by
_SAME_LAG = 0.5  # samples by which the periods of an early and of a late part may differ
_PATTERN = LONG // 8  # samples that are looked for in all of a very long record
_SILENT = 0.05  # of the largest value: what is beside a blow
_UNEQUAL, _STILL = 0.02, 0.3  # part that blows differ by, at least; part of that which the silence differs by, at most
_TRIED = 16  # lags at which they come again, and multiples of one


def apart(signal: Real, lag: int) -> float:
    """Share of the power of a signal (T, n) by which it differs from itself `lag` samples later; 1 where unrelated."""
    early, late = signal[:-lag], signal[lag:]
    return float(np.sum((early - late) ** 2) / max(np.sum(early**2) + np.sum(late**2), np.finfo(float).tiny))


def found_period(record: TimeRecord) -> int | None:
    """Shortest period in samples with which the excitation, reference or input, repeats; None where it doesn't.

    The shortest lag, at most half the record, at which it differs from itself by at most 15 % of its power, after it has differed
    by half of it; none of blows that are unequal. Of a very long record that of a stretch, or the lag at which a pattern comes
    again, if all of it repeats so.
    """
    signal = record.u if record.reference is None else record.reference
    signal = signal - signal.mean(axis=0)
    if len(signal) <= LONG:
        lag = _shortest(signal)
        return None if lag is None or unequal_blows(signal, lag) else lag
    place = liveliest(signal)
    lag = _shortest(signal[place] - signal[place].mean(axis=0))
    # A few cycles may repeat between two samples, and some of them together nearly at one.
    several = [] if lag is None else [lag, *(_closest(signal, place.start, k * lag, k) for k in range(2, _DIPS + 1))]
    if found := next((one for one in several if _throughout(signal, one)), None):
        return found
    return next((one for one in _of_pattern(signal) if _throughout(signal, one)), None)


def _shortest(signal: Real) -> int | None:
    """Shortest period of a signal (T, n) of mean 0."""
    samples = len(signal)
    if samples < 2 * _SHORTEST or not np.any(signal):
        return None
    spectrum = np.fft.rfft(signal, 2 * samples, axis=0)
    alike = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[: samples // 2 + 1]
    power = np.concatenate([[0.0], np.cumsum(np.sum(signal**2, axis=1))])
    lags = np.arange(alike.size)
    both = power[samples - lags] + power[-1] - power[lags]
    apart = 1 - 2 * alike / np.where(both > 0, both, 1)
    different = np.flatnonzero(apart > _DIFFERS)
    if different.size == 0:
        return None
    repeats = np.flatnonzero((apart <= _REPEATS) & (lags >= max(_SHORTEST, different[0])))
    if repeats.size == 0:
        return None
    # The best lag of the first dip; or of the next two, where lines on every second or third bin repeat between two samples.
    limit = np.inf
    for _ in range(_DIPS):
        first = int(repeats[0])
        dip = first + int(np.argmax(np.concatenate([apart[first:] > _DIFFERS, [True]])))
        best = first + int(np.argmin(apart[first : max(dip, first + 1)]))
        # Of noise in a narrow band only the first cycles are alike, and the later ones less than the first.
        if apart[best] < limit and not np.any(apart[best::best] > _DIFFERS):
            return None if _sweeps(signal, best) else best
        limit = min(limit, _ALIKE * float(apart[best]))
        repeats = repeats[repeats > max(dip, first)]
        if repeats.size == 0:
            break
    return None


def _throughout(signal: Real, lag: int) -> bool:
    """Return whether all of a very long signal repeats after a lag, and not only a part of it, or a few cycles."""
    most = len(signal) // 2 // lag
    later = np.unique(np.linspace(1, most, min(most, 4)).astype(int))[1:] * lag
    if apart(signal, lag) > _REPEATS or any(apart(signal, int(one)) > _DIFFERS for one in later):
        return False
    return not _sweeps(signal, lag)


def _of_pattern(signal: Real) -> list[int]:
    """Lags, beyond half a stretch, at which a pattern of the first half of a very long signal comes again, the shortest first."""
    half = len(signal) // 2
    power = np.concatenate([[0.0], np.cumsum(np.sum(signal**2, axis=1))])
    size = power[_PATTERN:] - power[:-_PATTERN]
    start = int(np.argmax(size[: half - _PATTERN]))
    pattern, most = signal[start : start + _PATTERN], half - LONG // 2 + 1
    blocks = -(-most // _PATTERN)
    later = np.zeros(((blocks + 1) * _PATTERN, signal.shape[1]))
    given = signal[start + LONG // 2 :][: len(later)]
    later[: len(given)] = given
    product = np.zeros((blocks, _PATTERN))
    for one, own in zip(later.T, pattern.T, strict=True):
        sought = np.fft.rfft(own, 2 * _PATTERN).conj()
        for k in range(blocks):  # every block, with the one after it
            spectrum = np.fft.rfft(one[k * _PATTERN : (k + 2) * _PATTERN]) * sought
            product[k] += np.fft.irfft(spectrum)[:_PATTERN]
    both = size[start] + size[start + LONG // 2 :][:most]
    differs = 1 - 2 * product.ravel()[: both.size] / np.where(both > 0, both, 1)
    lags = np.flatnonzero(differs <= _REPEATS)
    dips = np.split(lags, np.flatnonzero(np.diff(lags) > 1) + 1) if lags.size else []
    places = sorted((int(dip[np.argmin(differs[dip])]) for dip in dips), key=lambda at: float(differs[at]))[:_TRIED]
    return [_closest(signal, start, at + LONG // 2, _PATTERN // 4) for at in sorted(places)]


def _closest(signal: Real, start: int, lag: int, reach: int) -> int:
    """Lag near another at which a stretch of a very long signal differs least: a pattern of a few steps tells it roughly."""
    low, high = lag - reach, min(lag + reach, len(signal) // 2)
    count = min(LONG, len(signal) - high)
    return low + int(
        np.argmin(_differences(signal, min(start, len(signal) - high - count), count, low, high - low + 1))
    )


def unequal_blows(signal: Real, lag: int) -> bool:
    """Return whether a signal is silent for most of a period and differs between periods where it isn't: no noise of a sensor."""
    cut = signal[: len(signal) // lag * lag].reshape(-1, lag, signal.shape[1])
    cut = cut - np.median(cut, axis=(0, 1))
    usual = np.abs(cut).max(axis=(0, 2))
    silent = usual <= _SILENT * usual.max()
    if 2 * silent.sum() <= lag or silent.all():
        return False
    spread: Real = np.asarray(cut.var(axis=0), dtype=float)
    beside, of_blows, struck = (
        float(spread[silent].mean()),
        float(spread[~silent].mean()),
        float(np.mean(cut[:, ~silent] ** 2)),
    )
    return of_blows > _UNEQUAL**2 * struck and beside < _STILL**2 * of_blows


def _sweeps(signal: Real, lag: int) -> bool:
    """Return whether early samples come again after another lag than late ones: cycles of a sweep become shorter, or longer."""
    reach = max(lag // 8, 2)
    pairs = len(signal) - lag - reach
    half = min(pairs // 2, max(LONG, lag))
    if half < _SHORTEST:
        return False
    first, last = (_differences(signal, k, half, lag - reach, 2 * reach + 1) for k in (0, pairs - half))
    return abs(_lowest(first) - _lowest(last)) > _SAME_LAG


def _differences(signal: Real, start: int, count: int, lag: int, lags: int) -> Real:
    """Squares of so many samples of a signal (T, n) less those after a lag, and after every one of the next lags."""
    own, later = signal[start : start + count], signal[start + lag : start + lag + lags - 1 + count]
    power = np.concatenate([[0.0], np.cumsum(np.sum(later**2, axis=1))])
    product = sum(correlated(b, a) for a, b in zip(own.T, later.T, strict=True))
    return float(np.sum(own**2)) + power[count:] - power[:-count] - 2 * product


def _lowest(values: Real) -> float:
    """Place of the smallest value, between the numbers by a parabola."""
    k = int(np.argmin(values))
    if k in (0, len(values) - 1):
        return float(k)
    before, at, after = values[k - 1 : k + 2]
    return k + 0.5 * float(before - after) / max(float(before - 2 * at + after), np.finfo(float).tiny)
