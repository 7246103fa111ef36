"""Bounds of what finitely many coefficients leave out of a function of the ball, and how small that must be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem, excited_lines

SHARE = 0.1  # of the accuracy that is left to the tails


def taylor_tail(prior: Prior, length: int) -> float:
    """Largest singular value on the unit circle of what a member of the ball has beyond its first L Taylor coefficients.

    tau_L = K rho^-L (2/pi) K(1/rho), K(k) the complete elliptic integral of modulus k: Cauchy's formula on |z| = rho.
    """
    import scipy.special

    rho = prior.decay_rate
    return prior.gain_bound * rho ** -float(length) * 2 / np.pi * float(scipy.special.ellipk(rho**-2))


def smallest_bound(problem: MixedProblem) -> float:
    """Largest error of a function of the ball, at every frequency, that no sample feels as more than its bound."""
    _, bounds, everywhere = demands(problem)
    least = min(everywhere, float(bounds.min(initial=np.inf)))
    return least if np.isfinite(least) else problem.prior.gain_bound


def demands(problem: MixedProblem) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Size, in the largest singular value over scaling and weight of the prior, above which a function makes some sample feel
    more than its bound. At the angles (F,) of the frequency points, those excited by periodic records included: (F,); and on
    the whole circle, for the other records: infinity where there are none.
    """
    scales, weighting = problem.prior.scales(*problem.entries.shape), problem.weighting
    angles = [problem.plane.angles(frf.omega) for frf in problem.frequency]
    bounds, everywhere = [_felt(frf, scales) for frf in problem.frequency], np.inf
    bounds = [bound / weighting.sizes(at) for at, bound in zip(angles, bounds, strict=True)]
    for record in problem.time:
        if record.initial == "periodic":
            lines, samples = excited_lines(record), record.u.shape[0]
            # The response is at most the l1 norm of the spectrum times the largest value on its lines.
            least = _least(
                record,
                lambda u, n=samples: 2 * np.linalg.norm(np.fft.rfft(u, axis=0), axis=1).sum() / n,
                scales,
                record.u,
            )
            angles.append(2 * np.pi * lines / samples)
            bounds.append(np.full(lines.size, least if lines.size else np.inf) / weighting.sizes(angles[-1]))
        else:
            # sum over the past of |u| rho^-j <= max|u| / (1 - 1/rho).
            reach = 1 - 1 / problem.prior.decay_rate
            inside = weighting.filtered(record.u)
            least = _least(record, lambda u, reach=reach: np.linalg.norm(u, axis=1).max() / reach, scales, inside)
            everywhere = min(everywhere, least)
    return np.concatenate([np.zeros(0), *angles]), np.concatenate([np.zeros(0), *bounds]), everywhere


def _felt(frf: FrequencyResponse | TangentialResponse, scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """Size that a function must not exceed at the points of a frequency response, (F,)."""
    if not isinstance(frf, FrequencyResponse):
        nuclear = np.linalg.svd(frf.weights * scales, compute_uv=False).sum(axis=-1)
        return (frf.bound.radius / np.maximum(nuclear, np.finfo(float).tiny)).min(axis=(1, 2))
    if frf.bound.joint == "matrix":
        whiten = frf.bound.whitening * scales.T.ravel()
        return 1 / (np.linalg.norm(whiten, 2, axis=(1, 2)) * np.sqrt(min(scales.shape)))
    return (frf.bound.inner_radius / scales).min(axis=(1, 2))


def _least(
    record: TimeRecord,
    drive: Callable[[NDArray[np.float64]], float],
    scales: NDArray[np.float64],
    inputs: NDArray[np.float64],
) -> float:
    """Smallest bound over drive of the outputs of a record, from its inputs as functions of the ball see them."""
    least = np.inf
    for bound, row in zip(record.bound.radius.T, scales, strict=True):
        size = float(drive(inputs * row))
        if size > 0:
            least = min(least, float(bound.min()) / size)
    return least
