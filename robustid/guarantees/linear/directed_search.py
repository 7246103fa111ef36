"""The search for certificates of directions: steps of Newton, all directions of a target at once. Nothing of it is trusted."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Real
from robustid.guarantees.linear.certificate import Targets, targets_at
from robustid.guarantees.linear.directed import DirectedBand, Measure, Sides, directions, kernels, supports
from robustid.guarantees.linear.polygon_discs import corners_of_supports, smallest_discs

_SIDES = 16  # directions
# Smoothing of the steps, as parts of the mean term of a bound: from multipliers of a knot beside, whose points are others, as many
# steps would be needed.
_LEVELS = np.geomspace(2, 0.02, 16).tolist()
_LENGTHS = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.6])  # of a step
_BEND = (
    0.85  # of what a term's curvature is below that of its majorant, x^2/(2 t) + t/2: with all of it steps overshoot
)
_POINTS, _FARTHER, _NODES = 16, 8, 8  # the nearest points, others ever farther apart, and the nearest polygons
_FUNCTIONS = 12  # of the class, of each of which it is weighed what is missed; of the others together
_FEWEST = 24  # angles, where the time is short
_LAST = 3  # iterates that are evaluated
_ROUNDS = 40  # of the smallest ellipses
_FLAT = 1e-9  # of an extent: the least one of an ellipse
_HALVINGS = 4  # of arcs:
_WIDE, _LOOSE = 1.0, 1.02  # those that are so much wider in the middle than at their ends, and than a search there

Directed = tuple[NDArray[np.intp], Complex, Real]  # points (n,), multipliers (M, n), bounds (M,)
Norms = tuple[Real, Real, Real]  # square - 2 cross x + x'Qx, squared, of all directions: Q, cross, square


def directed_band(sides: Sides, angles: Real, least: float, budget: Budget) -> DirectedBand | None:
    """Search certificates at angles, and between them where mixing loses, on arcs above `least`.

    At those of the angles that there is time for, spread over all; None where it is hardly any.
    """
    search, targets = DirectedSearch(sides, directions(_SIDES)), targets_at(sides.samples, angles)
    found: dict[int, Directed] = {}
    # The ends, every 2^k-th one, and so on to all of them: whenever the time ends, those that were searched are spread.
    for k in sorted(range(angles.size), key=lambda k: -(k & -k) if 0 < k < angles.size - 1 else -angles.size):
        if budget.over:
            break
        found[k] = search.at(targets[k : k + 1])
    if len(found) < min(_FEWEST, angles.size):
        return None
    places = sorted(found)
    angles = angles[places]
    points, c, _ = map(np.array, zip(*(found[k] for k in places), strict=True))
    band = DirectedBand(sides, angles, points, c.astype(np.complex64))
    open_arcs = np.arange(angles.size - 1)
    for _ in range(_HALVINGS):
        open_arcs = open_arcs[np.diff(band.angles)[open_arcs] > least]
        if not open_arcs.size:
            break
        middle = (band.angles[open_arcs] + band.angles[open_arcs + 1]) / 2
        radius, between = band.radius, band.at(middle)[1]
        with np.errstate(invalid="ignore"):
            loss = between / ((radius[open_arcs] + radius[open_arcs + 1]) / 2)
        worst = np.argsort(-loss, kind="stable")
        worst = worst[loss[worst] > _WIDE]  # the time may end before the others
        open_arcs, middle, between = open_arcs[worst], middle[worst], between[worst]
        if not open_arcs.size or budget.over:
            break
        band, open_arcs = _halved(search, band, open_arcs, middle, between, budget)
    return band


def _halved(
    search: DirectedSearch, band: DirectedBand, arcs: NDArray[np.intp], middle: Real, between: Real, budget: Budget
) -> tuple[DirectedBand, NDArray[np.intp]]:
    """The band with knots in the middle of those arcs where a search there gains, and the numbers of their halves, rising.

    Of the first of them, as far as the time goes; one at least.
    """
    targets = targets_at(band.samples, middle)
    found: list[Directed] = []
    for k in range(arcs.size):
        if k and budget.over:
            break
        found.append(search.at(targets[k : k + 1]))
    chosen, multipliers, bounds = map(np.array, zip(*found, strict=True))
    loose = between[: len(bounds)] > _LOOSE * smallest_discs(corners_of_supports(bounds))[1]
    loose = np.flatnonzero(loose)[np.argsort(arcs[: len(bounds)][loose])]
    at = arcs[loose] + 1
    first = arcs[loose] + np.arange(at.size)
    angles = np.insert(band.angles, at, middle[loose])
    points = np.insert(band.points, at, chosen[loose], axis=0)
    c = np.insert(band.multipliers, at, multipliers[loose].astype(np.complex64), axis=0)
    return DirectedBand(band.sides, angles, points, c), np.sort(np.concatenate([first, first + 1]))


class DirectedSearch:
    """Multipliers of directions `turns` for targets that are seen from the sides."""

    def __init__(self, sides: Sides, turns: Complex) -> None:
        self.sides, self.turns = sides, turns

    @functools.cached_property
    def _ellipses(self) -> tuple[Complex, Real]:
        """Centres (half,) and shapes E (half, 2, 2) of ellipses around what is known at every point: Re(c m) + sqrt(g'Eg)."""
        sides, samples = self.sides, self.sides.samples
        centre = samples.y[: sides.half] - samples.values[: sides.half] @ self._centres
        E = (samples.bound[: sides.half] + sides.left_out)[:, None, None] ** 2 * np.eye(2)
        for k, corners in enumerate(sides.corners, sides.first_node):
            middle, shape = smallest_ellipse(corners)
            centre[k] += middle - samples.y[k]
            E[k] = shape + sides.left_out[k] ** 2 * np.eye(2)
        return centre, E

    @functools.cached_property
    def _centres(self) -> Complex:
        return self.sides.extraction.known.coefficients(self.sides.samples)[0]

    def nearest(self, base: complex) -> NDArray[np.intp]:
        """Numbers of the points for a target, rising: the nearest in the hyperbolic distance, and others ever farther apart."""
        sides, z = self.sides, self.sides.samples.nodes[: self.sides.half]
        away = np.abs((z - base) / (1 - base.conjugate() * z))
        away = away + (np.abs(sides.samples.v[: sides.half, sides.samples.target]) == 0)  # those do not see the entry
        order, nodes = np.argsort(away[: sides.first_node]), np.argsort(away[sides.first_node :])[:_NODES]
        if order.size > _POINTS + _FARTHER:
            far = np.geomspace(_POINTS, order.size, _FARTHER + 1)[:-1].astype(int)
            order = order[np.unique(np.concatenate([np.arange(_POINTS), far]))]
        return np.sort(np.concatenate([order, sides.first_node + nodes]))

    def at(self, target: Targets) -> Directed:
        """The nearest points for one target, with multipliers and bounds."""
        points = self.nearest(complex(target.base[0]))
        return points, *self.search(target, points)

    def search(self, target: Targets, points: NDArray[np.intp]) -> tuple[Complex, Real]:
        """Multipliers (M, n) of points for one target, and bounds (M,): the best of the last ones."""
        sides, n = self.sides, points.size
        centre, E = self._ellipses
        rows, rest = _grouped(*self._rows(target, points))
        bound = _Smoothed([self._norms(target, points), *rest], rows, centre[points], E[points])
        x = np.zeros((self.turns.size, 2 * n))
        tried: list[Complex] = []
        for step, level in enumerate(_LEVELS):
            try:
                x = bound.step(x, level)
            except np.linalg.LinAlgError:  # a singular one of the stack: what is best so far stays
                break
            if step >= len(_LEVELS) - _LAST:
                tried.append((x[:, :n] + 1j * x[:, n:]).astype(np.complex64).astype(complex))
        if not tried:
            return np.zeros((self.turns.size, n), complex), np.full(self.turns.size, np.inf)
        total = supports(sides, target, points, np.concatenate(tried)[None], np.tile(self.turns, len(tried)))
        total = np.where(np.isnan(total), np.inf, total).reshape(len(tried), -1)
        best, at = total.argmin(axis=0), np.arange(self.turns.size)
        return np.where(np.isfinite(total[best, at])[:, None], np.array(tried)[best, at], 0), total[best, at]

    def _norms(self, target: Targets, points: NDArray[np.intp]) -> tuple[Real, Real, Real]:
        """|r|^2 = square - 2 cross x + x'Qx in x = (Re c, Im c): (2n, 2n), (M, 2n), (M,)."""
        samples, base = self.sides.samples, complex(target.base[0])
        z, w, measure = samples.nodes[points], samples.weights[points], Measure(base)
        h, at = measure.outer(z), complex(measure.outer(np.array(base)))
        A, B = (one * h[:, None] for one in kernels(z, w))
        A, B = A * h.conj(), B * h
        Q = np.block([[A.real + B.real, A.imag - B.imag], [-A.imag - B.imag, A.real - B.real]]) / 2
        w, tau = w[:, samples.target], (target.weight[0] * at * self.turns)[:, None]
        onto, other = tau * (h * w).conj() / (1 - base * z.conj()), tau * h * w / (1 - base * z)
        cross = np.concatenate([(onto + other).real, (onto - other).imag], axis=1) / 2
        square = np.abs(tau) ** 2 / (1 - abs(base) ** 2) + (tau**2 / (1 - base**2)).real
        return Q, cross, np.maximum(square[:, 0] / 2, 1e-300)

    def _rows(self, target: Targets, points: NDArray[np.intp]) -> tuple[Real, Real]:
        """Rows J (2k, 2n) and values (M, 2k) of real and then imaginary parts of what is missed of the functions, times radii."""
        sides, (own, twin) = self.sides, self.sides.twins
        radius = sides.extraction.known.coefficients(sides.samples)[1]
        V, wanted = sides.samples.values[points].T, self.turns[:, None] * target.values[0]
        real, imaginary = np.concatenate([V.real, -V.imag], axis=1), np.concatenate([V.imag, V.real], axis=1)
        T = [wanted.real, wanted.imag]
        for rows, sign, values in ((real, 1, T[0]), (imaginary, -1, T[1])):
            rows[own] += sign * rows[twin]
            values[:, own] += sign * values[:, twin]
        imaginary[sides.reals], T[1][:, sides.reals] = 0, 0
        kept = np.setdiff1d(np.arange(radius.size), twin)
        J = np.concatenate([one[kept] * radius[kept, None] for one in (real, imaginary)])
        return J, np.concatenate([one[:, kept] * radius[kept] for one in T], axis=1)


def _grouped(J: Real, wanted: Real) -> tuple[tuple[Real, Real], list[Norms]]:
    """Rows of the largest functions, and the others as one norm, which is at least as large as the sum of theirs."""
    count = len(J) // 2
    size = np.abs(wanted[:, :count] + 1j * wanted[:, count:]).max(axis=0)
    if count <= _FUNCTIONS:
        return (J, wanted), []
    order = np.argsort(-size, kind="stable")
    large, small = (np.concatenate([part, part + count]) for part in (order[:_FUNCTIONS], order[_FUNCTIONS:]))
    A, b = J[small] * np.sqrt(count - _FUNCTIONS), wanted[:, small] * np.sqrt(count - _FUNCTIONS)
    return (J[large], wanted[:, large]), [(A.T @ A, b @ A, (b**2).sum(axis=1))]


class _Smoothed:
    """The bound of a target as a function of x = (Re c, Im c), of all directions, each |term| as sqrt(term^2 + delta^2)."""

    def __init__(self, norms: Sequence[Norms], rows: tuple[Real, Real], centre: Complex, E: Real) -> None:
        self.norms, (self.J, self.wanted) = norms, rows
        self.linear, self.E, self.count = np.concatenate([centre.real, -centre.imag]), E, centre.size
        self.unit = np.sqrt(norms[0][2].max())

    def _terms(self, x: Real) -> tuple[Real, Real, list[Real], Real]:
        """E g of the points, their squares, those of the norms, and what is missed of the functions; x (..., M, 2n)."""
        a, b = x[..., : self.count], x[..., self.count :]
        E = self.E
        turned = np.stack([E[:, 0, 0] * a - E[:, 0, 1] * b, E[:, 1, 1] * b - E[:, 0, 1] * a])
        own = np.maximum(turned[0] * a + turned[1] * b, 0.0)
        rest = [
            np.maximum(square - 2 * (cross * x).sum(axis=-1) + ((x @ Q) * x).sum(axis=-1), 0.0)
            for Q, cross, square in self.norms
        ]
        return turned, own, rest, x @ self.J.T - self.wanted

    def _value(self, x: Real, delta: Real) -> Real:
        _, own, rest, missed = self._terms(x)
        half = missed.shape[-1] // 2
        d = delta[:, None] ** 2
        sizes = missed[..., :half] ** 2 + missed[..., half:] ** 2
        total = np.sqrt(own + d).sum(axis=-1) + np.sqrt(sizes + d).sum(axis=-1)
        return x @ self.linear + total + sum(np.sqrt(one + d[:, 0]) for one in rest)

    def step(self, x: Real, level: float) -> Real:
        """A step of Newton with the smoothing `level`, as a part of the mean term, and the best of some lengths of it."""
        n, at = self.count, np.arange(self.count)
        turned, own, rest, missed = self._terms(x)
        half = missed.shape[1] // 2
        sizes = missed[:, :half] ** 2 + missed[:, half:] ** 2
        total = np.sqrt(own).sum(axis=1) + np.sqrt(sizes).sum(axis=1) + sum(np.sqrt(one) for one in rest)
        delta = np.maximum(level * total / (n + len(rest) + half), 1e-9 * self.unit)
        d = delta[:, None] ** 2
        s, m = np.sqrt(own + d), np.sqrt(sizes + d)
        both = np.concatenate([m, m], axis=1)
        gradient = self.linear + np.concatenate([turned[0] / s, turned[1] / s], axis=1) + (missed / both) @ self.J
        H = (self.J.T / both[:, None, :]) @ self.J
        along = missed[:, :half, None] * self.J[:half] + missed[:, half:, None] * self.J[half:]
        H -= _BEND * (along / m[:, :, None] ** 3).swapaxes(1, 2) @ along
        for (Q, cross, _), one in zip(self.norms, rest, strict=True):
            pull, r = x @ Q - cross, np.sqrt(one + d[:, 0])[:, None]
            gradient += pull / r
            H += Q / r[:, :, None] - _BEND * (pull[:, :, None] * pull[:, None, :]) / r[:, :, None] ** 3
        H[:, at, at] += self.E[:, 0, 0] / s - _BEND * turned[0] ** 2 / s**3
        H[:, n + at, n + at] += self.E[:, 1, 1] / s - _BEND * turned[1] ** 2 / s**3
        off = -self.E[:, 0, 1] / s - _BEND * turned[0] * turned[1] / s**3
        H[:, at, n + at] += off
        H[:, n + at, at] += off
        way = np.asarray(np.linalg.solve(H, -gradient[:, :, None])[:, :, 0], dtype=float)
        tried = x + _LENGTHS[:, None, None] * way
        best = self._value(tried, delta).argmin(axis=0)
        return tried[best, np.arange(len(x))]


def smallest_ellipse(points: Complex) -> tuple[complex, Real]:
    """Centre m and shape E (2, 2) of a small ellipse around points: max Re(c v) <= Re(c m) + sqrt(g'Eg), g = (Re c, -Im c).

    The multiplicative rule for the ellipse of the smallest area, a few rounds.
    """
    middle = complex(points.mean())
    extent = float(np.abs(points - middle).max()) or 1.0
    P = np.stack([(points - middle).real, (points - middle).imag]) / extent
    lifted, weight = np.concatenate([P, np.ones((1, points.size))]), np.full(points.size, 1 / points.size)
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv((lifted * weight) @ lifted.T + _FLAT**2 * np.eye(3))
        weight = weight * np.einsum("in,ij,jn->n", lifted, inverse, lifted)
        weight /= weight.sum()
    away = P - (P @ weight)[:, None]
    E = (away * weight) @ away.T + _FLAT**2 * np.eye(2)
    E = E * float(np.einsum("in,ij,jn->n", away, np.linalg.inv(E), away).max())
    return middle + extent * complex(*(P @ weight)), E * extent**2
