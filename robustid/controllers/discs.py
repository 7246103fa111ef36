"""Values of all consistent plants at frequencies, as discs, polygons and quotients of matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, norms

_SHORT = 1e-12  # of the longest edge of a polygon: shorter ones are none

Indices = NDArray[np.intp]


class Discs(NamedTuple):
    """Values of all consistent plants at frequencies: centres (F, ny, nu), radii (F,) and units of the inputs (F, nu).

    All of them are ``centre + Delta diag(units)`` with a largest singular value of Delta of at most the radius; where several
    matrices `adds` are given for one row, with entries of at most the radius. Of one input and one output they are within
    `around` of the hull of ``centre + corners``, too: that of 0 alone where nothing else is known; or, where `outside`, at least
    the radius away from the centre, and perhaps infinite. `plant` is one of them.

    Of matrices they are quotients, ``(V + E)^-1 (V centre + G)`` with V = `under`, and what is unknown adds to
    ``V + E + (V centre + G) C`` at most the sum of the norms of ``adds C + shifts``; where `outside` is true of a matrix this
    alone is known, and the centre is that of the plant.
    """

    omega: Real
    centre: Complex
    radius: Real
    units: Real
    corners: Complex  # (F, V)
    around: Real  # (F,)
    outside: NDArray[np.bool_]  # (F,)
    plant: Complex
    under: Complex  # (F, ny, ny)
    adds: Complex  # (F, k, nu, nu)
    shifts: Complex  # (F, k, nu, ny)

    @classmethod
    def of(cls, omega: Real, centre: Complex, radius: Real, units: Real, *, entries: bool = False) -> Discs:
        """Discs alone; of one row those of its entries."""
        F, ny, nu = centre.shape
        sizes: Complex = np.asarray((radius[:, None] * units)[:, :, None] * np.eye(nu), dtype=complex)
        adds = sizes[:, :, None, :] * np.eye(nu)[:, :, None] if entries else sizes[:, None]
        return cls(
            omega,
            centre,
            radius,
            units,
            np.zeros((F, 1), complex),
            radius,
            np.zeros(F, dtype=bool),
            centre,
            np.tile(np.eye(ny, dtype=complex), (F, 1, 1)),
            adds,
            np.zeros((F, adds.shape[1], nu, ny), complex),
        )

    @classmethod
    def together(cls, parts: Sequence[Discs]) -> Discs:
        """Sets of several plants, one after the other."""
        most, terms = (max(getattr(one, name).shape[1] for one in parts) for name in ("corners", "adds"))
        rows: list[Discs] = []
        for one in parts:
            more = (0, 0), (0, terms - one.adds.shape[1]), (0, 0), (0, 0)
            corners = np.pad(one.corners, ((0, 0), (0, most - one.corners.shape[1])), mode="edge")
            rows.append(one._replace(corners=corners, adds=np.pad(one.adds, more), shifts=np.pad(one.shifts, more)))
        return cls(*(np.concatenate(one) for one in zip(*rows, strict=True)))

    @property
    def shape(self) -> tuple[int, int]:
        """Outputs and inputs."""
        return self.centre.shape[1], self.centre.shape[2]

    @property
    def typical(self) -> float:
        """Size of a controller with which the loop is about 1."""
        return 1 / float(np.median(norms(self.plant)))

    @property
    def columns(self) -> Real:
        """Bound of the norm of every column, (F, nu); where `outside` that of one plant."""
        known = np.where(self.outside, 0.0, self.radius)
        return np.asarray(np.linalg.norm(self.plant, axis=1), dtype=float) + known[:, None] * self.units

    @property
    def largest(self) -> Real:
        """Bound of the largest singular value, (F,)."""
        added = self.radius * (np.linalg.norm(self.units, axis=1) if self.by_entries else self.units.max(axis=1))
        return np.where(self.outside, np.inf, norms(self.centre) + added)

    @property
    def by_entries(self) -> bool:
        """True of one row whose entries are bounded each by itself."""
        return self.adds.shape[1] > 1

    @property
    def quotients(self) -> tuple[Real, Real]:
        """Bounds of the norms of both parts of the quotients, (F,) each: of what is under them, and of what is above."""
        under, above = norms(self.under), norms(self.under @ self.centre)
        for k in range(self.adds.shape[1]):
            under, above = under + norms(self.shifts[:, k]), above + norms(self.adds[:, k])
        return under, above

    @property
    def known_corners(self) -> Complex:
        """Corners about the centres of polygons that are narrower than the discs, (F, V or 0); nan elsewhere."""
        known = self.corners[:, : 0 if self.corners.shape[1] == 1 else None]
        return np.where(self.around[:, None] > 0, np.nan, known)

    @property
    def least(self) -> Real:
        """Least size of the values of one output, (F,): negative where they may be 0, by how much."""
        if self.shape[1] > 1:
            sizes = np.abs(self.centre[:, 0])
            if not self.by_entries:
                return norms(self.centre) - self.radius * self.units.max(axis=1)
            left: Real = sizes - self.radius[:, None] * self.units
            size: Real = np.asarray(np.linalg.norm(np.maximum(left, 0.0), axis=1), dtype=float)
            return np.where((left > 0).any(axis=1), size, left.max(axis=1))
        within = distance_from(-self.centre[:, 0, 0], self.corners)[0] - self.around * self.units[:, 0]
        return np.where(self.outside, self.radius * self.units[:, 0] - np.abs(self.centre[:, 0, 0]), within)

    def at(self, which: NDArray[np.bool_] | Indices) -> Discs:
        """Some of the frequencies."""
        parts: list[Any] = [one[which] for one in self]
        return Discs(*parts)


def sums_of(one: Complex, other: Complex) -> Complex:
    """Corners of all sums of points of two convex polygons (1 or N, V) and (N, W), (N, V + W): edges of both by their angles."""
    edges: list[Complex] = []
    for corners in (one, other):
        following = np.roll(corners, -1, axis=1)
        turning = np.sign(np.sum((corners.conj() * following).imag, axis=1, keepdims=True))
        edges.append(np.where(turning < 0, -1, 1) * (following - corners))
    starts = [
        np.take_along_axis(corners, np.lexsort((corners.real, corners.imag), axis=1)[:, :1], axis=1)
        for corners in (one, other)
    ]
    every = np.concatenate([np.broadcast_to(edge, (len(other), edge.shape[1])) for edge in edges], axis=1)
    order = np.argsort(np.angle(every) % (2 * np.pi), axis=1)
    along = np.cumsum(np.take_along_axis(every, order, axis=1), axis=1)
    return starts[0] + starts[1] + np.concatenate([np.zeros((len(other), 1)), along[:, :-1]], axis=1)


def distance_from(points: Complex, corners: Complex) -> tuple[Real, Complex]:
    """Distances of points from convex polygons, negative inside, and the directions away from them."""
    ends = np.roll(corners, -1, axis=1)
    along = ends - corners
    length = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
    part = np.clip(np.real((points[:, None] - corners) * along.conj()) / length, 0.0, 1.0)
    away = points[:, None] - (corners + part * along)
    sizes = np.abs(away)
    k = np.argmin(sizes, axis=1)
    rows = np.arange(points.size)
    size, direction = sizes[rows, k], away[rows, k]
    turned = np.imag((points[:, None] - corners) * along.conj())
    point = length <= _SHORT**2 * length.max(axis=1, keepdims=True)  # edges that have no direction
    sides = [np.all(point | (sign * turned > 0), axis=1) for sign in (1, -1)]
    inner = (corners.shape[1] > 2) & (length.max(axis=1) > np.finfo(float).tiny) & (sides[0] | sides[1])
    unit = np.where(size > 0, direction / np.where(size > 0, size, 1.0), 1.0)
    return np.where(inner, -size, size), np.where(inner, -unit, unit)
