"""Records of steps and blows near their beginning, from rest: local models with the rest before them, up to the noise.

The spectrum of what moves early is as smooth over the lines as that of a transient, so a window of lines tells neither from the
other. Where a record began at rest, what was before it is known: after that a step is in the middle of a record, and turns from
line to line as no transient does. A step has less and less at higher lines, and tells as much there as what it moves exceeds the
noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Real
from robustid.data import TimeRecord, variances
from robustid.estimation.estimate import Estimate
from robustid.estimation.excited_lines import excited_lines, window_means
from robustid.estimation.nonperiodic import ORDER, half_window, local, spectra_of

_PARTS = 4  # of a record: after the first no input moves, and as long as one is the rest that is put before
_MOVED, _STILL = 0.05, 0.02  # of the largest change of an input: what moves it, and the most that all others are, rms
# What is more than noise: times the power of outputs at the highest lines; standard deviations of the response.
_MORE, _SEEN = 2.0, 4.0


def is_step(record: TimeRecord) -> bool:
    """Return whether inputs that never change are steps, from rest, at the first sample."""
    return record.initial == "rest" and bool(np.any(record.u) and np.all(record.u == record.u[0]))


def local_from_rest(records: list[TimeRecord], lines: ArrayLike | None) -> Estimate:
    """Local models as `local`, where all inputs move early, from rest, after it: up to the last line above the noise.

    Lines that are stated are those of the records as they are.
    """
    early = all(one.initial == "rest" and one.reference is None and _moves_early(one.u) for one in records)
    if not early or lines is not None:
        return local(records, lines)
    rest = len(records[0].u) // _PARTS
    more = ((rest, 0), (0, 0))
    records = [dataclasses.replace(one, u=np.pad(one.u, more), y=np.pad(one.y, more), bound=None) for one in records]
    u = np.stack([one.u for one in records])
    half, last = half_window(*u.shape[::2]), (u.shape[1] - 1) // 2
    changes = np.diff(u, axis=1, prepend=0.0)
    index = np.union1d(*(excited_lines(spectra_of(one), half, last, ORDER + 1) for one in (u, changes)))
    power = window_means(np.mean(np.abs(spectra_of(np.stack([one.y for one in records]))) ** 2, axis=0), half)
    index = _to_last(index, power[index] > _MORE * np.median(power[last - last // _PARTS :], axis=0))
    found = local(records, index, rest=rest)
    size, error = np.abs(found.values), np.sqrt(variances(found.covariance, found.values.shape))
    # Again without the others, so that each line has its part in the poles of all.
    return local(records, _to_last(index, np.any(size > _SEEN * error, axis=2)), rest=rest)


def _to_last(index: NDArray[np.intp], seen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Lines up to the last one at which any output is seen (K, ny)."""
    return index[: np.max(np.flatnonzero(np.any(seen, axis=1)), initial=0) + 1]


def _moves_early(inputs: Real) -> bool:
    """Return whether nothing moves inputs (N, n) after the first part of a record but noise."""
    changes = np.abs(np.diff(inputs, axis=0, prepend=0.0))
    largest, late = changes.max(axis=0), changes[len(inputs) // _PARTS :]
    return bool(np.all(late <= _MOVED * largest) and np.all(np.sqrt(np.mean(late**2, axis=0)) <= _STILL * largest))
