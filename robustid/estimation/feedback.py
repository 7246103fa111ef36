"""Feedback in records: an input that answers the output before the output answers it."""

from __future__ import annotations

import numpy as np

from robustid.core import Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.innovations import filtered
from robustid.estimation.noise_in_inputs import WITHOUT_CONTROLLER, noise_in_inputs

_LAGS = 20
# Of an input that those lags don't make white, as many as a record tells: one sample in ten, and no more than are quick.
_SAMPLES_A_LAG, _MOST_LAGS = 10, 1000
_FEWEST = 400
# Parts of a record, and the mean square of their autocorrelations, from which on it isn't random: 1 for white noise, over 22 for
# sweeps of 1000 samples, 2 to 5 for the excitation of a CD player and for a multisine.
_PARTS, _COLOURED = 8, 10.0
_CERTAIN = 6.0  # standard deviations of a correlation between unrelated signals
_PART = 0.2  # of the correlation with later outputs, that of an open loop is surely less
_COPY = 1 - 1e-6
_PEAKED = 30.0  # fourth moment over squared variance, from which on a signal is a few steps or pulses
_CONTINUED = 1e-3  # what is new in an input, in part of it, below which it is its own continuation
_EXACT = 1e-4  # part of an input that the output leaves unexplained, where a controller computes it
_ORDER = 4  # of such a controller, or of a plant without noise
_ROUNDING = 1e-6  # part of an output that a plant without noise leaves, with the digits of a file
_AT_ONE = 1e-3  # distance from 1 of a zero that is there


def feedback_faults(record: TimeRecord) -> list[Fault]:
    """Inputs that depend on the outputs; of records without reference whose inputs vary at random.

    Input and output are filtered so that the input is white (its autoregression of order 20): then the input is uncorrelated with
    earlier outputs unless a controller, or an exchange of the two, ties it to them. Standard deviation 1/sqrt(T). Lines of a
    multisine stay related over more lags than 20, and so to the answer to earlier ones: the correlation has to outlast the
    longest autoregression that the record tells.
    """
    if record.reference is not None or len(record.u) < _FEWEST:
        return []
    tied: list[tuple[float, str]] = []
    outputs = [(y, y - y.mean(), one) for y, one in zip(record.y.T, record.outputs, strict=True) if np.ptp(y) > 0]
    for u, name in zip(record.u.T, record.inputs, strict=True):
        if np.ptp(u) == 0 or not outputs:
            continue
        e = (u - u.mean()) / np.ptp(u)
        past = _own_past(e)
        new = _new(e, past)
        for y, about_mean, other in outputs:
            z = about_mean / np.ptp(y)
            pair = f"input {name.name} and output {other.name}"
            if float(e @ z) > _COPY * float(np.linalg.norm(e) * np.linalg.norm(z)):
                continue  # the output is the input, in another unit
            if (left := _computed(e, z, past, new)) < _EXACT and not _simulated(u, y):
                words = (
                    f"{pair}: all but {left:.1g} of the changes of the input follow from the output: a controller computes it, and"
                    " nothing else moves it. The response would be that of -1/controller; excite the loop, and give the reference"
                )
                return [Fault(FaultKind.FEEDBACK, words, where=pair, size=left)]
            if record.held and (early := _tied(e, z)):
                tied.append((early, pair))
    if not tied:
        return noise_in_inputs(record) if record.held else []
    early, pair = max(tied)
    more = f" (and {len(tied) - 1} more pairs)" if len(tied) > 1 else ""
    words = (
        f"{pair}{more}: the input follows earlier outputs, with a correlation of {early:.2g} standard deviations: the loop is"
        f" closed, or the two are exchanged and to be given the other way round. {WITHOUT_CONTROLLER}"
    )
    return [Fault(FaultKind.FEEDBACK, words, where=pair, size=early)]


def _tied(u: Real, y: Real) -> float:
    """Correlation of the input with earlier outputs, in standard deviations; 0 where it may as well be none."""
    early = 0.0
    for lags in (_LAGS, min(max(u.size // _SAMPLES_A_LAG, _LAGS), _MOST_LAGS)):
        early, late = _correlations(u, y, lags)
        if early <= max(_CERTAIN, _PART * late):
            return 0.0
    return early


def _correlations(u: Real, y: Real, lags: int) -> tuple[float, float]:
    """Largest correlation of the input, whitened over so many lags, with earlier outputs, and with later ones, in standard
    deviations.
    """
    whitening = _autoregression(u, lags)
    e, z = (filtered(whitening, x - x.mean())[2 * lags :] for x in (u, y))
    if e.std() <= _CONTINUED * u.std() or np.mean(e**4) > _PEAKED * np.mean(e**2) ** 2 or not _white_everywhere(e):
        return 0.0, 0.0
    scale = float(np.sqrt(e.size) * e.std() * z.std())
    early = [abs(float(e[lag:] @ z[:-lag])) / scale for lag in range(1, _LAGS + 1)]
    late = [abs(float(e[:-lag] @ z[lag:])) / scale for lag in range(1, _LAGS + 1)]
    return max(early), max(late)


def _white_everywhere(e: Real) -> bool:
    """Return whether a signal is white in every part, not only on the average: a sweep is a sine in every part of it."""
    parts = e[: e.size // _PARTS * _PARTS].reshape(_PARTS, -1)
    power = np.maximum(np.sum(parts**2, axis=1), np.finfo(float).tiny)
    r = np.stack([np.sum(parts[:, lag:] * parts[:, :-lag], axis=1) / power for lag in range(1, _LAGS + 1)])
    return float(np.mean(r**2)) * parts.shape[1] < _COLOURED


def _autoregression(u: Real, lags: int) -> Real:
    """Coefficients of the whitening filter 1 - a1 z^-1 - ..., by the Yule-Walker equations."""
    import scipy.linalg

    x = u - u.mean()
    r = np.array([float(x[: x.size - lag] @ x[lag:]) for lag in range(lags + 1)])
    r[0] *= 1 + 1e-9
    return np.concatenate([[1.0], -scipy.linalg.solve_toeplitz(r[:-1], r[1:])])


def _own_past(u: Real) -> Real:
    """Columns of the input before every sample, and a constant."""
    rows = np.arange(_ORDER, u.size)
    return np.stack([u[rows - lag] for lag in range(1, _ORDER + 1)] + [np.ones(rows.size)], axis=1)


def _new(u: Real, columns: Real) -> float:
    """Power of what columns leave of the input."""
    left = u[_ORDER:] - columns @ np.linalg.lstsq(columns, u[_ORDER:], rcond=None)[0]
    return float(left @ left)


def _computed(u: Real, y: Real, past: Real, new: float) -> float:
    """Part of what is new in the input, given its own past, that present and past outputs leave unexplained."""
    rows = np.arange(_ORDER, u.size)
    outputs = np.stack([y[rows - lag] for lag in range(_ORDER + 1)], axis=1)
    outputs = outputs / max(float(np.abs(y).max()), np.finfo(float).tiny)
    # An input that is its own continuation (a few sines, a constant) has nothing new.
    return 1.0 if new <= _CONTINUED**2 * float(u @ u) else _new(u, np.concatenate([past, outputs], axis=1)) / new


def _simulated(u: Real, y: Real) -> bool:
    """Return whether an output is that of a stable plant from zero initial conditions, without noise.

    An input that a controller computes, -C y, is tied to the output as closely, through the plant -1/C: one with a negative direct
    term, or with the zero at 1 that an integrator leaves; and a record of a machine does not begin at zero.
    """
    u, y = u / np.ptp(u), y / np.ptp(y)
    for order in range(_ORDER + 1):
        columns = [np.pad(x, (lag, 0))[: u.size] for x, first in ((u, 0), (-y, 1)) for lag in range(first, order + 1)]
        A = np.stack(columns, axis=1)
        x = np.linalg.lstsq(A, y, rcond=None)[0]
        if np.linalg.norm(y - A @ x) <= _ROUNDING * np.linalg.norm(y):
            b, a = x[: order + 1], np.concatenate([[1.0], x[order + 1 :]])
            at_one = int(np.sum(np.abs(np.roots(b) - 1) < _AT_ONE))  # two of them has an acceleration
            return bool(b[0] > _ROUNDING * np.abs(b).max() and at_one != 1 and np.all(np.abs(np.roots(a)) < 1))
    return False
