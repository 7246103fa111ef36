"""Least squares: linear unknowns taken out by a projection (variable projection, `golub1973`), and lengths to divide by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core.state_space import Real


class Projection(NamedTuple):
    """The best ``values ~ columns c`` in least squares: ``columns = basis triangle``, ``along = basis' values``."""

    basis: Real
    triangle: Real
    along: Real
    residual: Real

    @property
    def coefficients(self) -> Real:
        """The c; the shortest one where columns depend on each other."""
        return np.asarray(np.linalg.lstsq(self.triangle, self.along, rcond=None)[0], dtype=float)

    def tangent(self, changes: Real) -> Real:
        """Derivatives of `residual` where ``columns c`` changes so at this c, up to terms of the size of the residual (Kaufman)."""
        return self.basis @ (self.basis.T @ changes) - changes


def projected(columns: Real, values: Real) -> Projection:
    """Return the projection of real values on real columns.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.core import projected
    >>> found = projected(np.array([[1.0], [1.0]]), np.array([1.0, 3.0]))
    >>> found.coefficients, found.residual
    (array([2.]), array([-1.,  1.]))
    """
    basis, triangle = np.linalg.qr(columns)
    along = basis.T @ values
    return Projection(basis, triangle, along, values - basis @ along)


def lengths(matrix: NDArray[np.inexact], axis: int = 0, *, keepdims: bool = False) -> Real:
    """Euclidean norms of the columns (axis 0) or rows (axis 1), 1 where all entries are zero: what they can be divided by."""
    size: Real = np.linalg.norm(matrix, axis=axis, keepdims=keepdims)
    size[size == 0] = 1.0
    return size
