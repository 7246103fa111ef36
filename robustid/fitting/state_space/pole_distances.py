"""Distances of poles from the stability boundary, and how near to it the frequency points let them come."""

from __future__ import annotations

import numpy as np

from robustid.core import Complex, Real

# A step takes a pole at most this part of its way to the stability boundary.
_KEPT = 0.1
# A mode whose damping is below this part of the spacing of the frequency points is one that they don't resolve.
RESOLVED = 0.02
SEVERAL = 0.5  # of the spacing: a mode of such damping is seen by several points
EDGE = 1e-8  # nearer to the stability boundary (in the unit of the nodes) no pole goes


def least_distances(here: Real, spacing: Real, resolved: float) -> Real:
    """Least distance of poles from the stability boundary after a step: a part of the way, and what the data resolve."""
    floor = np.minimum(resolved * spacing, here)
    return np.maximum.reduce([_KEPT * here, floor, np.full(here.size, EDGE)])


def line_spacing(xi: Complex, poles: Complex, discrete: bool) -> Real:
    """Distance between the frequency points where the poles are; beyond the last, that from it."""
    gap = np.abs(np.gradient(xi)) if xi.size > 1 else np.ones(1)
    frequency = np.abs(np.angle(poles)) if discrete else np.abs(np.imag(poles))
    last = np.max(np.abs(np.angle(xi)) if discrete else np.abs(np.imag(xi)))
    return np.maximum(gap[np.abs(xi[:, None] - poles).argmin(axis=0)], frequency - last)


def distance(centre: Real, product: Real, discrete: bool) -> Real:
    """Distance of the poles ``centre ± sqrt(-product)`` from the stability boundary."""
    swing = np.sqrt(np.maximum(-product, 0.0))
    if not discrete:
        return -(centre + swing)
    return 1 - np.where(product > 0, np.hypot(centre, np.sqrt(np.maximum(product, 0.0))), np.abs(centre) + swing)
