r"""Values of a model on whole arcs of the circle: a centre and a radius for every piece.

With :math:`R = (z_0 I - A)^{-1}` and :math:`|z - z_0| \le h < 1/\|R\|`, the resolvent's series gives

.. math:: |F(z) - F(z_0)|_{ij} \le \frac{h\,\|C_i R\|\,\|R B_j\|}{1 - h \|R\|}.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from robustid.reduction import scaled

_EPS = np.finfo(float).eps
_BLOCK = 2_000_000  # entries of all resolvents at once
_FAR = 1e100  # where the series diverges: larger than any gain, and finite, so that a channel that is zero stays so
_DEPTH = 34  # halvings of a cell: what is left then is rounding


class Pieces(NamedTuple):
    """Every piece of arc: its cell, its middle (rad), values (M, ny, nu) there and radii (M, ny, nu) that hold on all of it."""

    cell: np.ndarray
    middle: np.ndarray
    values: np.ndarray
    radius: np.ndarray


def enclose(model: Any, angles: np.ndarray, coarse: Callable[[Pieces], np.ndarray]) -> Pieces:
    """Enclose a model on the cells between `angles`, halved for as long as `coarse` says so of a piece.

    Radii include an allowance for the rounding of the solution of linear systems, to first order.
    """
    matrices = (*scaled(model.A, model.B, model.C), np.asarray(model.D))
    cell, low, high = np.arange(angles.size - 1), angles[:-1], angles[1:]
    done = []
    for depth in range(_DEPTH):
        pieces = Pieces(cell, (low + high) / 2, *_on_arcs(matrices, low, high))
        split = coarse(pieces) if depth < _DEPTH - 1 else np.zeros(cell.size, dtype=bool)
        done.append(Pieces(*(part[~split] for part in pieces)))
        if not split.any():
            break
        cell, low, middle, high = cell[split], low[split], pieces.middle[split], high[split]
        cell, low, high = np.tile(cell, 2), np.concatenate([low, middle]), np.concatenate([middle, high])
    return Pieces(*(np.concatenate(parts) for parts in zip(*done, strict=True)))


def _on_arcs(matrices: tuple, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    A, B, C, D = matrices
    n, pieces = A.shape[0], low.size
    values = np.tile(D.astype(complex), (pieces, 1, 1))
    radius = np.zeros(values.shape)
    if not n:
        return values, radius
    size = np.linalg.norm(A, 2) + 1
    step = max(1, _BLOCK // n**2)
    for first in range(0, pieces, step):
        part = slice(first, first + step)
        points = np.exp(0.5j * (low[part] + high[part]))
        resolvent = np.linalg.inv(points[:, None, None] * np.eye(n) - A)
        left, right = C @ resolvent, resolvent @ B
        sizes = np.abs(resolvent)
        norm = np.sqrt(sizes.sum(axis=1).max(axis=1) * sizes.sum(axis=2).max(axis=1))
        half = (high[part] - low[part]) / 2
        room = 1 - half * norm
        rows, columns = np.linalg.norm(left, axis=2), np.linalg.norm(right, axis=1)
        reach = np.where(room > 0, half / np.maximum(room, _EPS), _FAR) + 10 * n * _EPS * size
        values[part] += left @ B
        radius[part] = reach[:, None, None] * (rows[:, :, None] * columns[:, None, :])
    return values, radius + 8 * _EPS * np.abs(values)
