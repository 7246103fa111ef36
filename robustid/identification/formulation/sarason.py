"""The convex condition: a function of the unit ball has the data x iff X(x) = g(A) is a contraction."""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from robustid.bases import InputNormalPair, solve_stein, stein_powers
from robustid.core import Frozen, freeze, kept_by_content
from robustid.identification.entries import SINGLE, Entries
from robustid.identification.formulation.ball import (
    Axes,
    Ball,
    DenseMap,
    DenseMapOf,
    DenseProducts,
    EntryProducts,
    Inequalities,
    MatrixBall,
    SymmetricBall,
    SymmetricMap,
    TurnedBall,
)
from robustid.identification.formulation.quadrature import QuadratureMap
from robustid.identification.interpolant import interpolants

_LARGE = 40  # order from which products of stored matrices, n^4, take several times as long as a quadrature, n^3
_KEPT = 64  # order up to which the last bases are kept, 2 MB each: of the same data many classes are asked for


@kept_by_content(most=_KEPT)
def _basis(A: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    n = len(A)
    unit = np.zeros((n, n, n))
    unit[np.arange(n), :, np.arange(n)] = c[0]
    return freeze(solve_stein(A.T, A, unit))


@kept_by_content(most=_KEPT)
def _symmetric_basis(A: NDArray[np.float64], c: NDArray[np.float64], T: NDArray[np.float64]) -> NDArray[np.float64]:
    H = T @ _basis(A, c)
    return freeze((H + H.transpose(0, 2, 1)) / 2)


class SarasonMap(Frozen, abc.ABC):
    """x -> X(x) = g(A), the solution of X - A'XA = c'x, and its symmetric form H = T X.

    A function with the coefficients x exists in the unit ball of H-infinity iff ||X(x)|| <= 1.
    """

    # For SISO T X is symmetric, hence the condition is -I <= H(x) <= I: two blocks of size n in place of one of size 2n. Matrix
    # functions, p x q, have n coefficients an entry, and the condition is the same for X(x) = sum_j X(e_j) (x) x_j (Kronecker
    # products), of size np x nq. Source: Sarason; Caratheodory-Fejer for A a shift, Nevanlinna-Pick for distinct nodes.
    # `inanc2001` Theorem 1 is the same condition in a non-orthonormal basis.

    pair: InputNormalPair
    entries: Entries  # outputs and inputs; x is a vector of `size` numbers
    # whether the columns of the samples fall in size along the basis, or it is small: else their axes are computed
    graded: ClassVar[bool] = True
    conic: ClassVar[bool] = False  # whether the condition is for general semidefinite solvers in the first place
    entrywise: ClassVar[bool] = True  # whether blocks of functions of the class are in such a class themselves
    # what `norm` of at most 1 says, in words
    inside: ClassVar[str] = "size of the non-parametric part over its bound: it is in the ball"

    @property
    def size(self) -> int:
        """Number of unknowns x."""
        return self.pair.order * self.entries.count

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of X, (np, nq)."""
        return self.pair.order * self.entries.outputs, self.pair.order * self.entries.inputs

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the semidefinite blocks of the condition."""
        return self.entries.blocks(self.pair.order)

    @functools.cached_property
    def basis(self) -> NDArray[np.float64]:
        """X(e_j) of one entry for every unit vector, shape (n, n, n)."""
        return _basis(self.pair.A, self.pair.c)

    @functools.cached_property
    def unit_matrices(self) -> NDArray[np.float64]:
        """X of every unit vector of all entries, (size, np, nq)."""
        parts = self.entries.basis[:, None, None, :, None, :] * self.basis[None, :, :, None, :, None]
        return freeze(parts.reshape(self.size, *self.shape))

    @functools.cached_property
    def symmetry(self) -> NDArray[np.float64]:
        """The T of `InputNormalPair.symmetry`."""
        return freeze(self.pair.symmetry())

    @functools.cached_property
    def symmetric_basis(self) -> NDArray[np.float64]:
        """H(e_j) = T X(e_j), symmetrised, shape (n, n, n)."""
        return _symmetric_basis(self.pair.A, self.pair.c, self.symmetry)

    def of(self, entries: Entries) -> SarasonMap:
        """The same map for matrices of another shape."""
        return dataclasses.replace(self, entries=entries)  # type: ignore[type-var]

    def turned(self, M: NDArray[np.float64]) -> NDArray[np.float64]:
        """T M, for MIMO (T (x) I) M; T is symmetric and orthogonal, its own inverse."""
        return self._turned(M.reshape(self.pair.order, M.size // max(self.pair.order, 1))).reshape(M.shape)

    def matrix(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """X(x)."""
        return self.entries.joined(self._matrices(self.entries.expand(x)))

    def stein(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """The S with S - A S A' = Y, entry by entry: <Y, X(x)> = <`first_row`(S), x> for all x."""
        return self.entries.joined(self._stein(self.entries.parted(Y)))

    def first_row(self, S: NDArray[np.float64]) -> NDArray[np.float64]:
        """The weights c S of x, (size,)."""
        return self.entries.collapse(self.pair.c[0] @ self.entries.parted(S))

    def norm(self, x: NDArray[np.float64]) -> float:
        """||X(x)||, the smallest gain of any function with these data."""
        return float(np.linalg.norm(self.matrix(x), 2)) if x.any() else 0.0

    def largest(self, level: float) -> float:
        """Largest ||X|| of the functions of the class that keep every residual within `level` bounds."""
        return 1.0

    def product(self, Y: NDArray[np.float64], level: float) -> float:
        """Largest <Y, X> of them: the nuclear norm ||Y||_*."""
        return float(np.sum(np.linalg.svd(Y, compute_uv=False)))

    def interpolants(self, x: NDArray[np.float64]) -> Any:
        """All functions of the unit ball with the data x; needs ||X(x)|| < 1."""
        return interpolants(self.pair, self.entries.parted(self.matrix(x)), self.entries.expand(x))

    def ball(self, axes: Axes | None = None, quick: bool = False) -> Ball:
        """||X|| <= b as semidefinite blocks of x, of its coordinates along `axes` where they are given.

        `quick` ones may differ in their last digits: for bounds, whose proofs are evaluated anew.
        """
        ball: Ball
        if self.entries.single:
            ball = SymmetricBall(self._quick_map() if quick else self._symmetric_map())
        else:
            ball = MatrixBall(self.entries, self.pair.order, self._products())
        return ball if axes is None else TurnedBall(ball, axes)

    def inequalities(self) -> Inequalities:
        """||X|| <= b as linear matrix inequalities of stored matrices, for general solvers."""
        return self.ball().inequalities(self.unit_matrices, self.symmetric_basis, self.turned)

    def _matrices(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """X of every entry, (p, q, n, n), of (p, q, n), from its Stein equation."""
        turned = [(Q, P) for P, Q in self._powers]
        return solve_stein(self.pair.A.T, self.pair.A, self.pair.c.T @ x[..., None, :], turned)

    def _stein(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        return solve_stein(self.pair.A, self.pair.A.T, Y, self._powers)

    @functools.cached_property
    def _powers(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        return stein_powers(self.pair.A, self.pair.A.T)

    def _turned(self, M: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.symmetry @ M

    def _symmetric_map(self) -> SymmetricMap:
        """H of one entry."""
        return DenseMap(self.symmetric_basis)

    def _quick_map(self) -> SymmetricMap:
        """The same, rounded otherwise where that is quicker."""
        return self._symmetric_map()

    def _products(self) -> EntryProducts:
        """H of every entry of a matrix."""
        return DenseProducts(self.symmetric_basis)


@dataclasses.dataclass(frozen=True, eq=False)
class PairMap(SarasonMap):
    """The map of any input-normal pair."""

    pair: InputNormalPair
    entries: Entries = SINGLE

    @functools.cached_property
    def _by_quadrature(self) -> QuadratureMap | None:
        """A map with n^3 work for the curvature in place of n^4; None where the nodes don't allow it."""
        return QuadratureMap.of(self.pair, self.symmetry)

    def _symmetric_map(self) -> SymmetricMap:
        """H of stored matrices, of large orders with a curvature by quadrature, where the nodes allow it."""
        other = self._by_quadrature if self.pair.order >= _LARGE else None
        return super()._symmetric_map() if other is None else DenseMapOf(self.symmetric_basis, other)

    def _quick_map(self) -> SymmetricMap:
        """By quadrature, where the nodes allow it."""
        return self._by_quadrature or super()._symmetric_map()

    def _products(self) -> EntryProducts:
        """By quadrature too."""
        found = self._by_quadrature
        return super()._products() if found is None else found.products()
