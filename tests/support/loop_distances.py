"""Distances of plants in a loop by brute force: the formulas on a grid, the winding number by the phase of a determinant."""

import numpy as np
import scipy.optimize

from robustid.core import input_states


def values(system, points):
    """Response by one factorisation a point."""
    A, B, C, D = system
    return D + C @ input_states(A, B, points) if len(A) else np.repeat(D[None].astype(complex), len(points), axis=0)


def star(matrices):
    return np.conj(np.swapaxes(matrices, 1, 2))


def root_inverse(matrices):
    """Inverse square roots of Hermitian matrices."""
    levels, basis = np.linalg.eigh(matrices)
    return (basis / np.sqrt(levels)[:, None, :]) @ star(basis)


def chordal(first, second, points):
    """sigma_max((I + P2 P2*)^-1/2 (P1 - P2)(I + P1* P1)^-1/2)."""
    one, two = values(first, points), values(second, points)
    left = root_inverse(np.eye(one.shape[1]) + two @ star(two))
    right = root_inverse(np.eye(one.shape[2]) + star(one) @ one)
    return np.linalg.norm(left @ (one - two) @ right, 2, axis=(1, 2))


def angles_of_graphs(first, second, points):
    """The same as the largest sine of an angle between the graphs of both: good to rounding also where a pole is near."""
    one, two = values(first, points), values(second, points)
    inputs = np.broadcast_to(np.eye(one.shape[2]), (len(points), one.shape[2], one.shape[2]))
    graph = np.linalg.qr(np.concatenate([inputs, one], axis=1))[0]
    other = np.linalg.qr(np.concatenate([inputs, two], axis=1), mode="complete")[0][:, :, one.shape[2] :]
    return np.linalg.norm(star(other) @ graph, 2, axis=(1, 2))


def margin_gain(plant, controller, points):
    """sigma_max([P; I](I + C P)^-1 [C I])."""
    p, c = values(plant, points), values(controller, points)
    one = np.eye(p.shape[2])
    lower = np.linalg.solve(one + c @ p, np.concatenate([c, np.tile(one, (len(p), 1, 1))], axis=2))
    return np.linalg.norm(np.concatenate([p @ lower, lower], axis=1), 2, axis=(1, 2))


def largest(function, dt, marks, count=3000):
    """Largest value on the axis or circle, refined; `marks`: frequencies near which it may be."""
    marks = np.abs(np.asarray(marks, dtype=float))
    if dt:
        angles = np.concatenate([np.linspace(0, np.pi, count), np.abs(np.angle(np.exp(1j * marks)))])
    else:  # s = j tan(angle/2)
        angles = np.concatenate([np.linspace(0, np.pi * (1 - 1e-9), count), 2 * np.arctan(marks)])
    angles = np.unique(np.clip(angles + 1e-8, 1e-8, np.pi * (1 - 1e-9)))  # not on a pole

    def at(angle):
        return function(np.exp(1j * angle) if dt else 1j * np.tan(angle / 2))

    found = at(angles)
    best = found.max()
    for k in np.argsort(found)[::-1][:6]:
        low, high = angles[max(k - 1, 0)], angles[min(k + 1, len(angles) - 1)]
        peak = scipy.optimize.minimize_scalar(
            lambda a: -at(np.array([a]))[0], bounds=(low, high), method="bounded", options={"xatol": 1e-13}
        )
        best = max(best, -peak.fun)
    return best


def plain_determinant(one, back):
    """det(I + P2~ P1)."""
    return np.linalg.det(np.eye(one.shape[2]) + back @ one)


def winding_condition(first, second, dt, offset=0.0, determinant=plain_determinant):
    """wno det(I + P2~ P1) + unstable poles of P1 - poles of P2 that aren't stable is zero, by the phase of the determinant.

    The contour runs right of the axis (outside of the circle) by `offset`, with poles on the axis to its left.
    """
    poles = [np.linalg.eigvals(system.A) for system in (first, second)]
    right = [np.log(np.abs(some)) if dt else some.real for some in poles]
    unstable = int(np.sum(right[0] > offset)), int(np.sum(right[1] > -offset))

    def phases(angles):
        points = np.exp(offset + 1j * angles) if dt else offset + 1j * np.tan(angles / 2)
        one, two = values(first, points), values(second, 1 / points if dt else -points)
        return np.angle(determinant(one, two.swapaxes(1, 2)))

    # Around a pole near the axis the phase turns within its distance: a grid that gets closer and closer to all of them.
    near = np.concatenate(poles)
    near = np.angle(near) if dt else 2 * np.arctan(near.imag)
    steps = np.concatenate([[0.0], np.geomspace(1e-9, 1, 100)])
    angles = np.concatenate(
        [
            np.linspace(-np.pi, np.pi, 1001),
            *(sign * one + way * steps for one in near for sign in (1, -1) for way in (1, -1)),
        ]
    )
    angles = np.unique(angles[np.abs(angles) <= np.pi]) if dt else np.unique(angles[np.abs(angles) < np.pi])
    found = phases(angles)
    while True:
        turns = np.diff(found, append=found[0])
        turns = (turns + np.pi) % (2 * np.pi) - np.pi
        coarse = np.flatnonzero(np.abs(turns[:-1]) > 0.5)
        if not coarse.size:
            return -round(turns.sum() / (2 * np.pi)) + unstable[0] - unstable[1] == 0
        between = (angles[coarse] + angles[coarse + 1]) / 2
        angles, found = np.insert(angles, coarse + 1, between), np.insert(found, coarse + 1, phases(between))


def gap(first, second, dt, offset=0.0):
    """The nu-gap by brute force."""
    if not winding_condition(first, second, dt, offset):
        return 1.0
    marks = np.concatenate([np.linalg.eigvals(system.A) for system in (first, second)])
    marks = np.angle(marks) if dt else np.concatenate([np.abs(marks), np.abs(marks.imag)])
    return largest(lambda points: angles_of_graphs(first, second, points), dt, marks)
