r"""Values of the maps of a loop over all R within bounds, at points and on pieces of arc.

From r at the input and d at the output of the plant to u and y, with :math:`R = R_0 + \Delta, |\Delta_{ij}| \le b_{ij}`,

.. math:: H(\Delta) = H_0 + H_1 \Delta (I - m \Delta)^{-1} H_2 .

Of one input and one output the disc of Δ about e with the radius r gives the disc with

.. math:: \text{centre } H_0 + \frac{H_1 H_2}{1 - m e} \left(e + \frac{\bar m\, r^2}{|1 - m e|^2 - |m|^2 r^2}\right), \qquad
          \text{radius } \frac{|H_1 H_2|\, r}{|1 - m e|^2 - |m|^2 r^2} ,

exactly, since that is a Möbius map. Every disc that holds a set of Δ bounds what it does; the worst of a polygon, seen from where a
map is infinite (Δ = 1/m) or T is zero, is that of a large disc whose border is almost the line that parts them. Of matrices the
centre is H_0, and the largest singular value of what is added to it is bounded by the smallest of three: by entries (Neumann's
series), by norms, and by norms with the scaling of the robust stability margin.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np

from robustid.core import Complex, Real, norms
from robustid.guarantees.linear.error_sets import ErrorSets, Held
from robustid.guarantees.scaling import Scaling, perron_scaling
from robustid.guarantees.value_set import norm_of_bounds

MAPS = ("sensitivity", "complementary_sensitivity", "process_sensitivity", "control_sensitivity")
_ROUNDING = 1e-12


class Balls(NamedTuple):
    """Centres (N, p, q) and radii (N,): at every point all values are so near to the centre, in the largest singular value."""

    centre: Complex
    radius: Real

    @property
    def largest(self) -> Real:
        """Bound of the largest singular value, (N,)."""
        return norms(self.centre) + self.radius

    def or_narrower(self, other: Balls) -> Balls:
        """At every point the one of two with the smaller radius."""
        first = self.radius <= other.radius
        return Balls(
            np.where(first[:, None, None], self.centre, other.centre), np.where(first, self.radius, other.radius)
        )

    def or_smaller(self, other: Balls) -> Balls:
        """At every point the one of two that says more."""
        first = self.largest <= other.largest
        return Balls(
            np.where(first[:, None, None], self.centre, other.centre), np.where(first, self.radius, other.radius)
        )

    @property
    def least(self) -> Real:
        """Bound of the smallest singular value, (N,); negative where it may be 0."""
        return np.linalg.svd(self.centre, compute_uv=False)[:, -1] - self.radius

    def about(self, centre: Complex | Real) -> Balls:
        """The same values less a matrix."""
        return Balls(self.centre - centre, self.radius)


class LoopValues(NamedTuple):
    """Values of ``[r; e; d] -> [u; y; x]`` at points, (N, 2 nu + ny, nu + 2 ny), and radii that hold around them (0 at points)."""

    values: Complex
    reach: Real
    shape: tuple[int, int]  # inputs and outputs of the plant

    @classmethod
    def at(cls, values: Complex, shape: tuple[int, int]) -> Self:
        """Exact values."""
        return cls(values, np.zeros(values.shape), shape)

    def _places(self) -> tuple[dict[str, slice], dict[str, slice]]:
        nu, ny = self.shape
        rows = {"u": slice(0, nu), "y": slice(nu, nu + ny), "x": slice(nu + ny, None)}
        columns = {"r": slice(0, nu), "e": slice(nu, nu + ny), "d": slice(nu + ny, None)}
        return rows, columns

    def shifted(self, change: Complex) -> LoopValues:
        """The values about R + change, (N, ny, nu): exact, at points."""
        rows, columns = self._places()
        V, nu = self.values, self.shape[0]
        inner = np.eye(nu) - V[:, rows["x"], columns["e"]] @ change
        back = change @ np.linalg.inv(inner)  # change (I - m change)^-1
        moved = V + V[:, :, columns["e"]] @ back @ V[:, rows["x"], :]
        return LoopValues(moved, np.zeros(moved.shape), self.shape)

    def over(self, errors: ErrorSets) -> Iterator[dict[str, Balls]]:
        """The maps by several discs that hold the errors at the points, all of which hold; of matrices about 0 alone."""
        if self.shape != (1, 1):
            yield self.balls(errors.bound)
            return
        (S, _), (left, _) = self.part("y", "d"), self.part("y", "e")
        (right, _), (inner, _) = self.part("x", "d"), self.part("x", "e")
        discs = errors.discs()
        if errors.corners.shape[1] and np.any(inner):  # else no map is infinite
            with np.errstate(divide="ignore", invalid="ignore"):
                singular = (1 / inner)[:, 0, 0]
                no_loop = ((1 - S) / (left * right + inner * (1 - S)))[:, 0, 0]
            discs = errors.discs(singular, no_loop)
        for held in discs:
            yield self.balls(held)

    def balls(self, within: Real | Held) -> dict[str, Balls]:
        """The maps S, T = I - S, P S and C S over all Delta in discs, or of at most so much; infinite where a loop may be singular.

        A bound (N, ny, nu), or discs of the entries; of matrices those about 0. S and T are those at the outputs of the plant, or
        at its inputs where these are fewer.
        """
        held = within if isinstance(within, Held) else Held.about_zero(within)
        found = {
            "sensitivity": self._ball(*(("u", "r") if self.shape[0] < self.shape[1] else ("y", "d")), held),
            "process_sensitivity": self._ball("y", "r", held),
            "control_sensitivity": self._ball("u", "d", held),
        }
        one = found["sensitivity"]
        found["complementary_sensitivity"] = Balls(np.eye(min(self.shape)) - one.centre, one.radius)
        return found

    def part(self, row: str, column: str) -> tuple[Complex, Real]:
        """Values from one of r, e and d to one of u, y and x, about the model, and their radii."""
        rows, columns = self._places()
        return self.values[:, rows[row], columns[column]], self.reach[:, rows[row], columns[column]]

    def entry(self, row: str, column: str, place: int, bound: Real) -> Balls:
        """Balls of one entry on the diagonal of a map, (N, 1, 1): no larger than those of the whole."""
        own = slice(place, place + 1)
        return self._ball(row, column, Held.about_zero(bound), own)

    def _ball(self, row: str, column: str, held: Held, own: slice = slice(None)) -> Balls:
        fixed, left, right = (
            (one[0][:, rows, columns], one[1][:, rows, columns])
            for one, rows, columns in (
                (self.part(row, column), own, own),
                (self.part(row, "e"), own, slice(None)),
                (self.part("x", column), slice(None), own),
            )
        )
        inner = self.part("x", "e")
        if self.shape == (1, 1):
            found = _disc(fixed, left, right, inner, held)
        else:
            found = Balls(fixed[0], _added(left, right, inner, held.bound) + norms(fixed[1]))
        rounding = _ROUNDING * (norms(found.centre) + np.where(np.isfinite(found.radius), found.radius, 0.0))
        return Balls(found.centre, found.radius + rounding)


Part = tuple[Complex, Real]  # values, and radii that hold around them


def image_of(left: Part, right: Part, inner: Part, bound: Real) -> Balls:
    """Balls that hold ``left Delta (I - inner Delta)^-1 right`` over all ``|Delta| <= bound``: of scalars discs."""
    if bound.shape[1:] == (1, 1):
        return _disc((0.0 * left[0], 0.0 * left[1]), left, right, inner, Held.about_zero(bound))
    return Balls(
        np.zeros((len(bound), left[0].shape[1], right[0].shape[2]), dtype=complex), _added(left, right, inner, bound)
    )


def image_over(left: Part, right: Part, inner: Part, errors: ErrorSets) -> Balls:
    """Balls as of `image_of` over sets of errors: of scalars the narrowest of their discs."""
    if errors.bound.shape[1:] != (1, 1):
        return image_of(left, right, inner, errors.bound)
    with np.errstate(divide="ignore", invalid="ignore"):
        singular = (1 / inner[0])[:, 0, 0]
    none = 0.0 * left[0], 0.0 * left[1]
    return functools.reduce(
        Balls.or_narrower, [_disc(none, left, right, inner, held) for held in errors.discs(singular)]
    )


def entries_over(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    """Bounds of every entry of ``left Delta (I - inner Delta)^-1 right`` over all ``|Delta| <= bound``, (N, rows, columns)."""
    scaling = _scaling(left, right, inner, bound)
    found = [_entries(left, right, inner, bound)]
    for (outer, last), through, size in (
        ((left, right), _size(inner), bound),
        (_in_scales(scaling, left, right), _size(_closing(scaling, inner)), scaling.uncertainty(bound)),
    ):
        rows: Real = np.linalg.norm(outer[0], axis=2) + np.linalg.norm(outer[1], axis=2)
        columns: Real = np.linalg.norm(last[0], axis=1) + np.linalg.norm(last[1], axis=1)
        limit = through[:, None, None], norm_of_bounds(size)[:, None, None]
        found.append(_closed(rows[:, :, None], columns[:, None, :], *limit))
    return np.fmin.reduce(found)


def _added(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    return np.fmin.reduce([one(left, right, inner, bound) for one in (_by_entries, _by_norms, _scaled)])


def _disc(fixed: Part, left: Part, right: Part, inner: Part, held: Held) -> Balls:
    """The image of a disc; around it what the radii of the values let it move."""
    e, r, b, m = (one[:, 0, 0] for one in (*held, inner[0]))
    across = (left[0] * right[0])[:, 0, 0]
    size, reach = np.abs(m), inner[1][:, 0, 0]
    moved = np.abs(left[0]) * right[1] + left[1] * (np.abs(right[0]) + right[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        about = 1 - m * e
        clear = np.abs(about) - size * r  # |1 - m Delta| at least
        room = clear * (np.abs(about) + size * r)
        centre = fixed[0][:, 0, 0] + across / about * (e + np.conj(m) * r**2 / room)
        radius = np.abs(across) * r / room
        least = np.fmax(clear, 1 - size * b)
        sure = least - reach * b  # the same with what m may be
        radius += fixed[1][:, 0, 0] + moved[:, 0, 0] * b / sure
        radius += np.abs(across) * b**2 * reach / (sure * least)
        whole = (clear > 0) & (sure > 0) & np.isfinite(radius)
    return Balls(np.where(whole, centre, 0.0)[:, None, None], np.where(whole, radius, np.inf))


def _by_entries(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    return norm_of_bounds(_entries(left, right, inner, bound))


def _entries(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    """``|H_1| b (I - |m| b)^-1 |H_2|``, infinite where the series is."""
    sizes = [np.abs(values) + reach for values, reach in (left, right, inner)]
    through = sizes[2] @ bound
    closed = (np.max(np.abs(np.linalg.eigvals(through)), axis=1) < 1)[:, None, None]
    through = np.where(closed, through, 0.0)
    series = np.maximum(np.linalg.inv(np.eye(through.shape[1]) - through), 0.0)
    return np.where(closed, sizes[0] @ bound @ series @ sizes[1], np.inf)


def _by_norms(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    return _closed(_size(left), _size(right), _size(inner), norm_of_bounds(bound))


def _scaled(left: Part, right: Part, inner: Part, bound: Real) -> Real:
    """The same with signals scaled by ``Delta = diag(alpha) Delta_s diag(beta)``."""
    scaling = _scaling(left, right, inner, bound)
    outer, last = _in_scales(scaling, left, right)
    through, size = _size(_closing(scaling, inner)), norm_of_bounds(scaling.uncertainty(bound))
    return _closed(_size(outer), _size(last), through, size)


def _size(part: tuple[Complex | Real, Complex | Real]) -> Real:
    """Bound of the largest singular value of values within their radii, (N,)."""
    return norms(part[0]) + norms(part[1])


def _closing(scaling: Scaling, inner: Part) -> tuple[Complex | Real, Complex | Real]:
    """Part around a scaled Delta."""
    return scaling.loop(inner[0]), scaling.loop(inner[1])


def _scaling(left: Part, right: Part, inner: Part, bound: Real) -> Scaling:
    fed_back = np.any(inner[0], axis=(1, 2))[:, None, None]
    return perron_scaling(np.where(fed_back, inner[0], _outer(right, left)), bound)


def _in_scales(scaling: Scaling, left: Part, right: Part) -> tuple[Part, Part]:
    """Parts before and behind a scaled Delta."""
    alpha, beta = np.exp(scaling.rows)[:, None, :], np.exp(scaling.columns)[:, :, None]
    return (left[0] * alpha, left[1] * alpha), (right[0] * beta, right[1] * beta)


def _outer(right: Part, left: Part) -> Complex:
    """A matrix of the size of the inner part whose scaling balances what is outside."""
    return np.linalg.norm(right[0], axis=2)[:, :, None] * np.linalg.norm(left[0], axis=1)[:, None, :] + 0j


def _closed(left: Real, right: Real, inner: Real, bound: Real) -> Real:
    """``left bound right / (1 - inner bound)``."""
    room = 1 - inner * bound
    return np.where(room > 0, left * bound * right / np.where(room > 0, room, 1.0), np.inf)


class Worst(NamedTuple):
    """Larger numbers for worse margins, (N,) each: 0 or less where a margin is not met there.

    Of one input and one output with L = P C the open loop, ``S = 1/(1 + L)``: a real S > 1 makes a gain of S/(S - 1) unstable,
    a real S < 0 one below 1, and S = 1/2 + j t has |L| = 1 and a phase 2 arctan(2 t) short of -180 degrees by
    180 - 2 arctan(2 |t|) degrees. Of matrices gains and phases follow from the disc margin (`seiler2020`).
    """

    gain_above: Real  # S - 1
    gain_below: Real  # - S
    phase: Real  # |t|
    delay: Real  # omega over the phase that is left, in rad


def worst_of(balls: Balls, omega: Real) -> Worst:
    """The margins of one sensitivity that all of a disc may have, up to the frequency omega of each."""
    centre, radius = balls.centre[:, 0, 0], balls.radius
    with np.errstate(invalid="ignore", divide="ignore"):
        half = np.sqrt(radius**2 - np.imag(centre) ** 2)  # nan where it has no real value
        above, below = np.real(centre) + half - 1, half - np.real(centre)
        side = np.sqrt(radius**2 - (np.real(centre) - 0.5) ** 2)
        top, bottom = np.imag(centre) + side, side - np.imag(centre)
        left = np.pi - 2 * np.arctan(2 * top)
        delay = np.where(np.isnan(top), 0.0, omega / left)
    whole = np.isinf(radius)
    found = [np.nan_to_num(one, nan=-1.0) for one in (above, below, np.fmax(top, bottom))]
    return Worst(*(np.where(whole, np.inf, one) for one in (*found, delay)))


def delay_of(balls: Balls, omega: Real) -> Real:
    """For matrices: omega over the phase of all delays together that the complementary sensitivity leaves, (N,)."""
    size = balls.largest
    with np.errstate(divide="ignore", invalid="ignore"):
        phase = 2 * np.arcsin(np.minimum(1.0, 1 / (2 * size)))
        return np.where(size < 0.5, 0.0, omega / phase)
