r"""Sets that hold the error of a model, E = F - model, at frequencies and on whole arcs between them.

With E in the convex sets :math:`V_0, V_1` at the ends of an arc of the length h, and :math:`|E''| \le B` on it,

.. math:: E \in \operatorname{conv}(V_0 \cup V_1) + \tfrac{B h^2}{8} \mathbb D \quad \text{on the arc},

since its chord is in the hull, and E at most so far from it. Of two discs the smallest disc about both holds their hull; in every
direction the hull reaches as far as the set that reaches farther, so that polygons are joined by their supports.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.guarantees.linear.polygon_discs import corners_of_supports, smallest_discs

_ONE, _ROUNDED = 1 + 1e-9, 1e-9
_FAR = (
    1.0,
    4.0,
    16.0,
    64.0,
)  # radii of a set: how far behind its border the centres of discs are that take the side of one line
_TURNS = np.tan(np.radians(np.arange(-80, 81, 5)))  # slopes of lines that part a set from a point


class Held(NamedTuple):
    """Errors at points, entry by entry: within `radius` of `centre`, and within `bound` of 0, (N, ny, nu) each."""

    centre: Complex
    radius: Real
    bound: Real

    @classmethod
    def about_zero(cls, bound: Real) -> Self:
        """Within a bound of 0."""
        return cls(np.zeros(bound.shape, complex), bound, bound)


class KnownErrors(NamedTuple):
    """Errors at frequencies: within `bound` of 0, within `radius` of `centre`, (N, ny, nu) each; supports of one entry (N, M).

    Those are bounds of Re(exp(-j theta) E), theta equally spaced; none (M = 0) where all that is known are discs.
    """

    bound: Real
    centre: Complex
    radius: Real
    supports: Real

    def of(self, which: NDArray[np.intp] | slice) -> KnownErrors:
        """Some of the frequencies."""
        return KnownErrors(self.bound[which], self.centre[which], self.radius[which], self.supports[which])

    def in_order(self, others: KnownErrors, order: NDArray[np.intp]) -> KnownErrors:
        """These and others behind them, in an order."""
        parts: list[Any] = [np.concatenate(pair)[order] for pair in zip(self, others, strict=True)]
        return KnownErrors(*parts)

    def or_smaller(self, others: KnownErrors) -> KnownErrors:
        """Smaller sets of these and of others that hold the same."""
        count = max(int(self.supports.shape[1]), int(others.supports.shape[1]))
        smaller = self.radius < others.radius
        return KnownErrors(
            np.minimum(self.bound, others.bound),
            np.where(smaller, self.centre, others.centre),
            np.minimum(self.radius, others.radius),
            np.fmin(self._sides(count), others._sides(count)),
        )

    def _sides(self, count: int) -> Real:
        """Supports in so many directions, of discs where there are no others, (N, count)."""
        if self.supports.shape[1] == count:
            return self.supports
        turns: Complex = np.exp(-2j * np.pi * np.arange(count) / count)
        return (self.centre[:, 0, 0, None] * turns).real + self.radius[:, 0, 0, None]

    def on_arcs(self, bends: Real) -> ErrorSets:
        """Sets that hold the errors from each frequency to the next, with what they may bend away from chords, (N - 1, ny, nu)."""
        first, last = self.of(slice(None, -1)), self.of(slice(1, None))
        centre, radius = _about_both((first.centre, first.radius), (last.centre, last.radius))
        supports = np.maximum(first.supports, last.supports) + bends[:, 0, 0, None]
        return ErrorSets.of_supports(np.maximum(first.bound, last.bound) + bends, centre, radius + bends, supports)


class ErrorSets(NamedTuple):
    """Sets of errors, on arcs or at points: within `bound` of 0, within `radius` of `centre`, (N, ny, nu) each, and polygons.

    Of one entry the hull of `corners` (N, M) holds them too; none (M = 0) where all that is known are discs.
    """

    bound: Real
    centre: Complex
    radius: Real
    corners: Complex

    @classmethod
    def about_zero(cls, bound: Real) -> Self:
        """All that is within bounds of 0."""
        return cls(bound, np.zeros(bound.shape, complex), bound, np.zeros((len(bound), 0), complex))

    @classmethod
    def of_supports(cls, bound: Real, centre: Complex, radius: Real, supports: Real) -> Self:
        """With polygons by their supports, and smaller discs about these, where they are; rounding included."""
        corners = np.zeros(supports.shape, complex)
        if supports.shape[1]:
            # The supports of the polygons themselves, where a side of others cuts one off: by the corners of all pairs.
            count = supports.shape[1]
            turn, tight = 2 * np.pi / count, supports
            for i in range(1, count // 2):
                for j in range(1, (count - 1) // 2 + 1 - i):
                    before, after = np.roll(supports, i, axis=1), np.roll(supports, -j, axis=1)
                    corner = (np.sin(j * turn) * before + np.sin(i * turn) * after) / np.sin((i + j) * turn)
                    tight = np.fmin(tight, corner)
            corners = corners_of_supports(tight + 2 * _ROUNDED * np.abs(tight).max(axis=1, keepdims=True))
            own, least = smallest_discs(corners)
            smaller = (least < radius[:, 0, 0])[:, None, None]
            centre = np.where(smaller, own[:, None, None], centre)
            radius = np.where(smaller, least[:, None, None], radius)
        return cls(bound * _ONE, centre, radius * _ONE + _ROUNDED * np.abs(centre), corners)

    def of(self, which: NDArray[np.intp]) -> ErrorSets:
        """Some of the sets."""
        return ErrorSets(self.bound[which], self.centre[which], self.radius[which], self.corners[which])

    def followed_by(self, bound: Real) -> ErrorSets:
        """These and a last one, within bounds (ny, nu) of 0."""
        corners = np.zeros((1, 0), complex)
        if self.corners.shape[1]:
            corners = corners_of_supports(np.full((1, self.corners.shape[1]), float(bound[0, 0])))
        last = ErrorSets(bound[None], np.zeros((1, *bound.shape), complex), bound[None], corners)
        parts: list[Any] = [np.concatenate(pair) for pair in zip(self, last, strict=True)]
        return ErrorSets(*parts)

    @property
    def narrower(self) -> bool:
        """True if more is known than bounds of sizes."""
        return bool(np.any(self.centre) or self.corners.shape[1])

    def discs(self, *points: Complex) -> Iterator[Held]:
        """Discs that hold the sets: about 0, the smallest ones, and of polygons some that bulge little towards points (N,).

        Those are what is seen of the polygon from a point: almost the side of a line between both.
        """
        yield Held.about_zero(self.bound)
        if not self.narrower:
            return
        yield Held(self.centre, self.radius, self.bound)
        if not self.corners.shape[1]:
            return
        for point in points:
            with np.errstate(invalid="ignore", divide="ignore"):
                border = nearest(self.corners, point)
                away = (border - point) / np.abs(border - point)
                for part in _FAR:
                    centre = border + part * self.radius[:, 0, 0] * away
                    reach = np.abs(self.corners - centre[:, None]).max(axis=1) * (1 + 1e-12)
                    known = np.isfinite(reach)
                    held = np.where(known, centre, 0), np.where(known, reach, np.inf)
                    yield Held(held[0][:, None, None], held[1][:, None, None], self.bound)

    def closed_by(self, M: Complex, reach: Real) -> Real:
        """A number below 1 only where ``1 + t E M`` isn't 0 for any t from 0 to 1, any E of the sets and any M within reach, (N,).

        ``- t E M = 1`` has no imaginary part: whatever the slope beta, t times the largest real part of ``-(1 + j beta) E M`` is
        at least 1 then. Its reciprocal is the factor by which the sets, with 0 in them, may grow.
        """
        size, least = np.abs(M), np.full(M.size, np.inf)
        for slope in _TURNS.tolist():
            turned, length = -(1 + 1j * slope) * M, float(np.hypot(1.0, slope))
            far = (turned * self.centre[:, 0, 0]).real + length * size * self.radius[:, 0, 0]
            if self.corners.shape[1]:
                far = np.fmin(far, (turned[:, None] * self.corners).real.max(axis=1) * _ONE)
            least = np.fmin(least, np.maximum(far, 0.0) + length * reach * self.bound[:, 0, 0])
        return least


def nearest(corners: Complex, point: Complex) -> Complex:
    """The points on the borders of polygons (N, M) that are nearest to points (N,), (N,)."""
    along = np.roll(corners, -1, axis=1) - corners
    length = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
    part = np.clip(np.real((point[:, None] - corners) * along.conj()) / length, 0.0, 1.0)
    border = corners + part * along
    rows = np.arange(len(border))
    return border[rows, np.abs(border - point[:, None]).argmin(axis=1)]


def _about_both(one: tuple[Complex, Real], other: tuple[Complex, Real]) -> tuple[Complex, Real]:
    """The smallest discs about pairs of discs; infinite where one of them is."""
    (a, r), (b, s) = one, other
    apart = np.abs(b - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.clip((1 + (s - r) / apart) / 2, 0.0, 1.0)
    known = np.isfinite(r) & np.isfinite(s)
    centre = np.where(known, a + np.where(apart > 0, part, 0.0) * (b - a), 0.0)
    radius = np.maximum(np.abs(a - centre) + r, np.abs(b - centre) + s)
    return centre, np.where(known, radius, np.inf)
