"""The ball ||X(x)|| <= b of matrix functions as one semidefinite block b I + [0 H; H' 0], H = (T (x) I) X."""

from __future__ import annotations

import numpy as np
import scipy.fft

from robustid.identification.formulation.sarason import SarasonMap, ShiftMap
from robustid.identification.solver.hankel_map import HankelMap


class MatrixBall:
    r"""H(x) = sum_j H_j (x) x_j with symmetric H_j (n, n) and real x_j (p, q), rows in the order (coefficient, channel).

    The curvature in the unknowns i = (k; a, b) and j = (l; c, d) is, with the blocks P^bc (n, n) of the corners of P,

    .. math:: [P_{21}^{bc} * Q_{12}^{ad} + P_{22}^{bd} * Q_{11}^{ac} + P_{11}^{ac} * Q_{22}^{bd} + P_{12}^{ad} * Q_{21}^{bc}]_{kl},
              \quad [U * V]_{kl} = \mathrm{tr}(H_k U H_l V')

    For Taylor coefficients H_k has ones where the indices sum to L - 1 + k, and U * V is a two-dimensional convolution:
    O(p^2 q^2 L^2 log L) for the whole matrix. Else it is one product of matrices, O(p^2 q^2 n^4).
    """

    def __init__(self, sarason: SarasonMap):
        self._map, self.size = sarason, sarason.size
        self._rows, columns = sarason.shape
        self.blocks = (self._rows + columns,)
        self._pairs = _Convolutions(sarason) if isinstance(sarason, ShiftMap) else _Products(sarason)

    def matrices(self, x: np.ndarray) -> list[np.ndarray]:
        """[0 H; H' 0]."""
        r, out = self._rows, np.zeros((self.blocks[0], self.blocks[0]))
        out[:r, r:] = H = self._matrix(x)
        out[r:, :r] = H.T
        return [out]

    def adjoint(self, Z: list[np.ndarray]) -> np.ndarray:
        """Inner products 2 <H_j, Z_12>."""
        corner = Z[0][: self._rows, self._rows :]
        return 2 * self._map.entries.collapse(self._pairs.adjoint(self._map.parted(corner)))

    def _matrix(self, x: np.ndarray) -> np.ndarray:
        """H(x), (np, nq)."""
        return self._map.joined(self._pairs.matrix(self._map.entries.expand(x)))

    def times(self, x: np.ndarray, M: list[np.ndarray]) -> list[np.ndarray]:
        """[H M_2; H' M_1] of the two parts of the rows."""
        r, H = self._rows, self._matrix(x)
        return [np.vstack([H @ M[0][r:], H.T @ M[0][:r]])]

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(A_i P A_j Q)."""
        entries, n = self._map.entries, self._map.pair.order
        p, q = entries.outputs, entries.inputs
        full = np.zeros((p, q, n, p, q, n))
        ((P, Q),) = ((self._corners(P), self._corners(Q)) for P, Q in pairs)
        left, right = self._pairs.transforms(P), self._pairs.transforms(Q)
        places = list(np.ndindex(p, q))
        for i, (a, b) in enumerate(places):
            for c, d in places[i:]:
                found = self._pairs.block(left, right, a, b, c, d)
                full[a, b, :, c, d] = found
                full[c, d, :, a, b] = found.T
        if entries.symmetric:
            basis = entries.basis
            full = np.einsum("eab,abkcdl,fcd->ekfl", basis, full, basis, optimize=True)
        full = full.reshape(self.size, self.size)
        return (full + full.T) / 2

    def _corners(self, P: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
        """Blocks (channel, channel, n, n) of the corners 11, 12, 21, 22."""
        r, n = self._rows, self._map.pair.order
        parts = slice(0, r), slice(r, None)
        return {
            (i + 1, j + 1): P[parts[i], parts[j]].reshape(n, -1, n, P[parts[j]].shape[0] // n).transpose(1, 3, 0, 2)
            for i in (0, 1)
            for j in (0, 1)
        }


class _Convolutions:
    """Hankel matrices of Taylor coefficients; U * V by FFT."""

    def __init__(self, sarason: SarasonMap):
        self._n = sarason.pair.order
        self._length = int(scipy.fft.next_fast_len(2 * self._n - 1, real=True) or 0)
        self._map = HankelMap(self._n)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H of every entry, (p, q, n, n)."""
        return np.array([[self._map.matrix(entry) for entry in row] for row in x])

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        return np.array([[self._map.adjoint(entry) for entry in row] for row in Y])

    def transforms(self, corners: dict) -> dict:
        """Two-dimensional transforms of all blocks, zeros around them."""
        return {place: self._transform(block) for place, block in corners.items()}

    def block(self, P: dict, Q: dict, a: int, b: int, c: int, d: int) -> np.ndarray:
        """The block of the curvature of two entries."""
        total = P[2, 1][b, c] * Q[1, 2][a, d]
        total += P[2, 2][b, d] * Q[1, 1][a, c]
        total += P[1, 1][a, c] * Q[2, 2][b, d]
        total += P[1, 2][a, d] * Q[2, 1][b, c]
        last = slice(self._n - 1, 2 * self._n - 1)
        rows = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        return np.asarray(scipy.fft.irfft(rows, self._length))[:, last]

    def _transform(self, blocks: np.ndarray) -> np.ndarray:
        half = scipy.fft.rfft(blocks, self._length, axis=-1)
        return np.asarray(scipy.fft.fft(half, self._length, axis=-2, overwrite_x=True))


class _Products:
    """Any basis, stored; [U * V]_kl = <U'H_k, H_l V'>."""

    def __init__(self, sarason: SarasonMap):
        self._basis = sarason.symmetric_basis
        n = sarason.pair.order
        self._tall, self._flat = self._basis.reshape(n * n, n), self._basis.reshape(n, n * n)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H of every entry, (p, q, n, n)."""
        return (x @ self._flat).reshape(*x.shape[:2], *self._basis.shape[1:])

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        return Y.reshape(*Y.shape[:2], -1) @ self._flat.T

    def transforms(self, corners: dict) -> dict:
        """U'H_k and H_l V' of all blocks."""
        return {
            place: [[(self._before(one), self._after(one)) for one in row] for row in block]
            for place, block in corners.items()
        }

    def block(self, P: dict, Q: dict, a: int, b: int, c: int, d: int) -> np.ndarray:
        """The block of the curvature of two entries."""
        terms = (
            (P[2, 1][b][c], Q[1, 2][a][d]),
            (P[2, 2][b][d], Q[1, 1][a][c]),
            (P[1, 1][a][c], Q[2, 2][b][d]),
            (P[1, 2][a][d], Q[2, 1][b][c]),
        )
        return np.asarray(sum(before @ after.T for (before, _), (_, after) in terms))

    def _before(self, U: np.ndarray) -> np.ndarray:
        return np.matmul(U.T, self._basis).reshape(self._flat.shape)

    def _after(self, V: np.ndarray) -> np.ndarray:
        return (self._tall @ V.T).reshape(self._flat.shape)
