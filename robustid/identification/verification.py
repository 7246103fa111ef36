"""Verification from the numbers: what a result claims is evaluated again, along other paths than it was found."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import responses, simulate
from robustid.data import tilted
from robustid.identification.forms import Claim, Posed
from robustid.identification.formulation.functions import line_tails
from robustid.identification.model import Nominal, family_of, parametric_values, physical_parameters, residue_matrices
from robustid.identification.problem import MixedProblem
from robustid.identification.residuals import Residual, largest, model_residuals
from robustid.identification.solver.conic import Candidate, ConvexData


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
    posed: Posed, point: Candidate, nominal: Nominal, claim: Claim, claimed: ConvexData, level: float
) -> Verification:
    """Evaluate every claim of an identification from its numbers.

    The residuals come from the state-space model: its frequency response at the lines and its simulated response to the
    recorded inputs, not from the coefficients that were solved for. `claimed` are the data that the margin is about, `posed`
    those of the model's own prior.
    """
    problem, data, model = posed.problem, posed.data, nominal.model
    residuals = model_residuals(problem, model, data, point.p)
    worst = largest(residuals)
    reached = claimed.margin(claim.x, claim.p) if claimed.sarason.norm(claim.x) <= 1 else np.inf
    checks = [
        Check("largest |residual|/bound of the model", worst, level * (1 + 1e-5)),
        Check("||X||: the non-parametric part is in the ball", data.sarason.norm(point.x), 1.0),
        *_interval_checks(problem, data, point),
        *_model_checks(posed, point, nominal),
        Check("margin, at the system that reaches it", reached, claim.margin * (1 + 1e-9) + 1e-12),
        Check("width of the proven interval of the margin", claim.width, claim.accuracy),
        Check(
            "certificate: stated minus recomputed",
            0.0 if claim.certificate.verify(claimed.rows, claimed.sarason) else np.inf,
            0.0,
        ),
    ]
    return Verification(tuple(checks), tuple(residuals))


def _interval_checks(problem: MixedProblem, data: ConvexData, point: Candidate) -> list[Check]:
    """Whether the parameters of the model are in their intervals."""
    if problem.parameter_bounds is None:
        return []
    low, high = problem.unknown_bounds.T
    p = physical_parameters(data.rows, point.p)
    return [
        Check("largest distance of a parameter from its interval", max(0.0, float(np.max([low - p, p - high]))), 0.0)
    ]


def _model_checks(posed: Posed, point: Candidate, nominal: Nominal) -> list[Check]:
    """What the state space must have in common with the interpolant that it stands for."""
    problem, model, n = posed.problem, nominal.model, nominal.states
    if posed.sections is not None:
        return [
            Check(
                "model minus the central interpolant, relative to K",
                truncation_error(posed, point, model),
                nominal.error / problem.prior.gain_bound + 1e-9,
            ),
            Check(
                "model minus the values of the coefficients at the lines, beyond the tails, relative to K",
                line_error(posed, point, model),
                nominal.error / problem.prior.gain_bound + 1e-9,
            ),
            Check("largest |pole| of the non-parametric part", spectral_radius(model.A[:n, :n]), 1.0),
        ]
    return [
        Check(
            "model minus its own interpolation data, relative",
            interpolation_error(problem, posed.data, point, model),
            1e-9,
        ),
        Check(
            "largest |pole| of the non-parametric part times rho",
            spectral_radius(model.A[:n, :n]) * problem.prior.decay_rate,
            1.0,
        ),
    ]


def truncation_error(posed: Posed, point: Candidate, model: Any, count: int = 257) -> float:
    """Largest |model - interpolant|/K on a grid of frequencies, the interpolant by its own evaluation, with all states."""
    problem = posed.problem
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    angles, scales = np.pi * (np.arange(count) + 0.5) / count, _scales(problem)
    values = family_of(posed, point.x).evaluate(np.exp(-1j * angles) / rho).reshape(count, *scales.shape)
    error = (responses(model, angles) - parametric_values(problem, posed.data.rows, point.p, angles)) / scales
    return float(np.linalg.norm(error - K * values, 2, axis=(1, 2)).max()) / K


def _scales(problem: MixedProblem) -> np.ndarray:
    return problem.prior.scales(problem.entries.outputs, problem.entries.inputs)


def line_error(posed: Posed, point: Candidate, model: Any) -> float:
    """Largest (|model - E x - P p| - tail)/K at the frequency samples; 0 where there are none.

    In units of the smallest response that a sample feels as its whole bound.
    """
    problem, rows = posed.problem, posed.data.rows
    if not rows.discs or posed.sections is None:
        return 0.0
    found = [r for r in model_residuals(problem, model) if r.kind == "frequency"]
    from_model = np.concatenate([part for r in found for part in _parts(r)])
    difference = rows.y - rows.E @ point.x - rows.P @ point.p
    difference[: rows.discs] -= from_model
    difference[rows.discs :] = 0
    limit = np.concatenate([line_tails(problem, posed.sections, r.axis * problem.dt) for r in found])
    tail = rows.tail[: limit.size]
    excess = (rows.sizes(difference)[: limit.size] - tail) * limit / tail
    return float(excess.max(initial=0.0)) / problem.prior.gain_bound


def _parts(residual: Residual) -> list[np.ndarray]:
    """The residuals in units of their bounds, in the order of the rows: of samples that share bounds entry by entry."""
    if residual.error.ndim == 1:
        return [tilted(residual.error, residual.tilt) / residual.bound]
    pairs = zip(residual.error.T, residual.bound.T, strict=True)
    return [(error / bound)[np.isfinite(bound)] for error, bound in pairs]


def spectral_radius(A: np.ndarray) -> float:
    """Largest |eigenvalue| of A."""
    return float(np.abs(np.linalg.eigvals(A)).max()) if A.size else 0.0


def interpolation_error(problem: MixedProblem, data: ConvexData, point: Candidate, model: Any) -> float:
    """Model against K phi x' + p'P at the nodes, and against its Taylor coefficients; relative to their size."""
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    rows, pair, scales, worst = data.rows, data.sarason.pair, _scales(problem), 0.0
    x = K * problem.entries.expand(point.x) * scales[..., None]
    if problem.angles.size:
        values = np.moveaxis(x @ pair.evaluate(np.exp(-1j * problem.angles) / rho).T, 2, 0)
        values = values + parametric_values(problem, rows, point.p, problem.angles)
        worst = _relative(responses(model, problem.angles) - values, values, scales, K)
    if problem.taylor:
        values = np.moveaxis(x @ (rho ** -np.arange(problem.taylor)[:, None] * pair.taylor(problem.taylor)).T, 2, 0)
        if problem.parametric is not None:
            residues = residue_matrices(problem, rows, point.p)
            values = values + np.tensordot(problem.parametric.impulse(problem.taylor), residues, 1)
        unit = np.eye(1, problem.taylor)[0]
        pulses = [simulate(model, unit[:, None] * one)[0] for one in np.eye(scales.shape[1])]
        worst = max(worst, _relative(np.stack(pulses, axis=2) - values, values, scales, K))
    return worst


def _relative(error: np.ndarray, values: np.ndarray, scales: np.ndarray, K: float) -> float:
    size = float(np.abs(values / scales).max())
    return float(np.abs(error / scales).max()) / max(size, 1e-6 * K)
