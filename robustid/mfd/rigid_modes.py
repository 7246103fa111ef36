"""Rigid-body modes as linear conditions on a fraction, with directions that may be refined."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen, freeze
from robustid.mfd.constraints import Condition


@dataclasses.dataclass(frozen=True, eq=False)
class RigidModes(Frozen):
    """Undamped rigid-body modes: chains of two integrators with constant directions.

    Outside (``P = N D~^{-1} I_RB^{-1} T_u^{-1}``): ``B D(xi) = O((xi - origin)^2)``, `directions` = B (count, nu), the
    inputs that drive the modes. Inside (``P = N I_RB^{-1} D~^{-1}``): ``D(xi) V = O((xi - origin)^2)``,
    `directions` = V (nu, count). The `pivots` columns of B (rows of V) are the identity; with `free` the rest is
    refined with the fit.

    Notes
    -----
    Source: `voorhoeve2016` section III.
    """

    directions: np.ndarray
    pivots: np.ndarray
    outside: bool
    free: bool

    def __post_init__(self) -> None:
        self._set(directions=freeze(self.directions), pivots=freeze(self.pivots))

    @property
    def count(self) -> int:
        """Number of modes."""
        return self.pivots.size

    def conditions(self, directions: np.ndarray, ny: int, nu: int, origin: float) -> tuple[Condition, ...]:
        """Both powers, as conditions on [D; N]."""
        if self.outside:
            left, right = np.hstack([directions, np.zeros((self.count, ny))]), np.eye(nu)
        else:
            left, right = np.eye(nu, nu + ny), directions
        return tuple(Condition(origin, ((left, right),), k) for k in range(2))

    def turned(self, anchor: np.ndarray) -> np.ndarray:
        """What the conditions change by when the free part of the directions does: (equations, parameters)."""
        nu = anchor.shape[2]
        rest = np.setdiff1d(np.arange(nu), self.pivots)
        one = np.eye(self.count)
        # vec(dX D_rest) = (D_rest^T kron I) vec dX; vec(D_rest dX) = (I kron D_rest) vec dX
        parts = [
            np.kron(block[:nu][rest].T, one) if self.outside else np.kron(one, block[:nu][:, rest]) for block in anchor
        ]
        return np.concatenate(parts)

    def embedded(self, change: np.ndarray) -> np.ndarray:
        """The change of the directions from the parameters."""
        nu = max(self.directions.shape)
        rest = np.setdiff1d(np.arange(nu), self.pivots)
        out = np.zeros(self.directions.shape)
        if self.outside:
            out[:, rest] = change.reshape(rest.size, self.count).T
        else:
            out[rest] = change.reshape(self.count, rest.size).T
        return out
