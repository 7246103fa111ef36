"""Responses of models in time and frequency."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.interpolation import transfer


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
