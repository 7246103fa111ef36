"""Matrices that prove passivity next to the limit: a Riccati equation refined beyond double precision.

Next to the limit the inequality leaves less room than the rounding of P takes. The frequency axis is turned so that a point of the
right half-plane, where a passive response is far from the limit, takes the place of infinity, and Newton steps follow with
residuals in extended precision; then, with the feedback that follows fixed, P solves an equation that is linear, refined with exact
residuals into the sum of two matrices of doubles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Real, StateMatrices
from robustid.passivity.exact_matrices import Exact

_POINTS = (1.0, 3.0)  # of the right half-plane, over the mean size of the poles
_ROOM = (0.3, 1e-2)  # of the gap, given to the first block
_NEWTON, _EXACT = 5, 6
_MOST = 40  # states: exact residuals take their cube


class Equation(NamedTuple):
    """A, B, Q, S and R of an inequality ``[[A'P + PA + Q, PB + S], [., R]] < 0`` without rounding."""

    A: Exact
    B: Exact
    Q: Exact
    S: Exact
    R: Exact


Extended = NDArray[np.longdouble]
Form = Callable[[StateMatrices], tuple[Real, Real, Real]]  # Q, S and R of an inequality of a system


def refined_proofs(
    system: StateMatrices, form: Form, slack: Real, gap: float, exact: Equation, S: Real, unit: float
) -> Iterator[tuple[Real, Real]]:
    """P and what is to be added to it, in the coordinates S, that may prove a bound. `system` is rounded, in these coordinates
    and the unit of frequency, `exact` as the proof means it, in those of the model; `form` gives Q, S and R of the inequality
    for the bound, which lies by `gap` above the largest excess; `slack` is the room in the first block that a gap of 1 leaves.
    """
    n = len(system.A)
    if not 0 < n <= _MOST:
        return
    for part in _ROOM:
        for point in _POINTS:
            P = _riccati(system, form, part * gap * slack, point)
            if P is not None and (found := _exactly(P, system, part * gap * slack, exact, S, unit)) is not None:
                yield found


def _riccati(system: StateMatrices, form: Form, room: Real, point: float) -> Extended | None:
    """P of the equation, by that of discrete time: the same where s = point (z - 1)/(z + 1)."""
    A, B, C, D = (np.asarray(part, dtype=np.longdouble) for part in system)
    n = len(A)
    M = _solved(point * np.eye(n) - A, np.eye(n))
    root = np.sqrt(np.longdouble(2 * point))
    a, b, c, d = (point * np.eye(n) + A) @ M, root * M @ B, root * C @ M, D + C @ M @ B
    W, N = root * M, M @ B
    q, s, r = form(StateMatrices(a, b, c, d))  # type: ignore[arg-type]
    q, s, r = q + W.T @ room @ W, s + W.T @ room @ N, r + N.T @ room @ N
    try:
        found = scipy.linalg.solve_discrete_are(*map(_rounded, (a, b, q, r)), s=_rounded(s)).astype(np.longdouble)
        for _ in range(_NEWTON):
            found = (found + found.T) / 2
            gain = b.T @ found @ a + s.T
            feedback = _solved(r + b.T @ found @ b, gain)
            left = a.T @ found @ a - found + q - gain.T @ feedback
            found = found + scipy.linalg.solve_discrete_lyapunov(_rounded((a - b @ feedback).T), _rounded(left))
    except (np.linalg.LinAlgError, scipy.linalg.LinAlgError, ValueError):
        return None
    return (found + found.T) / 2 if np.all(np.isfinite(_rounded(found))) else None


def _exactly(
    P: Extended, system: StateMatrices, room: Real, exact: Equation, S: Real, unit: float
) -> tuple[Real, Real] | None:
    """P as a sum of two, so that ``(A + BK)'P + P(A + BK) + Q + SK + K'S' + K'RK + room = 0`` for a feedback K of doubles. With
    the K that minimises, the inequality has the room in its first block, and next to nothing beside it: a K that is off by dK
    costs dK'R dK. K follows from P, and P from K, with exact residuals (Newton's method).
    """
    a, b, Q, cross, R = exact
    T, inverse = Exact.of(S), np.asarray(np.linalg.inv(S), dtype=float)
    given = Q + T.T @ Exact.of(unit * room) @ T
    first = _even(_rounded(P))
    second: Real = _even(_rounded(P - first))

    def whole() -> Exact:
        return T.T @ (Exact.of(first) + Exact.of(second)) @ T

    for _ in range(_NEWTON):
        try:
            gain: Real = -np.asarray(np.linalg.solve(R.rounded(), (b.T @ whole() + cross.T).rounded()), dtype=float)
            closed = system.A + system.B @ gain @ inverse / np.sqrt(unit)
            K = Exact.of(gain)
            loop, fixed = a + b @ K, given + (cross @ K).symmetrised() + K.T @ (R @ K)
            for _ in range(_EXACT):
                left = inverse.T @ (fixed + (whole() @ loop).symmetrised()).rounded() @ inverse / unit
                second = _even(second + scipy.linalg.solve_continuous_lyapunov(closed.T, -_even(left)))
        except (np.linalg.LinAlgError, scipy.linalg.LinAlgError, ValueError):
            return None
        if not np.all(np.isfinite(second)):
            return None
    return first, second


def _even(matrix: Real) -> Real:
    return (matrix + matrix.T) / 2


def _rounded(array: Extended) -> Real:
    return np.asarray(array, dtype=float)


def _solved(matrix: Real | Extended, right: Real | Extended) -> Extended:
    """The solution of a small system in extended precision: elimination with pivots."""
    M, Y = np.array(matrix, dtype=np.longdouble), np.array(right, dtype=np.longdouble)
    n = len(M)
    for k in range(n):
        pivot = k + int(np.argmax(np.abs(M[k:, k])))
        M[[k, pivot]], Y[[k, pivot]] = M[[pivot, k]], Y[[pivot, k]]
        if M[k, k] == 0:
            raise np.linalg.LinAlgError
        factors = M[k + 1 :, k] / M[k, k]
        M[k + 1 :, k:] -= factors[:, None] * M[k, k:]
        Y[k + 1 :] -= factors[:, None] * Y[k]
    for k in range(n - 1, -1, -1):
        Y[k] = (Y[k] - M[k, k + 1 :] @ Y[k + 1 :]) / M[k, k]
    return Y
