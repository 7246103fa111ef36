"""Cells of a pole-uncertainty box as trees: halved at a frequency where their systems are farthest from the model.

What a cell says comes from sums of one direction each over the samples, with amplitudes of its own.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Pieces, Real
from robustid.errors import InconsistentDataError
from robustid.guarantees.amplitude_bounds import modes_by_frequency
from robustid.guarantees.candidates import in_units
from robustid.guarantees.linear.certificate import Targets, targets_at
from robustid.guarantees.linear.directed import DirectedBand, directions, left_by_series
from robustid.guarantees.linear.directed_search import DirectedSearch, moved
from robustid.guarantees.linear.further_points import further_points
from robustid.guarantees.linear.polygon_discs import corners_of_supports
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.pole_proofs import RefutedBySums, SummedCell, is_empty, sides_of
from robustid.identification import MixedProblem

if TYPE_CHECKING:
    import control

_SIDES = 16  # directions
_POINTS, _ROUNDS = 40, 2  # of a sum; rounds in which those of the whole box become others
_DEEP, _LESS = (
    3,
    0.99,
)  # parts of a cell after so many halvings must have less than that times its error, for more of them


class Polygon(NamedTuple):
    """Points (n,), multipliers (M, n) and bounds (M,): the sides of an entry of a cell at one frequency."""

    points: NDArray[np.intp]
    multipliers: NDArray[np.complex64]
    bounds: Real


class Branch:
    """A cell, what is known of it, and its halves by the mode that was halved.

    Attributes
    ----------
    found : dict
        Polygons of all entries by frequency, rad/s.
    refuted : bool
        Sums of two opposite directions contradict each other: no system has its poles in the cell.
    """

    def __init__(self, problem: MixedProblem, cell: PoleCell, whole: Branch | None = None) -> None:
        self.problem, self.cell, self._whole = problem, cell, whole
        self.found: dict[float, tuple[Polygon, ...]] = {}
        self.refuted = False
        self._halves: dict[int, tuple[Branch, ...]] = {}
        self._points: dict[tuple[int, float], NDArray[np.intp]] = {}

    @functools.cached_property
    def _searches(self) -> list[DirectedSearch]:
        return [DirectedSearch(sides_of(one), directions(_SIDES)) for one in self.cell.proofs]

    def solve(self, omega: float, nominal: Complex) -> None:
        """Search the polygons of all entries at a frequency, about nominal values (ny, nu).

        From those of the smallest cell that holds it and has some there, or from nothing.
        """
        if omega in self.found:
            return
        whole, count = self._whole, len(self._searches)
        while whole is not None and omega not in whole.found:
            whole = whole._whole
        if whole is None:
            every = [self._first(k, omega, nominal) for k in range(count)]
        else:
            every = [
                self._searched(k, omega, whole.further(k, omega, nominal), whole.found[omega][k]) for k in range(count)
            ]
        self.found[omega] = tuple(every)
        self.refuted |= any(is_empty(one.bounds) for one in every)

    def _first(self, entry: int, omega: float, nominal: Complex) -> Polygon:
        """The polygon from the points nearest to a frequency, with some rounds of further ones."""
        search = self._searches[entry]
        target = self._target(omega, entry)
        found = self._searched(entry, omega, search.nearest(complex(target.base[0])))
        for _ in range(_ROUNDS):
            found = self._searched(entry, omega, self._further(entry, omega, nominal, found))
        return found

    def _target(self, omega: float, entry: int) -> Targets:
        return targets_at(self._searches[entry].sides.samples, self.problem.plane.angles(np.array([omega])))

    def _searched(self, entry: int, omega: float, points: NDArray[np.intp], before: Polygon | None = None) -> Polygon:
        start = None if before is None else moved(before.points, before.multipliers, points)
        c, bounds = self._searches[entry].search(self._target(omega, entry), points, start)
        return Polygon(points, c.astype(np.complex64), bounds)

    def further(self, entry: int, omega: float, nominal: Complex) -> NDArray[np.intp]:
        """Points for the halves of the cell."""
        if (entry, omega) not in self._points:
            self._points[entry, omega] = self._further(entry, omega, nominal, self.found[omega][entry])
        return self._points[entry, omega]

    def _further(self, entry: int, omega: float, nominal: Complex, found: Polygon) -> NDArray[np.intp]:
        """Points for the directions on both sides of the farthest corner."""
        search = self._searches[entry]
        value = complex(nominal[search.sides.samples.entry])
        corner = int(np.argmax(np.abs(corners_of_supports(found.bounds[None])[0] - value)))
        both = [corner, (corner + 1) % _SIDES]
        c = found.multipliers[both].astype(complex)
        return further_points(search.sides, self._target(omega, entry), found.points, c, search.turns[both], _POINTS)

    def errors(self, omega: float, nominal: Complex) -> Real:
        """Largest distances of the entries from nominal values (ny, nu), (ny, nu)."""
        found = np.zeros(nominal.shape)
        for proof, one in zip(self.cell.proofs, self.found[omega], strict=True):
            i, j = proof.samples.entry
            for place in {(i, j), (j, i)} if self.problem.entries.symmetric else {(i, j)}:
                far = np.abs(corners_of_supports(one.bounds[None]) - nominal[place])
                found[place] = np.inf if np.isnan(far).any() else far.max()
        return found

    def mode_left(self, omega: float, entry: int, nominal: complex) -> int:
        """Number of the mode of which the series leaves most in the direction in which an entry is farthest from a value."""
        search, one = self._searches[entry], self.found[omega][entry]
        samples = search.sides.samples
        k = int(np.argmax(one.bounds - (search.turns * nominal).real))
        target = self._target(omega, entry)
        c = one.multipliers[None, k : k + 1].astype(complex)
        left = left_by_series(search.sides, target, one.points, c, search.turns[k : k + 1])
        functions = samples.functions
        of_modes = left[: len(samples.components) * functions.amplitudes].reshape(-1, functions.amplitudes)
        return int(modes_by_frequency(samples.problem)[np.argmax(of_modes.sum(axis=0)[functions.fixed_count :])])

    def halves(self, mode: int) -> tuple[Branch, ...]:
        """Halves of a mode; none where their amplitudes have no bound."""
        if mode not in self._halves:
            cells = self.cell.split(self.problem, mode, hyperbolic=True) or ()
            self._halves[mode] = tuple(Branch(self.problem, cell, self) for cell in cells)
        return self._halves[mode]

    def kept(self, omega: Sequence[float]) -> SummedCell:
        """The cell with its polygons at frequencies, rising."""
        return SummedCell.of(self.problem, self.cell, np.array(omega), self._bands(omega))

    def refutation(self) -> RefutedBySums:
        """The proof that no system has its poles in the cell."""
        omega, entry = next(
            (w, k) for w, every in self.found.items() for k, one in enumerate(every) if is_empty(one.bounds)
        )
        return RefutedBySums(self.cell, self._bands([omega])[entry])

    def _bands(self, omega: Sequence[float]) -> tuple[DirectedBand, ...]:
        angles = self.problem.plane.angles(np.array(omega))
        every = zip(*(self.found[w] for w in omega), strict=True)
        return tuple(
            DirectedBand(
                search.sides, angles, np.array([one.points for one in own]), np.array([one.multipliers for one in own])
            )
            for search, own in zip(self._searches, every, strict=True)
        )


class PoleTree:
    """Cells of a box, of which those that hold the largest error at a frequency are halved; what they share is computed once."""

    def __init__(self, problem: MixedProblem, model: control.StateSpace, whole: PoleCell) -> None:
        self.problem, self.model, self.root = problem, model, Branch(problem, whole)
        self._branches = [self.root]

    @property
    def refuted(self) -> list[Branch]:
        """Cells that are proved not to contain the poles."""
        return [one for one in self._branches if one.refuted]

    def cover(
        self, omega: float, scale: Real, most: int, budget: Budget | None, start: Sequence[Branch] = ()
    ) -> list[Branch] | None:
        """So many branches at most that cover the box, without those that are refuted, with their polygons at a frequency.

        The one whose systems are farthest from the model, in units of `scale` (ny, nu), is halved next, for as long as that
        makes it smaller and there is time; None where there is none for the first ones: the whole box, or those that are to
        `start` with, where they say more.
        """
        pieces = Pieces(budget)
        nominal = self.problem.plane.values_at(self.model, np.array([omega]))[0]
        sizes, above = dict[Branch, float](), dict[Branch, list[Branch]]()
        for leaf in (self.root, *start):
            if not pieces.begins():
                return None
            leaf.solve(omega, nominal)
            sizes[leaf], above[leaf] = float(in_units(leaf.errors(omega, nominal), scale).max()), []
        leaves = best = self._left([self.root])
        if start and max(sizes[leaf] for leaf in start) < sizes[self.root]:
            leaves = best = self._left(start)
        while len(leaves) < most and pieces.begins():
            worst = max(leaves, key=sizes.__getitem__)
            before = above[worst][-_DEEP:]
            halves = self._halves(worst, omega, nominal, scale)
            if not halves or (len(before) == _DEEP and sizes[worst] > _LESS * sizes[before[0]]):
                break
            for half in halves:
                half.solve(omega, nominal)
                sizes[half], above[half] = (
                    float(in_units(half.errors(omega, nominal), scale).max()),
                    [*above[worst], worst],
                )
            leaves = self._left([*(leaf for leaf in leaves if leaf is not worst), *halves])
            best = min(best, leaves, key=lambda one: max(sizes[leaf] for leaf in one))
        return best

    def _halves(self, branch: Branch, omega: float, nominal: Complex, scale: Real) -> tuple[Branch, ...]:
        """Halves of the mode that matters at a frequency in the entry with the largest error."""
        errors = in_units(branch.errors(omega, nominal), scale)
        entry, place = max(
            ((k, one.samples.entry) for k, one in enumerate(branch.cell.proofs)), key=lambda one: errors[one[1]]
        )
        halves = branch.halves(branch.mode_left(omega, entry, complex(nominal[place])))
        self._branches += [half for half in halves if half not in self._branches]
        return halves

    def _left(self, leaves: Sequence[Branch]) -> list[Branch]:
        """Leave out those that are refuted."""
        left = [leaf for leaf in leaves if not leaf.refuted]
        if not left:
            raise InconsistentDataError(
                "no system with poles in the pole-uncertainty box fits the data: cells that cover it are refuted; loosen the"
                " bounds, the prior or the box"
            )
        return left
