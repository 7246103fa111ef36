"""The numbers that every solver gets, and what it must return."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen
from robustid.interpolation import Rows, SarasonMap


@dataclasses.dataclass(frozen=True, eq=False)
class ConvexData(Frozen):
    """Samples and contraction of one problem: |y - E x - P p|_k <= s, -I <= H(x) <= I.

    The parameters enter as q = R p with orthonormal columns Q = P R^{-1}, so that free parameters cost no conditioning.
    """

    rows: Rows
    sarason: SarasonMap

    @functools.cached_property
    def stacked(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Real (y, E, Q, R): real parts of all samples, then imaginary parts of the discs."""
        y, E, P = self.rows.real
        Q, R = np.linalg.qr(P) if P.shape[1] else (P, np.zeros((0, 0)))
        return y, E, Q, R

    def scaled_parameters(self, q: np.ndarray) -> np.ndarray:
        """The p with R p = q."""
        R = self.stacked[3]
        return scipy.linalg.solve_triangular(R, q) if q.size else q

    def orthonormal_parameters(self, p: np.ndarray) -> np.ndarray:
        """The q = R p."""
        return self.stacked[3] @ p

    def margin(self, x: np.ndarray, p: np.ndarray) -> float:
        """Largest |residual|/bound, evaluated from the numbers."""
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
