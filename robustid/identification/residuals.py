"""Data minus model at the samples, from the state space: responses at the frequency points, simulations of the records."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Numbers, Real, StateSpace, freeze, responses, simulate
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord, bound_ratio
from robustid.identification.formulation.assembly import initial_state, measured_entries
from robustid.identification.formulation.rows import Rows
from robustid.identification.problem import MixedProblem, excited_lines


@dataclasses.dataclass(frozen=True, eq=False)
class Residual(Frozen):
    """y - model at the samples of one entry (output) of one experiment, or of several that share their bounds.

    Attributes
    ----------
    kind : {"frequency", "time"}
    index : int
        Number of the experiment among those of its kind.
    axis : (N,) array
        rad/s, or s; only samples that were used.
    error : (N,) array, or (N, d) of samples that share a bound
        Complex for frequency samples.
    bound : (N,) array or (N, d)
        The bound in force (widened by an unknown past input where there is one).
    tilt : (N,) complex array or None
        Where the bounds are ellipses: |error + tilt conj(error)| <= bound.
    entry : (output, input)
        Numbers; None for an output of a record (its input), for what all entries of a column or of the matrix share, and for
        tangential samples.
    """

    kind: str
    index: int
    axis: Real
    error: Numbers
    bound: Real
    tilt: Complex | None = None
    entry: tuple[int | None, int | None] = (0, 0)

    def __post_init__(self) -> None:
        self._set(axis=freeze(self.axis), error=freeze(self.error), bound=freeze(self.bound))
        self._set(tilt=None if self.tilt is None else freeze(self.tilt))

    @property
    def ratio(self) -> Real:
        """|error|/bound, (N,), of an ellipse |error + tilt conj(error)|/bound; the norm of those that share a bound."""
        ratio = bound_ratio(self.error, self.bound, self.tilt)
        return ratio if ratio.ndim == 1 else np.linalg.norm(ratio, axis=1)


def model_residuals(
    problem: MixedProblem, model: StateSpace, rows: Rows | None = None, p: Real | None = None
) -> list[Residual]:
    """Residuals of any model at the samples of a problem, in the order of its bounds.

    For records with unknown initial state the free response of the parametric part is that of `p`, or the one with the smallest
    largest |residual|/bound where none is given.
    """
    out = [residual for i, f in enumerate(problem.frequency) for residual in _of_lines(i, f, model, problem)]
    taken = 0 if rows is None else rows.parameters
    for i, record in enumerate(problem.time):
        used = record.bound.used
        count = np.flatnonzero(used.any(axis=1))[-1] + 1
        predicted = (
            _steady_state(record, model) if record.initial == "periodic" else simulate(model, record.u[:count])[0]
        )
        for output in map(int, np.flatnonzero(used.any(axis=0))):
            samples = np.flatnonzero(used[:, output])
            error = record.y[samples, output] - predicted[samples, output]
            columns, widen = initial_state(problem, record, samples, output)
            bound = record.bound.radius[samples, output] + widen
            if rows is not None and p is not None:
                weights = (p / rows.column_scale)[taken : taken + columns.shape[1]]
                taken += columns.shape[1]
            else:
                weights = _least_largest(columns / bound[:, None], error / bound)
            error = error - columns @ weights
            out.append(Residual("time", i, record.time[samples], error, bound, entry=(output, None)))
    return out


def entry_name(problem: MixedProblem, entry: tuple[int | None, int | None]) -> str:
    """The entry of a residual in words; empty for SISO."""
    output, input = entry
    if problem.entries.single or (output is None and input is None):
        return ""
    if input is None:
        return problem.outputs[output or 0].name
    name = problem.inputs[input].name
    return f"all outputs from {name}" if output is None else f"{name} to {problem.outputs[output].name}"


def largest_ratio(problem: MixedProblem, model: StateSpace) -> float:
    """Largest |residual|/bound of a model at the samples of a problem."""
    return largest(model_residuals(problem, model))


def fit_percent(problem: MixedProblem, model: StateSpace) -> dict[str, float]:
    """Return ``100 (1 - |y - yhat|/|y - mean(y)|)`` of the worst entry or output, for each kind of experiment.

    Of frequency points the complex values in place of y, of those that are `known`; those that share their bounds, and
    combinations of signals, are left out, as are those that are constant within their bounds: around their mean there is
    nothing but errors.
    """
    found: dict[str, float] = {}
    for residual in model_residuals(problem, model):
        (row, column), error = residual.entry, residual.error
        if residual.kind == "time":
            record = problem.time[residual.index]
            used = record.bound.used[:, row or 0]
            y: Numbers = record.y[used, row or 0]
            radius = record.bound.outer_radius[used, row or 0]
        elif column is None or residual.error.ndim > 1:
            continue
        else:
            frf: FrequencyResponse = problem.frequency[residual.index]
            counted = known(frf)[:, row, column]
            y, error = frf.values[counted, row, column], error[counted[frf.bound.used[:, row, column]]]
            radius = frf.bound.outer_radius[counted, row, column]
        moved = np.abs(y - y.mean())
        if np.any(moved > radius):
            value = float(100 * (1 - np.linalg.norm(error) / np.linalg.norm(moved)))
            found[residual.kind] = min(value, found.get(residual.kind, np.inf))
    return found


def known(frf: FrequencyResponse) -> NDArray[np.bool_]:
    """The samples that have a bound, without those whose bound is above every value that is above its own, by entry.

    At lines that hardly anything excited values may be of any size.
    """
    used, size, radius = frf.bound.used, np.abs(frf.values), frf.bound.outer_radius
    most = np.max(size, axis=0, initial=0.0, where=used & (size >= radius))
    return used & ((radius <= most) | (most == 0))


def largest(residuals: list[Residual]) -> float:
    """Largest |residual|/bound; NaN where one is."""
    return float(np.max([np.max(r.ratio) for r in residuals]))  # NaN stays NaN


def _least_largest(columns: Real, right: Real) -> Real:
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
        return np.asarray(np.linalg.lstsq(columns, right, rcond=None)[0], dtype=float)
    return found.x[:count] * size


def _of_lines(
    index: int, frf: FrequencyResponse | TangentialResponse, model: StateSpace, problem: MixedProblem
) -> list[Residual]:
    """Residuals of a frequency response: by entry, by column or of the whole matrix, as its bounds are."""
    predicted = problem.plane.values_at(model, frf.omega)
    out: list[Residual] = []
    if not isinstance(frf, FrequencyResponse):
        error = frf.values - np.einsum("klrab,kab->klr", frf.weights, predicted)
        for row, column in measured_entries(frf):
            used, place = frf.bound.used[:, row, column], (slice(None), row, column)
            found = error[place][used], frf.bound.radius[place][used]
            out.append(Residual("frequency", index, frf.omega[used], *found, entry=(None, None)))
        return out
    error = frf.values - predicted
    if frf.bound.joint == "matrix":
        stacked = error.transpose(0, 2, 1).reshape(frf.omega.size, -1, 1)
        ellipsoid: Complex = frf.bound.ellipsoid
        white = np.linalg.solve(np.linalg.cholesky(ellipsoid), stacked)[..., 0]
        return [Residual("frequency", index, frf.omega, white, np.ones(white.shape), entry=(None, None))]
    if frf.bound.joint == "column":
        for column in sorted({j for _, j in measured_entries(frf)}):
            used = frf.bound.used[:, :, column].any(axis=1)
            some, bound = error[used, :, column], frf.bound.radius[used, :, column]
            some = np.where(np.isfinite(bound), some, 0)
            out.append(Residual("frequency", index, frf.omega[used], some, bound, entry=(None, column)))
        return out
    for row, column in measured_entries(frf):
        used = frf.bound.used[:, row, column]
        some, bound = error[used, row, column], frf.bound.radius[used, row, column]
        tilt = None if frf.bound.tilt is None else frf.bound.tilt[used, row, column]
        out.append(Residual("frequency", index, frf.omega[used], some, bound, tilt, (row, column)))
    return out


def _steady_state(record: TimeRecord, model: StateSpace) -> Real:
    """Outputs (T, ny)."""
    lines, samples = excited_lines(record), record.u.shape[0]
    spectrum = np.zeros((samples // 2 + 1, record.y.shape[1]), complex)
    drive = np.fft.rfft(record.u, axis=0)[lines]
    spectrum[lines] = (responses(model, 2 * np.pi * lines / samples) @ drive[:, :, None])[..., 0]
    return np.fft.irfft(spectrum, samples, axis=0)
