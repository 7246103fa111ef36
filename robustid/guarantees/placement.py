"""Frequencies of the polygons of a band: where they are estimated to gain most over the discs, a few at a time."""

from __future__ import annotations

import abc
import time
from typing import TYPE_CHECKING, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Real, threads_for
from robustid.errors import InconsistentDataError, InputError
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.over_poles import Bounded, WorstCaseOverPoles
from robustid.guarantees.parameters import parameter_intervals
from robustid.guarantees.pole_cells import box_of
from robustid.guarantees.pole_proofs import KeptCell
from robustid.guarantees.pole_sweep import Searched, affordable, bounded, matters, searched
from robustid.guarantees.refinement import discs_of, in_order
from robustid.guarantees.sweep import Known, Means, value_sets
from robustid.guarantees.value_set import ValueSet, by_frequency, gap_of
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control

_GRID = 40  # further candidates, equally spaced
_MOST, _ROUND, _ROUND_OF_CELLS = 40, 8, 4  # frequencies, and of these so many before the next are chosen
_MANY = 4  # entries: of more all frequencies are chosen at once, since the search between them takes as long as they do
_GAIN = 1.05  # times the radius of the polygon: discs that are smaller are good enough
_BESIDE = 2  # neighbours of a frequency that are not chosen together with it
_CELLS, _SEARCH = 8, 0.25  # of a pole-uncertainty box, at most; part of the time in which they are found
_HALF = 0.5  # of the radius of a disc: what a polygon may be that nothing is known of
_TWICE = 2.0  # what the remainder of a cell adds to a polygon, in the samples and at its frequency, over itself
_SIDES = 16, 0.05  # directions of polygons and their tolerance: of exact poles,
_SIDES_OF_CELLS = 8, 0.1  # and of cells
_QUICK = 0.1  # of the time of their polygons: what discs between these may take, to choose the next ones
_BETWEEN = 0.2  # of the time: for the search between the polygons
_NO_TIME = 1e-9
_LEAST = 0.1  # of a polygon: what is its own, and not that of the relaxation


class Refinable(Known, Protocol):
    """A band that takes polygons."""

    def between(self, polygons: Bounded, budget: Budget | None) -> Self:
        """Return it with polygons, the search between them within a budget; without one a short search."""
        ...


B = TypeVar("B", bound=Refinable)


class Programs(abc.ABC):
    """Semidefinite programs of one statement, and the polygons that were found."""

    together: int  # frequencies that are chosen at once

    def __init__(self, identification: Identification, model: control.StateSpace) -> None:
        self.identification, self.model = identification, model
        self.entries = identification.problem.entries

    @abc.abstractmethod
    def solve(self, omega: Real, known: Known, means: Means) -> tuple[Real, Real]:
        """Find the polygons at frequencies; those that were looked at, (F,), and at least the radii there, (F, ny, nu)."""

    @abc.abstractmethod
    def polygons(self) -> Bounded | None:
        """Everything that was found; None where nothing was."""

    def added(self, omega: Real) -> Real:
        """Parts of the radii of polygons that the relaxation of the poles adds at frequencies, (F, ny, nu), approximately."""
        return np.zeros((omega.size, *self.entries.shape))


class OfExactPoles(Programs):
    """Poles as they are stated; of every solution at `least` so many frequencies whatever the time is."""

    together = _ROUND

    def __init__(
        self,
        identification: Identification,
        model: control.StateSpace,
        sides: tuple[int, float] = _SIDES,
        least: int = 1,
    ) -> None:
        super().__init__(identification, model)
        self._least = least
        self.consistent = consistent_set(identification)
        self._directions, rtol = sides
        self._gap = gap_of(rtol, self._directions, self.entries.single)
        self._values: dict[float, tuple[ValueSet, ...]] = {}

    def solve(self, omega: Real, known: Known, means: Means) -> tuple[Real, Real]:
        """As `Programs.solve`."""
        how = self._directions, self._gap, means, self.model, known, self._least
        found = by_frequency(value_sets(self.consistent, omega, *how))
        if not found:
            return omega[:0], np.zeros((0, *self.entries.shape))
        self._values |= found
        result = self.polygons()
        at = np.isin(result.omega, list(found))
        return result.omega[at], discs_of(result.kept, result.omega, self.entries)[1][at]

    def polygons(self) -> WorstCaseError:
        """As `Programs.polygons`."""
        values = tuple(one for w in sorted(self._values) for one in self._values[w])
        return WorstCaseError(
            identification=self.identification,
            model=self.model,
            values=values,
            parameters=parameter_intervals(self.consistent, None, Budget(_NO_TIME)),
            directions=self._directions,
            gap=self._gap,
        )


class OverBox(Programs):
    """Poles anywhere in a box, in few cells."""

    together = _ROUND_OF_CELLS

    def __init__(
        self, identification: Identification, model: control.StateSpace, box: Box, omega: Real, budget: Budget
    ) -> None:
        super().__init__(identification, model)
        problem = identification.problem
        self._whole, self._proofs = box_of(identification, *in_order(problem, box))
        directions, rtol = _SIDES_OF_CELLS
        self._sides = directions, gap_of(rtol, directions, self.entries.single)
        with threads_for(problem.coefficients):
            self._sets, self._refuted, self._each = self._cells(omega, budget)
        if not self._sets:
            raise InconsistentDataError(
                f"no system with poles in the pole-uncertainty box fits the data: all {len(self._refuted)} cells of it are"
                " refuted; loosen the bounds, the prior or the box"
            )
        if any(one is None for _, one in self._sets) and np.isfinite(self._each):
            raise InputError(
                "a cell of the pole-uncertainty box is so wide that no sample says anything of all its poles at once: the discs of"
                " `band` stand alone; measure more frequency points around the modes, or state a smaller box"
            )
        self._kept: list[dict[float, tuple[ValueSet, ...]]] = [{} for _ in self._sets]

    def _cells(self, omega: Real, budget: Budget) -> Searched:
        """As many cells as leave time for enough frequencies, and the seconds of one of them at one; infinite without time."""
        problem, begun = self.identification.problem, time.monotonic()
        margins = Budget(budget.seconds)
        sets, refuted = searched(problem, self._whole, omega, 1, budget, margins)
        # One frequency, with sides of every entry, takes longer.
        if budget.left < self.entries.count * (time.monotonic() - begun):
            return sets, refuted, np.inf
        narrow = omega[np.argsort(self._whole.slack(omega).max(axis=(1, 2)), kind="stable")]
        most, each = affordable(sets, narrow[: narrow.size // 2 + 1], self._sides, budget, self.model)
        if most > 1 and matters(self._whole, problem, omega):
            most = min(most, _CELLS)
            sets, refuted = searched(problem, self._whole, omega, most, budget.share(_SEARCH), margins)
            each = np.inf if margins.over else each
        return sets, refuted, each

    def added(self, omega: Real) -> Real:
        """As `Programs.added`: the remainder of the cells' expansions."""
        return _TWICE * np.max([cell.slack(omega) for cell, _ in self._sets], axis=0)

    def solve(self, omega: Real, known: Known, means: Means) -> tuple[Real, Real]:
        """As `Programs.solve`; a frequency at which a cell alone is as large as the known disc is looked at no further.

        Only so many, the first of them, as are finished in all cells by the end of the time.
        """
        if means.budget is not None and means.budget.seconds is not None:
            omega = omega[: max(int(means.budget.left / (self._each * len(self._sets))), 0)]
        omega = np.sort(omega)
        most = known.at(omega)[1] / _GAIN
        looked = np.full((omega.size, *self.entries.shape), np.nan)

        def pays(cell: KeptCell, here: Real) -> NDArray[np.bool_]:
            radius, at = discs_of((cell,), here, self.entries)[1], np.searchsorted(omega, here)
            looked[at] = np.fmax(looked[at], radius)
            return np.asarray((radius < most[at]).any(axis=(1, 2)))

        kept, grid = bounded(self._sets, omega, self._sides, means, self.model, known, pays)
        for mine, one in zip(self._kept, kept, strict=True):
            mine |= by_frequency(one.at(grid).values)
        seen = ~np.isnan(looked).all(axis=(1, 2))
        return omega[seen], looked[seen]

    def polygons(self) -> WorstCaseOverPoles | None:
        """As `Programs.polygons`."""
        omega = sorted(self._kept[0])
        if not omega:
            return None
        kept = tuple(
            KeptCell(tuple(one for w in omega for one in mine[w]), cell)
            for mine, (cell, _) in zip(self._kept, self._sets, strict=True)
        )
        return WorstCaseOverPoles(
            identification=self.identification,
            model=self.model,
            omega=np.array(omega),
            box=self._whole,
            kept=kept,
            refuted=tuple(self._refuted),
            extractions=self._proofs,
        )


def candidates_of(band: Known, problem: MixedProblem, omega: Real) -> Real:
    """Frequencies at which polygons are thought of: those of a band, and a grid, in the range of the data."""
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = band.range
    if lines.size:
        low, high = max(low, float(lines.min())), min(high, float(lines.max()))
    inside = omega[(omega >= low) & (omega <= high)]
    return np.union1d(inside, np.linspace(low, high, _GRID))


def placed(programs: Programs, band: B, candidates: Real, means: Means) -> B:
    """The band with polygons at those candidates, rising, where they gain most, until nothing or no time is left.

    Radii of polygons are estimated from those of the discs of the samples alone, times what those beside had in these units, and
    what the relaxation of the poles adds.
    """
    plain, added = band.at(candidates)[1], programs.added(candidates)
    tried = np.full(plain.shape, np.nan)  # radii, of those that were looked at
    found, count, joining = band, 0, 0.0
    polygons = joined = None
    # The search between the polygons, which ends where its time does.
    searching = 0.0 if means.budget is None or means.budget.seconds is None else _BETWEEN * means.budget.left
    size = programs.together if plain[0].size <= _MANY else _MOST
    while count < _MOST:
        room = min(size, _MOST - count)
        with np.errstate(invalid="ignore", divide="ignore"):  # nothing is gained where nothing is known, or all is
            gain = (found.at(candidates)[1] / _estimated(plain, tried, added, candidates)).max(axis=(1, 2))
        if count:
            chosen = _apart(np.where(np.isnan(tried).all(axis=(1, 2)) & (gain > _GAIN), gain, 0), room)
        else:
            chosen = _first(np.where(gain > _GAIN, plain.max(axis=(1, 2)), 0), room)
        if not chosen.size:
            break
        # The best of them first: the time may end before the others.
        chosen = chosen[np.argsort(-gain[chosen], kind="stable")]
        before = time.monotonic()
        seen, radius = programs.solve(candidates[chosen], band, _less(means, joining + searching))
        solved = time.monotonic()
        if not seen.size:
            break
        tried[np.searchsorted(candidates, seen)] = radius
        tried[np.isinf(tried)] = np.finfo(float).max
        count += chosen.size
        polygons = programs.polygons()
        if polygons is not None and joining <= _QUICK * (solved - before):
            found, joined = band.between(polygons, None), polygons
            joining = max(joining, time.monotonic() - solved)
        if means.budget is not None and means.budget.over:
            break
    if polygons is None:
        return found
    if means.budget is not None and means.budget.over:
        return found if polygons is joined else band.between(polygons, None)
    return band.between(polygons, means.budget or Budget())


def _less(means: Means, seconds: float) -> Means:
    """The same means without some seconds at the end of their time."""
    budget = means.budget
    if budget is None or budget.seconds is None:
        return means
    return means._replace(budget=Budget(max(budget.left - seconds, _NO_TIME)))


def _estimated(plain: Real, tried: Real, added: Real, omega: Real) -> Real:
    """Radii of polygons (F, ny, nu): in units of those of the discs they change from one that was tried to the next.

    Without what the relaxation of the poles adds.
    """
    found = _HALF * plain
    for entry in np.ndindex(*plain.shape[1:]):
        known = np.isfinite(tried[:, *entry]) & np.isfinite(plain[:, *entry])
        if known.any():
            own = np.maximum(tried - added, _LEAST * tried)[known, *entry]
            level = np.log(own / plain[known, *entry])
            found[:, *entry] = plain[:, *entry] * np.exp(np.interp(omega, omega[known], level))
    return found + added


def _first(radius: Real, count: int) -> NDArray[np.intp]:
    """The numbers to begin with, of positive radii: half of them of the largest discs, the others spread over all."""
    largest, there = _apart(radius, (count + 1) // 2), np.flatnonzero(radius > 0)
    if not largest.size:
        return largest
    spread = there[np.linspace(0, there.size - 1, count + 2).round().astype(int)[1:-1]]
    away = np.abs(spread[:, None] - largest).min(axis=1)
    spread = spread[away > _BESIDE]
    kept = np.unique(np.linspace(0, spread.size - 1, min(count // 2, spread.size)).round().astype(int))
    return np.union1d(largest, spread[kept]).astype(int)


def _apart(value: Real, count: int) -> NDArray[np.intp]:
    """So many numbers, rising, of the largest positive values that are some way apart."""
    found: list[int] = []
    for k in np.argsort(-value, kind="stable").tolist():
        if value[k] > 0 and all(abs(k - other) > _BESIDE for other in found):
            found.append(k)
        if len(found) == count:
            break
    return np.array(sorted(found), dtype=int)
