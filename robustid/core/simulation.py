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


def responses(model: Any, angles: np.ndarray) -> np.ndarray:
    """Values at exp(j*angle) of a discrete model, (F, ny, nu)."""
    return transfer((model.A, model.B, model.C, model.D), np.exp(-1j * np.asarray(angles)))


def response(model: Any, angles: np.ndarray) -> np.ndarray:
    """Values at exp(j*angle) of a one-channel discrete model, (F,)."""
    return responses(model, angles)[:, 0, 0]


def transfer(system: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], zeta: np.ndarray) -> np.ndarray:
    """D + zeta C (I - zeta A)^{-1} B at points, (F, p, q): one Schur form, one substitution for all points of a block."""
    A, B, C, D = system
    n, q = B.shape
    values = np.repeat(np.asarray(D, dtype=complex)[None], zeta.size, axis=0)
    if not n:
        return values
    T, Q = scipy.linalg.schur(A, output="complex")[:2]
    right, left = Q.conj().T @ B, C @ Q
    block = max(1, _BLOCK // q)
    for first in range(0, zeta.size, block):
        points = np.asarray(zeta[first : first + block], dtype=complex)[:, None]
        x = np.empty((n, points.size * q), complex)
        for row in range(n - 1, -1, -1):  # (I - zeta T) x = right, from the last row up
            rest = (T[row, row + 1 :] @ x[row + 1 :]).reshape(points.size, q)
            x[row] = ((right[row] + points * rest) / (1 - points * T[row, row])).ravel()
        outputs = (left @ x).reshape(-1, points.size, q)
        values[first : first + block] += points[..., None] * outputs.transpose(1, 0, 2)
    return values


_BLOCK = 1024  # columns worked on at once: they stay in the cache
