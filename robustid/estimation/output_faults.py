"""Faults of the outputs of one record against its inputs: spikes, jumps, drifts, tones, points of operation, no response at all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.events import Event, Examined, examined, not_after_changes, not_repeated
from robustid.estimation.innovation_scatter import jitter_of_innovations
from robustid.estimation.innovations import (
    Predictor,
    Predictors,
    gain_of_inputs,
    order_for,
    own_continuation,
    trends,
    without_trend,
)
from robustid.estimation.long_outputs import OutputPieces
from robustid.estimation.stretch import LONG, liveliest, stretch_length
from robustid.estimation.tone_faults import keeps_on, tone_fault, tones_beside, without_tones

_CERTAIN = 8.0  # standard deviations of a trend
_DRIFTS = 0.05  # of the rms of the output
_SLOW = 20  # lines
_BESIDE = 30  # samples
_ON_CIRCLE = 4.0  # of a line: a mode that doesn't decay in the record, or a tone
_LISTED = 3
_PERIODS = 3  # at least, of those whose mean is taken out
_FEWEST = 400  # samples of a record whose output the input has to move
_ROUNDING = 1e-30  # part of a power
_CHANCE = 1e-3
_LINES = 8  # excited lines, at least
_SURE = 3.5  # standard deviations
_CORRELATED = 6.0  # standard deviations of a correlation, over all lags
_FROM_REST = 12.0  # standard deviations of the innovations of the first samples
_FIRST, _LEVEL = (
    3,
    0.1,
)  # samples at the beginning, and their least part of the mean, of a record about a point of operation
_CHANGES = 8  # of the inputs
_STANDS_OUT = 10.0  # mean, in the rms of the lowest lines
_LOWEST = 10  # lines
_BEFORE = 8.0  # standard deviations of an offset before the input acts
_STEADY = 0.01  # of the range of an output: an offset worth a word


class Outputs(NamedTuple):
    """Faults of the outputs of a record, and the record without what could be taken out."""

    faults: list[Fault]
    y: Real


def output_faults(record: TimeRecord, period: int | None, told: set[str]) -> Outputs:
    """Faults of every output that isn't `told` of; with `period`, those that its repetition shows are looked for elsewhere."""
    repeats = period if period is not None and len(record.u) >= _PERIODS * period else None
    # What drifts makes the mean over the periods jump where it begins anew: as a sawtooth does.
    u = record.u if repeats is None else (np.arange(len(record.u)) % repeats / repeats - 0.5)[:, None]
    length, cut = stretch_length(len(record.inputs), len(record.outputs)), None
    if len(u) > length:
        u = np.asfortranarray(u)  # signals are gone through one by one
        cut = OutputPieces(u, repeats, length)
    predictors = Predictors(u)
    found: list[Fault] = _before_input(record, told)
    clean = record.y
    for i, channel in enumerate(record.outputs):
        where = f"output {channel.name}"
        if where in told:
            continue
        y = record.y[:, i]
        if cut is not None:
            y = np.ascontiguousarray(y)
            seen, own = _seen_in_pieces(record, y, cut, period), predictors
            events = seen.events
        else:
            seen, own = _seen(y, u, predictors, repeats, period is not None)
            events = seen.events if period is not None else not_after_changes(seen.events, record.u, predictors.order)
        if period is not None and repeats is None:
            events = not_repeated(events, y, period)
        if seen.signal is not y:
            clean = clean.copy() if clean is record.y else clean
            clean[:, i] = seen.signal
        found += _events(seen._replace(events=events), where, period)
        if period is None:
            found += _aperiodic(record, seen, where, (predictors, own), cut)
    return Outputs(found, clean)


def _seen_in_pieces(record: TimeRecord, y: Real, cut: OutputPieces, period: int | None) -> Examined:
    """Events of a very long output: of its pieces, which are examined as records are."""

    def examine(part: slice) -> Examined:
        predictors = Predictors(cut.u[part])
        seen, _ = _seen(y[part], cut.u[part], predictors, cut.period, period is not None)
        if period is not None:
            return seen
        return seen._replace(events=not_after_changes(seen.events, record.u[part], predictors.order))

    return cut.examined(y, examine)


def _seen(y: Real, u: Real, predictors: Predictors, repeats: int | None, periodic: bool) -> tuple[Examined, Predictors]:
    """Events of an output, the output without them, and the predictors that found them: without tones, where nothing repeats."""
    seen, heard = examined(y, predictors, u, repeats), list[float]()
    if periodic or predictors.order == 0 or np.ptp(y) == 0:
        return seen, predictors
    for signal in (y, seen.signal) if seen.events else (y,):  # tones show better where no spikes are
        heard = _absorbed(signal, u, predictors)
        if heard:
            break
    if not heard:
        return seen, predictors
    quiet, given = without_tones(y, heard), np.stack([without_tones(one, heard) for one in u.T], axis=1)
    own = Predictors(given)
    seen = examined(quiet, own, given, None)
    # A tone that spikes hid is known better without them.
    again = _absorbed(y - (quiet - seen.signal), u, predictors) if seen.events else heard
    if again and again != heard:
        quiet, given = without_tones(y, again), np.stack([without_tones(one, again) for one in u.T], axis=1)
        own = Predictors(given)
        seen = examined(quiet, own, given, None)
    return seen._replace(signal=y - (quiet - seen.signal)), own


def _absorbed(y: Real, u: Real, predictors: Predictors) -> list[float]:
    """Tones that a predictor would take for modes, in cycles a sample: narrow lines of the output, and poles at the unit circle.

    They are taken out of input and output before the predictor is found: whatever they are, the rest says what the plant is.
    """
    poles = np.roots(predictors.of(y).a)
    poles = poles[(np.abs(np.abs(poles) - 1) < _ON_CIRCLE / y.size) & (poles.imag > 0)]
    lines = [cycles for cycles, _, _ in tones_beside(y, u)]
    own = [float(np.angle(pole)) / (2 * np.pi) for pole in poles]
    return lines + [one for one in own if all(abs(one - other) * y.size > 1 for other in lines)]


def _aperiodic(
    record: TimeRecord, seen: Examined, where: str, predictors: tuple[Predictors, Predictors], cut: OutputPieces | None
) -> list[Fault]:
    """Drift, point of operation and tones of a record that repeats nothing, by predictors from its inputs and without tones."""
    predictor, y, u = seen.predictor, seen.signal, record.u
    if predictor is None or not moves_on(u):
        return []
    short = len(y) < _FEWEST or any(event.jump for event in seen.events)
    short = short or all(
        own_continuation(one) for one in u.T if np.ptp(one) > 0
    )  # the answer to a slow sine looks like a drift
    found = [] if short else _drift(*predictors, y, where)
    if record.initial == "rest" and not any(fault.kind is FaultKind.OFFSET for fault in found):
        found += _operating_point(predictor, record, y, where)
    if cut is not None:  # what goes on is in the liveliest piece, too
        y, u = y[cut.lead], cut.u[cut.lead]
        seen, _ = _seen(y, u, cut.predictors, None, False)
        predictor, y = seen.predictor, seen.signal
        if predictor is None:
            return found
    w = predictor.innovations(y, u)
    tones = [one for one in tones_beside(w, u) if keeps_on(w, one[0])]
    if tones:
        frequencies = np.array([cycles for cycles, _, _ in tones])
        gain = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, np.arange(predictor.a.size))) @ predictor.a)
        amplitude = max(size / one for (_, size, _), one in zip(tones, gain, strict=True))
        contrast = max(ratio for _, _, ratio in tones)
        how = f"up to {10 * math.log10(contrast):.0f} dB above the noise beside"
        remedy = "leave these frequencies out, or find what makes them"
        fault = tone_fault(list(frequencies / record.dt), float(amplitude), float(y.std()), where, how, remedy)
        found += [] if fault is None else [fault]
    return found or jitter_of_innovations(predictor, w, y, u, record.dt, where)


def _events(seen: Examined, where: str, period: int | None) -> list[Fault]:
    """Sentences of spikes, and of jumps of the level."""
    found: list[Fault] = []
    for jump in (False, True):
        events = [event for event in seen.events if event.jump == jump]
        if not jump:  # a jump that takes some samples leaves spikes beside it
            jumps = [event.at for event in seen.events if event.jump]
            events = [event for event in events if all(abs(event.at - at) > _BESIDE for at in jumps)]
        if not events:
            continue
        largest, rms = events[0], max(float(seen.signal.std()), np.finfo(float).tiny)
        size = abs(largest.height) / rms
        places = _places([event.at for event in events], period)
        measure = f"the largest by {size:.3g} times its rms, {largest.deviations:.2g} standard deviations of the noise"
        if jump:
            words = f"{where} jumps to another level {places}, {measure}: use the parts between as records of their own"
            found.append(Fault(FaultKind.JUMP, words, where=where, size=size))
        else:
            words = f"{where} has {_counted(events)} off {places}, {measure}: leave that stretch out, or measure again"
            found.append(Fault(FaultKind.SPIKE, words, where=where, size=size))
    return sorted(found, key=lambda fault: -(fault.size or 0))


def _counted(events: list[Event]) -> str:
    return "a spike: one sample is" if len(events) == 1 else f"spikes: {len(events)} samples are"


def _places(at: list[int], period: int | None) -> str:
    """Samples, the largest first, and their periods."""
    listed = ", ".join(str(one) for one in at[:_LISTED]) + (", ..." if len(at) > _LISTED else "")
    in_period = "" if period is None else f" (period {', '.join(str(one // period + 1) for one in at[:_LISTED])})"
    return f"at sample{'s' if len(at) > 1 else ''} {listed}{in_period}"


def _drift(with_tones: Predictors, predictors: Predictors, y: Real, where: str) -> list[Fault]:
    """Trend in time that the inputs don't explain.

    The predictor is that of the output less its own trend: else it would take a strong drift for a pole at 1. A trend of an input
    whose slow answer the rest of the record does not tell explains that of the output.
    """
    predictor, shapes = predictors.of(without_trend(y)), trends(min(y.size, LONG))
    found, unsure, left = with_tones.trend_beside(y, predictor.a)
    slow = np.abs(np.fft.rfft(left)[1 : _SLOW + 1]) / math.sqrt(left.size)
    noise = max(predictor.noise, float(np.sqrt(np.mean(slow**2))))  # disturbances that are larger the slower they are
    sure = np.abs(found) / (noise * unsure)
    size = float(np.ptp(shapes[:, 1:] @ found[1:]) / abs(predictor.a.sum())) / max(float(y.std()), np.finfo(float).tiny)
    if sure[1:].max() < _CERTAIN or size < _DRIFTS:
        return []
    straight = sure[1] >= 2 * sure[2:].max()
    words = f"{where} drifts by {100 * size:.2g} % of its rms over the record, which the input doesn't explain: " + (
        "remove the straight line" if straight else "let the machine settle, and measure again"
    )
    correction = "detrend linear" if straight else ""
    return [Fault(FaultKind.DRIFT, words, correction=correction, where=where, size=size)]


def moves_on(u: Real) -> bool:
    """Return whether inputs (T, nu) change often: an answer to a step or two looks like a drift, a tone, or another level."""
    if len(u) > LONG and moves_on(u[:LONG]):
        return True
    return int(np.sum(np.any(np.diff(u, axis=0) != 0, axis=1))) >= _CHANGES


def _operating_point(predictor: Predictor, record: TimeRecord, y: Real, where: str) -> list[Fault]:
    """Record that begins about a point of operation though zero initial conditions are stated."""
    n = predictor.a.size - 1
    still = predictor._replace(trend=0 * predictor.trend)
    first = np.abs(still.from_start(y[: 2 * n], record.u[: 2 * n])[:n]).max() / predictor.noise
    begins = float(np.abs(y[:_FIRST]).min())  # from rest, an output begins near zero
    if first < _FROM_REST or begins < max(_FROM_REST * predictor.noise, _LEVEL * abs(y.mean())):
        return []
    if not _mean_stands_out(y):
        return []
    moved = [j for j, one in enumerate(record.u.T) if _mean_stands_out(one)]
    if not moved:
        return []
    name, mean = record.inputs[moved[0]].name, record.u[:, moved[0]].mean()
    words = (
        f"{where} and input {name} are about {y.mean():.4g} and {mean:.4g} from the first sample on, {first:.2g} standard"
        " deviations from rest, where a record begins unless it says otherwise: a point of operation; count from it"
    )
    return [Fault(FaultKind.OFFSET, words, correction="detrend", where=where, size=float(y.mean() / y.std()))]


def _mean_stands_out(signal: Real) -> bool:
    """Return whether the mean is far above the lowest lines of the spectrum."""
    if np.ptp(signal) == 0:
        return False
    # Of a very long signal the means of a few samples have the same lowest lines.
    together = max(signal.size // LONG, 1)
    means = signal[: signal.size // together * together].reshape(-1, together).mean(axis=1)
    lines = np.abs(np.fft.rfft(means)[: _LOWEST + 1])
    return bool(lines[0] > _STANDS_OUT * np.sqrt(np.mean(lines[1:] ** 2)))


def _before_input(record: TimeRecord, told: set[str]) -> list[Fault]:
    """Offset of an output that is there before the input acts."""
    if record.initial != "rest" or np.any(record.u[0]):
        return []
    moves = np.flatnonzero(np.any(record.u, axis=1))
    still = int(moves[0]) if moves.size else 0
    found: list[Fault] = []
    for i, channel in enumerate(record.outputs):
        where = f"output {channel.name}"
        y = record.y[:still, i]
        if still == 0 or where in told:
            continue
        offset = float(np.median(y))
        if record.bound is None:
            sure = still >= 5 and abs(offset) > _BEFORE * max(float(y.std()), 1e-9 * abs(offset))
        else:
            radius = record.bound.radius[:still, i]
            sure = bool(np.all(np.abs(y) > radius)) and bool(np.all(np.abs(y - offset) <= 2 * radius))
        if sure and abs(offset) > _STEADY * np.ptp(record.y[:, i]):
            words = (
                f"{where} is {offset:.4g} before the input acts, and zero initial conditions are stated: an offset, or a point of"
                " operation; count from it"
            )
            size = abs(offset) / max(float(np.ptp(record.y[:, i])), np.finfo(float).tiny)
            found.append(Fault(FaultKind.OFFSET, words, correction="detrend", where=where, size=size))
            told.add(where)
    return found


def answers(record: TimeRecord, i: int, period: int | None) -> bool:
    """Return whether an output follows the inputs more than chance does; True for records that are too short to say."""
    y, u = record.y[:, i], record.u
    if len(y) < _FEWEST or np.ptp(y) == 0 or np.ptp(u) == 0:
        return True
    if period is not None and len(y) >= 2 * period:
        return _repeats(y, u, period)
    if len(y) > LONG:
        y, u = (one[liveliest(record.u)] for one in (y, u))
    order = order_for(*u.shape)
    if order < 2:
        return True
    from scipy.special import chdtri

    if gain_of_inputs(y, u) > chdtri(u.shape[1] * (order + 1), _CHANCE):
        return True
    alone = Predictors(u[:, :0])
    w = _whitened(alone, y)
    moving = [one for one in u.T if np.ptp(one) > 0]
    # Of an input that is its own continuation the past of the output tells as much.
    return any(own_continuation(one) or _correlated(w, _whitened(alone, one)) for one in moving)


def _whitened(predictors: Predictors, signal: Real) -> Real:
    none = np.zeros((signal.size, 0))
    w = predictors.of(signal).innovations(signal, none)
    return np.asarray(w - w.mean(), dtype=float)


def _correlated(w: Real, v: Real) -> bool:
    """Return whether two white signals are correlated at some lag."""
    size = 2 * w.size
    products = np.fft.irfft(np.fft.rfft(w, size) * np.fft.rfft(v, size).conj())
    return bool(np.abs(products).max() > _CORRELATED * np.sqrt(w.size) * w.std() * v.std())


def _repeats(y: Real, u: Real, period: int) -> bool:
    """Return whether excited lines of a periodic record stand out of their scatter between the periods."""
    from scipy.special import polygamma, psi

    most = max(LONG // period, 4) * period  # of a very long record the last
    if y.size > most:
        first = y.size // period * period - most
        y, u = y[first : first + most], u[first : first + most]
    whole = y.size // period * period
    lines = np.fft.rfft(y[:whole].reshape(-1, period), axis=1)[:, 1 : (period + 1) // 2]
    drive = np.abs(np.fft.rfft(u[:whole].reshape(-1, period, u.shape[1]), axis=1).mean(axis=0))[1 : (period + 1) // 2]
    excited = np.any(drive >= 0.2 * drive.max(axis=0), axis=1)
    m = len(lines)
    scatter = lines.var(axis=0, ddof=1)[excited]
    power = m * np.abs(lines.mean(axis=0)[excited]) ** 2
    if not np.any(scatter > 0) or excited.sum() < _LINES:
        return True
    ratio = power / np.maximum(scatter, _ROUNDING * max(float(power.max()), np.finfo(float).tiny))
    # F(2, 2 (m - 1)) by chance: the largest of all, the mean of their logarithms, the power of all.
    chance = (1 + ratio.max() / (m - 1)) ** (1 - m) * ratio.size
    mean, variance = psi(1) - psi(m - 1) + np.log(m - 1), polygamma(1, 1) + polygamma(1, m - 1)
    together = float(np.sum(np.log(np.maximum(ratio, np.finfo(float).tiny)) - mean)) / math.sqrt(variance * ratio.size)
    power_of_all = (float(np.sum(power) / np.sum(scatter)) - 1) / math.sqrt((1 + 1 / (m - 1)) / ratio.size)
    return bool(chance < _CHANCE or together > _SURE or power_of_all > _SURE)
