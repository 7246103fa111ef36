"""Frequencies of the polygons of a band: where they are estimated to gain most over the discs, a few at a time."""

from __future__ import annotations

import abc
import time
from typing import TYPE_CHECKING, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Interruptible, Real, Stops, one_thread, was_interrupted
from robustid.guarantees.candidates import halved, shares_of
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.over_poles import Bounded, WorstCaseOverPoles
from robustid.guarantees.parameters import parameter_intervals
from robustid.guarantees.pole_cells import box_of
from robustid.guarantees.pole_tree import Branch, PoleTree
from robustid.guarantees.refinement import discs_of, in_order
from robustid.guarantees.sweep import Known, Means, value_sets
from robustid.guarantees.value_set import ValueSet, by_frequency, gap_of
from robustid.guarantees.worst_case import worst_case_error
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification

if TYPE_CHECKING:
    import control

_MOST, _ROUND = 40, 8  # frequencies, and of these so many before the next are chosen
_MOST_OF_CELLS, _ROUND_OF_CELLS, _SPREAD = 32, 4, 14  # the same over a box, and those that are spread over all
_MANY = 4  # entries: of more all frequencies are chosen at once, since the search between them takes as long as they do
_MOST_IN_TIME = 160  # the same where there is a limit of time, at exact poles
_GAIN, _LESS = 1.05, 1.02  # times a polygon's radius: smaller discs are good enough; and halfway between the candidates
_BESIDE = 2  # neighbours of a frequency that are not chosen together with it
_CELLS, _CELLS_AT_PEAK = 16, 64  # of a pole-uncertainty box, at most: everywhere, and where the error is largest
_FURTHER = 4  # cells at once, where the error is largest
_PEAK = 0.8  # of the time for polygons over a box: where the error is largest
_SHARE = 1 / 3  # of the time that is left, for the cells at one frequency
_WORDS = "bounding the error over the pole-uncertainty box"
_HALF = 0.5  # of the radius of a disc: what a polygon may be that nothing is known of
_SIDES = 16, 0.05  # directions of polygons and their tolerance
_QUICK = 0.1  # of the time of their polygons: what discs between these may take, to choose the next ones
_BETWEEN = 0.4  # of the time: for the search between the polygons
_NO_TIME = 1e-9


class Refinable(Known, Protocol):
    """A band that takes polygons."""

    @property
    def box(self) -> Box | None:
        """Pole-uncertainty box that it covers."""
        ...

    def error_at(self, omega: Real, model: control.StateSpace) -> Real:
        """Return bounds of the error of a model, (F, ny, nu)."""
        ...

    def between(self, polygons: Bounded, budget: Budget | None) -> Self:
        """Return it with polygons, the search between them within a budget; without one a short search."""
        ...


B = TypeVar("B", bound=Refinable)


class Programs(abc.ABC):
    """The polygons of one statement that were found, of semidefinite programs or of sums over cells."""

    together: int  # frequencies that are chosen at once
    most = in_time = _MOST  # in all; where there is a limit of time

    def __init__(self, identification: Identification, model: control.StateSpace) -> None:
        self.identification, self.model = identification, model
        self.entries = identification.problem.entries

    @abc.abstractmethod
    def solve(self, omega: Real, known: Refinable, means: Means) -> tuple[Real, Real]:
        """Find the polygons at frequencies; those that were looked at, (F,), and at least the radii there, (F, ny, nu)."""

    def spread(self, room: int) -> int:
        """Number of frequencies of the first round, of `room`, that are spread over all."""
        return room // 2

    @abc.abstractmethod
    def polygons(self) -> Bounded | None:
        """Everything that was found; None where nothing was."""

    def lower(self, omega: Real, known: Refinable, means: Means) -> tuple[Real, Real]:
        """Lower the largest error first, where that takes more than a polygon; what `solve` returns."""
        return omega[:0], np.zeros((0, *self.entries.shape))


class OfExactPoles(Programs):
    """Poles as they are stated; of every solution at `least` so many frequencies whatever the time is."""

    together, in_time = _ROUND, _MOST_IN_TIME

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

    def solve(self, omega: Real, known: Refinable, means: Means) -> tuple[Real, Real]:
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
    """Poles anywhere in a box, at every frequency in cells of their own: the more, the nearer it is to the largest error."""

    together, most, in_time = _ROUND_OF_CELLS, _MOST_OF_CELLS, _MOST_OF_CELLS

    def __init__(
        self, identification: Identification, model: control.StateSpace, box: Box, largest: Real, every: bool = False
    ) -> None:
        super().__init__(identification, model)
        problem = identification.problem
        self._largest = largest  # of the errors that are known in the band, (ny, nu)
        self._every = every
        self._tree = PoleTree(problem, model, box_of(identification, *in_order(problem, box)))
        self._covers: dict[float, list[Branch]] = {}
        self._interrupted = False
        self._looked = 0  # frequencies

    def solve(self, omega: Real, known: Refinable, means: Means) -> tuple[Real, Real]:
        """As `Programs.solve`, one after the other; those that gain nothing over known discs are kept where `every` one is."""
        radii: dict[float, Real] = {}
        error = known.error_at(omega, self.model)
        share = shares_of(error, self._largest)
        first = np.argsort(-share, kind="stable")  # the largest error, before the time is over
        omega, error, share = omega[first], error[first], share[first]
        most = np.ceil(_CELLS + (_CELLS_AT_PEAK - _CELLS) * np.minimum(share, 1.0)).astype(int)
        with one_thread(), Interruptible(lambda: bool(self._covers)) as sweep:
            for k, w in enumerate(omega.tolist()):
                mine = None if means.budget is None else means.budget.share(_SHARE)
                start = self._beside(w, int(most[k]))
                leaves = None if self._interrupted else self._tree.cover(w, error[k], int(most[k]), mine, start)
                if leaves is None:
                    break
                radii[w] = self._radius(leaves, w)
                self._looked += 1
                if means.progress is not None:
                    means.progress(_WORDS, self._looked, omega.size if self._every else self.most)
                if np.any(radii[w] < np.inf if self._every else radii[w] < known.at([w])[1][0] / _GAIN):
                    self._covers[w] = leaves
        self._interrupted |= sweep.interrupted
        return np.array(sorted(radii)), np.array([radii[w] for w in sorted(radii)]).reshape(-1, *self.entries.shape)

    def spread(self, room: int) -> int:
        """As `Programs.spread`."""
        return _SPREAD

    def lower(self, omega: Real, known: Refinable, means: Means) -> tuple[Real, Real]:
        """As `Programs.lower`: cells where the error is largest, by discs or by cells, until more of them make it no smaller."""
        error = known.error_at(omega, self.model)
        share = dict(zip(omega.tolist(), shares_of(error, self._largest).tolist(), strict=True))
        seen: list[float] = []
        with one_thread(), Interruptible(lambda: bool(self._covers)) as sweep:
            while not (means.budget is not None and means.budget.over):
                w = max(share, key=share.__getitem__)
                before = self._covers.get(w, [])
                most = min(len(before) + _FURTHER, _CELLS_AT_PEAK) if before else _CELLS
                leaves = self._tree.cover(w, self._largest, most, means.budget, start=before or self._beside(w, most))
                if leaves is None or set(leaves) == set(before):
                    break  # the time is over, or no more cells make it smaller
                errors = self._errors(w, leaves)
                if not np.isfinite(errors).any():
                    break  # cells in which no amplitude has a bound narrow nothing anywhere
                self._covers[w], seen = leaves, [*seen, w]
                share[w] = min(share[w], float(shares_of(errors[None], self._largest)[0]))
                if means.progress is not None:
                    means.progress(_WORDS, self._looked, self.most)
        self._interrupted |= sweep.interrupted
        found = np.unique(seen)
        radii = [self._radius(self._covers[w], w) for w in found.tolist()]
        return found, np.array(radii).reshape(-1, *self.entries.shape)

    def _errors(self, omega: float, leaves: list[Branch]) -> Real:
        """The proved errors (ny, nu) of cells at a frequency."""
        nominal = self.identification.problem.plane.values_at(self.model, np.array([omega]))[0]
        return np.asarray(np.max([leaf.errors(omega, nominal) for leaf in leaves], axis=0), dtype=float)

    def _beside(self, omega: float, most: int) -> list[Branch]:
        """Cells of the nearest frequency that has some, if these are not more than so many."""
        nearest = min(self._covers, key=lambda w: abs(w - omega), default=omega)
        leaves = [leaf for leaf in self._covers.get(nearest, []) if not leaf.refuted]
        return leaves if len(leaves) <= most else []

    def _radius(self, leaves: list[Branch], omega: float) -> Real:
        return discs_of([leaf.kept([omega]) for leaf in leaves], np.array([omega]), self.entries)[1][0]

    def polygons(self) -> WorstCaseOverPoles | None:
        """As `Programs.polygons`."""
        if not self._covers:
            return None
        omega = sorted(self._covers)
        used = dict.fromkeys(leaf for w in omega for leaf in self._covers[w])
        return WorstCaseOverPoles(
            identification=self.identification,
            model=self.model,
            omega=np.array(omega),
            box=self._tree.root.cell,
            kept=tuple(leaf.kept([w for w in omega if leaf in self._covers[w]]) for leaf in used),
            refuted=tuple(leaf.refutation() for leaf in self._tree.refuted),
        )


def refined(
    band: B,
    plain: B,
    identification: Identification,
    model: control.StateSpace,
    omega: Real,
    means: Means,
    *,
    stated: bool,
) -> B:
    """The band with polygons at the frequencies that are `stated`, or where they gain most of these; `plain` has none yet.

    After Ctrl-C nothing further is searched.
    """
    with Stops().listening():
        if band.box is None:
            if not stated:
                return placed(OfExactPoles(identification, model), plain, omega, means)
            found = worst_case_error(identification, model=model, omega=omega, known=band, **means.options)
            return band.between(found, means.budget)
        largest = plain.error_at(omega, model).max(axis=0)
        programs = OverBox(identification, model, band.box, largest, every=stated)
        if not stated:
            return placed(programs, plain, omega, means)
        programs.solve(omega, plain, means)
        polygons = programs.polygons()
        return band if polygons is None else band.between(polygons, means.budget)


def placed(programs: Programs, band: B, candidates: Real, means: Means) -> B:
    """The band with polygons at those candidates, rising, where they gain most, until nothing or no time is left.

    Radii of polygons are estimated from those of the discs of the samples alone, times what those beside had in these units. Where
    a limit of time leaves some when these are done, further ones halfway between them, which gain less.
    """
    plain = band.at(candidates)[1]
    tried = np.full(plain.shape, np.nan)  # radii, of those that were looked at
    found, count, joining = band, 0, 0.0
    polygons = joined = None
    # The search between the polygons, which ends where its time does.
    searching = 0.0 if means.budget is None or means.budget.seconds is None else _BETWEEN * means.budget.left
    first = _less(means, searching)
    first = first if first.budget is None else first._replace(budget=first.budget.share(_PEAK))
    seen, radius = programs.lower(candidates, band, first)
    if seen.size:
        tried[np.searchsorted(candidates, seen)], polygons = radius, programs.polygons()
    few = plain[0].size <= _MANY
    size, most, least = programs.together if few else programs.most, programs.most, _GAIN
    if few and means.budget is not None and means.budget.seconds is not None:
        most = programs.in_time
    while count < most and not was_interrupted():
        room = min(size, most - count)
        with np.errstate(invalid="ignore", divide="ignore"):  # nothing is gained where nothing is known, or all is
            now, then = found.at(candidates)[1], _estimated(plain, tried, candidates)
            gain = (now / then).max(axis=(1, 2))
            drop = np.nan_to_num((now - then) / plain.max(axis=0)).max(axis=(1, 2))
        new = np.isnan(tried).all(axis=(1, 2)) & (gain > least)
        if count:
            chosen = np.union1d(
                _apart(np.where(new, drop, 0), room // 2), _apart(np.where(new, gain, 0), room - room // 2)
            )
        else:
            chosen = _first(np.where(new, plain.max(axis=(1, 2)), 0), (room + 1) // 2, programs.spread(room))
        if not chosen.size:
            if most == programs.most or least == _LESS:
                break
            candidates, tried, least = *halved(candidates, tried), _LESS
            plain = band.at(candidates)[1]
            continue
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
        ample = means.budget is None or means.budget.left > 2 * searching
        if polygons is not None and joining <= _QUICK * (solved - before) and ample and not was_interrupted():
            found, joined = band.between(polygons, None), polygons
            joining = max(joining, time.monotonic() - solved)
        if means.budget is not None and means.budget.over:
            break
    if polygons is None:
        return found
    if means.budget is not None and means.budget.left <= joining:
        return found if polygons is joined else band.between(polygons, None)
    return band.between(polygons, means.budget or Budget())


def _less(means: Means, seconds: float) -> Means:
    """The same means without some seconds at the end of their time."""
    budget = means.budget
    if budget is None or budget.seconds is None:
        return means
    return means._replace(budget=Budget(max(budget.left - seconds, _NO_TIME)))


def _estimated(plain: Real, tried: Real, omega: Real) -> Real:
    """Radii of polygons (F, ny, nu): in units of those of the discs they change from one that was tried to the next."""
    found = _HALF * plain
    for entry in np.ndindex(*plain.shape[1:]):
        known = np.isfinite(tried[:, *entry]) & np.isfinite(plain[:, *entry])
        if known.any():
            level = np.log(tried[known, *entry] / plain[known, *entry])
            with np.errstate(over="ignore"):  # near a frequency where nothing was found: infinite
                found[:, *entry] = plain[:, *entry] * np.exp(np.interp(omega, omega[known], level))
    return found


def _first(radius: Real, largest: int, spread: int) -> NDArray[np.intp]:
    """The numbers to begin with, of positive radii: so many of the largest discs, and others spread over all."""
    chosen, there = _apart(radius, largest), np.flatnonzero(radius > 0)
    if not chosen.size:
        return chosen
    others = there[np.linspace(0, there.size - 1, 2 * spread + 2).round().astype(int)[1:-1]]
    away = np.abs(others[:, None] - chosen).min(axis=1)
    others = others[away > _BESIDE]
    kept = np.unique(np.linspace(0, others.size - 1, min(spread, others.size)).round().astype(int))
    return np.union1d(chosen, others[kept]).astype(int)


def _apart(value: Real, count: int) -> NDArray[np.intp]:
    """So many numbers, rising, of the largest positive values that are some way apart."""
    found: list[int] = []
    for k in np.argsort(-value, kind="stable").tolist():
        if len(found) == count:
            break
        if value[k] > 0 and all(abs(k - other) > _BESIDE for other in found):
            found.append(k)
    return np.array(sorted(found), dtype=int)
