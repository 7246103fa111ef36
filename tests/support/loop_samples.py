"""Worst cases of a loop by brute force: maps of the loop over dense points of the sets of R, and over consistent plants."""

import numpy as np

from robustid.core import StateMatrices, response_at
from robustid.guarantees.loop_values import MAPS

INSIDE = 1 + 1e-9


def border(errors, count=400):
    """Dense points on the border of the sets of one entry, (N, K): sides of polygons, circles of discs; nan outside the others."""
    part = np.linspace(0, 1, count, endpoint=False)
    corners = errors.corners
    sides = corners[:, :, None] + part * (np.roll(corners, -1, axis=1) - corners)[:, :, None]
    turn = np.exp(2j * np.pi * part)
    circles = [
        c[:, 0, 0, None] + r[:, 0, 0, None] * turn
        for c, r in ((0j * errors.bound, errors.bound), (errors.centre, errors.radius))
    ]
    points = np.concatenate([sides.reshape(len(corners), -1), *circles], axis=1)
    inside = np.abs(points) <= errors.bound[:, 0] * INSIDE
    inside &= np.abs(points - errors.centre[:, 0]) <= errors.radius[:, 0] * INSIDE
    along = np.roll(corners, -1, axis=1) - corners  # counter-clockwise
    for corner, side in zip(corners.T, along.T, strict=True):
        out = np.imag(side.conj()[:, None] * (points - corner[:, None]))
        inside &= (out >= -1e-9 * np.abs(side)[:, None] * errors.bound[:, 0]) | (np.abs(side) == 0)[:, None]
    return np.where(inside, points, np.nan)


def largest_over(around, errors, omega, dt):
    """Largest |S|, |T|, |P S| and |C S| at frequencies over the points of `border`, (F, 4), from the loop's own equation."""
    V, change = response_at(around, np.exp(1j * omega * dt)), border(errors)
    r, e, d = 0, 1, 2
    u, y, x = 0, 1, 2
    known = ~np.isnan(change)
    change = np.where(known, change, 0)
    through = change / (1 - V[:, x, e, None] * change)
    found = {
        name: V[:, a, b, None] + V[:, a, e, None] * through * V[:, x, b, None]
        for name, a, b in (("S", y, d), ("PS", y, r), ("CS", u, d))
    }
    sizes = [np.abs(one) for one in (found["S"], 1 - found["S"], found["PS"], found["CS"])]
    return np.stack([np.max(one, axis=1, where=known, initial=0.0) for one in sizes], axis=1)


def largest_of_plants(plants, controller, omega, dt):
    """Largest sizes of the four maps of a controller with any of some plants, at frequencies, (F, 4)."""
    c = response_at(StateMatrices.of(controller), np.exp(1j * omega * dt))[:, 0, 0]
    found = np.zeros((omega.size, len(MAPS)))
    for plant in plants:
        p = response_at(StateMatrices.of(plant), np.exp(1j * omega * dt))[:, 0, 0]
        S = 1 / (1 + p * c)
        found = np.maximum(found, np.abs(np.stack([S, 1 - S, p * S, c * S], axis=1)))
    return found
