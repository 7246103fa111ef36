"""Separable least squares: the unknowns that enter linearly taken out by a projection (variable projection, `golub1973`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
