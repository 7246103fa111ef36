"""Poles that measured frequency points leave: a local minimax fit, and how far it allows a pole to move."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.advice.pole_fit import (
    DAMPING,
    SMOOTH,
    LineData,
    design,
    lightest,
    nearest,
    pair_changes,
    pole_pair,
    ratios,
    smooth_terms,
)
from robustid.core import Plane, Real

_RAYS = 16
_LIGHT, _WELL = 0.1, 0.3  # damping ratios: of a resonance; of none
_LOCAL = (12, 60)  # fewest and most frequency points of the local fit


@dataclasses.dataclass(frozen=True)
class _Local:
    """A local fit: its data, and the columns that don't depend on the pole in question."""

    data: LineData
    fixed: Real

    @functools.cached_property
    def y(self) -> Real:
        """The values as real rows in units of the bounds."""
        return self.data.scaled(self.data.value[:, None])[:, 0]

    def minimax(self, pole: Real, level: float | None = None) -> tuple[float, float]:
        """Lower and upper bound of the smallest max |e|/bound at this pole; stops once a `level` is decided."""
        # In Fortran's order, as LAPACK takes it: this is computed some thousand times.
        columns = np.asfortranarray(np.hstack([self.data.scaled(pole_pair(self.data.angle, pole)), self.fixed]))
        columns /= np.linalg.norm(columns, axis=0)
        y, lines = self.y, self.data.angle.size
        weight, root = np.full(lines, 1 / lines), np.empty(2 * lines)
        lower, upper = 0.0, np.inf
        for _ in range(30):
            np.sqrt(weight, out=root[:lines])
            root[lines:] = root[:lines]
            ratio = ratios(y - columns @ _least_squares(columns * root[:, None], y * root, overwrite=True))
            lower, upper = max(lower, math.sqrt(weight @ ratio**2)), min(upper, float(ratio.max()))
            if upper - lower <= 1e-3 * upper or (level is not None and (lower > level or upper <= level)):
                break
            weight *= ratio
            weight /= weight.sum()
        return lower, upper

    def linear(self, pole: Real, to_mode: Real) -> Real:
        """One step of least squares from this pole, and the most that errors as large as the bounds move it by, (2, 2).

        In logarithms of the mode, whose derivatives by the pole are given: of natural frequency and damping.
        """
        pair = self.data.scaled(pole_pair(self.data.angle, pole))
        functions = np.hstack([pair, self.fixed])
        sizes = np.linalg.norm(functions, axis=0)
        y = self.y
        weights = np.asarray(np.linalg.lstsq(functions / sizes, y, rcond=1e-12)[0], dtype=float) / sizes
        changes = np.stack([one @ weights[:2] for one in pair_changes(self.data.angle, pole)], axis=1)
        slopes = self.data.scaled(changes) @ np.linalg.inv(to_mode)
        columns = np.hstack([slopes, functions])
        sizes = np.linalg.norm(columns, axis=0)
        inverse = np.asarray(np.linalg.pinv(columns / sizes, rcond=1e-12), dtype=float)
        rows = inverse[:2] / sizes[:2, None]
        return np.stack([rows @ (y - functions @ weights), np.hypot(*np.split(rows, 2, axis=1)).sum(axis=1)], axis=1)


def _least_squares(columns: Real, y: Real, *, overwrite: bool = False) -> Real:
    """The shortest solution, by a complete orthogonal factorisation: three times as fast as by singular values."""
    rows, n = columns.shape
    right = y if rows >= n else np.concatenate([y, np.zeros(n - rows)])
    free, size = np.zeros(n, dtype=np.int32), min(rows, n) + 66 * (n + 1)
    found = scipy.linalg.lapack.dgelsy(columns, right[:, None], free, 1e-12, size, overwrite, overwrite)
    return cast(Real, found[1][:n, 0])


class PoleBox(NamedTuple):
    """Ends in (angle, damping) of the poles that the data leave, at which level; was the end of the search reached; the part of
    all values that were used; and the `linear_estimate`.
    """

    ends: Real
    level: float
    reached: bool
    share: float
    linear: Real


def _local_fit(data: LineData, poles: Real, which: int) -> tuple[_Local, tuple[float, float]]:
    """The frequency points around one mode, without the modes far away; and the range of angles that they span."""
    turn, zeta = np.exp(poles[which])
    near = nearest(data.angle, turn, 5 * zeta * turn, _LOCAL[0])
    span = (float(data.angle[near[0]]), float(data.angle[near[-1]]))
    near = near[np.unique(np.linspace(0, near.size - 1, min(near.size, _LOCAL[1])).round().astype(int))]
    others = [i for i in range(len(poles)) if i != which]
    width = span[1] - span[0]
    close = [i for i in others if span[0] - width / 2 <= np.exp(poles[i, 0]) <= span[1] + width / 2]
    # Equations less unknowns: near modes are dropped to single pairs where the frequency points are too few for double ones.
    power = 2 if 2 * near.size > 4 + 4 * len(close) + SMOOTH else 1
    columns = design(data, poles)
    norms = np.linalg.norm(columns, axis=0)
    y = data.scaled(data.value[:, None])[:, 0]
    weights = np.asarray(np.linalg.lstsq(columns / norms, y, rcond=1e-12)[0], dtype=float) / norms
    far = sum(
        (pole_pair(data.angle, poles[i]) @ weights[2 * i : 2 * i + 2] for i in others if i not in close), np.zeros(1)
    )
    local = LineData(data.angle, data.value - far, data.bound, data.plane).select(near)
    parts = [pole_pair(local.angle, poles[i], k) for i in close for k in range(1, power + 1)] + [
        smooth_terms(local.angle)
    ]
    return _Local(local, local.scaled(np.hstack(parts))), span


class _Search(NamedTuple):
    """The fits around one mode, the level that the poles sought keep, and the range of the search."""

    local: list[_Local]
    level: float
    low: Real
    high: Real


def _around(data: LineData, poles: Real, which: int) -> _Search:
    fits = [_local_fit(one, poles, which) for one in data.each]
    local, span = [local for local, _ in fits], fits[0][1]
    centre = poles[which]
    best = max(local.minimax(centre)[1] for local in local)
    low = np.array([max(span[0], 1e-3 * span[1]), lightest(data.angle)])
    high = np.array([min(span[1], 0.999 * np.pi), DAMPING[1]])
    low, high = np.minimum(np.log(low), centre), np.maximum(np.log(high), centre)
    return _Search(local, 1.0 if best <= 1 else 2 * best, low, high)


def damped_outside(data: LineData, poles: Real) -> Real:
    """The poles, light ones outside the frequency points as well damped as these allow: no resonance where nobody measured.

    A resonance stays where the points refute that it is well damped.
    """
    found = poles.copy()
    for which, (turn, zeta) in enumerate(np.exp(poles)):
        if data.angle[0] <= turn <= data.angle[-1] or zeta >= _LIGHT:
            continue
        local, level, low, high = _around(data, poles, which)
        heaviest = _reach(local, poles[which], np.array([0.0, 1.0]), level, low, high)
        if np.exp(heaviest[1]) >= _WELL:
            found[which] = heaviest
    return found


def pole_interval(data: LineData, poles: Real, which: int) -> PoleBox:
    """Box of the poles that the data leave to one mode."""
    local, level, low, high = _around(data, poles, which)
    centre = poles[which]
    unit = np.array([np.exp(centre[1]), 1.0])  # a half-width in frequency weighs as a factor e in damping
    fits = list(local)
    axes = [_reach(fits, centre, unit * d, level, low, high) for d in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    scale = np.array([max(abs(e[k] - centre[k]) for e in axes[2 * k : 2 * k + 2]) for k in range(2)])
    angles = 2 * np.pi * (np.arange(_RAYS) + 0.5) / _RAYS
    rays = [_reach(fits, centre, scale * [np.cos(t), np.sin(t)], level, low, high) for t in angles]
    points = np.array([centre, *axes, *rays])
    box = np.array([points.min(axis=0), points.max(axis=0)])
    reached = bool(np.any(box[0] <= low + 1e-9) or np.any(box[1] >= high - 1e-9))
    share = sum(one.data.angle.size for one in local) / int(data.measured.sum())
    return PoleBox(np.exp(box.T), level, reached, share, _linear_estimate(local, centre, data.plane))


def mode_intervals(edges: Real, plane: Plane) -> Real:
    """Ends of natural frequencies and dampings, (M, 2, 2), of intervals of the poles in z (angle and damping there).

    In continuous time those of the four corners of every box, and of the middles of its sides.
    """
    if plane.dt:
        return edges / np.array([plane.dt, 1.0])[:, None]
    parts = np.array([0.0, 0.5, 1.0])
    turn, damping = (edges[:, k, :1] + np.diff(edges[:, k]) * parts for k in (0, 1))
    corners = plane.modes(*(np.broadcast_arrays(turn[:, :, None], damping[:, None])))
    return np.stack([np.stack([part.min(axis=(1, 2)), part.max(axis=(1, 2))], axis=1) for part in corners], axis=1)


def _linear_estimate(fits: Sequence[_Local], pole: Real, plane: Plane) -> Real:
    """Logarithms of natural frequency and damping by local least squares, and how far errors as large as the bounds move each.

    To first order, and whatever the errors of different points have to do with each other; (2, 2), each by the entry that moves
    least.
    """
    step = 1e-6 * np.eye(2)
    place = np.log(plane.modes(*np.exp(np.array([pole, *(pole + step), *(pole - step)])).T))
    to_mode = (place[:, 1:3] - place[:, 3:]) / 2e-6
    moves = np.array([one.linear(pole, to_mode) for one in fits])
    best = np.argmin(moves[:, :, 1], axis=0)
    found = np.take_along_axis(moves, best[None, :, None], axis=0)[0]
    return found + np.stack([place[:, 0], np.zeros(2)], axis=1)


def shown_in(records: Sequence[tuple[float, float, float, float]], data: LineData) -> Real:
    """Boxes (M, 2, 2) in (angle, damping) of the modes that the records of a response show, between its frequency points."""
    step = float(data.plane.dt or 0)
    boxes: Real = np.array(records, dtype=float).reshape(-1, 2, 2) * np.array([[step], [1.0]])
    return boxes[(boxes[:, 0, 0] > data.angle[0]) & (boxes[:, 0, 1] < data.angle[-1])]


def with_shown(poles: Real, shown: Real, angle: Real) -> Real:
    """The poles, and the middles of the boxes of modes beside which there is none."""
    more = [np.log(np.mean(box, axis=1)) for box in shown if not len(_beside(poles, box, angle))]
    return np.vstack([poles, *more])


def bounded_by_shown(found: PoleBox, pole: Real, shown: Real, angle: Real) -> PoleBox:
    """The box of a light pole; that of the records' mode beside it where it reaches the heaviest damping.

    An excitation and a transient that look alike over a few lines leave the response so uncertain there that it needs no mode at
    all; the whole record shows one all the same, and none that is light may be left to the gain bound.
    """
    mine = [box for box in shown if len(_beside(pole[None], box, angle))]
    if not mine or found.ends[1, 1] < DAMPING[1] * (1 - 1e-6):
        return found
    box, (turn, zeta) = mine[0], np.exp(pole)
    ends = np.array([[min(box[0, 0], turn), max(box[0, 1], turn)], [min(box[1, 0], zeta), max(box[1, 1], zeta)]])
    return found._replace(ends=ends, level=1.0, reached=False)


def _beside(poles: Real, box: Real, angle: Real) -> NDArray[np.intp]:
    """The light poles within a box, or within two frequency points of it."""
    turn, zeta = np.exp(poles).T
    low, high = (int(np.sum(angle < end)) for end in box[0])
    ends = angle[max(low - 2, 0)], angle[min(high + 1, angle.size - 1)]
    return np.flatnonzero((turn >= ends[0]) & (turn <= ends[1]) & (zeta < _WELL))


def _reach(fits: list[_Local], centre: Real, ray: Real, level: float, low: Real, high: Real) -> Real:
    """The last pole along a ray, inside the range of the search, that no entry refutes; rounded outwards.

    The entry that ends it comes first among the `fits` afterwards.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(ray > 0, (high - centre) / ray, np.where(ray < 0, (low - centre) / ray, np.inf))
    end = float(np.min(room))

    def refuted(fit: _Local, step: float) -> bool:
        return fit.minimax(centre + step * ray, level)[0] > level

    def last_and_first(fit: _Local) -> tuple[float, float]:
        """The last step at which this entry does not refute the pole, and the first at which it does, or the end twice."""
        inside, outside = 0.0, min(1e-3, end)
        while not refuted(fit, outside):
            if outside >= end:
                return end, end
            inside, outside = outside, min(2 * outside, end)
        for _ in range(7):
            middle = (inside + outside) / 2
            inside, outside = (inside, middle) if refuted(fit, middle) else (middle, outside)
        return inside, outside

    # The entry that ends a ray mostly ends the next one, too: most others have one pole to look at then.
    inside, outside = last_and_first(fits[0])
    for k in range(1, len(fits)):
        if inside > 0 and refuted(fits[k], inside):
            inside, outside = last_and_first(fits[k])
            fits.insert(0, fits.pop(k))
    return centre + outside * ray
