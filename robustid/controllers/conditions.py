r"""Limits that a loop keeps with every consistent plant, as conditions on the controller's value at each frequency.

With the values F of the consistent plants in a disc, ``|F - c| <= r``, and X = 1 + F C, every limit keeps X out of a disc, or
in one:

.. math:: |S| \le m \Leftrightarrow |X| \ge 1/m, \qquad
          |T| \le m \Leftrightarrow \left|X + \tfrac{1}{m^2 - 1}\right| \ge \tfrac{m}{m^2 - 1} \;(m > 1), \qquad
          |C S| \le m \Leftrightarrow |X| \ge |C|/m, \qquad |P S| \le m \Leftrightarrow |1/F + C| \ge 1/m .

Each is :math:`|a + b C| \ge q |C| + w` for all F at once, exactly, or :math:`|a + b C| + q |C| \le w`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.controllers.limits import Limits
from robustid.core import Complex, Real

_ABOVE = 5e-3  # 1 that |L| is up to the bandwidth: what the proof on arcs takes
_ARC = 5  # points of the arc about -1 that a phase margin keeps clear
_LEAST = 1e-12  # of the radius of a disc: nearer to zero it holds zero


class Discs(NamedTuple):
    """Values of all consistent plants at frequencies: centres and radii, (F,)."""

    omega: Real
    centre: Complex
    radius: Real

    @property
    def typical(self) -> float:
        """Size of a controller with which the loop is about 1."""
        return 1 / float(np.median(np.abs(self.centre)))

    def at(self, which: NDArray[np.bool_]) -> Discs:
        """Some of the frequencies."""
        return Discs(self.omega[which], self.centre[which], self.radius[which])


class Conditions(NamedTuple):
    """Distance of ``a + b C`` from a convex polygon at least ``q |C| + w``, at frequencies, each (N,).

    The polygon, by its corners, is the point 0 where nothing is said. `inside`: ``|a + b C| + q |C| <= w`` instead.
    """

    name: str
    place: NDArray[np.intp]  # frequency of every one
    a: Complex
    b: Complex
    q: Real
    w: Real
    inside: bool = False
    corners: Complex = np.zeros(1, complex)

    def excess(self, values: Complex) -> Real:
        """Distance to the limit of each, with values C at all frequencies: negative where it is not kept."""
        C = values[self.place]
        X, size = self.a + self.b * C, self.q * np.abs(C)
        if self.inside:
            return self.w - np.abs(X) - size
        return _distance(X, self.corners)[0] - size - self.w

    def directions(self, values: Complex) -> Complex:
        """Unit numbers that point from the polygon to where C is."""
        return _distance(self.a + self.b * values[self.place], self.corners)[1]


def _distance(points: Complex, corners: Complex) -> tuple[Real, Complex]:
    """Distances of points from a convex polygon, negative inside, and the directions away from it."""
    ends = np.roll(corners, -1)
    along = ends - corners
    length = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
    part = np.clip(np.real((points[:, None] - corners) * along.conj()) / length, 0.0, 1.0)
    away = points[:, None] - (corners + part * along)
    sizes = np.abs(away)
    k = np.argmin(sizes, axis=1)
    rows = np.arange(points.size)
    size, direction = sizes[rows, k], away[rows, k]
    turned = np.imag((points[:, None] - corners) * along.conj())
    inner = (corners.size > 2) & (np.all(turned > 0, axis=1) | np.all(turned < 0, axis=1))
    unit = np.where(size > 0, direction / np.where(size > 0, size, 1.0), 1.0)
    return np.where(inner, -size, size), np.where(inner, -unit, unit)


def conditions_of(limits: Limits, discs: Discs) -> list[Conditions]:
    """All limits at some frequencies."""
    found: list[Conditions] = []
    every = np.ones(discs.omega.size, dtype=bool)

    def clear(name: str, which: NDArray[np.bool_], point: float, size: float) -> None:
        """X keeps a distance from a point."""
        some, place = discs.at(which), np.flatnonzero(which)
        a: Complex = np.full(place.shape, 1.0 - complex(point))
        w: Real = np.full(place.shape, float(size))
        found.append(Conditions(name, place, a, some.centre, some.radius, w))

    if limits.sensitivity_peak is not None:
        clear("sensitivity peak", every, 0.0, 1 / limits.sensitivity_peak)
    if limits.complementary_peak is not None:
        clear("complementary peak", every, *_disc_of(limits.complementary_peak))
    for low, high, value in limits.attenuation:
        clear("attenuation", (discs.omega >= low) & (discs.omega <= high), 0.0, 1 / value)
    for low, high, value in limits.roll_off:
        which = (discs.omega >= low) & (discs.omega <= high)
        if value > 1:
            clear("roll-off", which, *_disc_of(value))
        elif value < 1:  # X stays in a disc about 1/(1 - m^2)
            some, place = discs.at(which), np.flatnonzero(which)
            a = np.full(place.size, 1 - 1 / (1 - value**2), complex)
            w = np.full(place.size, value / (1 - value**2))
            found.append(Conditions("roll-off", place, a, some.centre, some.radius, w, inside=True))
    if limits.bandwidth is not None:
        place = np.flatnonzero(discs.omega <= limits.bandwidth)
        some, least = discs.at(discs.omega <= limits.bandwidth), np.full(place.size, 1 + _ABOVE)
        found.append(
            Conditions("bandwidth", place, np.zeros(place.size, complex), some.centre + 0j, some.radius, least)
        )
    for corners in _kept_clear(limits):
        place = np.arange(discs.omega.size)
        one, none = np.ones(place.size, complex), np.zeros(place.size)
        found.append(Conditions("margins", place, one, discs.centre + 0j, discs.radius, none, corners=corners))
    if limits.control_peak is not None:
        place = np.arange(discs.omega.size)
        q = discs.radius + 1 / limits.control_peak
        found.append(
            Conditions("control peak", place, np.ones(place.size, complex), discs.centre + 0j, q, np.zeros(place.size))
        )
    if limits.process_peak is not None:
        found.append(_process(limits.process_peak, discs))
    return found


def _kept_clear(limits: Limits) -> list[Complex]:
    """Convex polygons in the plane of X that a gain margin and a phase margin keep clear of, by their corners."""
    found: list[Complex] = []
    if limits.gain_margin is not None:
        found.append(np.array([0.0, 1 - 1 / limits.gain_margin], complex))
    if limits.phase_margin is not None:
        # L = -exp(j t) for |t| <= margin; corners outside the arc, so that the polygon holds it.
        t = np.linspace(-limits.phase_margin, limits.phase_margin, _ARC)
        outer = np.exp(1j * (t[:-1] + t[1:]) / 2) / np.cos((t[1] - t[0]) / 2)
        found.append(1 - np.concatenate([outer, np.exp(1j * t[[0, -1]])]))
    return found


def _disc_of(peak: float) -> tuple[float, float]:
    """Centre and radius of what X keeps clear of where |T| is at most a peak above 1."""
    return -1 / (peak**2 - 1), peak / (peak**2 - 1)


def _process(peak: float, discs: Discs) -> Conditions:
    """|P S| at most a peak: exact in the disc of 1/F, or where F may be 0 by its largest value."""
    size, radius = np.abs(discs.centre), discs.radius
    whole = size > radius * (1 + _LEAST)
    room = np.where(whole, size**2 - radius**2, 1.0)
    place = np.arange(discs.omega.size)
    a: Complex = np.where(whole, discs.centre.conj() / room, 1.0 + 0j)
    b = np.where(whole, 1.0, discs.centre)
    q = np.where(whole, 0.0, radius)
    w = np.where(whole, 1 / peak + radius / room, (size + radius) / peak)
    return Conditions("process peak", place, a, b + 0j, q, w)
