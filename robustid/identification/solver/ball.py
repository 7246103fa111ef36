"""The ball ||X(x)|| <= b as semidefinite blocks b I + A_k(x).

One channel: two, A = -+H(x), H = T X symmetric. Matrices: one of size n(p + q), A = [0 H; H' 0], H = (T (x) I) X.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import scipy.fft
import scipy.linalg

from robustid.identification.formulation.sarason import SarasonMap, SectionMap, ShiftMap, antidiagonal_blocks
from robustid.identification.solver.hankel_map import HankelMap
from robustid.identification.solver.matrix_ball import MatrixBall


class Ball(Protocol):
    """The linear maps x -> A_k(x) = sum_j x_j A_kj into symmetric matrices, their adjoint, and their curvature."""

    size: int
    blocks: tuple[int, ...]

    def matrices(self, x: np.ndarray) -> list[np.ndarray]:
        """The A_k(x), fresh arrays."""
        ...

    def adjoint(self, Z: list[np.ndarray]) -> np.ndarray:
        """Inner products sum_k tr(A_kj Z_k), (n,)."""
        ...

    def times(self, x: np.ndarray, M: list[np.ndarray]) -> list[np.ndarray]:
        """The A_k(x) M_k."""
        ...

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(A_ki P A_kj Q) over the pairs (P, Q) of block k, symmetric positive definite, (n, n)."""
        ...


class SymmetricBall:
    """One channel: -+H(x) of a symmetric map."""

    def __init__(self, symmetric: SymmetricMap):
        self._map, self.size = symmetric, symmetric.size
        self.blocks = (symmetric.size, symmetric.size)

    def matrices(self, x: np.ndarray) -> list[np.ndarray]:
        """-H(x) and H(x)."""
        H = self._map.matrix(x)
        return [-H, H]

    def adjoint(self, Z: list[np.ndarray]) -> np.ndarray:
        """Inner products tr(H_j (Z_2 - Z_1))."""
        return self._map.adjoint(Z[1] - Z[0])

    def times(self, x: np.ndarray, M: list[np.ndarray]) -> list[np.ndarray]:
        """-H(x) M_1 and H(x) M_2."""
        return [-self._map.times(x, M[0]), self._map.times(x, M[1])]

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(H_i P H_j Q)."""
        return self._map.curvature(pairs)


class SymmetricMap(Protocol):
    """The linear map x -> H(x) = sum_j x_j H_j into symmetric matrices, its adjoint, and its curvature."""

    size: int

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H(x), (n, n)."""
        ...

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products tr(H_j Y), (n,)."""
        ...

    def times(self, x: np.ndarray, M: np.ndarray) -> np.ndarray:
        """H(x) M."""
        ...

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(H_i P H_j Q) over pairs (P, Q) of symmetric positive definite matrices, (n, n)."""
        ...


class BlockHankelMap:
    """H of a repeated section: block U(x_s) + V(x_(s-1)) where the block indices sum to M-1+s, U = T P and V = T Q.

    With J_s the blocks whose indices sum to M-1+s, H_(s,a) = J_s x U_a + J_(s+1) x V_a, so that the curvature

        tr(H_i P H_j Q) = sum over j + k = M-1+s, k' + j' = M-1+t of tr(U_a P_jk' U_b Q_kj'') + ...

    is a two-dimensional convolution over the block indices. In the transforms, matrices of size m per point, s -> s + 1 is a
    phase w, and the sum is tr((U_a + w V_a) P (U_b + w' V_b) Q'): O(m^2 n^2) products and O(n^2 log M) for the FFTs.
    """

    def __init__(self, sarason: SectionMap):
        self._map, self.size = sarason, sarason.pair.order
        self._shape = sarason.sections.repeats, sarason.sections.degree
        self._length = int(scipy.fft.next_fast_len(2 * self._shape[0], real=True) or 0)  # one place beyond is zero
        tau = sarason.sections.section.symmetry()
        self._tau, (self._U, self._V) = tau, (_symmetrised(tau @ part) for part in sarason.maps)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H(x)."""
        blocks = _symmetrised(self._tau @ self._map.blocks(x))
        return antidiagonal_blocks(blocks).reshape(self.size, self.size)

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products tr(H_j Y)."""
        M, m = self._shape
        sums = np.zeros((2 * M, m, m))
        for k, row in enumerate(np.swapaxes(np.reshape(Y.T, (M, m, M, m)), 1, 2)):
            sums[k : k + M] += row
        flat, U, V = sums.reshape(2 * M, m * m), self._U.reshape(m, m * m), self._V.reshape(m, m * m)
        return (flat[M - 1 : -1] @ U.T + flat[M:] @ V.T).ravel()

    def times(self, x: np.ndarray, M: np.ndarray) -> np.ndarray:
        """H(x) M."""
        return self.matrix(x) @ M

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(H_i P H_j Q)."""
        (M, m), N, R = self._shape, self._length, self._length // 2 + 1
        wave = np.exp(2j * np.pi / N * np.arange(N))[:, None, None, None]
        left = (self._U + wave * self._V).reshape(N, m * m, m)
        right = (self._U + wave[:R] * self._V).reshape(R, m * m, m)
        total = np.zeros((N, R, m, m), complex)
        for P, Q in pairs:
            for k, (p, q) in enumerate(zip(self._transform(P), self._transform(Q), strict=True)):
                above = (left[k] @ p.reshape(m, -1)).reshape(m, m, R, m).transpose(2, 0, 3, 1).reshape(R, m, m * m)
                below = (right @ q.transpose(1, 2, 0)).reshape(R, m, m * m)
                total[k] += above @ below.transpose(0, 2, 1)
        last = slice(M - 1, 2 * M - 1)
        half = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        full = np.asarray(scipy.fft.irfft(half, N, axis=1))[:, last].transpose(0, 2, 1, 3).reshape(self.size, self.size)
        return (full + full.T) / 2

    def _transform(self, P: np.ndarray) -> np.ndarray:
        """(N, m, N/2 + 1, m)."""
        M, m = self._shape
        half = scipy.fft.rfft(P.reshape(M, m, M, m), self._length, axis=2)
        return np.asarray(scipy.fft.fft(half, self._length, axis=0, overwrite_x=True))


class DenseMap:
    """H of any input-normal pair from its stored basis; O(n^4) for the curvature, as one large matrix product."""

    def __init__(self, basis: np.ndarray):
        self.size = basis.shape[0]
        self._flat = basis.reshape(self.size, self.size**2)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H(x)."""
        return (x @ self._flat).reshape(self.size, self.size)

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products tr(H_j Y)."""
        return self._flat @ Y.ravel()

    def times(self, x: np.ndarray, M: np.ndarray) -> np.ndarray:
        """H(x) M."""
        return self.matrix(x) @ M

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
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


class TurnedMap:
    """H(V y) of another map, V orthogonal."""

    def __init__(self, ball: SymmetricMap, axes: np.ndarray):
        self._ball, self._axes, self.size = ball, axes, ball.size

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H(V x)."""
        return self._ball.matrix(self._axes @ x)

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """V' times the adjoint."""
        return self._axes.T @ self._ball.adjoint(Y)

    def times(self, x: np.ndarray, M: np.ndarray) -> np.ndarray:
        """H(V x) M."""
        return self._ball.times(self._axes @ x, M)

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """V' times the curvature times V."""
        turned = self._axes.T @ self._ball.curvature(pairs) @ self._axes
        return (turned + turned.T) / 2


def _symmetrised(stack: np.ndarray) -> np.ndarray:
    return (stack + np.swapaxes(stack, -1, -2)) / 2


def ball_of(sarason: SarasonMap, axes: np.ndarray | None = None) -> Ball:
    """The fast form that the basis allows; of H(axes y) where there are axes."""
    if not sarason.entries.single:
        return MatrixBall(sarason)
    symmetric = _symmetric_map(sarason)
    return SymmetricBall(symmetric if axes is None else TurnedMap(symmetric, axes))


def _symmetric_map(sarason: SarasonMap) -> SymmetricMap:
    if isinstance(sarason, ShiftMap):
        return HankelMap(sarason.pair.order)
    if isinstance(sarason, SectionMap):
        return BlockHankelMap(sarason)
    return DenseMap(sarason.symmetric_basis)


def longest_step(factor: np.ndarray, direction: np.ndarray) -> float:
    """Largest a with LL' + a D >= 0, from the smallest eigenvalue of L^-1 D L^-T; a little less for large sizes."""
    n = factor.shape[0]
    if n == 0:
        return np.inf
    if n <= _DENSE:
        half = scipy.linalg.solve_triangular(factor, direction, lower=True, check_finite=False)
        scaled = scipy.linalg.solve_triangular(factor, half.T, lower=True, check_finite=False)
        smallest = scipy.linalg.eigvalsh(scaled, subset_by_index=[0, 0], check_finite=False)[0]
    else:
        smallest = 1.001 * _smallest(factor, direction)
    return -1 / smallest if smallest < 0 else np.inf


_DENSE = 160  # below, a dense eigenvalue routine is quicker than Lanczos


def _smallest(factor: np.ndarray, direction: np.ndarray) -> float:
    import scipy.sparse.linalg

    upper = factor.T  # in Fortran's order as it is: no copies

    def product(v: np.ndarray) -> np.ndarray:
        v = scipy.linalg.blas.dtrsv(upper, v.ravel(), lower=0)
        return scipy.linalg.blas.dtrsv(upper, direction @ v, lower=0, trans=1)

    arpack: Any = scipy.sparse.linalg
    operator = arpack.LinearOperator(direction.shape, matvec=product, dtype=float)
    start = np.ones(direction.shape[0])
    try:
        return float(arpack.eigsh(operator, k=1, which="SA", tol=1e-3, v0=start, return_eigenvectors=False)[0])
    except arpack.ArpackNoConvergence as stop:
        # Ritz values lie inside the spectrum: the step found is too long, and the caller shortens it.
        return float(min(stop.eigenvalues, default=0.0))
