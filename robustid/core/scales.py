"""Lengths of rows and columns, to divide by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core.state_space import Real


def lengths(matrix: NDArray[np.inexact], axis: int = 0, *, keepdims: bool = False) -> Real:
    """Euclidean norms of the columns (axis 0) or rows (axis 1), 1 where all entries are zero: what they can be divided by."""
    size: Real = np.linalg.norm(matrix, axis=axis, keepdims=keepdims)
    size[size == 0] = 1.0
    return size
