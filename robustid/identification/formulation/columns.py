"""The columns of the non-parametric part in the measurement equations: stored, or generated from the lines."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from robustid.core import Frozen, freeze
from robustid.data import tilted

_TABLE = 2**21  # complex entries of a generated block of lines: 32 MiB


@dataclasses.dataclass(frozen=True, eq=False)
class DenseColumns(Frozen):
    """An array E (N, n) with the products that the proofs need.

    Attributes
    ----------
    array : (N, n) complex array
    """

    array: np.ndarray

    def __post_init__(self) -> None:
        self._set(array=freeze(self.array))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, n)."""
        rows, columns = self.array.shape
        return rows, columns

    def dense(self) -> np.ndarray:
        """E itself."""
        return self.array

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        return self.array @ x

    def adjoint(self, samples: np.ndarray) -> np.ndarray:
        """Re E^H l, (n,)."""
        return np.real(self.array.conj().T @ samples)

    def spread(self, size: np.ndarray) -> np.ndarray:
        """An upper bound of |E|' size, (n,): what rounding errors are measured against."""
        return np.abs(self.array).T @ size

    @property
    def norm(self) -> float:
        """Frobenius norm."""
        return float(np.linalg.norm(self.array))


@dataclasses.dataclass(frozen=True, eq=False)
class ShiftColumns(Frozen):
    """E of L Taylor coefficients, never stored for the lines: E_kj = gain_k rho^-j exp(-i theta_k j), then the rows `real`.

    Of tilted lines E + kappa conj(E): E'x is tilted, and Re E'^H l = Re E^H (l + kappa conj(l)), since that map is symmetric.

    Attributes
    ----------
    angles, gain : (F,) arrays
        theta = omega T in rad, and K/bound.
    decay : (L,) array
        rho^-j.
    real : (N - F, L) array
        Rows of the time samples.
    tilt : (F,) complex array or None
        kappa.
    """

    angles: np.ndarray
    gain: np.ndarray
    decay: np.ndarray
    real: np.ndarray
    tilt: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("angles", "gain", "decay", "real")})
        self._set(tilt=None if self.tilt is None else freeze(self.tilt))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, L)."""
        return self.angles.size + self.real.shape[0], self.decay.size

    def dense(self) -> np.ndarray:
        """All of E, (N, L)."""
        lines = [table * self.gain[at, None] * self.decay for at, table in self._tables()]
        return np.vstack([tilted(np.vstack(lines), self.tilt), self.real]) if lines else self.real.astype(complex)

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        weighted = self.decay * x
        lines = [self.gain[at] * (table @ weighted) for at, table in self._tables()]
        return np.concatenate([tilted(np.concatenate([np.zeros(0), *lines]), self.tilt), self.real @ x])

    def adjoint(self, samples: np.ndarray) -> np.ndarray:
        """Re E^H l, (L,)."""
        lines = self.angles.size
        total, weights = np.zeros(self.decay.size), self.gain * tilted(samples[:lines], self.tilt)
        for at, table in self._tables():
            total += np.real(weights[at].conj() @ table)
        return self.decay * total + self.real.T @ np.real(samples[lines:])

    def spread(self, size: np.ndarray) -> np.ndarray:
        """An upper bound of |E|' size, (L,), with the rounding of the phases theta j included.

        In units of an inner product's 2 (N + 2) eps: the phases err by pi j eps, everything else by 8 times less.
        """
        lines = self.angles.size
        phases = 8 + np.pi * np.arange(self.decay.size) / (size.size + 2)
        return self.decay * phases * float(self._reach @ size[:lines]) + np.abs(self.real).T @ size[lines:]

    @property
    def norm(self) -> float:
        """Frobenius norm; of tilted lines an upper bound."""
        return float(np.hypot(np.linalg.norm(self._reach) * np.linalg.norm(self.decay), np.linalg.norm(self.real)))

    @property
    def _reach(self) -> np.ndarray:
        """What the tilts can make of the gains, (F,)."""
        return self.gain if self.tilt is None else self.gain * (1 + np.abs(self.tilt))

    def _tables(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Blocks of exp(-i theta_k j): products of two short tables, one exponential per 32 entries."""
        count = self.decay.size
        coarse, fine = np.arange(0, count, 32), np.arange(min(32, count))
        rows = max(1, _TABLE // max(count, 1))
        for first in range(0, self.angles.size, rows):
            at = slice(first, min(first + rows, self.angles.size))
            theta = self.angles[at, None]
            product = np.exp(-1j * theta * coarse)[:, :, None] * np.exp(-1j * theta * fine)[:, None, :]
            yield at, product.reshape(theta.shape[0], -1)[:, :count]


Columns = DenseColumns | ShiftColumns


@dataclasses.dataclass(frozen=True, eq=False)
class ColumnPart(Frozen):
    """Some rows of E that act on some neighbouring columns only.

    Attributes
    ----------
    rows, columns : slice
    block : DenseColumns or ShiftColumns
    """

    rows: slice
    columns: slice
    block: Columns


@dataclasses.dataclass(frozen=True, eq=False)
class BlockColumns(Frozen):
    """E of a matrix: every part of the rows sees one entry, one row, or all of its coefficients.

    Attributes
    ----------
    parts : tuple of ColumnPart
        Their rows follow each other.
    shape : (N, n)
    """

    parts: tuple[ColumnPart, ...]
    shape: tuple[int, int]

    def dense(self) -> np.ndarray:
        """All of E, (N, n)."""
        out = np.zeros(self.shape, complex)
        for part in self.parts:
            out[part.rows, part.columns] = part.block.dense()
        return out

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        out = np.zeros(self.shape[0], complex)
        for part in self.parts:
            out[part.rows] = part.block @ x[part.columns]
        return out

    def adjoint(self, samples: np.ndarray) -> np.ndarray:
        """Re E^H l, (n,)."""
        out = np.zeros(self.shape[1])
        for part in self.parts:
            out[part.columns] += part.block.adjoint(samples[part.rows])
        return out

    def spread(self, size: np.ndarray) -> np.ndarray:
        """An upper bound of |E|' size, (n,), as of its parts."""
        out = np.zeros(self.shape[1])
        for part in self.parts:
            out[part.columns] += part.block.spread(size[part.rows])
        return out

    @property
    def norm(self) -> float:
        """Frobenius norm; of tilted lines an upper bound."""
        return float(np.linalg.norm([part.block.norm for part in self.parts]))
