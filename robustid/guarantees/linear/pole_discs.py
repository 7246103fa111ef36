r"""Modes whose poles lie anywhere in a pole-uncertainty box, as series in a few functions with fixed poles.

.. math:: \frac{1}{1 - a x} = \sum_{j \le J} C_j \frac{\beta_1 \cdots \beta_{j-1}}{1 - a_j x} + \frac{\prod_{i \le J}
    \tau_i \beta_i}{1 - a x}, \qquad \beta_i = \frac{x - a_i^*}{1 - a_i x}, \qquad \tau_i = \frac{a - a_i}{1 - a_i^* a}

with the pole a of a mode c n(x)/(1 - a x) in a hyperbolic disc about a_1, x the delay, and
C_j = (1 - |a_j|^2)/(1 - a_j* a) tau_1 ... tau_(j-1): what projections on functions with the poles a_i leave of a Szego kernel. On
the unit circle |beta| = 1, so that the remainder is small at every frequency, at the resonance too, however light the damping is.
The amplitude is c' = c C_1. In Re s < 0 the distance of poles is |(s - s_0)/(s + s_0*)|; that of a = exp(s T)
is at most that (Schwarz and Pick).

Modes whose boxes are close may cancel each other with any amplitudes. So m of them are one group with m amplitudes that the
data do tell: the first m coefficients gamma_n = sum_i c_i C(a_i) tau_i^n of the series about one middle. The further ones
follow from them as t^n modulo prod_i (t - tau_i): gamma_n = sum_l R_nl gamma_l, whose R are Schur functions of hooks, so that

.. math:: |R_{nl}| \le \binom{n}{l} \binom{n - l - 1}{m - 1 - l} T^{n - l}, \qquad |\tau_i| \le T, \; l < m \le n.

A box that reaches the circle has no such disc of use: about its middle a_1 a geometric series in (a - a_1) x/(1 - a_1 x) then
serves at the frequencies that are farther from a_1 than all of the box, and nothing at the others.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy.sparse.csgraph
import scipy.special
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Plane, Real, SPlane, freeze, kept_by_content

_ROUNDING = 1e-12  # of a distance between poles: a few operations, none of which cancels
_TERMS = 48  # of the series of a mode, at most: 24 leave more of a wide box than the data tell of its amplitude
_TERMS_OF_GROUP = 24
_WIDEST, _FAR_TERMS = 0.9, 6  # distance from which a box counts as reaching the circle, and terms of its series
_ENDLESS = 600  # terms of a sum to its end: 0.9^600 is below 1e-27
_WIDEST_GROUP = 0.7  # of several modes: 24 terms leave 24 T^24, half a percent
_CLOSE = 1.5  # times the sum of the radii of two boxes
_CELLS = 16  # of a box, along each side, on which distances are bounded


@dataclasses.dataclass(frozen=True, eq=False)
class PoleDiscs(Frozen):
    """Every mode c n(x)/(1 - a x) with its pole a in a hyperbolic disc about a_1, x the delay: the series of the module."""

    poles: tuple[Complex, ...]  # one (J,) a group: the a_i in the z of the plane, in the upper half plane
    # One (J, m) a group: bounds of |C_j/C_1|, or |R|, for each of its m amplitudes; 0 of coefficients that are another amplitude.
    sizes: tuple[Real, ...]
    distance: Real  # (M,), largest |tau_1|, below 1, of every amplitude
    rest: Real  # (M,), bound of the sum of the coefficients beyond J: |tau_1 ... tau_J|/(1 - |tau_1|) of one mode
    reach: Real  # (M,), largest |a - a_1| of boxes that reach the circle; 0 of the others
    delay: int  # n(x) = x^delay; -1 stands for n(x) = 1 + x, of a strictly proper mode of continuous time

    def __post_init__(self) -> None:
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in ("distance", "rest", "reach")})

    @functools.cached_property
    def _groups(self) -> NDArray[np.intp]:
        """Group of every amplitude, (M,)."""
        return np.repeat(np.arange(len(self.sizes)), [sizes.shape[1] for sizes in self.sizes])

    @functools.cached_property
    def _far_groups(self) -> list[bool]:
        """Mask of the groups that reach the circle: one mode each."""
        return [bool(np.any(self.reach[self._groups == group] > 0)) for group in range(len(self.poles))]

    @functools.cached_property
    def middle(self) -> Complex:
        """The a_1 of every amplitude, (M,)."""
        first: Complex = np.array([poles[0] for poles in self.poles], dtype=complex)
        return first[self._groups]

    @functools.cached_property
    def _pairs(self) -> tuple[tuple[int, float, bool], ...]:
        """Amplitude, size of the coefficient and whether it is the amplitude itself, of every function and its conjugate."""
        found: list[tuple[int, float, bool]] = []
        for group, sizes in enumerate(self.sizes):
            own = int(np.searchsorted(self._groups, group))
            found += [(own + int(m), float(sizes[j, m]), int(j) < sizes.shape[1]) for j, m in np.argwhere(sizes)]
        return tuple(found)

    @functools.cached_property
    def columns(self) -> tuple[tuple[int, float, bool], ...]:
        """Amplitude, bound of the coefficient for an amplitude of 1, and whether it is the conjugate one, of every function."""
        return tuple((number, size, conjugate) for number, size, _ in self._pairs for conjugate in (False, True))

    @functools.cached_property
    def first(self) -> tuple[bool, ...]:
        """Mask of the functions whose coefficient is an amplitude, or the conjugate of one."""
        return tuple(first for *_, first in self._pairs for _ in range(2))

    def values(self, angles: Real) -> Complex:
        """The functions n(x) beta_1 ... beta_(j-1)/(1 - a_j x), and with conjugate poles, at exp(j angle), (N, columns).

        One of a group to which several amplitudes contribute stands there once for each.
        """
        x = np.exp(-1j * np.asarray(angles, dtype=float))
        found: list[Complex] = []
        for poles, sizes, far in zip(self.poles, self.sizes, self._far_groups, strict=True):
            products = [self._numerator(x)] * 2
            for pole, row in zip(poles, sizes, strict=True):
                both = [product / (1 - a * x) for product, a in zip(products, (pole, pole.conj()), strict=True)]
                found += both * np.count_nonzero(row)
                for k, a in enumerate((pole, pole.conj())):
                    products[k] = products[k] * (x if far else x - a.conj()) / (1 - a * x)
        return np.stack(found, axis=1) if found else np.zeros((x.size, 0), complex)

    def _numerator(self, x: Complex) -> Complex:
        return 1 + x if self.delay < 0 else x**self.delay

    def left_out(self, angles: Real) -> Real:
        """Largest remainder of the series of every mode and its conjugate, for |c'| = 1, (N, M); inf where it does not converge."""
        x = np.exp(-1j * np.asarray(angles, dtype=float))[:, None]
        terms = np.array([len(poles) for poles in self.poles])[self._groups]
        total = np.zeros((x.size, self.middle.size))
        for middle in (self.middle, self.middle.conj()):
            d = np.abs(1 - middle * x) * (1 - _ROUNDING)
            room = np.maximum(d - self.reach, 0.0)
            with np.errstate(divide="ignore"):
                total += np.where(self.reach > 0, (self.reach / d) ** terms / room, self.rest / d)
        return np.abs(self._numerator(x)) * total * (1 + _ROUNDING)

    def responses(self, u: Real) -> Complex:
        """Responses of the functions to an input (T,) from zero initial conditions, (T, columns)."""
        import scipy.signal  # half of the time that importing this room took

        found: list[Complex] = []
        start = np.concatenate([np.zeros(self.delay), u])[: u.size].astype(complex)
        for poles, sizes, far in zip(self.poles, self.sizes, self._far_groups, strict=True):
            before = start
            for pole, row in zip(poles, sizes, strict=True):
                one = np.asarray(scipy.signal.lfilter([1.0], [1.0, -pole], before))
                found += [one, np.conj(one)] * np.count_nonzero(row)
                numerator = [0.0, 1.0] if far else [-pole.conj(), 1.0]
                before = np.asarray(scipy.signal.lfilter(numerator, [1.0, -pole], before))
        return np.stack(found, axis=1) if found else np.zeros((u.size, 0), complex)

    def left_out_in_time(self, u: Real) -> Real:
        """The same in the response to an input, (T, M): the H2 norm of the remainder times the norm of the input so far.

        Infinite for boxes that reach the circle.
        """
        norm = np.sqrt(np.cumsum(u**2))[:, None]
        size = np.sqrt((1 - np.abs(self.middle)) * (1 + np.abs(self.middle)))
        return norm * np.where(self.reach > 0, np.inf, 2 * self.rest / size) * (1 + _ROUNDING)

    @functools.cached_property
    def moments(self) -> tuple[Real, Real, Real]:
        """Sums of the bounds of all coefficients for an amplitude of 1, and of n and n^2 times them, (M,) each."""
        n, found = np.arange(_ENDLESS)[:, None], np.zeros((3, self.middle.size))
        for group in range(len(self.poles)):
            own = self._groups == group
            every = bounds_of_coefficients(float(self.distance[own][0]), int(own.sum()))
            found[:, own] = [(n**power * every).sum(axis=0) for power in range(3)]
        return found[0], found[1], found[2]

    @functools.cached_property
    def on_wider_circle(self) -> tuple[Real, Real]:
        """Radii r >= T, and sums of |R_nl| r^-n for the largest value of a function of tau there, (M,) each.

        T and 1 of one mode.
        """
        radius, share = np.array(self.distance, dtype=float), np.ones(self.middle.size)
        for group in np.flatnonzero(np.bincount(self._groups) > 1):
            own = self._groups == group
            r = float(np.sqrt(self.distance[own][0]))
            radius[own], m = r, int(own.sum())
            share[own] = bounds_of_coefficients(float(self.distance[own][0]) / r, m).sum(axis=0) / r ** np.arange(m)
        return radius, share

    def bends(self, low: Real, high: Real) -> Real:
        r"""Bound of the second derivative of the share of every amplitude along arcs, for an amplitude of 1, (arcs, M).

        Of n(x) sum_k g_k beta^k/(1 - a_1 x), term by term, with |beta'| = (1 - |a_1|^2)/|1 - a_1 x|^2, at the angle nearest to the
        pole.
        """
        total = np.zeros((low.size, self.middle.size))
        for k, (S0, S1, S2) in enumerate(zip(*self.moments, strict=True)):
            for a in (self.middle[k], self.middle[k].conj()):
                d, size = self._nearest(low, high, a), np.abs(a)
                if self.reach[k]:
                    value = self._far(d, k)
                    first, second = value**2, 2 * value**3 + value**2
                else:
                    slope, turn = size / d, (1 - size) * (1 + size) / d**2
                    value, first = S0 / d, (slope * S0 + turn * S1) / d
                    second = ((slope**2 + slope / d) * S0 + 4 * slope * turn * S1 + turn**2 * S2) / d
                n = self.delay
                if n < 0:
                    total[:, k] += 2 * second + 2 * first + value
                else:  # no 0 times infinity
                    total[:, k] += second + 2 * n * first + n**2 * value if n else second
        return total * (1 + 1e-9)

    def largest_on(self, low: Real, high: Real) -> Real:
        """Bound of the modulus of the same on arcs, (arcs, M)."""
        total = np.zeros((low.size, self.middle.size))
        for k, whole in enumerate(self.moments[0].tolist()):
            for a in (self.middle[k], self.middle[k].conj()):
                d = self._nearest(low, high, a)
                value = self._far(d, k) if self.reach[k] else whole / d
                total[:, k] += (2.0 if self.delay < 0 else 1.0) * value
        return total * (1 + 1e-9)

    def _far(self, d: Real, mode: int) -> Real:
        """Bound of 1/|1 - a x| at distances d from the middle of a box that reaches the circle; inf within it."""
        with np.errstate(divide="ignore"):
            return 1 / np.maximum(d - self.reach[mode], 0.0)

    @staticmethod
    def _nearest(low: Real, high: Real, pole: complex) -> Real:
        """Smallest |1 - a x| on arcs."""
        return np.abs(1 - pole * np.exp(-1j * nearest(low, high, float(np.angle(pole)))))


def nearest(low: Real, high: Real, angle: float) -> Real:
    """The angle of every arc that is nearest to a given one, on the circle."""
    ends = np.where(np.cos(low - angle) >= np.cos(high - angle), low, high)
    turned = low + np.mod(angle - low, 2 * np.pi)
    return np.where(turned <= high, turned, ends)


def hull(omega: Real, damping: Real) -> Complex:
    """Corners of a polygon around all s = (-d + j sqrt(1 - d^2)) w of two intervals, or of cells of them, (..., 5).

    The four corners of the box, and the point in which the tangents at the ends of the outer arc meet.
    """
    turns: Real = np.arccos(-damping)  # angles of s, from the positive real axis
    ends = np.exp(1j * turns)
    corners = (omega[..., :, None] * ends[..., None, :]).reshape(*omega.shape[:-1], 4)
    tip = omega[..., 1] * np.exp(1j * turns.mean(axis=-1)) / np.cos((turns[..., 1] - turns[..., 0]) / 2)
    return np.asarray(np.concatenate([corners, tip[..., None]], axis=-1), dtype=complex)


def distances(points: Complex, s: complex | Complex) -> Real:
    """Hyperbolic distances in Re s < 0 of points from another, below 1."""
    return np.abs((points - s) / (points + np.conj(s)))


def middle_of(points: Complex) -> complex:
    """Middle of a small hyperbolic disc of Re s < 0 around points."""
    return _middle_of(np.ascontiguousarray(points, dtype=complex).tobytes())


@functools.lru_cache(maxsize=4096)
def _middle_of(numbers: bytes) -> complex:
    """The same of the bytes of points: a cell of a box asks for its own several times."""
    import scipy.optimize

    points: Complex = np.frombuffer(numbers, dtype=complex)
    scale, turn = np.exp(np.log(-points.real).mean()), points.imag.mean()

    def of(parts: Real) -> complex:
        return complex(-scale * np.exp(parts[0]), turn + scale * parts[1])

    def radius(s: complex) -> float:
        return float(distances(points, s).max())

    def objective(parts: Real) -> float:
        return radius(of(parts))

    found = scipy.optimize.minimize(objective, np.zeros(2), method="Nelder-Mead")
    return min((of(found.x), of(np.zeros(2))), key=radius)


def bounds_of_coefficients(T: float, m: int) -> Real:
    """Bounds of |R_nl| for poles within T of the middle, n along the rows, of the m amplitudes of a group, (_ENDLESS, m)."""
    n = np.arange(m, _ENDLESS)
    found = np.zeros((_ENDLESS, m))
    for one in range(m):
        size = scipy.special.comb(n, one) * scipy.special.comb(n - one - 1, m - 1 - one)
        found[m:, one] = size * T ** (n - float(one)) * (1 + _ROUNDING)
        found[one, one] = 1
    return found


def groups_of(points: Complex) -> list[NDArray[np.intp]]:
    """Modes whose discs around the points of their boxes (M, 5) are close, directly or through others, each group by its first one.

    Closer than `_CLOSE` times the sum of the radii, in the hyperbolic metric artanh of the distance: there the second term of a
    series looks like the difference of two modes. Boxes that reach the circle stay alone.
    """
    middle = np.array([middle_of(corners) for corners in points])
    own = np.array([float(distances(corners, s).max()) for corners, s in zip(points, middle, strict=True)])
    radius = np.arctanh(np.where(own > _WIDEST, 0.0, own))
    apart = np.arctanh(np.minimum(distances(middle[:, None], middle), 1 - _ROUNDING))
    close = apart < _CLOSE * (radius + radius[:, None])
    count, number = scipy.sparse.csgraph.connected_components(close, directed=False)
    return [np.flatnonzero(number == k) for k in range(count)]


def told_apart_of(omega: Real, damping: Real) -> NDArray[np.intp]:
    """Numbers of the modes whose amplitudes data can tell, of those in boxes (M, 2): all, but for groups too wide for one series.

    Of such a group the mode whose damping may be the heaviest is left out, until no group is too wide: it is most like the class.
    """
    points, kept = hull(omega, damping), np.arange(len(omega))
    while kept.size:
        groups = [kept[group] for group in groups_of(points[kept])]
        wide = [group for group in groups if group.size > 1 and _disc_around(points[group].ravel())[1] > _WIDEST_GROUP]
        if not wide:
            break
        kept = np.setdiff1d(kept, [group[np.argmax(damping[group, 1])] for group in wide])
    return kept


def discs_of(plane: Plane, omega: Real, damping: Real, delay: int, wanted: Real) -> PoleDiscs:
    """Series for the boxes (M, 2), long enough for remainders below a part `wanted` (M,) of the amplitudes."""

    def in_z(s: Complex) -> Complex:
        if isinstance(plane, SPlane):
            return np.asarray((plane.corner + s) / (plane.corner - s), dtype=complex)
        return np.asarray(np.exp(s * plane.dt), dtype=complex)

    poles: list[Complex] = []
    sizes: list[Real] = []
    numbers: list[tuple[float, float, float]] = []
    points = hull(omega, damping)
    for group in groups_of(points):
        part = float(wanted[group].min())
        if group.size > 1 and (together := _series_of_group(points[group].ravel(), group.size, part)):
            s, size, distance, rests = together
            poles.append(in_z(s))
            sizes.append(size)
            numbers += [(distance, rest, 0.0) for rest in rests.tolist()]
            continue
        for k, corners in zip(group.tolist(), points[group], strict=True):  # close ones of no disc are not told apart
            s, size, distance, rest = _series(omega[k], damping[k], wanted[k : k + 1])
            far = 0.0
            if distance > _WIDEST:
                s = np.full(_FAR_TERMS, (corners.real.min() + corners.real.max()) / 2 + 1j * corners[:4].imag.mean())
                far = float(_apart(plane, corners, complex(s[0])).max()) * (1 + 1e-9)
            a = in_z(s)
            inside: Real = (1 - np.abs(a)) * (1 + np.abs(a))
            # sqrt((1 - |a_j|^2)/(1 - |a_1|^2)) of |C_j/C_1|.
            size = far ** np.arange(_FAR_TERMS) if far else np.sqrt(inside / inside[0]) * size * (1 + _ROUNDING)
            poles.append(a)
            sizes.append(np.append(1.0, size[1:])[:, None])
            numbers.append((distance, rest, far))
    distances_, rests_, reaches = np.array(numbers).T
    return PoleDiscs(tuple(poles), tuple(sizes), distances_, rests_, reaches, delay)


def _series_of_group(points: Complex, m: int, wanted: float) -> tuple[Complex, Real, float, Real] | None:
    """Poles in s, sizes (J, m), distance and remainders (m,) of m modes around these points; None of a wide one."""
    middle, distance = _disc_around(points)
    if distance > _WIDEST_GROUP:
        return None
    every = bounds_of_coefficients(distance, m)
    rest = np.cumsum(every[::-1], axis=0)[::-1]
    terms = min(max(int(np.argmax(np.all(rest <= wanted, axis=1))), m + 1), _TERMS_OF_GROUP)
    return np.full(terms, middle), every[:terms], distance, rest[terms] * (1 + _ROUNDING)


def _disc_around(points: Complex) -> tuple[complex, float]:
    """Middle and radius of a small hyperbolic disc around points."""
    middle = middle_of(points)
    return middle, float(distances(points, middle).max()) + _ROUNDING


def _apart(plane: Plane, s: Complex, middle: complex) -> Real:
    """Bounds of the distances in z of poles s from another: |exp' | <= 1 in Re s < 0, and that of the bilinear map."""
    if plane.dt:
        return np.abs(s - middle) * plane.dt
    return 2 * np.abs(s - middle) / np.abs(plane.corner - middle)  # type: ignore[attr-defined]


@kept_by_content(most=2, results=4096)  # halves of a cell have all modes but one in common with it
def _series(omega: Real, damping: Real, wanted: Real) -> tuple[Complex, Real, float, float]:
    """Poles in s, bounds of |tau_1 ... tau_(j-1)|/sqrt(1 - |tau_1|^2), of |tau_1|, and of the remainder.

    The first pole is the middle, each further one where the product of the distances from those before is largest (Leja). On the
    cells of a grid a distance is at most the largest one at the corners of their hulls, since hyperbolic discs are convex.
    """
    sides: list[Real] = [np.linspace(ends[0], ends[1], _CELLS + 1) for ends in (omega, damping)]
    pairs = [np.stack([side[:-1], side[1:]], axis=1) for side in sides]
    cells = hull(*(part.reshape(-1, 2) for part in np.broadcast_arrays(pairs[0][:, None], pairs[1][None])))
    nodes = ((-sides[1] + 1j * np.sqrt(1 - sides[1] ** 2)) * sides[0][:, None]).ravel()
    poles = [middle_of(hull(omega, damping))]
    on_cells, at_nodes = np.ones(len(cells)), np.ones(nodes.size)
    sizes: list[float] = []
    first = float(distances(cells, poles[0]).max()) + _ROUNDING
    while True:
        sizes.append(float(on_cells.max()) / np.sqrt(1 - first**2))
        on_cells = on_cells * (distances(cells, poles[-1]).max(axis=1) + _ROUNDING)
        at_nodes = at_nodes * distances(nodes, poles[-1])
        rest = float(on_cells.max()) / (1 - first)
        if rest <= wanted[0] or len(poles) == _TERMS:
            return freeze(np.array(poles)), freeze(np.array(sizes)), first, rest * (1 + _ROUNDING)
        poles.append(complex(nodes[np.argmax(at_nodes)]))
