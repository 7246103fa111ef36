"""Data minus model at the samples, from the state space: responses at the lines, simulations of the records."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.data import FrequencyResponse, TimeRecord
from robustid.data.ellipses import bound_ratio
from robustid.identification.simulation import response, simulate
from robustid.interpolation import MixedProblem
from robustid.interpolation.problem import excited_lines
from robustid.interpolation.rows import initial_state
from robustid.solve import ConvexData


@dataclasses.dataclass(frozen=True, eq=False)
class Residual(Frozen):
    """y - model at the samples of one experiment.

    Attributes
    ----------
    kind : {"frequency", "time"}
    index : int
        Number of the experiment among those of its kind.
    axis : (N,) array
        rad/s, or s; only samples that were used.
    error : (N,) array
        Complex for frequency samples.
    bound : (N,) array
        The bound in force (widened by an unknown past input where there is one).
    tilt : (N,) complex array or None
        Where the bounds are ellipses: |error + tilt conj(error)| <= bound.
    """

    kind: str
    index: int
    axis: np.ndarray
    error: np.ndarray
    bound: np.ndarray
    tilt: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._set(axis=freeze(self.axis), error=freeze(self.error), bound=freeze(self.bound))
        self._set(tilt=None if self.tilt is None else freeze(self.tilt))

    @property
    def ratio(self) -> np.ndarray:
        """|error|/bound, (N,), of an ellipse |error + tilt conj(error)|/bound."""
        return bound_ratio(self.error, self.bound, self.tilt)


def model_residuals(problem: MixedProblem, model: Any, data: ConvexData | None = None, p: Any = None) -> list[Residual]:
    """Residuals of any one-channel model at the samples of a problem.

    For records with unknown initial state the free response of the parametric part is that of `p`, or the one with the smallest
    largest |residual|/bound where none is given.
    """
    out = [_frequency_residual(i, f, model, problem) for i, f in enumerate(problem.frequency)]
    taken = 0 if data is None else data.rows.parameters
    for i, record in enumerate(problem.time):
        used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
        count = used[-1] + 1
        bound = record.bound[used, 0]
        if record.initial == "periodic":
            predicted = _steady_state(record, model)[used]
        else:
            predicted = simulate(model, record.u[:count])[0][used, 0]
        error = record.y[used, 0] - predicted
        columns, widen = initial_state(problem, record, used)
        bound = bound + widen
        if data is not None and p is not None:
            weights = (p / data.rows.column_scale)[taken : taken + columns.shape[1]]
            taken += columns.shape[1]
        else:
            weights = _least_largest(columns / bound[:, None], error / bound)
        error = error - columns @ weights
        out.append(Residual("time", i, record.time[used], error, bound))
    return out


def largest_ratio(problem: MixedProblem, model: Any) -> float:
    """Largest |residual|/bound of a one-channel model at the samples of a problem."""
    return largest(model_residuals(problem, model))


def largest(residuals: list[Residual]) -> float:
    """Largest |residual|/bound; NaN where one is."""
    return float(np.max([np.max(r.ratio) for r in residuals]))  # NaN stays NaN


def _least_largest(columns: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The w with the smallest max |right - columns w|: a linear program."""
    import scipy.optimize

    count = columns.shape[1]
    if not count:
        return np.zeros(0)
    ones = np.ones((right.size, 1))
    rows = np.block([[columns, -ones], [-columns, -ones]])
    free = [(None, None)] * count + [(0, None)]
    size = max(float(np.abs(right).max()), np.finfo(float).tiny)
    found = scipy.optimize.linprog(
        np.eye(1, count + 1, count)[0], rows, np.concatenate([right, -right]) / size, bounds=free
    )
    if found.x is None:
        return np.linalg.lstsq(columns, right, rcond=None)[0]
    return found.x[:count] * size


def _frequency_residual(index: int, frf: FrequencyResponse, model: Any, problem: MixedProblem) -> Residual:
    error = frf.values[:, 0, 0] - response(model, frf.omega * problem.dt)
    tilt = None if frf.tilt is None else frf.tilt[:, 0, 0]
    return Residual("frequency", index, frf.omega, error, frf.bound[:, 0, 0], tilt)


def _steady_state(record: TimeRecord, model: Any) -> np.ndarray:
    lines, samples = excited_lines(record), record.u.shape[0]
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[lines] = response(model, 2 * np.pi * lines / samples) * np.fft.rfft(record.u[:, 0])[lines]
    return np.fft.irfft(spectrum, samples)
