"""Discs of every entry on the whole axis, and the bound of the error of a model that follows from them: sums alone."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Interruptible, Real, one_thread, rounded_up
from robustid.data import FrequencyResponse
from robustid.guarantees.circle import CircleBound, Peak
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.linear.amplitudes import extract
from robustid.guarantees.linear.arcs import arc_bounds
from robustid.guarantees.linear.entry_band import EntryBand, EntryBands, entry_band, quick_band, unsearched_band
from robustid.guarantees.linear.functions import BoxLike, functions_of
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.guarantees.value_set import norm_of_bounds
from robustid.identification import MixedProblem

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")
_BEYOND = 4.0  # times the highest frequency point of continuous data: the last knot before infinity
_COARSE = 64  # knots of the uniform grid from end to end
_ROWS = (
    100  # of records beside frequency points of every entry: with more of them the search takes minutes, and finds less
)
_FIRST = 100  # knots of every entry before any of them gets more, where time is short


def axis_ends(problem: MixedProblem, further: Real) -> tuple[float, float]:
    """The frequencies between which there are knots, rad/s; in continuous time to the last of further ones."""
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    basis = problem.parametric
    low = 0.0
    if basis is not None and basis.has_integrator:
        low = float(lines[lines > 0].min()) if np.any(lines > 0) else 1e-3 * problem.plane.top
    return low, problem.plane.top if problem.dt else max(_BEYOND * float(lines.max()), float(further.max(initial=0.0)))


def without_long_records(problem: MixedProblem) -> MixedProblem:
    """The problem without its records, if these are long and frequency points see every entry: all that it says holds still."""
    seen = [one.bound.used.any(axis=0) for one in problem.frequency if isinstance(one, FrequencyResponse)]
    rows = sum(record.y.size for record in problem.time if record.initial != "periodic")
    if rows <= _ROWS or not np.any(seen, axis=0).all():
        return problem
    return dataclasses.replace(problem, time=None)


def discs_of_entries(
    problem: MixedProblem, box: BoxLike | None, omega: Real, knots: int | None, budget: Budget
) -> tuple[EntryBand, ...]:
    """The discs of every entry: knots at frequencies and where interpolation asks for them, or so many at most."""
    functions, seen = functions_of(problem, box), seen_in(problem)
    ends: list[float] = problem.plane.angles(np.array(axis_ends(problem, omega))).tolist()
    low, high = ends
    wanted = np.concatenate([problem.plane.angles(omega), np.linspace(low, high, _COARSE)])
    with one_thread():
        every = [samples_of(problem, functions, entry, seen) for entry in independent_entries(problem.entries)]
        return _searched(every, np.clip(wanted, low, high), (low, high), knots, budget)


def _searched(
    every: Sequence[Samples], wanted: Real, ends: tuple[float, float], most: int | None, budget: Budget
) -> tuple[EntryBand, ...]:
    """The discs of every entry: with knots as interpolation asks for, or so many at most, as far as the budget goes."""
    found: dict[int, EntryBand] = {}
    done = 0
    budget.tell(done, len(every))
    with Interruptible(lambda: done > 0) as search:
        if not math.isinf(budget.left):
            _coarsely(every, ends, found, budget)
        for k, one in enumerate(every):
            if budget.over:
                break
            extraction = found[k].extraction if k in found else extract(one)
            if most is None:
                found[k] = entry_band(extraction, wanted, *ends, budget)
            else:
                found[k] = quick_band(extraction, *ends, most)
            done += found[k].complete
            budget.tell(done, len(every))
    if search.interrupted:
        _log.warning(
            "interrupted: the discs of %d of %d entries are finished; coarse ones for the others", done, len(every)
        )
        _coarsely(every, ends, found)
    return tuple(found[k] if k in found else unsearched_band(one, *ends) for k, one in enumerate(every))


def _coarsely(
    every: Sequence[Samples], ends: tuple[float, float], found: dict[int, EntryBand], budget: Budget | None = None
) -> None:
    """Give a coarse band to the entries that have none, until the time is over."""
    for k, one in enumerate(every):
        if budget is not None and budget.over:
            return
        if k not in found:
            found[k] = dataclasses.replace(quick_band(extract(one), *ends, _FIRST), complete=False)
            if budget is not None:
                budget.tell(0, len(every))


def whole_axis(
    bands: EntryBands, model: control.StateSpace, corners: tuple[Real, Real] | None = None, lower: float = 0.0
) -> CircleBound:
    """Bound of |F - model| arc by arc, from the discs and `corners` (angles, bounds (N, ny, nu)); `lower` is attained."""
    plane = bands.problem.plane
    with one_thread():
        angles, errors = arc_bounds(bands, model, corners)
    edges, inside = np.full(angles.size, plane.top), angles < np.pi
    edges[inside] = plane.omega(angles[inside])
    return CircleBound(edges, norm_of_bounds(errors.bound), lower, True, (), errors.bound, errors)


class OnAxis(Protocol):
    """A band, by its bounds at frequencies, and between them."""

    @property
    def model(self) -> control.StateSpace | None:
        """The nominal that errors are measured from; None: the centres."""
        ...

    @property
    def omega(self) -> Real:
        """The frequencies that were asked for, rad/s."""
        ...

    @property
    def sigma_upper(self) -> Real:
        """Bounds at its frequencies."""
        ...

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Mask of those frequencies at which something is said."""
        ...

    @property
    def circle(self) -> CircleBound:
        """Bounds between all frequencies."""
        ...

    def is_open(self, omega: Real) -> NDArray[np.bool_]:
        """Mask of frequencies in ranges where nothing is said."""
        ...


def largest_error(band: OnAxis, within: tuple[float, float] = (0.0, np.inf)) -> Peak:
    """Proved bound of the largest singular value of F - model at every frequency outside of open ranges, and where it is largest.

    At the frequencies of a band alone it would be no bound of what lies between them: a mode is narrower than they are apart, and
    beside an open range it rises. Of a band without a model that at these frequencies. `within` frequencies in rad/s: on the arcs
    that have a part there.
    """
    low, high = within
    upper = np.where(band.bounded & (band.omega >= low) & (band.omega <= high), band.sigma_upper, 0.0)
    k = int(np.argmax(upper))
    at_points = Peak(float(upper[k]), float(band.omega[k]))
    if band.model is None:
        return at_points
    edges = band.circle.edges
    middle = np.where(np.isfinite(edges[1:]), (edges[:-1] + edges[1:]) / 2, 2 * edges[:-1])
    away = band.is_open(middle) | (edges[1:] <= low) | (edges[:-1] >= high)
    bound = np.where(away, 0.0, band.circle.bound)
    k = int(np.argmax(bound))
    at = min(max(float(middle[k]), low), high)
    return Peak(float(bound[k]), at) if bound[k] > at_points.value else at_points


def largest_words(largest: Peak) -> str:
    """Write a `largest_error` with four digits, rounded up."""
    return f"{rounded_up(largest.value):.4g}"
