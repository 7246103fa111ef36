"""Records of steps and blows near their beginning, from rest: local models with the rest before them, up to the noise.

The spectrum of what moves early is as smooth over the lines as that of a transient, so a window of lines tells neither from the
other. Where a record began at rest, what was before it is known: after that a step is in the middle of a record, and turns from
line to line as no transient does. A step has less and less at higher lines, and tells as much there as what it moves exceeds the
noise. Inputs that wait elsewhere than at zero, and outputs there, are at rest about a point of operation: it is what they are
before anything moves, with the error that noise leaves of it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Real
from robustid.data import TimeRecord, variances
from robustid.estimation.estimate import Estimate
from robustid.estimation.excited_lines import excited_lines, window_means
from robustid.estimation.nonperiodic import ORDER, half_window, local, spectra_of

_PARTS = 4  # of a record: in the first an input moves, and as long as one is the rest that is put before
_MOVED, _STILL = 0.05, 0.02  # of the largest change of an input: what moves it, and the most that all others are, rms
_TIMES = 10  # that an input moves at most
# What is more than noise: times the power of outputs at the highest lines; standard deviations of the response.
_MORE, _SEEN = 2.0, 4.0
_ELSEWHERE = 0.05  # of the range of an output: a beginning that is farther from zero is about a point of operation
_APART = 8.0  # deviations: what the first and the last samples before anything moves differ by, where outputs rest
_BLOCKS = 32  # of a record, at least: the mean of one is the level before the step, and those of the last quarter say its error


def is_step(record: TimeRecord) -> bool:
    """Return whether inputs that never change are steps, from rest, at the first sample."""
    return record.initial == "rest" and bool(np.any(record.u) and np.all(record.u == record.u[0]))


def local_from_rest(records: list[TimeRecord], lines: ArrayLike | None) -> Estimate:
    """Local models as `local`, where inputs move a few times from rest, and early, after it: up to the last line above the noise.

    Lines that are stated are those of the records as they are.
    """
    counted = _counted(records) if lines is None else None
    if counted is None:
        return local(records, lines)
    rest, errors = len(records[0].u) // _PARTS, [error for _, error in counted]
    records = [_after(one, rest) for one, _ in counted]
    x, y = (spectra_of(np.stack(signals)) for signals in zip(*((one.u, one.y) for one in records), strict=True))
    half, last = half_window(*x.shape[::2]), (len(records[0].u) - 1) // 2
    window = 2 * half + 1
    changes = spectra_of(np.diff(np.stack([one.u for one in records]), axis=1, prepend=0.0))
    index = np.union1d(*(excited_lines(one, half, last, ORDER + 1) for one in (x, changes)))
    power = window_means(np.mean(np.abs(y) ** 2, axis=0), half)
    index = _to_last(index, power[index] > _MORE * np.median(power[last - last // _PARTS :], axis=0), window)
    found = local(records, index, rest=rest)
    size, error = np.abs(found.values), np.sqrt(variances(found.covariance, found.values.shape))
    # Again without the others, so that each line has its part in the poles of all.
    found = local(records, _to_last(index, np.any(size > _SEEN * error, axis=2), window), rest=rest)
    found = found._replace(source=f"{found.source}, the records from rest")
    if not np.any(errors):
        return found
    more = _of_levels(np.array(errors), x[:, found.index], rest, len(records[0].u), found.index)
    source = f"{found.source}, counted from where they begin"
    return found._replace(covariance=found.covariance + more, source=source)


def _counted(records: list[TimeRecord]) -> list[tuple[TimeRecord, Real]] | None:
    """Records as `_from_level` counts them; None where they are short, inputs move on, none early, or outputs are on their way."""
    samples, nu = records[0].u.shape
    short = (samples - 1) // 2 < 2 * half_window(len(records), nu) + 1
    if short or any(one.initial != "rest" or one.reference is not None for one in records):
        return None
    waits = [wait for one in records if (wait := _waits(one.u)) is not None]
    if len(waits) < len(records) or min(waits) >= samples // _PARTS:
        return None
    found = [level for one in records if (level := _from_level(one)) is not None]
    return found if len(found) == len(records) else None


def _from_level(record: TimeRecord) -> tuple[TimeRecord, Real] | None:
    """A record counted from what it is before anything moves, where that is not zero; and variances (ny,) of the outputs there.

    Inputs that never move are a step at the first sample, which no output answers yet. None where outputs are still on their way.
    """
    u: Real = record.u
    y: Real = record.y
    samples = len(u)
    moved = np.flatnonzero(np.any(u != u[0], axis=1))
    before = int(moved[0]) if moved.size else 1
    half = min(before // 2, samples // _BLOCKS)
    if half and np.any(
        np.abs(y[:half].mean(axis=0) - y[before - half : before].mean(axis=0)) > _APART * _noise(y, half)
    ):
        return None
    count = max(1, min(before, samples // _BLOCKS))
    level = y[before - count : before].mean(axis=0)
    base = u[0] if moved.size else np.zeros_like(u[0])
    if not np.any(base) and np.all(np.abs(level) <= _ELSEWHERE * np.ptp(y, axis=0)):
        return record, np.zeros(len(record.outputs))
    return dataclasses.replace(record, u=u - base, y=y - level, bound=None), _noise(y, count) ** 2


def _noise(y: Real, count: int) -> Real:
    """Deviations (ny,) of means of so many samples, by those in the last part of a record."""
    tail = y[-(len(y) // _PARTS // count * count) :]
    line = np.stack([np.ones(len(tail)), np.linspace(-1, 1, len(tail))], axis=1)
    left: Real = tail - line @ np.linalg.lstsq(line, tail, rcond=None)[0]
    blocks: Real = left.reshape(-1, count, y.shape[1]).mean(axis=1)
    apart: Real = blocks - blocks.mean(axis=0)
    return np.asarray(np.sqrt(np.sum(apart**2, axis=0) / (len(blocks) - 2)), dtype=float)


def _after(record: TimeRecord, rest: int) -> TimeRecord:
    more = ((rest, 0), (0, 0))
    return dataclasses.replace(record, u=np.pad(record.u, more), y=np.pad(record.y, more), bound=None)


def _of_levels(variance: Real, x: Complex, rest: int, samples: int, index: NDArray[np.intp]) -> Complex:
    """Covariance of the response at lines, of levels with variances (R, ny): they err by e, it by ``e B X^+``, B of what stays."""
    stays = np.abs(spectra_of((np.arange(samples) >= rest).astype(float)[:, None])[index, 0]) ** 2
    inverse = np.linalg.pinv(x.transpose(1, 2, 0))  # (K, R, nu)
    lines, nu, ny = len(index), x.shape[2], variance.shape[1]
    found = np.zeros((lines, nu, ny, nu, ny), complex)
    for i, own in enumerate(variance.T):
        found[:, :, i, :, i] = np.einsum("k,r,krj,krl->kjl", stays, own, inverse, inverse.conj())
    return found.reshape(lines, nu * ny, nu * ny)


def _to_last(index: NDArray[np.intp], seen: NDArray[np.bool_], least: int) -> NDArray[np.intp]:
    """Lines up to the last one at which any output is seen (K, ny), so many at least."""
    return index[: max(int(np.max(np.flatnonzero(np.any(seen, axis=1)), initial=0)) + 1, least)]


def _waits(inputs: Real) -> int | None:
    """Samples before any of the inputs (N, n) moves, where each does a few times and rests between; None where one does not."""
    changes = np.abs(np.diff(inputs, axis=0, prepend=0.0))
    largest = changes.max(axis=0)
    moves = changes > _MOVED * largest
    times = np.sum(np.diff(moves, axis=0, prepend=False) & moves, axis=0)
    still = np.sqrt(np.mean(np.where(moves, 0.0, changes) ** 2, axis=0)) <= _STILL * largest
    if not np.any(moves) or np.any(times > _TIMES) or not np.all(still):
        return None
    return int(np.flatnonzero(np.any(moves, axis=1))[0])
