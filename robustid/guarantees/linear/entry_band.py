"""Linear certificates of entries at knots of the frequency axis, and between them by interpolation."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Frozen, Real, freeze, kept_by_content
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.disc_values import DiscValues
from robustid.guarantees.linear.error_sets import KnownErrors
from robustid.guarantees.linear.samples import KEPT, Number, Samples
from robustid.guarantees.linear.search import FEW, POINTS, STEPS, search
from robustid.identification import MixedProblem

if TYPE_CHECKING:
    import control

_LOOSE = 1.05  # of the radius between knots over that of a search there: above, the arc is halved
_ROUNDS, _MOST = 6, 1200  # of halving arcs, and knots
_STEPS_BETWEEN = 5
_FEW_STEPS = 6
_APART = 1e-9  # of the range: knots that are nearer to each other are one
_LINES = 200  # of the data, at most, that are knots at first
_SHARE = 0.25  # of few knots that are lines
_OUTSIDE = 40  # knots below and above the data
_AROUND = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)  # knots around a mode, in its half-width
_ROUNDED = 1e-9  # of the values of a model
_Knots = tuple[Real, NDArray[np.intp], NDArray[np.complex64]]  # angles, points, multipliers


@dataclasses.dataclass(frozen=True, eq=False)
class EntryBand(Frozen):
    """Discs that hold an entry of every consistent system, at every angle between the first and the last knot.

    Between two knots the multipliers are those of both, in proportion: any multipliers are a certificate.
    """

    samples: Samples
    extraction: Extraction
    angles: Real  # (F,), ascending
    points: NDArray[np.intp]  # (F, n)
    multipliers: NDArray[np.complex64]  # (F, n + T)
    complete: bool = True  # False: the time for the search was over; the discs are proved, and wider than they need be

    def __post_init__(self) -> None:
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in ("angles", "points", "multipliers")})

    @functools.cached_property
    def _at_knots(self) -> tuple[Complex, Real]:
        return evaluate(self.samples, self.extraction, self.angles, self.points, self.multipliers.astype(complex))

    @property
    def centre(self) -> Complex:
        """Centres at the knots, (F,)."""
        return self._at_knots[0]

    @property
    def radius(self) -> Real:
        """Radii at the knots, (F,)."""
        return self._at_knots[1]

    @property
    def searched(self) -> bool:
        """Return whether combinations of the samples were searched: without, the class alone says what it can."""
        return bool(self.complete or np.any(self.multipliers))

    @property
    def amplitudes(self) -> tuple[Complex, Real]:
        """Centres and radii of the discs of the amplitudes of the entry, (g,) each."""
        own = self.samples.own_amplitudes
        return self.extraction.known.centre[own], self.extraction.known.radius[own]

    def at(self, angles: Real) -> tuple[Complex, Real]:
        """Centres and radii at angles between the knots."""
        return self._kept_at(angles)

    @functools.cached_property
    def _kept_at(self) -> Callable[[Real], tuple[Complex, Real]]:
        return kept_by_content(most=KEPT)(self._evaluated)

    def _evaluated(self, angles: Real) -> tuple[Complex, Real]:
        found = np.empty(angles.size, complex), np.empty(angles.size)
        before = np.clip(np.searchsorted(self.angles, angles, side="right") - 1, 0, self.angles.size - 2)
        part = (angles - self.angles[before]) / (self.angles[before + 1] - self.angles[before])
        known = (part == 0) | (part == 1)
        knots = (before + (part == 1))[known]
        for whole, own in zip(found, self._at_knots, strict=True):
            whole[known] = own[knots]
        if not known.all():
            new = self.between(before[~known], part[~known])
            for whole, own in zip(found, new, strict=True):
                whole[~known] = own
        return freeze(found[0]), freeze(found[1])

    def errors(self, nominal: Complex, angles: Real, rounding: float) -> KnownErrors:
        """F less nominal values (N, k) at angles, these known up to rounding: bounds and discs (N, k)."""
        centre, radius = self.at(angles)
        away = centre[:, None] - nominal
        size = np.abs(away)
        spread = radius[:, None] + rounding * size
        return KnownErrors(size * (1 + rounding) + radius[:, None], away, spread, np.zeros((angles.size, 0)))

    def between(self, arcs: NDArray[np.intp], part: Real) -> tuple[Complex, Real]:
        """Centres and radii on arcs, behind knot number `arcs`, at the given parts of their lengths."""
        angles = self.angles[arcs] + part * (self.angles[arcs + 1] - self.angles[arcs])
        return mixed(self.samples, self.extraction, angles, part, self.of_knots(arcs), self.of_knots(arcs + 1))

    def shares(self, angle: float) -> tuple[Real, Real]:
        """Angles of the points that the disc at an angle rests on, and what each adds to its radius: ``|d_k|`` times its bound.

        Both of a conjugate pair count as one.
        """
        after = int(np.clip(np.searchsorted(self.angles, angle), 1, self.angles.size - 1))
        knot = after - int(angle - self.angles[after - 1] < self.angles[after] - angle)
        points, d = self.points[knot], self.multipliers[knot, : self.points.shape[1]]
        found, place = np.unique(np.abs(self.samples.angles[points]), return_inverse=True)
        added = np.zeros(found.size)
        np.add.at(added, place, np.abs(d) * self.samples.bound[points])
        return found, added

    def of_knots(self, knots: NDArray[np.intp]) -> tuple[NDArray[np.intp], Complex]:
        """Points and multipliers of knots."""
        return self.points[knots], self.multipliers[knots].astype(complex)


@dataclasses.dataclass(frozen=True, eq=False)
class EntryBands(Frozen):
    """Discs of all entries of a problem: row by row; of symmetric matrices those of the upper triangle."""

    problem: MixedProblem
    bands: tuple[EntryBand, ...]

    @functools.cached_property
    def _numbers(self) -> dict[tuple[int, int], int]:
        """Number of the band of every entry."""
        own = {one.samples.entry: k for k, one in enumerate(self.bands)}
        symmetric, places = self.problem.entries.symmetric, np.ndindex(*self.problem.entries.shape)
        return {place: own[(min(place), max(place)) if symmetric else place] for place in places}

    def knots(self) -> Real:
        """Angles of the knots of all entries."""
        return np.unique(np.concatenate([band.angles for band in self.bands]))

    def of(self, place: tuple[int, int]) -> EntryBand:
        """The discs of an entry."""
        return self.bands[self._numbers[place]]

    def matrices(self, values: Sequence[NDArray[Number]]) -> NDArray[Number]:
        """Values (N,) of every band as matrices (N, ny, nu)."""
        found = np.empty((len(values[0]), *self.problem.entries.shape), values[0].dtype)
        for place, number in self._numbers.items():
            found[:, *place] = values[number]
        return found

    def at(self, angles: Real) -> tuple[Complex, Real]:
        """Centres and radii at angles between the knots, (N, ny, nu)."""
        centres, radii = zip(*(one.at(angles) for one in self.bands), strict=True)
        return self.matrices(centres), self.matrices(radii)

    def errors(self, nominal: Complex, angles: Real, rounding: float = 1e-15) -> KnownErrors:
        """The entries of F less nominal values (N, ny, nu) at angles, these known up to rounding."""
        bound, radius, centre = np.empty(nominal.shape), np.empty(nominal.shape), np.empty(nominal.shape, complex)
        supports = np.zeros((angles.size, 0))
        for number, band in enumerate(self.bands):
            rows, columns = zip(*(place for place, own in self._numbers.items() if own == number), strict=True)
            own = band.errors(nominal[:, rows, columns], angles, rounding)
            bound[:, rows, columns], centre[:, rows, columns], radius[:, rows, columns] = own[:3]
            supports = own.supports if nominal[0].size == 1 else supports
        return KnownErrors(bound, centre, radius, supports)

    def errors_at(self, model: control.StateSpace, angles: Real) -> KnownErrors:
        """The entries of F - model at angles."""
        return self.errors(self.problem.plane.values(model, angles), angles, _ROUNDED)

    def open_arcs(self) -> list[tuple[float, float]]:
        """Arcs between angles on which nothing is said: around infinite radii, as far as they exceed the largest response."""
        ends: list[tuple[float, float]] = []
        for one in self.bands:
            if not (endless := np.isinf(one.radius)).any():
                continue
            lost = one.radius > np.abs(one.centre[~endless]).max(initial=0.0)
            starts = np.flatnonzero(lost & ~np.r_[False, lost[:-1]])
            stops = np.flatnonzero(lost & ~np.r_[lost[1:], False])
            ends += [
                (float(one.angles[max(a - 1, 0)]), float(one.angles[min(b + 1, one.angles.size - 1)]))
                for a, b in zip(starts.tolist(), stops.tolist(), strict=True)
                if endless[a : b + 1].any()
            ]
        found: list[tuple[float, float]] = []
        for low, high in sorted(ends):
            if found and low <= found[-1][1]:
                found[-1] = found[-1][0], max(high, found[-1][1])
            else:
                found.append((low, high))
        return found


def mixed(
    samples: Samples,
    extraction: Extraction,
    angles: Real,
    part: Real,
    low: tuple[NDArray[np.intp], Complex],
    high: tuple[NDArray[np.intp], Complex],
) -> tuple[Complex, Real]:
    """Centres and radii at angles with multipliers that are mixed from two others: (1 - part) and part of them."""
    count, t = low[0].shape[1], part[:, None]
    points = np.concatenate([low[0], high[0]], axis=1)
    a, b = (1 - t) * low[1], t * high[1]
    d = np.concatenate([a[:, :count], b[:, :count], a[:, count:] + b[:, count:]], axis=1)
    return evaluate(samples, extraction, angles, points, d)


def evaluate(
    samples: Samples, extraction: Extraction, angles: Real, points: NDArray[np.intp], d: Complex
) -> tuple[Complex, Real]:
    """Centres and radii of multipliers at angles."""
    return DiscValues(samples, extraction.known).at(angles, points, d)


def entry_band(
    extraction: Extraction, wanted: Real, low: float, high: float, budget: Budget | None = None
) -> EntryBand:
    """Search certificates at the wanted angles, at the lines and around the modes, and between them until interpolation does.

    Arcs that are still to be halved where the time is over leave a wider band.
    """
    samples = extraction.samples
    angles = apart(np.concatenate([wanted, first_knots(samples, low, high)]), _APART * (high - low))
    count = POINTS + min(int(samples.first.sum()), POINTS) // 2  # more where there are more functions to be told apart
    knots = angles, *_found(extraction, angles, count)
    open_arcs: NDArray[np.intp] = np.arange(angles.size - 1)
    for _ in range(_ROUNDS):
        if not open_arcs.size or (budget is not None and budget.over):
            break
        knots, open_arcs = _with_middles(extraction, knots, open_arcs, count, 4 * _APART * (high - low))
        if knots[0].size > _MOST:
            break
    complete = not (open_arcs.size and budget is not None and budget.over)
    return EntryBand(samples, extraction, *knots, complete)


def _with_middles(
    extraction: Extraction, knots: _Knots, arcs: NDArray[np.intp], count: int, least: float
) -> tuple[_Knots, NDArray[np.intp]]:
    """Knots with the middles of arcs among them, and the arcs beside middles where interpolation was loose, longer than `least`."""
    samples, (angles, points, d) = extraction.samples, knots
    middle = (angles[arcs] + angles[arcs + 1]) / 2
    low_end, high_end = [(points[k], np.asarray(d[k], dtype=complex)) for k in (arcs, arcs + 1)]
    _, between = mixed(samples, extraction, middle, np.full(middle.size, 0.5), low_end, high_end)
    new_points, new_d = _found(extraction, middle, count, heaviest(samples, low_end, high_end))
    _, direct = evaluate(samples, extraction, middle, new_points, new_d.astype(complex))
    loose = between > _LOOSE * direct
    order = np.argsort(np.concatenate([angles, middle]), kind="stable")
    fresh = np.concatenate([np.zeros(angles.size, bool), loose])[order]
    both = np.concatenate([angles, middle])[order]
    at = np.flatnonzero(fresh)
    beside = np.unique(np.concatenate([at - 1, at]))
    found = both, np.concatenate([points, new_points])[order], np.concatenate([d, new_d])[order]
    return found, beside[np.diff(both)[beside] > least]


def unsearched_band(samples: Samples, low: float, high: float) -> EntryBand:
    """Band of what the class says without any sample: discs without end where it has modes of unknown amplitudes."""

    def none(count: int) -> tuple[NDArray[np.intp], Complex]:
        return np.zeros((count, 0), np.intp), np.zeros((count, samples.rows), complex)

    amplitudes = samples.amplitudes
    extraction = Extraction(samples, np.zeros(amplitudes, complex), *none(amplitudes))
    points, d = none(2)
    return EntryBand(samples, extraction, np.array([low, high]), points, d.astype(np.complex64), complete=False)


def quick_band(extraction: Extraction, low: float, high: float, most: int) -> EntryBand:
    """Search certificates of fewer points at the first knots, and halve the widest arcs until there are `most` knots."""
    samples, least = extraction.samples, 4 * _APART * (high - low)
    angles = apart(first_knots(samples, low, high, int(_SHARE * most)), least)
    count = FEW + min(int(samples.first.sum()), FEW)
    band = EntryBand(samples, extraction, angles, *_found(extraction, angles, count, steps=_FEW_STEPS))
    radius, arcs, wider = band.radius, np.arange(angles.size - 1), np.zeros(angles.size - 1)
    while True:
        _, middle = band.between(arcs, np.full(arcs.size, 0.5))
        ends = np.minimum(radius[arcs], radius[arcs + 1])
        halved = np.isfinite(ends) & (np.diff(band.angles)[arcs] > least)
        wider[arcs[halved]] = middle[halved] / ends[halved]
        room = max(most - band.angles.size + 1, 0) // 2  # half of it now: the widest may need it again
        chosen = np.sort(np.argsort(-wider, kind="stable")[:room])
        chosen = chosen[wider[chosen] > _LOOSE]
        if not chosen.size:
            return band
        band, new = _halved(band, chosen, count)
        radius, wider = np.insert(radius, chosen + 1, new), np.insert(wider, chosen + 1, 0.0)
        first = chosen + np.arange(chosen.size)
        arcs = np.sort(np.concatenate([first, first + 1]))
        wider[arcs] = 0.0


def _halved(band: EntryBand, arcs: NDArray[np.intp], count: int) -> tuple[EntryBand, Real]:
    """The band with knots in the middle of arcs too, and the radii there."""
    middle = (band.angles[arcs] + band.angles[arcs + 1]) / 2
    start = heaviest(band.samples, band.of_knots(arcs), band.of_knots(arcs + 1))
    points, d = _found(band.extraction, middle, count, start)
    _, radius = evaluate(band.samples, band.extraction, middle, points, d.astype(complex))
    angles = np.insert(band.angles, arcs + 1, middle)
    points = np.insert(band.points, arcs + 1, points, axis=0)
    d = np.insert(band.multipliers, arcs + 1, d, axis=0)
    return EntryBand(band.samples, band.extraction, angles, points, d), radius


def _found(
    extraction: Extraction,
    angles: Real,
    count: int,
    start: tuple[NDArray[np.intp], Complex] | None = None,
    steps: int = STEPS,
) -> tuple[NDArray[np.intp], NDArray[np.complex64]]:
    samples, steps = extraction.samples, steps if start is None else _STEPS_BETWEEN
    points, d = search(samples, targets_at(samples, angles), extraction.known, points=count, steps=steps, start=start)
    return points, d.astype(np.complex64)


def apart(angles: Real, least: float) -> Real:
    """The angles, ascending, without those that are nearer than `least` to the one before; the last one is kept."""
    ascending = np.unique(angles)
    kept = [float(ascending[0])]
    for one in ascending[1:].tolist():
        if one - kept[-1] > least:
            kept.append(one)
    kept[-1] = float(ascending[-1])
    return np.array(kept)


def heaviest(
    samples: Samples, low: tuple[NDArray[np.intp], Complex], high: tuple[NDArray[np.intp], Complex]
) -> tuple[NDArray[np.intp], Complex]:
    """The points of two knots that bear most of their mean, as many as each has, and the mean of the multipliers there."""
    count = low[0].shape[1]
    points, d = np.empty_like(low[0]), np.empty_like(low[1])
    d[:, count:] = (low[1][:, count:] + high[1][:, count:]) / 2
    for k in range(len(points)):
        both, place = np.unique(np.concatenate([low[0][k], high[0][k]]), return_inverse=True)
        every = np.concatenate([low[1][k, :count], high[1][k, :count]]) / 2
        total = np.zeros(both.size, complex)
        np.add.at(total, place, every)
        most = np.argsort(-np.abs(total) * samples.bound[both])[:count]
        points[k], d[k, :count] = both[most], total[most]
    return points, d


def first_knots(samples: Samples, low: float, high: float, most: int = _LINES) -> Real:
    """The ends, the lines (or some of many), a grid outside of them, and angles around the modes."""
    lines = np.unique(np.abs(samples.angles))
    lines = lines[(lines >= low) & (lines <= high)]
    if lines.size > most:
        lines = lines[np.unique(np.linspace(0, lines.size - 1, most).round().astype(int))]
    inner = (float(lines[0]), float(lines[-1])) if lines.size else (low, low)
    parts = [lines, np.linspace(low, inner[0], _OUTSIDE // 4), np.linspace(inner[1], high, _OUTSIDE)]
    poles: list[complex] = [] if samples.functions.modes is None else samples.functions.modes.middle.tolist()
    if samples.functions.fixed is not None:
        poles += [p for p in samples.functions.fixed.poles.tolist() if p.imag > 0]
    for pole in poles:
        turn, width = float(np.angle(pole)), -float(np.log(abs(pole)))
        parts.append(turn + width * np.array([-k for k in _AROUND] + [0.0, *_AROUND]))
    every = np.concatenate(parts)
    return np.unique(np.concatenate([every[(every >= low) & (every <= high)], [low, high]]))


def multipliers_fit(samples: Samples, points: NDArray[np.intp], d: NDArray[np.complexfloating], count: int) -> bool:
    """Return whether so many rows of points and multipliers belong to the samples."""
    return bool(
        points.shape[:1] == (count,) == d.shape[:1]
        and d.shape[1] == points.shape[1] + samples.rows
        and (not points.size or (points.min() >= 0 and points.max() < samples.angles.size))
        and np.all(np.isfinite(d))
    )


def extraction_fits(found: Extraction) -> bool:
    """Return whether what bounds the amplitudes belongs to the samples."""
    g = found.samples.amplitudes
    return found.about.shape == (g,) and multipliers_fit(found.samples, found.points, found.multipliers, g)
