"""The matrix fraction that is sought: form, degrees, data and criterion."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Frozen, as_array, as_count, as_positive, freeze, lengths
from robustid.errors import InputError
from robustid.fitting.fraction.conditions import Condition, RigidModes, orthonormal_rows
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.node_fraction import Held, NodeFraction, staircase
from robustid.fitting.fraction.response_conditions import ResponseCondition
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials, orthonormal_polynomials, polynomial_nodes

# A residual of this part of the weighted data is rounding: D is ill-conditioned at points near lightly damped poles.
_EXACT = 1e-10


@dataclasses.dataclass(frozen=True, eq=False)
class FractionProblem(Frozen):
    """A fraction that is sought: minimise ``sum_k |W(k) vec(values_k - N D^{-1}(xi_k))|^2`` at a given McMillan degree.

    Right fraction in (row) Popov form: row i of D has degree nu_i on the diagonal, with coefficient 1, and less
    elsewhere; column j of N has a degree below nu_j (at most nu_j with feed-through). The nu_i are the staircase
    ``ceil(order/nu)`` for the first inputs and one less for the others, so that any order is possible; every system
    but a thin set has exactly these. The order*(ny + nu) free coefficients are the dimension of the model set.

    Lightly damped modes come in pairs of states, and an undamped machine *is* in the thin set unless the degrees are
    even: with `pairs` the staircase goes by twos. Two inputs whose degrees differ by two give D_ij one degree more,
    nu_j + 1, and column j of N too, whose highest coefficient is tied: ``n_j = sum_i n_i D_ij`` (highest coefficients),
    or else P(infinity) would differ. The dimension is the same; the conditioning is not: D is 1e5 times better on
    4 x 4 systems of 6 modes, ratio of the largest to the smallest singular value.

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
    conditions : tuple of Condition
        Linear constraints on the coefficients.
    held : tuple of ResponseCondition
        Conditions on the response that no right fraction is linear in: those of a transposed problem. Only a state space
        keeps them.
    roll_off : int
        Degree of the numerator columns below those of D (1: strictly proper; not with feed-through).
    zeros : (nu + ny, nu) bool array, optional
        Entries of [D; N] that are zero.
    rigid : RigidModes, optional
    pairs : bool
        Whether the degrees go by twos.
    priority : tuple of int
        All inputs, those that get a higher degree first; default in their order.

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
    conditions: tuple[Condition, ...] = ()
    held: tuple[ResponseCondition, ...] = ()
    roll_off: int = 1
    zeros: np.ndarray = None  # type: ignore[assignment]  # filled in below
    rigid: RigidModes | None = None
    pairs: bool = False
    priority: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        omega = as_array("omega", self.omega, ndim=1)
        values = as_array("values", self.values, dtype=complex, ndim=3)
        if values.shape[0] != omega.size or 0 in values.shape:
            raise InputError(f"`values` must have shape (F, ny, nu) with F = {omega.size}; got {values.shape}")
        if self.weight.shape != values.shape:
            raise InputError(f"`weight` must have shape {values.shape} as the values; got {self.weight.shape}")
        ny, nu = values.shape[1:]
        zeros = cast("NDArray[np.bool_] | None", self.zeros)
        self._set(
            zeros=freeze(np.zeros((nu + ny, nu), dtype=bool) if zeros is None else zeros),
            omega=freeze(omega),
            values=freeze(values),
            order=as_count("order", self.order, least=1),
            dt=None if self.dt is None else as_positive("dt", self.dt),
        )
        lines = int(np.sum(np.any(self.weight.entries, axis=(1, 2))))
        unknowns = self.order * sum(values.shape[1:])
        if unknowns > self.equations:
            raise InputError(
                f"`order` = {self.order} has {unknowns} free coefficients, but the {lines} frequency points in use give only"
                f" {self.equations} real equations; lower the order or give more frequency points"
            )

    @property
    def equations(self) -> int:
        """Number of real equations: twice that of the samples with weight."""
        return 2 * int(np.count_nonzero(self.weight.entries))

    @property
    def rounding(self) -> float:
        """A criterion below this is rounding: the model passes through the data."""
        return (_EXACT * float(np.linalg.norm(self.weight.apply(self.values)))) ** 2

    @property
    def xi(self) -> np.ndarray:
        """Nodes of the polynomials, (F,)."""
        return polynomial_nodes(self.omega, self.dt)[0]

    @property
    def degrees(self) -> np.ndarray:
        """The staircase nu_i, (nu,): at least 2 for the pivot inputs of the rigid body."""
        count = self.values.shape[2]
        pivots = self.rigid.pivots if self.rigid is not None else ()
        return staircase(self.order, self.priority or range(count), pivots, step=2 if self.pairs else 1)

    @property
    def tied(self) -> tuple[np.ndarray, np.ndarray]:
        """Inputs whose degrees differ by two: (the higher ones, the lower ones); empty without."""
        degrees = self.degrees
        if degrees.max() - degrees.min() < 2:
            return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        return np.flatnonzero(degrees == degrees.max()), np.flatnonzero(degrees == degrees.min())

    @property
    def scale(self) -> float:
        """Unit of the nodes: s = scale*xi; 1 in discrete time."""
        return polynomial_nodes(self.omega, self.dt)[1]

    @property
    def origin(self) -> float:
        """Point of the rigid-body poles, and of the static gain."""
        return 0.0 if self.dt is None else 1.0

    @property
    def free(self) -> bool:
        """True where no constraint but a rigid body holds coefficients."""
        return not self.conditions and self.roll_off == 1 and not np.any(self.zeros)

    @property
    def entries_apart(self) -> bool:
        """True where entries of a column share the denominator alone: no constraint and no weight ties them to each other."""
        _, ny, nu = self.values.shape
        column = nu == 1 and ny > 1 and self.weight.entries_only
        return column and self.free and not self.held and self.rigid is None

    @property
    def response_conditions(self) -> tuple[ResponseCondition, ...]:
        """Constraints on coefficients as conditions on the response; zero entries and rigid-body modes are none."""
        ny, nu = self.values.shape[1:]
        out = list(self.held)
        for condition in self.conditions:  # left [I; P] right = 0
            ((left, right),) = condition.terms
            out.append(ResponseCondition(left[:, nu:], right, -left[:, :nu] @ right, condition.point))
        for power in range(0 if self.feedthrough else self.roll_off - 1):
            out.append(ResponseCondition(np.eye(ny), np.eye(nu), np.zeros((ny, nu)), np.inf, power))
        return tuple(out)

    @property
    def limits(self) -> np.ndarray:
        """Largest free degree of every entry of vec([D; N]), ((ny + nu)*nu,)."""
        ny, degrees = self.values.shape[1], self.degrees
        high, low = self.tied
        rows = np.minimum(degrees[:, None] - 1, degrees[None, :])
        rows[high[:, None], low] += 1
        columns = np.repeat(degrees[None, :] - (0 if self.feedthrough else self.roll_off), ny, axis=0)
        columns[:, low] += 1
        return np.where(self.zeros, -1, np.vstack([rows, columns])).T.ravel()

    @property
    def leading(self) -> np.ndarray:
        """vec([I; 0]): the leading coefficients that are fixed."""
        ny, nu = self.values.shape[1:]
        return np.eye(nu + ny, nu).T.ravel()

    def transposed(self) -> FractionProblem:
        """The problem whose right fraction is the left fraction of this one, transposed."""
        return FractionProblem(
            self.omega,
            self.values.transpose(0, 2, 1),
            self.order,
            self.weight.transposed(),
            dt=self.dt,
            feedthrough=self.feedthrough,
            held=tuple(condition.transposed() for condition in self.response_conditions),
        )

    def stacked(self) -> FractionProblem:
        """The problem of the response as one column, entry (i, j) in row i*nu + j: poles that all entries share."""
        return FractionProblem(
            self.omega,
            self.values.reshape(self.omega.size, -1, 1),
            self.order,
            self.weight.stacked(),
            dt=self.dt,
            feedthrough=self.feedthrough,
        )

    def with_conditions(self, *conditions: Condition) -> FractionProblem:
        """The problem with further conditions."""
        return dataclasses.replace(self, conditions=self.conditions + conditions)

    def residual(self, response: np.ndarray) -> np.ndarray:
        """W vec(P_o - P), (F, ny*nu)."""
        return self.weight.apply(self.values - response)

    def cost(self, fraction: NodeFraction) -> float:
        """The criterion; infinite where D is singular at a frequency point."""
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                cost = float(np.linalg.norm(self.residual(fraction.response)) ** 2)
        except np.linalg.LinAlgError:
            return np.inf
        return cost if np.isfinite(cost) else np.inf

    def regressor(self, denominators: np.ndarray, response: np.ndarray) -> np.ndarray:
        """``W(k) (D^{-T} kron [response -I])``, (F, ny*nu, (ny + nu)*nu): what the data see of vec([D; N])."""
        lines, ny, _ = self.values.shape
        inverse = np.linalg.inv(denominators).transpose(0, 2, 1)
        left = np.concatenate([response, np.broadcast_to(-np.eye(ny), (lines, ny, ny))], axis=2)
        return self.weight.linearised(inverse, left)

    def basis(self, denominators: np.ndarray, response: np.ndarray) -> VectorPolynomials:
        """Polynomials orthonormal for the regressor."""
        return orthonormal_polynomials(self.regressor(denominators, response), self.xi, self.limits)

    def conditions_at(self, held: Held) -> tuple[Condition, ...]:
        """The conditions of a linear step, those of the rigid-body modes last."""
        out = self.conditions
        nu, ny = self.values.shape[2], self.values.shape[1]
        high, low = self.tied
        if low.size:
            left = np.eye(ny, nu + ny, nu)
            if held.highest is not None:
                left[:, high] = -held.highest[nu:, high]
            out = (*out, Condition(np.inf, ((left, np.eye(nu)[:, low]),)))
        return out + self._rigid_conditions(held)

    def directions(self, held: Held) -> np.ndarray | None:
        """The rigid-body directions: those held, else those of the problem."""
        return self.rigid.directions if self.rigid is not None and held.directions is None else held.directions

    def _rigid_conditions(self, held: Held) -> tuple[Condition, ...]:
        directions = self.directions(held)
        if self.rigid is None or directions is None:
            return ()
        ny, nu = self.values.shape[1:]
        return self.rigid.conditions(directions, ny, nu, self.origin)

    def _tangent_conditions(self, held: Held) -> tuple[Condition, ...]:
        """Linear in the change of a fraction: the tied coefficients are products."""
        out = self.conditions_at(held)
        high, low = self.tied
        if not low.size or held.highest is None:
            return out
        nu, ny = self.values.shape[2], self.values.shape[1]
        right = np.zeros((nu, low.size))
        right[high] = -held.highest[high[:, None], low]
        at = len(self.conditions)
        product = Condition(np.inf, (*out[at].terms, (np.eye(ny, nu + ny, nu), right)))
        return (*out[:at], product, *out[at + 1 :])

    def forbidden(self, basis: VectorPolynomials, fraction: NodeFraction) -> np.ndarray:
        """Orthonormal rows (m, n): the directions of the basis that the constraints forbid at a fraction."""
        return self._tangent(basis, fraction)[0]

    def turn(self, basis: VectorPolynomials, fraction: NodeFraction, coordinates: np.ndarray) -> np.ndarray | None:
        """Change of the rigid-body directions along admissible coordinates."""
        if self.rigid is None:
            return None
        _, rows, turned = self._tangent(basis, fraction)
        if not turned.shape[1]:
            return np.zeros(self.rigid.directions.shape)
        return self.rigid.embedded(-np.linalg.lstsq(turned, rows @ coordinates, rcond=None)[0])

    def _tangent(self, basis: VectorPolynomials, fraction: NodeFraction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        conditions = self._tangent_conditions(fraction.held)
        rows = np.concatenate([np.zeros((0, basis.size)), *(c.on(basis) for c in conditions)])
        turned = np.zeros((len(rows), 0))
        if self.rigid is not None and self.rigid.free and fraction.anchor is not None:
            part = self.rigid.turned(fraction.anchor)
            turned = np.concatenate([np.zeros((len(rows) - len(part), part.shape[1])), part])
        size = lengths(rows, axis=1, keepdims=True)
        rows, turned = rows / size, turned / size
        left = scipy.linalg.null_space(turned.T) if turned.shape[1] else np.eye(len(rows))
        return orthonormal_rows(left.T @ rows), rows, turned

    def matrices(self, vectors: np.ndarray) -> np.ndarray:
        """Values (m, (ny + nu)*nu) of vec([D; N]) as (m, nu + ny, nu)."""
        ny, nu = self.values.shape[1:]
        return vectors.reshape(-1, nu, ny + nu).transpose(0, 2, 1)

    def split(self, vectors: np.ndarray) -> NodeFraction:
        """Values (F, (ny + nu)*nu) of vec([D; N]) as a fraction."""
        both, nu = self.matrices(vectors), self.values.shape[2]
        return NodeFraction(both[:, :nu], both[:, nu:])

    def polynomial(
        self, basis: VectorPolynomials, terms: Sequence[np.ndarray], directions: np.ndarray | None = None
    ) -> NodeFraction:
        """The fraction of a polynomial (arguments of `VectorPolynomials.evaluate`), with what later steps hold of it."""
        return self.assembled([basis], [terms], directions)

    def assembled(
        self,
        bases: Sequence[VectorPolynomials],
        terms: Sequence[Sequence[np.ndarray]],
        directions: np.ndarray | None = None,
    ) -> NodeFraction:
        """The fraction of one polynomial for vec [D; N], or of one for each of its columns."""
        nu = self.values.shape[2]

        def matrix(parts: list[np.ndarray]) -> np.ndarray:
            return self.matrices(np.concatenate(parts, axis=1))

        both = matrix([basis.evaluate(basis.xi, *term) for basis, term in zip(bases, terms, strict=True)])
        anchor = highest = None
        if self.rigid is not None:
            parts = [basis.derivatives_of(self.origin, 2, term) for basis, term in zip(bases, terms, strict=True)]
            anchor = np.real(matrix(parts))
        if self.tied[1].size:
            parts = [basis.derivatives_of(np.inf, 1, term) for basis, term in zip(bases, terms, strict=True)]
            highest = np.real(matrix(parts)[0])
        return NodeFraction(both[:, :nu], both[:, nu:], anchor, Held(directions, highest))

    def tie(self, fraction: NodeFraction) -> NodeFraction:
        """The fraction with its tied coefficients set to their products, which a linear step meets to first order."""
        high, low = self.tied
        highest = fraction.held.highest
        if not low.size or highest is None:
            return fraction
        nu = self.values.shape[2]
        wanted = highest[nu:, high] @ highest[high[:, None], low]
        change = np.zeros(fraction.numerators.shape[1:])
        change[:, low] = wanted - highest[nu:, low]
        degree = self.limits.reshape(nu, -1)[low[0], nu]
        numerators = fraction.numerators + self.xi[:, None, None] ** degree * change
        highest = highest.copy()
        highest[nu:, low] = wanted
        anchor = fraction.anchor
        if anchor is not None:
            powers = np.array([self.origin**degree, degree * self.origin ** max(degree - 1, 0)])
            anchor = anchor.copy()
            anchor[:, nu:] += powers[:, None, None] * change
        return dataclasses.replace(
            fraction, numerators=numerators, anchor=anchor, held=fraction.held._replace(highest=highest)
        )
