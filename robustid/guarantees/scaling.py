r"""Diagonal scalings with which the small-gain condition says most about an uncertainty of known structure.

Cut :math:`\Delta` into blocks, one for each group of rows and of columns, with :math:`\bar\sigma(\Delta_{ij}) \le b_{ij}`. For
positive numbers :math:`\alpha_i, \beta_j`, one a group, :math:`I + \Delta M` is regular for all of them if

.. math:: \bar\sigma(\operatorname{diag}(\beta)\, M \operatorname{diag}(\alpha))\;
          \|\operatorname{diag}(\alpha)^{-1} [b_{ij}] \operatorname{diag}(\beta)^{-1}\|_2 < 1.

The smallest such number is that of the D-scaled bound of the structured singular value with a scaling d for every block: there the
two factors are :math:`\beta_j^2 = \sum_i d_{ij}^2 b_{ij}^2` and :math:`\alpha_i^2 = \sum_j d_{ij}^{-2}`; by Cauchy and Schwarz
the norm of the second matrix above is then at most one, while its singular vectors give such d for any :math:`\alpha, \beta`. So
a matrix of 2x2 takes two unknowns and not three, one of 4x4 six and not fifteen. Both factors are log-convex in the logarithms of
:math:`\alpha, \beta` (three-lines theorem), so that Newton's method finds the smallest product.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Real, norms

_FLOOR = 1e-9  # of the largest entry: channels that don't meet have scalings all the same
# The largest singular value is the limit of the norms of these powers, each of which is smooth; at the last one, 0.1 % is left.
_POWERS = (4, 16, 64, 256, 1024)
_STEPS = 5  # of Newton at each of them
_FARTHEST = 2.0  # of a step, in the logarithm of a scaling
_SHORTEST = 2.0**-6

Numbers = NDArray[np.complex128 | np.float64]


class Scaling(NamedTuple):
    """Logarithms of the factors of the columns (K, q) and of the rows (K, p) of the uncertainty, for K matrices."""

    columns: Real
    rows: Real

    def gain(self, values: Complex, bound: Real) -> tuple[Real, Real]:
        """Largest singular values of ``diag(beta) M diag(alpha)`` and of ``diag(1/alpha) [b] diag(1/beta)``, (K,)."""
        return norms(self.loop(values)), norms(self.uncertainty(bound))

    def loop(self, values: Complex | Real) -> Complex | Real:
        """``diag(beta) M diag(alpha)``, (K, nu, ny), of M or of radii around it."""
        # A group is a single signal, or all.
        columns, rows = (
            np.broadcast_to(part, (part.shape[0], size)) for part, size in zip(self, values.shape[1:], strict=True)
        )
        return np.exp(columns)[:, :, None] * values * np.exp(rows)[:, None, :]

    def uncertainty(self, bound: Real) -> Real:
        """``diag(1/alpha) [b] diag(1/beta)``, (K, p, q)."""
        return np.exp(-self.rows)[:, :, None] * bound * np.exp(-self.columns)[:, None, :]


def perron_scaling(values: Complex, bound: Real) -> Scaling:
    """The scaling that is best where all entries of M are non-negative: there the product is the spectral radius of ``[b] |M|``.

    `values` (K, nu, ny) are M; `bound` is (K, p, q), p = ny or 1, q = nu or 1.
    """
    k, p, q = bound.shape
    found, known = Scaling(np.zeros((k, q)), np.zeros((k, p))), _seen(values, bound)
    if (p > 1 or q > 1) and known.any():
        found.columns[known], found.rows[known] = _perron(values[known], bound[known])
    return found


def _seen(values: Complex, bound: Real) -> NDArray[np.bool_]:
    """True where neither the loop nor the bound is zero, (K,): no scaling makes nothing smaller."""
    return np.any(values, axis=(1, 2)) & np.any(bound, axis=(1, 2))


def _perron(values: Complex, bound: Real) -> Scaling:
    _, p, q = bound.shape
    sizes = np.abs(values)
    if p == 1:
        sizes = np.linalg.norm(sizes, axis=2, keepdims=True)
    if q == 1:
        sizes = np.linalg.norm(sizes, axis=1, keepdims=True)
    sizes = sizes + _FLOOR * sizes.max(axis=(1, 2), keepdims=True) + np.finfo(float).tiny
    right = _leading(bound @ sizes)
    left = _leading(np.swapaxes(bound @ sizes, 1, 2))
    through = np.einsum("kji,ki->kj", sizes, right), np.einsum("kij,ki->kj", bound, left)
    return Scaling(np.log(through[1] / through[0]) / 2, np.log(right / left) / 2)


def _leading(matrices: Real) -> Real:
    """Perron vectors of positive matrices, (K, n)."""
    values, vectors = np.linalg.eig(matrices)
    leading = np.take_along_axis(vectors, np.argmax(np.real(values), axis=1)[:, None, None], axis=2)[..., 0]
    return np.abs(leading) + _FLOOR * np.abs(leading).max(axis=1, keepdims=True)


def best_scaling(values: Complex, bound: Real) -> Scaling:
    """The scaling of the smallest product: from `perron_scaling`, which takes the same, by Newton steps.

    Whatever it is, the product proves its bound; how near to the smallest it comes decides only how sharp that is.
    """
    start, known = perron_scaling(values, bound), _seen(values, bound)
    if bound[0].size > 1 and known.any():
        improved = _improved(values[known], bound[known], Scaling(start.columns[known], start.rows[known]))
        start.columns[known], start.rows[known] = improved
    return start


def _improved(values: Complex, bound: Real, start: Scaling) -> Scaling:
    _, p, q = bound.shape
    # In units in which the start is 1 and both norms are 1.
    loop, size = start.loop(values), start.uncertainty(bound)
    loop = loop / np.maximum(norms(loop), np.finfo(float).tiny)[:, None, None]
    size = size / norms(size)[:, None, None]
    spread = scipy.linalg.block_diag(_groups(values.shape[1], q), _groups(values.shape[2], p))
    product = _Product(loop, size, spread)
    y = np.zeros((values.shape[0], q + p))
    for power in _POWERS:
        moving = np.ones(y.shape[0], dtype=bool)
        for _ in range(_STEPS):
            step = product.of(moving).step(y[moving], power)
            y[moving] += step
            moving[moving] = np.max(np.abs(step), axis=1) > 0.01 / power
            if not moving.any():
                break
    return Scaling(start.columns + y[:, :q], start.rows + y[:, q:])


def _groups(size: int, count: int) -> Real:
    """The signals (rows) of every group (columns): a group is a single signal, or all."""
    return np.eye(size) if count == size else np.ones((size, 1))


def _dilated(matrices: Numbers) -> Numbers:
    """``[[0, M], [M*, 0]]``, whose eigenvalues are the singular values of M and their negatives."""
    k, m, n = matrices.shape
    whole = np.zeros((k, m + n, m + n), dtype=matrices.dtype)
    whole[:, :m, m:] = matrices
    whole[:, m:, :m] = np.conj(np.swapaxes(matrices, 1, 2))
    return whole


class _Product(NamedTuple):
    """Logarithm of the product of both norms in the logarithms y of the scalings of the groups, (K, q + p).

    `loop` (K, nu, ny) and `size` (K, p, q) are scaled; `spread` takes groups to signals.
    """

    loop: Complex | Real
    size: Real
    spread: Real

    def of(self, which: NDArray[np.bool_]) -> _Product:
        """The same of some of the matrices."""
        return _Product(self.loop[which], self.size[which], self.spread)

    def scaled(self, y: Real) -> tuple[Complex | Real, Real]:
        """Both matrices with scalings."""
        q = self.size.shape[2]
        scaling = Scaling(y[:, :q], y[:, q:])
        return scaling.loop(self.loop), scaling.uncertainty(self.size)

    def values(self, y: Real, power: int) -> Real:
        """Smoothed by a power, (K,)."""
        sizes = (np.linalg.svd(each, compute_uv=False) for each in self.scaled(y))
        return sum((_log_sum(np.asarray(each, dtype=float), power)[0] for each in sizes), start=np.zeros(y.shape[0]))

    def step(self, y: Real, power: int) -> Real:
        """A step of Newton, halved until it no longer ascends."""
        loop, size = self.scaled(y)
        slope, curve = _log_norm(_dilated(loop), power)
        other_slope, other_curve = _log_norm(_dilated(np.swapaxes(size, 1, 2)), power)
        value, slope = self.values(y, power), slope @ self.spread - other_slope
        curve = self.spread.T @ curve @ self.spread + other_curve
        ridge = 1e-9 * np.trace(curve, axis1=1, axis2=2) + 1e-12
        curve = curve + ridge[:, None, None] * np.eye(y.shape[1])
        step = np.asarray(np.linalg.solve(curve, -slope[..., None]), dtype=float)[..., 0]
        length = np.minimum(1.0, _FARTHEST / np.maximum(np.abs(step).max(axis=1), np.finfo(float).tiny))
        shortest, open_ = _SHORTEST * length, np.ones(y.shape[0], dtype=bool)
        while open_.any():
            tried = y[open_] + length[open_, None] * step[open_]
            open_[open_] = self.of(open_).values(tried, power) > value[open_]
            length[open_] = np.where(length[open_] > shortest[open_], length[open_] / 2, 0.0)
            open_ &= length > 0
        return length[:, None] * step


def _log_sum(sizes: Real, power: int) -> tuple[Real, Real]:
    """``log(sum |lambda|^p)/p`` of sizes (K, n), and the parts of the sum."""
    top = np.maximum(sizes.max(axis=1, keepdims=True), np.finfo(float).tiny)
    parts = (sizes / top) ** power
    total = parts.sum(axis=1, keepdims=True)
    return (np.log(top) + np.log(total) / power)[:, 0], parts / total


def _log_norm(matrices: Numbers, power: int) -> tuple[Real, Real]:
    """Gradient and Hessian at x = 0 of ``log tr|e^X H e^X|^p / p``, ``X = diag(x)``.

    First order: ``2 sum_k w_k |q_k|^2`` with the eigenvectors q_k and ``w_k = |lambda_k|^p / tr``. Second order: divided
    differences of ``|lambda|^p`` between all pairs of eigenvalues.
    """
    eigenvalues, vectors = np.linalg.eigh(matrices)
    weights = _log_sum(np.abs(eigenvalues), power)[1]
    slope = 2 * np.einsum("kl,kil->ki", weights, np.abs(vectors) ** 2)
    a, b, low, high = eigenvalues[:, :, None], eigenvalues[:, None, :], weights[:, :, None], weights[:, None, :]
    apart = np.abs(a - b) > 1e-7 * np.abs(eigenvalues).max(axis=1)[:, None, None]
    quotients = np.where(apart, (a + b) * (low - high) / np.where(apart, a - b, 1.0), power * (low + high))
    k, n = eigenvalues.shape
    pairs = (np.conj(vectors)[:, :, None, :] * vectors[:, None, :, :]).reshape(k, n * n, n)
    curve = 2 * np.real(np.sum((pairs @ quotients) * np.conj(pairs), axis=2)).reshape(k, n, n)
    return slope, curve - power * slope[:, :, None] * slope[:, None, :]
