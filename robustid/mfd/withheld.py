"""What a fit predicts: its error at frequency points that were withheld from it."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import StateMatrices
from robustid.data import FrequencyResponse
from robustid.mfd.attempt import blocks_of, flipped, refinable, transposed
from robustid.mfd.block_model import RESOLVED, BlockModel
from robustid.mfd.refinement import refine

if TYPE_CHECKING:
    from robustid.mfd.fit import MatrixFraction

_EVERY, _FIRST = 4, 2  # every fourth frequency point is withheld
_STEPS = 10
_HELD = 1.05


def withheld_error(fit: MatrixFraction) -> float:
    """Weighted rms error at every fourth frequency point of the fit refined on the others, relative to the data there.

    nan where constraints on coefficients don't let the state space be refined, or too few points are left.
    """
    problem, model = fit.problem, fit.fraction.matrices
    unknowns = problem.order * sum(problem.values.shape[1:])
    if not refinable(problem) or unknowns > problem.equations // 2:
        return math.nan
    if flipped(problem):
        problem, model = problem.transposed(), transposed(model)
    points = np.arange(problem.omega.size)
    withheld = (points % _EVERY == _FIRST) & (points < points.size - 1)  # the last one says what the unit is
    used = np.any(problem.weight.entries, axis=(1, 2))
    if not np.any(used & withheld) or not used[-1]:
        return math.nan
    others = dataclasses.replace(
        problem,
        omega=problem.omega[~withheld],
        values=problem.values[~withheld],
        weight=problem.weight.select(~withheld),
    )
    found = refine(others, blocks_of(problem, model), stable=fit.stable, limit=_STEPS).fitted
    response = found.C @ found.model.states(problem.xi[withheld]) + found.D
    weight = problem.weight.select(withheld)
    size = float(np.linalg.norm(weight.apply(problem.values[withheld])))
    return float(np.linalg.norm(weight.apply(problem.values[withheld] - response))) / size if size > 0 else math.nan


def unresolved_poles(fit: MatrixFraction) -> int:
    """Number of poles, rigid-body modes left aside, that the refinement held where the frequency points resolve no damping."""
    problem, model = fit.problem, fit.fraction.matrices
    if fit.fraction.rigid_count:
        flexible = len(model.A) - 2 * fit.fraction.rigid_count
        model = StateMatrices(model.A[:flexible, :flexible], model.B[:flexible], model.C[:, :flexible], model.D)
    blocks = BlockModel.of(model.A / problem.scale, model.B / problem.scale, discrete=problem.dt is not None)
    poles = np.concatenate([blocks.poles[: 2 * blocks.centre.size : 2], blocks.single])
    inside = np.abs(np.imag(poles)) > 0  # a real pole is no mode
    held = inside & (blocks.distances <= _HELD * RESOLVED * blocks.spacing(problem.xi))
    sizes = np.repeat([2, 1], [blocks.centre.size, blocks.single.size])
    return int(np.sum(sizes[held]))


def outside_bound(fit: MatrixFraction, frf: FrequencyResponse) -> float:
    """Largest ratio of what the fit leaves of the data to their bound; nan where they have none."""
    if frf.bound is None:
        return math.nan
    left = np.abs(np.where(frf.missing, 0, frf.values - fit.fraction.response(frf.omega)))
    known = ~frf.missing & np.isfinite(frf.bound) & (frf.bound > 0)
    return float(np.max(left[known] / frf.bound[known], initial=0.0)) if np.any(known) else math.nan
