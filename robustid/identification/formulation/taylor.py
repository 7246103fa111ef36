"""Taylor coefficients: the first L delays, a triangular Toeplitz X(x), and Hankel matrices by FFT."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import scipy.fft
import scipy.linalg
from numpy.typing import NDArray

from robustid.bases import InputNormalPair, Sections, shift_pair
from robustid.core import Numbers, ZPlane
from robustid.identification.entries import SINGLE, Entries
from robustid.identification.formulation.ball import Corners, EntryProducts, Parts, SymmetricMap
from robustid.identification.formulation.base import Family, Formulation, Realisation, States
from robustid.identification.formulation.columns import Columns
from robustid.identification.formulation.functions import EntryColumns
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.formulation.tails import SHARE, smallest_bound, taylor_tail
from robustid.identification.formulation.taylor_columns import ShiftColumns, joined_shifts
from robustid.identification.interpolant import FreeParameter
from robustid.identification.problem import MixedProblem
from robustid.identification.schur import taylor_interpolants
from robustid.identification.truncation import balanced_from_impulse

LONGEST_TAYLOR = 2000  # dense L x L matrices: 32 MB each, a dozen of them, and L^3 work per Newton step

_LONG = 300  # from here on, Hankel products by FFT are quicker than dense ones
_LONGEST_IMPULSE = 8000  # samples of an impulse response that is reduced


@dataclasses.dataclass(frozen=True, eq=False)
class TaylorFormulation(Formulation):
    """The first L Taylor coefficients of G, whatever the number of samples."""

    length: int  # L

    name: ClassVar[str] = "taylor"

    @classmethod
    def within(cls, problem: MixedProblem, accuracy: float) -> TaylorFormulation:
        """The smallest L whose tails are below a tenth of the accuracy, in units of every bound."""
        return cls(problem, taylor_length(problem, accuracy))

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.length

    @property
    def determined(self) -> int:
        """Number of Taylor coefficients: all that there are."""
        return self.length

    @property
    def repeated(self) -> Sections:
        """The delay, repeated."""
        return Sections.shift(self.length)

    @property
    def basis(self) -> Sections:
        """The powers of the delay."""
        return self.repeated

    @classmethod
    def takes(cls, problem: MixedProblem) -> bool:
        """Say whether all frequencies are as deep in the region of the class: in discrete time."""
        return isinstance(problem.plane, ZPlane)

    @classmethod
    def refusal(cls, problem: MixedProblem) -> str:
        """There are no Taylor coefficients in continuous time."""
        return 'is for sampled data; these are of continuous time. Take form="sections", or "orthonormal" for few frequency points'

    def _sarason(self) -> ShiftMap:
        return ShiftMap(self.length, self.problem.entries)

    @property
    def description(self) -> str:
        """The number of coefficients."""
        return f"{self.length} Taylor coefficients{self.problem.entries.each}"

    @property
    def decay(self) -> NDArray[np.float64]:
        """rho^-j, (L,)."""
        return self.problem.prior.decay_rate ** -np.arange(self.length, dtype=float)

    def responses(self, angles: NDArray[np.float64]) -> Numbers:
        """Values at exp(j angle), (F, L)."""
        functions = self.problem.prior.gain_bound * self.decay * np.exp(-1j * np.outer(angles, np.arange(self.length)))
        return self.problem.weighting.times(functions, angles)

    def time_responses(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Responses to an input, (T, L): the input, delayed."""
        delayed = scipy.linalg.toeplitz(u, np.zeros(min(self.length, u.size)))
        padded = np.zeros((u.size, self.length))
        padded[:, : delayed.shape[1]] = delayed
        return self.problem.prior.gain_bound * self.decay * padded

    def response_tail(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest singular value of the remainder: K rho^-L (2/pi) K(1/rho), K the complete elliptic integral."""
        return taylor_tail(self.problem.prior, self.length) * self.problem.weighting.sizes(angles)

    def time_tail(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """K (sum_{j >= L} ||u_{n-j}||^2 rho^-2j)^(1/2), since the scaled coefficients of a row have norm 1, (T,)."""
        prior, L, count = self.problem.prior, self.length, u.shape[0]
        energy = np.zeros(count)
        if count > L:
            weights = prior.decay_rate ** (-2.0 * np.arange(L, len(u)))
            energy[L:] = np.convolve(np.sum(u**2, axis=1), weights)[: count - L]
        return prior.gain_bound * np.sqrt(energy)

    def entry_columns(self, angles: NDArray[np.float64]) -> EntryColumns:
        """Return what makes the columns of one entry at some of the angles: they are generated where they are needed."""

        def columns(
            used: NDArray[np.bool_],
            scale: float,
            part: float,
            bound: NDArray[np.float64],
            tilt: NDArray[np.complex128] | None,
        ) -> ShiftColumns:
            gain = self.problem.weighting.times(self.problem.prior.gain_bound * scale * part / bound, angles[used])
            return ShiftColumns(angles[used], gain, self.decay, np.zeros((0, self.length)), tilt)

        return columns

    def joined(self, lines: Sequence[Any], real: Sequence[Columns]) -> Columns | None:
        """Columns in one piece; frequency points that see several entries at once are stored, not generated."""
        if any(part.stored for part in lines):
            return super().joined(lines, real)
        return joined_shifts(self.decay, lines, real)

    def family(self, x: NDArray[np.float64]) -> Family:
        """All functions of the unit ball with the coefficients x; for SISO by the Schur algorithm, without matrices."""
        return taylor_interpolants(x) if self.problem.entries.single else super().family(x)

    def realisation(self, x: NDArray[np.float64], E: FreeParameter = 0.0) -> Realisation:
        """State spaces of the interpolant; for SISO from its impulse response."""
        if not self.problem.entries.single:
            return super().realisation(x, E)
        prior, family = self.problem.prior, taylor_interpolants(x)

        def realise(tolerance: float) -> tuple[States, float]:
            wanted = taylor_tail(prior, 0) / (1e-3 * tolerance)
            count = min(_LONGEST_IMPULSE, max(2, math.ceil(math.log(max(wanted, 2.0)) / math.log(prior.decay_rate))))
            decay = prior.decay_rate ** -np.arange(count, dtype=float)
            small = balanced_from_impulse(prior.gain_bound * decay * family.coefficients(count, E), tolerance)
            return small[:4], small.bound + taylor_tail(prior, count)

        return realise

    def _siso_work(self) -> float:
        return 20.0 * self.count**3 if self.count <= LONGEST_TAYLOR else math.inf

    def _mimo_work(self) -> float:
        (p, q), n = self.problem.entries.shape, self.count
        if n * math.sqrt(p * q) > LONGEST_TAYLOR:
            return math.inf
        return self._dense_work(1) + 40.0 * p**2 * q**2 * n**2 * math.log(n + 2)

    @property
    def _kind(self) -> tuple[str, int]:
        return "Taylor coefficients", LONGEST_TAYLOR


def taylor_length(problem: MixedProblem, accuracy: float) -> int:
    """Smallest L whose tails are below a tenth of the accuracy, in units of every bound."""
    ratio = taylor_tail(problem.prior, 0) / (SHARE * accuracy * smallest_bound(problem))
    return max(1, math.ceil(math.log(max(ratio, 1.0)) / math.log(problem.prior.decay_rate)))


@dataclasses.dataclass(frozen=True, eq=False)
class ShiftMap(SarasonMap):
    """The map of the first L Taylor coefficients: X(x) is the upper-triangular Toeplitz matrix with first row x.

    T is the flip and H(x) a Hankel matrix; nothing of size L^3 is stored.
    """

    length: int
    entries: Entries = SINGLE
    pair: InputNormalPair = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._set(pair=shift_pair(self.length))

    def _matrices(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        padded = np.concatenate([np.zeros((*x.shape[:-1], max(self.length - 1, 0))), x], axis=-1)
        windows = np.lib.stride_tricks.sliding_window_view(padded, self.length, axis=-1)
        return windows[..., ::-1, :].copy()

    def _stein(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums along the diagonals, from the lower right corner."""
        S = np.array(Y)
        for row in range(S.shape[-2] - 2, -1, -1):
            S[..., row, :-1] += S[..., row + 1, 1:]
        return S

    def _turned(self, M: NDArray[np.float64]) -> NDArray[np.float64]:
        """M upside down."""
        return M[::-1]

    def _symmetric_map(self) -> SymmetricMap:
        return HankelMap(self.length)

    def _products(self) -> EntryProducts:
        return HankelProducts(self.length)


class HankelMap(SymmetricMap):
    """H(x)_ab = x_(a+b-L+1), zero above the antidiagonal: the flipped Toeplitz matrix of L Taylor coefficients."""

    # The curvature is a two-dimensional convolution: tr(H_i P H_j Q) = sum over b + c = L-1+i, d + a = L-1+j of P_cd Q_ab = (P
    # * Q)[L-1+i, L-1+j], hence O(L^2 log L) for the whole matrix, with the rounding of an FFT: relative to ||P|| ||Q||.

    def __init__(self, size: int):
        self.size = size
        self._length = scipy.fft.next_fast_len(2 * size - 1, real=True)

    def matrix(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """H(x)."""
        # Called six times a Newton system, where NumPy's function for windows takes ten times as long as the copy.
        padded = np.concatenate([np.zeros(self.size - 1), x])
        return np.ndarray((self.size, self.size), padded.dtype, padded, strides=2 * padded.strides).copy()

    def adjoint(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inner products tr(H_j Y)."""
        n = self.size
        skewed = np.zeros((n, 2 * n))
        skewed[:, :n] = Y
        # Row a moves a places to the right, so that antidiagonals become columns.
        return skewed.ravel()[: n * (2 * n - 1)].reshape(n, 2 * n - 1).sum(axis=0)[n - 1 :]

    def times(self, x: NDArray[np.float64], M: NDArray[np.float64]) -> NDArray[np.float64]:
        """H(x) M."""
        if self.size < _LONG:
            return self.matrix(x) @ M
        # Rows of H are windows of (0, ..., 0, x): a correlation with the columns of M.
        spectrum = scipy.fft.rfft(np.concatenate([np.zeros(self.size - 1), x]), self._length)
        turned = np.asarray(scipy.fft.rfft(M[::-1].T, self._length))
        turned *= np.asarray(spectrum)
        return np.asarray(scipy.fft.irfft(turned, self._length))[:, self.size - 1 : 2 * self.size - 1].T

    def curvature(self, pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> NDArray[np.float64]:
        """Sum of tr(H_i P H_j Q)."""
        P, Q = (self._transform(np.array(ones)) for ones in zip(*pairs, strict=True))
        total = (P * Q).sum(axis=0)
        last = slice(self.size - 1, 2 * self.size - 1)
        rows = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        full = np.asarray(scipy.fft.irfft(rows, self._length))[:, last]
        return (full + full.T) / 2

    def _transform(self, P: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Two-dimensional transforms of matrices P with zeros around; the zero rows are left out where they can be."""
        return np.asarray(scipy.fft.fft(scipy.fft.rfft(P, self._length), self._length, axis=-2, overwrite_x=True))


class HankelProducts(EntryProducts):
    """Hankel matrices of Taylor coefficients; U * V by FFT."""

    def __init__(self, order: int):
        self._n = order
        self._length = int(scipy.fft.next_fast_len(2 * self._n - 1, real=True) or 0)
        self._map = HankelMap(self._n)

    def matrix(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """H of every entry, (p, q, n, n)."""
        return np.array([[self._map.matrix(entry) for entry in row] for row in x])

    def adjoint(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        return np.array([[self._map.adjoint(entry) for entry in row] for row in Y])

    def factors(self, P: Corners, Q: Corners) -> tuple[Parts, Parts]:
        """Two-dimensional transforms of all blocks, zeros around them."""
        left, right = ({place: self._transform(block) for place, block in one.items()} for one in (P, Q))
        return left, right

    def block(self, P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> NDArray[np.float64]:
        """The block of the curvature of two entries."""
        total = P[2, 1][b, c] * Q[1, 2][a, d]
        total += P[2, 2][b, d] * Q[1, 1][a, c]
        total += P[1, 1][a, c] * Q[2, 2][b, d]
        total += P[1, 2][a, d] * Q[2, 1][b, c]
        last = slice(self._n - 1, 2 * self._n - 1)
        rows = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        return np.asarray(scipy.fft.irfft(rows, self._length))[:, last]

    def _transform(self, blocks: NDArray[np.float64]) -> NDArray[np.complex128]:
        half = scipy.fft.rfft(blocks, self._length, axis=-1)
        return np.asarray(scipy.fft.fft(half, self._length, axis=-2, overwrite_x=True))
