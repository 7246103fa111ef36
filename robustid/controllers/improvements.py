"""Sensitivity of a design to what is known and to what is asked: levels with smaller bounds, and with wider limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from robustid.controllers.designing import At, Found, Task, TimeIsOver
from robustid.controllers.plants import Plants
from robustid.core import Budget, Interruptible, Real, StateMatrices, hz_span, hz_words, points_of, response_at
from robustid.guarantees import Band

_ACTIVE = 0.05  # of the unit of a condition: less slack makes it one that limits
_ABOUT = 1.25  # ratio of frequencies about one that limits
_JUMP = 1e-6  # of a frequency, from one side of an end of a range to the other
_RANGES = 5  # that are tried at most, those of the least slack first
_WIDER = 1.1  # of a limit
_LOWER = (1.0, 0.995, 0.98, 0.95)  # of the level, from which the search goes on
BOUNDS = "bounds"  # name of what is smaller, beside names of limits that are wider


class Improvement(NamedTuple):
    """Level that a goal reaches where the bounds were smaller in a range of frequencies, or one limit were wider.

    Attributes
    ----------
    of : str
        "bounds", or the limit.
    factor : float
        Of the bounds, or of the limit.
    low, high : float
        Range in rad/s, of the bounds; 0 and infinity: all frequencies. Of limits nan.
    level : float
        What the goal reaches.
    ratio : float
        This to what it reaches as it is, by the same search.
    point : float
        Of bounds in a range the frequency point of the data, in rad/s, that adds most to them where they limit; nan of others.
    """

    of: str
    factor: float
    low: float
    high: float
    level: float
    ratio: float
    point: float = math.nan

    @property
    def sentence(self) -> str:
        """The change and what it does, in words."""
        if self.of != BOUNDS:
            what = f"{self.of.replace('_', ' ')} wider by {100 * (self.factor - 1):.3g} %"
        elif math.isinf(self.high):
            what = f"all bounds times {self.factor:.3g}"
        else:
            what = (
                f"bounds times {self.factor:.3g} from {hz_span(self.low / (2 * math.pi), self.high / (2 * math.pi), 4)}"
            )
            if math.isfinite(self.point):
                what += f", most from the point at {hz_words(self.point / (2 * math.pi), 4)}"
        return f"{what}: {100 * (self.ratio - 1):.3g} % more"


def improvements(task: Task, found: Found, factor: float, budget: Budget) -> tuple[Improvement, ...]:
    """Effects of all changes, the largest first; as many as there is time for."""
    task.with_frequencies([omega for one in zip(task.plants, task.grids, strict=True) for omega in _widest(*one)])
    rows: list[Improvement] = []
    changes: list[tuple[str, float, float, float, float, Task]] = []
    for low, high, point in [*_ranges(task, found), (0.0, math.inf, math.nan)]:
        changed = dataclasses.replace(task, smaller=partial(_smaller, low=low, high=high, factor=factor))
        changed.with_frequencies(_about(task, low, high))
        changes.append((BOUNDS, factor, low, high, point, changed))
    for name in task.limits.stated:
        wider = dataclasses.replace(task, limits=task.limits.relaxed(_WIDER, name))
        changes.append((name, _WIDER, math.nan, math.nan, math.nan, wider))
    with Interruptible(lambda: bool(rows)):
        try:
            before = max(_reached(dataclasses.replace(task, budget=budget), found), found.level)
            for of, part, low, high, point, changed in changes:
                level = max(_reached(dataclasses.replace(changed, budget=budget), found), found.level)
                rows.append(Improvement(of, part, low, high, level, level / before, point))
        except TimeIsOver:
            pass
    return tuple(sorted(rows, key=lambda row: -row.ratio))


def _smaller(omega: Real, *, low: float, high: float, factor: float) -> Real:
    return np.where((omega >= low) & (omega <= high), factor, 1.0)


def _widest(plants: Plants, grid: Real) -> Real:
    """Frequencies in the cells with the largest bounds between those of a grid: no proof adds them here."""
    edges, bounds = plants.band.circle.edges, plants.band.circle.entries.max(axis=(1, 2))
    low, high = np.maximum(edges[:-1], grid[0]), np.minimum(edges[1:], grid[-1])
    inside = low < high
    middle, bounds = np.sqrt(low[inside] * high[inside]), bounds[inside]
    between = np.searchsorted(grid, middle)
    order = np.lexsort((-bounds, between))
    return middle[order[np.unique(between[order], return_index=True)[1]]]


def _about(task: Task, low: float, high: float) -> list[float]:
    """Frequencies at either end of a range where the bounds jump, within those that are asked about."""
    begin, end = max(grid[0] for grid in task.grids), min(grid[-1] for grid in task.grids)
    return [one for one in (low * (1 - _JUMP), low, high, high * (1 + _JUMP)) if begin < one < end]


def _reached(task: Task, found: Found) -> float:
    """The level from a controller on; 0 where it isn't found again."""
    here = At(task, found.at)
    for part in _LOWER:
        if (again := here.found(found.level * part, found)) is not None:
            return here.raised(again).level
    return 0.0


def heaviest_point(band: Band, omega: float) -> float:
    """Frequency in rad/s of the point of the data that adds most to the radii of the discs at a frequency; nan where none does."""
    plane = band.problem.plane
    every = [one.shares(float(plane.angles(np.array([omega]))[0])) for one in band.bands]
    angles, place = np.unique(np.concatenate([found for found, _ in every]), return_inverse=True)
    added = np.zeros(angles.size)
    np.add.at(added, place, np.concatenate([share for _, share in every]))
    return float(plane.omega(angles[[np.argmax(added)]])[0]) if added.any() else math.nan


def _ranges(task: Task, found: Found) -> Iterator[tuple[float, float, float]]:
    """Ranges about the frequencies that limit, and the points of the data that bear most at the first of each, in rad/s."""
    here = At(task, found.at)
    owners = [*here.owners, *range(len(task.plants))]
    question, discs = here.question(task.asked(found.level))
    C = response_at(StateMatrices.of(found.controller), points_of(discs.omega, task.dt))
    slack = np.full(discs.omega.size, np.inf)
    for one, unit in question.with_units():
        np.minimum.at(slack, one.place, one.excess(C) / unit)
    order = np.argsort(slack)
    limiting = order[slack[order] <= max(_ACTIVE, slack[order[0]])]
    active = discs.omega[limiting]
    ranges: list[list[float]] = []
    for omega in np.sort(active):
        low, high = omega / _ABOUT, min(omega * _ABOUT, discs.omega.max())
        if ranges and low <= ranges[-1][1]:
            ranges[-1][1] = high
        else:
            ranges.append([low, high])
    first = [next(k for k, (low, high) in enumerate(ranges) if low <= omega <= high) for omega in active]
    for k in list(dict.fromkeys(first))[:_RANGES]:
        place = int(limiting[first.index(k)])
        band: Band = task.plants[owners[place]].band
        point = heaviest_point(band, float(discs.omega[place]))
        yield float(ranges[k][0]), float(ranges[k][1]), point
