"""Tones: hum, its harmonics, and whatever stands out of its neighbours in frequency."""

from __future__ import annotations

import functools
import math

import numpy as np

from robustid.core import Complex, Real
from robustid.data import Fault, FaultKind

_FALSE_ALARM = 1e-4  # in one signal
_AROUND = 40  # lines on either side that a line is held against
_LOBE = 2  # lines on either side that the window spreads a tone over
_SIDES = range(3, 7)  # lines beside it, where a resonance would still be large
_NARROW = 1 / 20  # of the power of a line, at most, in those
_UNCERTAIN = 1.5  # of a median over so many lines
_MOST = 8
_SEVERAL = 8  # times as many lines: then their medians are taken one by one
_PARTS, _ALIKE = 6, 0.7  # of a record, and how much of their power adds up
_LIGHTEST, _SURELY = 5e-4, 3.0  # damping ratio of a mode, at least; standard deviations
_VARIES = 0.5  # of the logarithm of an amplitude: mains do, a little
_FEWEST = 64  # lines
_CONTRAST = 100.0  # power of an excited line in that of its neighbours
_DRIVEN = 1e-3  # of the largest line of an input
_SMALLEST = 1e-3  # amplitude in the rms of the output


def tones_beside(w: Real, u: Real) -> list[tuple[float, float, float]]:
    """Tones in innovations or residuals w (T,): (cycles a sample, amplitude in w, power in that of the neighbours).

    Hann's window; the power of a line is exponential about that of its neighbours. A tone goes on as it began, which a mode that
    noise moves doesn't. Where an input (T, nu) has a narrow line of its own, nothing is said.
    """
    power = _power(w)
    if power.size < _FEWEST:
        return []
    limit = _UNCERTAIN * math.log(power.size / _FALSE_ALARM)
    ratio = _contrast(power, limit)
    found: list[tuple[float, float, float]] = []

    @functools.cache
    def drives() -> list[Real]:
        return [_power(one) for one in u.T if np.ptp(one) > 0]

    for k in np.argsort(-ratio)[: 8 * _MOST]:
        if ratio[k] < limit or len(found) == _MOST:
            break
        if any(abs(k - hz * w.size) <= 2 * _LOBE + 2 for hz, _, _ in found) or not _LOBE < k < power.size - _LOBE - 1:
            continue
        sides = [k + sign * j for j in _SIDES for sign in (-1, 1) if 0 <= k + sign * j < power.size]
        if np.mean(power[sides]) > max(_NARROW * power[k], 0):
            continue
        hz = _refined(w, int(k))
        if any(_narrow(drive, int(k)) for drive in drives()) or not _goes_on(w, hz):
            continue
        if any(_follows(power, drive, int(k), limit) for drive in drives()):
            continue
        off = hz * w.size - k
        lobe = np.sinc(off) / (1 - off**2)  # of the window, between the lines
        found.append((hz, 2 * math.sqrt(power[k]) / float(lobe), float(ratio[k])))
    return found


def _power(signal: Real) -> Real:
    """Power of the lines (T/2 + 1,) under Hann's window: the squared half amplitude of a tone on a line."""
    window = np.hanning(signal.size + 1)[:-1]
    return np.abs(np.fft.rfft((signal - signal.mean()) * window) / window.sum()) ** 2


def _contrast(power: Real, limit: float) -> Real:
    """Power of every line in the mean power of the lines around it, by their median; 0 where it is surely below a limit.

    Two thirds of the lines around one are whole blocks: its own, and one beside it. At least 14 of their 54 lines are at most the
    median of all 81, so 7 of one of them.
    """
    window, third = 2 * _AROUND + 1, (2 * _AROUND + 1) // 3
    count, likely = power.size // third, np.ones(power.size, dtype=bool)
    if count > 4:
        least = (_AROUND + 1 - third + 1) // 2
        low = np.partition(power[: count * third].reshape(count, third), least - 1, axis=1)[:, least - 1]
        low = np.minimum(np.minimum(low[:-2], low[2:]), low[1:-1])[1:-1]
        likely[2 * third : (count - 2) * third] = power[2 * third : (count - 2) * third] * math.log(
            2
        ) >= limit * np.repeat(low, third)
    places = np.flatnonzero(likely)
    if places.size * _SEVERAL > power.size:
        from scipy.ndimage import median_filter

        level: Real = np.asarray(median_filter(power, window, mode="reflect"), dtype=float)[places]
    else:
        around = np.pad(power, _AROUND, mode="symmetric")[places[:, None] + np.arange(window)]
        level = np.median(around, axis=1)
    found = np.zeros(power.size)
    found[places] = power[places] / np.maximum(level / math.log(2), np.finfo(float).tiny)
    return found


def _follows(power: Real, drive: Real, k: int, limit: float) -> bool:
    """Return whether a line is no more than others beside it, each in that of the input: what a model of the input leaves."""
    from scipy.ndimage import maximum_filter

    near = slice(max(k - _AROUND, 0), k + _AROUND + 1)
    given: Real = maximum_filter(drive[max(k - _AROUND - _LOBE, 0) : k + _AROUND + _LOBE + 1], 2 * _LOBE + 1)
    given = given[near.start - max(k - _AROUND - _LOBE, 0) :][: power[near].size]
    own = given[k - near.start]
    driven = given > _DRIVEN * given.max()
    if own <= _DRIVEN * given.max() or driven.sum() < _LOBE:
        return False
    return bool(power[k] / own < limit / math.log(2) * np.median(power[near][driven] / given[driven]))


def _narrow(drive: Real, k: int) -> bool:
    """Return whether an input has a line there that stands out of its neighbours."""
    near = drive[max(k - _LOBE, 0) : k + _LOBE + 1].max()
    around = np.concatenate(
        [drive[max(k - _AROUND, 0) : max(k - 2 * _LOBE, 0)], drive[k + 2 * _LOBE + 1 : k + _AROUND]]
    )
    return bool(near > _CONTRAST * np.median(around) and near > _DRIVEN**2 * drive.max())


def _goes_on(w: Real, cycles: float) -> bool:
    """Return whether the amplitudes at a frequency in parts of a signal are alike, in size and phase."""
    parts = _in_parts(w, cycles)
    turns = np.exp(-2j * np.pi * np.outer(np.linspace(-1, 1, 41) / (2 * _PARTS), np.arange(_PARTS)))
    together = np.abs(turns @ parts).max() ** 2  # the frequency is known to part of a line
    return bool(together > _ALIKE * _PARTS * np.sum(np.abs(parts) ** 2))


def _in_parts(w: Real, cycles: float) -> Complex:
    """Amplitudes at a frequency in parts of a signal, (_PARTS,), under Hann's window."""
    length = w.size // _PARTS
    window = np.hanning(length + 1)[:-1]
    wave = np.exp(-2j * np.pi * cycles * np.arange(_PARTS * length)).reshape(_PARTS, length)
    cut = (w[: _PARTS * length] - w.mean()).reshape(_PARTS, length)
    return np.asarray(np.sum(cut * wave * window, axis=1) / window.sum(), dtype=complex)


def keeps_on(w: Real, cycles: float) -> bool:
    """Return whether an oscillation in what the input does not explain lasts longer than any mode that rings.

    By the largest damping that the logarithms of its amplitudes in parts of the signal leave, of a straight line through them.
    A mode that was moved before the record rings on for as long as its damping lets it.
    """
    size = np.maximum(np.abs(_in_parts(w, cycles)), np.finfo(float).tiny)
    # Of the noise: what is as far off as the window of a part reaches.
    beside = [np.abs(_in_parts(w, cycles + sign * k * _PARTS / w.size)) for k in (3, 4, 5) for sign in (-1, 1)]
    noise = float(np.median(np.array(beside))) / math.sqrt(2 * math.log(2))  # of one of two components
    place, uncertain = (np.arange(_PARTS) - (_PARTS - 1) / 2) / _PARTS, noise / float(size.mean())
    spread, logs = float(place @ place), np.log(size)
    slope = float(place @ logs) / spread
    bent = float(np.abs(logs - logs.mean() - slope * place).max())
    if bent > max(_VARIES, _SURELY * noise / float(size.min())):
        return False  # moved again within the record
    return abs(slope) + _SURELY * uncertain / math.sqrt(spread) < 2 * math.pi * cycles * w.size * _LIGHTEST


def _refined(w: Real, k: int) -> float:
    """Frequency in cycles a sample, between the lines: of Hann's window, by the larger neighbour."""
    spectrum = np.sqrt(_power(w)[k - 1 : k + 2])
    side = 1 if spectrum[2] >= spectrum[0] else -1
    ratio = spectrum[1 + side] / max(spectrum[1], np.finfo(float).tiny)
    return (k + side * (2 * ratio - 1) / (1 + ratio)) / w.size


def amplitudes(y: Real, cycles: list[float], period: int) -> Real:
    """Amplitudes of tones in a signal less its mean over the periods, by least squares of such sines."""
    angle = 2 * np.pi * np.arange(y.size)[:, None] * np.array(cycles)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    cut = waves.reshape(-1, period, waves.shape[1])
    left = (cut - cut.mean(axis=0)).reshape(waves.shape)
    found: Real = np.asarray(np.linalg.lstsq(left, y, rcond=1e-6)[0], dtype=float)
    return np.hypot(found[: len(cycles)], found[len(cycles) :])


def without_tones(y: Real, cycles: list[float]) -> Real:
    """Signal (T,) less its least-squares sines of so many cycles a sample."""
    if not cycles:
        return y
    angle = 2 * np.pi * np.arange(y.size)[:, None] * np.array(cycles)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    return y - waves @ np.linalg.lstsq(waves, y, rcond=None)[0]


def tone_fault(hz: list[float], amplitude: float, rms: float, where: str, how: str, remedy: str) -> Fault | None:
    """Finding of tones, the largest first; None below a thousandth of the rms of the output."""
    if amplitude < _SMALLEST * rms:
        return None
    listed = ", ".join(f"{one:.5g}" for one in sorted(hz[:_MOST]))
    words = (
        f"{where} holds {'a tone' if len(hz) == 1 else 'tones'} at {listed} Hz that the input doesn't make, of up to"
        f" {100 * amplitude / rms:.2g} % of its rms, {how}; {remedy}"
    )
    return Fault(FaultKind.TONE, words, where=where, size=amplitude / rms)
