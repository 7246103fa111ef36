"""The products of `MatrixBall` by the quadrature of an input-normal pair: O(n^3) for every block of the curvature."""

from __future__ import annotations

import numpy as np

from robustid.core import Real
from robustid.identification.formulation.ball import Corners, EntryProducts, Parts, products_of_blocks

Four = tuple[Real, Real, Real, Real]


class QuadratureProducts(EntryProducts):
    """H_j = Re sum_k D_kj b_k b_k' of every entry, R and D with the real parts above the imaginary ones, (2 n, n) each.

    [U * V]_kl = Re [D'((G_U o G_V) D + (F_U o F_V) conj(D))]_kl / 2 with G_U = (b_k' U b_l) and F_U = (b_k' U conj(b_l)).
    """

    def __init__(self, R: Real, D: Real):
        self._R, self._D, self._n = R, D, R.shape[1]

    def matrix(self, x: Real) -> Real:
        """H of every entry, (p, q, n, n)."""
        n, R = self._n, self._R
        d = x @ self._D.T
        r, s = d[..., :n, None], d[..., n:, None]
        top, bottom = R[:n], R[n:]
        return R.T @ np.concatenate([r * top - s * bottom, -r * bottom - s * top], axis=-2)

    def adjoint(self, Y: Real) -> Real:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        n, R = self._n, self._R
        half = R @ Y
        top, bottom = half[..., :n, :], half[..., n:, :]
        real = np.sum(top * R[:n] - bottom * R[n:], axis=-1)
        imaginary = np.sum(top * R[n:] + bottom * R[:n], axis=-1)
        return np.concatenate([real, -imaginary], axis=-1) @ self._D

    def factors(self, P: Corners, Q: Corners) -> tuple[Parts, Parts]:
        """Real and imaginary parts of (b_k' U b_l) and of (b_k' U conj(b_l)) of all blocks."""
        return self._of(P), self._of(Q)

    def _of(self, P: Corners) -> Parts:
        """Parts of a symmetric matrix: a block and the one across it have one product."""
        found: Parts = {(1, 2): [[self._between(U) for U in row] for row in P[1, 2]]}
        found[2, 1] = [[_across(found[1, 2][b][a]) for b in range(len(row))] for a, row in enumerate(P[2, 1])]
        for corner in ((1, 1), (2, 2)):
            rows: list[list[Four]] = []
            for a, row in enumerate(P[corner]):
                rows.append([_across(rows[b][a]) if b < a else self._between(U) for b, U in enumerate(row)])
            found[corner] = rows
        return found

    def _between(self, U: Real) -> Four:
        n, E = self._n, self._R @ U @ self._R.T
        first, last, right, left = E[:n, :n], E[n:, n:], E[:n, n:], E[n:, :n]
        return first - last, right + left, first + last, left - right

    def block(self, P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> Real:
        """The block of the curvature of two entries."""
        n, D = self._n, self._D
        K = np.zeros((2 * n, 2 * n))
        for (r, s, t, u), (e, f, g, h) in products_of_blocks(P, Q, a, b, c, d):
            real, turned = r * e - s * f, r * f + s * e
            plain, skew = t * g - u * h, t * h + u * g
            K[:n, :n] += plain + real
            K[n:, n:] += plain - real
            K[:n, n:] += skew - turned
            K[n:, :n] -= skew + turned
        return D.T @ (K @ D) / 2


def _across(four: Four) -> Four:
    """The parts of a transposed block."""
    r, s, t, u = four
    return r.T, s.T, t.T, -u.T
