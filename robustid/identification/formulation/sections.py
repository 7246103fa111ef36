"""The form of a repeated all-pass section: few coefficients where the frequency points fill a part of the circle only."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import ClassVar

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from robustid.bases import InputNormalPair, Sections
from robustid.core import Numbers, freeze
from robustid.errors import Remedy, SizeError
from robustid.identification.entries import SINGLE, Entries
from robustid.identification.formulation.ball import (
    Corners,
    EntryProducts,
    Parts,
    SymmetricMap,
    of_blocks,
    products_of_blocks,
)
from robustid.identification.formulation.base import Formulation
from robustid.identification.formulation.exact import MOST_PRODUCTS
from robustid.identification.formulation.sarason import PairMap, SarasonMap
from robustid.identification.formulation.section_choice import shortest_sections
from robustid.identification.formulation.tails import SHARE
from robustid.identification.formulation.taylor import TaylorFormulation
from robustid.identification.problem import MixedProblem

LONGEST_SECTIONS = 1000  # coefficients; minutes begin here, with N x n columns of the frequency points

_MOST_STORED = 4e7  # complex entries of the columns of all points: 0.6 GB, of which the solver holds a few copies


@dataclasses.dataclass(frozen=True, eq=False)
class SectionsFormulation(Formulation):
    """The functions of a repeated section; the remainder is theta times a function that is bounded by the tails."""

    # MIMO: the same section for every entry. u'Gv has the coefficients u'x v for all unit vectors u and v, hence what bounds
    # the remainder of one entry bounds the largest singular value of that of the matrix.

    sections: Sections

    name: ClassVar[str] = "sections"

    @classmethod
    def within(cls, problem: MixedProblem, accuracy: float) -> Formulation:
        """The shortest repeated section whose tails are below a tenth of the accuracy; the delay where no other is shorter."""
        return of_sections(problem, shortest_sections(problem, SHARE * accuracy))

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.sections.order

    @property
    def determined(self) -> int:
        """Number of Taylor coefficients: none."""
        return 0

    @property
    def repeated(self) -> Sections:
        """The section, repeated."""
        return self.sections

    @property
    def basis(self) -> Sections:
        """The functions of the repeated section."""
        return self.sections

    def _sarason(self) -> SectionMap:
        return SectionMap(self.sections, self.problem.entries)

    @property
    def description(self) -> str:
        """The number of coefficients, the degree of the section and how often it is taken."""
        degree, repeats = self.sections.degree, self.sections.repeats
        each = self.problem.entries.each
        return f"{self.count} coefficients{each} of an all-pass section of degree {degree}, taken {repeats} times"

    def responses(self, angles: NDArray[np.float64]) -> Numbers:
        """Values at exp(j angle), (F, n)."""
        if angles.size * self.count > _MOST_STORED:
            raise SizeError(
                f"`problem` has {self.count} coefficients in the form of sections and {angles.size} frequency points; their"
                f" product may be up to {_MOST_STORED:.2g}. ",
                Remedy({}, 'Use form="taylor", or thin the data: frf.select(slice(None, None, step))'),
            )
        return self.values(angles)

    def response_tail(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """K |theta(zeta)| (2/pi) K(|zeta|) at the zeta of exp(j angle), by Cauchy's formula on the circle, (F,)."""
        # With what rounding can do to theta, and to the values of a function of norm 1 (||phi|| <= (1 - |zeta|^2)^(-1/2)); of a
        # matrix, whose rows have norm 1, sqrt(ny) times as much.
        K, region = self.problem.prior.gain_bound, self.problem.region
        sections, inside, eps = self.sections, region.inside(angles), np.finfo(float).eps
        size = np.abs(sections.all_pass(region.points(angles))) + 8 * sections.degree * eps / inside
        rounding = 8 * (sections.order + 1 / inside) * eps / np.sqrt(inside)
        tail = region.reach(K, angles) * size**sections.repeats + K * self._rows * rounding
        return tail * self.problem.weighting.sizes(angles)

    def time_responses(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Responses to the input, (T, n)."""
        return self._driven(u)[0] @ (self.problem.prior.gain_bound * self.sections.pair.symmetry())

    def time_tail(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """K (sum_j ||v_(n-j)||^2 rho^-2j)^(1/2), v the responses of theta(z/rho) to the inputs u, (T,)."""
        # Sample n is an inner product with h_n = sum_j u_(n-j) rho^-j zeta^j; P_+(conj(theta) h_n) has the coefficients v_(n-j)
        # rho^-j. No digits cancel: [A B; c d] is orthogonal, and what its rounding adds is bounded along the way.
        import scipy.signal

        prior, n, total = self.problem.prior, self.sections.order, np.zeros(u.shape[0])
        slow, fast = [1.0, -1 / prior.decay_rate], [1.0, -(prior.decay_rate**-2.0)]
        for one in u.T:
            v = self._driven(one)[1]
            energy, size = (np.sqrt(scipy.signal.lfilter([1.0], fast, a**2)) for a in (v, one))
            rounding = 2 * (n + 3) ** 1.5 * np.finfo(float).eps * scipy.signal.lfilter([1.0], slow, size)
            total = np.hypot(total, energy + rounding)
        return prior.gain_bound * total

    def _driven(self, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """States (T, n) after, and outputs (T,) at every sample of theta(z/rho) driven by u."""
        pair, rho = self.sections.pair, self.problem.prior.decay_rate
        states, outputs, state = np.empty((u.size, pair.order)), np.empty(u.size), np.zeros(pair.order)
        for k, push in enumerate(u):
            outputs[k] = pair.c[0] @ state / rho + pair.d[0, 0] * push
            states[k] = state = pair.A @ state / rho + pair.B[:, 0] * push
        return states, outputs

    def _siso_work(self) -> float:
        points, n = sum(frf.omega.size for frf in self.problem.frequency), self.count
        return 40.0 * n**3 + 3.0 * points * n**2 if n <= LONGEST_SECTIONS and points * n <= _MOST_STORED else math.inf

    def _mimo_work(self) -> float:
        (p, q), n = self.problem.entries.shape, self.count
        points = sum(points.omega.size for points in self.problem.frequency)
        if n > self._limit or points * n > _MOST_STORED:
            return math.inf
        return self._dense_work(p * q) + 4.0 * p**2 * q**2 * n**4

    @property
    def _limit(self) -> int:
        """Largest number of coefficients; MIMO: those whose products with all blocks can be stored."""
        p, q = self.problem.entries.shape
        return (
            super()._limit if self.problem.entries.single else math.floor((MOST_PRODUCTS / 4 / (p + q) ** 2) ** (1 / 3))
        )

    @property
    def _rows(self) -> float:
        """Norm of a vector of ones over the outputs."""
        return math.sqrt(self.problem.entries.outputs)

    @property
    def _kind(self) -> tuple[str, int]:
        return f"coefficients (a section of degree {self.sections.degree}, repeated)", LONGEST_SECTIONS


def of_sections(problem: MixedProblem, sections: Sections) -> Formulation:
    """The formulation of a repeated section; that of Taylor coefficients where the section is the delay."""
    if sections.is_shift and TaylorFormulation.takes(problem):
        return TaylorFormulation(problem, sections.repeats)
    return SectionsFormulation(problem, sections)


@dataclasses.dataclass(frozen=True, eq=False)
class SectionMap(SarasonMap):
    """The map of a repeated section: X(x) is block upper triangular and Toeplitz, T the block flip with T of the section.

    Block k above the diagonal is P(x_k) + Q(x_(k-1)): a function e(zeta) x_k' of one section acts on one section or two.
    """

    sections: Sections

    entries: Entries = SINGLE

    pair: InputNormalPair = dataclasses.field(init=False, repr=False)

    graded: ClassVar[bool] = False

    def __post_init__(self) -> None:
        self._set(pair=self.sections.pair)

    @functools.cached_property
    def maps(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """P(e_a) and Q(e_a) for every unit vector, each (m, m, m)."""
        m = self.sections.degree
        two = PairMap(dataclasses.replace(self.sections, repeats=2).pair).basis[:m, :m]
        return freeze(two[..., :m]), freeze(two[..., m:])

    @functools.cached_property
    def symmetry(self) -> NDArray[np.float64]:
        """T."""
        return freeze(np.kron(np.eye(self.sections.repeats)[::-1], self.sections.section.symmetry()))

    def diagonals(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """P(x_k) + Q(x_(k-1)), (M, m, m)."""
        P, Q = self.maps
        parts = np.reshape(x, (self.sections.repeats, self.sections.degree))
        blocks = np.tensordot(parts, P, 1)
        blocks[1:] += np.tensordot(parts[:-1], Q, 1)
        return blocks

    def _matrices(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        order, entries = self.pair.order, x.reshape(-1, self.pair.order)
        blocks = [antidiagonal_blocks(self.diagonals(one))[::-1].reshape(order, order) for one in entries]
        return np.reshape(blocks, (*x.shape[:2], order, order))

    def _symmetric_map(self) -> SymmetricMap:
        return BlockHankelMap(self)

    def _products(self) -> EntryProducts:
        return SectionProducts(self)


def antidiagonal_blocks(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, m, M, m): block k + j - (M - 1) in the place (k, j), zero above the antidiagonal."""
    M = blocks.shape[0]
    padded = np.concatenate([np.zeros((M - 1, *blocks.shape[1:])), blocks])
    return np.lib.stride_tricks.sliding_window_view(padded, M, axis=0).transpose(0, 1, 3, 2).copy()


class BlockHankelMap(SymmetricMap):
    """H of a repeated section: block U(x_s) + V(x_(s-1)) where the block indices sum to M-1+s, U = T P and V = T Q."""

    # With J_s the blocks whose indices sum to M-1+s, H_(s,a) = J_s x U_a + J_(s+1) x V_a, so that the curvature
    #     tr(H_i P H_j Q) = sum over j + k = M-1+s, k' + j' = M-1+t of tr(U_a P_jk' U_b Q_kj'') + ...
    # is a two-dimensional convolution over the block indices. In the transforms, matrices of size m per point, s -> s + 1 is a
    # phase w, and the sum is tr((U_a + w V_a) P (U_b + w' V_b) Q'): O(m^2 n^2) products and O(n^2 log M) for the FFTs.

    def __init__(self, sarason: SectionMap):
        self._map, self.size = sarason, sarason.pair.order
        self._shape = sarason.sections.repeats, sarason.sections.degree
        self._length = int(scipy.fft.next_fast_len(2 * self._shape[0], real=True) or 0)  # one place beyond is zero
        tau = sarason.sections.section.symmetry()
        self._tau, (self._U, self._V) = tau, (_symmetrised(tau @ part) for part in sarason.maps)

    def matrix(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """H(x)."""
        blocks = _symmetrised(self._tau @ self._map.diagonals(x))
        return antidiagonal_blocks(blocks).reshape(self.size, self.size)

    def adjoint(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inner products tr(H_j Y)."""
        M, m = self._shape
        sums = np.zeros((2 * M, m, m))
        for k, row in enumerate(np.swapaxes(np.reshape(Y.T, (M, m, M, m)), 1, 2)):
            sums[k : k + M] += row
        flat, U, V = sums.reshape(2 * M, m * m), self._U.reshape(m, m * m), self._V.reshape(m, m * m)
        return (flat[M - 1 : -1] @ U.T + flat[M:] @ V.T).ravel()

    def curvature(self, pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> NDArray[np.float64]:
        """Sum of tr(H_i P H_j Q)."""
        # With C(w, w') of real symmetric P and Q, C(w, w') = C(w', w)' and C(-w, -w') is its conjugate: half of the pairs do.
        (_, m), N, R = self._shape, self._length, self._length // 2 + 1
        p, q = (np.stack([self._transform(one[side]) for one in pairs], axis=-1) for side in (0, 1))
        turned = self._turned.reshape(N, m, m, m).transpose(0, 3, 2, 1).reshape(N, m, m * m)
        total = np.empty((N, R, m, m), complex)
        for k in range(N):
            first = min(k, N - k)
            here, there = p[k][:, first:], q[k][:, first:].transpose(1, 2, 3, 0)
            above = (here.reshape(m, -1).T @ turned[k]).reshape(R - first, -1, m)
            below = self._turned[first:R] @ there.reshape(R - first, m, -1)
            total[k, first:] = above.transpose(0, 2, 1) @ below.reshape(R - first, m, -1).transpose(0, 2, 1)
        k, r = np.nonzero(np.arange(R) < np.minimum(np.arange(N), N - np.arange(N))[:, None])
        low = 2 * k <= N
        total[k, r] = np.where(
            low[:, None, None], total[r, np.minimum(k, R - 1)], total[(N - r) % N, np.minimum(N - k, R - 1)].conj()
        ).transpose(0, 2, 1)
        full = self.back(total)
        return (full + full.T) / 2

    def before(self, P: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Transforms that tr(H_i P H_j Q') needs of P, (N, N/2 + 1, m, m^2): `back` of products with the transposes of `after`."""
        return self._above(self._transform(P))

    def after(self, Q: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Transforms that tr(H_i P H_j Q') needs of Q, (N, N/2 + 1, m, m^2)."""
        return self._below(self._transform(Q))

    def back(self, total: NDArray[np.complex128]) -> NDArray[np.float64]:
        """The (n, n) array of transforms (N, N/2 + 1, m, m)."""
        last = slice(self._shape[0] - 1, 2 * self._shape[0] - 1)
        half = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        full = np.asarray(scipy.fft.irfft(half, self._length, axis=1))[:, last]
        return full.transpose(0, 2, 1, 3).reshape(self.size, self.size)

    @functools.cached_property
    def _turned(self) -> NDArray[np.complex128]:
        """U_a + w V_a at every w, (N, m^2, m)."""
        wave = np.exp(2j * np.pi / self._length * np.arange(self._length))[:, None, None, None]
        return np.asarray(self._U + wave * self._V, dtype=complex).reshape(self._length, -1, self._shape[1])

    def _above(self, p: NDArray[np.complex128], first: int = 0) -> NDArray[np.complex128]:
        """(U_a + w V_a) P at the w from one on, (K, N/2 + 1, m, m^2), of (K, m, N/2 + 1, m)."""
        count, m, R, _ = p.shape
        found = (self._turned[first : first + count] @ p.reshape(count, m, -1)).reshape(count, m, m, R, m)
        return found.transpose(0, 3, 1, 4, 2).reshape(count, R, m, m * m)

    def _below(self, q: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """(U_b + w' V_b) Q' likewise."""
        count, m, R, _ = q.shape
        return (self._turned[:R] @ q.transpose(0, 2, 3, 1)).reshape(count, R, m, m * m)

    def _transform(self, P: NDArray[np.float64]) -> NDArray[np.complex128]:
        """(N, m, N/2 + 1, m)."""
        M, m = self._shape
        half = scipy.fft.rfft(P.reshape(M, m, M, m), self._length, axis=2)
        return np.asarray(scipy.fft.fft(half, self._length, axis=0, overwrite_x=True))


class SectionProducts(EntryProducts):
    """The products U * V of a repeated section as two-dimensional convolutions over the block indices, see `BlockHankelMap`."""

    def __init__(self, sarason: SectionMap):
        self._one = BlockHankelMap(sarason)

    def matrix(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """H of every entry, (p, q, n, n)."""
        return np.array([[self._one.matrix(entry) for entry in row] for row in x])

    def adjoint(self, Y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inner products <H_j, Y> of every entry, (p, q, n)."""
        return np.array([[self._one.adjoint(entry.T) for entry in row] for row in Y])

    def factors(self, P: Corners, Q: Corners) -> tuple[Parts, Parts]:
        """Transforms that tr(H_k U H_l V') needs of all blocks U and V."""
        return of_blocks(P, self._one.before), of_blocks(Q, self._one.after)

    def block(self, P: Parts, Q: Parts, a: int, b: int, c: int, d: int) -> NDArray[np.float64]:
        """The block of the curvature of two entries."""
        terms = products_of_blocks(P, Q, a, b, c, d)
        total = sum(before @ after.transpose(0, 1, 3, 2) for before, after in terms)
        return self._one.back(np.asarray(total, dtype=complex))


def _symmetrised(stack: NDArray[np.float64]) -> NDArray[np.float64]:
    return (stack + np.swapaxes(stack, -1, -2)) / 2
