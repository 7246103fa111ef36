"""A matrix-fraction fit with what follows from it, computed once: responses, uncertainty, modes, and the claims checked again."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Signal, StateMatrices, Unfinished, as_kind, as_signals, counted, points_of, response_at
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import FitCovariance, FitStatus, MatrixFraction, ModeRow, OrderSweep, fit_covariance, mode_table
from robustid.identification import Check

if TYPE_CHECKING:
    import control

# The realisation reproduces the fraction to 1e-8 at the worst point of noisy 4 x 4 data of order 40.
_SAME_MODEL = 1e-8
_CONDITION = 1e-8
_COUNTS = 0.05  # of the largest entry of an output, by which an entry varies that counts
_WORK = 3e10  # products of equations and squared coefficients: some seconds


@dataclasses.dataclass(frozen=True, eq=False)
class FitView:
    """Fit in the orientation of its data, with what follows from it; the data, which must be those that were fitted, give the
    names of the signals (else y1, u1, ...) and the noise, a sweep over the order what frequency points that were withheld say.
    """

    fit: MatrixFraction
    data: FrequencyResponse | None = None
    sweep: OrderSweep | None = None

    def __post_init__(self) -> None:
        as_kind("fit", self.fit, MatrixFraction, "a MatrixFraction")
        if self.sweep is not None:
            as_kind("order_sweep", self.sweep, OrderSweep, "an OrderSweep from suggest_order")
        if self.data is None:
            return
        as_kind("data", self.data, FrequencyResponse, "a FrequencyResponse")
        # A fit knows zeros where entries are missing.
        measured = np.where(self.data.missing, 0, self.data.values)
        same = np.array_equal(self.data.omega, self.omega) and np.array_equal(measured, self.values)
        if not same:
            raise InputError(
                f"`data` must be the response that was fitted, {counted(self.omega.size, 'frequency point')} of"
                f" {counted(self.ny, 'output')} and"
                f" {counted(self.nu, 'input')}; got other numbers, {self.data.values.shape}"
            )

    def _oriented(self, array: np.ndarray) -> np.ndarray:
        return self.fit.fraction.oriented(array)

    @property
    def omega(self) -> np.ndarray:
        """Frequency points, rad/s."""
        return self.fit.problem.omega

    @property
    def unfinished(self) -> Unfinished | None:
        """Orders that Ctrl-C left out of the sweep that the order comes from, whether it is at hand or the fit keeps it."""
        return self.fit.unfinished if self.sweep is None else self.sweep.unfinished

    @property
    def dt(self) -> float | None:
        """Sample time of the model, s; None for continuous time."""
        return self.fit.fraction.dt

    @property
    def values(self) -> np.ndarray:
        """Data (F, ny, nu)."""
        return self._oriented(self.fit.problem.values)

    @property
    def used(self) -> np.ndarray:
        """Samples that have a weight, (F, ny, nu) bool."""
        return self._oriented(self.fit.problem.weight.entries > 0)

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return self.values.shape[1]

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return self.values.shape[2]

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Names and units."""
        return as_signals("outputs", None if self.data is None else self.data.outputs, self.ny, "y")

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """Names and units."""
        return as_signals("inputs", None if self.data is None else self.data.inputs, self.nu, "u")

    def entry(self, output: int, input: int) -> str:
        """Name of an entry, "displacement [mm] / force [N]"."""
        return f"{self.outputs[output]} / {self.inputs[input]}"

    @property
    def noise(self) -> np.ndarray | None:
        """Standard deviation of the data (F, ny, nu), where they have a covariance."""
        if self.data is None or self.data.covariance is None:
            return None
        variance = np.real(np.diagonal(self.data.covariance, axis1=1, axis2=2))
        return np.sqrt(variance).reshape(-1, self.nu, self.ny).transpose(0, 2, 1)

    @cached_property
    def model(self) -> control.StateSpace:
        """The `control.StateSpace` that leaves the library."""
        return self.fit.model

    def response(self, omega: np.ndarray) -> np.ndarray:
        """The model's own response (F, ny, nu), from A, B, C, D."""
        return response_at(StateMatrices.of(self.model), points_of(omega, self.dt))

    @cached_property
    def fitted(self) -> np.ndarray:
        """The model's response at the frequency points."""
        return self.response(self.omega)

    @property
    def too_many(self) -> bool:
        """True for shared poles with so many residues, tied by constraints or weights, that their covariance would take long."""
        problem = self.fit.problem
        tied = self.fit.fraction.form == "shared" and not problem.entries_apart
        coefficients = problem.order * sum(problem.values.shape[1:])
        return tied and problem.equations * coefficients**2 > _WORK

    @cached_property
    def covariance(self) -> FitCovariance | None:
        """Uncertainty from what the fit leaves; None where it is no optimum, leaves nothing but rounding, or has `too_many`."""
        if self.fit.status not in (FitStatus.STATIONARY, FitStatus.FLAT) or self.too_many:
            return None
        try:
            return fit_covariance(self.fit)
        except InputError:  # as many coefficients as equations
            return None

    @cached_property
    def modes(self) -> tuple[ModeRow, ...]:
        """Modes of the model, with their standard deviations where there are any."""
        return mode_table(self.fit, self.covariance)

    @cached_property
    def fit_percent(self) -> float:
        """``100 (1 - |P_o - P|/|P_o - mean(P_o)|)`` of the worst entry, over the samples that have a weight; NaN without any.

        Entries that vary by less than a twentieth of the largest of their output say nothing of a fit.
        """
        left, size = self._left
        counts = (size > 0) & (size >= _COUNTS * size.max(axis=1, keepdims=True))
        return float(np.min(100 * (1 - left[counts] / size[counts]))) if np.any(counts) else np.nan

    @cached_property
    def output_fit_percent(self) -> float:
        """The same of the worst output, all its entries together: one that is all but 0 says nothing of a fit."""
        left, size = (np.linalg.norm(part, axis=1) for part in self._left)
        return float(np.min(100 * (1 - left[size > 0] / size[size > 0]), initial=np.inf)) if np.any(size) else np.nan

    @property
    def withheld_percent(self) -> float:
        """Fit at frequency points that were withheld, ``100 (1 - error)`` with the error of the sweep; NaN where none were."""
        if self.sweep is None:
            return np.nan
        judged = self.sweep.withheld[self.sweep.orders == len(self.fit.fraction.A)]
        return float(100 * (1 - judged[0])) if judged.size else np.nan

    @cached_property
    def _left(self) -> tuple[np.ndarray, np.ndarray]:
        """Norms of what the fit leaves and of the data less their mean, of every entry, (ny, nu)."""
        count = np.maximum(self.used.sum(axis=0), 1)
        data = np.where(self.used, self.values, 0)
        mean = np.where(self.used, data.sum(axis=0) / count, 0)
        left = np.where(self.used, self.values - self.fitted, 0)
        return np.linalg.norm(left, axis=0), np.linalg.norm(data - mean, axis=0)

    @property
    def equations(self) -> int:
        """Number of real equations."""
        return self.fit.problem.equations

    @property
    def checks(self) -> tuple[Check, ...]:
        """Claims of the fit, each with what is measured of it."""
        return tuple(dataclasses.replace(check, name=f"{claim}: {check.name}") for claim, check in self.claims)

    @cached_property
    def claims(self) -> tuple[tuple[str, Check], ...]:
        """Claims of the fit, evaluated again from the state-space model: each with the check of a number."""
        fit = self.fit
        problem = fit.problem
        size = float(np.linalg.norm(problem.weight.apply(problem.values))) or 1.0
        cost = float(np.linalg.norm(problem.residual(fit.fraction.fitted(self.fitted))))
        rigid = sum(row.count for row in self.modes if row.rigid)
        outside = sum(row.count for row in self.modes if not row.rigid and self._outside(row.pole))
        difference = abs(cost - np.sqrt(fit.cost)) / size
        out = [
            (
                "the state-space model has the cost of the fraction",
                Check("difference of their roots, part of the weighted data", difference, _SAME_MODEL),
            ),
            ("stable", Check("number of poles outside the stability region, the rigid body left aside", outside, 0)),
        ]
        if fit.fraction.rigid_count:
            missing = abs(2 * fit.fraction.rigid_count - rigid)
            out.append(("rigid body", Check("states that are missing in exact chains of two integrators", missing, 0)))
        if fit.condition_numbers.size:
            excess = float(np.max(fit.condition_numbers)) - 1
            out.append(("well-conditioned", Check("largest κ − 1 of a normal matrix", excess, _CONDITION)))
        return tuple(out)

    def _outside(self, pole: complex) -> bool:
        return bool(np.real(pole) >= 0 if self.dt is None else abs(pole) >= 1)
