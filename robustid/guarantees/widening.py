"""Data whose bounds make room for what a finite expansion of the plant leaves out."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Real
from robustid.data import Bound, FrequencyResponse, TangentialResponse, TimeRecord, stacked
from robustid.identification import MixedProblem

Points = FrequencyResponse | TangentialResponse

# Samples whose bound would grow by more than this factor are left out: they say next to nothing.
_DISTANT = 3.0
_WIDER = 1 + 1e-9  # for the rounding of a whitening


def widened_points(points: Points, extra: Real) -> Points | None:
    """Frequency points that hold of every plant whose entries are within `extra` (F, ny, nu) of one that keeps these.

    What says next to nothing then is left out; None where nothing is left.
    """
    if isinstance(points, TangentialResponse):
        extra = _through(points.weights, extra)
    bound = points.bound
    if bound.joint == "entry" or bound.radius[0].size == 1:
        tilt = 0.0 if bound.tilt is None else np.abs(bound.tilt)  # an ellipse's rows are weighted by up to 1 + |tilt|
        extra = extra * (1 + tilt)
        near = (extra <= _DISTANT * bound.radius) & bound.used
        radius = np.where(near, bound.radius + extra, np.inf)
        kept = near.any(axis=(1, 2))
        return points.select(kept).with_bound(radius[kept]) if kept.any() else None
    growth = _growth(bound, extra)
    near = growth <= _DISTANT
    kept = (near & bound.used).any(axis=(1, 2))
    if not kept.any():
        return None
    growth, near, there = growth[kept], near[kept], bound.select(kept)
    if there.ellipsoid is not None:
        wider = dataclasses.replace(there, radius=None, ellipsoid=(1 + growth) ** 2 * there.ellipsoid)
    else:
        wider = dataclasses.replace(there, radius=np.where(near, (1 + growth) * there.radius, np.inf))
    return points.select(kept).with_bound(wider)


def widened_record(record: TimeRecord, distance: Real) -> TimeRecord:
    """A record that holds of every plant whose impulse response is within `distance` (T, ny, nu) of one that keeps it."""
    inputs, count = np.abs(record.u).T, len(distance)
    extra = [
        sum(np.convolve(u, h)[:count] for u, h in zip(inputs, row, strict=True)) for row in distance.transpose(1, 2, 0)
    ]
    return record.with_bound(record.bound.radius + np.stack(extra, axis=1))


def bounds_at(problem: MixedProblem, omega: Real) -> Real:
    """The bound that the samples beside a frequency give to every entry, (F, ny, nu); inf where none sees it.

    Straight between frequency points; of records alone their smallest, over the largest input.
    """
    found = np.full((omega.size, *problem.entries.shape), np.inf)
    for points in problem.frequency:
        bounds = bounds_of_entries(points, points.bound.inner_radius)
        for entry in np.ndindex(*problem.entries.shape):
            own = bounds[:, *entry]
            seen = np.isfinite(own)
            if seen.any():
                place = slice(None), *entry
                found[place] = np.minimum(found[place], np.interp(omega, points.omega[seen], own[seen]))
    for record in () if problem.frequency else problem.time:
        drive = np.maximum(np.abs(record.u).max(axis=0), np.finfo(float).tiny)
        found = np.minimum(found, record.bound.radius.min(axis=0)[:, None] / drive)
    return found


def bounds_of_entries(points: Points, radius: Real) -> Real:
    """Bound that those of frequency points leave to every entry alone at best, (F, ny, nu); inf where it isn't seen."""
    if not isinstance(points, TangentialResponse):
        return radius
    weights = np.abs(points.weights)
    each = np.divide(radius[..., None, None], weights, out=np.full(weights.shape, np.inf), where=weights > 0)
    return each.min(axis=(1, 2))


def _through(weights: np.ndarray, extra: Real) -> Real:
    """Largest |sum(weights * e)|, (F, l, r), over |e| <= extra; an infinite one counts where it has a weight."""
    size, each = np.abs(weights), extra[:, None, None]
    return np.multiply(size, each, out=np.zeros(size.shape), where=size > 0).sum(axis=(3, 4))


def _growth(bound: Bound, extra: Real) -> Real:
    """Largest size of errors |e| <= extra (F, ny, nu) in a joint bound: (F, 1, nu) for columns, (F, 1, 1) for the matrix."""
    enough = np.minimum(extra, 100 * bound.radius)  # as large as this, it is too large
    relative = np.divide(enough, bound.radius, out=np.zeros(extra.shape), where=bound.used)
    if bound.ellipsoid is None:
        return np.linalg.norm(relative, axis=1, keepdims=True) * _WIDER
    white = np.abs(bound.whitening) @ stacked(relative * bound.radius)[..., None]
    return np.linalg.norm(white, axis=1, keepdims=True) * _WIDER
