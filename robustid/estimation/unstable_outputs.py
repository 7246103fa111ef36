"""Outputs that grow without end: of a plant that is unstable, and measured without a controller that holds it."""

from __future__ import annotations

import math

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.innovations import Predictors
from robustid.estimation.stretch import LONG

_PARTS = 8  # of a record
_LARGER = 5.0  # rms of the last part, in that of any in the first half
_GROWTH = (
    4.0  # of the logarithm of the size, over the record, by the fastest pole: of 1500 double integrators 5 have it
)


def unstable_outputs(record: TimeRecord) -> list[Fault]:
    """Outputs that are far larger at the end than in the first half, and have a pole outside the unit circle that says so."""
    found: list[Fault] = []
    for y, channel in zip(record.y.T, record.outputs, strict=True):
        size = float(np.abs(y - y[0]).max())
        if size == 0 or y.size < _PARTS or not _swells((y - y[0]) / size):
            continue
        growth = y.size * _fastest(y / size, record.u)
        if growth > _GROWTH:
            where = f"output {channel.name}"
            words = (
                f"{where} grows without end, by a factor of 10^{growth / math.log(10):.0f} over the record: the plant is unstable,"
                " and nothing holds it; measure it in a loop that does, with the reference, or use the part before it grows"
            )
            found.append(Fault(FaultKind.UNSTABLE, words, where=where, size=growth))
    return found


def _swells(y: Real) -> bool:
    rms = np.array([math.sqrt(float(np.mean(part**2))) for part in np.array_split(y, _PARTS)])
    return bool(rms[-1] == rms.max() and rms[-1] >= _LARGER * rms[: _PARTS // 2].max())


def _fastest(y: Real, u: Real) -> float:
    """Logarithm of the modulus of the largest pole of a predictor of the end of an output; 0 where it is too short for one."""
    part = slice(max(y.size - LONG, 0), None)
    predictors = Predictors(u[part])
    if predictors.order == 0:
        return 0.0
    poles = np.roots(predictors.of(y[part]).a)
    return math.log(max(float(np.abs(poles).max()), np.finfo(float).tiny)) if poles.size else 0.0
