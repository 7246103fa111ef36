"""The residuals e = y - G v as a linear map of the unknowns v = (x, q): products and weighted Gram matrices."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import scipy.linalg

from robustid.data import tilted
from robustid.identification.formulation.columns import BlockColumns, DenseColumns, ShiftColumns
from robustid.identification.solver.nonuniform import NonuniformSums


class Design(Protocol):
    """G (N, n) complex, acting on real unknowns."""

    def apply(self, v: np.ndarray) -> np.ndarray:
        """G v, (N,)."""
        ...

    def adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re G^H z, (n,)."""
        ...

    def gram(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Re G^H diag(a) G + Re G^T diag(b) G, (n, n), for real a and complex b."""
        ...

    def turned(self, c: np.ndarray, sums: Any) -> np.ndarray:
        """The rows sums Re conj(c) G, (M, n), `sums` a sparse matrix (M, N)."""
        ...


class DenseDesign:
    """G stored as its real and imaginary rows; real samples have none of the latter."""

    def __init__(self, G: np.ndarray, discs: int):
        self._real, self._imag, self._discs = (
            np.ascontiguousarray(np.real(G)),
            np.ascontiguousarray(np.imag(G[:discs])),
            discs,
        )

    def apply(self, v: np.ndarray) -> np.ndarray:
        """G v."""
        out = (self._real @ v).astype(complex)
        out[: self._discs] += 1j * (self._imag @ v)
        return out

    def adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re G^H z."""
        return self._real.T @ np.real(z) + self._imag.T @ np.imag(z[: self._discs])

    def gram(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Weighted Gram matrix."""
        # a |e|^2 + Re(b e^2) = (a + |b|) Re(u e)^2 + (a - |b|) Im(u e)^2 with u^2 = b/|b|: a sum of squares, one product.
        real, imag, d = self._real, self._imag, self._discs
        size = np.abs(b[:d])
        turn = np.sqrt(np.where(size > 0, b[:d] / np.where(size > 0, size, 1.0), 1.0))
        along, across = np.sqrt(a[:d] + size) * turn, np.sqrt(np.maximum(a[:d] - size, 0.0)) * turn
        rows = np.empty((real.shape[0] + d, real.shape[1]))
        rows[:d] = np.real(along)[:, None] * real[:d] - np.imag(along)[:, None] * imag
        rows[d : 2 * d] = np.imag(across)[:, None] * real[:d] + np.real(across)[:, None] * imag
        rows[2 * d :] = np.sqrt(a[d:] + np.real(b[d:]))[:, None] * real[d:]
        return rows.T @ rows

    def turned(self, c: np.ndarray, sums: Any) -> np.ndarray:
        """The rows sums Re conj(c) G."""
        rows = np.real(c)[:, None] * self._real
        rows[: self._discs] += np.imag(c[: self._discs])[:, None] * self._imag
        return sums @ rows


class ShiftDesign:
    """G = [E Q] for L Taylor coefficients on F lines, then time samples; all sums over the lines by non-uniform FFTs.

    Toeplitz plus Hankel: Re sum a_k E_ki* E_kj + b_k E_ki E_kj = (c_|i-j| + h_(i+j)) rho^-(i+j), with
    c_l = Re sum a_k g_k^2 exp(-i theta_k l) and h_l = Re sum b_k g_k^2 exp(-i theta_k l). With E + kappa conj(E) in the place
    of E the same holds with a (1 + |kappa|^2) + 2 Re(b kappa) and b + conj(b kappa^2) + 2 a conj(kappa).
    """

    def __init__(self, columns: ShiftColumns, Q: np.ndarray):
        self._columns, self._Q, self._lines = columns, Q, columns.angles.size
        self._coefficients = columns.decay.size
        if self._lines:
            self._short = NonuniformSums(columns.angles, self._coefficients)
            self._long = NonuniformSums(columns.angles, 2 * self._coefficients - 1)

    def apply(self, v: np.ndarray) -> np.ndarray:
        """G v."""
        columns, L = self._columns, self._coefficients
        out = (self._Q @ v[L:]).astype(complex)
        if self._lines:
            straight = columns.gain * self._short.over_exponents(columns.decay * v[:L])
            out[: self._lines] += tilted(straight, columns.tilt)
        out[self._lines :] += columns.real @ v[:L]
        return out

    def adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re G^H z."""
        return np.concatenate([self._adjoint(z[None])[0], np.real(self._Q.conj().T @ z)])

    def gram(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Weighted Gram matrix."""
        columns, L, F = self._columns, self._coefficients, self._lines
        inner = columns.real.T @ ((a + np.real(b))[F:, None] * columns.real)
        if F:
            first, second = a[:F], b[:F]
            if (kappa := columns.tilt) is not None:
                first, second = (
                    first * (1 + np.abs(kappa) ** 2) + 2 * np.real(second * kappa),
                    second + (second * kappa**2).conj() + 2 * first * kappa.conj(),
                )
            toeplitz = np.real(self._short.over_angles(columns.gain**2 * first))
            hankel = np.real(self._long.over_angles(columns.gain**2 * second))
            both = scipy.linalg.toeplitz(toeplitz) + np.lib.stride_tricks.sliding_window_view(hankel, L)
            inner += both * columns.decay * columns.decay[:, None]
        if not self._Q.shape[1]:
            return inner
        weighted = (a[:, None] * self._Q + (b[:, None] * self._Q).conj()).T
        cross = self._adjoint(weighted)
        corner = np.real(weighted.conj() @ self._Q)
        return np.block([[inner, cross.T], [cross, (corner + corner.T) / 2]])

    def turned(self, c: np.ndarray, sums: Any) -> np.ndarray:
        """The rows sums Re conj(c) G."""
        columns = np.hstack([self._columns.dense(), self._Q])
        return sums @ np.real(c.conj()[:, None] * columns)

    def _adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re E^H z of every row of z."""
        columns, F = self._columns, self._lines
        out = np.real(z[:, F:]) @ columns.real
        if F:
            weights = columns.gain * tilted(z[:, :F].T, columns.tilt).T.conj()
            out += columns.decay * np.real(self._short.over_angles(weights))
        return out


class BlockDesign:
    """G = [E Q] for the entries of a matrix: every part of the rows with the columns that it acts on."""

    def __init__(self, columns: BlockColumns, Q: np.ndarray, discs: int):
        self._shape = columns.shape[0], columns.shape[1] + Q.shape[1]
        self._parts = []
        for part in columns.parts:
            rows = range(*part.rows.indices(columns.shape[0]))
            last = np.flatnonzero(np.any(Q[part.rows] != 0, axis=0))  # the others belong to other entries
            index = np.concatenate([np.arange(*part.columns.indices(columns.shape[1])), columns.shape[1] + last])
            within = min(max(discs - rows.start, 0), len(rows))
            self._parts.append((part.rows, index, design_of(part.block, Q[part.rows, last], within)))

    def apply(self, v: np.ndarray) -> np.ndarray:
        """G v."""
        out = np.zeros(self._shape[0], complex)
        for rows, index, design in self._parts:
            out[rows] = design.apply(v[index])
        return out

    def adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re G^H z."""
        out = np.zeros(self._shape[1])
        for rows, index, design in self._parts:
            out[index] += design.adjoint(z[rows])
        return out

    def gram(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Weighted Gram matrix."""
        out = np.zeros((self._shape[1], self._shape[1]))
        for rows, index, design in self._parts:
            out[np.ix_(index, index)] += design.gram(a[rows], b[rows])
        return out

    def turned(self, c: np.ndarray, sums: Any) -> np.ndarray:
        """The rows sums Re conj(c) G."""
        out = np.zeros((sums.shape[0], self._shape[1]))
        for rows, index, design in self._parts:
            if np.any(c[rows]):
                out[:, index] += design.turned(c[rows], sums[:, rows])
        return out


class IntervalDesign:
    """The rows of the samples, then real rows B of the last unknowns alone: those of the intervals."""

    def __init__(self, samples: Design, count: int, B: np.ndarray):
        self._samples, self._count, self._B = samples, count, B

    def apply(self, v: np.ndarray) -> np.ndarray:
        """G v."""
        return np.concatenate([self._samples.apply(v), self._B @ v[v.size - self._B.shape[1] :]])

    def adjoint(self, z: np.ndarray) -> np.ndarray:
        """Re G^H z."""
        out = self._samples.adjoint(z[: self._count])
        out[out.size - self._B.shape[1] :] += self._B.T @ np.real(z[self._count :])
        return out

    def gram(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Weighted Gram matrix."""
        count, B = self._count, self._B
        out = self._samples.gram(a[:count], b[:count])
        first = out.shape[0] - B.shape[1]
        out[first:, first:] += B.T @ ((a + np.real(b))[count:, None] * B)
        return out

    def turned(self, c: np.ndarray, sums: Any) -> np.ndarray:
        """The rows sums Re conj(c) G: those of the intervals have none."""
        return self._samples.turned(c[: self._count], sums[:, : self._count])


def design_of(columns: DenseColumns | ShiftColumns | BlockColumns, Q: np.ndarray, discs: int) -> Design:
    """The fast form that the columns allow; Q holds the columns of the parameters."""
    if isinstance(columns, BlockColumns):
        return BlockDesign(columns, Q, discs)
    if isinstance(columns, ShiftColumns):
        return ShiftDesign(columns, Q)
    return DenseDesign(np.hstack([columns.array, Q]), discs)
