"""Discs around many polygons at once, and their corners from bounds in equally spaced directions."""

from __future__ import annotations

import functools
import itertools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real

_ROUNDS = 30  # exchanges; a handful are needed, and every disc holds its polygon whenever they end
_ENOUGH = 1 + 1e-10  # times the radius: what the farthest point may be outside
_ROUNDING = 1e-14  # relative, of corners and distances
_PAIRS, _TRIPLES = (np.array(list(itertools.combinations(range(4), k))).T for k in (2, 3))


def corners_of_supports(support: Real) -> Complex:
    """Points where neighbouring sides Re(exp(-j theta) v) = support meet, theta equally spaced, (N, M): their hull holds the set.

    A direction between two neighbours is a sum of theirs with positive factors, in which the set is at most as far as their corner.
    """
    count = int(support.shape[1])
    turn, support = 2 * np.pi / count, tightened(support)
    with np.errstate(invalid="ignore"):
        after: Real = support[:, np.arange(1, count + 1) % count]
        along = (after - support * np.cos(turn)) / np.sin(turn)
        turned: Complex = np.exp(1j * turn * np.arange(count))
        return turned * (support + 1j * along)


def tightened(support: Real) -> Real:
    """Bounds in equally spaced directions, (..., M), or what two on both sides of one leave it, where that is less.

    A direction is a sum of any two less than half a turn apart, one on either side of it, with positive factors: where their sides
    meet the set ends.
    """
    low, high, factors = _pairs(int(support.shape[-1]))
    if not len(factors):
        return support
    with np.errstate(invalid="ignore"):
        parts = support[..., low] * factors[:, :1], support[..., high] * factors[:, 1:]
        size = np.abs(parts[0]) + np.abs(parts[1])
        return np.fmin(support, np.fmin.reduce(parts[0] + parts[1] + _ROUNDING * size, axis=-2))


@functools.cache
def _pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Real]:
    """Numbers (P, M) of directions before and behind each, and the factors (P, 2) with which they make it."""
    turn, at = 2 * np.pi / count, np.arange(count)
    every = [(before, apart) for apart in range(2, (count + 1) // 2) for before in range(1, apart)]
    low = np.array([at - before for before, _ in every], int).reshape(-1, count) % count
    high = np.array([at + apart - before for before, apart in every], int).reshape(-1, count) % count
    factors = [np.sin(np.array([apart - before, before]) * turn) / np.sin(apart * turn) for before, apart in every]
    return low, high, np.array(factors).reshape(-1, 2)


def smallest_discs(points: Complex) -> tuple[Complex, Real]:
    """Centres and radii (N,) of the smallest discs around rows of points, infinite where one of them isn't finite.

    The exchange of `elzinga1972`, all rows together: the farthest point joins those on the rim. Radii are distances to the farthest
    points, whatever the centres are.
    """
    count = len(points)
    finite = np.asarray(np.isfinite(points).all(axis=1), dtype=bool)
    held: Complex = np.array(points, dtype=complex)
    held[~finite] = 0
    middle = (held.real.max(axis=1) + held.real.min(axis=1) + 1j * (held.imag.max(axis=1) + held.imag.min(axis=1))) / 2
    held = held - middle[:, None]
    rows = np.arange(count)
    rim: Complex = np.repeat(held[rows, np.abs(held).argmax(axis=1)][:, None], 3, axis=1)
    centre: Complex = rim[:, 0].copy()
    radius = np.zeros(count)
    for _ in range(_ROUNDS):
        away = np.abs(held[rows] - centre[rows, None])
        far = away.argmax(axis=1)
        rising = away[np.arange(rows.size), far] > radius[rows] * _ENOUGH
        rows, far = rows[rising], far[rising]
        if not rows.size:
            break
        four = np.concatenate([rim[rows], held[rows, far][:, None]], axis=1)
        rim[rows], centre[rows], larger = _of_four(four)
        stuck = larger <= radius[rows]  # rounding: no disc of these is larger, and the last one is as good
        radius[rows] = larger
        rows = rows[~stuck]
    radius = np.abs(held - centre[:, None]).max(axis=1)
    centre = np.where(finite, centre + middle, 0)
    radius += _ROUNDING * (np.abs(middle) + np.abs(held).max(axis=1, initial=0.0))
    return centre, np.where(finite, radius, np.inf)


def _of_four(points: Complex) -> tuple[Complex, Complex, Real]:
    """Rims of three, centres and radii of the smallest discs around rows of four points: through two or three of them."""
    first, second = (points[:, one] for one in _PAIRS)
    a, b, c = (points[:, one] for one in _TRIPLES)
    b, c = b - a, c - a
    cross = (b.conj() * c).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = 1j * (b * np.abs(c) ** 2 - c * np.abs(b) ** 2) / (2 * cross)
    centres = np.concatenate([(first + second) / 2, a + offset], axis=1)
    own = np.concatenate([np.abs(first - second) / 2, np.abs(offset)], axis=1)
    reach = np.abs(points[:, None, :] - centres[:, :, None]).max(axis=2)
    with np.errstate(invalid="ignore"):
        reach = np.where(reach <= own * (1 + 1e-9), reach, np.inf)
    best = reach.argmin(axis=1)
    rows = np.arange(len(points))
    members = np.concatenate([_PAIRS[[0, 1, 1]].T, _TRIPLES.T])[best]
    return points[rows[:, None], members], centres[rows, best], reach[rows, best]


def hull(points: Complex) -> Complex:
    """Corners of the convex hull of points, counterclockwise: those that turn left of the points from left to right, and back."""
    ordered = np.unique(points)
    if ordered.size < 3:
        return ordered
    sides: list[list[complex]] = []
    for every in (ordered.tolist(), ordered[::-1].tolist()):
        side: list[complex] = []
        for one in every:
            while len(side) > 1 and ((side[-1] - side[-2]).conjugate() * (one - side[-1])).imag <= 0:
                side.pop()
            side.append(one)
        sides.append(side[:-1])
    return np.array(sides[0] + sides[1], dtype=complex)
