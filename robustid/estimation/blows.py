"""Records of a blow: a short input from rest, and outputs that ring out. Each of them is one period of a response that repeats.

The spectrum of a blow is as smooth over the lines as that of a transient, so a window of lines tells neither from the other; but
from rest, and rung out, there is no transient. What still rings at the end is bounded from how it fell before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.core import Real
from robustid.data import TimeRecord, stacked
from robustid.estimation.estimate import Estimate
from robustid.estimation.excited_lines import window_means

_STRUCK, _SILENT = 0.05, 0.02  # of the largest input: what is of the blow, and the most that is beside it, rms
_SHORT = 8  # parts of the record, of which the blow takes one at most, in the first half
_PARTS, _FEWEST = 32, 8  # parts of a record whose levels are compared, and their fewest samples
_RUNG_OUT = 0.1  # level of an output before the blow and at the end, relative to the largest
_AROUND = 4  # lines on either side that a quarter of a record does not tell apart
_DEVIATIONS = 2.0  # at least, of a bound that holds at all lines at once: the most that is cut off is within it
_SLOWEST = 0.8  # decay from quarter to quarter: what falls less is noise, or has not rung out


def are_blows(records: Sequence[TimeRecord], period: int | None) -> bool:
    """Return whether several records, each without a stated period, are of one input that strikes once."""
    first = records[0]
    one = len(records) > 1 and first.u.shape[1] == 1 and all(r.reference is None for r in records)
    return one and period in (None, len(first.u)) and all(r.initial != "free" and _is_blow(r) for r in records)


def _is_blow(record: TimeRecord) -> bool:
    u, samples = np.abs(record.u[:, 0]), len(record.u)
    struck = np.flatnonzero(u > _STRUCK * u.max())
    if not struck.size or struck[-1] >= samples // 2 or struck[-1] - struck[0] >= samples // _SHORT:
        return False
    if np.sqrt(np.mean(np.delete(u, slice(struck[0], struck[-1] + 1)) ** 2)) > _SILENT * u.max():
        return False
    length = max(samples // _PARTS, _FEWEST)
    y = record.y - record.y[-4 * length :].mean(axis=0)
    levels = np.sqrt(np.mean(y[: samples // length * length].reshape(-1, length, y.shape[1]) ** 2, axis=1))
    quiet = [np.sqrt(np.mean(y[-length:] ** 2, axis=0))]
    quiet += [np.sqrt(np.mean(y[: struck[0]] ** 2, axis=0))] * bool(struck[0] >= _FEWEST)
    return bool(np.all(np.array(quiet) <= _RUNG_OUT * levels.max(axis=0)))


def with_ringing(found: Estimate, records: Sequence[TimeRecord]) -> Estimate:
    """The estimate of blows as periods, with the variance of what each cuts off: the same in all of them, it shows in no scatter.

    What falls by rho from one quarter of the record to the next goes on, after the last one, as ``rho/(1 - rho)`` of that.
    """
    y, u = (np.stack([getattr(r, name) for r in records]) for name in ("y", "u"))
    quarter = y.shape[1] // 4
    before, last = (
        _power(y[:, at : at + quarter], y.shape[1]) for at in (y.shape[1] - 2 * quarter, y.shape[1] - quarter)
    )
    rho = np.minimum(np.sqrt(last / np.where(before > 0, before, np.inf)), _SLOWEST)
    force = np.abs(np.fft.rfft(u, axis=1)[:, found.index]) ** 2
    cut = np.mean((last * (rho / (1 - rho)) ** 2)[:, found.index] / force, axis=0)
    more = stacked(cut[:, :, None] / _DEVIATIONS**2)[:, None, :] * np.eye(found.values[0].size)
    return found._replace(
        covariance=found.covariance + more,
        source=f"{found.source}; every record, of a blow that rings out, is one period",
    )


def _power(part: Real, samples: int) -> Real:
    """Mean power (R, K, ny) of a part of records around every line of the whole."""
    power = np.abs(np.fft.rfft(part, n=samples, axis=1)) ** 2
    return np.stack([window_means(one, _AROUND) for one in power])
