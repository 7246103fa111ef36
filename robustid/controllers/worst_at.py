"""Worst cases of a loop over all consistent plants at frequencies: exact in their discs, or in polygons, and no proof between them.

With the plants in ``|F - c| <= r`` the open loops are a disc about c C with the radius r |C|; S, T, P S and C S have discs too,
since they are Möbius maps of F.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from robustid.controllers.discs import Discs
from robustid.controllers.images import smallest_sets
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.proving import Taken
from robustid.core import Complex, Real, StateMatrices, points_of, response_at
from robustid.guarantees import Balls, LoopMargins, LoopValues, Peak, margins_of, worst_of

_STEPS = 6  # of the search for a crossing
_NEAR = np.array([0.92, 0.96, 0.98, 1.0, 1.02, 1.04, 1.08])  # frequencies about a crossing: margins are least near it


@dataclasses.dataclass(frozen=True, eq=False)
class WorstAt:
    """Worst cases of a controller with the plants of one band, at frequencies."""

    omega: Real  # (F,), rad/s
    centre: Complex  # centre, radius: (F,); discs of the open loops, in which -1 may lie
    radius: Real
    corners: Complex  # (F, V); of polygons that hold them, where they are narrower; nan elsewhere
    least: Real  # (F,); of the size of the open loops
    # values of S, T, P S and C S, by the names of `LoopBounds`, all of which hold; of an infinite radius where a loop
    # may be singular
    balls: Sequence[Mapping[str, Balls]]
    stable: bool  # with the model of the band
    margins: LoopMargins  # at these frequencies

    @functools.cached_property
    def largest(self) -> dict[str, Real]:
        """Largest |S|, |T|, |P S| and |C S|, (F,) each; infinite where a loop may be singular."""
        return {name: np.minimum.reduce([one[name].largest for one in self.balls]) for name in self.balls[0]}

    @functools.cached_property
    def smallest(self) -> dict[str, Real]:
        """Smallest |S|, |T|, |P S| and |C S| at least, (F,) each."""
        return {name: np.maximum.reduce([one[name].least for one in self.balls]) for name in self.balls[0]}

    @property
    def clear(self) -> bool:
        """True if no disc holds -1, and the loop with the model is stable."""
        return self.stable and bool(np.all(np.isfinite(self.largest["sensitivity"])))

    @property
    def bandwidth(self) -> float:
        """Frequency in rad/s up to which every open loop is at least 1; 0 where the first is not."""
        low = np.flatnonzero(self.least < 1)
        if not low.size:
            return float(self.omega[-1])
        return float(self.omega[low[0] - 1]) if low[0] else 0.0

    def taken(self, limits: Limits) -> Taken:
        """Numbers that limits are about, as those of a proof."""
        places = {name: int(np.argmax(one)) for name, one in self.largest.items()}
        peaks = {name: Peak(float(self.largest[name][k]), float(self.omega[k])) for name, k in places.items()}
        rows: dict[str, tuple[float, float]] = {}
        sizes = [
            (one.name, np.minimum.reduce([one.share(balls[one.map], value) for balls in self.balls]), low, high)
            for one, low, high, value in limits.rows
        ]
        if limits.bandwidth is not None:
            sizes.append(("bandwidth", 1 / np.maximum(self.least, np.finfo(float).tiny), 0.0, limits.bandwidth))
        for name, size, low, high in sizes:
            here = np.flatnonzero((self.omega >= low) & (self.omega <= high))
            if here.size:
                k = here[np.argmax(size[here])]
                if size[k] >= rows.get(name, (0.0, 0.0))[0]:
                    rows[name] = float(size[k]), float(self.omega[k])
        return Taken(peaks, self.margins, rows)


def worst_at(plants: Plants, controller: StateMatrices, omega: Real) -> WorstAt:
    """Worst cases at frequencies, and where the centre of the open loop crosses the unit circle and the negative real axis."""
    dt = plants.dt

    def seen(at: Real) -> tuple[Discs, Complex]:
        return plants.discs(at), response_at(controller, points_of(at, dt))[:, 0, 0]

    def loop(at: Real) -> Complex:
        found, value = seen(at)
        return found.plant[:, 0, 0] * value

    discs, gain = seen(np.sort(np.concatenate([omega, _crossings(loop, omega)])))
    centre, reach = discs.plant[:, 0, 0], np.where(discs.outside, np.inf, discs.radius * discs.units[:, 0])
    errors = smallest_sets(plants.band.circle.sets_at(discs.omega), np.ones(discs.omega.size))
    every = list(closed_by(plants.open_loop(discs.omega), gain).over(errors))
    found = [_sizes(balls, discs.omega) for balls in every]
    sizes = {name: np.minimum.reduce([one[name] for one in found]) for name in found[0]}
    return WorstAt(
        omega=discs.omega,
        centre=centre * gain,
        radius=reach * np.abs(gain),
        corners=(discs.centre[:, 0] + discs.known_corners) * gain[:, None],
        least=discs.least * np.abs(gain),
        balls=every,
        stable=plants.is_stable_with(controller.model(dt)),
        margins=margins_of({name: float(np.max(one)) for name, one in sizes.items()}, (1, 1)),
    )


def _sizes(balls: Mapping[str, Balls], omega: Real) -> dict[str, Real]:
    """Sizes that limit margins."""
    S = balls["sensitivity"]
    found = dict(zip(("gain_above", "gain_below", "phase", "delay"), worst_of(S, omega), strict=True))
    return found | {"sensitivity": S.largest, "disk": S.about(np.full((1, 1), 0.5)).largest}


def closed_by(around: LoopValues, gain: Complex) -> LoopValues:
    """The loop of one input and one output without a controller, closed by values of one, (N,)."""
    (P, _), (left, _) = around.part("y", "r"), around.part("y", "e")
    (right, _), (inner, _) = around.part("x", "r"), around.part("x", "e")
    C = gain[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        S = 1 / (1 + P * C)
        values = [
            [S, -C * S * left, -C * S],
            [P * S, S * left, S],
            [right * S, inner - right * C * S * left, -right * C * S],
        ]
    return LoopValues.at(np.block(values), (1, 1))


def _outside(loop: Complex) -> Real:
    """Distance outside the unit circle."""
    return np.abs(loop) - 1


def _imaginary(loop: Complex) -> Real:
    return loop.imag


def _crossings(loop: Callable[[Real], Complex], omega: Real) -> Real:
    """Frequencies about those where an open loop crosses the unit circle or the negative real axis."""
    found, values = list[Real](), loop(omega)
    for part in (_outside, _imaginary):
        size = part(values)
        change = np.flatnonzero(size[1:] * size[:-1] < 0)
        change = change[np.minimum(values.real[change], values.real[change + 1]) < 0] if part is _imaginary else change
        low, high, below = omega[change], omega[change + 1], size[change]
        for _ in range(_STEPS if change.size else 0):
            middle = np.sqrt(low * high)
            left = part(loop(middle)) * below <= 0
            low, high = np.where(left, low, middle), np.where(left, middle, high)
        found.append(np.sqrt(low * high))
    near = np.outer(np.concatenate(found), _NEAR).ravel()
    return near[(near > omega[0]) & (near < omega[-1])]
