"""Modes from records alone: the poles of the smallest fit of them that keeps their samples inside the bounds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from robustid.core import Budget
from robustid.data import TimeRecord
from robustid.errors import InputError
from robustid.fitting import ModeRow, RecordFit, fit_records, mode_table
from robustid.identification import validate

_MOST_ORDER, _SECONDS = 12, 60.0
_CLOSE = 1.2  # times the bounds: least squares keeps to them no better, where the order is right
_EQUATIONS = 3  # samples that a parameter asks for
_FAST = 0.7  # decay of a pole per sample that any non-parametric part holds as well
_SLOW = {1: 0.2, 2: 0.05}  # decay over the longest record below which a pole, or a pair, is a guess: drift or sustained


def modes_of_records(
    records: Sequence[TimeRecord], count: int | None = None, seconds: float = _SECONDS
) -> tuple[tuple[ModeRow, ...], str]:
    """Poles that decay slowly, as rows of a mode table, of `count` modes or as many as the bounds ask for; and words on them.

    The order is the first whose output-error fit, from free initial states where the record has them, keeps the samples within 1.2
    times their bounds; else the one of least description length. The fit has a direct term, as the class may. No rows where no
    fit says anything.
    """
    budget, lengths, fits = Budget(seconds), {}, {}
    for order, fit in _fits(records, 2 * count if count else None, budget):
        found = [validate(fit.model, record) for record in records]
        ratio = max(one.ratio or 0.0 for one in found)
        misfit = float(np.sqrt(np.mean([np.square(1 - one.fit) for one in found])))
        samples = sum(record.y.size for record in records)
        free = sum(fit.B.shape) + len(records)
        lengths[order] = 2 * samples * math.log(max(misfit, 1e-300)) + order * free * math.log(samples)
        fits[order] = fit, ratio
        if ratio <= _CLOSE or budget.over:
            break
    if not fits:
        return (), "No parametric part: the records have too few samples for a fit."
    inside = [order for order, (_, ratio) in fits.items() if ratio <= _CLOSE]
    order = min(inside, default=min(lengths, key=lengths.__getitem__))
    fit, ratio = fits[order]
    length = max(len(record.u) for record in records) * fit.dt
    rows = [row for row in mode_table(fit.model) if _says_something(row, fit.dt, length)]
    if inside:
        words = (
            f"output error of order {order}, the smallest that keeps every sample within {ratio:.3g} times its bound."
        )
    else:
        words = f"output error of order {order}, of least description length; residuals up to {ratio:.3g} times their bounds."
    lines = [f"  {row.hz:.5g} Hz, damping {row.damping:.3g}" for row in rows]
    return tuple(rows), "\n".join([words, *lines])


def _fits(records: Sequence[TimeRecord], only: int | None, budget: Budget) -> Iterator[tuple[int, RecordFit]]:
    """Fits of rising order, as far as the samples go."""
    outputs, inputs = records[0].y.shape[1], records[0].u.shape[1]
    samples = sum(record.y.size for record in records)
    for order in range(1, _MOST_ORDER + 1) if only is None else [only]:
        if _EQUATIONS * order * (outputs + inputs + len(records)) > samples:
            return
        try:
            yield order, fit_records(records, order=order, feedthrough=True, time_limit=budget.seconds)
        except (InputError, np.linalg.LinAlgError):
            continue


def _says_something(row: ModeRow, dt: float, length: float) -> bool:
    """Tell whether a pole is damped, decays slower than any fast response, and not much slower than the records last."""
    if row.rigid or not 0 < row.damping <= 1 or not 0 < row.hz < 0.5 / dt:
        return False
    rate = 2 * math.pi * row.hz * row.damping
    return rate * dt < _FAST and rate * length > _SLOW[row.count]
