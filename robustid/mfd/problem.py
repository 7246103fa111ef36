"""Which matrix fraction is sought: form, degrees, data and criterion."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid._arrays import Frozen, as_array, as_count, as_positive, freeze
from robustid.bases.vector_polynomials import VectorPolynomials, orthonormal_polynomials, polynomial_nodes
from robustid.errors import InputError
from robustid.mfd.criterion import Weight


@dataclasses.dataclass(frozen=True, eq=False)
class NodeFraction(Frozen):
    """A right fraction P = N D^{-1} by its values at the lines: `denominators` (F, nu, nu), `numerators` (F, ny, nu)."""

    denominators: np.ndarray
    numerators: np.ndarray

    def __post_init__(self) -> None:
        self._set(denominators=freeze(self.denominators), numerators=freeze(self.numerators))

    @property
    def response(self) -> np.ndarray:
        """N D^{-1}, (F, ny, nu)."""
        return right_divide(self.numerators, self.denominators)

    def moved(self, step: float, direction: NodeFraction) -> NodeFraction:
        """The fraction plus `step` times another one, numerators and denominators apart."""
        return NodeFraction(
            self.denominators + step * direction.denominators, self.numerators + step * direction.numerators
        )


@dataclasses.dataclass(frozen=True, eq=False)
class FractionProblem(Frozen):
    """Which fraction is sought: minimise ``sum_k |W(k) vec(values_k - N D^{-1}(xi_k))|^2`` at a given McMillan degree.

    Right fraction in (row) Popov form: row i of D has degree nu_i on the diagonal, with coefficient 1, and less
    elsewhere; column j of N has a degree below nu_j (at most nu_j with feed-through). The nu_i are the staircase
    ``ceil(order/nu)`` for the first inputs and one less for the rest, so that any order is possible; every system
    but a thin set has exactly these. The order*(ny + nu) free coefficients are the dimension of the model set.

    Parameters
    ----------
    omega : (F,) array, rad/s
    values : (F, ny, nu) complex array
    order : int
        McMillan degree.
    weight : Weight
    dt : float, optional
        Sample time in s (polynomials in z); None for continuous time.
    feedthrough : bool
        Whether P(infinity) may differ from 0.

    Notes
    -----
    Source: `voorhoeve2016` section II. A left fraction is the right fraction of the transposed data (`transposed`).
    """

    omega: np.ndarray
    values: np.ndarray
    order: int
    weight: Weight
    _: dataclasses.KW_ONLY
    dt: float | None = None
    feedthrough: bool = False

    def __post_init__(self) -> None:
        omega = as_array("omega", self.omega, ndim=1)
        values = as_array("values", self.values, dtype=complex, ndim=3)
        if values.shape[0] != omega.size or 0 in values.shape:
            raise InputError(f"`values` must have shape (F, ny, nu) with F = {omega.size}; got {values.shape}")
        if self.weight.shape != values.shape:
            raise InputError(f"`weight` must have shape {values.shape} as the values; got {self.weight.shape}")
        self._set(
            omega=freeze(omega),
            values=freeze(values),
            order=as_count("order", self.order, least=1),
            dt=None if self.dt is None else as_positive("dt", self.dt),
        )
        lines = int(np.sum(np.any(self.weight.entries, axis=(1, 2))))
        unknowns = self.order * sum(values.shape[1:])
        equations = 2 * int(np.count_nonzero(self.weight.entries))
        if unknowns > equations:
            raise InputError(
                f"`order` = {self.order} has {unknowns} free coefficients, but the {lines} lines in use give only"
                f" {equations} real equations; lower the order or give more lines"
            )

    @property
    def xi(self) -> np.ndarray:
        """Nodes of the polynomials, (F,)."""
        return polynomial_nodes(self.omega, self.dt)[0]

    @property
    def degrees(self) -> np.ndarray:
        """The staircase nu_i, (nu,)."""
        return staircase(self.order, self.values.shape[2])

    @property
    def limits(self) -> np.ndarray:
        """Largest free degree of every entry of vec([D; N]), ((ny + nu)*nu,)."""
        ny, nu = self.values.shape[1:]
        rows = np.repeat(self.degrees[:, None] - 1, nu, axis=1)
        columns = np.repeat(self.degrees[None, :] - 1 + self.feedthrough, ny, axis=0)
        return np.vstack([rows, columns]).T.ravel()

    @property
    def leading(self) -> np.ndarray:
        """vec([I; 0]): the leading coefficients that are fixed."""
        ny, nu = self.values.shape[1:]
        return np.eye(nu + ny, nu).T.ravel()

    def transposed(self) -> FractionProblem:
        """The problem whose right fraction is the left fraction of this one, transposed."""
        return dataclasses.replace(self, values=self.values.transpose(0, 2, 1), weight=self.weight.transposed())

    def residual(self, response: np.ndarray) -> np.ndarray:
        """W vec(P_o - P), (F, ny*nu)."""
        return self.weight.apply(self.values - response)

    def cost(self, fraction: NodeFraction) -> float:
        """The criterion; infinite where D is singular on a line."""
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                cost = float(np.linalg.norm(self.residual(fraction.response)) ** 2)
        except np.linalg.LinAlgError:
            return np.inf
        return cost if np.isfinite(cost) else np.inf

    def basis(self, denominators: np.ndarray, response: np.ndarray) -> VectorPolynomials:
        """Polynomials orthonormal for ``W(k) (D^{-T} kron [response -I])``."""
        lines, ny, _ = self.values.shape
        inverse = np.linalg.inv(denominators).transpose(0, 2, 1)
        left = np.concatenate([response, np.broadcast_to(-np.eye(ny), (lines, ny, ny))], axis=2)
        return orthonormal_polynomials(self.weight.linearised(inverse, left), self.xi, self.limits)

    def split(self, stacked: np.ndarray) -> NodeFraction:
        """Values (F, (ny + nu)*nu) of vec([D; N]) as a fraction."""
        ny, nu = self.values.shape[1:]
        both = stacked.reshape(-1, nu, ny + nu).transpose(0, 2, 1)
        return NodeFraction(both[:, :nu], both[:, nu:])


def staircase(order: int, count: int) -> np.ndarray:
    """`count` degrees that add up to `order` and differ by at most one, falling.

    Examples
    --------
    >>> staircase(7, 3)
    array([3, 2, 2])
    """
    low, high = divmod(order, count)
    return np.repeat([low + 1, low], [high, count - high])


def right_divide(numerators: np.ndarray, denominators: np.ndarray) -> np.ndarray:
    """``numerators @ inv(denominators)``, line by line."""
    return np.linalg.solve(denominators.transpose(0, 2, 1), numerators.transpose(0, 2, 1)).transpose(0, 2, 1)
