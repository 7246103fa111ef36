"""Graphs of plants, and what is zero on them: ``[I; P]``, factors of a feedback, normalised factors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import (
    Complex,
    Numbers,
    StateMatrices,
    decay_of,
    input_states,
    normalised_factors,
    poles_of,
    right_factors,
)
from robustid.errors import InputError
from robustid.guarantees.chordal import Graph
from robustid.identification import describe_poles
from robustid.reduction import MOST_DOUBT, is_stable, modes_of

if TYPE_CHECKING:
    from collections.abc import Callable

_HIDDEN = 1e-13  # of the matrix that tells it: a pole that is moved, or seen, by so little is hidden
_FAR = 1e-10  # squared singular value, relative: no question of rounding
# Error of normalised factors at which they are none, and the number of poles at which it is looked for.
_ISOMETRY, _CHECKED = 1e-6, 4
# Distance from the axis, relative to A, and from z = -1: poles farther off leave the response of the system itself exact enough.
_AWAY, _AWAY_FROM_END = 1e-6, 1e-2
_LARGE_END = 1e3  # a gain at infinity, or at z = -1, beside whose square the identity loses digits


def graph_of(
    name: str,
    system: StateMatrices,
    dt: float | None,
    then: Callable[[StateMatrices], StateMatrices] = lambda one: one,
    *,
    feedback: bool,
) -> Graph:
    """Find what spans the graph of a system: ``[I; P]``, or normalised factors where poles are near the axis, or near z = -1.

    With feedback factors whose value at infinity is an isometry; the poles are those of the factors.
    """
    plain = right_factors(system, np.zeros((system.B.shape[1], len(system.A))))
    found = then(_isometric_at_infinity(system) if feedback else plain)
    sums = modes_of(found)
    poles = sums.poles if sums else poles_of(found.A)
    distance = np.abs(np.abs(poles) - 1) if dt else np.abs(poles.real)
    if np.any(distance <= _AWAY * np.linalg.norm(system.A)) or (dt and np.any(np.abs(poles + 1) < _AWAY_FROM_END)):
        found = then(graph_factors(name, system, dt))
        return Graph(found, modes_of(found))
    if not feedback:
        check_shown(name, system, dt, poles)
    return Graph(found, sums)


def ends_large(system: StateMatrices, dt: float | None) -> bool:
    """Say whether the value at infinity, or at z = -1 where no pole is near, is large."""
    A, B, C, D = system
    if not dt or not A.size:
        return bool(np.linalg.norm(D) > _LARGE_END)
    try:
        value = D - C @ np.linalg.solve(A + np.eye(len(A)), B)
    except np.linalg.LinAlgError:
        return False
    return bool(np.linalg.norm(value) > _LARGE_END and np.abs(poles_of(A) + 1).min() >= _AWAY_FROM_END)


def _isometric_at_infinity(system: StateMatrices) -> StateMatrices:
    """The factors ``[D; N]`` of the feedback that leaves least of the states in the outputs, in terms of the singular values of D.

    ``I + D* D`` would be rounded to ``D* D`` where D is large.
    """
    A, B, C, D = system
    left, sizes, right = np.linalg.svd(D)
    count = len(sizes)
    cosines, inner = np.ones(len(right)), np.ones(len(left))
    cosines[:count], inner[:count] = 1 / np.hypot(1, sizes), 1 / (1 + sizes**2)
    basis = right.T * cosines
    gain = -(right.T[:, :count] * (sizes * inner[:count])) @ left[:, :count].T
    inputs, lower = B @ basis, (left[:, :count] * (sizes * cosines[:count])) @ np.eye(count, len(right))
    outputs = np.vstack([gain @ C, (left * inner) @ left.T @ C])
    return StateMatrices(A + B @ gain @ C, inputs, outputs, np.vstack([basis, lower]))


def graph_factors(name: str, system: StateMatrices, dt: float | None) -> StateMatrices:
    """The normalised right factors ``[D; N]``, checked: stable, and an isometry where rounding weighs most."""
    check_shown(name, system, dt, poles_of(system.A))
    try:
        found = normalised_factors(system, dt or 0.0)
    except (np.linalg.LinAlgError, InputError):
        found = None
    if found is None or not _is_isometry(found, dt):
        raise InputError(
            f"`{name}` must have normalised factors that are stable by more than rounding; the Riccati equation gave none."
            " Scale its signals, so that its gain is about 1"
        )
    return found


def check_shown(name: str, system: StateMatrices, dt: float | None, poles: Complex) -> None:
    """Refuse poles that are not stable and that no input moves or no output shows, relative to the matrices."""
    A, B, C, _ = system
    distance = 1 - np.abs(poles) if dt else -poles.real
    stable = distance > 0
    if np.any(np.abs(distance) <= MOST_DOUBT * np.linalg.norm(A)):
        poles, stable = is_stable(A, dt or 0)
    poles = poles[~stable & (poles.imag >= 0)]
    shifted = poles[:, None, None] * np.eye(len(A)) - A
    hidden = np.zeros(poles.size, dtype=bool)
    for left, part in ((shifted, B), (shifted.swapaxes(1, 2), C.T)) if poles.size else ():
        both = np.concatenate([left, np.broadcast_to(part, (poles.size, *part.shape))], axis=2)
        if not _far_from_singular(both):
            levels = np.linalg.svd(both, compute_uv=False)
            hidden |= levels[:, -1] <= _HIDDEN * levels[:, 0]
    if hidden.any():
        raise InputError(
            f"`{name}` must be moved by its inputs and seen in its outputs where it isn't stable; it has a hidden"
            f" {describe_poles(poles[hidden], dt)}. Leave such states out"
        )


def _far_from_singular(rows: Numbers) -> bool:
    """Say whether rows are independent by much more than rounding, which a Cholesky factorisation tells in little time."""
    gram = rows @ rows.conj().swapaxes(1, 2)
    room = _FAR * np.trace(gram, axis1=1, axis2=2).real
    try:
        np.linalg.cholesky(gram - room[:, None, None] * np.eye(gram.shape[1]))
    except np.linalg.LinAlgError:
        return False
    return True


def _is_isometry(factors: StateMatrices, dt: float | None) -> bool:
    """Say whether factors are stable and normalised to working precision, at the frequencies of the slowest poles."""
    poles = poles_of(factors.A)
    if not decay_of(poles, dt or 0.0) > 0:
        return False
    slowest = np.argsort(1 - np.abs(poles) if dt else -poles.real)[:_CHECKED]
    places = poles[slowest].imag * 1j if not dt else np.exp(1j * np.angle(poles[slowest]))
    values = factors.D + factors.C @ input_states(factors.A, factors.B, places)
    excess = values.conj().swapaxes(1, 2) @ values - np.eye(values.shape[2])
    return bool(np.all(np.abs(excess) <= _ISOMETRY))


def graph_complement(left: StateMatrices) -> StateMatrices:
    """``[-N, D]`` from the left factors ``[D, N]``: 0 times the right factors ``[D; N]`` of the same system."""
    A, B, C, D = left
    ny = len(C)
    return StateMatrices(A, np.hstack([-B[:, ny:], B[:, :ny]]), C, np.hstack([-D[:, ny:], D[:, :ny]]))
