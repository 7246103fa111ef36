"""Balanced truncation for interpolants: of a realisation whose A is a contraction, and of a long impulse response."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import as_array, as_positive, balancing
from robustid.errors import InputError

_EPS = float(np.finfo(float).eps)

# Rank of the first try, doubled until the remainder is proved small; and rows of the Hankel matrix handled together.
_FIRST_RANK = 64
_ROWS = 512

# Part of the tolerance that may be spent on what was not computed.
_SLACK = 0.01

# The row norms of a remainder that is zero come out as up to five times the size times eps.
_ROUNDING = 10


class Truncation(NamedTuple):
    """A small discrete model, with the impulse response D, C B, C A B, ..."""

    A: NDArray[np.float64]  # (r, r), of spectral radius below 1: leading part of a balanced realisation, as B and C
    B: NDArray[np.float64]  # (r, 1)
    C: NDArray[np.float64]  # (1, r)
    D: NDArray[np.float64]  # (1, 1)
    hankel: NDArray[np.float64]  # (r,), the Hankel singular values that are kept, descending, in units of the response
    bound: float  # of max over frequency of the error, in units of the response: twice the sum of the others


def balanced_from_impulse(response: NDArray[np.float64], tolerance: float) -> Truncation:
    """The smallest balanced truncation of an impulse response (M,), zero from there on, whose error bound meets an absolute
    tolerance: max |G - G_r| <= 2 sum_{k>r} σ_k <= tolerance, σ the singular values of H_ij = g_{1+i+j}. Same truncation as
    that of `balanced_truncation` for a model with this response, without its state space. Of a tolerance below rounding what
    rounding leaves, as the bound says.
    """
    # The square-root method with factors I and H of the Gramians of a shift register, which has this response. H is symmetric,
    # so that H = V diag(λ) V' balances it: σ = |λ|, A = σ^{-1/2} V' S V σ^{1/2} with S the shift. V'SV is a contraction for any
    # orthonormal V. Only the leading part of V is computed: an orthonormal Q of k columns that spans H² Ω, Ω random, gives the
    # eigenvalues of T = Q'HQ. For R = H - HQQ' the sum of the row norms bounds the sum of singular values, and H - QTQ' = R +
    # R'QQ' that of H beyond T:
    #     sum of all |λ(T)| beyond the r-th <= sum of all σ beyond the r-th <= the same of T + 2 (sum of row norms of R).
    # k is doubled until the last term is below one percent of half the tolerance or below rounding (10 M eps σ_1), up to half
    # of H, then H is taken as a whole. The bound includes that term, whatever Ω was, and r is the smallest for 99 % of the
    # tolerance. The bound is that of the exact V, from which the computed one differs by rounding and by what R leaves.
    # Sources: Al-Saggaf and Franklin 1987, Hinrichsen and Pritchard 1990 for the bound in discrete time; Kung 1978 for the
    # realisation; Halko, Martinsson and Tropp 2011 for the random range.
    response = as_array("response", response, ndim=1)
    tolerance = as_positive("tolerance", tolerance)
    if not response.size:
        raise InputError("`response` must hold at least one sample; got none")
    g = np.append(response[1:], 0.0)  # one sample more, so that the matrix is never empty
    rank = min(_FIRST_RANK, g.size)
    while True:
        values, V, rest = _leading(g, rank)
        least = _ROUNDING * g.size * _EPS * abs(values[0])
        tolerance = max(tolerance, least)
        if 2 * rest <= max(_SLACK * tolerance, least):
            break
        rank = 2 * rank if 4 * rank <= g.size else g.size
    bounds = _tail_bounds(np.abs(values), rest)
    order = int(np.argmax(bounds <= tolerance))  # the last bound, 2 rest, always meets it
    values, V = values[:order], V[:, :order]
    hankel = np.abs(values)
    root = np.sqrt(hankel)
    A = V[:-1].T @ V[1:] * root / root[:, None]
    B, C = np.sign(values) * root * V[:1], root * V[:1]
    return Truncation(A, B.T, C, response[:1, None], hankel, float(bounds[order]))


def _leading(g: NDArray[np.float64], rank: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Leading eigenvalues of the Hankel matrix, by falling modulus, their vectors, and twice the row norms of R."""
    n = g.size
    rows = np.lib.stride_tricks.sliding_window_view(np.append(g, np.zeros(n - 1)), n)
    if rank < n:
        triangle = np.append(g[-1], np.zeros(n - 1)), g[::-1]  # Toeplitz: the Hankel matrix, columns reversed
        Q = np.random.default_rng(0).standard_normal((n, rank))
        for _ in range(2):
            Q = np.linalg.qr(scipy.linalg.matmul_toeplitz(triangle, Q[::-1]))[0]
        HQ = scipy.linalg.matmul_toeplitz(triangle, Q[::-1])
        values, turn = np.linalg.eigh(Q.T @ HQ)
        parts = [slice(i, i + _ROWS) for i in range(0, n, _ROWS)]
        rest = 2 * float(sum(np.linalg.norm(rows[part] - HQ[part] @ Q.T, axis=1).sum() for part in parts))
        vectors = Q @ turn
    else:
        (values, vectors), rest = np.linalg.eigh(rows), 0.0
    first = np.argsort(-np.abs(values))
    return values[first], vectors[:, first], rest


def _tail_bounds(hankel: NDArray[np.float64], lost: float) -> NDArray[np.float64]:
    """Twice the sum of the truncated singular values, with what was lost before, for every order."""
    return 2 * (np.append(np.cumsum(hankel[::-1])[::-1], 0.0) + lost)


class BalancedContraction:
    """Balanced coordinates of (A, B, C, D), ||A|| < 1, by the square-root method: with P = sum A^k B B' A'^k = R R' and Q = sum
    A'^k C' C A^k = L L', L'R = U Σ V'.
    """

    # The factors come from doubling, [Z, A^(2^k) Z] compressed to its rank at every step, as in the squared Smith method with
    # low-rank factors: no Gramian is formed, so that the Hankel singular values keep the digits down to eps of the largest, and
    # the work does not depend on how long the response is.

    def __init__(self, A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64], D: NDArray[np.float64]):
        self._system = A, B, C, D
        self._balancing = balancing(_factor(A.T, C.T), _factor(A, B))
        self.hankel = self._balancing.hankel

    def truncate(self, tolerance: float) -> Truncation:
        """The smallest truncation whose error bound, twice the sum of the other singular values, meets a tolerance.

        Where rounding is larger, all states that stand out from it.
        """
        A, B, C, D = self._system
        rounding = 10 * A.shape[0] * _EPS * float(np.max(self.hankel, initial=0.0))
        bounds = _tail_bounds(self.hankel, rounding)
        order = min(int(np.sum(bounds > tolerance)), int(np.sum(self.hankel > rounding)))
        return Truncation(*self._balancing.truncated(A, B, C, order), D, self.hankel[:order], float(bounds[order]))


def _factor(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    """R with RR' = sum_k A^k BB' A'^k; its columns are what stands out from rounding."""
    R, power = B, A
    while True:
        moved = power @ R
        if not np.linalg.norm(moved) > _EPS * np.linalg.norm(R):
            return R
        U, size, _ = scipy.linalg.svd(np.hstack([R, moved]), full_matrices=False)
        kept = size > _EPS * size[0]
        R, power = U[:, kept] * size[kept], power @ power
