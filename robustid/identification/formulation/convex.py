"""The finite convex problem that every solver gets, and what it must return."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Array, Frozen, Numbers, decoupled_fit, decoupled_qr
from robustid.identification.formulation.ball import Axes
from robustid.identification.formulation.rows import Rows
from robustid.identification.formulation.sarason import SarasonMap

LEAST_SQUARES = "least squares"  # solver of a point without G: of the parameters alone


@dataclasses.dataclass(frozen=True, eq=False)
class ConvexData(Frozen):
    """Samples and contraction of one problem: |y - E x - P p|_k <= s, ||X(x)|| <= 1, p in its intervals."""

    # The parameters enter as q = R (p - `origin`), with orthonormal columns Q of P R^{-1} and of the intervals' rows, so that
    # free parameters and narrow intervals cost no conditioning; p that are fixed are left out of q.

    rows: Rows
    sarason: SarasonMap

    @functools.cached_property
    def origin(self) -> NDArray[np.float64]:
        """Point from which p is counted, (m,): 0 for free ones, else the value inside the interval that suits least squares.

        Not the middle: an interval far wider than what the data leave would cost digits.
        """
        rows, held = self.rows, self.rows.held
        out = np.zeros(held.size)
        if held.any():
            low, high = rows.ends[held].T
            fit = decoupled_fit(rows.real(rows.P), rows.real(rows.y))[held]
            out[held] = np.clip(fit, low + (high - low) / 10, high - (high - low) / 10)
        return out

    @functools.cached_property
    def least_squares(self) -> NDArray[np.float64]:
        """The parameters that suit the samples best without G, (m,): free ones; the others as in `origin`."""
        p, free = self.origin.copy(), ~self.rows.held
        p[free] = decoupled_fit(self.rows.real(self.rows.P[:, free]), self.rows.real(self.y))
        return p

    @property
    def y(self) -> Numbers:
        """Samples minus what p = `origin` explains, (N,)."""
        return self.rows.y - self.rows.P @ self.origin

    @property
    def orthonormal(self) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Q (N, m) complex and R; with the columns of `intervals` below, Q is orthonormal as stacked real columns."""
        Q, R, _ = self._factors
        return Q, R

    @property
    def intervals(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The intervals |a - B q| <= 1 of the parameters that are neither free nor fixed: a (K,) and B (K, m)."""
        low, high = self.rows.ends[self.rows.held & self._loose].T
        return (low + high - 2 * self.origin[self.rows.held & self._loose]) / (high - low), self._factors[2]

    @functools.cached_property
    def _loose(self) -> NDArray[np.bool_]:
        """Mask of the parameters that are not fixed, (m,)."""
        return self.rows.ends[:, 0] < self.rows.ends[:, 1]

    @functools.cached_property
    def _factors(self) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
        rows, discs, count = self.rows, self.rows.discs, self.rows.y.size
        P, (low, high) = rows.P[:, self._loose], rows.ends[self._loose].T
        held = np.isfinite(low)
        stacked = np.vstack([rows.real(P), (np.eye(P.shape[1]) * (2 / (high - low)))[held]])
        Q, R = decoupled_qr(stacked)
        out = Q[:count].astype(complex)
        out[:discs] += 1j * Q[count : count + discs]
        return out, R, Q[count + discs :]

    @functools.cached_property
    def axes(self) -> Axes | None:
        """Orthogonal V for a basis that is not graded: with x = V y the columns E V of y are orthogonal and fall in size.

        None where it is graded (the shift) or small. Entries that share no sample have each their own: E V is as sparse as E.
        """
        # Newton matrices then are graded, so that a diagonal scaling saves the digits of what the samples hardly see: a proof
        # for 456 coefficients and 1000 frequency points comes out a thousand times sharper.
        if self.sarason.graded:
            return None
        apart = self.rows.E.apart()
        real = [self.rows.real(apart[0])] if len(apart) == 1 else [np.vstack([one.real, one.imag]) for one in apart]
        return Axes(np.array([np.linalg.svd(np.linalg.qr(one, mode="r"))[2].T for one in real]))

    def scaled_parameters(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """The p of q; those that rounding has put outside of their interval are put back."""
        p = self.origin.copy()
        if q.size:
            p[self._loose] += _triangular(self.orthonormal[1], q, transposed=False)
        return np.clip(p, *self.rows.ends.T)

    def orthonormal_parameters(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """The q = R (p - origin)."""
        return self.orthonormal[1] @ (p - self.origin)[self._loose]

    def margin(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> float:
        """Largest (|residual| + tail)/bound, evaluated from the numbers: some system with these coefficients keeps it.

        Infinite where a parameter is outside its interval.
        """
        return float(self.rows.ratio(x, p).max(initial=0.0)) if self.rows.within(p) else np.inf

    def direction(self, along: NDArray[np.float64]) -> NDArray[np.float64]:
        """The w with w'q = along'(p - origin)."""
        R = self.orthonormal[1]
        return _triangular(R, along[self._loose], transposed=True) if R.size else np.zeros(0)


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """Numbers that a solver returned, unverified."""

    x: NDArray[np.float64]  # (n,), coefficients of the non-parametric part, all entries
    p: NDArray[np.float64]  # (m,), scaled parameters
    samples: Array  # (N,), multipliers of the samples
    ball: NDArray[np.float64]  # (np, nq), multiplier of the contraction X
    solver: str


def _triangular(R: NDArray[np.float64], right: NDArray[np.float64], transposed: bool) -> NDArray[np.float64]:
    """R^-1 right, or R'^-1 right, of an upper R: by LAPACK directly, for every point on a path."""
    found, singular = scipy.linalg.lapack.dtrtrs(R.T, right, lower=1, trans=int(not transposed))
    if singular:
        raise np.linalg.LinAlgError("a triangle with a zero on its diagonal")
    return found
