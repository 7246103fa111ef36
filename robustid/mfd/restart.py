"""A second start where the first one was poor: the strongest modes of a richer fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.mfd.attempt import Attempt
from robustid.mfd.chains import StateMatrices
from robustid.mfd.model import FractionModel
from robustid.mfd.state_fit import Samples, fit_inputs

# Neighbouring residuals of a fit at the noise floor are independent: this many standard deviations are too much.
_CORRELATED = 5.0
_NOTHING_LEFT = 1e-6  # a residual of this part of the data is no measurement noise
EXTRA = 2  # states that the richer fit has more


def suspicious(attempt: Attempt) -> bool:
    """Whether the residual still has a shape over frequency: a mode missed by a poor start, or an order too small."""
    fit = attempt.fit
    residual = fit.problem.residual(fit.fraction.response)
    size = float(np.linalg.norm(residual)) ** 2
    if size <= (_NOTHING_LEFT * float(np.linalg.norm(fit.problem.weight.apply(fit.problem.values)))) ** 2:
        return False
    if not fit.status.converged:
        return True
    correlation = float(np.real(np.vdot(residual[1:], residual[:-1]))) / size
    return correlation * np.sqrt(2 * np.count_nonzero(residual)) > _CORRELATED


def strongest(found: FractionModel, data: Samples, feedthrough: bool) -> StateMatrices | None:
    """A model with the poles of a fit but the EXTRA weakest, by what each adds to the weighted response.

    None where the weakest poles can't be taken away without splitting a pair.
    """
    A, B, C, _ = found.matrices
    flexible = len(A) - 2 * found.rigid_count
    poles, V = np.linalg.eig(A[:flexible, :flexible])
    left, right = C[:, :flexible] @ V, np.linalg.solve(V, B[:flexible].astype(complex))
    lines = np.abs(data.points[:, None] - poles) ** -2
    strength = np.sqrt(
        np.einsum("kij,km,im,mj->m", data.weight**2, lines, np.abs(left) ** 2, np.abs(right) ** 2, optimize=True)
    )
    units = [(strength[k], [k]) for k in np.flatnonzero(np.imag(poles) == 0)]
    pairs = [(2 * strength[k], [int(k), _conjugate(poles, int(k))]) for k in np.flatnonzero(np.imag(poles) > 0)]
    reals: list[Any] = sorted(units, key=lambda unit: unit[0])[:EXTRA]
    choices: list[Any] = (
        [(sum(size for size, _ in reals), [k for _, ks in reals for k in ks])] if len(reals) == EXTRA else []
    )
    if pairs:
        choices.append(min(pairs, key=lambda pair: pair[0]))
    if not choices:
        return None
    dropped = min(choices, key=lambda choice: choice[0])[1]
    kept = [k for k in range(flexible) if k not in dropped]
    T, outputs = _real_modal(poles[kept], left[:, kept])
    rest = A[flexible:, flexible:]
    A = np.block([[T, np.zeros((len(T), len(rest)))], [np.zeros((len(rest), len(T))), rest]])
    C = np.hstack([outputs, C[:, flexible:]])
    B, D, _ = fit_inputs(data, A, C, feedthrough)
    return StateMatrices(A, B, C, D)


def _conjugate(poles: np.ndarray, k: int) -> int:
    return int(np.argmin(np.abs(poles - poles[k].conj())))


def _real_modal(poles: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real blocks and the outputs that belong to them, for poles that come in pairs."""
    T, C = np.zeros((len(poles), len(poles))), np.zeros(outputs.shape)
    at = 0
    for pole, shape in zip(poles, outputs.T, strict=True):
        if pole.imag == 0:
            T[at, at], C[:, at] = pole.real, shape.real
            at += 1
        elif pole.imag > 0:
            T[at : at + 2, at : at + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            C[:, at], C[:, at + 1] = shape.real, shape.imag
            at += 2
    return T, C
