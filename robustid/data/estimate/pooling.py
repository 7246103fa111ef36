"""From covariances to bounds that hold for all spectral lines and entries at once; pooling over neighbouring ones."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robustid.data.error_sets import joint_radius, variances

_POOLED = 10  # degrees of freedom below which neighbouring lines are pooled, up to this number
_NEAR = 0.1  # neighbours lie within this part of the frequency, or
_NEAR_LINES = 16  # within so many lines of the transform


class Estimate(NamedTuple):
    """Result of a method from the records, before any bound."""

    index: np.ndarray  # (F,) spectral line of the transform
    step: float  # distance of the lines of the transform, rad/s
    values: np.ndarray  # (F, ny, nu)
    covariance: np.ndarray  # (F, ny nu, ny nu) of the values
    dof: float
    coherence: np.ndarray | None  # (F, ny)
    rounding: np.ndarray  # (F, ny, nu) floor of the bound
    source: str  # what the scatter was taken over
    noise: np.ndarray | None = None  # (F, ny, nu) standard deviations
    distortion: np.ndarray | None = None
    real: np.ndarray | None = None  # (F,) lines at which everything is real


def pool(estimate: Estimate) -> tuple[Estimate, np.ndarray]:
    """Covariances averaged over neighbouring spectral lines where few residuals would leave them hardly known; own variances too.

    Relative to the response, and absolute, whichever is larger: what a distortion in front of the dynamics does is smooth
    relative to the response, noise behind them in absolute terms.
    """
    lines = estimate.index.size
    own = variances(estimate.covariance, estimate.values.shape)
    count = min(lines, math.ceil(_POOLED / estimate.dof))
    if count == 1:
        return estimate, own
    index = estimate.index.astype(float)
    first = np.clip(np.arange(lines) - count // 2, 0, lines - count)
    neighbours = first[:, None] + np.arange(count)
    near = np.abs(index[neighbours] - index[:, None]) <= np.maximum(_NEAR * index[:, None], _NEAR_LINES)
    share = near / near.sum(axis=1, keepdims=True)
    size = np.abs(estimate.values.transpose(0, 2, 1).reshape(lines, -1))
    size = np.where(size > 0, size, 1)
    relative = estimate.covariance / (size[:, :, None] * size[:, None, :])
    relative = np.einsum("fn,fnij->fij", share, relative[neighbours]) * (size[:, :, None] * size[:, None, :])
    absolute = np.einsum("fn,fnij->fij", share, estimate.covariance[neighbours])
    scales = [np.sqrt(np.maximum(np.einsum("fii->fi", c).real, 0)) for c in (relative, absolute)]
    grow = np.maximum(scales[1], scales[0]) / np.where(scales[0] > 0, scales[0], 1)
    covariance = np.where(
        (scales[0].min(axis=1) > 0)[:, None, None], relative * grow[:, :, None] * grow[:, None, :], absolute
    )
    least = int(near.sum(axis=1).min())
    if least == 1:
        return estimate, own
    source = f"{estimate.source}, pooled over {count} neighbouring spectral lines"
    return estimate._replace(covariance=covariance, dof=estimate.dof * least, source=source), own


def bound(estimate: Estimate, probability: float) -> tuple[Estimate, np.ndarray]:
    """The estimate with its covariance pooled where that helps, and the bound that holds everywhere at once."""
    pooled, own = pool(estimate)
    radius = joint_radius(probability, estimate.values.size, pooled.dof, pooled.real)
    spread = np.sqrt(np.maximum(variances(pooled.covariance, pooled.values.shape), own))
    return pooled, np.maximum(radius * spread, estimate.rounding)
