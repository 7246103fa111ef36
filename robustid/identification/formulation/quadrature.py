"""The symmetric map of any input-normal pair by a quadrature on the unit circle, which makes its curvature cost O(n^3)."""

from __future__ import annotations

import numpy as np

from robustid.bases import InputNormalPair
from robustid.core import Complex, Real
from robustid.identification.formulation.ball import (
    Corners,
    EntryProducts,
    Pairs,
    Parts,
    SymmetricMap,
    products_of_blocks,
)

_STEPS = 60  # of Newton's method for the nodes of the quadrature, bisection where it leaves its bracket
_EXACT = 1e-11  # largest error of the quadrature's Gram matrix that is taken for rounding


Four = tuple[Real, Real, Real, Real]


class QuadratureMap(SymmetricMap):
    """H(x) = Re sum_k d_k b_k b_k', d = D x: n complex rows b_k of unit length, without stored matrices H_j."""

    # Products of two functions of the space of theta, the all-pass function of the pair, are in the space of theta^2. There 2n
    # nodes on the unit circle, where theta^2 = -1, with the weights 1/(2 |phi|^2) make a quadrature that is exact (Clark's measure
    # of theta^2): <g u, v> = sum_k w_k g(z_k) u(z_k) conj(v(z_k)) for all g, u and v of the space. So g(A) = B^H diag(g(z_k)) B
    # with orthonormal columns of B, whatever the zeros of theta, equal ones included; for a shift it is the FFT of length 2n. T
    # turns phi(z)^H into phi(z)' times a phase. The nodes come in conjugate pairs, of which one half is kept.

    def __init__(self, rows: Complex, weights: Complex):
        self.size = rows.shape[1]
        self._R = np.vstack([rows.real, rows.imag])
        self._D = np.vstack([weights.real, weights.imag])

    @classmethod
    def of(cls, pair: InputNormalPair, symmetry: Real) -> QuadratureMap | None:
        """The map of a cascade (`nodes_pair`) with its T; None where nodes too near to the circle cost the digits of it."""
        if (found := quadrature(pair)) is None:
            return None
        rows, phi = found
        phases = np.sum((rows @ symmetry) * rows, axis=1).conj()
        return cls(rows, phases[:, None] * phi)

    def products(self) -> EntryProducts:
        """The same H_j for every entry of a matrix."""
        return QuadratureProducts(self._R, self._D)

    def matrix(self, x: Real) -> Real:
        """H(x)."""
        n, (r, s) = self.size, (self._D @ x).reshape(2, self.size, 1)
        top, bottom = self._R[:n], self._R[n:]
        return self._R.T @ np.vstack([r * top - s * bottom, -r * bottom - s * top])

    def adjoint(self, Y: Real) -> Real:
        """Inner products tr(H_j Y)."""
        n, R = self.size, self._R
        half = R @ Y
        real = np.sum(half[:n] * R[:n] - half[n:] * R[n:], axis=1)
        imaginary = np.sum(half[:n] * R[n:] + half[n:] * R[:n], axis=1)
        return np.concatenate([real, -imaginary]) @ self._D

    def curvature(self, pairs: Pairs) -> Real:
        """Sum of tr(H_i P H_j Q)."""
        # With G_P = (b_k' P b_l) and F_P = (b_k' P conj(b_l)) it is Re D'((G_P o G_Q) D + (F_P o F_Q) conj(D)) / 2. In the
        # blocks of R P R' = [r m; m' i] and of R Q R' that is the symmetric part of [D1; D2]' [K11 2 K12; 0 K22] [D1; D2], where
        # M + M' is as good as 2 M.
        n, first, last = self.size, self._D[: self.size], self._D[self.size :]
        top, corner, bottom = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        for P, Q in pairs:
            (r, i, m), (real, imaginary, mixed) = self._blocks(P), self._blocks(Q)
            top += r * real + i * imaginary - 2 * m * mixed
            bottom += r * imaginary + i * real + 2 * m * mixed.T
            corner += i * mixed.T + imaginary * m.T - r * mixed - real * m
        full = first.T @ (top @ first + 2 * corner @ last) + last.T @ (bottom @ last)
        return (full + full.T) / 2

    def _blocks(self, P: Real) -> tuple[Real, Real, Real]:
        """The blocks of R P R': of real parts, of imaginary ones, and of both."""
        n, R = self.size, self._R
        half = R @ P
        return half[:n] @ R[:n].T, half[n:] @ R[n:].T, half[:n] @ R[n:].T


def quadrature(pair: InputNormalPair) -> tuple[Complex, Complex] | None:
    """The b_k and the phi(z_k) of a cascade, as rows; None where nodes too near to the circle cost the digits of b_k."""
    # eigenvalues of a cascade's A: of blocks of size one or two on its diagonal
    found: list[complex] = []
    k, n = 0, len(pair.A)
    while k < n:
        wide = 2 if k + 1 < n and pair.A[k, k + 1] else 1
        found.extend(np.linalg.eigvals(pair.A[k : k + wide, k : k + wide]).tolist())
        k += wide
    phi = _values(pair, np.exp(1j * _nodes(np.array(found, complex))))
    rows = phi.conj() / np.linalg.norm(phi, axis=1)[:, None]
    gram = np.real(rows.T @ rows.conj())
    return (rows, phi) if np.abs(gram - np.eye(pair.order)).max(initial=0.0) < _EXACT else None


def _nodes(zeros: Complex) -> Real:
    """The angles in (0, pi), one for each zero, at which the product of all (z - a)/(1 - conj(a) z) squares to -1."""
    # Its phase grows with the angle from 0 to n pi, and is pi/2, 3 pi/2, ... there.
    n, size, goals = zeros.size, 1 - np.abs(zeros) ** 2, np.pi * (np.arange(zeros.size) + 0.5)

    def phase(t: Real) -> tuple[Real, Real]:
        rest = 1 - np.exp(-1j * t)[:, None] * zeros
        return n * t + 2 * np.angle(rest).sum(axis=1), (size / np.abs(rest) ** 2).sum(axis=1)

    around = np.abs(np.angle(zeros))[:, None] + (1 - np.abs(zeros))[:, None] * np.array([-2, -1, -0.5, 0, 0.5, 1, 2])
    grid = np.unique(np.clip(np.concatenate([np.linspace(0, np.pi, 4 * n + 1), around.ravel()]), 0, np.pi))
    values = np.maximum.accumulate(phase(grid)[0])
    above = np.clip(np.searchsorted(values, goals), 1, grid.size - 1)
    low, high = grid[above - 1], grid[above]
    t = np.interp(goals, values, grid)
    for _ in range(_STEPS):
        value, slope = phase(t)
        low, high = np.where(value < goals, t, low), np.where(value > goals, t, high)
        ahead = t - (value - goals) / slope
        ahead = np.where((low <= ahead) & (ahead <= high), ahead, (low + high) / 2)
        moved, t = np.abs(ahead - t).max(initial=0.0), ahead
        if moved <= 16 * np.finfo(float).eps:  # a few digits of pi
            break
    return t


def _values(pair: InputNormalPair, z: Complex) -> Complex:
    """The rows phi(z) of a cascade, (len(z), n): its equations, solved block by block for all z at once."""
    # phi (I - z A) = c with A block lower triangular.
    A, c, n = pair.A, pair.c[0], pair.order
    phi = np.zeros((n, z.size), complex)
    k = n
    while k > 0:
        wide = 2 if k > 1 and A[k - 2, k - 1] else 1
        part = slice(k - wide, k)
        right = c[part, None] + z * (A[k:, part].T @ phi[k:])
        block = np.eye(wide) - z[:, None, None] * A[part, part].T
        phi[part] = np.linalg.solve(block, right.T[..., None])[..., 0].T
        k -= wide
    return phi.T


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
