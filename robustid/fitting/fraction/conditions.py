"""Linear conditions on the coefficients of a fraction, and rigid-body modes, which are such conditions."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, freeze
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials


@dataclasses.dataclass(frozen=True, eq=False)
class Condition(Frozen):
    """``sum_t left_t X^(derivative)(point) right_t = 0`` on X = [D; N], point in the unit of the nodes.

    Every linear constraint on coefficients that the library knows has this form; at infinity X stands for its
    coefficients of the highest degrees that are free. It says what the coordinates in the orthonormal basis must
    satisfy; their null space is orthonormal again, so that the condition number stays one.
    """

    point: complex
    terms: tuple[tuple[np.ndarray, np.ndarray], ...]  # left (a, nu + ny), right (nu, c)
    derivative: int = 0

    def __post_init__(self) -> None:
        self._set(terms=tuple((freeze(left), freeze(right)) for left, right in self.terms))

    def on(self, basis: VectorPolynomials, column: int | None = None) -> np.ndarray:
        """The equations (m, n), real, on coordinates in a basis for vec X, or for one `column` of X."""
        return self._rows(basis.derivatives(self.point, self.derivative + 1), column)

    def of(self, basis: VectorPolynomials, polynomial: Sequence[np.ndarray], column: int | None = None) -> np.ndarray:
        """Residuals (m,) of the equations at a polynomial, the arguments of `VectorPolynomials.evaluate`."""
        values = basis.derivatives_of(self.point, self.derivative + 1, polynomial)
        return self._rows(values[..., None], column)[:, 0]

    def _rows(self, derivatives: np.ndarray, column: int | None) -> np.ndarray:
        maps = (np.kron(right.T if column is None else right[column][:, None], left) for left, right in self.terms)
        both = sum(maps) @ derivatives[self.derivative]
        return np.concatenate([both.real, both.imag]) if np.imag(self.point) else both.real


@dataclasses.dataclass(frozen=True, eq=False)
class RigidModes(Frozen):
    """Undamped rigid-body modes: chains of two integrators with constant directions.

    Outside (``P = N D~^{-1} I_RB^{-1} T_u^{-1}``): ``B D(xi) = O((xi - origin)^2)``, `directions` = B (count, nu), the
    inputs that drive the modes. Inside (``P = N I_RB^{-1} D~^{-1}``): ``D(xi) V = O((xi - origin)^2)``,
    `directions` = V (nu, count). The `pivots` columns of B (rows of V) are the identity; with `free` the others
    are refined with the fit.

    Notes
    -----
    Source: `voorhoeve2016` section III.
    """

    directions: np.ndarray
    pivots: NDArray[np.int_]
    outside: bool
    free: bool

    def __post_init__(self) -> None:
        self._set(directions=freeze(self.directions), pivots=freeze(self.pivots))

    @property
    def count(self) -> int:
        """Number of modes."""
        return self.pivots.size

    def others(self, nu: int) -> NDArray[np.int_]:
        """The entries of a direction, of nu, that no pivot fixes."""
        return np.setdiff1d(np.arange(nu), self.pivots)

    def conditions(self, directions: np.ndarray, ny: int, nu: int, origin: float) -> tuple[Condition, ...]:
        """Both powers, as conditions on [D; N]."""
        if self.outside:
            left, right = np.hstack([directions, np.zeros((self.count, ny))]), np.eye(nu)
        else:
            left, right = np.eye(nu, nu + ny), directions
        return tuple(Condition(origin, ((left, right),), k) for k in range(2))

    def turned(self, anchor: np.ndarray) -> np.ndarray:
        """Derivatives of the conditions along the free part of the directions, (equations, parameters)."""
        nu = int(anchor.shape[2])
        rest = self.others(nu)
        one = np.eye(self.count)
        # vec(dX D_rest) = (D_rest^T kron I) vec dX; vec(D_rest dX) = (I kron D_rest) vec dX
        parts: list[np.ndarray] = [
            np.kron(block[:nu][rest].T, one) if self.outside else np.kron(one, block[:nu][:, rest]) for block in anchor
        ]
        return np.concatenate(parts)

    def embedded(self, change: np.ndarray) -> np.ndarray:
        """The change of the directions from the parameters."""
        rest = self.others(max(self.directions.shape))
        out = np.zeros(self.directions.shape)
        if self.outside:
            out[:, rest] = change.reshape(rest.size, self.count).T
        else:
            out[rest] = change.reshape(self.count, rest.size).T
        return out


def orthonormal_rows(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the row space: what these equations forbid. Every equation in its own unit."""
    size = np.linalg.norm(rows, axis=1)
    rows = rows[size > 0] / size[size > 0, None]
    _, values, Vt = np.linalg.svd(rows, full_matrices=False)
    return Vt[values > 1e-12 * values.max(initial=0.0)]
