"""A fraction by its values at the frequency points, with what later steps hold of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robustid.core import Frozen, freeze


class Held(NamedTuple):
    """Parts of the last fraction that a linear step holds, where the constraints are not linear in them."""

    directions: np.ndarray | None = None  # of the rigid-body modes
    highest: np.ndarray | None = None  # coefficients of [D; N] at the highest free degrees, (nu + ny, nu)


NOTHING_HELD = Held()


@dataclasses.dataclass(frozen=True, eq=False)
class NodeFraction(Frozen):
    """A right fraction P = N D^{-1} by its values at the frequency points."""

    denominators: np.ndarray  # (F, nu, nu)
    numerators: np.ndarray  # (F, ny, nu)
    # (2, nu + ny, nu) real or None; [D; N] and its derivative at the rigid-body pole, where rigid-body modes are
    # asked for
    anchor: np.ndarray | None = None
    held: Held = NOTHING_HELD

    def __post_init__(self) -> None:
        self._set(
            denominators=freeze(self.denominators),
            numerators=freeze(self.numerators),
            anchor=_frozen(self.anchor),
            held=Held(*map(_frozen, self.held)),
        )

    @property
    def response(self) -> np.ndarray:
        """N D^{-1}, (F, ny, nu)."""
        return right_divide(self.numerators, self.denominators)

    def moved(self, step: float, direction: NodeFraction) -> NodeFraction:
        """The fraction plus `step` times another one, numerators and denominators apart."""
        return NodeFraction(
            self.denominators + step * direction.denominators,
            self.numerators + step * direction.numerators,
            _sum(self.anchor, step, direction.anchor),
            Held(*(_sum(a, step, b) for a, b in zip(self.held, direction.held, strict=True))),
        )


def _frozen(array: np.ndarray | None) -> np.ndarray | None:
    return None if array is None else freeze(array)


def _sum(a: np.ndarray | None, step: float, b: np.ndarray | None) -> np.ndarray | None:
    return None if a is None or b is None else a + step * b


def right_divide(numerators: np.ndarray, denominators: np.ndarray) -> np.ndarray:
    """``numerators @ inv(denominators)``, point by point."""
    return np.linalg.solve(denominators.transpose(0, 2, 1), numerators.transpose(0, 2, 1)).transpose(0, 2, 1)


def staircase(
    order: int, priority: Sequence[int], pivots: Sequence[int] | np.ndarray = (), *, step: int = 1
) -> np.ndarray:
    """Degrees that add up to `order` and differ as little as they can, at least 2 for the pivots; by twos for ``step=2``."""
    degrees = np.zeros(len(priority), dtype=int)
    degrees[list(pivots)] = 2
    while (left := order - int(degrees.sum())) > 0:
        degrees[min(priority, key=lambda k: degrees[k])] += min(step, left)
    return degrees
