"""The ball of programs without coefficients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robustid.core import Real
from robustid.identification.formulation.ball import Ball, Inequalities, Pairs


class NoBall(Ball):
    """No block: of unknowns that samples alone bound."""

    size, blocks = 0, ()

    def matrices(self, x: Real) -> list[Real]:
        """No matrices."""
        return []

    def adjoint(self, Z: list[Real]) -> Real:
        """No unknown, no number."""
        return np.zeros(0)

    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """No products."""
        return []

    def curvature(self, pairs: Pairs) -> Real:
        """No unknown, no number."""
        return np.zeros((0, 0))

    def multiplier(self, Z: list[Real]) -> Real:
        """A multiplier of no size."""
        return np.zeros((0, 0))

    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """No inequality."""
        return Inequalities((), (), None, self.multiplier)
