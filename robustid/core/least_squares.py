"""Nonlinear least squares: linear unknowns taken out by a projection, and damped steps of the others (Levenberg-Marquardt).

The projection is variable projection, `golub1973`; the damping for a radius of trust that of `more1978`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray

from robustid.core.state_space import Numbers, Real

_BISECTIONS = 40  # of the logarithm of a damping


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


def singular_parts(matrix: Real) -> tuple[Real, Real, Real]:
    """U, the singular values and V' of a matrix of finite entries, of the smaller size; by the QR iteration where the faster
    method does not converge.
    """
    try:
        left, sizes, directions = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        left, sizes, directions = scipy.linalg.svd(matrix, full_matrices=False, lapack_driver="gesvd")
    return left, sizes, directions


def decoupled_parts(matrix: Numbers) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Rows and columns of the parts of a matrix that have no row in common; a column of zeros has no rows."""
    rows, columns = np.nonzero(matrix)
    many, count = matrix.shape
    links = scipy.sparse.coo_array((np.ones(rows.size, bool), (rows, many + columns)), shape=(many + count,) * 2)
    numbers = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    order = np.argsort(numbers, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1)
    return [(one[one < many], one[one >= many] - many) for one in groups if one.size and one[-1] >= many]


def decoupled_qr(matrix: Real) -> tuple[Real, Real]:
    """Q and R of a tall matrix, part by part (`decoupled_parts`): where parts have no row in common Q has zeros, not rounding.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.core import decoupled_qr
    >>> Q, R = decoupled_qr(np.array([[3.0, 0.0], [0.0, 2.0], [4.0, 0.0]]))
    >>> np.abs(R), bool(np.all((Q == 0) == [[False, True], [True, False], [False, True]]))
    (array([[5., 0.],
           [0., 2.]]), True)
    """
    parts = decoupled_parts(matrix)
    if len(parts) < 2 or any(rows.size < columns.size for rows, columns in parts):
        basis, triangle = np.linalg.qr(matrix)
        return basis, triangle
    Q, R = np.zeros(matrix.shape), np.zeros((matrix.shape[1],) * 2)
    for rows, columns in parts:
        Q[np.ix_(rows, columns)], R[np.ix_(columns, columns)] = np.linalg.qr(matrix[np.ix_(rows, columns)])
    return Q, R


def decoupled_fit(matrix: Real, values: Real) -> Real:
    """The shortest c of the least ``|matrix c - values|``, part by part (`decoupled_parts`)."""
    found = np.zeros(matrix.shape[1])
    for rows, columns in decoupled_parts(matrix):
        found[columns] = np.linalg.lstsq(matrix[np.ix_(rows, columns)], values[rows], rcond=None)[0]
    return found


class DampedSteps(NamedTuple):
    """Steps d of the least ``|J d - r|^2 + damping |d|^2``, for every damping from one singular value decomposition of J."""

    sizes: Real  # (k,); singular values of J, falling
    along: Real  # (k,); components of r along the left singular vectors
    directions: Real  # (k, n); right singular vectors, as rows

    @classmethod
    def of(cls, J: Real, r: Real, seen: float = 0.0) -> DampedSteps:
        """The steps along directions of which J sees more than this part of what it sees of the first."""
        left, sizes, directions = singular_parts(J)
        if seen:
            kept = sizes > seen * sizes[:1]
            left, sizes, directions = left[:, kept], sizes[kept], directions[kept]
        return cls(sizes, left.T @ r, directions)

    def step(self, damping: float) -> Real:
        """The step of a damping."""
        return self.directions.T @ (self.sizes * self.along / (self.sizes**2 + damping))

    def within(self, radius: float) -> Real:
        """The step of the smallest damping that is no longer than a radius.

        Examples
        --------
        >>> import numpy as np
        >>> from robustid.core import DampedSteps
        >>> steps = DampedSteps.of(np.diag([2.0, 1.0]), np.array([2.0, 0.0]))
        >>> [float(np.linalg.norm(steps.within(radius)).round(9)) for radius in (3.0, 0.5)]
        [1.0, 0.5]
        """
        squares, pull = self.sizes**2, self.sizes * self.along

        def length(damping: float) -> float:
            step = pull / (squares + damping)
            return math.sqrt(step @ step)

        if length(0.0) <= radius:
            return self.step(0.0)
        low, high = 1e-30 * squares[0], math.sqrt(pull @ pull) / radius
        for _ in range(_BISECTIONS):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if length(middle) > radius else (low, middle)
        return self.step(high)


def real_rows(values: Numbers) -> Real:
    """Real parts over imaginary parts: the real inner product of complex columns."""
    return np.concatenate([np.real(values), np.imag(values)])
