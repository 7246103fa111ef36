"""From bounds of an error at frequencies to a bound on the whole unit circle, by adaptive refinement."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robustid.core import Complex, Frozen, Real, freeze, hz_span, hz_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.curvature import Curvature, curvature_of
from robustid.guarantees.linear.error_sets import ErrorSets
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.sweep import Means, value_sets
from robustid.guarantees.value_set import (
    FINE,
    Errors,
    ValueSet,
    by_frequency,
    directions_at,
    largest_errors,
    norm_of_bounds,
    schur_bound,
)
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control

_COARSE = 6, 0.05  # directions and gap of a first look at a frequency between others
_ROUNDED = 1 + 2e-6  # barely consistent data are given a level of 1 + 1e-6
_DOUBLES, _LITTLE = 4, 0.1  # of the highest frequency point, and of the weight there
_ALIKE = 1.05  # times the smallest bound of arcs that are joined
_PIECES = 64  # of the arc from the highest frequency point to infinity
_ROUNDS, LARGEST = 40, 4000  # refinements of the circle, and frequencies in all


@dataclasses.dataclass(frozen=True, eq=False)
class CircleBound(Frozen):
    """|F(exp(j omega T)) - model| <= bound_i for every consistent F and every omega in [edges_i, edges_(i+1)].

    MIMO: the largest singular value is at most bound_i, the norm of the matrix of the bounds of the entries.

    Attributes
    ----------
    edges : (C+1,) array, rad/s
        From 0, or from the first frequency point where the plant has an integrator, to pi/dt, or infinity in continuous time.
    bound : (C,) array
    lower : float
        Error of a consistent system at one of the edges, attained.
    converged : bool
        True if the largest bound is within the tolerance that was asked of the largest one at an edge.
    values : tuple of ValueSet
        At the edges, with their certificates; entry after entry.
    entries : (C, ny, nu) array
        Bounds of the entries of F - model.
    sets : ErrorSets
        Discs about other centres and polygons that hold F - model, where they are known.
    """

    edges: Real
    bound: Real
    lower: float
    converged: bool
    values: tuple[ValueSet, ...]
    entries: Any = None
    sets: Any = None

    def __post_init__(self) -> None:
        entries = freeze(self.bound[:, None, None] if self.entries is None else self.entries)
        sets = ErrorSets.about_zero(entries) if self.sets is None else ErrorSets(*map(freeze, self.sets))
        self._set(edges=freeze(self.edges), bound=freeze(self.bound), entries=entries, sets=sets)

    def sets_at(self, omega: Real) -> ErrorSets:
        """The sets of the arcs that hold frequencies; at an edge of that with the larger bound."""
        last = self.bound.size - 1
        right, left = (
            np.clip(np.searchsorted(self.edges, omega, side=side) - 1, 0, last) for side in ("right", "left")
        )
        return self.sets.of(np.where(self.bound[left] > self.bound[right], left, right))

    @property
    def largest(self) -> float:
        """The bound of the H-infinity norm of F - model."""
        return float(self.bound.max())

    @property
    def peak(self) -> float:
        """Middle of the cell with the largest bound, rad/s; of one without end its beginning."""
        cell = int(np.argmax(self.bound))
        low, high = self.edges[cell : cell + 2].tolist()
        return (low + high) / 2 if np.isfinite(high) else low


class Peak(NamedTuple):
    """Largest value over frequencies, for any consistent plant: an upper bound, and the frequency near which it is."""

    value: float
    omega: float  # rad/s


def joined(circle: CircleBound) -> tuple[Real, Real]:
    """Edges and bounds of fewer arcs: neighbours whose bounds differ by little make one, with the largest of them.

    InputError, with the frequencies, where an arc has no bound.
    """
    if (open_arcs := np.flatnonzero(~np.isfinite(circle.bound))).size:
        low, high = circle.edges[[open_arcs[0], open_arcs[-1] + 1]] / (2 * np.pi)
        where = f"from {hz_span(low, high)}" if np.isfinite(high) else f"above {hz_words(low)}"
        raise InputError(f"the error has no bound {where}, so that no weight exceeds it")
    starts, low, high = [0], circle.bound[0], circle.bound[0]
    for k, bound in enumerate(circle.bound.tolist()):
        low, high = min(low, bound), max(high, bound)
        if high > _ALIKE * low:
            starts.append(k)
            low = high = bound
    return circle.edges[[*starts, circle.bound.size]], np.maximum.reduceat(circle.bound, starts)


class Remembered:
    """The smallest bound on the circle that has been computed for a result, the only part of it that changes."""

    def __init__(self) -> None:
        self.bound: CircleBound | None = None

    def take(self, bound: CircleBound) -> None:
        """Remember a bound, unless one at most as large is known; of two as large (without end, say) that of more arcs."""
        if self.bound is None or (bound.largest, -bound.bound.size) < (self.bound.largest, -self.bound.bound.size):
            self.bound = bound


@dataclasses.dataclass(frozen=True, eq=False)
class ModelError:
    """F - model over all consistent F: its bounds at frequencies and between them, from value sets."""

    identification: Identification
    model: control.StateSpace
    parameters: ParameterIntervals
    lowest: float  # rad/s, where the circle begins if the plant has an integrator and there are no frequency points

    @functools.cached_property
    def curvature(self) -> Curvature:
        """Bounds of its second derivative along the circle."""
        return curvature_of(self.model, self.identification, self.parameters)

    @property
    def range(self) -> tuple[float, float]:
        """Ends of the circle, rad/s: from 0, or from the first frequency point where the plant has an integrator."""
        problem = self.identification.problem
        top, basis = problem.plane.top, problem.parametric
        if basis is None or not basis.has_integrator:
            return 0.0, top
        return float(min((f.omega.min() for f in problem.frequency), default=self.lowest)), top

    @property
    def end(self) -> float:
        """The last edge with value sets, rad/s: the top of the range; in continuous time the highest frequency point.

        Where the class falls beyond that, the first of its doubles at which little is left of it.
        """
        problem, top = self.identification.problem, self.range[1]
        if np.isfinite(top):
            return top
        last = float(max(f.omega.max() for f in problem.frequency))
        doubles = np.array([last * 2.0**k for k in range(_DOUBLES + 1)])
        sizes = problem.weighting.sizes(problem.plane.angles(doubles))
        small = np.flatnonzero(sizes <= _LITTLE * sizes[0])
        return float(doubles[small[0]]) if small.size else last

    @functools.cached_property
    def beyond(self) -> Real:
        """Bound of the entries from the last edge to infinity, (1, ny, nu): the class, and the rest by its ends and bends.

        Infinite for positive-real classes, of which nothing bounds the gain at infinity; (0, ny, nu) where the range ends there.
        """
        if self.range[1] <= self.end:
            return np.zeros((0, *self.model.D.shape))
        identification, plane = self.identification, self.identification.problem.plane
        prior = identification.problem.prior
        if prior.positive_real:  # they may grow like s
            return np.full((1, *self.model.D.shape), np.inf)
        scales = prior.scales(*self.model.D.shape)
        angles = np.linspace(float(plane.angles(np.array(self.end))), np.pi, _PIECES + 1)
        rest, reach = -plane.values(self.model, angles), np.zeros((angles.size, *scales.shape))
        if identification.problem.parametric is not None:
            functions = identification.problem.parametric.response(angles)
            parts = (-1, *scales.shape)
            rest = rest + np.tensordot(functions, identification.parameters.reshape(parts), 1)
            reach = np.tensordot(np.abs(functions), self.parameters.reach(identification.parameters).reshape(parts), 1)
        low, high = angles[:-1], angles[1:]
        step = ((high - low) ** 2 / 8)[:, None, None]
        bends = (self.curvature.outside(low, high) * step).max(axis=0)
        ball = prior.gain_bound * self.curvature.weight(low, high).max()
        return (ball * scales + (np.abs(rest) + reach).max(axis=0) * (1 + 1e-9) + bends)[None]

    def bends(self, low: Real, high: Real) -> Real:
        """Bounds of how far the error exceeds the larger one of those at the ends of each arc, entry by entry, (arcs, ny, nu)."""
        plane = self.identification.problem.plane
        a, b = plane.angles(low), plane.angles(high)
        width = (high - low) * plane.dt if plane.dt else b - a
        return self.curvature.largest(a, b) * (width**2 / 8)[:, None, None]

    def at(self, sets: dict[float, tuple[ValueSet, ...]]) -> tuple[Errors, ...]:
        """Bounds at frequencies, from the value sets of their entries."""
        omega = np.array(list(sets))
        nominal = self.identification.problem.plane.values_at(self.model, omega)
        limits = norms_of_class(self.identification, self.parameters, nominal, omega)
        limits = np.minimum(limits, norms_of_samples(self.identification.problem, nominal, omega))
        return tuple(largest_errors(*each) for each in zip(sets.values(), nominal, limits.tolist(), strict=True))

    def arrays_at(self, sets: dict[float, tuple[ValueSet, ...]]) -> tuple[Real, Real, Real]:
        """Bounds of the entries (F, ny, nu), and the bound and an attained value of the largest singular value (F,)."""
        found = self.at(sets)
        sigma = np.array([(e.sigma_upper, e.sigma_lower) for e in found])
        return np.array([e.upper for e in found]), sigma[:, 0], sigma[:, 1]


def refine(
    error: ModelError,
    consistent: ConsistentSet,
    values: Sequence[ValueSet],
    before: CircleBound | None,
    settings: tuple[int, float],
    rtol: float,
    everywhere: bool,
    means: Means,
    most: int = LARGEST,
) -> CircleBound:
    """Halve the arcs whose bound exceeds the largest error (or that at its own ends) by more than rtol, up to `most` frequencies.

    Within the time; `values`, of `settings` (directions and gap), and those of a bound `before` are used again. New ends get a
    coarse value set, which does for most of them, and a fine one where the arc is short enough for it to matter.
    """
    plane, bottom, last = error.identification.problem.plane, error.range[0], error.end
    known = by_frequency(before.values if before is not None else ())
    known |= {w: sets for w, sets in by_frequency(values).items() if bottom <= w <= last}
    fine = {
        w
        for w, sets in known.items()
        if np.isin(sets[0].directions, directions_at(w, plane.dt, FINE * settings[0])).all()
    }
    limits: dict[tuple[float, float], Real] = {}
    coarse: list[float] = [w for w in (bottom, last) if w not in known]
    sharp: list[float] = []
    rounds = 0
    while True:
        rounds += 1
        cut = rounds > 1 and means.budget is not None and means.budget.over
        for wanted, how in ((coarse, _COARSE), (sharp, settings)):
            if cut:
                break
            # The ends of the circle, first of all, whatever they take.
            now = means if rounds > 1 else means._replace(budget=None)
            found = by_frequency(value_sets(consistent, np.array(wanted), *how, now, error.model))
            known |= found
            fine |= set(found) & set(sharp)
            cut |= len(found) < len(wanted)
        result, coarse, sharp = _halved(error, known, fine, limits, rtol, everywhere)
        if result.converged or cut or len(known) + len(coarse) > most or rounds == _ROUNDS:
            return result


def _halved(
    error: ModelError,
    known: dict[float, tuple[ValueSet, ...]],
    fine: set[float],
    limits: dict[tuple[float, float], Real],
    rtol: float,
    everywhere: bool,
) -> tuple[CircleBound, list[float], list[float]]:
    """The bound on the circle from value sets, and the frequencies that it asks for: coarse ones and fine ones.

    `limits` are the bends of arcs, remembered from round to round.
    """
    edges = np.array(sorted(known))
    entries, upper, lower = error.arrays_at({w: known[w] for w in edges.tolist()})
    sure = np.where([w in fine for w in edges], upper, lower)  # errors known to be about that large
    ends = np.maximum(sure[:-1], sure[1:])
    peak = ends if everywhere else np.full(ends.size, sure.max())
    arcs = list(itertools.pairwise(edges.tolist()))
    new = [arc for arc in arcs if arc not in limits]
    limits |= dict(zip(new, error.bends(*np.array(new).reshape(-1, 2).T), strict=True))
    bends = np.array([limits[arc] for arc in arcs])
    bounds, bound = _between(entries, upper, bends)
    open_arcs = np.flatnonzero(bound > (1 + rtol) * peak)
    further = error.beyond
    result = CircleBound(
        np.append(edges, [error.range[1]] * len(further)),
        np.append(bound, norm_of_bounds(further)),
        float(lower.max()),
        open_arcs.size == 0,
        tuple(one for w in edges.tolist() for one in known[w]),
        np.concatenate([bounds, further]),
    )
    coarse: list[float] = []
    sharp: set[float] = set()
    for k, bend in zip(open_arcs.tolist(), norm_of_bounds(bends[open_arcs]).tolist(), strict=True):
        ends_of_arc = zip(arcs[k], upper[k : k + 2].tolist(), strict=True)
        rough = [w for w, u in ends_of_arc if w not in fine and u + bend > peak[k]]
        if bend <= 0.5 * rtol * peak[k] and rough:
            sharp.update(rough)
        else:
            coarse.append(error.identification.problem.plane.middle(*arcs[k]))
    return result, coarse, sorted(sharp)


def supported(error: ModelError, circle: CircleBound) -> bool:
    """Return whether the value sets at its edges, whose certificates are claims of their own, give the bounds that it states."""
    sets = by_frequency(circle.values)
    omega = np.array(list(sets))
    (bottom, top), last = error.range, error.end
    edges = omega if top == last else np.append(omega, top)
    if not np.array_equal(edges, circle.edges) or (bottom, last) != (omega[0], omega[-1]):
        return False
    entries, upper, _ = error.arrays_at(sets)
    further = error.beyond
    bends = error.bends(omega[:-1], omega[1:])
    bounds, norms = _between(entries, upper, bends)
    bounds, norms = np.concatenate([bounds, further]), np.append(norms, norm_of_bounds(further))
    return bool(np.all(bounds <= circle.entries * (1 + 1e-9)) and np.all(norms <= circle.bound * (1 + 1e-9)))


def _between(entries: Real, upper: Real, bends: Real) -> tuple[Real, Real]:
    """Bounds of the entries (C, ny, nu) on the arcs between edges, and of the largest singular value (C,), also from its own."""
    bounds = np.maximum(entries[:-1], entries[1:]) + bends
    return bounds, np.minimum(norm_of_bounds(bounds), np.maximum(upper[:-1], upper[1:]) + norm_of_bounds(bends))


def norms_of_samples(problem: MixedProblem, nominal: Complex, omega: Real) -> Real:
    """Bound of the largest singular value of F - nominal from the samples at the same frequencies, (F,); inf where there are none.

    sigma(F - N) <= sigma(y - N) + the largest sigma of an error that the bound allows: of columns the norm of their bounds, of
    whole matrices the largest half-axis of the ellipsoid. Bounds of entries alone are in those of the entries.
    """
    limits = np.full(omega.size, np.inf)
    for frf in problem.frequency:
        if not isinstance(frf, FrequencyResponse) or frf.bound.joint == "entry" or not frf.bound.used.all():
            continue
        bound = frf.bound
        if bound.joint == "matrix":
            reach = np.sqrt(np.linalg.eigvalsh(bound.ellipsoid)[:, -1])
        else:
            reach = np.linalg.norm(bound.radius.max(axis=1), axis=1)
        for here, there in zip(*np.nonzero(omega[:, None] == frf.omega), strict=True):
            off = float(np.linalg.norm(frf.values[there] - nominal[here], 2))
            limits[here] = min(limits[here], (off + reach[there]) * _ROUNDED)
    return limits


def norms_of_class(
    identification: Identification, parameters: ParameterIntervals, nominal: Complex, omega: Real
) -> Real:
    """Bound of the largest singular value of F - nominal from the class and the intervals of the parameters alone, (F,).

    Infinite where these are not complete, and of classes without a gain bound.
    """
    if not parameters.complete or identification.problem.prior.positive_real:
        return np.full(omega.size, np.inf)
    problem, (_, p, q) = identification.problem, nominal.shape
    known, loose, rounding = -nominal, np.zeros(nominal.shape), np.linalg.norm(nominal, axis=(1, 2))
    if problem.parametric is not None:
        functions = problem.parametric.response(problem.plane.angles(omega))
        reach = parameters.reach(identification.parameters).reshape(-1, p, q)
        outside = np.tensordot(functions, identification.parameters.reshape(-1, p, q), 1)
        known, loose = known + outside, np.tensordot(np.abs(functions), reach, 1)
        rounding = rounding + np.linalg.norm(outside, axis=(1, 2))
    ball = problem.prior.gain_bound * schur_bound(problem.prior.scales(p, q))
    ball = ball * problem.weighting.sizes(problem.plane.angles(omega))
    return (ball + np.linalg.norm(known, 2, axis=(1, 2)) + norm_of_bounds(loose) + 1e-9 * rounding) * (1 + 1e-9)


def union_of_circles(circles: Sequence[CircleBound]) -> CircleBound:
    """The largest bound of several on every arc between the edges of all; its values are those of the members."""
    edges = np.unique(np.concatenate([circle.edges for circle in circles]))
    low, high = max(circle.edges[0] for circle in circles), min(circle.edges[-1] for circle in circles)
    edges = edges[(edges >= low) & (edges <= high)]
    middle = (edges[:-1] + edges[1:]) / 2
    at = [np.searchsorted(circle.edges, middle) - 1 for circle in circles]
    bound = np.max([circle.bound[k] for circle, k in zip(circles, at, strict=True)], axis=0)
    entries = np.max([circle.entries[k] for circle, k in zip(circles, at, strict=True)], axis=0)
    lower, converged = max(circle.lower for circle in circles), all(circle.converged for circle in circles)
    return CircleBound(edges, bound, lower, converged, (), entries)
