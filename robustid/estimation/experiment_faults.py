"""Faults of time records that a measured response of the same plant shows, before any class is assumed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.core import Real, as_kind, counted
from robustid.data import Fault, FaultKind, FrequencyResponse, TimeRecord, as_frequency_response, as_records
from robustid.errors import InputError
from robustid.estimation.default_bound import estimate_bound
from robustid.estimation.record_trial import Known, RecordTrial, Remedy
from robustid.estimation.response_model import ResponseModel, response_model

_FEWEST, _LONGEST = 8, 4096  # samples that say something; that are used
_SAME = 0.02  # part by which the numbers of several outputs may differ and be one
_FALSE = 1e-5  # probability of a false alarm of one record, were the bound one standard deviation


def experiment_faults(frf: FrequencyResponse, record: TimeRecord | Sequence[TimeRecord]) -> tuple[Fault, ...]:
    """Faults of records that a response of the same plant shows, with what undoes them; no class is assumed.

    A stable rational model of the response is simulated with the input of the record. Where it misses the output by more than
    the bounds of both leave open, corrections are tried: sign, unit, delay, sample time, exchanged input and output, a start that
    is not at rest or already periodic, an offset, single samples. One is believed when it leaves a third of what was left,
    and little altogether; where none is, the record is of another plant than the response.

    Parameters
    ----------
    frf : FrequencyResponse
        Of discrete or continuous time; without a bound, with the one that it shows itself (`estimate_bound`).
    record : TimeRecord or sequence of TimeRecord
        With the inputs and outputs of the response. Only what lies inside the frequencies of the response is compared. Without a
        bound, the noise is what the best model of each record alone leaves.

    Returns
    -------
    tuple of Fault
        Empty where nothing is wrong, or the response is too short or too rough for a model.

    Raises
    ------
    InputError, InputTypeError
        Other numbers of signals; something that isn't a response, or a record.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 20, 60)
    >>> plant = rid.FrequencyResponse(omega, 100 / (100 - omega**2 + 2j * omega), bound=0.01)
    >>> t = 0.1 * np.arange(60)
    >>> y = 1 - np.exp(-t) * (np.cos(np.sqrt(99) * t) + np.sin(np.sqrt(99) * t) / np.sqrt(99))
    >>> rid.prepare.experiment_faults(plant, rid.TimeRecord(np.ones(60), y, dt=0.1, bound=0.01))
    ()
    >>> (fault,) = rid.prepare.experiment_faults(plant, rid.TimeRecord(np.ones(60), -y, dt=0.1, bound=0.01))
    >>> fault.words, fault.correction
    ('the sign of output y is the opposite of that of the response', 'negate')
    """
    frf = as_frequency_response("frf", frf)
    records = as_records("record", record)
    for one in records:
        as_kind("record", one, TimeRecord, "a TimeRecord")
        if (one.y.shape[1], one.u.shape[1]) != frf.values.shape[1:]:
            raise InputError(
                f"`record` has {counted(one.y.shape[1], 'output')} and {counted(one.u.shape[1], 'input')}, the response is"
                f" {frf.values.shape[1]}x{frf.values.shape[2]}; give records of the same signals"
            )
    radius = _radius(frf)
    model = None if radius is None else response_model(frf, radius)
    if model is None:
        return ()
    found: list[Fault] = []
    for k, one in enumerate(records, start=len(records) > 1):
        found += [fault._replace(record=k) for fault in _of_record(model, one, len(records))]
    return tuple(found)


def _radius(frf: FrequencyResponse) -> Real | None:
    """Size of the errors of every value."""
    if frf.bound is not None:
        return frf.bound.outer_radius
    try:
        return estimate_bound(frf).bound.outer_radius
    except InputError:
        return None


def _of_record(model: ResponseModel, record: TimeRecord, count: int) -> list[Fault]:
    if len(record.u) > _LONGEST and record.initial != "periodic":
        record = dataclasses.replace(
            record,
            u=record.u[:_LONGEST],
            y=record.y[:_LONGEST],
            reference=None,
            bound=None if record.bound is None else record.bound.select(slice(0, _LONGEST)),
        )
    if len(record.u) < _FEWEST:
        return []
    simulated: Known = {}
    found: list[tuple[RecordTrial, Remedy | None]] = []
    for i in range(len(record.outputs)):
        trial = RecordTrial(model, record, i, simulated)
        if not _sound(trial, count * len(record.outputs)):
            best = trial.best()
            if best is not None or trial.before.samples:
                found.append((trial, best))
    sizes = [best.size for _, best in found if best is not None]
    kinds = {None if best is None else best.kind for _, best in found}
    names = [channel.name for channel in record.outputs]
    # One fault of all outputs where they have the same; a correction is of all outputs.
    same = not sizes or max(sizes) - min(sizes) <= _SAME * max(map(abs, sizes)) or kinds == {FaultKind.NOT_AT_REST}
    if 1 < len(found) == len(names) and len(kinds) == 1 and same:
        return [_fault(*found[0], f"outputs {', '.join(names)}")]
    faults = [_fault(trial, best, f"output {names[trial.output]}") for trial, best in found]
    return faults if len(names) == 1 else [fault._replace(correction="") for fault in faults]


def _sound(trial: RecordTrial, tests: int) -> bool:
    """True where what is left can be noise within the bound, or nothing is known of the noise."""
    import scipy.stats

    before = trial.before
    if not np.isfinite(trial.sigma) or not np.isfinite(before.cost):
        return True
    if before.samples == 0:  # its frequencies are all other than those of the response
        return False
    if np.isfinite(trial.spare):
        return before.cost <= before.samples * float(scipy.stats.f.isf(_FALSE / tests, before.samples, trial.spare))
    return before.cost <= float(scipy.stats.chi2.isf(_FALSE / tests, before.samples))


def _fault(trial: RecordTrial, best: Remedy | None, where: str) -> Fault:
    before, bound = trial.before, "its bound" if trial.bounded else "its noise"
    missed = f"a model of the response misses it by {before.times:.3g} times {bound} (rms)"
    if best is not None:
        after = f"{best.left.times:.2g} times"
        if not before.samples:
            missed = (
                f"as it stands the record has none of the frequencies of the response, and is missed by {after} {bound}"
            )
        else:
            missed += f", by {after}"
        words = best.words.format(where=where)
        return Fault(best.kind, words, f"{missed} after the correction", best.correction, where, size=best.size)
    left: Real = np.where(trial.used, np.abs(before.residual), 0)
    worst = int(np.argmax(left))
    words = (
        f"the response does not explain {where}: one of the two is of another plant, or of another point of operation; measure both"
        " again with nothing changed between them"
    )
    part = float(np.sqrt(np.mean(before.residual[trial.used] ** 2))) / (trial.rms or 1.0)
    evidence = f"{missed}, {100 * part:.2g} % of it, most in sample {worst} ({worst * trial.dt:.4g} s)"
    return Fault(FaultKind.OTHER_PLANT, words, evidence, where=where, size=before.times)
