"""The convex condition: a function of the unit ball has the data x iff X(x) = g(A) is a contraction."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from robustid.bases import InputNormalPair, Sections, shift_pair, solve_stein
from robustid.core import Frozen, freeze
from robustid.identification.formulation.entries import SINGLE, Entries


@dataclasses.dataclass(frozen=True, eq=False)
class SarasonMap(Frozen):
    """x -> X(x) = g(A), the solution of X - A'XA = c'x, and its symmetric form H = T X.

    A function with the coefficients x exists in the unit ball of H-infinity iff ||X(x)|| <= 1. For one channel
    T X is symmetric, hence the condition is -I <= H(x) <= I: two blocks of size n in place of one of size 2n.

    Matrix functions, p x q, have n coefficients an entry, and the condition is the same for X(x) = sum_j X(e_j) (x) x_j
    (Kronecker products), of size np x nq.

    Attributes
    ----------
    pair : InputNormalPair
    entries : Entries
        Outputs and inputs; x is a vector of `size` numbers.

    Notes
    -----
    Source: Sarason; Caratheodory-Fejer for A a shift, Nevanlinna-Pick for distinct nodes. `inanc2001` Theorem 1 is
    the same condition in a non-orthonormal basis.
    """

    pair: InputNormalPair
    entries: Entries = SINGLE

    @property
    def size(self) -> int:
        """Number of unknowns x."""
        return self.pair.order * self.entries.count

    @property
    def shape(self) -> tuple[int, int]:
        """Of X, (np, nq)."""
        return self.pair.order * self.entries.outputs, self.pair.order * self.entries.inputs

    @functools.cached_property
    def basis(self) -> np.ndarray:
        """X(e_j) of one entry for every unit vector, shape (n, n, n)."""
        n = self.pair.order
        unit = np.zeros((n, n, n))
        unit[np.arange(n), :, np.arange(n)] = self.pair.c[0]
        return freeze(solve_stein(self.pair.A.T, self.pair.A, unit))

    @functools.cached_property
    def unit_matrices(self) -> np.ndarray:
        """X of every unit vector of all entries, (size, np, nq)."""
        if self.entries.single:
            return self.basis
        parts = self.entries.basis[:, None, None, :, None, :] * self.basis[None, :, :, None, :, None]
        return freeze(parts.reshape(self.size, *self.shape))

    @functools.cached_property
    def symmetry(self) -> np.ndarray:
        """The T of `InputNormalPair.symmetry`."""
        return freeze(self.pair.symmetry())

    @functools.cached_property
    def symmetric_basis(self) -> np.ndarray:
        """H(e_j) = T X(e_j), symmetrised, shape (n, n, n)."""
        H = self.symmetry @ self.basis
        return freeze((H + H.transpose(0, 2, 1)) / 2)

    def turned(self, M: np.ndarray) -> np.ndarray:
        """T M, of matrices (T (x) I) M; T is symmetric and orthogonal, its own inverse."""
        return self._turned(M.reshape(self.pair.order, M.size // max(self.pair.order, 1))).reshape(M.shape)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """X(x)."""
        if self.entries.single:
            return self._matrix(x)
        return self.joined(self._matrix(self.entries.expand(x)))

    def stein(self, Y: np.ndarray) -> np.ndarray:
        """The S with S - A S A' = Y: <Y, X(x)> = <`first_row`(S), x> for all x; entry by entry of matrices."""
        if self.entries.single:
            return self._stein(Y)
        return self.joined(self._stein(self.parted(Y)))

    def first_row(self, S: np.ndarray) -> np.ndarray:
        """The weights c S of x, (size,)."""
        return self.entries.collapse(self.pair.c[0] @ self.parted(S))

    def parted(self, M: np.ndarray) -> np.ndarray:
        """The matrix (np, nq) entry by entry, (p, q, n, n)."""
        n, p, q = self.pair.order, self.entries.outputs, self.entries.inputs
        return M.reshape(n, p, n, q).transpose(1, 3, 0, 2)

    def joined(self, parts: np.ndarray) -> np.ndarray:
        """The matrix (np, nq) of its entries (p, q, n, n)."""
        return parts.transpose(2, 0, 3, 1).reshape(self.shape)

    def norm(self, x: np.ndarray) -> float:
        """||X(x)||, the smallest gain of any function with these data."""
        return float(np.linalg.norm(self.matrix(x), 2)) if self.pair.order else 0.0

    def _matrix(self, x: np.ndarray) -> np.ndarray:
        """X(x) of one entry or of a stack of them, from its Stein equation."""
        return solve_stein(self.pair.A.T, self.pair.A, self.pair.c.T @ x[..., None, :])

    def _stein(self, Y: np.ndarray) -> np.ndarray:
        return solve_stein(self.pair.A, self.pair.A.T, Y)

    def _turned(self, M: np.ndarray) -> np.ndarray:
        return self.symmetry @ M


class ShiftMap(SarasonMap):
    """The map of the first L Taylor coefficients: X(x) is the upper-triangular Toeplitz matrix with first row x.

    T is the flip and H(x) a Hankel matrix; nothing of size L^3 is stored.
    """

    def __init__(self, length: int, entries: Entries = SINGLE):
        super().__init__(shift_pair(length), entries)

    def __reduce__(self):
        return ShiftMap, (self.pair.order, self.entries)

    def _matrix(self, x: np.ndarray) -> np.ndarray:
        if x.ndim > 1:
            return np.array([self._matrix(part) for part in x])
        padded = np.concatenate([np.zeros(max(self.pair.order - 1, 0)), x])
        return np.lib.stride_tricks.sliding_window_view(padded, self.pair.order)[::-1].copy()

    def _stein(self, Y: np.ndarray) -> np.ndarray:
        """Sums along the diagonals, from the lower right corner."""
        S = np.array(Y)
        for row in range(S.shape[-2] - 2, -1, -1):
            S[..., row, :-1] += S[..., row + 1, 1:]
        return S

    def _turned(self, M: np.ndarray) -> np.ndarray:
        """M upside down."""
        return M[::-1]


class SectionMap(SarasonMap):
    """The map of a repeated section: X(x) is block upper triangular and Toeplitz, T the block flip with T of the section.

    Block k above the diagonal is P(x_k) + Q(x_(k-1)): a function e(zeta) x_k' of one section acts on one section or two.
    """

    def __init__(self, sections: Sections):
        super().__init__(sections.pair)
        self._set(sections=sections)

    sections: Sections

    def __reduce__(self):
        return SectionMap, (self.sections,)

    @functools.cached_property
    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """P(e_a) and Q(e_a) for every unit vector, each (m, m, m)."""
        m = self.sections.degree
        two = SarasonMap(dataclasses.replace(self.sections, repeats=2).pair).basis[:m, :m]
        return freeze(two[..., :m]), freeze(two[..., m:])

    @functools.cached_property
    def symmetry(self) -> np.ndarray:
        """T."""
        return freeze(np.kron(np.eye(self.sections.repeats)[::-1], self.sections.section.symmetry()))

    def blocks(self, x: np.ndarray) -> np.ndarray:
        """P(x_k) + Q(x_(k-1)), (M, m, m)."""
        P, Q = self.maps
        parts = np.reshape(x, (self.sections.repeats, self.sections.degree))
        blocks = np.tensordot(parts, P, 1)
        blocks[1:] += np.tensordot(parts[:-1], Q, 1)
        return blocks

    def _matrix(self, x: np.ndarray) -> np.ndarray:
        return antidiagonal_blocks(self.blocks(x))[::-1].reshape(2 * (self.pair.order,))


def antidiagonal_blocks(blocks: np.ndarray) -> np.ndarray:
    """(M, m, M, m): block k + j - (M - 1) in the place (k, j), zero above the antidiagonal."""
    M = blocks.shape[0]
    padded = np.concatenate([np.zeros((M - 1, *blocks.shape[1:])), blocks])
    return np.lib.stride_tricks.sliding_window_view(padded, M, axis=0).transpose(0, 1, 3, 2).copy()
