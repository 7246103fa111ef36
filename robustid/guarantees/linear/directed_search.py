"""The search for certificates of directions: steps of Newton, all directions of a target at once. Nothing of it is trusted."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Real
from robustid.guarantees.linear.certificate import Targets, targets_at
from robustid.guarantees.linear.directed import (
    DirectedBand,
    Measure,
    SeenRows,
    Sides,
    directions,
    kernels,
    seen_rows,
    supports,
)
from robustid.guarantees.linear.further_points import further_points
from robustid.guarantees.linear.polygon_discs import corners_of_supports, smallest_discs
from robustid.guarantees.linear.smoothed import Norms, Smoothed

_SIDES = 16  # directions
# Smoothing of the steps, as parts of the mean term of a bound: from multipliers of a knot beside, whose points are others, as many
# steps would be needed.
_LEVELS = np.geomspace(2, 0.01, 12).tolist()
# The nearest lines, others ever farther apart, some that are spread over all of them, and the nearest polygons.
_POINTS, _FARTHER, _SPREAD, _NODES = 3, 21, 4, 8
_FIRST_ROWS, _SPREAD_ROWS = 8, 16  # samples of records
_EXCHANGES = 2  # rounds in which they, and lines, become others
_PAYS = 0.998  # of a radius: multipliers with polygons are taken where they are below, and sought farther on
_FUNCTIONS = 12  # of the class, of each of which it is weighed what is missed; of the others together
_FEWEST = 24  # angles, where the time is short, and after which it is seen
_WORTH = 0.97  # whether certificates of directions pay: of the radii of discs
_LAST = 3  # iterates that are evaluated
_FEW = 6  # of the levels, from multipliers that are good already
_ROUNDS = 40  # of the smallest ellipses
_FLAT = 1e-9  # of an extent: the least one of an ellipse
_HALVINGS = 4  # of arcs:
_WIDE, _LOOSE = 1.0, 1.02  # those that are so much wider in the middle than at their ends, and than a search there

Directed = tuple[NDArray[np.intp], Complex, Real]  # points (n,), multipliers (M, n), bounds (M,)


def directed_band(
    sides: Sides, angles: Real, least: float, budget: Budget, discs: Real | None = None
) -> DirectedBand | None:
    """Search certificates at angles, and between them where mixing loses, on arcs above `least`.

    At those of the angles that there is time for, spread over all; None where it is hardly any, or where the first ones gain little
    over the radii of `discs` at the angles.
    """
    search, targets = DirectedSearch(sides, directions(_SIDES)), targets_at(sides.samples, angles)
    found: dict[int, Directed] = {}
    # The ends, every 2^k-th one, and so on to all of them: whenever the time ends, those that were searched are spread.
    for k in sorted(range(angles.size), key=lambda k: -(k & -k) if 0 < k < angles.size - 1 else -angles.size):
        if budget.over:
            break
        found[k] = search.at(targets[k : k + 1])
        if discs is not None and len(found) == _FEWEST and _gained(found, discs) > _WORTH:
            return None
    if len(found) < min(_FEWEST, angles.size):
        return None
    places = sorted(found)
    points, c, _ = map(np.array, zip(*(found[k] for k in places), strict=True))
    band = DirectedBand(sides, angles[places], points, c.astype(np.complex64))
    return _halved_arcs(search, band, np.arange(len(places) - 1), least, budget)


def _gained(found: dict[int, Directed], discs: Real) -> float:
    """Radii that were found over those of discs, in the median."""
    bounds = np.array([bounds for *_, bounds in found.values()])
    with np.errstate(invalid="ignore"):
        return float(np.median(smallest_discs(corners_of_supports(bounds))[1] / discs[list(found)]))


def around_nodes(before: DirectedBand, sides: Sides, nodes: Real, least: float, budget: Budget) -> DirectedBand:
    """The band of the lines with polygons among its samples: at their angles, and from each of them on as far as that gains."""
    search = DirectedSearch(sides, before.turns)
    band = _beside_nodes(before, search)
    apart = nodes[np.abs(band.angles[:, None] - nodes).min(axis=0) > least]
    band, new = _with_knots(search, band, apart, budget)
    beside = np.abs(band.angles[:, None] - nodes).min(axis=1) <= least
    band, changed = _outwards(search, band, new, beside & ~new, budget)
    if budget.seconds is not None:
        return searched_further(band, least, budget)
    return _halved_arcs(search, band, np.flatnonzero(changed[:-1] | changed[1:]), least, budget)


def _with_knots(
    search: DirectedSearch, band: DirectedBand, angles: Real, budget: Budget
) -> tuple[DirectedBand, NDArray[np.bool_]]:
    """The band with further knots, of which one is searched at least, and a mask of these."""
    chosen: list[Directed] = []
    for k in range(angles.size):
        if chosen and budget.over:
            break
        chosen.append(search.at(targets_at(band.samples, angles[k : k + 1])))
    if not chosen:
        return band, np.zeros(band.angles.size, bool)
    own = angles[: len(chosen)]
    at = np.searchsorted(band.angles, own)
    points, c, _ = map(np.array, zip(*chosen, strict=True))
    new = np.insert(np.zeros(band.angles.size, bool), at, True)
    rows = np.insert(band.points, at, points, axis=0), np.insert(band.multipliers, at, c.astype(np.complex64), axis=0)
    return DirectedBand(band.sides, np.insert(band.angles, at, own), *rows), new


def searched_further(band: DirectedBand, least: float, budget: Budget) -> DirectedBand:
    """The band with more knots where mixing loses: what the time did not suffice for before."""
    arcs = np.arange(band.angles.size - 1)
    return _halved_arcs(DirectedSearch(band.sides, band.turns), band, arcs, least, budget)


def _beside_nodes(before: DirectedBand, search: DirectedSearch) -> DirectedBand:
    """The same certificates as those of lines and of the nearest nodes, which they don't use."""
    bases = targets_at(search.sides.samples, before.angles).base.tolist()
    nodes = np.array([search.nearest_nodes(base) for base in bases])
    none = np.zeros((*before.multipliers.shape[:2], nodes.shape[1]), np.complex64)
    points, c = np.concatenate([before.points, nodes], axis=1), np.concatenate([before.multipliers, none], axis=2)
    return DirectedBand(search.sides, before.angles, points, c)


def _outwards(
    search: DirectedSearch, band: DirectedBand, new: NDArray[np.bool_], beside: NDArray[np.bool_], budget: Budget
) -> tuple[DirectedBand, NDArray[np.bool_]]:
    """The band with searches from `new` knots on, and those `beside` nodes, one after the other, until they don't gain.

    And a mask of the knots that are others now.
    """
    points, c, changed, tried = np.array(band.points), np.array(band.multipliers), new.copy(), new.copy()
    targets, radius = targets_at(band.samples, band.angles), band.radius
    fronts = [(int(k), step) for k in np.flatnonzero(new) for step in (-1, 1)]
    fronts += [(int(k), 0) for k in np.flatnonzero(beside)]
    while fronts and not budget.over:
        onwards: list[tuple[int, int]] = []
        for before, step in fronts:
            k = before + step
            if not 0 <= k < tried.size or tried[k] or budget.over:
                continue
            tried[k] = True
            chosen, multipliers, bounds = search.at(targets[k : k + 1])
            if smallest_discs(corners_of_supports(bounds[None]))[1][0] < _PAYS * radius[k]:
                points[k], c[k], changed[k] = chosen, multipliers, True
                onwards += [(k, way) for way in ((step,) if step else (-1, 1))]
        fronts = onwards
    return DirectedBand(band.sides, band.angles, points, c), changed


def _halved_arcs(
    search: DirectedSearch, band: DirectedBand, arcs: NDArray[np.intp], least: float, budget: Budget
) -> DirectedBand:
    """The band with knots in the middle of those arcs where mixing loses, and of their halves, on arcs above `least`."""
    for _ in range(_HALVINGS):
        arcs = arcs[np.diff(band.angles)[arcs] > least]
        if not arcs.size:
            break
        middle = (band.angles[arcs] + band.angles[arcs + 1]) / 2
        radius, between = band.radius, band.at(middle)[1]
        with np.errstate(invalid="ignore"):
            loss = between / ((radius[arcs] + radius[arcs + 1]) / 2)
        worst = np.argsort(-loss, kind="stable")
        worst = worst[loss[worst] > _WIDE]  # the time may end before the others
        arcs, middle, between = arcs[worst], middle[worst], between[worst]
        if not arcs.size or budget.over:
            break
        band, arcs = _halved(search, band, arcs, middle, between, budget)
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
        """Centres (N,) and shapes E (N, 2, 2) of ellipses around what is known at points and in rows: Re(c m) + sqrt(g'Eg)."""
        sides, samples = self.sides, self.sides.samples
        centre = sides.y - sides.values @ self._centres
        E = (sides.bound + sides.left_out)[:, None, None] ** 2 * np.eye(2)
        for k, corners in enumerate(sides.corners, sides.first_node):
            middle, shape = smallest_ellipse(corners)
            centre[k] += middle - samples.y[k]
            E[k] = shape + sides.left_out[k] ** 2 * np.eye(2)
        return centre, E

    @functools.cached_property
    def _centres(self) -> Complex:
        return self.sides.extraction.known.coefficients(self.sides.samples)[0]

    def nearest(self, base: complex) -> NDArray[np.intp]:
        """Numbers of the points for a target, rising: the nearest lines, others ever farther apart, some of all, nodes; and rows.

        By the hyperbolic distance. Those that are spread over all lines matter to targets beyond them.
        """
        # by their distance, those behind that do not see the entry
        z = self.sides.samples.nodes[: self.sides.first_node]
        lines = np.argsort(np.abs((z - base) / (1 - base.conjugate() * z)) + ~self._seen)
        if lines.size > _POINTS + _FARTHER + _SPREAD:
            others = lines[~np.isin(lines, self._spread)]
            far = np.geomspace(_POINTS, others.size, _FARTHER + 1)[:-1].astype(int)
            near = others[np.unique(np.concatenate([np.arange(_POINTS), far]))]
            lines = np.concatenate([near, self._spread])
        return np.sort(np.concatenate([self._few_rows, lines, self.nearest_nodes(base)]))

    @functools.cached_property
    def _few_rows(self) -> NDArray[np.intp]:
        """Numbers of samples of records: the first ones, which see the class most, and some that are spread over all of them."""
        count = self.sides.samples.rows
        if count <= _FIRST_ROWS + _SPREAD_ROWS:
            return np.arange(-count, 0)
        spread = np.linspace(_FIRST_ROWS, count - 1, _SPREAD_ROWS).round().astype(int)
        return np.unique(np.concatenate([np.arange(_FIRST_ROWS), spread])) - count

    def nearest_nodes(self, base: complex) -> NDArray[np.intp]:
        """Numbers of the nearest polygons."""
        first = self.sides.first_node
        z = self.sides.samples.nodes[first : self.sides.half]
        return first + np.argsort(np.abs((z - base) / (1 - base.conjugate() * z)))[:_NODES]

    @functools.cached_property
    def _seen(self) -> NDArray[np.bool_]:
        samples = self.sides.samples
        return np.asarray(samples.v[: self.sides.first_node, samples.target] != 0)

    @functools.cached_property
    def _spread(self) -> NDArray[np.intp]:
        """Numbers of lines that are spread over all that see the entry, the denser, the nearer to their ends."""
        lines = np.flatnonzero(self._seen) if self._seen.sum() > _SPREAD else np.arange(self._seen.size)
        part = (1 - np.cos(np.pi * np.linspace(0, 1, _SPREAD))) / 2
        return lines[np.unique((part * (lines.size - 1)).round().astype(int))]

    def at(self, target: Targets) -> Directed:
        """The nearest points for one target, with multipliers and bounds; beside records others that gain more."""
        base = complex(target.base[0])
        points = self.nearest(base)
        c, bounds = self.search(target, points)
        lines, every = int(np.sum((points >= 0) & (points < self.sides.first_node))), [(points, c, bounds)]
        for _ in range(_EXCHANGES if self.sides.samples.rows else 0):
            further = further_points(self.sides, target, points, c, self.turns, lines)
            others = np.concatenate([further, self.nearest_nodes(base)])
            points, (c, bounds) = others, self.search(target, others, moved(points, c, others))
            every.append((points, c, bounds))
        radius = smallest_discs(corners_of_supports(np.array([bounds for *_, bounds in every])))[1]
        return every[int(np.argmin(np.where(np.isnan(radius), np.inf, radius)))]

    def search(self, target: Targets, points: NDArray[np.intp], start: Complex | None = None) -> tuple[Complex, Real]:
        """Multipliers (M, n) of points for one target, and bounds (M,): the best of the last ones; from a start in fewer steps."""
        sides, n = self.sides, points.size
        centre, E = self._ellipses
        rows, rest = _grouped(*self._rows(target, points))
        bound = Smoothed([self._norms(target, points), *rest], rows, centre[points], E[points])
        x = np.zeros((self.turns.size, 2 * n)) if start is None else np.concatenate([start.real, start.imag], axis=1)
        tried: list[Complex] = []
        levels = _LEVELS if start is None else _LEVELS[-_FEW:]
        for step, level in enumerate(levels):
            try:
                x = bound.step(x, level)
            except np.linalg.LinAlgError:  # a singular one of the stack: what is best so far stays
                break
            if step >= len(levels) - _LAST:
                tried.append((x[:, :n] + 1j * (points >= 0) * x[:, n:]).astype(np.complex64).astype(complex))
        if not tried:
            return np.zeros((self.turns.size, n), complex), np.full(self.turns.size, np.inf)
        total = supports(sides, target, points, np.concatenate(tried)[None], np.tile(self.turns, len(tried)))
        total = np.where(np.isnan(total), np.inf, total).reshape(len(tried), -1)
        best, at = total.argmin(axis=0), np.arange(self.turns.size)
        return np.where(np.isfinite(total[best, at])[:, None], np.array(tried)[best, at], 0), total[best, at]

    def _norms(self, target: Targets, points: NDArray[np.intp]) -> tuple[Real, Real, Real]:
        """|r|^2 = square - 2 cross x + x'Qx in x = (Re c, Im c): (2n, 2n), (M, 2n), (M,)."""
        samples, base, measure = self.sides.samples, complex(target.base[0]), Measure(complex(target.base[0]))
        rows, points = points[points < 0], points[points >= 0]
        z, w = samples.nodes[points], samples.weights[points]
        h, at = measure.outer(z), complex(measure.outer(np.array(base)))
        A, B = (one * h[:, None] for one in kernels(z, w, z, w))
        A, B = A * h.conj(), B * h
        Q = np.block([[A.real + B.real, A.imag - B.imag], [-A.imag - B.imag, A.real - B.real]]) / 2
        own, tau = w[:, samples.target], (target.weight[0] * at * self.turns)[:, None]
        onto, other = tau * (h * own).conj() / (1 - base * z.conj()), tau * h * own / (1 - base * z)
        cross = np.concatenate([(onto + other).real, (onto - other).imag], axis=1) / 2
        square = np.abs(tau) ** 2 / (1 - abs(base) ** 2) + (tau**2 / (1 - base**2)).real
        if rows.size:
            Q, cross = self._with_rows(seen_rows(samples, rows, measure), Q, cross, (z, w * h[:, None]), (base, tau))
        return Q, cross, np.maximum(square[:, 0] / 2, 1e-300)

    def _with_rows(
        self, seen: SeenRows, Q: Real, cross: Real, at_points: tuple[Complex, Complex], target: tuple[complex, Complex]
    ) -> tuple[Real, Real]:
        """The same with the real parts of the multipliers of rows, which stand before those of the points."""
        samples, (base, tau), T = self.sides.samples, target, len(seen.gram)
        onto, n = seen.at(*at_points), len(Q) // 2
        at_target = (tau * seen.of_entry(base, samples.target)).real  # (M, T)
        order = np.concatenate([np.arange(T), 2 * T + np.arange(n), T + np.arange(T), 2 * T + n + np.arange(n)])
        beside = np.concatenate([onto.real, -onto.imag], axis=1)
        none = np.zeros((T, T))
        every = np.block([[seen.gram, none, beside], [none, none, 0 * beside], [beside.T, 0 * beside.T, Q]])
        crossed = np.concatenate([at_target, 0 * at_target, cross], axis=1)
        return every[np.ix_(order, order)], crossed[:, order]

    def _rows(self, target: Targets, points: NDArray[np.intp]) -> tuple[Real, Real]:
        """Rows J (2k, 2n) and values (M, 2k) of real and then imaginary parts of what is missed of the functions, times radii."""
        sides, (own, twin) = self.sides, self.sides.twins
        radius = sides.extraction.known.coefficients(sides.samples)[1]
        V, wanted = sides.values[points].T, self.turns[:, None] * target.values[0]
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


def moved(points: NDArray[np.intp], c: NDArray[np.complexfloating], others: NDArray[np.intp]) -> Complex:
    """Multipliers (M, n) of points (n,) for others, (M, k): 0 for those that are new."""
    start = np.zeros((len(c), others.size), complex)
    _, here, there = np.intersect1d(others, points, assume_unique=True, return_indices=True)
    start[:, here] = c[:, there]
    return start


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
