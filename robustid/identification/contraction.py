"""Balanced truncation of a realisation whose A is a contraction, once for every tolerance."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from robustid.identification.hankel import ImpulseReduction

_EPS = float(np.finfo(float).eps)


class BalancedContraction:
    r"""Balanced coordinates of (A, B, C, D), ||A|| < 1, by the square-root method.

    .. math:: P = \sum_k A^k B B' A'^k = R R', \quad Q = \sum_k A'^k C' C A^k = L L', \quad L'R = U \Sigma V'

    The factors come from doubling, [Z, A^(2^k) Z] compressed to its rank at every step: no Gramian is formed, so that the Hankel
    singular values keep the digits down to eps of the largest, and the work does not depend on how long the response is.

    Notes
    -----
    Source: the square-root method of balanced truncation; doubling as in the squared Smith method with low-rank factors.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.identification.contraction import BalancedContraction
    >>> half, none = np.array([[0.5]]), np.zeros((1, 1))
    >>> BalancedContraction(half, half, half, none).truncate(1e-9).hankel.round(12)  # 0.25 / (1 - 0.5^2)
    array([0.33333333])
    """

    def __init__(self, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray):
        self._system = A, B, C, D
        self._right, self._left = _factor(A, B), _factor(A.T, C.T)
        self._U, self.hankel, self._V = scipy.linalg.svd(self._left.T @ self._right, full_matrices=False)

    def truncate(self, tolerance: float) -> ImpulseReduction:
        """The smallest truncation whose error bound, twice the sum of the other singular values, meets a tolerance.

        Where rounding is larger, all states that stand out from it.
        """
        A, B, C, D = self._system
        rounding = 10 * A.shape[0] * _EPS * float(np.max(self.hankel, initial=0.0))
        bounds = 2 * (np.append(np.cumsum(self.hankel[::-1])[::-1], 0.0) + rounding)
        order = min(int(np.sum(bounds > tolerance)), int(np.sum(self.hankel > rounding)))
        root = np.sqrt(self.hankel[:order])
        into, onto = self._right @ self._V[:order].T / root, (self._left @ self._U[:, :order] / root).T
        return ImpulseReduction(onto @ A @ into, onto @ B, C @ into, D, self.hankel[:order], float(bounds[order]))


def _factor(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """R with RR' = sum_k A^k BB' A'^k; its columns are what stands out from rounding."""
    R, power = B, A
    while True:
        moved = power @ R
        if not np.linalg.norm(moved) > _EPS * np.linalg.norm(R):
            return R
        U, size, _ = scipy.linalg.svd(np.hstack([R, moved]), full_matrices=False)
        kept = size > _EPS * size[0]
        R, power = U[:, kept] * size[kept], power @ power
