"""Passive models beside fits that are almost passive: the nearest C and D by cutting planes, to rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.optimize

from robustid.core import Complex, Real, StateMatrices, input_states
from robustid.reduction.passivity_search import Popov

_STRICT = 3e-11  # relative distance from the limit
_SMALL = 1e-2  # relative violation up to which cuts are tried: beyond, a semidefinite program does better
_ROUNDS = 40
_NEAR = 3.0  # violations below the limit: cuts there too, so that few rounds are needed
_BEYOND = 1e3  # times the highest frequency, on the way to infinity
_GRID = 400


def cut(model: Any, kind: str, omega: Real, triangles: list[Real], into: tuple[Real, Real]) -> StateMatrices | None:
    """A, B, C and D with the least squares of C and D that keep a passive model, in the time units of `into`; None where far.

    ``Re u'S v <= 1`` for all unit vectors u and v, at every frequency, infinity included ("positive real": ``Re u'S u >= 0``), is
    linear in C and D. Cuts at the singular vectors of what violates it most are added until nothing does: the nearest passive
    model, whose violation a semidefinite program could not resolve.

    Parameters
    ----------
    model : control.StateSpace
    kind : str
    omega : (F,) array, rad/s
    triangles : list of (n + m, n + m + 1) arrays
        [R, r] of every row of [C, D]: its squares are ``|R g - r|^2``.
    into : (A, B)
        Of the model, in units of its `Popov`.
    """
    A, B = into
    popov = Popov(kind, StateMatrices.of(model))
    violation = popov.peak()[0] - popov.limit
    n, m = B.shape
    if not 0 < violation <= _SMALL * popov.size or any(len(t) < n + m for t in triangles):
        return None
    grid = _grid(omega, popov.marks)
    states = input_states(A, B, 1j * grid[:-1] / popov.unit)
    basis = np.zeros((grid.size, n + m, m), dtype=complex)
    basis[:-1, :n], basis[:, n:] = states, np.eye(m)
    inverses = [np.linalg.inv(t[: n + m, :-1]) for t in triangles]
    free: Real = np.stack([inverse @ t[: n + m, -1] for inverse, t in zip(inverses, triangles, strict=True)])
    limit = (1 - _STRICT) * popov.limit if popov.bounded else -_STRICT * popov.size
    rows: list[Real] = []
    room: list[float] = []
    gains = free
    for _ in range(_ROUNDS):
        excess, left, right = _worst(np.asarray(gains @ basis, dtype=complex), popov.bounded)
        over = float(excess.max()) - limit
        if over <= 0.3 * _STRICT * popov.size:
            return StateMatrices(A, B, gains[:, :n], gains[:, n:])
        for k in np.flatnonzero(excess > limit - _NEAR * over):
            # Re(left' gains basis right) as a row over all gains.
            part = np.real(np.outer(left[k].conj(), basis[k] @ right[k]))
            rows.append(np.concatenate([part[i] @ inverses[i] for i in range(m)]))
            room.append(limit - float(np.sum(part * free)))
        change = _least(np.array(rows), np.array(room))
        if change is None:
            return None
        gains = free + np.stack([inverses[i] @ part for i, part in enumerate(change.reshape(m, -1))])
    return None


def _grid(omega: Real, marks: Real) -> Real:
    """Frequencies in rad/s where cuts are looked for: those of the data, at the poles, and beyond; infinity last."""
    top = max(float(omega.max()), float(marks.max()))
    low = min(float(omega[omega > 0].min()), float(marks[marks > 0].min(initial=np.inf)))
    wide = np.geomspace(low / _BEYOND, top * _BEYOND, _GRID)
    middle = (omega[1:] + omega[:-1]) / 2
    return np.append(np.unique(np.concatenate([[0.0], omega, middle, marks, wide])), np.inf)


def _worst(values: Complex, bounded: bool) -> tuple[Real, Complex, Complex]:
    """The excess of every value, and the vectors along which it is reached: ``Re left' S right`` is the excess."""
    if bounded:
        left, sizes, right = np.linalg.svd(values)
        return sizes[:, 0], left[:, :, 0], right[:, 0].conj()
    lowest, vectors = np.linalg.eigh((values + values.conj().transpose(0, 2, 1)) / 2)
    return -lowest[:, 0], -vectors[:, :, 0], vectors[:, :, 0]


def _least(rows: Real, room: Real) -> Real | None:
    """The shortest y with ``rows y <= room``; None where there is none.

    Source: least distance programming by non-negative least squares, `lawson1974` chapter 23.
    """
    sizes = np.linalg.norm(rows, axis=1)
    rows, room = rows / sizes[:, None], room / sizes
    scale = float(np.abs(room).max()) or 1.0
    wanted = np.zeros(rows.shape[1] + 1)
    wanted[-1] = 1.0
    both = np.vstack([-rows.T, -room / scale])
    try:
        weights = scipy.optimize.nnls(both, wanted, maxiter=50 * len(rows) + 1000)[0]
    except RuntimeError:
        return None
    left = both @ weights - wanted
    return None if abs(left[-1]) < 1e-12 else -scale * left[:-1] / left[-1]
