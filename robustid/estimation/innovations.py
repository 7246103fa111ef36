"""Innovations of an output: what neither its own past nor the inputs predict of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real
from robustid.estimation.stretch import LONG

_ORDER = 30  # of the predictor, at most
_ROWS = 20_000  # of the regression, about
_SPARE = 5  # rows a coefficient, at least
_RIDGE = 1e-10  # of the power of a regressor
_FLOOR = 3e-5  # of the rms of the output: what ridge and rounding leave
_DEGREE = 3  # of a trend in time
LAST, _CONTINUED = 4, 3e-3  # samples; what is new in a signal, in part of it


class Predictor(NamedTuple):
    """One-step predictor ``a(q) y = b(q) u + trend + w`` of one output."""

    a: Real  # (n + 1,); with a[0] = 1
    b: Real  # (nu, n + 1)
    trend: Real  # (4,); coefficients of Legendre polynomials over the record: a constant, a drift
    noise: float  # standard deviation of w

    def innovations(self, y: Real, u: Real) -> Real:
        """Innovations (T - n,), of the samples that have a whole past."""
        return self.from_start(y, u)[self.a.size - 1 :]

    def from_start(self, y: Real, u: Real) -> Real:
        """Innovations (T,) as if everything had been 0 before the record."""
        w = filtered(self.a, y)
        for b, one in zip(self.b, u.T, strict=True):
            w -= filtered(b, one)
        return np.asarray(w - trends(len(y)) @ self.trend, dtype=float) if np.any(self.trend) else w


class Trend(NamedTuple):
    """Coefficients of Legendre polynomials over a record, (4,), their deviations for noise of variance 1, and what is left."""

    coefficients: Real
    unsure: Real
    left: Real


def filtered(b: Real, signal: Real) -> Real:
    """Signal (T,) through a filter of finite length, from rest."""
    return np.asarray(np.convolve(b, signal)[: signal.size], dtype=float)


def trends(samples: int, rows: NDArray[np.intp] | slice = slice(None)) -> Real:
    """Legendre polynomials (T, 4) over a record, at some of its samples."""
    return np.asarray(np.polynomial.legendre.legvander(np.linspace(-1, 1, samples)[rows], _DEGREE), dtype=float)


def without_trend(y: Real) -> Real:
    """Signal (T,) less its least-squares trend; of a very long one by some of its samples."""
    if y.size <= LONG:
        shapes = trends(y.size)
        return y - shapes @ np.linalg.lstsq(shapes, y, rcond=None)[0]
    rows = np.arange(0, y.size, y.size // LONG)
    found = np.linalg.lstsq(trends(y.size, rows), y[rows], rcond=None)[0]
    left, place = y.copy(), np.linspace(-1, 1, y.size)
    for first in range(0, y.size, LONG):
        part = slice(first, first + LONG)
        left[part] -= np.polynomial.legendre.legval(place[part], found)
    return left


def order_for(samples: int, inputs: int) -> int:
    """Order of the predictor of a record; 0 where it is too short for one."""
    order = min(_ORDER, (samples // _SPARE - inputs - 1 - _DEGREE) // (1 + inputs))
    return order if order >= 2 else 0


class Predictors:
    """Predictors of the outputs of one record, by least squares; the part of the inputs is prepared once."""

    def __init__(self, u: Real, order: int | None = None) -> None:
        samples, nu = u.shape
        self.order = order_for(samples, nu) if order is None else order
        self._rows: NDArray[np.intp] = np.asarray(
            np.arange(self.order, samples, max(1, samples // _ROWS)), dtype=np.intp
        )
        parts = [self._lagged(one, 0) for one in u.T] + [trends(samples, self._rows)]
        given = np.concatenate(parts, axis=1)
        self._size = _rms(given)
        self._given = given / self._size
        self._gram = self._given.T @ self._given
        self._inputs = nu * (self.order + 1)
        self.rows, self.coefficients = given.shape[0], given.shape[1] + self.order

    def _lagged(self, signal: Real, first: int) -> Real:
        """Columns signal[t - first], ..., signal[t - n] of the rows t."""
        windows = np.lib.stride_tricks.sliding_window_view(signal, self.order + 1)
        return windows[self._rows - self.order][:, ::-1][:, first:]

    def of(self, y: Real) -> Predictor:
        """Predictor of an output (T,)."""
        import scipy.linalg

        n, inputs = self.order, self._inputs
        size = float(_rms(y[:, None])[0])
        own, target = self._lagged(y, 1) / size, y[self._rows] / size
        cross = own.T @ self._given
        gram = np.block([[own.T @ own, cross], [cross.T, self._gram]])
        gram[np.diag_indices_from(gram)] += _RIDGE * len(own)
        right = np.concatenate([own.T @ target, self._given.T @ target])
        factor = scipy.linalg.cholesky(gram, lower=True, check_finite=False)
        found = scipy.linalg.cho_solve((factor, True), right, check_finite=False)
        left = target - own @ found[:n] - self._given @ found[n:]
        noise = max(float(np.sqrt(left @ left / max(left.size - len(gram), 1))), _FLOOR)
        given = found[n:] * size / self._size
        return Predictor(
            a=np.concatenate([[1.0], -found[:n]]),
            b=given[:inputs].reshape(-1, n + 1),
            trend=given[inputs:],
            noise=noise * size,
        )

    def trend_beside(self, y: Real, a: Real) -> Trend:
        """Trend of ``a(q) y`` beside the answer to the inputs: least squares of both, so that it is as unsure as their gain."""
        import scipy.linalg

        target = filtered(a, y)[self._rows]
        size = float(_rms(target[:, None])[0])
        gram = self._gram.copy()
        gram[np.diag_indices_from(gram)] += _RIDGE * self.rows
        factor = scipy.linalg.cho_factor(gram, check_finite=False)
        found = scipy.linalg.cho_solve(factor, self._given.T @ (target / size), check_finite=False)
        left = (target / size - self._given @ found) * size
        unsure = scipy.linalg.cho_solve(factor, np.eye(len(gram))[:, self._inputs :], check_finite=False)
        columns = self._size[self._inputs :]
        return Trend(
            found[self._inputs :] * size / columns,
            np.sqrt(np.diag(unsure[self._inputs :])) / columns,
            np.asarray(left, dtype=float),
        )


def gain_of_inputs(y: Real, u: Real) -> float:
    """Power of the innovations that the inputs take away, in that of one: chi-squared of nu (n + 1) where they do nothing."""
    without, given = (Predictors(one, order=order_for(*u.shape)) for one in (u[:, :0], u))
    alone, both = without.of(y).noise, given.of(y).noise
    spare = given.rows - given.coefficients
    return (alone**2 * (spare + u.shape[1] * (given.order + 1)) - both**2 * spare) / both**2


def own_continuation(signal: Real) -> bool:
    """Return whether a signal (T,) follows from its last few samples: a sine, or a part of a sweep."""
    if order_for(signal.size, 0) < LAST:
        return False
    alone = Predictors(np.zeros((signal.size, 0)), LAST)
    return alone.of(signal).noise < _CONTINUED * float(signal.std())


def _rms(columns: Real) -> Real:
    size = np.sqrt(np.mean(columns**2, axis=0))
    return np.where(size > 0, size, 1.0)
