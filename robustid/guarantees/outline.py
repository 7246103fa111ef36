"""Sides that are found one after the other around the values of one entry, and the direction that cuts off its farthest corner."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Real
from robustid.guarantees.consistent_set import Entry, Extreme
from robustid.guarantees.value_set import corners


@dataclasses.dataclass
class Outline:
    """The sides found so far around the values of one entry, by the numbers of their directions.

    `reached` are values that the bounds of the sides are near to; of `whole` sides they are those of consistent systems. Directions
    are taken so many `steps` apart.
    """

    entry: Entry
    angles: Real
    origin: complex
    sides: dict[int, Extreme] = dataclasses.field(default_factory=dict[int, Extreme])
    reached: dict[int, complex] = dataclasses.field(default_factory=dict[int, complex])
    whole: set[int] = dataclasses.field(default_factory=set[int])
    step: int = 1
    order: list[int] = dataclasses.field(default_factory=list[int])

    def add(self, direction: int, side: Extreme, reached: complex) -> None:
        """Add a side, or replace one; `order` are the directions of those that bound the polygon, rising."""
        self.sides[direction], self.reached[direction] = side, reached
        self.order = sorted(self.sides)
        # A loose side between tight ones bounds nothing, and corners with it would lie outside.
        while (loose := self._redundant()) is not None:
            self.order.remove(loose)

    def _redundant(self) -> int | None:
        angles, support, count = self.angles[self.order], self.support, len(self.order)
        for k in range(count if self.angles.size > 2 else 0):
            beside = [k - 1, (k + 1) % count]
            if count < 4 or (angles[beside[1]] - angles[beside[0]]) % (2 * np.pi) > np.pi - 1e-9:
                continue
            corner = corners(angles[beside], support[beside])[0]
            if np.real(np.exp(-1j * angles[k]) * corner) <= support[k]:
                return self.order[k]
        return None

    @property
    def support(self) -> Real:
        """Proved values of the directions in their order."""
        return np.array([self.sides[k].upper for k in self.order])

    @property
    def _distances(self) -> Real:
        """Distances of the corners from the origin; corner k lies between directions k and k + 1."""
        if self.angles.size == 2:
            return np.abs(np.array([self.support[0], -self.support[1]]) - self.origin)
        return np.abs(corners(self.angles[self.order], self.support) - self.origin)

    @property
    def radius(self) -> float:
        """Largest distance of a corner from the origin."""
        return float(self._distances.max())

    @property
    def farthest(self) -> int:
        """The direction whose reached value is farthest from the origin."""
        return max(self.order, key=lambda k: abs(self.reached[k] - self.origin))

    @property
    def extent(self) -> float:
        """Distance of the farthest value of a consistent system that was found."""
        return abs(self.reached[self.farthest] - self.origin)

    @property
    def beside(self) -> tuple[int, int]:
        """The directions on both sides of the farthest corner."""
        order, worst = self.order, int(np.argmax(self._distances))
        if self.angles.size == 2:
            return order[worst], order[worst]
        return order[worst], order[(worst + 1) % len(order)]

    def far(self, part: float) -> list[int]:
        """The directions beside corners that are almost as far as the farthest."""
        order, far = self.order, np.flatnonzero(self._distances >= part * self.radius)
        return sorted({order[k] for at in far for k in (at, (at + 1) % len(order))})

    @property
    def between(self) -> int | None:
        """A direction that cuts off the farthest corner; None where there is none left."""
        first, second = self.beside
        steps = (second - first) % self.angles.size // self.step
        return (first + steps // 2 * self.step) % self.angles.size if steps > 1 else None
