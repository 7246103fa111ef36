"""Matrices of exact numbers: doubles as integers times a power of two, their sums, products and definiteness."""

from __future__ import annotations

import dataclasses
import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real

_DIGITS = 53
_SHOWN = 64
_LARGE = 30_000  # products of integers
_ONE = 1 << 240  # what a definite matrix is scaled to and cut off below
_ROUNDS = 4  # congruences that are tried: each brings a definite matrix nearer to the identity


@dataclasses.dataclass(frozen=True, eq=False)
class Exact:
    """A matrix ``digits * 2**power`` of integers of any length: sums and products of matrices of doubles without any rounding."""

    digits: NDArray[np.object_]  # (p, q) of int
    power: int

    @classmethod
    def of(cls, array: Real) -> Exact:
        """The doubles as they are."""
        mantissa, exponent = np.frexp(np.asarray(array, dtype=float))
        whole = np.ldexp(mantissa, _DIGITS).astype(np.int64)
        least = int(np.min(exponent[whole != 0], initial=1 << 20))
        shift = np.where(whole != 0, exponent - least, 0)
        digits = np.left_shift(whole.astype(object), shift.astype(object))
        return cls(digits.reshape(whole.shape), least - _DIGITS if np.any(whole) else 0)

    @property
    def T(self) -> Exact:
        """The transpose."""
        return Exact(self.digits.T, self.power)

    def __matmul__(self, other: Exact) -> Exact:
        if 0 in (*self.digits.shape, *other.digits.shape):
            return Exact.of(np.zeros((self.digits.shape[0], other.digits.shape[1])))
        return Exact(_product(self.digits, other.digits), self.power + other.power)

    def __add__(self, other: Exact) -> Exact:
        power = min(self.power, other.power)
        return Exact(self.digits * 2 ** (self.power - power) + other.digits * 2 ** (other.power - power), power)

    def __neg__(self) -> Exact:
        return Exact(-self.digits, self.power)

    def __sub__(self, other: Exact) -> Exact:
        return self + (-other)

    def times(self, factor: int) -> Exact:
        """The matrix times an integer."""
        return Exact(self.digits * factor, self.power)

    def symmetrised(self) -> Exact:
        """The matrix plus its transpose."""
        return self + self.T

    def rounded(self) -> Real:
        """The nearest doubles, about."""

        def nearest(digits: int) -> float:
            surplus = max(abs(digits).bit_length() - _SHOWN, 0)
            return math.ldexp(digits >> surplus, surplus + self.power)

        return np.array([[nearest(x) for x in row] for row in self.digits.tolist()], dtype=float)

    def is_zero(self) -> bool:
        """Say whether every entry is 0."""
        return not np.any(self.digits)

    def is_symmetric(self) -> bool:
        """Say whether it equals its transpose."""
        return (self - self.T).is_zero()

    def directions(self, *others: Exact) -> list[Real]:
        """Its columns as doubles of size one, about, and those of others by the same factors."""
        columns: list[list[list[float]]] = [[], *([] for _ in others)]
        for j in range(self.digits.shape[1]):
            top = max(abs(x) for x in self.digits[:, j].tolist()) or 1
            for k, matrix in enumerate((self, *others)):
                power = matrix.power - self.power
                columns[k].append([np.ldexp(x / top, power) for x in matrix.digits[:, j].tolist()])
        return [np.array(column, dtype=float).T for column in columns]


def _product(left: NDArray[np.object_], right: NDArray[np.object_]) -> NDArray[np.object_]:
    """The product of matrices of integers; large ones by the library FLINT where it is installed, in a tenth of the time."""
    if len(left) * right.shape[1] * right.shape[0] < _LARGE or not (flint := _flint()):
        return left.dot(right)
    product = flint.fmpz_mat(left.tolist()) * flint.fmpz_mat(right.tolist())
    return np.array([[int(x) for x in row] for row in product.tolist()], dtype=object)


def _flint() -> ModuleType | None:
    try:
        import flint
    except ImportError:
        return None
    return flint


def beside(*parts: Exact) -> Exact:
    """The matrices beside each other."""
    power = min(part.power for part in parts)
    return Exact(np.hstack([part.digits * 2 ** (part.power - power) for part in parts]), power)


def symmetric_blocks(corner: Exact, side: Exact, end: Exact) -> Exact:
    """``[[corner, side], [side', end]]``."""
    return beside(beside(corner, side).T, beside(side.T, end).T).T


def solved(A: Exact, B: Exact) -> tuple[Exact, int]:
    """X and an integer d with ``A X = d B``, d = 0 where A is singular: elimination without fractions (Bareiss)."""
    n = len(A.digits)
    rows = [list(row) for row in np.hstack([A.digits, B.digits]).tolist()]
    before = 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return B, 0
        rows[k], rows[pivot] = rows[pivot], rows[k]
        lead = rows[k]
        for i in range(n):
            if i != k:
                factor = rows[i][k]
                rows[i] = [(lead[k] * x - factor * y) // before for x, y in zip(rows[i], lead, strict=True)]
        before = lead[k]
    digits = np.array([row[n:] for row in rows], dtype=object).reshape(B.digits.shape)
    return Exact(digits, B.power - A.power), before


def is_positive_definite(matrix: Exact) -> bool:
    """Say whether a symmetric matrix is proved positive definite: some congruent one is dominated by its diagonal, exactly. The
    congruence is any matrix of doubles, taken from a Cholesky factor in rounded numbers; what it leads to is computed and
    compared in integers. False proves nothing.
    """
    # `horn2013`, theorem 6.1.10: a symmetric matrix whose diagonal entries exceed the sums of the others of their rows is
    # positive definite, and the matrix it is congruent to with it.
    for _ in range(_ROUNDS):
        if any(x <= 0 for x in np.diagonal(matrix.digits)):
            return False
        shorter = _shortened(matrix.digits)
        diagonal = np.diagonal(shorter)
        if all(2 * d > s for d, s in zip(diagonal, np.abs(shorter).sum(axis=1), strict=True)):
            return True
        try:
            rounded = np.array([[x / _ONE for x in row] for row in shorter.tolist()])
            inverse = Exact.of(np.asarray(np.linalg.inv(np.linalg.cholesky(rounded)).T, dtype=float))
        except (np.linalg.LinAlgError, OverflowError):
            return False
        matrix = inverse.T @ Exact(shorter, 0) @ inverse
    return False


def _shortened(digits: NDArray[np.object_]) -> NDArray[np.object_]:
    """A matrix of few digits below a congruent one, scaled by powers of two to diagonal entries of about `_ONE`. Digits are cut
    off, by less than one unit each, which a unit a row on the diagonal outweighs: if this is positive definite, so is the
    matrix.
    """
    halves = [x.bit_length() // 2 for x in np.diagonal(digits)]
    rows = [
        [_shifted(x, _ONE.bit_length() - 1 - p - q) for x, q in zip(row, halves, strict=True)]
        for row, p in zip(digits.tolist(), halves, strict=True)
    ]
    shorter = np.array(rows, dtype=object)
    shorter[np.diag_indices(len(rows))] -= len(rows)
    return shorter


def _shifted(x: int, places: int) -> int:
    return x << places if places >= 0 else x >> -places
