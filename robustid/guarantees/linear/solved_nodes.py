"""Values that are known at further frequencies, as samples of linear certificates: sums over lines and these."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Real
from robustid.guarantees.linear.amplitudes import Extraction, amplitude_targets, extract
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.directed import DirectedBand, Sides
from robustid.guarantees.linear.directed_search import around_nodes, directed_band, searched_further
from robustid.guarantees.linear.entry_band import EntryBand, EntryBands, apart, evaluate, first_knots, mixed
from robustid.guarantees.linear.error_sets import KnownErrors
from robustid.guarantees.linear.samples import Number, Samples
from robustid.guarantees.linear.search import search

_NEAREST = 6  # nodes that join the points of a knot, with their conjugates
_ROUNDS, _LOOSE = 5, 1.04  # of halving arcs, and of the radius between knots over that of a search there
_PAYS = 0.98  # of a radius: multipliers with nodes are taken where they are below
_APART = 1e-7  # of the range: shorter arcs are not halved, and nodes this near to a knot are no knots of their own

Multipliers = tuple[NDArray[np.intp], Complex]


class Nodes(NamedTuple):
    """Polygons, and discs around them, that hold the values of an entry of every consistent system at angles, (N,) each."""

    angles: Real
    centre: Complex
    radius: Real
    corners: Complex  # (N, V), the last one again where there are fewer

    def only(self, use: NDArray[np.bool_]) -> Nodes:
        """Some of them."""
        return Nodes(self.angles[use], self.centre[use], self.radius[use], self.corners[use])


NO_NODES = Nodes(np.zeros(0), np.zeros(0, complex), np.zeros(0), np.zeros((0, 1), complex))


def with_nodes(samples: Samples, nodes: Nodes) -> Samples:
    """The samples with nodes behind the points, and their conjugates behind the conjugate points."""
    half, count = samples.angles.size // 2, nodes.angles.size
    v = np.zeros((count, len(samples.components)), complex)
    v[:, samples.target] = 1

    def joined(old: NDArray[Number], new: NDArray[Number], conjugate: NDArray[Number]) -> NDArray[Number]:
        return np.concatenate([old[:half], new, old[half:], conjugate])

    return dataclasses.replace(
        samples,
        angles=joined(samples.angles, nodes.angles, -nodes.angles),
        v=joined(samples.v, v, v),
        y=joined(samples.y, nodes.centre, nodes.centre.conj()),
        bound=joined(samples.bound, nodes.radius, nodes.radius),
    )


def said(samples: Samples, nodes: Nodes) -> Nodes:
    """The nodes with finite discs at which the series of the modes say something."""
    use = np.isfinite(nodes.radius) & np.isfinite(samples.functions.left_out(nodes.angles)).all(axis=1)
    return nodes.only(use)


def of_directions(band: EntryBand, budget: Budget) -> EntryBand | DirectedBand:
    """The same entry by certificates of one direction each; itself where they do not pay."""
    samples, extraction = band.samples, band.extraction
    if not np.all(np.isfinite(extraction.known.radius)):
        return band
    low, high = band.angles[[0, -1]].tolist()
    least = _APART * (high - low)
    sides, angles = Sides(samples, extraction, NO_NODES.corners), apart(first_knots(samples, low, high), least)
    return directed_band(sides, angles, least, budget, band.at(angles)[1]) or band


def joined_band(
    band: EntryBand, directed: EntryBand | DirectedBand, nodes: Nodes, budget: Budget | None
) -> EntryBand | DirectedBand:
    """The band with certificates over lines and nodes; those that are `directed`, or more, where no node has a smaller disc.

    Of one direction each, with the polygons of the nodes, from those of the lines on where they are known, which stand without
    time. Where they aren't, those of all directions, with the discs of the nodes: sooner, and wider.
    """
    if isinstance(directed, DirectedBand) and (budget is None or budget.over):
        return directed  # a mixture with few polygons, in which nothing is searched, could be wider between them
    nodes = said(band.samples, nodes)
    inside = (nodes.angles >= band.angles[0]) & (nodes.angles <= band.angles[-1])
    found = None
    if np.any(nodes.radius[inside] < _PAYS * directed.at(nodes.angles[inside])[1]):
        found = _Search(band, nodes)
    if found is not None and np.all(np.isfinite(found.extraction.known.radius)):
        if isinstance(directed, DirectedBand) and budget is not None:
            return found.around(directed, budget)
        alone = None if budget is None else found.directed(budget)
        return found.band() if alone is None else alone
    if isinstance(directed, DirectedBand) and budget is not None and budget.seconds is not None:
        return searched_further(directed, _APART * float(np.ptp(band.angles)), budget)
    return directed


class _Search:
    """Multipliers of lines and nodes, from those of the lines on."""

    def __init__(self, band: EntryBand, nodes: Nodes) -> None:
        self._plain, self._nodes = band, nodes
        self.samples = with_nodes(band.samples, nodes)
        half, count = self.samples.angles.size // 2, nodes.angles.size
        own = half - count + np.arange(count)
        self._own, self._least = np.stack([own, own + half]), _APART * float(np.ptp(band.angles))

    def _started(self, near: NDArray[np.intp], points: NDArray[np.intp], d: Complex) -> Multipliers:
        """Rows of points of the lines and multipliers, with so many nodes (B, n) behind the points, of multiplier 0."""
        count, zeros = points.shape[1], np.zeros((len(points), 2 * near.shape[1]), complex)
        points = points + self._nodes.angles.size * (points >= self._plain.samples.angles.size // 2)
        points = np.concatenate([points, self._own[0][near], self._own[1][near]], axis=1)
        return points, np.concatenate([d[:, :count], zeros, d[:, count:]], axis=1)

    @functools.cached_property
    def extraction(self) -> Extraction:
        """The amplitudes as the lines prove them, or smaller discs with nodes."""
        plain, targets = self._plain.extraction, amplitude_targets(self.samples)
        if not np.all(np.isfinite(plain.known.radius)):
            return extract(self.samples)
        away = np.abs(self.samples.nodes[self._own[0]] - targets.base[:, None])
        start = self._started(np.argsort(away, axis=1, kind="stable")[:, :_NEAREST], plain.points, plain.multipliers)
        best = Extraction(self.samples, plain.about, *start)
        new = search(self.samples, targets, best.known, start=start)
        found = Extraction(self.samples, best.known.centre, *new)
        return found if found.known.radius.sum() < best.known.radius.sum() else best

    def band(self) -> EntryBand:
        """Knots of the lines and of the nodes, and further ones where mixing loses; from a knot that gained to the next."""
        low, high = self._plain.angles[[0, -1]]
        inside = (self._nodes.angles > low) & (self._nodes.angles < high)
        angles = apart(np.concatenate([self._plain.angles, self._nodes.angles[inside]]), self._least)
        points, d = self._started(self._nearest(angles), *self._of_plain(angles))
        before = self._radius(angles, points, d)
        points, d, after = self._improved(angles, points, d, before)
        gained = after < before
        open_arcs = np.flatnonzero(gained[:-1] | gained[1:])
        for _ in range(_ROUNDS):
            open_arcs = open_arcs[np.diff(angles)[open_arcs] > self._least]
            if not open_arcs.size:
                break
            middle, half = (angles[open_arcs] + angles[open_arcs + 1]) / 2, np.full(open_arcs.size, 0.5)
            ends = [(points[k], d[k]) for k in (open_arcs, open_arcs + 1)]
            _, between = mixed(self.samples, self.extraction, middle, half, *ends)
            start = self._mean(middle, *ends)
            new_points, new_d, direct = self._improved(middle, *start, self._radius(middle, *start))
            loose = between > _LOOSE * direct
            at = open_arcs[loose] + 1
            angles = np.insert(angles, at, middle[loose])
            points, d = np.insert(points, at, new_points[loose], axis=0), np.insert(d, at, new_d[loose], axis=0)
            first = open_arcs[loose] + np.arange(at.size)
            open_arcs = np.concatenate([first, first + 1])
            open_arcs.sort()
        return EntryBand(self.samples, self.extraction, angles, points, d.astype(np.complex64))

    def directed(self, budget: Budget) -> DirectedBand | None:
        """Knots of few lines and of the nodes, and further ones where mixing loses; None where there is no time."""
        low, high = self._plain.angles[[0, -1]].tolist()
        inside = (self._nodes.angles > low) & (self._nodes.angles < high)
        first = first_knots(self._plain.samples, low, high)
        angles = apart(np.concatenate([first, self._nodes.angles[inside]]), self._least)
        sides = Sides(self.samples, self.extraction, self._nodes.corners)
        return directed_band(sides, angles, self._least, budget)

    def around(self, directed: DirectedBand, budget: Budget) -> DirectedBand:
        """Certificates of one direction each, from those of the lines on."""
        low, high = self._plain.angles[[0, -1]]
        inside = self._nodes.angles[(self._nodes.angles >= low) & (self._nodes.angles <= high)]
        sides = Sides(self.samples, self.extraction, self._nodes.corners)
        return around_nodes(directed, sides, inside, self._least, budget)

    def _of_plain(self, angles: Real) -> Multipliers:
        """Points and multipliers of the lines at angles: those of the nearest knot."""
        knots = self._plain.angles
        before = np.clip(np.searchsorted(knots, angles, side="right") - 1, 0, knots.size - 2)
        return self._plain.of_knots(before + (angles - knots[before] > knots[before + 1] - angles))

    def _mean(self, angles: Real, low: Multipliers, high: Multipliers) -> Multipliers:
        """Mean multipliers of pairs of knots at as many points as each: the nodes nearest to angles, and the heaviest others."""
        count, near = low[0].shape[1], self._own[:, self._nearest(angles)].swapaxes(0, 1).reshape(angles.size, -1)
        points, d = np.empty_like(low[0]), np.empty_like(low[1])
        d[:, count:] = (low[1][:, count:] + high[1][:, count:]) / 2
        for k, kept in enumerate(near):
            total = np.zeros(self.samples.angles.size, complex)
            for one, every in (low, high):
                np.add.at(total, one[k], every[k, :count] / 2)
            weight = np.abs(total) * self.samples.bound
            weight[np.setdiff1d(np.arange(weight.size), np.concatenate([low[0][k], high[0][k]]))] = -1
            weight[kept] = np.inf
            points[k] = np.argsort(-weight, kind="stable")[:count]
            d[k, :count] = total[points[k]]
        return points, d

    def _nearest(self, angles: Real) -> NDArray[np.intp]:
        """Numbers of the nodes nearest to angles, (B, n)."""
        away = np.abs(self._nodes.angles - angles[:, None])
        return np.argsort(away, axis=1, kind="stable")[:, :_NEAREST]

    def _radius(self, angles: Real, points: NDArray[np.intp], d: Complex) -> Real:
        return evaluate(self.samples, self.extraction, angles, points, d)[1]

    def _improved(
        self, angles: Real, points: NDArray[np.intp], d: Complex, before: Real
    ) -> tuple[NDArray[np.intp], Complex, Real]:
        """Points and multipliers that are searched with the same points, where that pays, and radii."""
        # Not from the multipliers of the lines: weights of nodes that are zero there would hardly move.
        _, new = search(self.samples, targets_at(self.samples, angles), self.extraction.known, points=points)
        new = new.astype(np.complex64).astype(complex)
        after = self._radius(angles, points, new)
        better = after < _PAYS * before
        return points, np.where(better[:, None], new, d), np.where(better, after, before)


@dataclasses.dataclass(frozen=True, eq=False)
class JoinedBands(EntryBands):
    """Bounds of all entries from certificates over lines and nodes, beside discs over lines alone: the smaller ones."""

    bands: tuple[EntryBand | DirectedBand, ...]  # type: ignore[reportIncompatibleVariableOverride]
    plain: EntryBands

    def knots(self) -> Real:
        """Angles of the knots of both."""
        return np.union1d(super().knots(), self.plain.knots())

    def at(self, angles: Real) -> tuple[Complex, Real]:
        """Centres and radii at angles between the knots, (N, ny, nu)."""
        (centre, radius), (plain, least) = super().at(angles), self.plain.at(angles)
        return np.where(radius < least, centre, plain), np.minimum(radius, least)

    def errors(self, nominal: Complex, angles: Real, rounding: float = 1e-15) -> KnownErrors:
        """The smaller bounds, discs and supports of those by both."""
        return super().errors(nominal, angles, rounding).or_smaller(self.plain.errors(nominal, angles, rounding))
