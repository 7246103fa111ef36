"""From the discs at knots to a bound of the error of a model on every arc between them, and beyond the last one."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Real, StateMatrices
from robustid.guarantees.curvature import ArcDerivatives, Curvature, input_normal
from robustid.guarantees.linear.entry_band import EntryBands
from robustid.guarantees.linear.error_sets import ErrorSets

if TYPE_CHECKING:
    import control

_FINE = 0.02  # of the larger bound at the ends: what the bend of an arc may add
_PARTS = 4, 4, 4, 1  # of an arc, of each of these, and so on, at most
_BEYOND = 64  # pieces of the arc from the last knot to infinity
_ONE = 1 + 1e-9


def arc_bounds(
    bands: EntryBands, model: control.StateSpace, corners: tuple[Real, Real] | None = None
) -> tuple[Real, ErrorSets]:
    r"""Edges (angles) of arcs, and sets that hold E = F - model on them, of every entry of every consistent system.

    |E| <= (1 - t) u_0 + t u_1 + B h^2/8 along an arc: u its multipliers' bounds of E at its ends, or those of `corners` (angles,
    and bounds (N, ny, nu)), B a bound of |E''|; other discs and polygons follow from `KnownErrors.on_arcs`. Arcs are divided until
    the last term is small; nothing is searched.
    """
    knots = bands.knots()
    bend = Bends(bands, model)
    if corners is not None:
        corners = np.clip(corners[0], knots[0], knots[-1]), corners[1]
        knots = np.union1d(knots, corners[0])
    edges, found = _divided(knots, bands, bend, model)
    if corners is not None:
        found = found._replace(bound=_below_chords(edges, np.array(found.bound), *corners, bend))
    top = np.pi if knots[-1] < np.pi else None
    if top is not None:
        edges = np.append(edges, top)
        found = found.followed_by(bend.beyond(float(knots[-1])))
    return edges, found


def _divided(knots: Real, bands: EntryBands, bend: Bends, model: control.StateSpace) -> tuple[Real, ErrorSets]:
    """The arcs between knots of all entries, in as many parts as their bends ask for, a few at a time: shorter arcs bend less."""
    edges, at = knots, bands.errors_at(model, knots)
    added, asked = np.full((edges.size - 1, *bend.shape), np.inf), np.arange(edges.size - 1)
    for most in _PARTS:
        low, high = edges[asked], edges[asked + 1]
        own = bend.of(low, high) * ((high - low) ** 2 / 8)[:, None, None]
        # The bend of a whole arc bounds that of its parts.
        added[asked] = np.fmin(added[asked], own)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = added[asked] / (_FINE * np.maximum(at.bound[asked], at.bound[asked + 1]))
        ratio = np.nan_to_num(ratio, nan=0.0, posinf=most**2).max(axis=(1, 2))
        parts = np.ones(edges.size - 1, int)
        parts[asked] = np.clip(np.ceil(np.sqrt(ratio)), 1, most).astype(int)
        if parts.max() == 1:
            break
        sides = zip(edges[:-1].tolist(), edges[1:].tolist(), parts.tolist(), strict=True)
        inner: list[Real] = [np.linspace(a, b, n + 1)[:-1] for a, b, n in sides]
        kept = np.append(0, np.cumsum(parts))
        edges = np.concatenate([*inner, edges[-1:]])
        new = np.setdiff1d(np.arange(edges.size), kept, assume_unique=True)
        at = at.in_order(bands.errors_at(model, edges[new]), np.argsort(np.concatenate([kept, new])))
        added = np.repeat(added / (parts**2)[:, None, None], parts, axis=0)
        asked = np.flatnonzero(np.repeat(parts > 1, parts))
    return edges, at.on_arcs(added)


def _below_chords(edges: Real, found: Real, angles: Real, bounds: Real, bend: Bends) -> Real:
    """Bounds of arcs (A, ny, nu), or those of the arcs between neighbours of further angles, edges too, if smaller."""
    low, high = angles[:-1], angles[1:]
    further = np.maximum(bounds[:-1], bounds[1:]) + bend.of(low, high) * ((high - low) ** 2 / 8)[:, None, None]
    of = np.searchsorted(angles, (edges[:-1] + edges[1:]) / 2) - 1
    inside = (of >= 0) & (of < low.size)
    found[inside] = np.fmin(found[inside], further[of[inside]] * _ONE)
    return found


class Bends:
    """Bounds of the second derivatives of E = F - model along arcs, entry by entry: the class, the amplitudes, and the model."""

    def __init__(self, bands: EntryBands, model: control.StateSpace) -> None:
        problem = bands.problem
        a, b, c, _ = problem.plane.in_z(StateMatrices.of(model))
        self.problem, self.bands, self.shape = problem, bands, bands.problem.entries.shape
        self.model, self.known = model, ArcDerivatives(*input_normal(a, b, c))
        # Without a known part of its own: that of the model is added here, arcs of all lengths at once.
        none = np.zeros((0, 0)), np.zeros((0, self.shape[1])), np.zeros((self.shape[0], 0))
        self.of_class = Curvature(problem, none, None, np.zeros((0, *self.shape)), False)

    def of(self, low: Real, high: Real) -> Real:
        """Bounds on arcs, (arcs, ny, nu)."""
        found = self.known.on_arcs(low, high) + self.of_class.largest(low, high)
        functions: Real | None = None
        for place in np.ndindex(*self.shape):
            band = self.bands.of(place)
            functions = band.samples.functions.bends(low, high) if functions is None else functions
            found[:, *place] += functions @ band.extraction.known.largest[band.samples.own_amplitudes]
        return found

    def beyond(self, last: float) -> Real:
        """Bound of the entries from the last knot to infinity, (ny, nu): the class, the functions and the model by their moduli."""
        angles = np.linspace(last, np.pi, _BEYOND + 1)
        low, high = angles[:-1], angles[1:]
        step = (high - low) ** 2 / 8
        values = np.abs(self.problem.plane.values(self.model, angles))
        bent = self.known.on_arcs(low, high)
        total = (np.maximum(values[:-1], values[1:]) + bent * step[:, None, None]).max(axis=0)
        prior = self.problem.prior
        total = total + prior.gain_bound * self.of_class.weight(low, high).max() * prior.scales(*self.shape)
        for place in np.ndindex(*self.shape):
            band = self.bands.of(place)
            total[place] += float(
                (
                    band.samples.functions.largest_on(low, high)
                    @ band.extraction.known.largest[band.samples.own_amplitudes]
                ).max()
            )
        return total * _ONE
