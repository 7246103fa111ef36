"""Several inputs in fewer periodic experiments than inputs: local models over the spectral lines of the mean period."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.data import Caveat, TimeRecord, stacked, variances
from robustid.errors import InputError
from robustid.estimation.changes import CHANGED, added_variance
from robustid.estimation.estimate import Estimate
from robustid.estimation.nonperiodic import SURE, half_window, local


def of_mean_periods(
    records: list[TimeRecord], period: int, lines: ArrayLike | None, driven: NDArray[np.bool_]
) -> Estimate:
    """Local models of the mean over the periods of every experiment, whose spectrum is ``G U + T`` at the lines of the period.

    Neighbouring lines tell the inputs apart, whether they are excited in turn or together. T, what the first state leaves, has the
    poles of G in the mean of all periods too: none is left out. Halves of the periods are compared. Nothing is extrapolated from
    the lines (K, nu) that are `driven`.
    """
    nu, count = records[0].u.shape[1], len(records[0].u) // period
    width = 2 * half_window(len(records), nu) + 1
    if period < (least := 2 * width + 1):
        raise InputError(
            f"`record`: {nu} inputs that are excited at lines of their own, or in fewer than {nu} experiments, are told apart over"
            f" {width} spectral lines, which takes a period of {least} samples; got {period}. Excite all at the same lines in"
            f" {nu} experiments, or with a longer period"
        )
    band = int(np.argmax(driven, axis=0).max()), len(driven) - 1 - int(np.argmax(driven[::-1], axis=0).max())
    found = local([_mean(one, period, 0, count) for one in records], lines, band)
    found = found._replace(source=f"mean of {count} periods, {found.source}" if count > 1 else found.source)
    if count < 2:
        return found
    first, last = (
        local([_mean(one, period, start, count // 2) for one in records], found.index)
        for start in (0, count - count // 2)
    )
    shape = found.values.shape
    noise = (variances(first.covariance, shape) + variances(last.covariance, shape)) / 2
    dof = float(np.min(found.dof))
    changes = added_variance(last.values - first.values, noise, dof, chance=SURE, shared=float(width))
    if not np.any(changes):
        return found
    return found._replace(
        covariance=found.covariance + stacked(changes)[:, None, :] * np.eye(found.values[0].size),
        changed=np.sqrt(changes) if found.changed is None else np.hypot(found.changed, np.sqrt(changes)),
        source=f"{found.source}{CHANGED if found.changed is None else ''}",
        caveats=(Caveat.CHANGING,),
    )


def _mean(record: TimeRecord, period: int, first: int, count: int) -> TimeRecord:
    """The mean of so many periods."""

    def mean(signals: np.ndarray) -> np.ndarray:
        cut = signals.reshape(-1, period, signals.shape[1])
        return cut[first : first + count].mean(axis=0)

    reference = None if record.reference is None else mean(record.reference)
    return dataclasses.replace(
        record, u=mean(record.u), y=mean(record.y), reference=reference, bound=None, initial="free"
    )
