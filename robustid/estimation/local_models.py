"""Rational models of few neighbouring frequency points: what they say of a point that is left out, and how surely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from robustid.core import Complex, Real

# Poles and degree of the numerator, each with the points that it takes: a line has to be odd to all of them.
ORDERS = ((1, 1, 10), (2, 2, 12), (2, 3, 14), (3, 3, 16))
FEWEST = ORDERS[-1][-1] + 1
_TURNS = 2  # solutions, each weighted by the denominator of the one before
_SMALL = 1e-12  # of a direction of the unknowns, and of the scatter, in parts of the largest and of the values
_NEAR = 1e-3  # of the largest |A|: nearer to a pole no weight rises


class Said(NamedTuple):
    """Values at x = 0, (...,), their variances for a scatter of 1, and the mean square of residuals over their deviations."""

    value: Complex
    variance: Real
    scatter: Real
    dof: int  # complex residuals less unknowns
    denominator: Complex  # coefficients of x^poles, ..., x; that of 1 is 1, (..., poles)


def unlikely(ratio: Real | float, dof: float) -> Real:
    """Minus the logarithm of the chance of such a ratio of mean squares of complex noise, of one value over `dof` others."""
    return dof * np.log1p(np.asarray(ratio, float) / dof)


def mean_nearby(squares: Real, reach: int) -> Real:
    """Mean of exponentially distributed squares around every line, from their median: a few that are odd do not move it."""
    near = sliding_window_view(np.pad(squares, reach, mode="reflect"), 2 * reach + 1)
    return np.asarray(np.median(near, axis=1) / np.log(2), dtype=float)


def neighbours(count: int, lines: NDArray[np.intp], usable: NDArray[np.intp]) -> NDArray[np.intp]:
    """The nearest usable lines of each line in the order of the axis, as many on both sides as there are, itself left out."""
    place = np.searchsorted(usable, lines)
    own = (place < usable.size) & (usable[np.minimum(place, usable.size - 1)] == lines)
    start = np.clip(place - count // 2, 0, usable.size - own - count)
    taken = start[:, None] + np.arange(count)
    return usable[taken + (own[:, None] & (taken >= place[:, None]))]


def said_at_zero(x: Real, values: Complex, deviation: Real, poles: int, power: int, turns: int = _TURNS) -> Said:
    """Values that points (..., n) give to x = 0: B(x)/A(x), A(0) = 1, of `poles` poles and a numerator of degree `power`.

    Least squares of B(x) - (A(x) - 1) G(x) = G(x), weighted by 1/|A| of the solution before (Sanathanan and Koerner). The last
    unknown, B(0), is that of the last row of the triangular factor alone.
    """
    weight: Real = 1 / deviation
    powers: Real = x[..., None] ** np.arange(max(poles, power), -1, -1)
    low: Real = powers[..., -1 - poles : -1]
    parts = [-low * values[..., None], powers[..., -1 - power :]]
    columns: Complex = np.asarray(np.concatenate(parts, axis=-1), dtype=complex)
    unknowns, scatter, variance = _solved(columns, values, weight)
    for _ in range(turns - 1):
        below: Real = np.abs(1 + np.sum(low * unknowns[..., None, :poles], axis=-1))
        weight = 1 / (deviation * np.maximum(below, _NEAR * below.max(axis=-1, keepdims=True)))
        unknowns, scatter, variance = _solved(columns, values, weight)
    dof = values.shape[-1] - columns.shape[-1]
    return Said(unknowns[..., -1], variance, scatter / max(dof, 1), dof, unknowns[..., :poles])


def _solved(columns: Complex, values: Complex, weight: Real) -> tuple[Complex, Real, Real]:
    """Weighted least squares: the unknowns, the sum of squares that is left, and the variance of the last unknown."""
    scaled = columns * weight[..., None]
    sizes: Real = np.maximum(np.linalg.norm(scaled, axis=-2), np.finfo(float).tiny)
    q, r = (np.asarray(part, dtype=complex) for part in np.linalg.qr(scaled / sizes[..., None, :]))
    right = (q.conj().swapaxes(-1, -2) @ (values * weight)[..., None])[..., 0]
    places: NDArray[np.intp] = np.arange(r.shape[-1], dtype=np.intp)
    diagonal = r[..., places, places]
    r[..., places, places] = diagonal + np.where(np.abs(diagonal) < _SMALL, _SMALL, 0)
    unknowns: Complex = np.asarray(np.linalg.solve(r, right[..., None])[..., 0] / sizes, dtype=complex)
    whole: Real = np.sum(np.abs(values * weight) ** 2, axis=-1)
    left: Real = np.maximum(whole - np.sum(np.abs(right) ** 2, axis=-1), _SMALL**2 * whole)
    return unknowns, left, 1 / np.abs(r[..., -1, -1] * sizes[..., -1]) ** 2
