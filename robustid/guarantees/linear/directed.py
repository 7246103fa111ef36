"""Certificates of one direction each: linear bounds of Re(exp(-j theta) F) from samples and from polygons of solved frequencies.

Let f_k be what sample k sees, f_k(F) in a disc of y_k and eps_k or in a polygon P_k. For any complex c_k and every consistent F

    Re(exp(-j theta) F(z_0)) = sum_k Re(c_k f_k(F)) + Re r(G) + Re sum_i m_i p_i,

r and m_i what the sum misses of the non-parametric part and of the functions. The first term is at most Re(c_k y_k) + |c_k| eps_k
for a disc, and max Re(c_k v) over the corners of a polygon; the last one Re(m_i q_i) + |m_i| Delta_i, p_i within Delta_i of q_i.
G = K phi with real coefficients, which counts twice: c_k stands for a point and its conjugate, and with real p_i only Re m_i does.
Re r(G) <= K |r| in the real part of H2(mu), for every probability measure mu that is symmetric about the real axis, since phi has
at most norm 1 there. For mu the mean of the harmonic measures seen from b and b*, b the place of z_0, with a = |b|^2:

    mu = (1 - a) s/2 |1 - r x|^2 / |(1 - b x)(1 - b* x)|^2 dm,    s (1 + r^2) = 2 (1 + a), s r = 2 Re b,

so that 1/h, h(x) = (1 - b x)(1 - b* x)/((1 - r x) sqrt((1 - a) s/2)), is outer with mu = dm/|h|^2, and the kernel is k(z, w) =
h(z) h(w)*/(1 - z w*). Re(u phi(z)) has the representer (u* k(., z) + u k(., z*))/2, and two of them have the inner product
Re(u u'* k(z, z') + u u' k(z, z'*))/2. A sample of a record is a real functional U of the coefficients of phi, for which Re c
counts; of phi = h psi it sees sum_n (sum_m U_m h_(m-n)) psi_n, and these are the coefficients of its representer.

A disc of one certificate says the same in all directions, whatever the samples say; here the multipliers of a direction are those
that are best for the values that were measured. Between knots multipliers are mixed, direction by direction.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Array, Complex, Frozen, Real, freeze, kept_by_content
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.certificate import Targets, targets_at
from robustid.guarantees.linear.error_sets import KnownErrors
from robustid.guarantees.linear.polygon_discs import corners_of_supports, smallest_discs
from robustid.guarantees.linear.samples import KEPT, Samples

_EPS = float(np.finfo(float).eps)
_CORNERS = 1e-12  # relative rounding of corners


def directions(count: int) -> Complex:
    """Exp(-j theta) of so many equally spaced directions, (M,)."""
    return np.asarray(np.exp(-2j * np.pi * np.arange(count) / count), dtype=complex)


@dataclasses.dataclass(frozen=True, eq=False)
class Sides(Frozen):
    """Samples with polygons at the last of their points, as certificates of a direction see them.

    Points are numbered from 0 on, samples of records from the last one, -1, backwards: polygons come behind the lines.
    """

    samples: Samples
    extraction: Extraction
    corners: Complex  # (nodes, V), those of the last points; fewer ones repeat the last

    @property
    def half(self) -> int:
        """Number of points, without their conjugates."""
        return self.samples.angles.size // 2

    @property
    def first_node(self) -> int:
        """Number of the first point with a polygon."""
        return self.half - len(self.corners)

    def _numbered(self, at_points: Array, of_rows: Array) -> Array:
        """Values at points and conjugates, and those of rows, behind each other as they are numbered."""
        return np.concatenate([at_points[: self.half], of_rows])

    @functools.cached_property
    def values(self) -> Complex:
        """Functions at the points and in the rows of records, (half + T, m)."""
        return self._numbered(self.samples.values, self.samples.record_functions)

    @functools.cached_property
    def y(self) -> Complex:
        """Samples at points and in rows, (half + T,)."""
        return self._numbered(self.samples.y, self.samples.record_y.astype(complex))

    @functools.cached_property
    def bound(self) -> Real:
        """Their bounds, (half + T,)."""
        return self._numbered(self.samples.bound, self.samples.record_bound)

    @functools.cached_property
    def left_out_each(self) -> Real:
        """Most that the series leave out of them, (half + T, amplitudes)."""
        return self._numbered(self.samples.left_out, self.samples.record_left_out)

    @functools.cached_property
    def left_out(self) -> Real:
        """The same for the largest amplitudes, (half + T,)."""
        return self.left_out_each @ self.extraction.known.largest

    @functools.cached_property
    def reals(self) -> NDArray[np.bool_]:
        """Mask of the coefficients that are real numbers, (m,): amplitudes without a conjugate one."""
        at, first = self.samples.amplitude_of, self.samples.first
        count = np.bincount(at[first], minlength=self.samples.amplitudes)
        return first & (count[at] == 1) if at.size else first

    @functools.cached_property
    def twins(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Numbers of the complex coefficients, and of their conjugates, which stand behind them."""
        other = np.flatnonzero(self.samples.conjugate)
        return other - 1, other


class Measure:
    """The symmetric measure of a target at `base`."""

    def __init__(self, base: complex) -> None:
        self.base, a = base, abs(base) ** 2
        part = base.real / (1 + a)
        root = np.sqrt((1 - a) ** 2 + 4 * base.imag**2) / (1 + a)  # of 1 - 4 part^2, without cancellation
        self.zero = float(2 * part / (1 + root))
        self.level = float(np.sqrt((1 - a) * (1 + a) / (1 + self.zero**2)))

    def outer(self, x: Complex) -> Complex:
        """Values of h at x."""
        b = self.base
        return (1 - b * x) * (1 - np.conj(b) * x) / ((1 - self.zero * x) * self.level)

    @property
    def as_filter(self) -> tuple[Real, Real]:
        """Numerator and denominator of h."""
        b = self.base
        return np.array([1.0, -2 * b.real, abs(b) ** 2]) / self.level, np.array([1.0, -self.zero])


def kernels(z: Complex, w: Complex, other: Complex, weights: Complex) -> tuple[Complex, Complex]:
    """Inner products of the weights of points (n, C) with others (k, C) and with their conjugates, over 1 - z z'* and 1 - z z'."""
    plain = (w @ weights.conj().T) / (1 - z[:, None] * other.conj())
    return plain, (w @ weights.T) / (1 - z[:, None] * other)


def supports(sides: Sides, targets: Targets, points: NDArray[np.intp], c: Complex, turns: Complex) -> Real:
    """Bounds of Re(turn F) at the targets by multipliers (B, M, n) of points (n,), (B, M)."""
    samples, known = sides.samples, sides.extraction.known
    own = points < sides.first_node
    total = (c[:, :, own] * sides.y[points[own]]).real.sum(axis=2)
    size = np.abs(c)
    total += size[:, :, own] @ sides.bound[points[own]] + size @ sides.left_out[points]
    rounded = size[:, :, own] @ np.abs(sides.y[points[own]])
    if not own.all():
        corners = sides.corners[points[~own] - sides.first_node]
        total += (c[:, :, ~own, None] * corners).real.max(axis=3).sum(axis=2)
        total += _CORNERS * (size[:, :, ~own] @ np.abs(corners).max(axis=1))
    missed, terms = missed_of(sides, targets, points, c, turns)
    centre, radius = sides.extraction.known.coefficients(sides.samples)
    total += (missed @ centre).real + sizes_of(sides, missed) @ radius
    with np.errstate(invalid="ignore"):
        beyond = np.where(np.isinf(targets.left_out).any(axis=1), np.inf, targets.left_out @ known.largest)
    total += beyond[:, None] + class_bound(sides, targets, points, c, turns)
    rounded += terms @ known.largest[samples.amplitude_of] if terms.shape[2] else 0.0
    return total + _EPS * (8 * (points.size + 16) * rounded + 16 * (np.abs(total) + rounded))


def missed_of(
    sides: Sides, targets: Targets, points: NDArray[np.intp], c: Complex, turns: Complex
) -> tuple[Complex, Real]:
    """The m_i of all functions, (B, M, m), and the sizes of their terms."""
    values = sides.values[points]
    missed = turns[:, None] * targets.values[:, None, :] - c @ values
    return missed, np.abs(targets.values)[:, None, :] + np.abs(c) @ np.abs(values)


def sizes_of(sides: Sides, missed: Complex) -> Real:
    """Sizes of the m_i that count, (B, M, m)."""
    own, twin = sides.twins
    size = np.where(sides.reals, np.abs(missed.real), np.abs(missed))
    size[:, :, twin] = 0  # both together: Re(m p + m' p*) = Re((m + m'*) p)
    size[:, :, own] = np.abs(missed[:, :, own] + missed[:, :, twin].conj())
    return size


def left_by_series(sides: Sides, target: Targets, points: NDArray[np.intp], c: Complex, turn: Complex) -> Real:
    """Parts of the bound in one direction that the series of the amplitudes leave behind their first terms, (amplitudes,).

    Multipliers c (1, 1, n) of points (n,) for one target: smaller boxes of their poles make these parts smaller.
    """
    samples, known = sides.samples, sides.extraction.known
    further = ~samples.first
    size = sizes_of(sides, missed_of(sides, target, points, c, turn)[0])[0, 0] * known.coefficients(samples)[1]
    found = (np.abs(c[0, 0]) @ sides.left_out_each[points] + target.left_out[0].real) * known.largest
    np.add.at(found, samples.amplitude_of[further], size[further])
    return found


class SeenRows(NamedTuple):
    """Samples of records as a measure sees them: coefficients of their representers, and what these do at points."""

    coefficients: list[Real]  # (T, N) of every component
    gram: Real  # (T, T), inner products

    def at(self, z: Complex, weights: Complex) -> Complex:
        """Values psi of the representers at points (n,), times the weights (n, C), (T, n)."""
        found = np.zeros((len(self.gram), z.size), complex)
        for R, own in zip(self.coefficients, weights.T, strict=True):
            found += own * (R @ np.vander(z, R.shape[1], increasing=True).T)
        return found

    def of_entry(self, base: complex, component: int) -> Complex:
        """Values psi of the representers at one point, for a component, (T,)."""
        R = self.coefficients[component]
        return np.asarray(R @ np.vander(np.array([base]), R.shape[1], increasing=True)[0], dtype=complex)


def seen_rows(samples: Samples, numbers: NDArray[np.intp], measure: Measure) -> SeenRows:
    """Samples of records with negative numbers, as `Sides` has them."""
    import scipy.signal  # half of the time that importing this room took

    found: list[Real] = []
    for U in samples.blocks:
        turned = scipy.signal.lfilter(*measure.as_filter, U[numbers, ::-1], axis=1)
        found.append(np.asarray(turned, dtype=float)[:, ::-1])
    return SeenRows(found, np.asarray(sum(R @ R.T for R in found), dtype=float))


def class_bound(sides: Sides, targets: Targets, points: NDArray[np.intp], c: Complex, turns: Complex) -> Real:
    """K |r|, rounding included, (B, M)."""
    samples, rows = sides.samples, points[points < 0]
    points, c, of_rows = points[points >= 0], c[:, :, points >= 0], c[:, :, points < 0].real
    z, w = samples.nodes[points], samples.weights[points]
    plain, twice = kernels(z, w, z, w)
    measures = [Measure(b) for b in targets.base.tolist()]
    h = np.array([one.outer(z) for one in measures]).reshape(len(measures), points.size)
    at = np.array([complex(one.outer(np.array(one.base))) for one in measures])
    u, tau = c * h[:, None, :], (targets.weight * at)[:, None] * turns  # (B, M, n), (B, M)
    every = u.reshape(-1, points.size)
    square = ((every @ plain) * every.conj() + (every @ twice) * every).real.sum(axis=1).reshape(tau.shape)
    b, own_weight = targets.base[:, None], w[:, samples.target]
    onto, other = own_weight.conj() / (1 - b * z.conj()), own_weight / (1 - b * z)  # (B, n)
    square -= 2 * (tau * ((u.conj() @ onto[:, :, None]) + (u @ other[:, :, None]))[:, :, 0]).real
    own = np.abs(tau) ** 2 / (1 - np.abs(b) ** 2)
    square += own + (tau**2 / (1 - b**2)).real
    sizes = np.sqrt(own) + np.abs(u) @ np.sqrt(np.einsum("nn->n", plain).real)
    terms = points.size
    if rows.size:
        terms += rows.size + samples.blocks[0].shape[1]
        for k, measure in enumerate(measures):
            seen = seen_rows(samples, rows, measure)
            beside = (u[k] @ seen.at(z, w).T - tau[k][:, None] * seen.of_entry(measure.base, samples.target)).real
            square[k] += 4 * (of_rows[k] * beside).sum(axis=1) + 2 * ((of_rows[k] @ seen.gram) * of_rows[k]).sum(axis=1)
            sizes[k] += np.abs(of_rows[k]) @ np.sqrt(np.diag(seen.gram))
    inside = float(samples.problem.region.inside(np.append(np.abs(samples.angles), 0.0)).min())
    inside = min(inside, float((1 - np.abs(targets.base) ** 2).min(initial=1.0)))
    rounding = (8 * terms + 128 + 128 / inside) * _EPS
    return np.sqrt(np.maximum(square, 0.0) / 2 + rounding * sizes**2)


@dataclasses.dataclass(frozen=True, eq=False)
class DirectedBand(Frozen):
    """Polygons that hold an entry of every consistent system, at every angle between the first and the last knot."""

    sides: Sides
    angles: Real  # (F,), ascending
    points: NDArray[np.intp]  # (F, n)
    multipliers: NDArray[np.complex64]  # (F, M, n)
    complete: bool = True

    def __post_init__(self) -> None:
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in ("angles", "points", "multipliers")})

    @property
    def samples(self) -> Samples:
        """The samples, with nodes behind the points."""
        return self.sides.samples

    @property
    def extraction(self) -> Extraction:
        """Proofs of the amplitudes."""
        return self.sides.extraction

    @functools.cached_property
    def turns(self) -> Complex:
        """Exp(-j theta) of the directions, (M,)."""
        return directions(int(self.multipliers.shape[1]))

    @functools.cached_property
    def _at_knots(self) -> tuple[Complex, Real]:
        return self.at(self.angles)

    @functools.cached_property
    def knot_supports(self) -> Real:
        """Bounds of Re(exp(-j theta) F) at the knots, (F, M)."""
        targets, found = targets_at(self.samples, self.angles), np.empty((self.angles.size, self.turns.size))
        for k, c in enumerate(self.multipliers.astype(complex)):
            found[k] = supports(self.sides, targets[k : k + 1], self.points[k], c[None], self.turns)[0]
        return freeze(found)

    @property
    def centre(self) -> Complex:
        """Centres of discs around the polygons at the knots, (F,)."""
        return self._at_knots[0]

    @property
    def radius(self) -> Real:
        """Radii of these, (F,)."""
        return self._at_knots[1]

    def at(self, angles: Real) -> tuple[Complex, Real]:
        """Centres and radii of discs around the polygons at angles."""
        return smallest_discs(corners_of_supports(self.supports(angles)))

    def errors(self, nominal: Complex, angles: Real, rounding: float) -> KnownErrors:
        """F less nominal values (N, k) at angles, these known up to rounding: bounds and discs (N, k), supports of the first."""
        support = self.supports(angles)
        corners = corners_of_supports(support)
        centre, radius = smallest_discs(corners)
        away, sizes = corners[:, None, :] - nominal[:, :, None], _CORNERS * np.abs(corners)[:, None, :]
        far = np.abs(away) * (1 + rounding) + sizes
        bound = np.where(np.isnan(far).any(axis=2), np.inf, far.max(axis=2))
        spread = rounding * np.abs(nominal) + _CORNERS * np.abs(centre)[:, None]
        own = support - (self.turns * nominal[:, :1]).real + spread[:, :1]
        return KnownErrors(bound, centre[:, None] - nominal, radius[:, None] + spread, own)

    def supports(self, angles: Real) -> Real:
        """Bounds of Re(exp(-j theta) F) at angles, (N, M): an arc at a time, with the multipliers of both ends in proportion."""
        return self._kept_supports(angles)

    @functools.cached_property
    def _kept_supports(self) -> Callable[[Real], Real]:
        return kept_by_content(most=KEPT)(self._evaluated)

    def _evaluated(self, angles: Real) -> Real:
        found = np.empty((angles.size, self.turns.size))
        before = np.clip(np.searchsorted(self.angles, angles, side="right") - 1, 0, self.angles.size - 2)
        part = (angles - self.angles[before]) / (self.angles[before + 1] - self.angles[before])
        order = np.argsort(before, kind="stable")
        targets = targets_at(self.samples, angles[order])
        starts = np.flatnonzero(np.diff(before[order], prepend=-1))
        for start, stop in itertools.pairwise([*starts.tolist(), angles.size]):
            own = order[start:stop]
            points, low, high = self.of_arc(int(before[own[0]]))
            t = part[own][:, None, None]
            found[own] = supports(self.sides, targets[start:stop], points, (1 - t) * low + t * high, self.turns)
        return freeze(found)

    def of_arc(self, arc: int) -> tuple[NDArray[np.intp], Complex, Complex]:
        """The points of the knots at both ends of an arc, (n,), and the multipliers of these, (M, n) each."""
        points, place = np.unique(self.points[arc : arc + 2], return_inverse=True)
        place = place.reshape(2, -1)
        ends = np.zeros((2, self.turns.size, points.size), complex)
        for k in range(2):
            ends[k][:, place[k]] = self.multipliers[arc + k]
        return points, ends[0], ends[1]


def directed_fit(sides: Sides, points: NDArray[np.intp], c: NDArray[np.complexfloating], count: int) -> bool:
    """Return whether so many rows of points and multipliers belong to the samples, each point once in a row."""
    fits = c.ndim == 3 and points.ndim == 2 and (len(points), len(c)) == (count, count) and c.shape[1] >= 3
    if not (fits and c.shape[2] == points.shape[1] and np.all(np.isfinite(c))):
        return False
    inside = not points.size or (points.min() >= -sides.samples.rows and points.max() < sides.half)
    return bool(inside and np.all(np.diff(np.sort(points, axis=1), axis=1) > 0))
