"""Frequencies of the polygons of a band: where they are estimated to gain most over the discs, a few at a time."""

from __future__ import annotations

import abc
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
from robustid.guarantees.pole_sweep import bounded, searched
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
_SIDES = 16, 0.05  # directions of polygons and their tolerance: of exact poles,
_SIDES_OF_CELLS = 8, 0.1  # and of cells
_NO_TIME = 1e-9


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


class OfExactPoles(Programs):
    """Poles as they are stated."""

    together = _ROUND

    def __init__(self, identification: Identification, model: control.StateSpace) -> None:
        super().__init__(identification, model)
        self._consistent = consistent_set(identification)
        self._directions, rtol = _SIDES
        self._gap = gap_of(rtol, self._directions, self.entries.single)
        self._values: dict[float, tuple[ValueSet, ...]] = {}

    def solve(self, omega: Real, known: Known, means: Means) -> tuple[Real, Real]:
        """As `Programs.solve`."""
        found = by_frequency(value_sets(self._consistent, omega, self._directions, self._gap, means, self.model, known))
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
            parameters=parameter_intervals(self._consistent, None, Budget(_NO_TIME)),
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
            self._sets, self._refuted = searched(problem, self._whole, omega, _CELLS, budget.share(_SEARCH))
        if not self._sets:
            raise InconsistentDataError(
                f"no system with poles in the pole-uncertainty box fits the data: all {len(self._refuted)} cells of it are"
                " refuted; loosen the bounds, the prior or the box"
            )
        if any(one is None for _, one in self._sets):
            raise InputError(
                "a cell of the pole-uncertainty box is so wide that no sample says anything of all its poles at once: the discs of"
                " `band` stand alone; measure more frequency points around the modes, or state a smaller box"
            )
        self._kept: list[dict[float, tuple[ValueSet, ...]]] = [{} for _ in self._sets]

    def solve(self, omega: Real, known: Known, means: Means) -> tuple[Real, Real]:
        """As `Programs.solve`; a frequency at which a cell alone is as large as the known disc is looked at no further."""
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

    Radii of polygons are estimated from those of the discs of the samples alone, times what those beside had in these units. One
    polygon at least is looked at.
    """
    plain = band.at(candidates)[1]
    tried = np.full(plain.shape, np.nan)  # radii, of those that were looked at
    found, count, polygons = band, 0, None
    size = programs.together if plain[0].size <= _MANY else _MOST
    while count < _MOST:
        room = min(size, _MOST - count)
        if count:
            gain = (found.at(candidates)[1] / _estimated(plain, tried, candidates)).max(axis=(1, 2))
            chosen = _apart(np.where(np.isnan(tried).all(axis=(1, 2)) & (gain > _GAIN), gain, 0), room)
        else:
            chosen = _first(plain.max(axis=(1, 2)), room)
        if not chosen.size:
            break
        seen, radius = programs.solve(candidates[chosen], band, means)
        tried[np.searchsorted(candidates, seen)] = radius
        tried[np.isinf(tried)] = np.finfo(float).max
        count += chosen.size
        polygons = programs.polygons()
        if polygons is not None:
            found = band.between(polygons, None)
        if means.budget is not None and means.budget.over:
            break
    if polygons is None or (means.budget is not None and means.budget.over):
        return found
    return band.between(polygons, means.budget or Budget())


def _estimated(plain: Real, tried: Real, omega: Real) -> Real:
    """Radii of polygons (F, ny, nu): in units of those of the discs they change from one that was tried to the next."""
    found = np.array(plain)
    for entry in np.ndindex(*plain.shape[1:]):
        known = np.isfinite(tried[:, *entry]) & np.isfinite(plain[:, *entry])
        if known.any():
            level = np.log(tried[known, *entry] / plain[known, *entry])
            found[:, *entry] = plain[:, *entry] * np.exp(np.interp(omega, omega[known], level))
    return found


def _first(radius: Real, count: int) -> NDArray[np.intp]:
    """The numbers to begin with: half of them of the largest discs, the others spread over all."""
    largest = _apart(radius, (count + 1) // 2)
    spread = np.linspace(0, radius.size - 1, count + 2).round().astype(int)[1:-1]
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
