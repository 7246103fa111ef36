"""State spaces of transfer functions that files hold as zeros, poles and gain, or as polynomials."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.errors import InputError

_Complex = NDArray[np.complex128]
_MOST_STATES = 2000
_PAIR = 1e-8  # relative distance of a root from the conjugate of its partner


def of_polynomials(numerator: NDArray[Any], denominator: NDArray[Any], dt: float) -> Any:
    """The `control.StateSpace` of b(s)/a(s), highest power first, in companion form.

    Written out here: scipy takes leading coefficients below 1e-14 for zero, whatever the units.
    """
    import control

    b, a = (np.trim_zeros(np.asarray(part, dtype=float).reshape(-1), "f") for part in (numerator, denominator))
    if not a.size:
        raise InputError("the denominator is zero")
    if b.size > a.size:
        raise InputError(f"the numerator has the degree {b.size - 1}, the denominator {a.size - 1}; a model is proper")
    order = _checked_order(a.size - 1)
    b, a = np.concatenate([np.zeros(a.size - b.size), b]) / a[0], a / a[0]
    A = np.eye(order, k=-1)
    A[:1] = -a[1:]
    return control.ss(A, np.eye(order, 1), [b[1:] - b[0] * a[1:]], b[0], dt)


def of_roots(zeros: NDArray[Any], poles: NDArray[Any], gain: float, dt: float) -> Any:
    """The `control.StateSpace` of ``gain * prod(s - zeros) / prod(s - poles)``: a cascade of sections of order 2 at most.

    A cascade, since the coefficients of the whole polynomial lose lightly damped modes at high orders. Every section takes the
    zeros nearest to its poles.
    """
    import control

    zeros, poles = (np.asarray(part, dtype=complex).reshape(-1) for part in (zeros, poles))
    if zeros.size > poles.size:
        raise InputError(f"there are {zeros.size} zeros and {poles.size} poles; a model is proper")
    n = _checked_order(poles.size)
    A, B, seen, through = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n)), float(gain)
    left, at = _sections("zeros", zeros), 0
    for section in sorted(_sections("poles", poles), key=len):
        fitting = [k for k, part in enumerate(left) if len(part) <= len(section)]
        # A section of one pole takes a single zero if there is one; all others the nearest.
        near = min(fitting, key=lambda k: float(np.abs(left[k][0] - section[0])), default=None)
        part = left.pop(near) if near is not None else np.array([], dtype=complex)
        one = of_polynomials(np.poly(part).real, np.poly(section).real, dt)
        own = slice(at, at + len(section))
        A[own, own], A[own, :at], B[own] = one.A, one.B @ seen[:, :at], one.B * through
        seen, through, at = seen * one.D.item(), through * one.D.item(), own.stop
        seen[:, own] = one.C
    return control.ss(A, B, seen, through, dt)


def _checked_order(order: int) -> int:
    if order > _MOST_STATES:
        raise InputError(f"a model of order {order} is too large; at most {_MOST_STATES}")
    return order


def _sections(what: str, roots: _Complex) -> list[_Complex]:
    """Conjugate pairs and pairs of real roots; one real root alone where their number is odd."""
    scale = np.maximum(np.abs(roots), np.finfo(float).tiny)
    real = np.sort(roots[np.abs(roots.imag) <= _PAIR * scale].real)
    upper, lower = (roots[sign * roots.imag > _PAIR * scale] for sign in (1, -1))
    pairs: list[_Complex] = []
    for root in upper:
        partner = int(np.argmin(np.abs(lower - root.conj()))) if lower.size else -1
        if partner < 0 or abs(lower[partner] - root.conj()) > _PAIR * abs(root):
            raise InputError(f"the {what} of a real model come in conjugate pairs; {root:.6g} is alone")
        lower = np.delete(lower, partner)
        pairs.append(np.array([root, root.conj()]))
    if lower.size:
        raise InputError(f"the {what} of a real model come in conjugate pairs; {lower[0]:.6g} is alone")
    return pairs + [real[k : k + 2].astype(complex) for k in range(0, real.size, 2)]
