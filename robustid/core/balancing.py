"""The square-root method of balanced truncation, from factors of both Gramians."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core.state_space import Real


class Balancing(NamedTuple):
    r"""Balanced coordinates of a stable state space, by the singular values of the product of two factors.

    .. math:: W_o = L L^T, \quad W_c = R R^T, \quad L^T R = U \Sigma V^T

    No Gramian is formed, so that Hankel singular values keep their digits down to eps of the largest. Any factors do, of any
    number of columns: `robustid.reduction` has those of the Lyapunov and Stein equations, `robustid.identification` those that
    doubling gives for contractions.

    Notes
    -----
    Source: the square-root method of Tombs and Postlethwaite 1987.

    Examples
    --------
    >>> both = balancing(np.array([[2.0]]), np.array([[3.0]]))
    >>> both.hankel, [part.round(12) for part in both.truncated(-np.eye(1), np.eye(1), np.eye(1), 1)]
    (array([6.]), [array([[-1.]]), array([[0.81649658]]), array([[1.22474487]])])
    """

    left: Real  # left, right: (n, k), (n, m); L and R
    right: Real
    U: Real  # U, hankel, Vt: (k, r), (r,), (r, m); r the smaller of k and m; `hankel` descending
    hankel: Real
    Vt: Real

    def coordinates(self, order: int) -> tuple[Real, Real]:
        """``L U`` and ``R V``, (n, order) each: ``(L U)^T (R V)`` is the diagonal matrix of the Hankel singular values."""
        return self.left @ self.U[:, :order], self.right @ self.Vt[:order].T

    def projections(self, order: int) -> tuple[Real, Real]:
        """The map (n, order) from the states that are kept, and the map (order, n) onto them."""
        root = np.sqrt(self.hankel[:order])
        observed, reached = self.coordinates(order)
        return reached / root, (observed / root).T

    def truncated(self, A: Real, B: Real, C: Real, order: int) -> tuple[Real, Real, Real]:
        """A, B and C of the leading part of the balanced realisation."""
        into, onto = self.projections(order)
        return onto @ A @ into, onto @ B, C @ into


def balancing(left: Real, right: Real) -> Balancing:
    """Balanced coordinates from factors of the observability and of the controllability Gramian."""
    U, hankel, Vt = scipy.linalg.svd(left.T @ right, full_matrices=False)
    return Balancing(left, right, U, hankel, Vt)
