"""The block of a positive-real class: from stored matrices, and by quadrature without them."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import abc
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robustid.core import Complex, Real
from robustid.identification.entries import Entries
from robustid.identification.formulation.ball import Ball, Inequalities, Pairs


class RealPart(Ball):
    """The block I + A(x), A(x) = (X + X')/2, of size N."""

    def __init__(self, size: int, rows: int):
        self.size, self._rows, self.blocks = size, rows, (rows,)

    @abc.abstractmethod
    def matrix(self, x: Real) -> Real:
        """A(x)."""

    def matrices(self, x: Real) -> list[Real]:
        """A(x)."""
        return [self.matrix(x)]

    def times(self, x: Real, M: list[Real]) -> list[Real]:
        """A(x) M."""
        return [self.matrix(x) @ M[0]]

    def multiplier(self, Z: list[Real]) -> Real:
        """-Z: <-Z, X> <= tr(Z) on the class."""
        return -Z[0]

    def inequalities(self, X: Real, H: Real, turned: Callable[[Real], Real]) -> Inequalities:
        """The block itself."""
        return Inequalities((np.eye(self._rows),), ((X + X.transpose(0, 2, 1)) / 2,), None, self.multiplier)


class DenseRealPart(RealPart):
    """The block from stored matrices A_j, (m, N, N); O(m N^3 + m^2 N^2) for the curvature."""

    def __init__(self, matrices: Real):
        super().__init__(*matrices.shape[:2])
        self._flat = matrices.reshape(self.size, -1)

    def matrix(self, x: Real) -> Real:
        """A(x)."""
        return (x @ self._flat).reshape(self._rows, self._rows)

    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products tr(A_j Z)."""
        return self._flat @ Z[0].ravel()

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(A_i P A_j Q), from factors: symmetric and positive semidefinite as computed."""
        rows, total = self._rows, np.zeros((self.size, self.size))
        for P, Q in pairs:
            left, right = np.linalg.cholesky(P), np.linalg.cholesky(Q)
            half = (self._flat.reshape(-1, rows) @ left).reshape(self.size, rows, rows)
            both = np.matmul(right.T, half).reshape(self.size, -1)
            total += both @ both.T
        return total


class QuadratureRealPart(RealPart):
    """The block of one port by quadrature, without stored matrices: O(n^3) for the curvature."""

    # X(x) = Re sum_k g(z_k) b_k b_k^H with g(z_k) = phi(z_k) x, see `QuadratureMap`. So A(x) = R' diag(d, d) R with the rows Re b_k
    # and Im b_k of R and d_k = Re g(z_k) = (D x)_k, and the curvature is D' K D, K the sum of the four blocks of
    # (R P R') o (R Q R').

    def __init__(self, rows: Complex, values: Complex):
        super().__init__(rows.shape[1], rows.shape[1])
        self._R, self._D = np.vstack([rows.real, rows.imag]), np.ascontiguousarray(values.real)

    def matrix(self, x: Real) -> Real:
        """A(x)."""
        return self._R.T @ (np.tile(self._D @ x, 2)[:, None] * self._R)

    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products tr(A_j Z)."""
        return np.sum((self._R @ Z[0]) * self._R, axis=1).reshape(2, -1).sum(axis=0) @ self._D

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(A_i P A_j Q)."""
        n, R, D = self.size, self._R, self._D
        K = np.zeros((n, n))
        for P, Q in pairs:
            K += ((R @ P @ R.T) * (R @ Q @ R.T)).reshape(2, n, 2, n).sum(axis=(0, 2))
        full = D.T @ K @ D
        return (full + full.T) / 2


class _Piece(NamedTuple):
    """One of the p^2 Hermitian matrices S of which M_k are sums: e_ab + e_ba, or j (e_ab - e_ba)."""

    imaginary: bool
    shares: Real  # of it in the matrix of every unknown
    places: tuple[tuple[int, int, complex], ...]


class QuadratureRealParts(RealPart):
    """The block of several ports by quadrature, without stored matrices: O(n^3) for the curvature."""

    # A(x) = Re sum_k (b_k b_k^H) (x) M_k with the Hermitian parts M_k of G(z_k) = sum_c phi(z_k) x_c B_c, the B_c those of
    # `Entries.basis`: of M_k = sum_S v_kS S the numbers v are Re phi(z_k) times those of x for real S, Im phi(z_k) for imaginary
    # ones. With P_kl = (b_k^H (x) I) P (b_l (x) I), and P'_kl for conj(b_l), the curvature is D_S' K_ST D_T,
    #     K_ST = Re [tr(S P_kl T Q_kl^H) + tr(S P'_kl conj(T) Q'_kl^H)] / 2.

    def __init__(self, rows: Complex, values: Complex, entries: Entries):
        p, n = entries.outputs, rows.shape[1]
        super().__init__(n * entries.count, n * p)
        self._n, self._p = n, p
        self._R, self._D = np.vstack([rows.real, rows.imag]), (values.real, values.imag)  # rows of b_k^H
        across = entries.basis.transpose(0, 2, 1)
        self._even, self._odd = (entries.basis + across) / 2, (entries.basis - across) / 2
        pairs = [(a, b) for a in range(p) for b in range(a, p)]
        pieces = [_Piece(False, self._even[:, a, b], ((a, b, 1), (b, a, 1))[: 1 + (a < b)]) for a, b in pairs]
        pieces += [_Piece(True, self._odd[:, a, b], ((a, b, 1j), (b, a, -1j))) for a, b in pairs if a < b]
        self._pieces = [piece for piece in pieces if np.any(piece.shares)]

    def matrix(self, x: Real) -> Real:
        """A(x)."""
        n, p, R, parts = self._n, self._p, self._R, x.reshape(-1, self._n)
        total = np.zeros((n, p, n, p))
        for piece in self._pieces:
            v = self._D[piece.imaginary] @ (piece.shares @ parts)
            if piece.imaginary:
                half = (R[:n].T * v) @ R[n:]
                block = half.T - half  # of j (b b^H)
            else:
                block = (R.T * np.tile(v, 2)) @ R
            for a, b, sign in piece.places:
                total[:, a, :, b] += (sign.imag if piece.imaginary else 1.0) * block
        return total.reshape(self._rows, self._rows)

    def adjoint(self, Z: list[Real]) -> Real:
        """Inner products tr(A_j Z)."""
        n, p, R = self._n, self._p, self._R
        half = R @ self._signals(Z[0])
        top, bottom = half[..., :n, :], half[..., n:, :]
        even = np.sum(top * R[:n] + bottom * R[n:], axis=-1).reshape(p * p, n)
        odd = np.sum(bottom * R[:n] - top * R[n:], axis=-1).reshape(p * p, n)
        found = self._even.reshape(-1, p * p) @ even @ self._D[0] + self._odd.reshape(-1, p * p) @ odd @ self._D[1]
        return found.ravel()

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(A_i P A_j Q)."""
        n, count = self._n, self.size // max(self._n, 1)
        total = np.zeros((count, n, count, n))
        seen = [(self._between(P), self._between(Q)) for P, Q in pairs]
        for k, one in enumerate(self._pieces):
            for m, other in enumerate(self._pieces[: k + 1]):
                K = sum((_products(P, Q, one, other) for P, Q in seen), np.zeros((n, n)))
                F = self._D[one.imaginary].T @ K @ self._D[other.imaginary]
                total += one.shares[:, None, None, None] * F[:, None] * other.shares[:, None]
                if m < k:
                    total += other.shares[:, None, None, None] * F.T[:, None] * one.shares[:, None]
        full = total.reshape(self.size, self.size)
        return (full + full.T) / 2

    def _signals(self, P: Real) -> Real:
        """Blocks (p, p, n, n) of a matrix."""
        n, p = self._n, self._p
        return P.reshape(n, p, n, p).transpose(1, 3, 0, 2)

    def _between(self, P: Real) -> tuple[Complex, Complex]:
        """P_kl and P'_kl, (p, p, n, n)."""
        n, R = self._n, self._R
        E = R @ self._signals(P) @ R.T
        first, last, right, left = E[..., :n, :n], E[..., n:, n:], E[..., :n, n:], E[..., n:, :n]
        return first + last + 1j * (left - right), first - last + 1j * (left + right)


def _products(P: tuple[Complex, Complex], Q: tuple[Complex, Complex], S: _Piece, T: _Piece) -> Real:
    """The matrix K_ST."""
    total = np.zeros(P[0].shape[2:])
    for a, b, s in S.places:
        for c, d, t in T.places:
            total += np.real(s * t * P[0][b, c] * Q[0][a, d].conj() + s * np.conj(t) * P[1][b, c] * Q[1][a, d].conj())
    return total / 2
