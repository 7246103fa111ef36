"""The ball ||X(x)|| <= b as semidefinite blocks b I + A_k(x).

SISO: two, A = -+H(x), H = T X symmetric. MIMO: one of size n(p + q), A = [0 H; H' 0], H = (T (x) I) X.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from robustid.core import Real
from robustid.identification.entries import Entries

Pairs = list[tuple[Real, Real]]
Corners = dict[tuple[int, int], Real]  # 11, 12, 21, 22: blocks (signal, signal, n, n)
Parts = dict[tuple[int, int], Any]  # of the same corners: what a kind of products needs of their blocks


class Inequalities(NamedTuple):
    """||X(x)|| <= b as b C_k + sum_j u_j A_kj >= 0 for every block k."""

    constants: tuple[Real, ...]  # C_k
    coefficients: tuple[Real, ...]  # (n, s, s), A_kj
    change: Real | None  # (n, n), x = change u; None where u is x
    # Of the multipliers Z_k of the blocks: the Y with <Y, X> <= ||Y||_* on the ball.
    multiplier: Callable[[list[Real]], Real]


class Ball(abc.ABC):
    """The linear maps x -> A_k(x) = sum_j x_j A_kj into symmetric matrices, their adjoint, and their curvature."""

    size: int
    blocks: tuple[int, ...]

    @abc.abstractmethod
    def matrices(self, x: Real) -> list[Real]:
        """The A_k(x), fresh arrays."""

    @abc.abstractmethod
    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products sum_k tr(A_kj Z_k), (n,)."""

    @abc.abstractmethod
    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """The A_k(x) M_k."""

    def both(self, x: Real, M: list[Real]) -> tuple[list[Real], list[Real]]:
        """The A_k(x) and the A_k(x) M_k."""
        return self.matrices(x), self.times(x, M)

    @abc.abstractmethod
    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(A_ki P A_kj Q) over the pairs (P, Q) of block k, symmetric positive definite, (n, n)."""

    @abc.abstractmethod
    def multiplier(self, Z: list[Real]) -> Real:
        """The multiplier Y of H with sum_k <Z_k, A_k> = -<Y, H>: <Y, H> <= ||Y||_* on the unit ball."""

    @abc.abstractmethod
    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """The blocks with stored matrices X_j (size, np, nq), H_j (n, n, n) of one entry, and T times a matrix."""


class SymmetricMap(abc.ABC):
    """The linear map x -> H(x) = sum_j x_j H_j into symmetric matrices, its adjoint, and its curvature."""

    size: int

    @abc.abstractmethod
    def matrix(self, x: Real) -> Real:
        """H(x), (n, n)."""

    @abc.abstractmethod
    def adjoint(self, Y: Real) -> Real:
        """Inner products tr(H_j Y), (n,)."""

    def times(self, x: Real, M: Real) -> Real:
        """H(x) M."""
        return self.matrix(x) @ M

    @abc.abstractmethod
    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(H_i P H_j Q) over pairs (P, Q) of symmetric positive definite matrices, (n, n)."""


class SymmetricBall(Ball):
    """The blocks of SISO: -+H(x) of a symmetric map."""

    def __init__(self, symmetric: SymmetricMap):
        self._map, self.size = symmetric, symmetric.size
        self.blocks = (symmetric.size, symmetric.size)

    def matrices(self, x: Real) -> list[Real]:
        """-H(x) and H(x)."""
        H = self._map.matrix(x)
        return [-H, H]

    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products tr(H_j (Z_2 - Z_1))."""
        return self._map.adjoint(Z[1] - Z[0])

    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """-H(x) M_1 and H(x) M_2."""
        return [-self._map.times(x, M[0]), self._map.times(x, M[1])]

    def both(self, x: Real, M: list[Real]) -> tuple[list[Real], list[Real]]:
        """-+H(x), and their products, from one H where that is not quicker otherwise."""
        if type(self._map).times is not SymmetricMap.times:
            return super().both(x, M)
        H = self._map.matrix(x)
        return [-H, H], [-(H @ M[0]), H @ M[1]]

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(H_i P H_j Q)."""
        return self._map.curvature(pairs)

    def multiplier(self, Z: list[Real]) -> Real:
        """Z_1 - Z_2."""
        return Z[0] - Z[1]

    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """I - H >= 0 and I + H >= 0."""
        one = np.eye(H.shape[0])

        def multiplier(Z: list[Real]) -> Real:
            return turned(self.multiplier(Z))

        return Inequalities((one, one), (-H, H), None, multiplier)


class DenseMap(SymmetricMap):
    """H of any input-normal pair from its stored basis; O(n^4) for the curvature, as one large matrix product."""

    def __init__(self, basis: Real):
        self.size = basis.shape[0]
        self._flat = basis.reshape(self.size, self.size**2)

    def matrix(self, x: Real) -> Real:
        """H(x)."""
        return (x @ self._flat).reshape(self.size, self.size)

    def adjoint(self, Y: Real) -> Real:
        """Inner products tr(H_j Y)."""
        return self._flat @ Y.ravel()

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(H_i P H_j Q)."""
        # tr(H_i P H_j Q) = <R'H_i L, R'H_j L> with P = LL', Q = RR': symmetric and positive semidefinite as computed.
        n = self.size
        total = np.zeros((n, n))
        for P, Q in pairs:
            left, right = np.linalg.cholesky(P), np.linalg.cholesky(Q)
            half = (self._flat.reshape(n * n, n) @ left).reshape(n, n, n)
            both = np.matmul(right.T, half).reshape(n, n * n)
            total += both @ both.T
        return total


class DenseMapOf(DenseMap):
    """A stored basis, with the curvature of another map of the same functions that has it in fewer operations.

    The curvature only shows Newton's method the way: where the way ends does not depend on it.
    """

    def __init__(self, basis: Real, other: SymmetricMap):
        super().__init__(basis)
        self._other = other

    def curvature(self, pairs: Pairs) -> Real:
        """The curvature of the other map."""
        return self._other.curvature(pairs)


class Axes(NamedTuple):
    """An orthogonal V of x = V y: blocks (k, m, m) on its diagonal, of groups of unknowns that share no sample."""

    blocks: Real

    def away(self, y: Real) -> Real:
        """V y, of a vector or of columns."""
        return self._times(self.blocks, y)

    def along(self, x: Real) -> Real:
        """V' x, of a vector or of columns."""
        return self._times(self.blocks.transpose(0, 2, 1), x)

    def of_form(self, C: Real) -> Real:
        """V' C V of a symmetric C, symmetric."""
        turned = self.along(self.along(C).T)
        return (turned + turned.T) / 2

    @staticmethod
    def _times(blocks: Real, x: Real) -> Real:
        parts = x.reshape(len(blocks), blocks.shape[1], -1)
        return np.matmul(blocks, parts).reshape(x.shape)


class TurnedBall(Ball):
    """The blocks of another ball in the coordinates y of x = V y, V orthogonal."""

    def __init__(self, ball: Ball, axes: Axes):
        self._ball, self._axes, self.size, self.blocks = ball, axes, ball.size, ball.blocks

    def matrices(self, x: Real) -> list[Real]:
        """The A_k(V y)."""
        return self._ball.matrices(self._axes.away(x))

    def adjoint(self, Z: list[Real]) -> Real:
        """V' times the adjoint."""
        return self._axes.along(self._ball.adjoint(Z))

    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """The A_k(V y) M_k."""
        return self._ball.times(self._axes.away(x), M)

    def both(self, x: Real, M: list[Real]) -> tuple[list[Real], list[Real]]:
        """The A_k(V y) and the A_k(V y) M_k."""
        return self._ball.both(self._axes.away(x), M)

    def curvature(self, pairs: Pairs) -> Real:
        """V' times the curvature times V."""
        return self._axes.of_form(self._ball.curvature(pairs))

    def multiplier(self, Z: list[Real]) -> Real:
        """The multiplier of the ball, whatever the coordinates."""
        return self._ball.multiplier(Z)

    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """The blocks in y."""
        return self._ball.inequalities(X, H, turned)._replace(change=self._axes.along(np.eye(self.size)))


class MatrixBall(Ball):
    """H(x) = sum_j H_j (x) x_j with symmetric H_j (n, n) and real x_j (p, q), rows in the order (coefficient, signal)."""

    # The curvature in the unknowns i = (k; a, b) and j = (l; c, d) is, with the blocks P^bc (n, n) of the corners of P,
    #     [P21^bc * Q12^ad + P22^bd * Q11^ac + P11^ac * Q22^bd + P12^ad * Q21^bc]_kl,   [U * V]_kl = tr(H_k U H_l V').
    # For Taylor coefficients H_k has ones where the indices sum to L - 1 + k, and U * V is a two-dimensional convolution: O(p^2
    # q^2 L^2 log L) for the whole matrix. Else it is one product of matrices, O(p^2 q^2 n^4).

    def __init__(self, entries: Entries, order: int, products: EntryProducts):
        self._entries, self._order, self._products = entries, order, products
        self.size, self._rows, self.blocks = order * entries.count, order * entries.outputs, entries.blocks(order)

    def matrices(self, x: Real) -> list[Real]:
        """[0 H; H' 0]."""
        r, out = self._rows, np.zeros((self.blocks[0], self.blocks[0]))
        out[:r, r:] = H = self._matrix(x)
        out[r:, :r] = H.T
        return [out]

    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products 2 <H_j, Z_12>."""
        corner = Z[0][: self._rows, self._rows :]
        return 2 * self._entries.collapse(self._products.adjoint(self._entries.parted(corner)))

    def _matrix(self, x: Real) -> Real:
        """H(x), (np, nq)."""
        return self._entries.joined(self._products.matrix(self._entries.expand(x)))

    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """[H M_2; H' M_1] of the two parts of the rows."""
        r, H = self._rows, self._matrix(x)
        return [np.vstack([H @ M[0][r:], H.T @ M[0][:r]])]

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(A_i P A_j Q)."""
        entries, n = self._entries, self._order
        p, q = entries.outputs, entries.inputs
        full = np.zeros((p, q, n, p, q, n))
        ((P, Q),) = ((self._corners(P), self._corners(Q)) for P, Q in pairs)
        left, right = self._products.factors(P, Q)
        places = list(np.ndindex(p, q))
        for i, (a, b) in enumerate(places):
            for c, d in places[i:]:
                found = self._products.block(left, right, a, b, c, d)
                full[a, b, :, c, d] = found
                full[c, d, :, a, b] = found.T
        if entries.symmetric:
            basis = entries.basis
            full = np.einsum("eab,abkcdl,fcd->ekfl", basis, full, basis, optimize=True)
        full = full.reshape(self.size, self.size)
        return (full + full.T) / 2

    def _corners(self, P: Real) -> Corners:
        """Blocks (signal, signal, n, n) of the corners 11, 12, 21, 22."""
        r, n = self._rows, self._order
        parts = slice(0, r), slice(r, None)
        return {
            (i + 1, j + 1): P[parts[i], parts[j]].reshape(n, -1, n, P[parts[j]].shape[0] // n).transpose(1, 3, 0, 2)
            for i in (0, 1)
            for j in (0, 1)
        }

    def multiplier(self, Z: list[Real]) -> Real:
        """-2 Z_12."""
        return -2 * Z[0][: self._rows, self._rows :]

    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """[I X; X' I] >= 0: X itself serves as well as H."""
        side, r = self.blocks[0], self._rows
        both = np.zeros((X.shape[0], side, side))
        both[:, :r, r:], both[:, r:, :r] = X, X.transpose(0, 2, 1)
        return Inequalities((np.eye(side),), (both,), None, self.multiplier)


class EntryProducts(abc.ABC):
    """The matrices H_j of the entries of a MIMO function, and the products U * V of `MatrixBall`."""

    @abc.abstractmethod
    def matrix(self, x: Real) -> Real:
        """H of every entry, (p, q, n, n), of (p, q, n)."""

    @abc.abstractmethod
    def adjoint(self, Y: Real) -> Real:
        """Inner products <H_j, Y> of every entry, (p, q, n), of (p, q, n, n)."""

    @abc.abstractmethod
    def factors(self, P: Corners, Q: Corners) -> tuple[Parts, Parts]:
        """The parts of the products that belong to each block of the left corners alone, and of the right ones."""

    @abc.abstractmethod
    def block(self, P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> Real:
        """The block of the curvature of the entries (a, b) and (c, d), of factors."""


def of_blocks(corners: Corners, one: Callable[[Real], Any]) -> Parts:
    """The parts that belong to each block of the corners, block by block."""
    return {place: [[one(block) for block in row] for row in blocks] for place, blocks in corners.items()}


def products_of_blocks(P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> tuple[tuple[Any, Any], ...]:
    """The parts of the four products U * V in the curvature of two entries, see `MatrixBall`."""
    return (
        (P[2, 1][b][c], Q[1, 2][a][d]),
        (P[2, 2][b][d], Q[1, 1][a][c]),
        (P[1, 1][a][c], Q[2, 2][b][d]),
        (P[1, 2][a][d], Q[2, 1][b][c]),
    )


class DenseProducts(EntryProducts):
    """Any basis, stored; [U * V]_kl = <U'H_k, H_l V'>."""

    def __init__(self, basis: Real):
        self._basis, n = basis, basis.shape[0]
        self._tall, self._flat = self._basis.reshape(n * n, n), self._basis.reshape(n, n * n)

    def matrix(self, x: Real) -> Real:
        """H of every entry, (p, q, n, n)."""
        return (x @ self._flat).reshape(*x.shape[:2], *self._basis.shape[1:])

    def adjoint(self, Y: Real) -> Real:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        return Y.reshape(*Y.shape[:2], -1) @ self._flat.T

    def factors(self, P: Corners, Q: Corners) -> tuple[Parts, Parts]:
        """U'H_k of the left blocks and H_l V' of the right ones."""
        return of_blocks(P, self._before), of_blocks(Q, self._after)

    def block(self, P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> Real:
        """The block of the curvature of two entries."""
        return np.asarray(sum(before @ after.T for before, after in products_of_blocks(P, Q, a, b, c, d)))

    def _before(self, U: Real) -> Real:
        return np.matmul(U.T, self._basis).reshape(self._flat.shape)

    def _after(self, V: Real) -> Real:
        return (self._tall @ V.T).reshape(self._flat.shape)
