"""Faults of records: the face of what is found in single samples, in outputs, in periods, and between records."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.core import Real, as_count
from robustid.data import Fault, FaultKind, TimeRecord, as_records
from robustid.estimation.feedback import feedback_faults
from robustid.estimation.lost_samples import lost_in_periods, lost_samples
from robustid.estimation.output_faults import answers, moves_on, output_faults
from robustid.estimation.period_faults import period_faults
from robustid.estimation.record_relations import with_relations
from robustid.estimation.repetition import apart, found_period, unequal_blows
from robustid.estimation.sample_faults import at_ends, cut_off, in_steps, runs, slower, unwrapped, wrapped_fault
from robustid.estimation.steps import is_step
from robustid.estimation.stretch import liveliest, stretch_length
from robustid.estimation.unstable_outputs import unstable_outputs

_BETTER = 10  # times less, by another period than the one that is stated
_CLOSELY = 0.01  # share of the power by which periods may differ whose mean is taken out
_WRONG = 0.3  # share of the input's power by which its periods differ, from which on they are none
_TAKEN_OUT = (FaultKind.SPIKE, FaultKind.JUMP, FaultKind.WRAPPED)
_OF_ALL = (
    FaultKind.WRAPPED,
    FaultKind.HELD,
    FaultKind.QUANTISED,
    FaultKind.TONE,
    FaultKind.DRIFT,
    FaultKind.TRANSIENT,
    FaultKind.OFFSET,
    FaultKind.JITTER,
    FaultKind.FEEDBACK,
    FaultKind.UNSTABLE,
)


def record_faults(record: TimeRecord | Sequence[TimeRecord], *, period: int | None = None) -> tuple[Fault, ...]:
    """Faults of records, before anything is estimated from them.

    Of every record: outputs that grow without end, with which nothing else is looked for; signals that are constant, get
    stuck, or stay at their extreme value, whose samples were lost, wrapped around or came in coarse steps; outputs with
    spikes, jumps, drifts or tones that the input doesn't explain, that no input moves, or that begin about a point of
    operation; input that repeats although nothing says with which period, or doesn't although something does; input that
    follows earlier outputs (a closed loop without reference, or input and output exchanged). Of periodic ones, with `period`:
    drifts, transients, and noise of the input. Of several: noise or level of one that is unlike the others'.

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
    the input repeats every 50 samples (4 periods), and nothing says so: give --period 50, or period = 50 in a run
    file
    """
    records = as_records("record", record)
    period = None if period is None else as_count("period", period, least=2)
    found: list[Fault] = []
    told: set[tuple[int, str]] = set()
    clean: list[TimeRecord] = []
    periods = [found_period(one) for one in records]
    repeating = [_repeated(one, period or right) for one, right in zip(records, periods, strict=True)]
    for k, one in enumerate(records):
        faults, sound = _alone(one, [r.u for r in records], (period, periods[k]), repeating[k])
        found += [fault._replace(record=k + 1 if len(records) > 1 else 0) for fault in faults]
        told |= {(k, fault.where) for fault in faults if fault.where and fault.kind not in _TAKEN_OUT}
        clean.append(sound)
    same = all(one.u.shape == records[0].u.shape and one.y.shape == records[0].y.shape for one in records)
    moving = any(moves_on(one.u) for one in records)
    dead = _unmoved(records, repeating, told) if same and moving else []
    found += dead
    told |= {(k, fault.where) for fault in dead for k in range(len(records))}
    if period is not None and same and all(_repeats_with(one, period) for one in records):
        found += period_faults(clean, period, told)
    kept = _joined(found, len(records))
    return tuple(with_relations(list(kept), clean, period)) if same and moving else kept


def operating_point(record: TimeRecord) -> Fault | None:
    """The point of operation about which a record begins, though zero initial conditions are taken; None where it shows none."""
    if record.initial != "rest":
        return None
    found = output_faults(record, _repeated(record, found_period(record)), set()).faults
    return next((fault for fault in found if fault.kind is FaultKind.OFFSET and fault.correction), None)


def _repeated(record: TimeRecord, period: int | None) -> int | None:
    """Period, stated or found, with which the input repeats closely; None where it doesn't."""
    if period is None or len(record.u) < 2 * period:
        return None
    drive = record.u if record.reference is None else record.reference
    closely = apart(drive - drive.mean(axis=0), period) < _CLOSELY
    return period if closely and not unequal_blows(drive, period) else None


def _joined(found: list[Fault], records: int) -> tuple[Fault, ...]:
    """One sentence for what all records have: that of the record where it is largest."""
    kept: list[Fault] = []
    for fault in found:
        alike = [one for one in found if (one.kind, one.where) == (fault.kind, fault.where)]
        if fault.kind not in _OF_ALL or records < 2 or len({one.record for one in alike}) < records:
            kept.append(fault)
        elif fault is max(alike, key=lambda one: one.size or 0.0):
            words = f"all records, of which {fault.record} shows it most: {fault.words}"
            kept.append(fault._replace(record=0, words=words))
    return tuple(kept)


def _alone(
    record: TimeRecord, inputs: list[Real], periods: tuple[int | None, int | None], repeats: int | None
) -> tuple[list[Fault], TimeRecord]:
    """Faults of one record, with its period as it is stated and as it was found; and the record without what could be taken out."""
    if growing := unstable_outputs(record):  # nothing else can be judged beside it
        return growing, record
    found = _constant(record, inputs)
    told = {fault.where for fault in found}
    y, turns = record.y.copy(), False
    sides = [("output", record.y, record.outputs)]
    if record.reference is not None:  # then the input is measured; an input that is played may stay at its ends
        sides.append(("input", record.u, record.inputs))
    for side, signals, channels in sides:
        for i, (signal, channel) in enumerate(zip(signals.T, channels, strict=True)):
            where = f"{side} {channel.name}"
            if where in told:
                continue
            new, turned = _of_samples(record, signal, where, repeats)
            found += new
            told |= {where} if new and turned is signal else set()
            if side == "output":
                y[:, i] = turned
                turns |= turned is not signal
    clean = dataclasses.replace(record, y=y) if turns else record
    outputs = output_faults(clean, repeats, told)
    found += outputs.faults
    repeating = _repeating(record, *periods)
    # A periodic input is like its own past: it is correlated with earlier outputs too.
    random = periods[0] is None and record.initial != "periodic" and not repeating
    feedback = feedback_faults(_lively(record)) if random else []
    return found + repeating + feedback, clean if outputs.y is clean.y else dataclasses.replace(clean, y=outputs.y)


def _lively(record: TimeRecord) -> TimeRecord:
    """The stretch of a very long record in which its inputs are largest, of several pairs of signals a shorter one."""
    length = stretch_length(len(record.inputs), len(record.outputs))
    if len(record.u) <= length:
        return record
    part = liveliest(record.u, length)
    return TimeRecord(
        record.u[part],
        record.y[part],
        dt=record.dt,
        reference=None if record.reference is None else record.reference[part],
        initial="free",
        held=record.held,
        inputs=record.inputs,
        outputs=record.outputs,
    )


def _constant(record: TimeRecord, inputs: list[Real]) -> list[Fault]:
    """Signals that never change."""
    found: list[Fault] = []
    for j, channel in enumerate(record.inputs):
        signal = record.u[:, j]
        # One input at a time is an experiment too: others may rest in it.
        held = record.initial == "rest" and record.bound is not None and bool(np.any(record.u))
        step = held or (is_step(record) and signal[0] != 0)
        if not step and all(np.all(u[:, min(j, u.shape[1] - 1)] == u[0, min(j, u.shape[1] - 1)]) for u in inputs):
            words = f"input {channel.name} is constant ({signal[0] + 0.0:.6g}): it excites nothing"
            found.append(Fault(FaultKind.CONSTANT, words, where=f"input {channel.name}", size=float(signal[0])))
    for signal, channel in zip(record.y.T, record.outputs, strict=True):
        if np.all(signal == signal[0]):
            words = f"output {channel.name} is constant ({signal[0]:.6g}): a sensor that is not connected, or saturated"
            found.append(Fault(FaultKind.CONSTANT, words, where=f"output {channel.name}", size=float(signal[0])))
    return found


def _of_samples(record: TimeRecord, signal: Real, where: str, period: int | None) -> tuple[list[Fault], Real]:
    """Fault that the values of one signal show, the most telling only; and the signal, unwrapped."""
    drive = record.u if where.startswith("output") or record.reference is None else record.reference
    for found in (
        slower(signal, drive, where) if where.startswith("output") else [],  # a controller may be slower than records
        in_steps(signal, drive, where),
        runs(signal, drive, where),
        at_ends(signal[_first_change(record.u) :], where),  # at rest, a signal is at one value
    ):
        if found:
            return found, signal
    if drive is record.reference and drive.shape == record.u.shape:
        i = [f"input {one.name}" for one in record.inputs].index(where)
        if cut := cut_off(signal, drive[:, i], where):
            return cut, signal
    turned, count = unwrapped(signal, drive)
    if count:
        return [wrapped_fault(signal, count, where)], turned
    if drive is record.u:
        lost = lost_samples(signal, drive, where) if period is None else lost_in_periods(signal, period, where)
        return ([] if lost is None else [lost]), signal
    return [], signal


def _unmoved(records: list[TimeRecord], periods: list[int | None], told: set[tuple[int, str]]) -> list[Fault]:
    """Outputs that no input moves in any record."""
    found: list[Fault] = []
    for i, channel in enumerate(records[0].outputs):
        where = f"output {channel.name}"
        if any((k, where) in told for k in range(len(records))):
            continue
        if any(answers(r, i, period) for r, period in zip(records, periods, strict=True)):
            continue
        words = (
            f"{where} follows the input no more than chance does: a sensor that is not connected, or something far above the"
            " answer, noise or an input that is not given; check its cable and its range, and give all inputs"
        )
        found.append(Fault(FaultKind.NO_RESPONSE, words, where=where))
    return found


def _first_change(u: Real) -> int:
    """Number of samples, but one, before an input changes for the first time."""
    return max(int(np.argmax(np.any(u != u[0], axis=1))) - 1, 0)


def _repeating(record: TimeRecord, period: int | None, right: int | None) -> list[Fault]:
    """Period that isn't stated, or is wrong; with the one that was found."""
    drive = record.u if record.reference is None else record.reference
    drive = drive - drive.mean(axis=0)
    power = float(np.mean(np.asarray(drive, dtype=float) ** 2))
    if power == 0:
        return []
    if period is not None:
        if len(drive) < 2 * period:
            return []
        if unequal_blows(drive, period):
            words = "the input strikes with blows that are unequal, which no period has: give none, every blow then counts as it is"
            return [Fault(FaultKind.WRONG_PERIOD, words, where="input", size=apart(drive, period))]
        differs = apart(drive, period)
        better = right is not None and period % right != 0 and _BETTER * apart(drive, right) < differs
        if differs <= _WRONG and not better:
            return []
        hint = "" if right is None else f"; it repeats every {right} samples"
        words = f"the input differs by {100 * differs:.2g} % of its power from one period of {period} samples to the next{hint}"
        return [Fault(FaultKind.WRONG_PERIOD, words, where="input", size=differs)]
    if right is None:
        return []
    whole = len(drive) // right
    cut = "" if whole * right == len(drive) else f"; cut the record to {whole * right} samples"
    words = (
        f"the input repeats every {right} samples ({whole} periods), and nothing says so: give --period {right},"
        f" or period = {right} in a run file{cut}"
    )
    return [Fault(FaultKind.UNSTATED_PERIOD, words, where="input", size=right)]


def _repeats_with(record: TimeRecord, period: int) -> bool:
    """Return whether there are two periods, and they are alike."""
    drive = record.u if record.reference is None else record.reference
    alike = len(drive) >= 2 * period and apart(drive - drive.mean(axis=0), period) <= _WRONG
    return alike and not unequal_blows(drive, period)
