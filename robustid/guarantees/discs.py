"""Smallest disc around points of the plane: the nominal value that is nearest to the farthest of several plants."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.core import Complex

_OUTSIDE = 1 + 1e-12  # of a radius: what rounding may put a point of the rim outside
_ROUNDING = 1e-15  # of the extent of the points, besides
_ROUNDS = 100  # exchanges; a handful are needed


class Disc(NamedTuple):
    """A closed disc of the complex plane."""

    centre: complex
    radius: float


def smallest_disc(points: Complex) -> Disc:
    """Return the smallest disc that holds all points.

    Its rim touches two of them, at the ends of a diameter, or three whose triangle is acute; no other disc can then be smaller.
    The farthest point joins those on the rim, whose own smallest disc grows every time, until no point lies outside: finitely many
    steps. A convex polygon is inside where its corners are.

    Parameters
    ----------
    points : (N,) complex array
        One at least, finite.

    Returns
    -------
    Disc
        All points are inside: the radius is the largest distance from the centre.

    Notes
    -----
    Source: the exchange of `elzinga1972`.
    """
    points = np.unique(np.ravel(points))
    middle = complex((points.real.min() + points.real.max()) / 2, (points.imag.min() + points.imag.max()) / 2)
    shifted = points - middle  # so that rounding is relative to the extent of the points, not to where they lie
    rim = [complex(shifted[np.argmax(np.abs(shifted))])]
    found = Disc(rim[0], 0.0)
    slack = _ROUNDING * float(np.abs(shifted).max(initial=0.0))
    for _ in range(_ROUNDS):
        distance = np.abs(shifted - found.centre)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= found.radius * _OUTSIDE + slack:
            break
        found, rim = _of_few([*rim, complex(shifted[farthest])])
    centre = found.centre + middle
    return Disc(centre, float(np.abs(points - centre).max()))


def _of_few(points: list[complex]) -> tuple[Disc, list[complex]]:
    """The smallest disc of two to four points, and those on its rim that hold it."""
    count = len(points)
    pairs = [(i, j) for i in range(count) for j in range(i)]
    triples = [(i, j, k) for i, j in pairs for k in range(j)]
    best, rim = Disc(0j, np.inf), points
    for chosen in (*pairs, *triples):
        held = [points[i] for i in chosen]
        disc = _through(held)
        reach = max(abs(p - disc.centre) for p in points) if np.isfinite(disc.radius) else np.inf
        if reach <= disc.radius * (1 + 1e-10) and reach < best.radius:
            best, rim = Disc(disc.centre, reach), held
    return best, rim


def _through(points: list[complex]) -> Disc:
    """The disc with two points as diameter, or through three; of infinite radius where these are on one line."""
    if len(points) == 2:
        return Disc((points[0] + points[1]) / 2, abs(points[0] - points[1]) / 2)
    a, (b, c) = points[0], (points[1] - points[0], points[2] - points[0])
    cross = (b.conjugate() * c).imag
    if abs(cross) <= 1e-14 * abs(b) * abs(c):
        return Disc(a, np.inf)
    offset = 1j * (b * abs(c) ** 2 - c * abs(b) ** 2) / (2 * cross)
    return Disc(a + offset, abs(offset))
