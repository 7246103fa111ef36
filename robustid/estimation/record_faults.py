"""Faults of records: dead, stuck and clipped signals, periods, noise, drift, records unlike the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.core import Real, as_count
from robustid.data import Fault, FaultKind, TimeRecord, as_records
from robustid.estimation.feedback import feedback_faults
from robustid.estimation.periodic import without_drift
from robustid.estimation.record_relations import with_relations

# A clipped signal has many samples at its extreme value and few beside it; the crest of a sine in a coarse quantiser
# has 2.4 times as many in its top step as in the next.
_CLIPPED_RATIO, _CLIPPED_PART, _CLIPPED_LEAST = 5, 1e-3, 10
_STUCK_LEAST, _STUCK_RATIO = 20, 10  # samples in a row that are the same, and how many times as many as elsewhere
_REPEATS, _DIFFERS = 0.15, 0.5  # share of a signal's power by which periods may differ; by which something else does
_SHORTEST = 8  # samples of a period that is looked for
_WRONG = 0.3  # share of the input's power by which its periods differ, from which on they are none
_NOISY, _UNEQUAL = 2.0, 1.5  # times the median of the records
_DRIFTS = 0.05  # part of the rms of an output
_INPUT_NOISE = 0.05  # of the input at the lines that carry it
_CARRYING = 0.2  # of its largest line


def record_faults(record: TimeRecord | Sequence[TimeRecord], *, period: int | None = None) -> tuple[Fault, ...]:
    """Faults of records, before anything is estimated from them.

    Of every record: signals that are constant, get stuck, or stay at their extreme value; input that repeats although nothing says
    with which period, or doesn't although something does; input that follows earlier outputs (a closed loop without reference, or
    input and output exchanged). Of periodic ones, with `period`: drifts, and noise of the input. Of several: noise or level of
    one that is unlike the others'.

    Parameters
    ----------
    record : TimeRecord or sequence of TimeRecord
        Of a sequence, faults say the number of their record, from 1.
    period : int, optional
        Period in samples; left out, one is looked for.

    Returns
    -------
    tuple of Fault

    Raises
    ------
    InputTypeError
        Something that isn't a TimeRecord.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> time = np.arange(200)
    >>> print(rid.prepare.record_faults(rid.TimeRecord(0 * time, np.clip(np.sin(0.1 * time), -2, 0.8), dt=1.0))[0])
    input u is constant (0): it excites nothing
    >>> u = np.tile(np.random.default_rng(0).standard_normal(50), 4)
    >>> print(*rid.prepare.record_faults(rid.TimeRecord(u, 2 * u, dt=1.0)))
    the input repeats every 50 samples (4 periods), and nothing says so: give period = 50
    """
    records = as_records("record", record)
    period = None if period is None else as_count("period", period, least=2)
    found: list[Fault] = []
    for k, one in enumerate(records, start=len(records) > 1):
        found += [fault._replace(record=k) for fault in _alone(one, [r.u for r in records], period)]
    same = all(one.u.shape == records[0].u.shape and one.y.shape == records[0].y.shape for one in records)
    if period is not None and same and all(_repeats_with(one, period) for one in records):
        found += _periodic(records, period)
    if len(records) > 1 and same:
        found += _levels(records)
    return tuple(with_relations(found, records, period) if same else found)


def _alone(record: TimeRecord, inputs: list[Real], period: int | None) -> list[Fault]:
    found: list[Fault] = []
    for j, channel in enumerate(record.inputs):
        signal = record.u[:, j]
        # One input at a time is an experiment too: others may rest in it.
        step = record.initial == "rest" and signal[0] != 0 and np.all(record.u == record.u[0])
        if not step and all(np.all(u[:, min(j, u.shape[1] - 1)] == u[0, min(j, u.shape[1] - 1)]) for u in inputs):
            words = f"input {channel.name} is constant ({signal[0]:.6g}): it excites nothing"
            found.append(Fault(FaultKind.CONSTANT, words, where=f"input {channel.name}", size=float(signal[0])))
    for signal, channel in zip(record.y.T, record.outputs, strict=True):
        if np.all(signal == signal[0]):
            words = f"output {channel.name} is constant ({signal[0]:.6g}): a sensor that is not connected, or saturated"
            found.append(Fault(FaultKind.CONSTANT, words, where=f"output {channel.name}", size=float(signal[0])))
    sides = [("output", record.y, record.outputs)]
    if record.reference is not None:  # then the input is measured; an input that is played may stay at its ends
        sides.append(("input", record.u, record.inputs))
    for side, signals, channels in sides:
        for signal, channel in zip(signals.T, channels, strict=True):
            where = f"{side} {channel.name}"
            found += _at_ends(signal[_first_change(record.u) :], where)  # at rest, a signal is at one value
            found += _stuck(signal, record.u, where)
    repeating = _repeating(record, period)
    # A periodic input is like its own past: it is correlated with earlier outputs too.
    random = period is None and record.initial != "periodic" and not repeating
    return found + repeating + (feedback_faults(record) if random else [])


def _first_change(u: Real) -> int:
    """Number of samples, but one, before an input changes for the first time."""
    return max(int(np.argmax(np.any(u != u[0], axis=1))) - 1, 0)


def _at_ends(signal: Real, where: str) -> list[Fault]:
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
    """Number of samples exactly at the extreme value; 0 unless many of them come in runs, and few are beside it."""
    at = np.concatenate([[False], signal == extreme, [False]])
    count, in_runs = int(at.sum()), int(np.sum(at[1:-1] & (at[:-2] | at[2:])))
    if in_runs < max(_CLIPPED_LEAST, _CLIPPED_PART * signal.size) or count == signal.size:
        return 0
    others = signal[signal != extreme]
    next_to = others[np.argmin(np.abs(others - extreme))]
    return count if count > _CLIPPED_RATIO * np.sum(signal == next_to) else 0


def _stuck(signal: Real, u: Real, where: str) -> list[Fault]:
    """Stretch in which a signal keeps one value, between its ends, while the input moves."""
    starts = np.flatnonzero(np.concatenate([[True], signal[1:] != signal[:-1]]))
    runs = np.diff(np.concatenate([starts, [signal.size]]))
    longest = int(np.argmax(runs))
    start, count = int(starts[longest]), int(runs[longest])
    usual = np.partition(runs, -2)[-2] if runs.size > 1 else count
    if count < max(_STUCK_LEAST, _STUCK_RATIO * usual) or signal[start] in (signal.min(), signal.max()):
        return []
    if np.all(u[start : start + count] == u[start]):
        return []
    words = f"{where} keeps the value {signal[start]:.6g} for {count} samples from sample {start} on: it was stuck"
    return [Fault(FaultKind.STUCK, words, where=where, size=count)]


def _repeating(record: TimeRecord, period: int | None) -> list[Fault]:
    """Period that isn't stated, or is wrong."""
    drive = record.u if record.reference is None else record.reference
    drive = drive - drive.mean(axis=0)
    power = float(np.mean(np.asarray(drive, dtype=float) ** 2))
    if power == 0:
        return []
    if period is not None:
        if len(drive) < 2 * period or _repeats_with(record, period):
            return []
        apart = _apart(drive, period)
        right = found_period(record)
        hint = "" if right is None else f"; it repeats every {right} samples"
        words = f"the input differs by {100 * apart:.2g} % of its power from one period of {period} samples to the next{hint}"
        return [Fault(FaultKind.WRONG_PERIOD, words, where="input", size=apart)]
    right = found_period(record)
    if right is None:
        return []
    whole = len(drive) // right
    cut = "" if whole * right == len(drive) else f"; cut the record to {whole * right} samples"
    words = (
        f"the input repeats every {right} samples ({whole} periods), and nothing says so: give period = {right}{cut}"
    )
    return [Fault(FaultKind.UNSTATED_PERIOD, words, where="input", size=right)]


def _repeats_with(record: TimeRecord, period: int) -> bool:
    """Return whether there are two periods, and they are alike."""
    drive = record.u if record.reference is None else record.reference
    return len(drive) >= 2 * period and _apart(drive - drive.mean(axis=0), period) <= _WRONG


def _apart(signal: Real, lag: int) -> float:
    """Share of the power of a signal (T, n) by which it differs from itself `lag` samples later; 1 where unrelated."""
    early, late = signal[:-lag], signal[lag:]
    return float(np.sum((early - late) ** 2) / max(np.sum(early**2) + np.sum(late**2), np.finfo(float).tiny))


def found_period(record: TimeRecord) -> int | None:
    """Shortest period in samples with which the excitation, reference or input, repeats; None where it doesn't.

    The shortest lag, at most half the record, at which it differs from itself by at most 15 % of its power, after it has differed
    by half of it.
    """
    signal = record.u if record.reference is None else record.reference
    signal = signal - signal.mean(axis=0)
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
    # The best lag of the first dip.
    first = int(repeats[0])
    dip = first + np.argmax(np.concatenate([apart[first:] > _DIFFERS, [True]]))
    return first + int(np.argmin(apart[first : max(dip, first + 1)]))


def _periodic(records: list[TimeRecord], period: int) -> list[Fault]:
    """Faults that whole periods show: drifts, noise unlike that of other records, noise of the input."""
    periods = len(records[0].u) // period
    # Of the later half, where transients have died out.
    kept = slice(min(periods // 2, periods - 2) * period, periods * period)
    y, drift = without_drift(np.stack([r.y[kept] for r in records]), period)
    u, _ = without_drift(np.stack([r.u[kept] for r in records]), period)
    several = len(records) > 1
    found: list[Fault] = []
    size = drift / np.maximum(y.std(axis=1), np.finfo(float).tiny)
    for k, i in np.argwhere(size > _DRIFTS):
        where = f"output {records[0].outputs[i].name}"
        words = f"{where} drifts by {100 * size[k, i]:.2g} % of its rms; the drift over whole periods is removed"
        number = int(k) + 1 if several else 0
        found.append(Fault(FaultKind.DRIFT, words, where=where, record=number, size=float(size[k, i])))
    noise = _scatter(y, period)
    if several:
        usual = np.sort(noise, axis=0)[(len(noise) - 1) // 2]  # of two records, of the quieter one
        for k, i in np.argwhere(noise > _NOISY * np.where(usual > 0, usual, np.inf)):
            where, times = f"output {records[0].outputs[i].name}", float(noise[k, i] / usual[i])
            words = (
                f"{where} differs from period to period {times:.2g} times as much as in the other records: something disturbed"
                " it; leave the record out, or measure it again"
            )
            found.append(Fault(FaultKind.DISTURBED, words, where=where, record=int(k) + 1, size=times))
    return found + _input_noise(records, u, period)


def _scatter(signals: Real, period: int) -> Real:
    """Standard deviation between the periods, (R, n), of signals (R, T, n)."""
    cut = signals.reshape(len(signals), -1, period, signals.shape[2])
    return np.sqrt(cut.var(axis=1, ddof=1).mean(axis=1))


def _input_noise(records: list[TimeRecord], u: Real, period: int) -> list[Fault]:
    """Noise of a measured input at the lines that carry it: it makes the response too small."""
    spectra = np.fft.rfft(u.reshape(len(u), -1, period, u.shape[2]), axis=2)
    size, noise = np.abs(spectra.mean(axis=1)), spectra.std(axis=1, ddof=1)
    found: list[Fault] = []
    for j, channel in enumerate(records[0].inputs):
        level: Real = size[:, 1:, j]
        carrying = level >= _CARRYING * level.max()
        if level.max() == 0:
            continue
        own: Real = noise[:, 1:, j]
        share = float(np.sqrt(np.mean(own[carrying] ** 2) / np.mean(level[carrying] ** 2)))
        if share > _INPUT_NOISE:
            one = share**2 / (len(records[0].u) // period)
            words = (
                f"input {channel.name} is measured with noise: {100 * share:.2g} % of its amplitude at the lines that carry it, in"
                f" one period. The mean over the periods leaves a response about {100 * one:.2g} % too small; give a reference,"
                " which has no noise"
            )
            found.append(Fault(FaultKind.NOISY_INPUT, words, where=f"input {channel.name}", size=share))
    return found


def _levels(records: list[TimeRecord]) -> list[Fault]:
    """Excitation or answer of a record unlike that of the others."""
    found: list[Fault] = []
    for side in ("input", "output"):
        signals = np.stack([(r.u if side == "input" else r.y).std(axis=0) for r in records])
        for i, level in enumerate(signals.T):
            there = level > 0.01 * level.max()
            if there.sum() < 2:
                continue
            usual = float(np.median(level[there]))
            limit = _UNEQUAL if side == "input" else _NOISY
            for k in np.flatnonzero(there & ((level > limit * usual) | (level < usual / limit))):
                where = f"{side} {(records[0].inputs if side == 'input' else records[0].outputs)[i].name}"
                times = float(level[k] / usual)
                words = f"{where} has {times:.2g} times the rms of the other records: they are not the same experiment"
                found.append(Fault(FaultKind.OTHER_LEVEL, words, where=where, record=int(k) + 1, size=times))
    return found
