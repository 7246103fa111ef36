"""Finding the values of all consistent systems at one frequency: few directions, more where the farthest corner asks for them."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from robustid.core import Budget, Complex, Pieces, Real
from robustid.guarantees.consistent_set import ConsistentSet, Entry, Extreme, independent_entries
from robustid.guarantees.outline import Outline
from robustid.guarantees.value_set import FINE, ValueSet, along, directions_at
from robustid.identification import Functional
from robustid.identification.solver import Place

_FIRST = 4  # directions of an entry of a matrix to begin with
# Gaps from corners to what is reached: in a part, by consistent systems, for singular values.
_WITHIN, _ALL, _SHARP = 2.5, 5.0, 1.0
_FINER = 0.25  # part of the gap, where the largest singular value asks for it
_WORTH = 3.0  # gaps that tighter bounds of the entries may make up for
_NEARLY = 2.0  # gaps of systems that are far in several entries from what there is
_FEW = 3  # signals with which one system may be far in all entries
_NEAR = np.radians(100.0)  # angle between sides from which one between them starts
_STARTS, _STEPS = 12, 4  # of the search for a large singular value: among reached values, and among consistent systems


def bisected(count: int) -> list[int]:
    """The numbers of equally spaced directions: four far apart first, then those between two that are there, and so on."""
    order = sorted({round(k * count / _FIRST) % count for k in range(_FIRST)}) if count > _FIRST else list(range(count))
    while len(order) < count:
        there = sorted(order)
        ends = zip(there, [*there[1:], there[0] + count], strict=True)
        order += [(first + (last - first) // 2) % count for first, last in ends if last - first > 1]
    return order


def value_sets_at(
    consistent: ConsistentSet,
    omega: float,
    directions: int,
    gap: float,
    about: Complex | None = None,
    budget: Budget | None = None,
) -> tuple[ValueSet, ...]:
    """Support function and attained points at one frequency, of every independent entry.

    SISO: in all directions. MIMO: in as many as the corner of every polygon that is farthest from a nominal value `about` (ny, nu)
    asks for; by default the value at the centre. Nothing where the budget is over before its end.
    """
    here = consistent.with_node(omega)
    single = here.posed.problem.entries.single
    angles = directions_at(omega, here.posed.problem.dt, directions if single else FINE * directions)
    search = _Search(here, omega, angles, gap, about, Pieces(budget))
    try:
        return (search.siso(),) if single else search.mimo()
    except _TimeIsOver:
        return ()


def value_set(
    consistent: ConsistentSet, omega: float, directions: int, gap: float, told: Callable[[], None] | None = None
) -> ValueSet:
    """Support function and attained points at one frequency of a SISO plant; `told` is called after every direction."""
    here = consistent.with_node(omega)
    return _Search(here, omega, directions_at(omega, here.posed.problem.dt, directions), gap, None, Pieces(None)).siso(
        told
    )


class _TimeIsOver(Exception):
    """The end of a search whose next program would take longer than the time that is left."""


class _Search:
    """The values of all entries at one frequency."""

    def __init__(
        self, here: ConsistentSet, omega: float, angles: Real, gap: float, about: Complex | None, pieces: Pieces
    ) -> None:
        self._here, self._omega, self._angles, self._gap, self._about = here, omega, angles, gap, about
        self._pieces = pieces
        entries = here.posed.problem.entries
        self._entries, self._shape = entries, entries.shape
        parts = [here.value_weights(omega, entry) for entry in np.ndindex(*self._shape)]
        self._x, self._p, self._tail = (np.stack(part) for part in zip(*parts, strict=True))
        self._members: list[Complex] = []
        self._enough = 1 - _ALL * gap

    def _begin(self) -> ConsistentSet:
        """The set for one more program, if there is time for it."""
        if not self._pieces.begins():
            raise _TimeIsOver
        return self._here

    def siso(self, told: Callable[[], None] | None = None) -> ValueSet:
        """The only entry, in all directions."""
        sides: dict[int, Extreme] = {}
        for direction in bisected(self._angles.size):
            functional, near = self._functional((0, 0), direction), self._beside(sides, direction)
            sides[direction] = self._begin().extreme(functional, self._gap, near=near, early=True)
            if told is not None:
                told()
        found, tail = [sides[k] for k in range(self._angles.size)], self._tail[0]
        points = np.array([self._value(one)[0, 0] for one in found])
        support, proofs = np.array([one.upper for one in found]), tuple(one.certificate for one in found)
        return ValueSet(self._omega, self._angles, support, points, float(tail), proofs)

    def _beside(self, sides: dict[int, Extreme], direction: int) -> Place | None:
        """A place on the way to an extreme from those of the sides next to it; None where they are too far apart.

        The functional is a sum of theirs with positive factors. So are its multipliers, and of 16 directions the last eight take
        one or two steps each where those from the centre take ten.
        """
        if not sides:
            return None
        turn = (self._angles - self._angles[direction]) % (2 * np.pi)
        after, before = min(sides, key=lambda k: turn[k]), max(sides, key=lambda k: turn[k])
        ahead, back = turn[after], 2 * np.pi - turn[before]
        first, last = sides[before].place, sides[after].place
        if not ahead + back <= _NEAR or first is None or last is None:
            return None
        weights = np.sin([ahead, back]) / np.sin(ahead + back)
        return Place.between([(float(weights[0]), first), (float(weights[1]), last)])

    def mimo(self) -> tuple[ValueSet, ...]:
        """All entries: bounds first, then systems that come near to them.

        Systems far in the largest singular value and far in several entries do for most; else each entry's own, and where these
        stay away from a bound that was found in a part of the problem, bounds from all of it.
        """
        polygons = [self._polygon(entry) for entry in independent_entries(self._entries)]
        self._climb(self._largest_reached(polygons), polygons)
        wide = max(self._shape)
        # All entries together; then those that share no signal, which the ball ties less.
        for apart in (None, *range(wide)) if wide <= _FEW else range(wide):
            missing = [one for one in polygons if not self._met(one)]
            if apart is not None:
                missing = [one for one in missing if (one.entry[1] - one.entry[0]) % wide == apart]
            if missing:
                self._find(self._together(missing), _NEARLY * self._gap)
        for one in polygons:
            self._close(one)
        if not self._near(polygons):
            for one in polygons:
                self._sharpen(one, _SHARP)
        # What is farther away is so because the ball ties the entries, which tighter bounds of each don't show.
        if self._enough - _WORTH * self._gap <= self._sigma / self._norm(polygons) < self._enough:
            self._refine(polygons)
        return tuple(self._value_set(one) for one in polygons)

    def _refine(self, polygons: list[Outline]) -> None:
        """More directions around the farthest corners, and tighter bounds there; then systems with larger singular values."""
        self._gap *= _FINER
        for one in polygons:
            one.step = 1
            for direction in one.far(1 - self._gap / _FINER):
                self._side(one, direction)
            self._sharpen(one, _SHARP)
        self._climb(self._largest_reached(polygons), polygons)

    def _climb(self, error: Complex, polygons: list[Outline]) -> None:
        """Consistent systems with ever larger singular values: each is extreme along the singular vectors of the one before."""
        for _ in range(_STEPS):
            before, found = self._sigma, self._find(self._along_vectors(error), self._gap)
            if found is None or self._near(polygons) or self._sigma <= (1 + self._gap) * before:
                return
            error = found - self._origin

    def _near(self, polygons: list[Outline]) -> bool:
        """Say whether a consistent system is near to the bound of the largest singular value."""
        return self._sigma >= self._enough * self._norm(polygons)

    @property
    def _sigma(self) -> float:
        """Largest singular value that was found of the difference from the origin."""
        return max((float(np.linalg.norm(one - self._origin, 2)) for one in self._members), default=0.0)

    def _norm(self, polygons: list[Outline]) -> float:
        """Its bound from those of the entries."""
        return float(np.linalg.norm(self._matrix({one.entry: one.radius for one in polygons}), 2))

    @functools.cached_property
    def _origin(self) -> Complex:
        """Point from which distances are counted."""
        return self._response(self._here.center.x, self._here.center.p) if self._about is None else self._about

    def _value(self, found: Extreme) -> Complex:
        """The whole value of the system that attains an extreme; NaN where there is none."""
        if not np.isfinite(found.attained):
            return np.full(self._shape, np.nan, complex)
        return self._response(found.x, found.p)

    def _find(self, functional: Functional, gap: float) -> Complex | None:
        """The value of a consistent system that is almost extreme, one of the members from now on."""
        point = self._begin().member(functional, gap)
        if point is not None:
            self._members.append(self._response(*point))
        return None if point is None else self._members[-1]

    def _response(self, x: Real, p: Real) -> Complex:
        return np.asarray(self._x @ x + self._p @ p, dtype=complex).reshape(self._shape)

    def _functional(self, entry: Entry, direction: int) -> Functional:
        k = int(np.ravel_multi_index(entry, self._shape))
        return along(self._angles[direction], self._x[k], self._p[k], self._tail[k])

    def _polygon(self, entry: Entry) -> Outline:
        """A few sides, and more until the farthest corner is near to a value that is reached."""
        polygon, count = Outline(entry, self._angles, complex(self._origin[entry])), self._angles.size
        polygon.step = FINE if count > 2 else 1
        count //= polygon.step
        first = {round(k * count / _FIRST) % count for k in range(_FIRST)} if count > _FIRST else range(count)
        for direction in (k * polygon.step for k in first):
            self._side(polygon, direction)
        self._sharpen(polygon, _WITHIN)
        return polygon

    def _sharpen(self, polygon: Outline, within: float) -> None:
        """Cut corners off, from the part of the problem that sees the entry; the farthest is so many gaps from what is reached."""
        while polygon.extent < (1 - within * self._gap) * polygon.radius:
            direction = polygon.between
            if direction is None or direction in polygon.sides:
                return
            self._side(polygon, direction)

    def _side(self, polygon: Outline, direction: int, whole: bool = False) -> None:
        """Add a side, or the bound and the system from the whole problem to one that is there."""
        functional, before = self._functional(polygon.entry, direction), polygon.sides.get(direction)
        found = None if whole else self._begin().bounded(functional, self._gap)
        if found is None:
            found = self._begin().extreme_of_all(functional, self._gap)
            if np.isfinite(found.attained):
                self._members.append(self._value(found))
            polygon.whole.add(direction)
        reached = complex(self._value(found)[polygon.entry])
        side = found if before is None or found.upper <= before.upper else found.proved_by(before)
        polygon.add(direction, side, polygon.origin if np.isnan(reached) else reached)

    def _met(self, polygon: Outline) -> bool:
        """Say whether a consistent system is near to the farthest corner."""
        errors = [abs(member[polygon.entry] - polygon.origin) for member in self._members]
        return max(errors, default=0.0) >= self._enough * polygon.radius

    def _close(self, polygon: Outline) -> None:
        """Bounds and systems from the whole problem, where they are farthest apart."""
        while not self._met(polygon):
            near = polygon.farthest, *polygon.beside, polygon.between
            left = [k for k in near if k is not None and k not in polygon.whole]
            if not left:
                return
            self._side(polygon, left[0], whole=True)

    def _largest_reached(self, polygons: list[Outline]) -> Complex:
        """An error with a large singular value that reached values of the entries make together.

        Of every entry the value that is farthest in the direction of the singular vectors, whose vectors again: each step is
        upwards. From errors of one phase, and from several of random ones.
        """
        rng = np.random.default_rng(0)
        values = {one.entry: np.array([one.reached[k] - one.origin for k in one.order]) for one in polygons}
        best = np.zeros(self._shape, complex)
        for start in range(_STARTS):
            left, right = (np.exp(2j * np.pi * rng.random(size) * (start > 0)) for size in self._shape)
            error, size = best * 0, -1.0
            while (larger := float(np.linalg.norm(error, 2))) > size * (1 + 1e-9):
                size = larger
                wanted = np.outer(left, right).conj()
                error = self._matrix({at: v[np.argmax(np.real(complex(wanted[at]) * v))] for at, v in values.items()})
                U, _, V = np.linalg.svd(error)
                left, right = U[:, 0], V[0]
            best = error if size > np.linalg.norm(best, 2) else best
        return best

    def _along_vectors(self, error: Complex) -> Functional:
        """Re u'Fv with the first singular vectors of an error."""
        left, _, right = np.linalg.svd(error)
        weights = np.outer(left[:, 0].conj(), right[0].conj()).ravel()
        tail = float(np.abs(weights) @ self._tail)
        return Functional(np.real(weights @ self._x), np.real(weights @ self._p), tail)

    def _matrix(self, values: dict[Entry, complex]) -> Complex:
        """The matrix of values of the independent entries."""
        out = np.zeros(self._shape, complex)
        for (i, j), value in values.items():
            out[i, j] = value
            if self._entries.symmetric:
                out[j, i] = value
        return out

    def _together(self, polygons: list[Outline]) -> Functional:
        """The sum over entries of Re(exp(-j theta) F), each in the direction of its farthest value and in its units.

        Its unit is the distance of that value, or of the farthest corner where no value was found.
        """
        parts = [self._functional(one.entry, one.farthest) for one in polygons]
        size = [1 / (one.extent or one.radius) for one in polygons]
        x, p = (sum(s * getattr(part, name) for s, part in zip(size, parts, strict=True)) for name in ("x", "p"))
        tail = float(sum(s * part.tail for s, part in zip(size, parts, strict=True)))
        return Functional(np.asarray(x), np.asarray(p), tail)

    def _value_set(self, polygon: Outline) -> ValueSet:
        order, nothing = polygon.order, np.full(self._shape, np.nan, complex)
        values = {k: self._value(polygon.sides[k]) if k in polygon.whole else nothing for k in order}
        # The system that is farthest from the origin in this entry, and one in the largest singular value.
        far = max(self._members, key=lambda one: abs(one[polygon.entry] - polygon.origin), default=nothing)
        apart = max(self._members, key=lambda one: float(np.linalg.norm(one - self._origin, 2)), default=nothing)
        matrices = np.array([*(values[k] for k in order), far, apart])
        points = matrices[: len(order), *polygon.entry]
        k = int(np.ravel_multi_index(polygon.entry, self._shape))
        proofs = tuple(polygon.sides[k].certificate for k in order)
        sides = polygon.angles[order], polygon.support, points, float(self._tail[k]), proofs
        return ValueSet(self._omega, *sides, polygon.entry, matrices)
