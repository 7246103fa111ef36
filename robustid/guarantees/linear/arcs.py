"""From the discs at knots to a bound of the error of a model on every arc between them, and beyond the last one."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import Complex, Real, StateMatrices
from robustid.guarantees.curvature import Curvature, input_normal, second_derivative
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.identification import MixedProblem

_FINE = 0.02  # of the larger bound at the ends: what the bend of an arc may add
_PARTS = 64  # of an arc, at most
_BEYOND = 64  # pieces of the arc from the last knot to infinity
_ONE = 1 + 1e-9


def arc_bounds(
    bands: dict[tuple[int, int], EntryBand],
    model: Any,
    problem: MixedProblem,
    corners: tuple[Real, Real] | None = None,
) -> tuple[Real, Real]:
    r"""Edges (angles) and bounds (arcs, ny, nu) of |F - model|, of every entry of every consistent system.

    Along an arc the error of a consistent system, E = F - model, obeys |E| <= (1 - t) u_0 + t u_1 + B h^2/8: u the bounds at its
    ends, with the multipliers of the arc, B a bound of |E''|. Arcs are divided until the last term is small; nothing is searched.
    `corners` are further angles and bounds (N, ny, nu) there: between two of them they are the u as well.
    """
    shape = model.D.shape
    knots = np.unique(np.concatenate([band.angles for band in bands.values()]))
    bend = Bends(problem, bands, model)
    if corners is not None:
        corners = np.clip(corners[0], knots[0], knots[-1]), corners[1]
        knots = np.union1d(knots, corners[0])
    edges, found = _halved(knots, bands, bend, model, problem)
    if corners is not None:
        found = _below_chords(edges, found, *corners, bend)
    top = np.pi if knots[-1] < np.pi else None
    if top is not None:
        edges = np.append(edges, top)
        found = np.concatenate([found, bend.beyond(float(knots[-1]))[None]])
    return edges, found.reshape(-1, *shape)


def _halved(
    knots: Real, bands: dict[tuple[int, int], EntryBand], bend: Bends, model: Any, problem: MixedProblem
) -> tuple[Real, Real]:
    """The arcs between knots of all entries, in as many parts as their bends ask for."""
    low, high = knots[:-1], knots[1:]
    ends = errors_at(bands, model, problem, knots)
    added = bend.of(low, high) * ((high - low) ** 2 / 8)[:, None, None]
    size = np.maximum(ends[:-1], ends[1:])
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(added / (_FINE * size), nan=0.0, posinf=_PARTS**2).max(axis=(1, 2))
    parts = np.clip(np.ceil(np.sqrt(ratio)), 1, _PARTS).astype(int)
    sides = zip(low.tolist(), high.tolist(), parts.tolist(), strict=True)
    inner: list[Real] = [np.linspace(a, b, n + 1)[:-1] for a, b, n in sides]
    edges = np.concatenate([*inner, knots[-1:]])
    at = errors_at(bands, model, problem, edges)
    widths = np.diff(edges)
    # The bend of the whole arc bounds that of its parts.
    again = np.repeat(added / parts[:, None, None] ** 2, parts, axis=0)
    coarse = np.repeat(parts == 1, parts)
    sharp = bend.of(edges[:-1][~coarse], edges[1:][~coarse]) * (widths[~coarse] ** 2 / 8)[:, None, None]
    again[~coarse] = np.minimum(again[~coarse], sharp)
    return edges, (np.maximum(at[:-1], at[1:]) + again) * _ONE


def _below_chords(edges: Real, found: Real, angles: Real, bounds: Real, bend: Bends) -> Real:
    """Bounds of arcs (A, ny, nu), or those of the arcs between neighbours of further angles, edges too, if smaller."""
    low, high = angles[:-1], angles[1:]
    further = np.maximum(bounds[:-1], bounds[1:]) + bend.of(low, high) * ((high - low) ** 2 / 8)[:, None, None]
    of = np.searchsorted(angles, (edges[:-1] + edges[1:]) / 2) - 1
    inside = (of >= 0) & (of < low.size)
    found[inside] = np.fmin(found[inside], further[of[inside]] * _ONE)
    return found


def errors_at(bands: dict[tuple[int, int], EntryBand], model: Any, problem: MixedProblem, angles: Real) -> Real:
    """Bounds of the entries of F - model at angles, (N, ny, nu)."""
    nominal = problem.plane.values(model, angles)
    found = np.empty(nominal.shape)
    for place in np.ndindex(*nominal.shape[1:]):
        centre, radius = band_of(bands, problem, place).at(angles)
        found[:, *place] = np.abs(centre - nominal[:, *place]) * _ONE + radius
    return found


def band_of(bands: dict[tuple[int, int], EntryBand], problem: MixedProblem, place: tuple[int, int]) -> EntryBand:
    """The discs of an entry; of symmetric matrices those of either one."""
    return bands[(min(place), max(place)) if problem.entries.symmetric else place]


class Bends:
    """Bounds of the second derivatives of E = F - model along arcs, entry by entry: the class, the amplitudes, and the model."""

    def __init__(self, problem: MixedProblem, bands: dict[tuple[int, int], EntryBand], model: Any) -> None:
        a, b, c, _ = problem.plane.in_z(StateMatrices.of(model))
        self.problem, self.bands, self.shape = problem, bands, model.D.shape
        self.model, self.known = model, input_normal(a, b, c)
        # Without a known part of its own: that of the model is added here, arcs of all lengths at once.
        none = np.zeros((0, 0)), np.zeros((0, model.D.shape[1])), np.zeros((model.D.shape[0], 0))
        self.of_class = Curvature(problem, none, None, np.zeros((0, *model.D.shape)), False)

    def of(self, low: Real, high: Real) -> Real:
        """Bounds on arcs, (arcs, ny, nu)."""
        found = np.zeros((low.size, *self.shape))
        for k, ends in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
            found[k] = self.of_class.largest(*ends) + second_derivative(*self.known, *ends)
        functions: Any = None
        for place in np.ndindex(*self.shape):
            band = band_of(self.bands, self.problem, place)
            functions = band.samples.functions.bends(low, high) if functions is None else functions
            found[:, *place] += functions @ self._largest(band)
        return found

    @staticmethod
    def _largest(band: EntryBand) -> Real:
        """Largest modulus of the amplitudes of the entry, (g,)."""
        count, target = band.samples.functions.amplitudes, band.samples.target
        return band.extraction.known.largest[target * count : (target + 1) * count]

    def beyond(self, last: float) -> Real:
        """Bound of the entries from the last knot to infinity, (ny, nu): the class, the functions and the model by their moduli."""
        angles = np.linspace(last, np.pi, _BEYOND + 1)
        low, high = angles[:-1], angles[1:]
        step = (high - low) ** 2 / 8
        values = np.abs(self.problem.plane.values(self.model, angles))
        bent = np.array(
            [second_derivative(*self.known, *ends) for ends in zip(low.tolist(), high.tolist(), strict=True)]
        )
        total = (np.maximum(values[:-1], values[1:]) + bent * step[:, None, None]).max(axis=0)
        prior = self.problem.prior
        weight = max(self.of_class.weight(*ends) for ends in zip(low.tolist(), high.tolist(), strict=True))
        total = total + prior.gain_bound * weight * prior.scales(*self.shape)
        for place in np.ndindex(*self.shape):
            band = band_of(self.bands, self.problem, place)
            total[place] += float((band.samples.functions.largest_on(low, high) @ self._largest(band)).max())
        return total * _ONE


def centre_and_radius(
    bands: dict[tuple[int, int], EntryBand], problem: MixedProblem, angles: Real
) -> tuple[Complex, Real]:
    """Centres and radii of all entries, (N, ny, nu)."""
    shape = angles.size, *problem.entries.shape
    centre, radius = np.empty(shape, complex), np.empty(shape)
    done: dict[int, tuple[Complex, Real]] = {}
    for place in np.ndindex(*shape[1:]):
        band = band_of(bands, problem, place)
        if id(band) not in done:
            done[id(band)] = band.at(angles)
        centre[:, *place], radius[:, *place] = done[id(band)]
    return centre, radius
