r"""Limits that a loop keeps with every consistent plant, as conditions on the controller's value at each frequency.

With the values F of the consistent plants in a disc, ``|F - c| <= r``, or in the hull of corners v, and X = 1 + F C, every limit
keeps X out of a disc, or in one:

.. math:: |S| \le m \Leftrightarrow |X| \ge 1/m, \qquad
          |T| \le m \Leftrightarrow \left|X + \tfrac{1}{m^2 - 1}\right| \ge \tfrac{m}{m^2 - 1} \;(m > 1), \qquad
          |C S| \le m \Leftrightarrow |X| \ge |C|/m, \qquad |P S| \le m \Leftrightarrow |1/F + C| \ge 1/m, \qquad
          |T| \ge m \Leftrightarrow \left|X - \tfrac{1}{1 - m^2}\right| \ge \tfrac{m}{1 - m^2} \;(m < 1) .

Each is :math:`|a + b C| \ge |q C| + w` for all F at once, exactly, or :math:`|a + b C| + |q C| \le w`. Of a hull the distance from
a + b C is that of the polygon of all :math:`a + (b + v) C`: two convex sets are apart by w where one direction parts them so far,

.. math:: \operatorname{Re} \bar\varphi (a + (b + v) C) \ge |q C| + w \quad \text{at every corner } v,

which is exact, too; |P S| is bounded in the disc about the hull. Values outside of a disc, ``|F - c| >= r``, of plants that may be
infinite at a frequency, keep off the same where :math:`r |C| \ge |a + (b + c) C| + |q C| + w`, exactly. Of matrices
:math:`F = (V + \Delta U)^{-1} (V c + \Delta T)`, with U = 0 and V = I where F is finite, and the same with singular values
follows, after multiplication by the first factor, from

.. math:: \underline\sigma(V (a + c\, C)) \ge \textstyle\sum_k \|Q_k C + A_k\| + w \|V + \Delta U\|,

where Q and A bound what :math:`\Delta (T C + a U)` adds: with the norm of Delta, or of one row the sum of its entries, which is
exact where U = 0. ``|C S|`` and ``|P S|`` are bounded by products of norms.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.controllers.discs import Discs, Indices, distance_from, sums_of
from robustid.controllers.limits import Limits
from robustid.core import Complex, Real, norms

_ABOVE = 5e-3  # 1 that |L| is up to the bandwidth: what the proof on arcs takes
_ARC = 5  # points of the arc about -1 that a phase margin keeps clear
_LEAST = 1e-12  # of the radius of a disc: nearer to zero it holds zero
_LITTLE = 1e-3  # about 1: a bound of |T| there is taken as that much less than 1
_TURNED = math.pi / 3  # phase of a delay, beyond which |L| is kept below 1 instead


class Conditions(NamedTuple):
    """Distance of ``a + (b + v) C`` from a convex polygon at least ``sum_k |Q_k C + A_k| + w``, at frequencies, each (N, ...).

    The polygon, by its corners, is the point 0 where nothing is said; of matrices the distance from it is the smallest singular
    value. It is that for all v in the hull of `moved`. `inside`: ``|a + (b + v) C| + sum_k |Q_k C + A_k| <= w`` instead. `outside`:
    ``|Q C| >= |a + b C - k| + w`` instead at every corner k of the polygon.
    """

    name: str
    place: Indices  # frequency of every one
    a: Complex  # (N, p, q)
    b: Complex  # (N, p, nu)
    q: Complex  # (N, k, nu, nu): Q_k
    shift: Complex  # (N, k, nu, ny): A_k
    w: Real
    inside: bool = False
    corners: Complex = np.zeros((1, 1), complex)  # (1 or N, corners)
    moved: Complex = np.zeros((1, 1), complex)  # (1 or N, V)
    outside: bool = False

    def at(self, values: Complex) -> tuple[Complex, Real]:
        """A + b C, and what is taken from its distance, with values C (F, nu, ny) at all frequencies."""
        C = values[self.place]
        taken = sum(norms(self.q[:, k] @ C + self.shift[:, k]) for k in range(self.q.shape[1]))
        return self.a + self.b @ C, np.zeros(len(C)) + taken

    def excess(self, values: Complex) -> Real:
        """Distance to the limit of each: negative where it is not kept."""
        return self.judged(values)[0]

    def directions(self, values: Complex) -> Complex:
        """Unit numbers that point from the polygon to where C is; of matrices the unitary factor U of the polar form, (N, p, p)."""
        return self.judged(values)[1]

    def judged(self, values: Complex) -> tuple[Real, Complex]:
        """Both of them; inside there are no directions, and 1 stands for them."""
        X, taken = self.at(values)
        single = X.shape[1:] == (1, 1)
        if self.outside:
            C = values[self.place]
            return taken - np.abs(X[:, 0] - self.corners).max(axis=1) - self.w, np.exp(1j * np.angle(C))
        if self.inside:
            size = np.abs(X[:, 0] + self.moved * values[self.place, 0]).max(axis=1) if single else norms(X)
            return self.w - size - taken, np.broadcast_to(np.eye(X.shape[1], dtype=complex), X.shape)
        if single:
            away, turn = self._from_polygon(X, values)
            return away - taken - self.w, turn[:, None, None]
        left, sizes, right = np.linalg.svd(X, full_matrices=False)
        return sizes[:, -1] - taken - self.w, left @ right

    def ahead(self, values: Complex, turn: Complex) -> Real:
        """Distance to the limit of each, measured along given directions (N, p, p): at most `excess`, and that along the best."""
        return self.at_corners(values, turn).min(axis=1)

    def at_corners(self, values: Complex, turn: Complex) -> Real:
        """The same for b at each of its corners, or outside for each of those of the polygon, (N, V)."""
        X, taken = self.at(values)
        if self.outside:
            ahead = np.real(turn[:, 0].conj() * self.q[:, 0, 0] * values[self.place, 0])
            return ahead - np.abs(X[:, 0] - self.corners) - self.w[:, None]
        if X.shape[1:] == (1, 1):
            every = X[:, 0] + self.moved * values[self.place, 0]
            if self.inside:
                return (self.w - taken)[:, None] - np.abs(every)
            back = turn[:, 0].conj()
            return np.real(back * every) - (np.real(back * self.corners).max(axis=1) + taken + self.w)[:, None]
        if self.inside:
            return self.excess(values)[:, None]
        turned = turn.conj().swapaxes(1, 2) @ X
        return np.linalg.eigvalsh((turned + turned.conj().swapaxes(1, 2)) / 2)[:, :1] - (taken + self.w)[:, None]

    def with_corner(self, row: Indices, corner: Indices) -> Conditions:
        """Some of them, each at one of the corners of `at_corners`."""
        own = {name: getattr(self, name)[row] for name in ("place", "a", "q", "shift", "w")}
        if self.outside:
            shapes = np.broadcast_to(self.corners, (self.place.size, self.corners.shape[1]))[row, corner, None, None]
            own["a"] = own["a"] - shapes
            return self._replace(**own, b=self.b[row], corners=np.zeros((1, 1), complex))
        moved = np.broadcast_to(self.moved, (self.place.size, self.moved.shape[1]))[row, corner, None, None]
        shapes = self.corners[row] if len(self.corners) > 1 else self.corners
        return self._replace(**own, b=self.b[row] + moved, corners=shapes, moved=np.zeros((1, 1), complex))

    def _from_polygon(self, X: Complex, values: Complex) -> tuple[Real, Complex]:
        """Distances of the hulls of ``X + v C`` from the polygons, and the directions away: that of X from all differences."""
        shapes = self.corners
        if self.moved.shape[1] > 1:
            moved = -self.moved * values[self.place, 0]
            shapes = sums_of(shapes, moved) if shapes.shape[1] > 1 else shapes + moved
        return distance_from(X[:, 0, 0], shapes)


class _Clear:
    """Conditions at some frequencies, by points that X keeps away from."""

    def __init__(self, discs: Discs) -> None:
        self.discs, self.found = discs, list[Conditions]()
        self.ny = discs.shape[0]

    def add(
        self,
        name: str,
        where: NDArray[np.bool_] | None,
        offset: float | Real,
        size: float | Real,
        *,
        more: float = 0.0,
        inside: bool = False,
        corners: Complex | None = None,
    ) -> None:
        """``offset + F C`` at a distance of `size` and `more` times |C| from 0, or from polygons; or no farther than that."""
        which = np.ones(self.discs.omega.size, dtype=bool) if where is None else where
        shapes = np.zeros((1, 1), complex) if corners is None else corners
        w, offsets = (np.broadcast_to(np.asarray(one, dtype=float), (int(np.sum(which)),)) for one in (size, offset))
        single = self.discs.shape == (1, 1)
        far = self.discs.outside[which]
        for outside in (False, True) if far.any() else (False,):
            own = far == outside
            place = np.flatnonzero(which)[own]
            some = self.discs.at(place)
            a = np.zeros((place.size, self.ny, self.ny), dtype=complex)
            a[:] = offsets[own, None, None] * np.eye(self.ny)
            shape = shapes[own] if len(shapes) > 1 else shapes
            shift = offsets[own, None, None, None] * some.shifts
            q: Complex = _diagonal(some.around * some.units[:, 0], 1) if single else some.adds
            if outside and inside:  # the plant may be infinite
                nothing = np.full(place.size, -1.0)
                self.found.append(Conditions(name, place, 0 * a, 0 * some.centre, 0 * q, shift, nothing, inside=True))
            elif outside and single:
                q = _diagonal(np.maximum(some.radius - more, 0.0), 1)
                self.found.append(
                    Conditions(name, place, a, some.centre, q, shift, w[own], corners=shape, outside=True)
                )
            else:
                under = some.quotients[0] if outside else np.ones(place.size)
                if more:
                    least = _diagonal(more * under, some.shape[1])
                    q = q + least if single else np.concatenate([q, least], axis=1)
                    shift = shift if single else np.concatenate([shift, 0 * shift[:, :1]], axis=1)
                V = some.under
                self.found.append(
                    Conditions(
                        name, place, V @ a, V @ some.centre, q, shift, w[own] * under, inside, shape, some.corners
                    )
                )

    def process(self, name: str, which: NDArray[np.bool_], most: float) -> None:
        """|P S| at most a number: exact in the disc of 1/F, or where F may be 0, and of matrices, by its largest value."""
        place = np.flatnonzero(which)
        some = self.discs.at(place)
        if self.discs.shape != (1, 1):
            under, above = some.quotients
            self.add(name, which, 1.0, above / np.where(some.outside, under, 1.0) / most)
            return
        centre, radius = some.centre[:, 0, 0], some.radius * some.units[:, 0]
        size = np.abs(centre)
        whole = np.where(some.outside, size < radius * (1 - _LEAST), size > radius * (1 + _LEAST))
        nothing = some.outside & ~whole  # F may be 0 and infinite: 1/F is outside of the disc
        room = np.where(whole | nothing, size**2 - radius**2, 1.0)
        room = np.where(nothing, np.maximum(room, np.finfo(float).tiny), room)
        a: Complex = np.where(whole | nothing, centre.conj() / room, 1.0 + 0j)
        b: Complex = np.where(whole | nothing, 1.0 + 0j, centre)
        q = np.where(whole | nothing, 0.0, radius)
        w = np.where(whole, 1 / most + radius / np.abs(room), (size + radius) / most)
        w = np.where(nothing, radius / room - 1 / most, w)
        for inside in (False, True) if nothing.any() else (False,):
            own = nothing == inside
            full, zeros = (own, None, None), np.zeros((int(own.sum()), 1, 1, 1), complex)
            q_own = _diagonal(q[own], 1)
            self.found.append(Conditions(name, place[own], a[full], b[full], q_own, zeros, w[own], inside=inside))


def _diagonal(numbers: Real, size: int) -> Complex:
    """Multiples of the identity, (N, 1, size, size)."""
    return np.asarray(numbers[:, None, None, None] * np.eye(size), dtype=complex)


def conditions_of(limits: Limits, discs: Discs) -> list[Conditions]:
    """All limits at some frequencies."""
    clear, omega = _Clear(discs), discs.omega
    if limits.sensitivity_peak is not None:
        clear.add("sensitivity peak", None, 1.0, 1 / limits.sensitivity_peak)
    if limits.complementary_peak is not None:
        point, size = _disc_of(limits.complementary_peak)
        clear.add("complementary peak", None, 1.0 - point, size)
    for low, high, value in limits.attenuation:
        clear.add("attenuation", (omega >= low) & (omega <= high), 1.0, 1 / value)
    for low, high, value in limits.roll_off:
        which = (omega >= low) & (omega <= high)
        if value > 1:
            point, size = _disc_of(value)
            clear.add("roll-off", which, 1.0 - point, size)
        elif value < 1:  # X stays in a disc about 1/(1 - m^2)
            clear.add("roll-off", which, 1 - 1 / (1 - value**2), value / (1 - value**2), inside=True)
    for low, high, value in limits.tracking:  # X keeps clear of the disc about 1/(1 - m^2), which holds L = 0
        which = (omega >= low) & (omega <= high)
        clear.add("tracking", which, 1 - 1 / (1 - value**2), value / (1 - value**2))
    for low, high, value in limits.action:
        clear.add("action", (omega >= low) & (omega <= high), 1.0, 0.0, more=1 / value)
    for low, high, value in limits.disturbance:
        clear.process("disturbance", (omega >= low) & (omega <= high), value)
    if limits.bandwidth is not None:
        clear.add("bandwidth", omega <= limits.bandwidth, 0.0, 1 + _ABOVE)
    if discs.shape != (1, 1):
        _margins_of_matrices(clear, limits, omega)
        limits = dataclasses.replace(limits, gain_margin=None, phase_margin=None, delay_margin=None)
    for corners in _kept_clear(limits):
        clear.add("margins", None, 1.0, 0.0, corners=corners[None])
    if limits.delay_margin is not None:
        phase = omega * limits.delay_margin
        near = phase <= _TURNED
        # arcs of delays up to a phase: L = -exp(j t) for t up to it
        clear.add("delay margin", near, 1.0, 0.0, corners=_around(phase[near][:, None] * np.linspace(0.0, 1.0, _ARC)))
        clear.add("delay margin", ~near, 0.0, 1 - _ABOVE, inside=True)
    if limits.control_peak is not None:
        clear.add("control peak", None, 1.0, 0.0, more=1 / limits.control_peak)
    if limits.process_peak is not None:
        clear.process("process peak", np.ones(omega.size, dtype=bool), limits.process_peak)
    return clear.found


def _margins_of_matrices(clear: _Clear, limits: Limits, omega: Real) -> None:
    r"""Margins of changes in all loops at once: a disk for gain and phase, and what T leaves to any delays.

    .. math:: \|2 S - I\| \le k \Leftrightarrow \underline\sigma(X + \tfrac{2}{k^2 - 1}) \ge \tfrac{2 k}{k^2 - 1}, \qquad k > 1,

    and then a loop with factors f of its gains, ``|f - 1|/|f + 1| < 1/k``, is stable; with delays where
    ``|T| < 1/(2 sin(phase/2))``.
    """
    sizes = list[float]()
    if limits.gain_margin is not None:
        sizes.append((limits.gain_margin + 1) / (limits.gain_margin - 1))
    if limits.phase_margin is not None:
        sizes.append(1 / math.tan(limits.phase_margin / 2))
    for k in sizes:
        clear.add("margins", None, 1 + 2 / (k**2 - 1), 2 * k / (k**2 - 1))
    if limits.delay_margin is not None:
        most = 1 / (2 * np.sin(np.minimum(omega * limits.delay_margin, math.pi) / 2))
        for inside in (False, True):
            which = np.equal(most < 1 + _LITTLE, inside)
            m = np.minimum(most[which], 1 - _LITTLE) if inside else most[which]
            clear.add("delay margin", which, 1 + 1 / (m**2 - 1), m / np.abs(m**2 - 1), inside=inside)


def integrators_of(gain: float, discs: Discs) -> Conditions:
    """Least singular value of the factors K of the integrators of a matrix: C is about K/s at the lowest frequency."""
    lowest, (ny, nu) = int(np.argmin(discs.omega)), discs.shape
    w = np.array([(1 + _ABOVE) * gain / discs.omega[lowest]])
    one, nothing = np.eye(nu, dtype=complex)[None], np.zeros((1, nu, ny), complex)
    q, shift = np.zeros((1, 0, nu, nu), complex), np.zeros((1, 0, nu, ny), complex)
    return Conditions("integral gain", np.array([lowest]), nothing, one, q, shift, w)


def _kept_clear(limits: Limits) -> list[Complex]:
    """Convex polygons in the plane of X that a gain margin and a phase margin keep clear of, by their corners."""
    found: list[Complex] = []
    if limits.gain_margin is not None:
        found.append(np.array([0.0, 1 - 1 / limits.gain_margin], complex))
    if limits.phase_margin is not None:  # L = -exp(j t) for |t| <= margin
        found.append(_around(np.linspace(-limits.phase_margin, limits.phase_margin, _ARC)))
    return found


def _around(t: Real) -> Complex:
    """Corners of a polygon that holds the arc of X = 1 - exp(j t), (..., points): outside of the arc, and its ends."""
    outer = np.exp(1j * (t[..., :-1] + t[..., 1:]) / 2) / np.cos((t[..., 1:] - t[..., :-1]) / 2)
    return np.asarray(1 - np.concatenate([outer, np.exp(1j * t[..., [-1, 0]])], axis=-1), dtype=complex)


def _disc_of(peak: float) -> tuple[float, float]:
    """Centre and radius of what X keeps clear of where |T| is at most a peak above 1."""
    return -1 / (peak**2 - 1), peak / (peak**2 - 1)
