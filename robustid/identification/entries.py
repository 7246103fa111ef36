"""The entries of matrix coefficients as one vector."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Array, Frozen, freeze

HALF = float(np.sqrt(0.5))  # what each of two equal entries is of their unknown


@dataclasses.dataclass(frozen=True)
class Entries(Frozen):
    """An isometry between vectors and real p x q matrices, taken k times: (count k,) to (p, q, k).

    Entry by entry, row by row; of symmetric matrices the upper triangle, its off-diagonal entries times sqrt(2).
    """

    outputs: int = 1  # p
    inputs: int = 1  # q
    symmetric: bool = False

    @functools.cached_property
    def basis(self) -> NDArray[np.float64]:
        """The matrices of the unit vectors, orthonormal, (count, p, q)."""
        p, q = self.outputs, self.inputs
        unit = np.eye(p * q).reshape(p * q, p, q)
        if not self.symmetric:
            return freeze(unit)
        pairs = [(a, b) for a in range(p) for b in range(a, p)]
        both = [unit[a * q + b] if a == b else (unit[a * q + b] + unit[b * q + a]) * HALF for a, b in pairs]
        return freeze(np.stack(both))

    @property
    def count(self) -> int:
        """Number of free entries."""
        p, q = self.outputs, self.inputs
        return p * (p + 1) // 2 if self.symmetric else p * q

    @property
    def shape(self) -> tuple[int, int]:
        """(p, q)."""
        return self.outputs, self.inputs

    @property
    def single(self) -> bool:
        """Say whether there is one output and one input."""
        return self.outputs == self.inputs == 1

    @property
    def each(self) -> str:
        """The words " an entry" behind a number of coefficients; nothing for SISO."""
        return "" if self.single else " an entry"

    def as_given(self, matrices: Array) -> Array:
        """Matrices (k, p, q, ...) as users see them: (k, ...) for SISO."""
        return matrices[:, 0, 0] if self.single else matrices

    @property
    def reach(self) -> float:
        """Largest norm of the vector of a matrix whose singular values are at most 1."""
        least = float(np.sqrt(min(self.outputs, self.inputs)))
        return least * (1 + 4 * np.finfo(float).eps) if self.symmetric else least  # HALF is rounded

    def place(self, output: int, input: int) -> tuple[int, float]:
        """Number of the unknown that an entry belongs to, and what the entry is of it."""
        if not self.symmetric:
            return output * self.inputs + input, 1.0
        a, b = sorted((output, input))
        return a * self.outputs - a * (a - 1) // 2 + b - a, 1.0 if a == b else HALF

    def expand(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """(p, q, k) of (count k,)."""
        parts = np.reshape(x, (self.count, -1))
        if self.symmetric:
            return np.tensordot(self.basis, parts, (0, 0))
        return parts.reshape(self.outputs, self.inputs, -1)

    def collapse(self, full: NDArray[np.float64]) -> NDArray[np.float64]:
        """(count k,) of (p, q, k): the inverse on matrices of the class, and the adjoint of `expand` on all others."""
        if self.symmetric:
            return np.tensordot(self.basis, full, 2).ravel()
        return np.ravel(full)

    def spread(self, full: NDArray[np.float64]) -> NDArray[np.float64]:
        """`collapse` of absolute values, nowhere smaller than the absolute value of `collapse`."""
        if self.symmetric:
            return np.tensordot(np.abs(self.basis), np.abs(full), 2).ravel()
        return np.abs(full).ravel()

    def parted(self, M: NDArray[np.float64]) -> NDArray[np.float64]:
        """The matrix (np, nq) entry by entry, (p, q, n, n)."""
        p, q, n = self.outputs, self.inputs, M.shape[0] // self.outputs
        return M.reshape(n, p, n, q).transpose(1, 3, 0, 2)

    def joined(self, parts: NDArray[np.float64]) -> NDArray[np.float64]:
        """The matrix (np, nq) of its entries (p, q, n, n): the inverse of `parted`."""
        p, q, n, _ = parts.shape
        return parts.transpose(2, 0, 3, 1).reshape(n * p, n * q)

    def blocks(self, order: int) -> tuple[int, ...]:
        """Sizes of the semidefinite blocks that say ||X|| <= b: two of size n for SISO, else one of size n(p + q)."""
        return (order, order) if self.single else (order * (self.outputs + self.inputs),)


SINGLE = Entries()
