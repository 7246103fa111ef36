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
    """Values at exp(j*angle) of a one-channel discrete model, (F,): one Hessenberg form, one solve per frequency."""
    n = model.nstates
    if not n:
        return np.full(np.size(angles), complex(model.D[0, 0]))
    H, Q = scipy.linalg.hessenberg(model.A, calc_q=True)
    B, C, values = (Q.T @ model.B).astype(complex), model.C @ Q, np.empty(np.size(angles), complex)
    rows = max(1, _BLOCK // n**2)
    for first in range(0, values.size, rows):
        points = np.exp(1j * np.asarray(angles)[first : first + rows])
        left = points[:, None, None] * np.eye(n) - H
        state = np.linalg.solve(left, np.broadcast_to(B, (points.size, n, 1)))
        values[first : first + rows] = (C @ state)[:, 0, 0] + model.D[0, 0]
    return values


_BLOCK = 2**21  # complex numbers worked on at once: 32 MiB
