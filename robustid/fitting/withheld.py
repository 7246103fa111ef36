"""Predictions of a fit: its error at frequency points that were withheld from it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import StateMatrices
from robustid.data import FrequencyResponse
from robustid.fitting.modal.modal_fit import modal_withheld_residual
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.descent import blocks_of, flipped, refinable
from robustid.fitting.state_space.left_out import withheld, withheld_residual
from robustid.fitting.state_space.pole_distances import RESOLVED, SEVERAL

if TYPE_CHECKING:
    from robustid.fitting.fit import MatrixFraction

_FIRST = 2  # of the points that are withheld
_HELD, _ON = 1.05, 1e-3


def withheld_error(fit: MatrixFraction) -> float:
    """Weighted rms error at every fourth frequency point of the fit refined on the others, relative to the data there.

    nan where constraints on coefficients don't let the state space be refined, or too few points are left.
    """
    problem, model = fit.problem, fit.fraction.matrices
    unknowns = problem.order * sum(problem.values.shape[1:])
    if not refinable(problem) or unknowns > problem.equations // 2:
        return math.nan
    tied = fit.modal if fit.modal is not None and fit.modal.tied else None
    if flipped(problem) and not (tied is not None and tied.symmetric):
        problem, model = problem.transposed(), model.transposed()
    mask = withheld(problem, _FIRST)
    size = float(np.linalg.norm(problem.weight.select(mask).apply(problem.values[mask])))
    if not size > 0:
        return math.nan
    if tied is None:
        residual = withheld_residual(problem, blocks_of(problem, model), mask, stable=fit.stable)
    else:
        residual = modal_withheld_residual(problem, model, tied, mask, stable=fit.stable)
    return float(np.linalg.norm(problem.weight.select(mask).apply(residual))) / size


def unresolved_poles(fit: MatrixFraction) -> int:
    """Number of poles, rigid-body modes left aside, that the refinement held where the frequency points resolve no damping."""
    problem, model = fit.problem, fit.fraction.matrices
    if fit.fraction.rigid_count:
        flexible = len(model.A) - 2 * fit.fraction.rigid_count
        model = StateMatrices(model.A[:flexible, :flexible], model.B[:flexible], model.C[:, :flexible], model.D)
    blocks = BlockModel.of(model.A / problem.scale, model.B / problem.scale, discrete=problem.dt is not None)
    poles = np.concatenate([blocks.poles[: 2 * blocks.centre.size : 2], blocks.single])
    inside = np.abs(np.imag(poles)) > 0  # a real pole is no mode
    part = blocks.distances / blocks.spacing(problem.xi)
    # On the limit of wide modes a pole lies exactly, but for the rounding of the fraction, or by a rare chance.
    held = inside & ((part <= _HELD * RESOLVED) | (np.abs(part / SEVERAL - 1) <= _ON))
    sizes = np.repeat([2, 1], [blocks.centre.size, blocks.single.size])
    return int(np.sum(sizes[held]))


def outside_bound(fit: MatrixFraction, frf: FrequencyResponse) -> float:
    """Largest ratio of what the fit leaves of the data to their bound; nan where they have none."""
    if frf.bound is None:
        return math.nan
    left = np.abs(np.where(frf.missing, 0, frf.values - fit.fraction.response(frf.omega)))
    known = ~frf.missing & np.isfinite(frf.bound) & (frf.bound > 0)
    return float(np.max(left[known] / frf.bound[known], initial=0.0)) if np.any(known) else math.nan
