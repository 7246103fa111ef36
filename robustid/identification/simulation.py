"""Responses of models in time and frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg


def simulate(model: Any, u: np.ndarray, start: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Output (T, ny) of a discrete model driven by u (T, nu) from the state `start` (at rest), and the state after it."""
    a, drive = model.A, u @ model.B.T
    states = np.empty((u.shape[0], model.nstates))
    state = np.zeros(model.nstates) if start is None else start
    with np.errstate(over="ignore", invalid="ignore"):
        for k, push in enumerate(drive):
            states[k] = state
            state = a @ state + push
        return states @ model.C.T + u @ model.D.T, state


def response(model: Any, angles: np.ndarray) -> np.ndarray:
    """Values at exp(j*angle) of a one-channel discrete model, (F,): one Schur form, one substitution per frequency."""
    n = model.nstates
    values = np.full(np.size(angles), complex(model.D[0, 0]))
    if not n:
        return values
    T, Q = scipy.linalg.schur(model.A, output="complex")[:2]
    right, left = Q.conj().T @ model.B[:, 0], model.C[0] @ Q
    for first in range(0, values.size, _BLOCK):
        points = np.exp(1j * np.asarray(angles)[first : first + _BLOCK])
        # (zI - T) x = right, from the last row up, for all points of the block together.
        x = np.empty((n, points.size), complex)
        for row in range(n - 1, -1, -1):
            x[row] = (right[row] + T[row, row + 1 :] @ x[row + 1 :]) / (points - T[row, row])
        values[first : first + _BLOCK] += left @ x
    return values


_BLOCK = 1024  # points worked on at once: their states stay in the cache
