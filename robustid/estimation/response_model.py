"""Stable rational model of a response, simulated with the input of a record; and what the response leaves open of it."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from robustid.core import Complex, Real, real_rows
from robustid.data import FrequencyResponse
from robustid.estimation.pole_fit import PoleFit, fractions, slopes_of

_ORDERS = (2, 4, 6, 8, 12, 16, 20)
_A_POLE = 3  # frequency points at least
_BELOW = 3.0  # times slower than the lowest frequency: a pole that the response need not show
_GOOD = 0.1  # part of the response that a model may leave to predict anything
_STEP = 1e-6  # of the differences, in part of the distance of a pole from 1, or of its own size
_FASTEST = 0.05  # of a pole's modulus below which nothing of it is left after a sample


class Simulated(NamedTuple):
    """Answers (T, n, nu) of the functions of a model, and their derivatives by the poles, with the functions of each."""

    functions: Real
    moved: list[tuple[slice, Real]]


class Predicted(NamedTuple):
    """Prediction (T,) of an output, and its derivatives (T, n) by what the response leaves open."""

    outputs: Real
    slopes: Real


@dataclasses.dataclass(frozen=True)
class ResponseModel:
    """Poles, residues and what the response says of them."""

    fit: PoleFit
    poles: Complex  # of the fit, and last one below the lowest frequency, whose residues are zero and open
    coefficients: Real  # (n, nu, ny); real: of the functions of the poles, and of the constant
    # list of (R, q); for each output: R times the changes of the unknowns is q, plus numbers of variance 1 at most
    known: list[tuple[Real, Real]]
    misfit: float  # of the response, rms, in units of its bound

    def simulated(self, u: Real, dt: float, *, periodic: bool, slopes: bool = True) -> Simulated:
        """Answers of the functions to inputs (T, nu) held over `dt`."""
        functions = self._functions_of(u, self.poles, dt, periodic)
        if not slopes:
            return Simulated(functions, [])
        poles = self.poles[:-1]
        reach = _STEP * np.maximum(np.abs(poles if self.fit.dt is None else poles - 1), _STEP)
        pair = np.imag(poles) != 0
        first = np.cumsum(1 + pair) - 1 - pair
        moved: list[tuple[slice, Real]] = []
        for number, (k, size) in enumerate(zip(first, reach, strict=True)):
            for way in (complex(size), 1j * size)[: 1 + int(pair[number])]:
                ends = [
                    self._functions_of(u, poles[number : number + 1] + side * way, dt, periodic) for side in (1, -1)
                ]
                moved.append((slice(k, k + 1 + int(pair[number])), (ends[0] - ends[1])[:, :-1] / (2 * size)))
        return Simulated(functions, moved)

    def predicted(self, simulated: Simulated, output: int) -> Predicted:
        """Prediction of an output."""
        c, functions = self.coefficients[:, :, output], simulated.functions
        outputs = np.einsum("tnj,nj->t", functions, c)
        columns = [np.einsum("tnj,nj->t", change, c[own])[:, None] for own, change in simulated.moved]
        if not columns:
            return Predicted(outputs, np.zeros((len(outputs), 0)))
        return Predicted(outputs, np.hstack([functions.reshape(len(outputs), -1), *columns]))

    def free(self, samples: int, dt: float, faster: float = 1.0) -> Real:
        """Free responses (T, n) of the poles."""
        at, _ = self._sampled(self.poles, dt * faster)
        columns = at[None, :] ** np.arange(samples)[:, None]
        whole = np.hstack([np.real(columns), np.imag(columns[:, np.imag(at) != 0])])
        return np.hstack([whole, np.ones((samples, 1))])

    def _functions_of(self, u: Real, poles: Complex, dt: float, periodic: bool) -> Real:
        """Answers (T, n + 1, nu) of the functions of `fractions`, and of the constant."""
        import scipy.signal

        at, gain = self._sampled(poles, dt)
        parts: list[Real] = []
        spectrum = np.fft.fft(u, axis=0) if periodic else u
        z = np.exp(2j * np.pi * np.arange(len(u)) / len(u))[:, None]
        for pole, own, g in zip(poles, at, gain, strict=True):
            if periodic:
                one = np.fft.ifft(spectrum * (g / (z - own)), axis=0)
            else:
                one = g * scipy.signal.lfilter([0.0, 1.0], [1.0, -own], u, axis=0)
            parts += [np.real(one)] if pole.imag == 0 else [2 * np.real(one), -2 * np.imag(one)]
        return np.stack([*parts, u], axis=1)

    def _sampled(self, poles: Complex, dt: float) -> tuple[Complex, Complex]:
        """Poles behind a hold over `dt`, and the gains of their functions."""
        if self.fit.dt is None:
            rate = poles * self.fit.omega[-1]
            at = np.exp(rate * dt)
            still = np.abs(rate * dt) < _STEP
            gain = self.fit.omega[-1] * np.where(still, dt, (at - 1) / np.where(still, 1, rate))
            return at, np.asarray(gain, complex)
        ratio = dt / self.fit.dt
        if abs(ratio - 1) < _STEP * _STEP:
            return poles, np.ones(poles.size, complex)
        quick = (np.abs(poles) < _FASTEST) | ((np.imag(poles) == 0) & (np.real(poles) <= 0))
        safe = np.where(quick, 0.5, poles)
        at = np.where(quick, 0, np.exp(ratio * np.log(safe)))
        still = np.abs(safe - 1) < _STEP * _STEP
        gain = np.where(still, ratio, (at - 1) / np.where(still, 1, np.where(quick, poles, safe) - 1))
        return at, gain


def response_model(frf: FrequencyResponse, radius: Real) -> ResponseModel | None:
    """Model of a response whose errors have these sizes (F, ny, nu); None where no stable one of at most 20 poles is near it."""
    whole = np.all(np.isfinite(radius) & (radius > 0), axis=(1, 2)) & ~frf.missing.any(axis=(1, 2))
    if int(whole.sum()) < _A_POLE * _ORDERS[1] or not np.any(frf.values[whole]):
        return None
    part = dataclasses.replace(frf.select(whole), covariance=None, bound=None)
    fit = PoleFit(part, feedthrough=True)
    size: Real = radius[whole].swapaxes(1, 2).reshape(fit.values.shape)
    fit.weight = 1 / size
    best, places, least = np.inf, np.zeros(0, complex), 0.0
    for order in _ORDERS:
        if order * _A_POLE > part.omega.size or fit.unknowns(order) >= fit.samples:
            break
        costs, found = fit.search(order, np.zeros(1), decades=order <= _ORDERS[3])
        cost = max(float(costs[0]), np.finfo(float).tiny)
        criterion = 2 * fit.samples * float(np.log(cost / fit.samples)) + fit.unknowns(order) * float(
            np.log(2 * fit.samples)
        )
        if criterion < best:
            best, places, least = criterion, found[0], cost
    misfit = float(np.sqrt(least / fit.samples))
    left = float(np.linalg.norm(fit.residuals(places) * size))
    if misfit > 1 and left > _GOOD * float(np.linalg.norm(fit.values)):
        return None
    return _known(fit, places, len(frf.outputs), misfit)


def _known(fit: PoleFit, places: Complex, ny: int, misfit: float) -> ResponseModel:
    """Coefficients of a fit, and what the response says of changes of them, of the poles, and of a slow pole."""
    lowest = float(fit.omega[fit.omega > 0].min()) / _BELOW
    slow = -lowest / fit.omega[-1] if fit.dt is None else np.exp(-lowest * fit.dt)
    poles = np.append(places, complex(slow))
    functions = np.hstack([fractions(fit.x, poles), np.ones((fit.x.size, 1))])
    order, nu = functions.shape[1] - 2, fit.values.shape[1] // ny
    used = [k for k in range(order + 2) if k != order]
    coefficients = np.zeros((order + 2, nu, ny))
    known: list[tuple[Real, Real]] = []
    for i in range(ny):
        rows: list[Real] = []
        left: list[Real] = []
        for j in range(nu):
            weight: Real = fit.weight[:, j * ny + i] / max(misfit, 1)
            weighted = real_rows(weight[:, None] * functions)
            value = real_rows(weight * fit.values[:, j * ny + i])
            coefficients[used, j, i] = np.linalg.lstsq(weighted[:, used], value, rcond=None)[0]
            c = coefficients[:, j, i]
            ways = slopes_of(fit.x, places, c[:order])
            pair, count = np.imag(places) != 0, places.size
            # Re of each pole, followed by Im of it where it is one of a pair.
            turn = np.argsort(
                np.concatenate([np.arange(count, dtype=float), np.flatnonzero(pair) + 0.5]), kind="stable"
            )
            own = np.zeros((len(value), order + 2, nu))
            own[:, :, j] = weighted
            rows.append(np.hstack([own.reshape(len(value), -1), real_rows(weight[:, None] * ways[:, turn])]))
            left.append(value - weighted @ c)
        q, r = np.linalg.qr(np.concatenate(rows))
        known.append((r, q.T @ np.concatenate(left)))
    return ResponseModel(fit, poles, coefficients, known, misfit)
