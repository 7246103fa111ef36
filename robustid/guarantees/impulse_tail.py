"""What impulse responses add up to after a horizon: bounds from the state space."""

from __future__ import annotations

import numpy as np

_BLOCKS = 60  # of at least half the size of the one before: the rest after them is below rounding
_LONGEST = 2**17  # samples in which a state must halve; slower ones are as good as undamped
_ALLOWED = 1e-9  # for the rounding of the powers


def tail_bounds(A: np.ndarray, B: np.ndarray, C: np.ndarray, start: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum and maximum of |C A^(k-1) B| over k >= start (start >= 1), for every row of C; inf where the states do not decay.

    Blocks of N samples, ||A^N|| <= 1/2, are summed as they are; what follows the last one, with the state x, is at most
    sum_(j<N) ||C A^j|| ||x|| (1 + 1/2 + 1/4 + ...).
    """
    count, n = C.shape
    if not n or not count:
        return np.zeros(count), np.zeros(count)
    rows, power = C[None], A
    while np.linalg.norm(power, 2) > 0.5:
        if rows.shape[0] >= _LONGEST:
            return np.full(count, np.inf), np.full(count, np.inf)
        rows, power = np.concatenate([rows, rows @ power]), power @ power
    x = np.linalg.matrix_power(A, start - 1) @ B[:, 0]
    total, largest = np.zeros(count), np.zeros(count)
    for _ in range(_BLOCKS):
        block = np.abs(rows @ x)
        total, largest = total + block.sum(axis=0), np.maximum(largest, block.max(axis=0))
        x = power @ x
    sizes = np.linalg.norm(rows, axis=2)
    rest = float(np.linalg.norm(x))
    spread = float(np.linalg.norm(B)) * sizes
    total = total + 2 * rest * sizes.sum(axis=0) + _ALLOWED * spread.sum(axis=0)
    return total, np.maximum(largest, rest * sizes.max(axis=0)) + _ALLOWED * spread.max(axis=0)
