"""Verification from the numbers: what a result claims is evaluated again, along other paths than it was found."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.data import FrequencyResponse, TimeRecord
from robustid.identification.exact import Claim
from robustid.identification.model import physical_parameters
from robustid.identification.simulation import response, simulate
from robustid.interpolation import MixedProblem
from robustid.interpolation.problem import excited_lines
from robustid.interpolation.rows import initial_state
from robustid.solve import Candidate, ConvexData


@dataclasses.dataclass(frozen=True)
class Check:
    """One claim: its name, the number measured, its limit, and whether it holds."""

    name: str
    measured: float
    limit: float

    @property
    def holds(self) -> bool:
        """Whether the number is within its limit."""
        return bool(self.measured <= self.limit)


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
    """

    kind: str
    index: int
    axis: np.ndarray
    error: np.ndarray
    bound: np.ndarray

    def __post_init__(self) -> None:
        self._set(axis=freeze(self.axis), error=freeze(self.error), bound=freeze(self.bound))

    @property
    def ratio(self) -> np.ndarray:
        """|error|/bound, (N,)."""
        return np.abs(self.error) / self.bound


@dataclasses.dataclass(frozen=True)
class Verification:
    """All checks of a result, and the residuals of its model."""

    checks: tuple[Check, ...]
    residuals: tuple[Residual, ...]

    @property
    def passed(self) -> bool:
        """Whether every check holds."""
        return all(check.holds for check in self.checks)


def verify(
    problem: MixedProblem,
    data: ConvexData,
    point: Candidate,
    model: Any,
    claim: Claim,
    claimed: ConvexData,
    level: float,
) -> Verification:
    """Evaluate every claim of an identification from its numbers.

    The residuals come from the state-space model: its frequency response at the lines and its simulated response to the
    recorded inputs, not from the coefficients that were solved for. `claimed` are the data that the margin is about, `data`
    those of the model's own prior.
    """
    n = model.nstates - (0 if problem.parametric is None else problem.parametric.states)
    residuals = model_residuals(problem, model, data, point.p)
    worst = _largest(residuals)
    reached = claimed.margin(claim.x, claim.p) if claimed.sarason.norm(claim.x) <= 1 else np.inf
    checks = [
        Check("largest |residual|/bound of the model", worst, level * (1 + 1e-5)),
        Check("||X||: the non-parametric part is in the ball", data.sarason.norm(point.x), 1.0),
        Check(
            "model minus its own interpolation data, relative",
            interpolation_error(problem, data, point, model),
            1e-9,
        ),
        Check(
            "largest |pole| of the non-parametric part times rho",
            spectral_radius(model.A[:n, :n], problem),
            1.0,
        ),
        Check("margin, at the system that reaches it", reached, claim.margin * (1 + 1e-9) + 1e-12),
        Check("width of the proven interval of the margin", claim.width, claim.accuracy),
        Check(
            "certificate: stated minus recomputed",
            0.0 if claim.certificate.verify(claimed.rows, claimed.sarason) else np.inf,
            0.0,
        ),
    ]
    return Verification(tuple(checks), tuple(residuals))


def spectral_radius(A: np.ndarray, problem: MixedProblem) -> float:
    """Largest |eigenvalue| of A, times the decay rate."""
    return float(np.abs(np.linalg.eigvals(A)).max()) * problem.prior.decay_rate if A.size else 0.0


def interpolation_error(problem: MixedProblem, data: ConvexData, point: Candidate, model: Any) -> float:
    """Model against K phi x' + p'P at the nodes, and against its Taylor coefficients; relative to their size."""
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    pair, weights = data.sarason.pair, physical_parameters(data.rows, point.p)
    worst = 0.0
    if problem.angles.size:
        values = K * (pair.evaluate(np.exp(-1j * problem.angles) / rho) @ point.x)
        if problem.parametric is not None:
            values = values + problem.parametric.response(problem.angles) @ weights
        worst = _relative(response(model, problem.angles) - values, values, K)
    if problem.taylor:
        values = K * rho ** -np.arange(problem.taylor) * (pair.taylor(problem.taylor) @ point.x)
        if problem.parametric is not None:
            values = values + problem.parametric.impulse(problem.taylor) @ weights
        unit = np.eye(1, problem.taylor)[0]
        worst = max(worst, _relative(simulate(model, unit[:, None])[0][:, 0] - values, values, K))
    return worst


def _relative(error: np.ndarray, values: np.ndarray, K: float) -> float:
    size = float(np.abs(values).max())
    return float(np.abs(error).max()) / max(size, 1e-6 * K)


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
    return _largest(model_residuals(problem, model))


def _largest(residuals: list[Residual]) -> float:
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
    return Residual("frequency", index, frf.omega, error, frf.bound[:, 0, 0])


def _steady_state(record: TimeRecord, model: Any) -> np.ndarray:
    lines, samples = excited_lines(record), record.u.shape[0]
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[lines] = response(model, 2 * np.pi * lines / samples) * np.fft.rfft(record.u[:, 0])[lines]
    return np.fft.irfft(spectrum, samples)
