"""Faults of the samples of time records that are used as they stand, each within its bound."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation import record_faults

_LONGEST = 4096  # samples that are looked at
# Samples that are not what was measured, whatever the bounds are.
_UNTRUE = {FaultKind.SATURATED, FaultKind.STUCK, FaultKind.LOST, FaultKind.WRAPPED}
# Deviations, whose size is a part of the rms of the output: harmless within the bounds. Of drifts and tones the answer to a step
# cannot be told.
_DEVIATIONS = {FaultKind.SPIKE: 1.0, FaultKind.JUMP: 1.0, FaultKind.HELD: 1.0, FaultKind.QUANTISED: 3**0.5}


def sample_faults(record: TimeRecord) -> list[Fault]:
    """Faults of `record_faults` that are such of a record with bounds: what no bound is meant for, or what exceeds it.

    Not those that matter to an estimate of a response alone: its period, a closed loop, an input that excites little.
    """
    if not np.all(np.isfinite(record.y)) or not np.all(np.isfinite(record.u)):
        return []
    if len(record.u) > _LONGEST and record.initial != "periodic":
        record = _first(record, _LONGEST)
    places = {f"output {signal.name}": i for i, signal in enumerate(record.outputs)}
    told = [(fault, places[fault.where]) for fault in record_faults(record) if fault.where in places]
    return [fault for fault, i in told if _harms(fault, record, record.y[:, i], record.bound.radius[:, i])]


def _harms(fault: Fault, record: TimeRecord, y: Real, radius: Real) -> bool:
    """True of a fault that makes samples of an output leave their bounds."""
    if fault.kind is FaultKind.CONSTANT:  # an input that moves leaves no output as it is, but one that it doesn't reach
        return bool(np.ptp(record.u) > 0 and np.all(np.abs(y) > radius))
    if fault.kind is FaultKind.OFFSET:  # before the input acts
        still = int(np.argmax(np.any(record.u != 0, axis=1)))
        return record.initial == "rest" and still > 0 and bool(np.all(np.abs(y[:still]) > radius[:still]))
    if fault.kind in _DEVIATIONS:
        return abs(fault.size or 0.0) * _DEVIATIONS[fault.kind] * float(y.std()) > float(np.median(radius))
    return fault.kind in _UNTRUE


def _first(record: TimeRecord, samples: int) -> TimeRecord:
    """The first samples of a record."""
    arrays = {name: getattr(record, name) for name in ("u", "y", "reference")}
    cut = {name: array[:samples] for name, array in arrays.items() if array is not None}
    return dataclasses.replace(record, **cut, bound=record.bound.select(slice(0, samples)))
