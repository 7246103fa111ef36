"""Verification from the numbers: what a result claims is evaluated again, along other paths than it was found."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

from robustid.core import Model, Numbers, StateMatrices, simulate
from robustid.data import tilted
from robustid.errors import Status
from robustid.identification.certificate import MarginCertificate
from robustid.identification.formulation.base import Formulation
from robustid.identification.formulation.convex import Candidate, ConvexData
from robustid.identification.model import Nominal, parametric_values, physical_parameters, residue_matrices
from robustid.identification.problem import MixedProblem
from robustid.identification.residuals import Residual, largest, model_residuals

_ROUNDING = 1e-11  # of the values of the modes: that of values next to a pole of damping 1e-5


@dataclasses.dataclass(frozen=True, eq=False)
class Claim:
    """The margin as it is claimed: reached by the point (x, p), proved from below by the certificate, to an accuracy.

    Where the time ended before the accuracy that was asked for, `stopped` says so, and `accuracy` is what was reached.
    """

    margin: float
    accuracy: float
    x: NDArray[np.float64]
    p: NDArray[np.float64]
    certificate: MarginCertificate
    solver: str
    stopped: str = ""

    @property
    def width(self) -> float:
        """Width of the proven interval, relative where the margin exceeds 1; infinite where its ends are the wrong way round."""
        difference = self.margin - self.certificate.value
        return difference / max(1.0, self.margin) if difference >= 0 else np.inf

    @property
    def decided(self) -> bool:
        """Say whether the interval decides, however wide it is: it does not contain a margin at most 1 and one above."""
        return bool(np.isfinite(self.width) and (self.margin <= 1 or self.certificate.value > 1))

    @property
    def status(self) -> Status:
        """The finding that the interval means."""
        if self.margin <= 1:
            return Status.CONSISTENT
        if self.certificate.value > 1:
            return Status.INCONSISTENT
        return Status.UNDECIDED if self.width <= self.accuracy else Status.FAILED


class About(enum.Enum):
    """Subject of a check: the answer about the data, which the margin and its proof are, or the model beside it."""

    DATA = "data"
    MODEL = "model"


@dataclasses.dataclass(frozen=True)
class Check:
    """One claim: its name, the number measured, its limit, and what it is about."""

    name: str
    measured: float
    limit: float
    about: About = About.MODEL

    @property
    def holds(self) -> bool:
        """Say whether the number is within its limit."""
        return bool(self.measured <= self.limit)


@dataclasses.dataclass(frozen=True)
class Verification:
    """All checks of a result, and the residuals of its model."""

    checks: tuple[Check, ...]
    residuals: tuple[Residual, ...]

    @property
    def passed(self) -> bool:
        """Say whether every check holds."""
        return not self.failed

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that don't hold."""
        return tuple(check for check in self.checks if not check.holds)

    @property
    def answered(self) -> bool:
        """Say whether the answer about the data is verified, even where the model is not."""
        return all(check.about is About.MODEL for check in self.failed)


def verify(
    formulation: Formulation, point: Candidate, nominal: Nominal, claim: Claim, claimed: ConvexData, level: float
) -> Verification:
    """Evaluate every claim of an identification from its numbers; `claimed` are the data that the margin is about, `formulation`
    that of the model's own prior.
    """
    # The residuals come from the state-space model: its frequency response and its simulated response to the recorded inputs,
    # not from the coefficients that were solved for.
    problem, data, model = formulation.problem, formulation.data, nominal.model
    residuals = model_residuals(problem, model, data.rows, point.p)
    worst = largest(residuals)
    reached = claimed.margin(claim.x, claim.p) if claimed.sarason.norm(claim.x) <= 1 else np.inf
    checks = [
        Check("largest |residual|/bound of the model", worst, level * (1 + 1e-5)),
        Check(data.sarason.inside, data.sarason.norm(point.x), 1.0),
        *_interval_checks(problem, data, point),
        *_model_checks(formulation, point, nominal),
        Check("margin, at the system that reaches it", reached, claim.margin * (1 + 1e-9) + 1e-12, About.DATA),
        Check("width of the proven interval of the margin", claim.width, claim.accuracy, About.DATA),
        Check(
            "certificate: stated minus recomputed",
            0.0 if claim.certificate.verify(claimed.rows, claimed.sarason) else np.inf,
            0.0,
            About.DATA,
        ),
    ]
    return Verification(tuple(checks), tuple(residuals))


def _interval_checks(problem: MixedProblem, data: ConvexData, point: Candidate) -> list[Check]:
    """Check that the parameters of the model are in their intervals."""
    if problem.parameter_bounds is None:
        return []
    low, high = problem.unknown_bounds.T
    p = physical_parameters(data.rows, point.p)
    return [
        Check("largest distance of a parameter from its interval", max(0.0, float(np.max([low - p, p - high]))), 0.0)
    ]


def _model_checks(formulation: Formulation, point: Candidate, nominal: Nominal) -> list[Check]:
    """Properties that the state space must share with the interpolant that it stands for."""
    problem, model, n = formulation.problem, nominal.model, nominal.states
    A = problem.plane.in_z(StateMatrices.of(model)).A[:n, :n]
    poles = np.linalg.eigvals(A).astype(complex) if n else np.zeros(0, complex)
    if not formulation.exact:
        return [
            Check(
                "model minus the central interpolant, beyond the rounding of the modes, relative to K",
                truncation_error(formulation, point, model),
                nominal.error / problem.prior.gain_bound + 1e-9,
            ),
            Check(
                "model minus the values of the coefficients at the frequency points, beyond tails and rounding, relative to K",
                point_error(formulation, point, model),
                nominal.error / problem.prior.gain_bound + 1e-9,
            ),
            Check("largest |pole| of the non-parametric part", float(np.abs(poles).max(initial=0.0)), 1.0),
        ]
    return [
        Check("model minus its own interpolation data, relative", interpolation_error(formulation, point, model), 1e-9),
        Check(problem.region.depth_name, problem.region.depth(poles), 1.0),
    ]


def truncation_error(formulation: Formulation, point: Candidate, model: Model) -> float:
    """Largest |model - interpolant|/K on a grid of frequencies, the interpolant by its own evaluation, with all states.

    Over the largest weight, where the class has one. What rounding makes of the modes, which may exceed K many times, is left out.
    """
    problem = formulation.problem
    K, scales = problem.prior.gain_bound, _scales(problem)
    count = 257
    angles = np.pi * (np.arange(count) + 0.5) / count
    values = np.zeros((count, *scales.shape))  # of the central interpolant of coefficients that are zero
    if point.x.any():
        values = formulation.family(point.x).evaluate(problem.region.points(angles)).reshape(values.shape)
    values = problem.weighting.times(values, angles)
    modes = parametric_values(problem, formulation.rows, point.p, angles) / scales
    error = problem.plane.values(model, angles) / scales - modes - K * values
    size = float(problem.weighting.sizes(angles).max())
    excess = np.linalg.norm(error, 2, axis=(1, 2)) - _ROUNDING * np.linalg.norm(modes, 2, axis=(1, 2))
    return float(excess.max(initial=0.0)) / (K * size)


def _scales(problem: MixedProblem) -> NDArray[np.float64]:
    return problem.prior.scales(*problem.entries.shape)


def point_error(formulation: Formulation, point: Candidate, model: Model) -> float:
    """Largest (|model - E x - P p| - tail)/K at the frequency samples, beyond the rounding of P p; 0 where there are none.

    In units of the smallest response that a sample feels as its whole bound; over the largest weight there.
    """
    problem, rows = formulation.problem, formulation.rows
    if not rows.discs:
        return 0.0
    found = [r for r in model_residuals(problem, model) if r.kind == "frequency"]
    from_model = np.concatenate([part for r in found for part in _parts(r)])
    modes = rows.P @ point.p
    difference = rows.y - rows.E @ point.x - modes
    difference[: rows.discs] -= from_model
    difference[rows.discs :] = modes[rows.discs :] = 0
    angles = problem.plane.angles(np.concatenate([r.axis for r in found]))
    limit = formulation.response_tail(angles) / problem.weighting.sizes(angles).max()
    tail = rows.tail[: limit.size]
    apart = rows.sizes(difference) - _ROUNDING * rows.sizes(modes)
    excess = (apart[: limit.size] - tail) * limit / tail
    return float(excess.max(initial=0.0)) / problem.prior.gain_bound


def _parts(residual: Residual) -> list[Numbers]:
    """Residuals in units of their bounds, in the order of the rows: of samples that share bounds entry by entry."""
    if residual.error.ndim == 1:
        return [tilted(residual.error, residual.tilt) / residual.bound]
    pairs = zip(residual.error.T, residual.bound.T, strict=True)
    return [(error / bound)[np.isfinite(bound)] for error, bound in pairs]


def interpolation_error(formulation: Formulation, point: Candidate, model: Model) -> float:
    """Model against K phi x' + p'P at the nodes, and against its Taylor coefficients; relative to their size."""
    problem, data = formulation.problem, formulation.data
    K, region = problem.prior.gain_bound, problem.region
    rows, pair, scales, worst = data.rows, data.sarason.pair, _scales(problem), 0.0
    x = K * problem.entries.expand(point.x) * scales[..., None]
    if problem.angles.size:
        values = np.moveaxis(x @ pair.evaluate(region.points(problem.angles)).T, 2, 0)
        values = problem.weighting.times(values, problem.angles)
        values = values + parametric_values(problem, rows, point.p, problem.angles)
        worst = _relative(problem.plane.values(model, problem.angles) - values, values, scales, K)
    if problem.taylor:
        rho = problem.prior.decay_rate
        values = np.moveaxis(x @ (rho ** -np.arange(problem.taylor)[:, None] * pair.taylor(problem.taylor)).T, 2, 0)
        values = problem.weighting.filtered(values.reshape(problem.taylor, -1)).reshape(values.shape)
        if problem.parametric is not None:
            residues = residue_matrices(problem, rows, point.p)
            values = values + np.tensordot(problem.parametric.impulse(problem.taylor), residues, 1)
        unit = np.eye(1, problem.taylor)[0]
        pulses = [simulate(model, unit[:, None] * one)[0] for one in np.eye(scales.shape[1])]
        worst = max(worst, _relative(np.stack(pulses, axis=2) - values, values, scales, K))
    return worst


def _relative(error: Numbers, values: Numbers, scales: NDArray[np.float64], K: float) -> float:
    size = float(np.abs(values / scales).max())
    return float(np.abs(error / scales).max()) / max(size, 1e-6 * K)
