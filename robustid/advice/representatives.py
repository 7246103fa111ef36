"""A part of many frequency points that stands for all: dense where modes turn the phase, a few everywhere."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.identification import MixedProblem, model_residuals

Mask = NDArray[np.bool_]

_MODE = 6.0  # points that a mode gets beside those in equal steps
_SPARE = 1.5  # times its bound: what a point that was left out may miss the model of the others by
# A point that is barely outside says something about noise; the noise of two points, of model and data, is 2 bounds.
_ADDED = 8  # points that join the others at a time


def thinned(problem: MixedProblem, most: int) -> tuple[Mask, ...]:
    """Mask of the points of every response that stand for all, about `most` together.

    Equal steps of ``t(omega) = omega/width + (6/most) sum_i phase_i(omega)/pi``, phase_i that of an all-pass with the pole of
    mode i: half the points of a resonance lie within its half-width.
    """
    sizes = np.array([f.omega.size for f in problem.frequency])
    shares = np.maximum(2, np.round(np.asarray(most * sizes / sizes.sum(), dtype=float))).astype(int)
    return tuple(
        _of_response(problem.plane.angles(f.omega), _poles(problem), int(share))
        for f, share in zip(problem.frequency, shares, strict=True)
    )


def selected(problem: MixedProblem, masks: tuple[Mask, ...]) -> MixedProblem:
    """The problem with these points of its responses."""
    parts = tuple(f.select(mask) for f, mask in zip(problem.frequency, masks, strict=True))
    return dataclasses.replace(problem, frequency=parts)


def missed(problem: MixedProblem, masks: tuple[Mask, ...], model: Any) -> tuple[Mask, ...] | None:
    """The masks and the worst points that a model of these misses by more than 1.5 bounds; None where there are none."""
    worst = [np.where(mask, 0.0, one) for mask, one in zip(masks, _ratios(problem, model), strict=True)]
    peaks = [_peaks(one) for one in worst]
    found = np.sort(np.concatenate([one[peak] for one, peak in zip(worst, peaks, strict=True)]))
    limit = found[-_ADDED:].min(initial=np.inf)
    joined = [peak & (one >= max(limit, _SPARE)) for one, peak in zip(worst, peaks, strict=True)]
    if not any(np.any(one) for one in joined):
        return None
    return tuple(mask | one for mask, one in zip(masks, joined, strict=True))


def _poles(problem: MixedProblem) -> Complex:
    basis = problem.parametric
    poles = np.zeros(0, complex) if basis is None else np.asarray(basis.poles, dtype=complex)
    found = np.unique(poles.round(12))
    return found[(np.imag(found) > 0) & (np.abs(found) < 1)]


def _of_response(angles: Real, poles: Complex, share: int) -> Mask:
    used = np.zeros(angles.size, bool)
    if angles.size <= share:
        return ~used
    width = float(np.ptp(angles)) or 1.0
    t = (angles - angles.min()) / width
    for pole in poles:
        turn, half = float(np.angle(pole)), -float(np.log(np.abs(pole)))
        t = t + _MODE / share * (0.5 + np.arctan((angles - turn) / half) / np.pi)
    order = np.argsort(t, kind="stable")
    t = t[order]
    steps = np.asarray(np.linspace(t[0], t[-1], share), dtype=float)
    used[order[np.unique(np.searchsorted(t, steps))]] = True
    return used


def _ratios(problem: MixedProblem, model: Any) -> list[Real]:
    """Largest |residual|/bound at every point of every response."""
    out = [np.zeros(f.omega.size) for f in problem.frequency]
    for residual in model_residuals(dataclasses.replace(problem, time=()), model):
        place = np.searchsorted(problem.frequency[residual.index].omega, residual.axis)
        np.maximum.at(out[residual.index], place, residual.ratio)
    return out


def _peaks(ratio: Real) -> Mask:
    """Points whose neighbours are smaller: a resonance that is missed gives one point a round, not ten."""
    padded = np.concatenate([[-np.inf], ratio, [-np.inf]])
    return (ratio >= padded[:-2]) & (ratio >= padded[2:])
