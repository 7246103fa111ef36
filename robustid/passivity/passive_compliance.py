"""Negative-imaginary models nearest to data: a semidefinite program over the matrix that proves them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Complex, Real, StateMatrices, input_states
from robustid.data import FrequencyResponse
from robustid.passivity.passive_fit import like, radius_of, response_of, solver
from robustid.passivity.passivity_certificate import NEGATIVE
from robustid.passivity.passivity_search import Popov

if TYPE_CHECKING:
    import control

_ROOM = (
    1e-9,
    1e-7,
    1e-5,
    1e-3,
)  # of the rates of the states: how far inside the decrease stays, until there is a proof


def nearest_compliances(model: control.StateSpace, data: FrequencyResponse | None) -> Iterator[control.StateSpace]:
    """Negative-imaginary models with the A and B of a model and the least squares of residuals over bounds, ever further
    inside. ``C = -B^T A^{-T} X``, X ≻ 0, ``A^T X + X A ⪯ 0``, D = D^T is every negative-imaginary model with this A and B (the
    lemma of `lanzon2008`), linear in X and D.
    """
    cp = solver()
    popov = Popov(NEGATIVE, StateMatrices.of(model))
    A, B = popov.system.A, popov.system.B
    n, m = B.shape
    omega = np.unique(np.concatenate([popov.marks[1:], 10 * popov.marks[-1:]])) if data is None else data.omega
    values = response_of(model, omega) if data is None else data.values
    radius = np.ones(values.shape) if data is None else radius_of(data)
    weight = np.where(np.isfinite(radius), 1 / radius, 0.0)
    static: Real = np.asarray(-np.linalg.solve(A, B).T, dtype=float)
    states = input_states(A, B, 1j * omega / popov.unit)
    # Residuals over bounds are linear in [X, D]; D has one unknown for every pair of entries.
    terms = np.einsum("fij,ik,flj->fijkl", weight, static, states).reshape(-1, n * n)
    through = np.einsum("fij,ik,jl->fijkl", weight, np.eye(m), np.eye(m)).reshape(-1, m * m)
    wanted = (np.where(weight > 0, values, 0) * weight).ravel()
    rows: Complex = np.column_stack([terms, through.astype(complex), wanted])
    stacked = np.vstack([rows.real, rows.imag])
    triangle = scipy.linalg.qr(stacked, mode="r", check_finite=False)[0][: stacked.shape[1]]
    size = float(np.linalg.norm(triangle[:, -1])) or 1.0
    rates = np.diag(np.abs(np.diagonal(A)))
    for room in _ROOM:
        X = cp.Variable((n, n), symmetric=True)
        D = cp.Variable((m, m), symmetric=True)
        unknown = cp.hstack([cp.vec(X, order="C"), cp.vec(D, order="C")])
        cost = cp.norm(triangle[:, :-1] @ unknown - triangle[:, -1]) / size
        scale = float(np.abs(popov.system.C).max()) or 1.0
        constraints = [X >> room * scale * np.eye(n), A.T @ X + X @ A << -room * scale * rates]
        try:
            with warnings.catch_warnings():  # its word is not taken anyway
                warnings.simplefilter("ignore", UserWarning)
                cp.Problem(cp.Minimize(cost), constraints).solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            continue
        if X.value is None or not np.all(np.isfinite(X.value)):
            continue
        root = np.sqrt(popov.unit)
        found = np.asarray(D.value, dtype=float)
        gains = static @ np.asarray(X.value, dtype=float)
        yield like(model, A * popov.unit, B * root, gains * root, (found + found.T) / 2)
