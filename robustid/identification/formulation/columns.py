"""The columns E of the non-parametric part in the measurement equations, and the residuals y - [E Q] v as linear maps."""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import ClassVar

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from robustid.core import Frozen, Numbers, freeze
from robustid.identification.formulation.ball import Axes


class Columns(Frozen, abc.ABC):
    """A complex matrix E (N, n) that acts on real unknowns, with the products that the proofs need."""

    stored: ClassVar[bool] = False  # whether the matrix itself is kept, so that `dense` costs nothing

    @property
    @abc.abstractmethod
    def shape(self) -> tuple[int, int]:
        """(N, n)."""

    @abc.abstractmethod
    def dense(self) -> Numbers:
        """E itself, (N, n)."""

    @abc.abstractmethod
    def __matmul__(self, x: NDArray[np.float64]) -> Numbers: ...

    @abc.abstractmethod
    def adjoint(self, samples: Numbers) -> NDArray[np.float64]:
        """Re E^H l, (n,)."""

    @abc.abstractmethod
    def spread(self, size: NDArray[np.float64]) -> NDArray[np.float64]:
        """Upper bound of |E|' size, (n,): what rounding errors are measured against."""

    @property
    @abc.abstractmethod
    def norm(self) -> float:
        """Frobenius norm, or an upper bound of it."""

    @abc.abstractmethod
    def design(self, Q: Numbers, discs: int) -> Design:
        """The map of [E Q], Q the columns of the parameters, with `discs` complex samples first, in its fastest form."""

    def apart(self) -> list[Numbers]:
        """E of groups of neighbouring columns, equally many in each, that share no row."""
        return [self.dense()]

    def turned(self, axes: Axes) -> Columns:
        """E V, of as many groups as `apart`."""
        return DenseColumns(self.dense() @ axes.blocks[0])


class Design(abc.ABC):
    """G (N, n) complex, acting on real unknowns v = (x, q): products and weighted Gram matrices."""

    @abc.abstractmethod
    def apply(self, v: NDArray[np.float64]) -> Numbers:
        """G v, (N,)."""

    @abc.abstractmethod
    def adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re G^H z, (n,)."""

    @abc.abstractmethod
    def gram(self, a: NDArray[np.float64], b: Numbers) -> NDArray[np.float64]:
        """Re G^H diag(a) G + Re G^T diag(b) G, (n, n), for real a and complex b."""

    @abc.abstractmethod
    def turned(self, c: Numbers, sums: scipy.sparse.csr_array) -> NDArray[np.float64]:
        """The rows sums Re conj(c) G, (M, n), `sums` a sparse matrix (M, N)."""


@dataclasses.dataclass(frozen=True, eq=False)
class DenseColumns(Columns):
    """E as a stored array."""

    array: Numbers  # (N, n)
    stored: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._set(array=freeze(self.array))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, n)."""
        rows, columns = self.array.shape
        return rows, columns

    def dense(self) -> Numbers:
        """E itself."""
        return self.array

    def __matmul__(self, x: NDArray[np.float64]) -> Numbers:
        return self.array @ x

    def adjoint(self, samples: Numbers) -> NDArray[np.float64]:
        """Re E^H l."""
        return np.asarray(np.real(self.array.conj().T @ samples), dtype=float)

    def spread(self, size: NDArray[np.float64]) -> NDArray[np.float64]:
        """|E|' size."""
        return np.abs(self.array).T @ size

    @property
    def norm(self) -> float:
        """Frobenius norm."""
        return float(np.linalg.norm(self.array))

    def design(self, Q: Numbers, discs: int) -> Design:
        """[E Q] as one stored matrix."""
        return DenseDesign(np.hstack([self.array, Q]), discs)


@dataclasses.dataclass(frozen=True, eq=False)
class ColumnPart(Frozen):
    """Some rows of E that act on some neighbouring columns only."""

    rows: slice
    columns: slice
    block: Columns


@dataclasses.dataclass(frozen=True, eq=False)
class BlockColumns(Columns):
    """E of a MIMO problem: every part of the rows sees one entry, one row, or all of its coefficients."""

    parts: tuple[ColumnPart, ...]  # their rows follow each other
    extent: tuple[int, int]  # (N, n)

    @property
    def shape(self) -> tuple[int, int]:
        """(N, n)."""
        return self.extent

    def dense(self) -> Numbers:
        """All of E."""
        out = np.zeros(self.shape, complex)
        for part in self.parts:
            out[part.rows, part.columns] = part.block.dense()
        return out

    def __matmul__(self, x: NDArray[np.float64]) -> Numbers:
        out = np.zeros(self.shape[0], complex)
        for part in self.parts:
            out[part.rows] = part.block @ x[part.columns]
        return out

    def adjoint(self, samples: Numbers) -> NDArray[np.float64]:
        """Re E^H l."""
        out = np.zeros(self.shape[1])
        for part in self.parts:
            if np.any(samples[part.rows]):
                out[part.columns] += part.block.adjoint(samples[part.rows])
        return out

    def spread(self, size: NDArray[np.float64]) -> NDArray[np.float64]:
        """Upper bound of |E|' size, as of its parts."""
        out = np.zeros(self.shape[1])
        for part in self.parts:
            if np.any(size[part.rows]):
                out[part.columns] += part.block.spread(size[part.rows])
        return out

    @functools.cached_property
    def _groups(self) -> list[list[Columns]]:
        """Blocks with the same columns; none where some overlap, or have another number of columns than others."""
        found: dict[tuple[int, int], list[Columns]] = {}
        for part in self.parts:
            found.setdefault((part.columns.start, part.columns.stop), []).append(part.block)
        ends = sorted(found)
        width = ends[0][1] - ends[0][0] if ends else 0
        regular = ends == [(at, at + width) for at in range(0, self.shape[1], max(width, 1))]
        return [found[each] for each in ends] if regular else []

    def apart(self) -> list[Numbers]:
        """E of every entry, where every part of the rows sees one entry."""
        return [np.vstack([one.dense() for one in group]) for group in self._groups] or super().apart()

    def turned(self, axes: Axes) -> Columns:
        """E V, part by part where the groups have each their own V."""
        if len(axes.blocks) == 1:
            return super().turned(axes)
        width = axes.blocks.shape[1]
        parts = [
            dataclasses.replace(one, block=DenseColumns(one.block.dense() @ axes.blocks[one.columns.start // width]))
            for one in self.parts
        ]
        return dataclasses.replace(self, parts=tuple(parts))

    @property
    def norm(self) -> float:
        """Frobenius norm; of tilted samples an upper bound."""
        return float(np.linalg.norm([part.block.norm for part in self.parts]))

    def design(self, Q: Numbers, discs: int) -> Design:
        """[E Q], part by part."""
        parts: list[tuple[slice, NDArray[np.intp], Design]] = []
        for part in self.parts:
            rows = range(*part.rows.indices(self.shape[0]))
            last = np.flatnonzero(np.any(Q[part.rows] != 0, axis=0))  # the others belong to other entries
            index = np.concatenate([np.arange(*part.columns.indices(self.shape[1])), self.shape[1] + last])
            within = min(max(discs - rows.start, 0), len(rows))
            parts.append((part.rows, index, part.block.design(Q[part.rows, last], within)))
        return BlockDesign((self.shape[0], self.shape[1] + Q.shape[1]), parts)


class DenseDesign(Design):
    """G stored as its real and imaginary rows; real samples have none of the latter."""

    def __init__(self, G: Numbers, discs: int):
        self._discs = discs
        self._real, self._imag = np.ascontiguousarray(np.real(G)), np.ascontiguousarray(np.imag(G[:discs]))

    def apply(self, v: NDArray[np.float64]) -> Numbers:
        """G v."""
        out = (self._real @ v).astype(complex)
        out[: self._discs] += 1j * (self._imag @ v)
        return out

    def adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re G^H z."""
        return self._real.T @ np.real(z) + self._imag.T @ np.imag(z[: self._discs])

    def gram(self, a: NDArray[np.float64], b: Numbers) -> NDArray[np.float64]:
        """Weighted Gram matrix."""
        # a |e|^2 + Re(b e^2) = (a + |b|) Re(u e)^2 + (a - |b|) Im(u e)^2 with u^2 = b/|b|: a sum of squares, one product.
        real, imag, d = self._real, self._imag, self._discs
        size = np.abs(b[:d])
        u, v = _root_of_phase(b[:d], size)
        along, across = np.sqrt(a[:d] + size), np.sqrt(np.maximum(a[:d] - size, 0.0))
        rows = np.empty((real.shape[0] + d, real.shape[1]))
        first, second = rows[:d], rows[d : 2 * d]
        np.multiply((along * u)[:, None], real[:d], out=first)
        first -= (along * v)[:, None] * imag
        np.multiply((across * v)[:, None], real[:d], out=second)
        second += (across * u)[:, None] * imag
        np.multiply(np.sqrt(a[d:] + np.real(b[d:]))[:, None], real[d:], out=rows[2 * d :])
        return rows.T @ rows

    def turned(self, c: Numbers, sums: scipy.sparse.csr_array) -> NDArray[np.float64]:
        """The rows sums Re conj(c) G."""
        rows = np.real(c)[:, None] * self._real
        rows[: self._discs] += np.imag(c[: self._discs])[:, None] * self._imag
        return sums @ rows


def _root_of_phase(b: Numbers, size: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real and imaginary part of a square root of b/|b|, 1 where b is 0: in half the time of one of complex numbers."""
    some = size > 0
    cosine = np.divide(b.real, size, out=np.ones(size.size), where=some)
    sine = np.divide(b.imag, size, out=np.zeros(size.size), where=some)
    large = np.sqrt((1 + np.abs(cosine)) / 2)
    small = sine / (2 * large)
    right = cosine >= 0
    return np.where(right, large, small), np.where(right, small, large)


class BlockDesign(Design):
    """G (N, n) of which every part of the rows acts on some unknowns only: (rows, index of the unknowns, design) for each."""

    def __init__(self, shape: tuple[int, int], parts: list[tuple[slice, NDArray[np.intp], Design]]):
        self._shape, self._parts = shape, parts

    def apply(self, v: NDArray[np.float64]) -> Numbers:
        """G v."""
        out = np.zeros(self._shape[0], complex)
        for rows, index, design in self._parts:
            out[rows] = design.apply(v[index])
        return out

    def adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re G^H z."""
        out = np.zeros(self._shape[1])
        for rows, index, design in self._parts:
            out[index] += design.adjoint(z[rows])
        return out

    def gram(self, a: NDArray[np.float64], b: Numbers) -> NDArray[np.float64]:
        """Weighted Gram matrix."""
        out = np.zeros((self._shape[1], self._shape[1]))
        for rows, index, design in self._parts:
            out[index[:, None], index] += design.gram(a[rows], b[rows])
        return out

    def turned(self, c: Numbers, sums: scipy.sparse.csr_array) -> NDArray[np.float64]:
        """The rows sums Re conj(c) G."""
        out = np.zeros((sums.shape[0], self._shape[1]))
        for rows, index, design in self._parts:
            if np.any(c[rows]):
                out[:, index] += design.turned(c[rows], sums[:, rows])
        return out


class IntervalDesign(Design):
    """The rows of the samples, then real rows B of the last unknowns alone: those of the parameters' intervals."""

    def __init__(self, samples: Design, count: int, B: NDArray[np.float64]):
        self._samples, self._count, self._B = samples, count, B

    def apply(self, v: NDArray[np.float64]) -> Numbers:
        """G v."""
        return np.concatenate([self._samples.apply(v), self._B @ v[v.size - self._B.shape[1] :]])

    def adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re G^H z."""
        out = self._samples.adjoint(z[: self._count])
        out[out.size - self._B.shape[1] :] += self._B.T @ np.real(z[self._count :])
        return out

    def gram(self, a: NDArray[np.float64], b: Numbers) -> NDArray[np.float64]:
        """Weighted Gram matrix."""
        count, B = self._count, self._B
        out = self._samples.gram(a[:count], b[:count])
        first = out.shape[0] - B.shape[1]
        out[first:, first:] += B.T @ ((a + np.real(b))[count:, None] * B)
        return out

    def turned(self, c: Numbers, sums: scipy.sparse.csr_array) -> NDArray[np.float64]:
        """The rows sums Re conj(c) G: those of the intervals have none."""
        return self._samples.turned(c[: self._count], sums[:, : self._count])
