"""The columns of Taylor coefficients at frequency points, generated where they are needed, with their products by FFT."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.fft
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray

from robustid.core import Numbers, freeze
from robustid.data import tilted
from robustid.identification.formulation.columns import Columns, Design

_TABLE = 2**21  # complex entries of a generated block of frequency points: 32 MiB
_KEPT = 2**18  # complex entries of a table that is kept: 4 MiB
_WIDTH = 16  # grid points under the kernel: 14 digits at twofold oversampling
_SHAPE = 2.3 * _WIDTH

_gauss = functools.cache(np.polynomial.legendre.leggauss)


@dataclasses.dataclass(frozen=True, eq=False)
class ShiftColumns(Columns):
    """E of L Taylor coefficients: E_kj = gain_k rho^-j exp(-i theta_k j) at frequency points, never stored, then the rows `real`.

    Of tilted samples E + kappa conj(E): E'x is tilted, and Re E'^H l = Re E^H (l + kappa conj(l)), since that map is symmetric.
    """

    angles: NDArray[np.float64]  # (F,), theta = omega T in rad
    gain: Numbers  # (F,), K/bound; complex where the class has a weight W, K W/bound
    decay: NDArray[np.float64]  # (L,), rho^-j
    real: NDArray[np.float64]  # (N - F, L), rows of the time samples
    tilt: Numbers | None = None  # (F,), kappa

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("angles", "gain", "decay", "real")})
        self._set(tilt=None if self.tilt is None else freeze(self.tilt))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, L)."""
        return self.angles.size + self.real.shape[0], self.decay.size

    def dense(self) -> Numbers:
        """All of E, (N, L)."""
        lines = [table * self.gain[at, None] * self.decay for at, table in self._tables()]
        return np.vstack([tilted(np.vstack(lines), self.tilt), self.real]) if lines else self.real.astype(complex)

    def __matmul__(self, x: NDArray[np.float64]) -> Numbers:
        weighted = self.decay * x
        lines = [self.gain[at] * (table @ weighted) for at, table in self._tables()]
        return np.concatenate([tilted(np.concatenate([np.zeros(0), *lines]), self.tilt), self.real @ x])

    def adjoint(self, samples: Numbers) -> NDArray[np.float64]:
        """Re E^H l, (L,)."""
        lines = self.angles.size
        total, weights = np.zeros(self.decay.size), self.gain.conj() * tilted(samples[:lines], self.tilt)
        for at, table in self._tables():
            total += np.real(weights[at].conj() @ table)
        return self.decay * total + self.real.T @ np.real(samples[lines:])

    def spread(self, size: NDArray[np.float64]) -> NDArray[np.float64]:
        """An upper bound of |E|' size, (L,), with the rounding of the phases theta j included.

        In units of an inner product's 2 (N + 2) eps: the phases err by pi j eps, everything else by 8 times less.
        """
        lines = self.angles.size
        phases = 8 + np.pi * np.arange(self.decay.size) / (size.size + 2)
        return self.decay * phases * float(self._reach @ size[:lines]) + np.abs(self.real).T @ size[lines:]

    @property
    def norm(self) -> float:
        """Frobenius norm; of tilted samples an upper bound."""
        return float(np.hypot(np.linalg.norm(self._reach) * np.linalg.norm(self.decay), np.linalg.norm(self.real)))

    def design(self, Q: Numbers, discs: int) -> Design:
        """[E Q] with all sums over the frequency points by non-uniform FFTs."""
        return ShiftDesign(self, Q)

    @property
    def _reach(self) -> NDArray[np.float64]:
        """Largest gains that the tilts can make of the gains, (F,)."""
        size = np.abs(self.gain)
        return size if self.tilt is None else size * (1 + np.abs(self.tilt))

    def _tables(self) -> Iterator[tuple[slice, NDArray[np.complex128]]]:
        """Yield blocks of exp(-i theta_k j); the only one of few frequency points is kept."""
        if self.angles.size * self.decay.size <= _KEPT:
            if self.angles.size:
                yield slice(0, self.angles.size), self._table
            return
        rows = max(1, _TABLE // self.decay.size)
        for first in range(0, self.angles.size, rows):
            at = slice(first, min(first + rows, self.angles.size))
            yield at, _exponentials(self.angles[at], self.decay.size)

    @functools.cached_property
    def _table(self) -> NDArray[np.complex128]:
        return _exponentials(self.angles, self.decay.size)


def _exponentials(angles: NDArray[np.float64], count: int) -> NDArray[np.complex128]:
    """The matrix exp(-i theta_k j): products of two short tables, one exponential per 32 entries."""
    coarse, fine, theta = np.arange(0, count, 32), np.arange(min(32, count)), angles[:, None]
    product = np.exp(-1j * theta * coarse)[:, :, None] * np.exp(-1j * theta * fine)[:, None, :]
    return product.reshape(theta.shape[0], -1)[:, :count]


def joined_shifts(decay: NDArray[np.float64], lines: Sequence[ShiftColumns], real: Sequence[Columns]) -> ShiftColumns:
    """Frequency points of several experiments, and rows of records, of one entry."""
    tilt: Numbers | None = None
    if any(part.tilt is not None for part in lines):
        tilt = np.concatenate([np.zeros(part.angles.size) if part.tilt is None else part.tilt for part in lines])
    rows = np.real(np.vstack([np.zeros((0, decay.size)), *(part.dense() for part in real)]))
    angles, gain = (np.concatenate([np.zeros(0), *(getattr(part, n) for part in lines)]) for n in ("angles", "gain"))
    return ShiftColumns(angles, gain, decay, rows, tilt)


class ShiftDesign(Design):
    """G = [E Q] for L Taylor coefficients at F frequency points, then time samples; sums over the points by non-uniform FFTs."""

    # Toeplitz plus Hankel: Re sum a_k E_ki* E_kj + b_k E_ki E_kj = (c_|i-j| + h_(i+j)) rho^-(i+j), with c_l = Re sum a_k
    # |g_k|^2 exp(-i theta_k l) and h_l = Re sum b_k g_k^2 exp(-i theta_k l). With E + kappa conj(E) in the place of E the same
    # holds with a (1 + |kappa|^2) + 2 Re(b kappa) and b + conj(b kappa^2) + 2 a conj(kappa).

    def __init__(self, columns: ShiftColumns, Q: Numbers):
        self._columns, self._Q, self._lines = columns, Q, columns.angles.size
        self._coefficients = columns.decay.size
        if self._lines:
            self._short = NonuniformSums(columns.angles, self._coefficients)
            self._long = NonuniformSums(columns.angles, 2 * self._coefficients - 1)

    def apply(self, v: NDArray[np.float64]) -> Numbers:
        """G v."""
        columns, L = self._columns, self._coefficients
        out = (self._Q @ v[L:]).astype(complex)
        if self._lines:
            straight = columns.gain * self._short.over_exponents(columns.decay * v[:L])
            out[: self._lines] += tilted(straight, columns.tilt)
        out[self._lines :] += columns.real @ v[:L]
        return out

    def adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re G^H z."""
        return np.asarray(np.concatenate([self._adjoint(z[None])[0], np.real(self._Q.conj().T @ z)]), dtype=float)

    def gram(self, a: NDArray[np.float64], b: Numbers) -> NDArray[np.float64]:
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
            toeplitz = np.real(self._short.over_angles(np.abs(columns.gain) ** 2 * first))
            hankel = np.real(self._long.over_angles(columns.gain**2 * second))
            both = scipy.linalg.toeplitz(toeplitz) + np.lib.stride_tricks.sliding_window_view(hankel, L)
            inner += both * columns.decay * columns.decay[:, None]
        if not self._Q.shape[1]:
            return inner
        weighted = (a[:, None] * self._Q + (b[:, None] * self._Q).conj()).T
        cross = self._adjoint(weighted)
        corner = np.real(weighted.conj() @ self._Q)
        return np.block([[inner, cross.T], [cross, (corner + corner.T) / 2]])

    def turned(self, c: Numbers, sums: scipy.sparse.csr_array) -> NDArray[np.float64]:
        """The rows sums Re conj(c) G."""
        columns = np.hstack([self._columns.dense(), self._Q])
        return sums @ np.real(c.conj()[:, None] * columns)

    def _adjoint(self, z: Numbers) -> NDArray[np.float64]:
        """Re E^H z of every row of z."""
        columns, F = self._columns, self._lines
        out = np.real(z[:, F:]) @ columns.real
        if F:
            weights = columns.gain * tilted(z[:, :F].T, columns.tilt).T.conj()
            out += columns.decay * np.real(self._short.over_angles(weights))
        return out


class NonuniformSums:
    """Sums over angles (F,), any, or exponents 0 <= m < count, of exp(-i m theta_k). Source: `barnett2019` sections 2 and 3."""

    # Processes to (or read from) a regular grid of at least twice as many points with the kernel exp(b sqrt(1 - t^2) - b),
    # whose transform divides the result; the sums are those of the regular grid to about 1e-13 of the sum of the moduli. The
    # matrix of the kernel is sparse: 16 entries per angle. (A permissive library would be used here; the one that is kept
    # contains GPL code as it is distributed.)

    def __init__(self, angles: NDArray[np.float64], count: int):
        self.count = count
        self._grid = int(scipy.fft.next_fast_len(max(2 * count, 2 * _WIDTH)) or 0)
        h = 2 * np.pi / self._grid
        # Exponents run around 0 on the grid, where the kernel's transform is largest.
        self._centre = count // 2
        self._phase = np.exp(-1j * self._centre * angles)
        first = np.ceil(angles / h - _WIDTH / 2).astype(int)
        places = first[:, None] + np.arange(_WIDTH)
        distance = 2 * (places - (angles / h)[:, None]) / _WIDTH
        values = np.exp(_SHAPE * (np.sqrt(np.maximum(1 - distance**2, 0.0)) - 1))
        rows = np.arange(0, places.size + 1, _WIDTH)
        shape = (angles.size, self._grid)
        self._kernel = scipy.sparse.csr_array((values.ravel(), (places % self._grid).ravel(), rows), shape=shape)
        self._spread = self._kernel.T.tocsr()
        nodes, weights = _gauss(4 * _WIDTH)
        exponents = np.arange(count) - self._centre
        waves = np.cos(np.outer(exponents, nodes) * (_WIDTH * h / 2))
        self._correction = 2 / _WIDTH / (waves @ (weights * np.exp(_SHAPE * (np.sqrt(1 - nodes**2) - 1))))
        self._at = exponents % self._grid

    def over_angles(self, weights: Numbers) -> Numbers:
        """sum_k weights_k exp(-i m theta_k) for every m, (..., count), of weights (..., F)."""
        gridded = (self._spread @ (weights * self._phase).T).T
        return np.asarray(scipy.fft.fft(gridded))[..., self._at] * self._correction

    def over_exponents(self, weights: Numbers) -> Numbers:
        """sum_m weights_m exp(-i m theta_k) for every angle, (F,)."""
        gridded = np.zeros(self._grid, complex)
        gridded[self._at] = weights * self._correction
        return self._phase * (self._kernel @ np.asarray(scipy.fft.fft(gridded)))
