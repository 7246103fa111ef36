"""Predictions at frequency points from the others: to first order by one factorisation, or by fits to the others."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Budget, Complex, Real, pass_on
from robustid.fitting.fraction.fraction_iteration import FitStatus
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.pole_distances import RESOLVED
from robustid.fitting.state_space.projected_outputs import Fitted, Outputs
from robustid.fitting.state_space.state_refinement import UNLIMITED, refine

EVERY = 4  # points, of which one is withheld
STEPS = 10
_SEEN = 1e-10  # directions that the response sees less than this are no parameters
_ALONE = 1e-12  # 1 - leverage of a point that alone decides a direction


def left_out_cost(outputs: Outputs, fitted: Fitted) -> float:
    """Criterion of the points of a frequency response, each predicted by the fit to the others: to first order
    ``(I - H_ii)^-1 r_i``, H the projection on the response's tangent space (leave-one-out, `allen1974`). A mode that one point
    alone sees decides it: H_ii has an eigenvalue near one, and the sum grows without bound, however small the criterion is.
    """
    lines = outputs.criterion.xi.size
    _, sizes, Vt = np.linalg.svd(triangle(columns := outputs.directions(fitted)), full_matrices=False)
    kept = sizes > _SEEN * sizes[:1]
    Q = _by_line(columns @ (Vt[kept].T / sizes[kept]), len(fitted.residual), lines)
    groups, size = len(fitted.residual), Q.shape[1] // len(fitted.residual)
    leverage = Q @ Q.transpose(0, 2, 1)
    for group, basis in enumerate(fitted.basis):
        own, here = _by_line(basis, 1, lines), slice(group * size, (group + 1) * size)
        leverage[:, here, here] += own @ own.transpose(0, 2, 1)
    left = (1 + _ALONE) * np.eye(groups * size) - leverage
    residual = _by_line(fitted.residual.reshape(-1, 1), groups, lines)
    return float(np.sum(np.linalg.solve(left, residual) ** 2))


def _by_line(rows: Real, groups: int, lines: int) -> Real:
    """Rows (groups, 2, lines, ...) of real and imaginary parts as (lines, groups * 2 * ..., columns)."""
    parts = rows.reshape(groups, 2, lines, -1, rows.shape[1]).transpose(2, 0, 1, 3, 4)
    return np.ascontiguousarray(parts.reshape(lines, -1, rows.shape[1]))


def withheld(problem: FractionProblem, first: int) -> np.ndarray:
    """Mask of every fourth frequency point; none of them where the remaining ones say nothing. The last point stays: it says
    what the unit of the nodes is.
    """
    points = np.arange(problem.omega.size)
    mask = (points % EVERY == first) & (points < points.size - 1)
    used = np.any(problem.weight.entries, axis=(1, 2))
    return mask & bool(np.any(used & mask) and used[-1])


def withheld_residual(
    problem: FractionProblem,
    model: BlockModel,
    mask: np.ndarray,
    *,
    stable: bool,
    resolved: float = RESOLVED,
    steps: int = STEPS,
    budget: Budget = UNLIMITED,
) -> Complex:
    """Residual (m, ny, nu), without its weight, at the withheld points of the model refined on the others. Ctrl-C is not kept
    back here: without the points a fit is of no use.
    """
    others = dataclasses.replace(
        problem, omega=problem.omega[~mask], values=problem.values[~mask], weight=problem.weight.select(~mask)
    )
    end = refine(others, model, stable=stable, limit=steps, resolved=resolved, budget=budget)
    pass_on(end.status is FitStatus.INTERRUPTED)
    found = end.fitted
    return problem.values[mask] - found.C @ found.model.states(problem.xi[mask]) - found.D


def withheld_residuals(
    problem: FractionProblem,
    model: BlockModel,
    *,
    stable: bool,
    resolved: float = RESOLVED,
    steps: int = STEPS,
    budget: Budget = UNLIMITED,
) -> Complex:
    """Residual (F, ny, nu), without its weight, at every frequency point but the last, each withheld once; 0 at the last."""
    out = np.zeros(problem.values.shape, dtype=complex)
    for first in range(EVERY):
        mask = withheld(problem, first)
        if np.any(mask):
            out[mask] = withheld_residual(
                problem, model, mask, stable=stable, resolved=resolved, steps=steps, budget=budget
            )
    return out
