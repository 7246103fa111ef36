"""Peaks of the maps of a loop, and its margins, over all R of a band on the whole axis: on pieces of arc."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Real, StateMatrices, points_of, response_at, responses
from robustid.errors import InputError
from robustid.guarantees.band_result import Band
from robustid.guarantees.bilinear import Image
from robustid.guarantees.cells import Pieces, enclose_judged
from robustid.guarantees.circle import Peak
from robustid.guarantees.linear.error_sets import ErrorSets
from robustid.guarantees.loop_values import MAPS, Balls, LoopValues, delay_of, worst_of
from robustid.reduction import balanced_truncation

if TYPE_CHECKING:
    import control

    Sizes = Callable[
        [Pieces, Real, Real, Real], Real
    ]  # pieces, reach of their values, where their cells begin and end: (N, S)

_TOLERANCE = 2e-3  # of peaks and margins on the whole axis: how far they are above what they have at single frequencies
_LOST, _GRID, _BALANCING = 1e-6, 400, 4  # what a smaller model may lose, points and steps for the units of its signals
_FEW = 200_000  # pieces of arc, beyond which the bounds are left as they are
FLOORS = {"gain_above": 1e-3, "gain_below": 1e-3, "phase": 1e-2, "delay": 0.0}  # smaller ones limit nothing


class LoopMargins(NamedTuple):
    """Margins that every consistent plant has with the controller, at least; at the outputs of the plant, or its inputs if fewer.

    Attributes
    ----------
    modulus : float
        Distance of the open loop from -1: the reciprocal of the peak of the sensitivity.
    gain : (float, float)
        Factors of the gain between which every loop is stable.
    phase : float
        In rad, on both sides.
    delay : float
        In s.
    disk : float
        alpha: gain and phase in all loops may change at the same time within the disc ``|f - 1|/|f + 1| < alpha/2``.
    """

    modulus: float
    gain: tuple[float, float]
    phase: float
    delay: float
    disk: float


@dataclasses.dataclass(frozen=True)
class BandAxis:
    """The whole axis, on the cells of a band, and on pieces of them where sizes are to be bounded.

    Cells are parted where further frequencies are given.
    """

    band: Band
    parted: Real = dataclasses.field(default_factory=lambda: np.zeros(0))

    @functools.cached_property
    def _edges(self) -> Real:
        edges = self.band.circle.edges
        if not self.parted.size:
            return edges
        return np.unique(np.concatenate([edges, self.parted[(self.parted > edges[0]) & (self.parted < edges[-1])]]))

    def largest(
        self, system: StateMatrices, sizes: Sizes, floors: Real, budget: Budget | None = None, top: float = np.inf
    ) -> tuple[Real, Real]:
        """Bounds of sizes that follow from the values of a stable system and the bounds of the band, and frequencies near them.

        `sizes`: of pieces and how far the values may be from those in their middles, (N, S). `floors` (S,): smaller ones limit
        nothing. Where the time is over arcs stay as they are: what is found holds, and is larger than it need be. `top`: on the
        cells that begin below this frequency, in rad/s.
        """
        model, lost, angles, image = self.arcs_of(system)
        angles = angles[: max(2, int(np.searchsorted(self._edges, top)) + 1)]
        reached, count = floors, 0

        def judge(pieces: Pieces) -> tuple[NDArray[np.bool_], Real]:
            nonlocal reached, count
            ends = omega(angles[pieces.cell]), omega(angles[pieces.cell + 1])
            middle, arc = sizes(pieces, 0.0 * pieces.radius, *ends), sizes(pieces, pieces.radius + lost, *ends)
            # What is infinite at one frequency is so on the axis: no piece is halved for it.
            reached = np.maximum(reached, np.where(np.isnan(middle), -np.inf, middle).max(axis=0))
            count += len(arc)
            limits = np.any(arc > reached * (1 + _TOLERANCE), axis=1) & np.all(np.isfinite(middle), axis=1)
            wide = np.any(pieces.radius > lost, axis=(1, 2))  # narrower ones say no more
            halved = limits & wide & (count < _FEW) & (budget is None or not budget.over)
            return halved, np.stack([arc, middle], axis=1)

        def omega(places: Real) -> Real:
            if image is None:
                return places / float(self.band.problem.dt or 1.0)
            found = np.full(places.shape, np.inf)
            found[places < np.pi] = image.plane.omega(places[places < np.pi])
            return found

        pieces, found = enclose_judged(model, angles, judge)
        return found[:, 0].max(axis=0), omega(pieces.middle[np.argmax(found[:, 1], axis=0)])

    def arcs_of(self, system: StateMatrices) -> tuple[control.StateSpace, Real, Real, Image | None]:
        """A stable system on the circle: a smaller model, by how much its entries differ, where cells end, and the map to there.

        The map is that of continuous time.
        """
        edges = self._edges
        if edges[0] > 0:
            raise InputError(
                f"`band` must reach down to frequency 0; got {edges[0]:g} rad/s. R of a loop has no integrator, and a plant that"
                " has one is measured in a loop"
            )
        whole = system.model(self.band.problem.dt or 0.0)
        image = Image.of(whole, edges)
        if image is None:
            angles = edges * float(self.band.problem.dt or 0.0)
            angles[-1] = np.pi
        else:
            angles = image.edges
        return *_smaller_model(whole if image is None else image.model("band", whole)), angles, image

    def bounds(self, pieces: Pieces) -> Real:
        """Bounds of the entries on the cell of every piece, (N, ny, nu)."""
        return self.errors(pieces).bound

    def errors(self, pieces: Pieces) -> ErrorSets:
        """Sets that hold the errors on the cell of every piece."""
        if not self.parted.size:
            return self.band.circle.sets.of(pieces.cell)
        own = np.searchsorted(self.band.circle.edges, self._edges[:-1], side="right") - 1
        return self.band.circle.sets.of(own[pieces.cell])


@dataclasses.dataclass(frozen=True)
class LoopAxis:
    """The maps of the loop on the whole axis: on pieces of arc, halved where they may set a peak or a margin."""

    band: Band
    shape: tuple[int, int]
    around: StateMatrices

    def enclosed(self, budget: Budget | None = None) -> tuple[dict[str, Peak], LoopMargins]:
        """Peaks and margins."""
        floors = np.array([FLOORS.get(name, 0.0) for name in self._names])
        sizes, omega = BandAxis(self.band).largest(self.around, self._sizes, floors, budget)
        largest = dict(zip(self._names, sizes.tolist(), strict=True))
        where = dict(zip(self._names, omega.tolist(), strict=True))
        return {name: Peak(largest[name], where[name]) for name in MAPS}, margins_of(largest, self.shape)

    @property
    def _names(self) -> tuple[str, ...]:
        return (
            *MAPS,
            "disk",
            *(("gain_above", "gain_below", "phase", "delay") if self.shape == (1, 1) else ("delay",)),
        )

    def _sizes(self, pieces: Pieces, reach: Real, _: Real, top: Real) -> Real:
        """Sizes that limit peaks and margins where the values are within their reach, (N, names): the least of all discs."""
        values, errors = LoopValues(pieces.values, reach, self.shape), BandAxis(self.band).errors(pieces)
        return np.minimum.reduce([self._of(balls, top) for balls in values.over(errors)])

    def sizes_at(self, omega: Real) -> Real:
        """Sizes that limit peaks and margins at frequencies, over the sets of their arcs, (F, names)."""
        points = points_of(omega, self.band.problem.dt or 0.0)
        values = LoopValues.at(response_at(self.around, points), self.shape)
        return np.minimum.reduce([self._of(balls, omega) for balls in values.over(self.band.circle.sets_at(omega))])

    def _of(self, balls: Mapping[str, Balls], top: Real) -> Real:
        sensitivity = balls["sensitivity"]
        found = [balls[name].largest for name in MAPS]
        found.append(sensitivity.about(np.eye(min(self.shape)) / 2).largest)
        if self.shape == (1, 1):
            found += worst_of(sensitivity, top)
        else:
            found.append(delay_of(balls["complementary_sensitivity"], top))
        return np.stack(found, axis=1)


def margins_of(largest: Mapping[str, float], shape: tuple[int, int]) -> LoopMargins:
    """Margins that follow from the largest sizes that limit them, by their names."""
    modulus, disk = 1 / largest["sensitivity"], 1 / largest["disk"]
    delay = 1 / largest["delay"] if largest["delay"] else np.inf
    if shape == (1, 1):
        above, below, t = (max(largest[name], FLOORS[name]) for name in ("gain_above", "gain_below", "phase"))
        up, down = (
            (1 + 1 / above if np.isfinite(above) else 1.0),
            (below / (1 + below) if np.isfinite(below) else 1.0),
        )
        return LoopMargins(modulus, (down, up), math.pi - 2 * math.atan(2 * t), delay, disk)
    alpha = min(disk, 2 * (1 - 1e-9))
    return LoopMargins(
        modulus, ((2 - alpha) / (2 + alpha), (2 + alpha) / (2 - alpha)), 2 * math.atan(alpha / 2), delay, disk
    )


def _smaller_model(model: control.StateSpace) -> tuple[control.StateSpace, Real]:
    """A model of lower order in discrete time, and by how much its entries may differ, (p, q): they are enclosed much faster."""
    angles = np.linspace(0.0, np.pi, _GRID)
    sizes: Real = np.abs(responses(model, angles)).max(axis=0) + np.finfo(float).tiny
    rows, columns = np.ones(len(sizes)), np.ones(len(sizes.T))
    for _ in range(_BALANCING):
        rows = 1 / (sizes * columns).max(axis=1)
        columns = 1 / (sizes * rows[:, None]).max(axis=0)
    found = balanced_truncation(_in_units(model, rows, columns), tol=_LOST)
    if found.order >= model.nstates:
        return model, np.zeros(sizes.shape)
    lost: Real = found.bound / (rows[:, None] * columns)
    return _in_units(found.model, 1 / rows, 1 / columns), lost


def _in_units(model: control.StateSpace, rows: Real, columns: Real) -> control.StateSpace:
    A, B, C, D = StateMatrices.of(model)
    return StateMatrices(A, B * columns, C * rows[:, None], D * rows[:, None] * columns).model(1.0)
