"""Faults of single samples that their values show: saturated, stuck, lost, held, wrapped around, in coarse steps."""

from __future__ import annotations

import math

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind

# A clipped signal has many samples at its extreme value and few beside it; the crest of a sine in a coarse quantiser
# has 2.4 times as many in its top step as in the next.
_CLIPPED_RATIO, _CLIPPED_PART, _CLIPPED_LEAST = 5, 1e-3, 10
_ALIKE = 1e-3  # part of the other samples that may be as the one before
_STUCK_LEAST, _STUCK_RATIO = 20, 10  # samples in a row that are the same, and how many times as many as elsewhere
_FALSE_ALARM = 1e-4  # in one signal
_RUN = 4  # samples in a row that are the same, at least
_AROUND = 1000  # samples on either side of them
_STILL = 0.1  # part of the samples in which the input may keep its value
_LEAVES = 3  # steps of the resolution by which a signal goes on after it was held
_ENTERED = 2  # times the usual step, into and out of samples that were filled
_FAR = 0.5  # of the range of all others
_SLOWER = 20  # changes at whole multiples of the samples, different values, and changes of the input between
_COARSE = 0.02  # of the rms: error of a quantiser
_STEPS_LEAST = 10  # samples a step of a quantiser
_ON_GRID = 1e-3  # of a step
_ORDER = 6  # of the predictor that undoes wrapping
_OFF = 0.15  # of the range: prediction of a sample that wrapped
_MISSED = 10  # samples that turning back explains, for one that it doesn't
_POPULATED = 0.8  # of the range, by samples that did not wrap


def at_ends(signal: Real, where: str) -> list[Fault]:
    """Saturation: many samples exactly at the largest or smallest value."""
    return [
        Fault(
            FaultKind.SATURATED,
            f"{where} is at its {word} value, {extreme:.6g}, in {count} of {signal.size} samples: it looks saturated, and no"
            " linear model gives such samples",
            where=where,
            size=count,
        )
        for word, extreme in (("largest", signal.max()), ("smallest", signal.min()))
        if (count := _clipped(signal, extreme)) > 0
    ]


def _clipped(signal: Real, extreme: float) -> int:
    """Number of samples exactly at the extreme value; 0 unless many of them come in runs, and few are beside it.

    Where no other samples are as those before them, three in a row are enough.
    """
    at = np.concatenate([[False], signal == extreme, [False]])
    count, in_runs = int(at.sum()), int(np.sum(at[1:-1] & (at[:-2] | at[2:])))
    alike = np.sum((signal[1:] == signal[:-1]) & ~at[2:-1])
    if alike <= _ALIKE * signal.size and np.any(at[1:-1] & at[:-2] & at[2:]):
        return count
    if in_runs < max(_CLIPPED_LEAST, _CLIPPED_PART * signal.size) or count == signal.size:
        return 0
    others = signal[signal != extreme]
    next_to = others[np.argmin(np.abs(others - extreme))]
    return count if count > _CLIPPED_RATIO * np.sum(signal == next_to) else 0


def cut_off(signal: Real, played: Real, where: str) -> list[Fault]:
    """Saturation of a measured input: different values that were played beyond an end came out as one."""
    if np.sum(signal[1:] == signal[:-1]) > _ALIKE * signal.size:
        return []
    at = {word: signal == extreme for word, extreme in (("largest", signal.max()), ("smallest", signal.min()))}
    beyond = {word: np.unique(played[one & (np.abs(played) > np.abs(signal))]).size for word, one in at.items()}
    return [
        Fault(
            FaultKind.SATURATED,
            f"{where} is at its {word} value, {signal[at[word]][0]:.6g}, in {at[word].sum()} of {signal.size} samples where"
            f" {count} different values beyond it were played: it is saturated, and no linear model gives such samples",
            where=where,
            size=int(at[word].sum()),
        )
        for word, count in beyond.items()
        if count > 1
    ]


def runs(signal: Real, u: Real, where: str) -> list[Fault]:
    """Stretches in which a signal keeps one value while the input moves: a sensor that was stuck, samples that were lost."""
    starts = np.flatnonzero(np.concatenate([[True], signal[1:] != signal[:-1]]))
    counts = np.diff(np.concatenate([starts, [signal.size]]))
    return _held(signal, u, where, starts, counts) or _stuck(signal, u, where, starts, counts)


def _stuck(signal: Real, u: Real, where: str, starts: np.ndarray, counts: np.ndarray) -> list[Fault]:
    """One long stretch, between the ends of the signal."""
    longest = int(np.argmax(counts))
    start, count = int(starts[longest]), int(counts[longest])
    usual = np.partition(counts, -2)[-2] if counts.size > 1 else count
    if count < max(_STUCK_LEAST, _STUCK_RATIO * usual) or signal[start] in (signal.min(), signal.max()):
        return []
    return [] if np.all(u[start : start + count] == u[start]) else [_stuck_at(signal, where, start, count)]


def _stuck_at(signal: Real, where: str, start: int, count: int) -> Fault:
    kept = f"{where} keeps the value {signal[start]:.6g} for {count} samples from sample {start} on"
    words = f"{kept}: it was stuck, the sensor or the machine"
    return Fault(FaultKind.STUCK, words, where=where, size=count)


def _held(signal: Real, u: Real, where: str, starts: np.ndarray, counts: np.ndarray) -> list[Fault]:
    """Stretches that are longer than chance makes any, in a record the input of which moves all the time."""
    samples = signal.size
    if counts.size < 3 or counts.max() < _RUN or np.mean(np.all(u[1:] == u[:-1], axis=1)) > _STILL:
        return []
    least = _longest_by_chance(starts, counts, samples)
    steps = np.abs(np.diff(signal))
    moving = steps[steps > 0]
    resolution, usual = float(moving.min()), float(np.median(moving))
    into = np.concatenate([[0.0], steps])[starts]
    out_of = np.concatenate([steps, [0.0]])[starts + counts - 1]
    inside = (starts > 0) & (starts + counts < samples)
    held = inside & (counts >= least) & (out_of >= _LEAVES * resolution)
    # At an end of the range it is saturated, unless what fills the gaps is 0, or far from everything else.
    for end in (signal.max(), signal.min()):
        others = signal[signal != end]
        far = np.abs(others - end).min() > _FAR * np.ptp(others)
        held &= (signal[starts] != end) | far | ((end == 0) & (np.minimum(into, out_of) > _ENTERED * usual))
    for k in np.flatnonzero(held):
        held[k] = np.any(u[starts[k] : starts[k] + counts[k]] != u[starts[k]])
    total = int(counts[held].sum())
    if not np.any(held) or total > samples / 2:
        return []
    first, longest, values = int(starts[held][0]), int(counts[held].max()), signal[starts[held]]
    several = int(held.sum())
    if several == 1:
        return [] if counts[held][0] < _RUN else [_stuck_at(signal, where, first, longest)]
    filled = bool(np.all(values == values[0]))
    how = f"is exactly {values[0]:.6g}" if filled else "keeps its last value"
    why = "samples were lost and filled in"
    if not filled and np.median(out_of[held]) <= _ENTERED * usual:  # it goes on as it moves elsewhere
        why += ", or friction or backlash held it, which no linear model follows"
    words = (
        f"{where} {how} in {several} stretches of up to {longest} samples, {total} samples in all, the first from sample"
        f" {first} on: {why}; leave those stretches out, or measure again"
    )
    return [Fault(FaultKind.LOST, words, where=where, size=total)]


def slower(signal: Real, u: Real, where: str) -> list[Fault]:
    """Output that was taken at a lower rate than its input, and held between: all its changes are whole multiples of samples apart.

    It is no time-invariant answer to an input that changes between: half the time between the samples late at low frequencies,
    and at others mixed with what the input has there. Where all inputs are held as it is, it is one.
    """
    every = _grid(signal)
    if every < 2 or np.unique(signal).size < _SLOWER:
        return []
    at = np.flatnonzero(np.any(np.diff(u, axis=0) != 0, axis=1))
    if at.size == 0 or at.size - np.bincount(at % every).max() < _SLOWER:
        return []
    steps = np.diff(signal)
    size = float(np.sqrt(np.mean(steps[steps != 0] ** 2)) / signal.std())
    words = (
        f"{where} changes at one of {every} samples only, and its input between: it was taken at a lower rate and held, which makes"
        f" it {(every - 1) / 2:g} samples late on average; record both at one rate"
    )
    return [Fault(FaultKind.HELD, words, where=where, size=size)]


def _grid(signal: Real) -> int:
    """Samples of which all distances between changes of a signal are multiples; 1 where there are too few to say."""
    at = np.flatnonzero(np.diff(signal) != 0)
    return int(np.gcd.reduce(np.diff(at))) if at.size > _SLOWER else 1


def _longest_by_chance(starts: np.ndarray, counts: np.ndarray, samples: int) -> Real:
    """Samples in a row, from which on it is no chance that they are the same, for every stretch.

    The chance of a sample that is as the one before is that of all, or that around the stretch where it is larger: a sweep has
    quiet parts. It is told by the shortest stretches: the others may be the fault.
    """
    again = np.concatenate([[0], np.cumsum(np.repeat(np.where(counts < _RUN, (counts - 1) / counts, 0.0), counts))])
    low, high = np.maximum(starts - _AROUND, 0), np.minimum(starts + counts + _AROUND, samples)
    alike = np.maximum((again[high] - again[low]) / (high - low), max(again[-1], 1.0) / samples)
    by_chance = 1 + np.ceil(math.log(_FALSE_ALARM / samples) / np.log(np.minimum(alike, 1 - 1 / samples)))
    return np.maximum(by_chance, _RUN)


def in_steps(signal: Real, u: Real, where: str) -> list[Fault]:
    """Quantiser the steps of which are not small against the signal."""
    values = np.unique(signal)
    if values.size < 2 or _STEPS_LEAST * values.size > signal.size:
        return []
    if any(np.unique(one).size <= 2 * values.size for one in u.T if np.ptp(one) > 0):
        return []  # an input of a few levels has an answer of a few
    step = float(np.diff(values).min())
    whole: Real = (values - values[0]) / step
    if np.abs(whole - np.round(whole)).max() > max(_ON_GRID, 1e-12 * whole[-1]):
        return []
    deviation = float(signal.std())
    share = step / math.sqrt(12) / deviation if deviation else 0.0
    if share <= _COARSE:
        return []
    words = (
        f"{where} has only {values.size} different values, in steps of {step:.4g}: rounding to them makes an error of"
        f" {100 * share:.2g} % of its rms, which is no noise that means take away; measure again with a finer range"
    )
    return [Fault(FaultKind.QUANTISED, words, where=where, size=share)]


def unwrapped(signal: Real, u: Real) -> tuple[Real, int]:
    """Signal (T,) without jumps from one end of its range to the other, and the number of samples that were beyond the range."""
    width = float(np.ptp(signal))
    jumps = np.abs(np.diff(signal)) > width / 2
    if not np.any(jumps):
        return signal, 0
    predicted = _predictor(signal, u, jumps)
    if predicted is None:
        return signal, 0
    own, given = predicted
    windows = np.lib.stride_tricks.sliding_window_view(signal[:-1], _ORDER)
    if not np.any(np.round((given[_ORDER:] + windows @ own - signal[_ORDER:]) / width)):
        return signal, 0
    missed = 0
    found, turns = signal.copy(), np.zeros(signal.size)
    for t in range(_ORDER, signal.size):
        expected = given[t] + float(own @ found[t - _ORDER : t])
        turns[t] = round((expected - signal[t]) / width)
        if turns[t]:
            found[t] += turns[t] * width
            missed += abs(expected - found[t]) > _OFF * width
    wrapped = turns != 0
    count = int(wrapped.sum())
    if count <= _MISSED * missed or count > signal.size // 2 or np.ptp(signal[~wrapped]) < _POPULATED * width:
        return signal, 0
    return found, count


def _predictor(signal: Real, u: Real, jumps: np.ndarray) -> tuple[Real, Real] | None:
    """Weights of the last samples (n,), oldest first, and what the input and a constant add (T,); by rows without a jump."""
    samples = signal.size
    rows = np.arange(_ORDER, samples)
    counted = np.concatenate([[0], np.cumsum(jumps)])
    free = rows[counted[rows] == counted[rows - _ORDER]]
    lagged = [one[rows[:, None] - np.arange(_ORDER + 1)] for one in u.T]
    past = signal[rows[:, None] - np.arange(_ORDER, 0, -1)]
    whole = np.concatenate([past, *lagged, np.ones((rows.size, 1))], axis=1)
    if free.size < 4 * whole.shape[1]:
        return None
    size = np.maximum(np.abs(whole).max(axis=0), np.finfo(float).tiny)
    found: Real = (
        np.asarray(np.linalg.lstsq(whole[free - _ORDER] / size, signal[free], rcond=1e-9)[0], dtype=float) / size
    )
    given = np.concatenate([np.zeros(_ORDER), whole[:, _ORDER:] @ found[_ORDER:]])
    return found[:_ORDER], given


def wrapped_fault(signal: Real, count: int, where: str) -> Fault:
    """Finding of samples that wrapped around."""
    words = (
        f"{where} jumps from one end of its range to the other: {count} samples beyond {signal.min():.6g} to {signal.max():.6g}"
        f" came back about {np.ptp(signal):.4g} off, as integers that overflow do; measure again with a larger range"
    )
    return Fault(FaultKind.WRAPPED, words, where=where, size=count)
