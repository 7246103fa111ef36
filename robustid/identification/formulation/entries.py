"""The entries of matrix coefficients as one vector."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from robustid.core import Frozen, freeze

HALF = float(np.sqrt(0.5))  # what each of two equal entries is of their unknown


@dataclasses.dataclass(frozen=True)
class Entries(Frozen):
    """An isometry between vectors and real p x q matrices, taken k times: (count k,) to (p, q, k).

    Entry by entry, row by row; of symmetric matrices the upper triangle, its off-diagonal entries times sqrt(2).

    Parameters
    ----------
    outputs, inputs : int
        p and q.
    symmetric : bool

    Examples
    --------
    >>> from robustid.identification.formulation.entries import Entries
    >>> Entries(2, 2, symmetric=True).expand([1.0, 0.0, 3.0])[..., 0]
    array([[1., 0.],
           [0., 3.]])
    """

    outputs: int = 1
    inputs: int = 1
    symmetric: bool = False

    @functools.cached_property
    def basis(self) -> np.ndarray:
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
    def single(self) -> bool:
        """Whether there is one output and one input."""
        return self.outputs == self.inputs == 1

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

    def expand(self, x: np.ndarray) -> np.ndarray:
        """(p, q, k) of (count k,)."""
        parts = np.reshape(x, (self.count, -1))
        if self.symmetric:
            return np.tensordot(self.basis, parts, (0, 0))
        return parts.reshape(self.outputs, self.inputs, -1)

    def collapse(self, full: np.ndarray) -> np.ndarray:
        """(count k,) of (p, q, k): the inverse on matrices of the class, and the adjoint of `expand` on all others."""
        if self.symmetric:
            return np.tensordot(self.basis, full, 2).ravel()
        return np.ravel(full)

    def spread(self, full: np.ndarray) -> np.ndarray:
        """`collapse` of absolute values, nowhere smaller than the absolute value of `collapse`."""
        if self.symmetric:
            return np.tensordot(np.abs(self.basis), np.abs(full), 2).ravel()
        return np.abs(full).ravel()


SINGLE = Entries()
