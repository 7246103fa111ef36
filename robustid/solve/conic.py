"""The numbers that every solver gets, and what it must return."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen
from robustid.interpolation import Rows, SarasonMap, SectionMap


@dataclasses.dataclass(frozen=True, eq=False)
class ConvexData(Frozen):
    """Samples and contraction of one problem: |y - E x - P p|_k <= s, -I <= H(x) <= I.

    The parameters enter as q = R p with orthonormal columns Q = P R^{-1}, so that free parameters cost no conditioning.
    """

    rows: Rows
    sarason: SarasonMap

    @functools.cached_property
    def orthonormal(self) -> tuple[np.ndarray, np.ndarray]:
        """Q (N, m) complex, orthonormal as stacked real columns, and R."""
        P, discs = self.rows.P, self.rows.discs
        if not P.shape[1]:
            return P, np.zeros((0, 0))
        Q, R = np.linalg.qr(self.rows.real(P))
        out = Q[: P.shape[0]].astype(complex)
        out[:discs] += 1j * Q[P.shape[0] :]
        return out, R

    @functools.cached_property
    def axes(self) -> np.ndarray | None:
        """Orthogonal V of a repeated section: in the coordinates y of x = V y the columns E V are orthogonal and fall in size.

        Newton matrices then are graded, so that a diagonal scaling saves the digits of what the samples hardly see: a proof for
        456 coefficients and 1000 lines comes out a thousand times sharper. None where the basis is graded (the shift) or small.
        """
        if not isinstance(self.sarason, SectionMap):
            return None
        R = np.linalg.qr(self.rows.real(self.rows.E.dense()), mode="r")
        return np.linalg.svd(R)[2].T

    def scaled_parameters(self, q: np.ndarray) -> np.ndarray:
        """The p with R p = q."""
        return scipy.linalg.solve_triangular(self.orthonormal[1], q) if q.size else q

    def orthonormal_parameters(self, p: np.ndarray) -> np.ndarray:
        """The q = R p."""
        return self.orthonormal[1] @ p

    def margin(self, x: np.ndarray, p: np.ndarray) -> float:
        """Largest (|residual| + tail)/bound, evaluated from the numbers: some system with these coefficients keeps it."""
        return float(self.rows.ratio(x, p).max())


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """What a solver returned, unverified.

    Attributes
    ----------
    x : (n,) array
        Coefficients of the non-parametric part.
    p : (m,) array
        Scaled parameters.
    samples : (N,) complex array
        Multipliers of the samples.
    ball : (n, n) array
        Multiplier of the contraction X.
    solver : str
    """

    x: np.ndarray
    p: np.ndarray
    samples: np.ndarray
    ball: np.ndarray
    solver: str
