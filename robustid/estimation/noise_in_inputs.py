"""Noise of the outputs in later inputs of a record without periods: a loop that is closed, and whose reference nobody recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.innovations import order_for

# What may be done about a loop, and what cannot be said without.
WITHOUT_CONTROLLER = (
    "Give the reference (--time-field reference=NAME), or the controller that ran ([loop] controller = FILE in a run file, or"
    " identify --loop FILE with the response of the loop): noise that is fed back biases the response where it is not small"
    " beside the excitation, the bound does not know it, and no margin of the loop follows"
)
_AHEAD = 5  # samples
_CHANCE = 1e-4
# Part of the innovations that later inputs tell, at least: a loop passes most of the noise on (.6 and more, .42 in a CD player).
# Inputs that were decimated, or measured with noise, tell a part too: they are known better by what comes after (.05 to .3).
_LEAST = 0.35
_ROWS = 20_000  # of a regression, about
_RIDGE = 1e-11  # of the power of a regressor
_PRECISE = 1e-8  # part of the power of an output that rounding, and an order that is too low, leave
_PEAKED = 30.0  # fourth moment over squared variance, from which on the changes of an input are a few steps


def noise_in_inputs(record: TimeRecord) -> list[Fault]:
    """Inputs of which later samples tell what neither the past of an output nor that of the inputs tells of it.

    In an open loop the input knows nothing of the noise. Least squares of an output on its own past and on earlier, present and
    later inputs: the later ones take from the innovations what chance takes, chi-squared of their number. Inputs that are twice as
    long past take part, so that an order that is too low is not taken for a loop.
    """
    from scipy.special import chdtri

    samples, nu = record.u.shape
    order = order_for(samples, 2 * nu)
    moving = [np.ptp(one) > 0 and not _stepped(one) for one in record.u.T]
    if order < 2 or not all(moving):
        return []
    rows: NDArray[np.intp] = np.asarray(np.arange(2 * order, samples - _AHEAD, max(1, samples // _ROWS)), dtype=np.intp)
    past = np.hstack([_lagged(record.u, rows, range(2 * order + 1)), np.ones((rows.size, 1))])
    later = np.hstack([_lagged(one[:, None], rows, range(-_AHEAD, 0)) for one in record.u.T])
    given = np.hstack([past, later])
    gram = given.T @ given
    limit = float(chdtri(_AHEAD, _CHANCE / (nu * record.y.shape[1])))
    found: list[tuple[float, str]] = []
    for y, output in zip(record.y.T, record.outputs, strict=True):
        if np.ptp(y) == 0:
            continue
        y = y - y.mean()
        own = _lagged(y[:, None], rows, range(1, order + 1))
        columns, cross = np.hstack([own, given]), own.T @ given
        products = np.block([[own.T @ own, cross], [cross.T, gram]])
        count = order + past.shape[1]
        without, spare = _left(columns, products, y[rows], count, slice(0)), rows.size - count - _AHEAD
        if spare < order or without <= _PRECISE * float(y[rows] @ y[rows]):
            continue
        for j, input in enumerate(record.inputs):
            more = slice(count + j * _AHEAD, count + (j + 1) * _AHEAD)
            gain = without / _left(columns, products, y[rows], count, more) - 1
            part = gain / (1 + gain)
            if gain * spare > limit and part > _LEAST:
                found.append((part, f"input {input.name} and output {output.name}"))
    if not found:
        return []
    part, pair = max(found)
    more = f" (and {len(found) - 1} more pairs)" if len(found) > 1 else ""
    words = (
        f"{pair}{more}: later inputs tell {100 * part:.2g} % of what the past leaves open of the output: the input follows its"
        f" noise, and the loop is closed, or the output comes before its input. {WITHOUT_CONTROLLER}"
    )
    return [Fault(FaultKind.FEEDBACK, words, where=pair, size=part)]


def _stepped(u: Real) -> bool:
    changes: Real = np.asarray(np.diff(u), dtype=float)
    changes = changes - float(changes.mean())
    return bool(np.mean(changes**4) > _PEAKED * np.mean(changes**2) ** 2)


def _lagged(signals: Real, rows: NDArray[np.intp], lags: range) -> Real:
    """Columns of signals (T, n) so many samples before the rows."""
    columns: list[Real] = [signals[rows - lag] for lag in lags]
    return np.concatenate(columns, axis=1)


def _left(columns: Real, products: Real, right: Real, first: int, more: slice) -> float:
    """Squares that least squares by the first columns and some more leave, with the products of all of them."""
    import scipy.linalg

    used = np.r_[:first, more]
    gram = products[np.ix_(used, used)]
    size = np.maximum(np.sqrt(np.diag(gram) / len(columns)), np.finfo(float).tiny)
    gram = gram / np.outer(size, size)
    gram[np.diag_indices_from(gram)] += _RIDGE * len(columns)
    factor = scipy.linalg.cho_factor(gram, check_finite=False)
    found = np.zeros(columns.shape[1])
    found[used] = scipy.linalg.cho_solve(factor, (columns.T @ right)[used] / size) / size
    return float(np.sum((right - columns @ found) ** 2))
