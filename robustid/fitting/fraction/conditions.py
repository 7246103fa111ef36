"""Linear conditions: on the coefficients of a fraction, rigid-body modes among them, and on outputs C and D of its realisation."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real, freeze
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials
from robustid.fitting.state_space.block_model import BlockModel


@dataclasses.dataclass(frozen=True, eq=False)
class Condition(Frozen):
    """``sum_t left_t X^(derivative)(point) right_t = 0`` on X = [D; N], point in the unit of the nodes: every linear constraint
    on coefficients has this form. At infinity X stands for its coefficients of the highest free degrees. The null space of the
    conditions on coordinates in the orthonormal basis is orthonormal again, so that the condition number stays one.
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
    """Undamped rigid-body modes: chains of two integrators with constant directions (`voorhoeve2016` section III). Outside
    (``P = N D~^{-1} I_RB^{-1} T_u^{-1}``): ``B D(xi) = O((xi - origin)^2)``, with B = `directions`. Inside
    (``P = N I_RB^{-1} D~^{-1}``): ``D(xi) V = O((xi - origin)^2)``, with V = `directions`.
    """

    directions: np.ndarray  # B (count, nu), the inputs that drive the modes, or V (nu, count)
    pivots: NDArray[np.int_]  # columns of B (rows of V) that are the identity
    outside: bool
    free: bool  # the other columns (rows) are refined with the fit

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


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseCondition(Frozen):
    """``left P(point) right = value``; at infinity P stands for the Markov parameter ``C A^power B``."""

    left: Real  # (a, ny)
    right: Real  # (nu, c)
    value: Real  # (a, c)
    point: complex  # in the unit of the nodes, or inf
    power: int = 0  # of A, at infinity

    def __post_init__(self) -> None:
        self._set(left=freeze(self.left), right=freeze(self.right), value=freeze(self.value))

    def transposed(self) -> ResponseCondition:
        """The condition on the transposed response."""
        return dataclasses.replace(self, left=self.right.T, right=self.left.T, value=self.value.T)

    def rows(self, model: BlockModel, feedthrough: bool) -> Real:
        """Rows of [C D] as the equations see them: (equations, ny, columns)."""
        if np.isinf(self.point):
            A, B = model.matrices()
            states = np.linalg.matrix_power(A, self.power) @ B
            through = np.zeros((B.shape[1], B.shape[1]))
        else:
            states, through = model.states(np.array([self.point]))[0], np.eye(self.right.shape[0])
        seen = (np.vstack([states, through]) if feedthrough else states) @ self.right
        return self._parts(self.left[:, None, :, None] * seen.T[None, :, None, :])

    def values(self) -> Real:
        """Right sides of the equations, (equations,)."""
        return self._parts(self.value)

    def changes(self, model: BlockModel, C: Real) -> Real:
        """Derivatives (equations, T) of the left side in the coordinates of the model, outputs held."""
        if np.isinf(self.point):
            tangent = model.markov_tangent(C, self.power)
        else:
            xi = np.array([self.point])
            tangent = model.tangent(xi, model.states(xi), C)[0]
        return self._parts(np.einsum("ao,out,uc->act", self.left, tangent, self.right))

    def _parts(self, values: NDArray[np.generic]) -> Real:
        """Real equations from complex ones (a, c, ...): the axes of the equations merged."""
        flat = values.reshape(-1, *values.shape[2:])
        return np.concatenate([flat.real, flat.imag]) if np.imag(self.point) else np.asarray(flat.real)


def equations(conditions: Sequence[ResponseCondition], model: BlockModel, feedthrough: bool) -> Real:
    """Rows of [C D] as all equations see them, (m, ny, columns)."""
    return np.concatenate([condition.rows(model, feedthrough) for condition in conditions])


def wanted(conditions: Sequence[ResponseCondition]) -> Real:
    """Right sides of all equations, (m,)."""
    return np.concatenate([condition.values() for condition in conditions])
