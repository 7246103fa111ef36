"""The smallest gain bound with which data are consistent at one decay rate, and the sizes that it is measured in."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import Real, threads_for
from robustid.data import TangentialResponse
from robustid.errors import SolverError
from robustid.identification import MixedProblem
from robustid.identification.formulation import formulate
from robustid.identification.solver import analytic_center, gain_path

DIGITS = 1e-3  # relative, of the smallest gain
TAILS = (
    0.1  # accuracy that sets the number of Taylor coefficients: tails up to 1 % of a bound only make K a little larger
)
CEILINGS = (
    8.0,
    8e3,
)  # gain bounds tried, in units of the largest response in the data; above the last one is as good as none
_NEGLIGIBLE = 0.01  # a non-parametric part below this part of the smallest bound can't be told from none


def smallest_gain(
    problem: MixedProblem,
    decay_rate: float,
    whole: MixedProblem | None = None,
    ceilings: tuple[float, ...] = CEILINGS,
) -> float:
    """Smallest K, to 0.1 % from above, with which the data are consistent at one decay rate; inf where there is none.

    Gain bounds up to the `ceilings`, in units of the largest response (of a `whole` that the data are a part of), are tried.
    """
    largest, smallest = response_sizes(problem if whole is None else whole)
    for ceiling in ceilings:
        K = ceiling * largest
        trial = problem.with_prior(gain_bound=K, rate=decay_rate)
        form = formulate(trial, accuracy=TAILS)
        data, kappa = form.data, 1.0
        with threads_for(form.count):
            try:
                center = analytic_center(data, 1.0)
            except SolverError:
                continue
            for _, kappa, gap in gain_path(data, center, 1.0):
                if gap <= DIGITS * kappa or kappa * K <= _NEGLIGIBLE * smallest:
                    break
        return kappa * K if kappa * K > _NEGLIGIBLE * smallest else 0.0
    return np.inf


def response_sizes(problem: MixedProblem) -> tuple[float, float]:
    """Largest response in the data and smallest bound, both as a gain (output per input), over scaling and weight of the prior."""
    values: list[float] = []
    bounds: list[float] = []
    scales = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    for f in problem.frequency:
        values.append(float(entry_sizes(problem, f).max()))
        weights = _largest_weights(f, scales) * _weight(problem, f)
        bounds.append(float((f.bound.inner_radius / weights)[f.bound.used].min()))
    for record in problem.time:
        drive = np.linalg.norm(problem.weighting.filtered(record.u)[:, None] * scales, axis=2).max(axis=0)
        drive = np.where(drive > 0, drive, 1.0)
        values.append(float(np.where(record.bound.used, np.abs(record.y) / drive, 0.0).max()))
        bounds.append(float((record.bound.radius / drive).min()))
    return max(*values, *bounds), min(bounds)


def entry_sizes(problem: MixedProblem, f: Any) -> Real:
    """Absolute values of the measured samples of a frequency response, over scaling and weight of the prior."""
    scales = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    return (np.abs(f.values) / (_largest_weights(f, scales) * _weight(problem, f)))[f.bound.used]


def _weight(problem: MixedProblem, f: Any) -> Real:
    """The weight of the class at the points of a frequency response, (F, 1, 1)."""
    return problem.weighting.sizes(problem.plane.angles(f.omega))[:, None, None]


def _largest_weights(f: Any, scales: Real) -> Real:
    """Factor of the scaling for every sample; of one in directions, of the largest gain in them."""
    if isinstance(f, TangentialResponse):
        return np.linalg.svd(f.weights * scales, compute_uv=False).max(axis=-1)
    return scales
