"""Plants of a gain of 1e-8 or 1e8, and their nu-gap by brute force in terms of singular values."""

import numpy as np
import scipy.optimize

from robustid.core import StateMatrices
from support.loop_distances import largest, values, winding_condition
from support.loops import plant_of


def root_inverses(matrices):
    """(I + P* P)^-1/2 and (I + P P*)^-1/2 from the singular values of P, whatever its gain."""
    left, sizes, right = np.linalg.svd(matrices)
    basis = np.conj(right.swapaxes(1, 2)), left
    scales = [
        np.pad(1 / np.hypot(1, sizes), ((0, 0), (0, one.shape[1] - sizes.shape[1])), constant_values=1.0)
        for one in basis
    ]
    return [(one * scale[:, None, :]) @ np.conj(one.swapaxes(1, 2)) for one, scale in zip(basis, scales, strict=True)]


def chordal_by_svd(first, second, points):
    """The formula where gains are far from 1."""
    one, two = values(first, points), values(second, points)
    return np.linalg.norm(root_inverses(two)[1] @ (one - two) @ root_inverses(one)[0], 2, axis=(1, 2))


def cosines(one, back):
    """det(I + P2* P1) of the axis times what is positive: of the product of orthonormal bases of both graphs."""
    two = np.conj(back.swapaxes(1, 2))
    graphs = [np.concatenate([half, plant @ half], axis=1) for plant in (one, two) for half in root_inverses(plant)[:1]]
    return np.linalg.det(np.conj(graphs[1].swapaxes(1, 2)) @ graphs[0])


def extreme(seed):
    """Two plants of a gain of 1e-8 or 1e8, 1x1 to 3x3, near each other or not; with feedthrough or without."""
    rng = np.random.default_rng([seed, 8])
    dt, gain = (0.0, 0.1)[seed % 2], (1e-8, 1e8)[seed // 2 % 2]
    (ny, nu), order = rng.integers(1, 4, 2), int(rng.integers(1, 9))
    A, B, C, D = plant_of(rng, order, ny, nu, dt)
    first = StateMatrices(A, B, gain * C, gain * D * (seed // 4 % 2))
    if seed // 8 % 2:
        return first, StateMatrices(*(part * (1 + 1e-2 * rng.standard_normal(part.shape)) for part in first)), dt
    A, B, C, D = plant_of(rng, order, ny, nu, dt)
    return first, StateMatrices(A, B, gain * C, gain * D), dt


def highest(first, second, dt):
    """The largest value of the formula over the axis, refined; in continuous time over 20 decades and at infinity."""
    poles = np.concatenate([np.linalg.eigvals(system.A) for system in (first, second)])
    if dt:
        return largest(lambda at: chordal_by_svd(first, second, at), dt, np.angle(poles))
    near = np.log10(np.maximum(np.abs(np.concatenate([poles, poles.imag])), 1e-6))
    marks = np.unique(np.concatenate([[-300.0], np.linspace(-6, 14, 3001), near]))  # the first is 0
    found = chordal_by_svd(first, second, 1j * 10**marks)
    ends = [one._replace(A=np.zeros((0, 0)), B=one.B[:0], C=one.C[:, :0]) for one in (first, second)]
    best = max(found.max(), chordal_by_svd(*ends, np.ones(1))[0])
    for k in np.argsort(found)[::-1][:6]:
        peak = scipy.optimize.minimize_scalar(
            lambda x: -chordal_by_svd(first, second, np.array([1j * 10**x]))[0],
            bounds=(marks[max(k - 1, 0)], marks[min(k + 1, len(marks) - 1)]),
            method="bounded",
            options={"xatol": 1e-11},
        )
        best = max(best, -peak.fun)
    return best


def gap_by_svd(first, second, dt):
    """The nu-gap by brute force; 1 where the sine is, whatever rounding leaves of the winding number."""
    found = highest(first, second, dt)
    return found if found >= 1 - 1e-9 or winding_condition(first, second, dt, determinant=cosines) else 1.0
