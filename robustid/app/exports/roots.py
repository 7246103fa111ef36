"""Filters of one input and one output by their roots: second-order sections; zeros, poles and gain as control rooms write them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Complex, Real, StateMatrices, exponents_of, points_of, response_at
from robustid.errors import InputError

if TYPE_CHECKING:
    import control

_WORST = 1e-3  # of the response, that roots may lose
_POINTS = 400


def sections_text(model: control.StateSpace, name: str) -> str:
    """Return second-order sections, one a line: b0 b1 b2 a0 a1 a2, from the input on."""
    import scipy.signal

    if not model.dt:
        raise InputError("second-order sections are of discrete models; sample this one, or save it as .zpk")
    z, p, k = _roots(model, "second-order sections")
    sections = _later(scipy.signal.zpk2sos(z, p, k, pairing="nearest"), p.size - z.size)
    omega = compared_at(model)
    _, found = scipy.signal.sosfreqz(sections, omega * float(model.dt))
    lost = _lost(model, omega, np.asarray(found, dtype=complex), "second-order sections")
    head = [
        f"# {name}: second-order sections, sampled at {float(model.dt)!r} s, written by robustid",
        f"# relative difference from the response of the model: at most {lost:.1e} at {omega.size} frequencies",
        "# b0 b1 b2 a0 a1 a2 of (b0 + b1/z + b2/z^2)/(a0 + a1/z + a2/z^2)",
    ]
    return "\n".join([*head, *(" ".join(f"{value:.17g}" for value in row) for row in sections), ""])


def _later(sections: Real, samples: int) -> Real:
    """Sections with the delay that zpk2sos leaves out: it adds zeros at z = 0 until there are as many as poles."""
    sections = np.array(sections)
    for row in sections:
        while samples and row[2] == 0:
            row[:3] = 0.0, row[0], row[1]
            samples -= 1
    return sections


def roots_text(model: control.StateSpace, name: str) -> str:
    """Return ``zpk([zeros], [poles], gain, "n")`` in Hz: gain prod(1 + i f/z) / prod(1 + i f/p), a root at 0 as i f.

    Roots in the left half-plane have a positive real part there.
    """
    if model.dt:
        raise InputError(
            "zeros and poles in Hz are of continuous models; make one by to_continuous, or save this one as .sos"
        )
    z, p, k = _roots(model, "zeros, poles and gain")
    zeros, poles = (-root / (2 * np.pi) for root in (z, p))
    gain = float(k)
    for roots, power in ((z, 1), (p, -1)):
        moving = roots[roots != 0]
        gain *= float(np.real(np.prod((-moving) ** power))) * (2 * np.pi) ** (power * int(np.sum(roots == 0)))
    omega = compared_at(model)
    f = omega / (2 * np.pi)
    found = gain * _normal(f, zeros) / _normal(f, poles)
    lost = _lost(model, omega, found, "zeros, poles and gain")
    listed = ["; ".join(_complex(root) for root in roots) for roots in (zeros, poles)]
    return (
        f"# {name}: zeros and poles in Hz, written by robustid; differs from the model by at most {lost:.1e} of the response\n"
        f'zpk([{listed[0]}], [{listed[1]}], {gain:.17g}, "n")\n'
    )


def _normal(f: Real, roots: Complex) -> Complex:
    product: Complex = np.ones(f.size, complex)
    for root in roots:
        factor: Complex = np.asarray(1j * f if root == 0 else 1 + 1j * f / root, dtype=complex)
        product = product * factor
    return product


def _complex(root: complex) -> str:
    if root.imag == 0:
        return f"{root.real:.17g}"
    return f"{root.real:.17g}{'+' if root.imag > 0 else '-'}i*{abs(root.imag):.17g}"


def _roots(model: control.StateSpace, what: str) -> tuple[Complex, Complex, float]:
    """Zeros, poles and gain of a model of one input and one output."""
    import scipy.linalg

    if (model.noutputs, model.ninputs) != (1, 1):
        raise InputError(
            f"{what} are of one input and one output; this model is {model.noutputs}x{model.ninputs}. Save .h or .m"
        )
    A, B, C, D = (np.asarray(getattr(model, part), dtype=float) for part in "ABCD")
    n = len(A)
    poles = np.asarray(np.linalg.eigvals(A) if n else np.zeros(0), dtype=complex)
    if not n:
        return np.zeros(0, complex), poles, float(D[0, 0])
    pencil = np.block([[A, B * (scale := 1 / max(np.abs(B).max(), 1e-300))], [C, D * scale]])
    unit = scipy.linalg.block_diag(np.eye(n), 0.0)
    alpha, beta = scipy.linalg.eigvals(pencil, unit, homogeneous_eigvals=True)
    count = _relative_degree(A, B, C, D)
    finite = np.argsort(-np.abs(beta) / np.maximum(np.hypot(np.abs(alpha), np.abs(beta)), 1e-300))[: n - count]
    zeros = _paired(np.asarray(alpha[finite] / beta[finite], dtype=complex))
    omega = compared_at(model)
    x, values = (
        points_of(omega, model.dt or 0.0),
        response_at(StateMatrices.of(model), points_of(omega, model.dt or 0.0))[:, 0, 0],
    )
    ratio = values / (_product(x, zeros) / _product(x, poles))
    return zeros, _paired(poles), float(np.median(ratio.real))


def _product(x: Complex, roots: Complex) -> Complex:
    product = np.ones(x.size, complex)
    for root in roots:
        product = product * (x - root)
    return product


def _relative_degree(A: Real, B: Real, C: Real, D: Real) -> int:
    """Number of infinite zeros: 0 with feed-through, else the first k with C A^(k-1) B not zero."""
    size = np.linalg.norm(C) * np.linalg.norm(B)
    if abs(D[0, 0]) > 1e-14 * max(size, abs(D[0, 0])):
        return 0
    column, scale = B, max(np.linalg.norm(A, 2), 1e-300)
    for k in range(1, len(A) + 1):
        if abs((C @ column).item()) > 1e-13 * size:
            return k
        column = A @ column / scale
    return len(A)


def _paired(roots: Complex) -> Complex:
    """Roots as exact conjugate pairs and real numbers."""
    size = np.maximum(np.abs(roots), 1e-300)
    real = roots[np.abs(roots.imag) <= 1e-13 * size].real
    upper = roots[roots.imag > 1e-13 * size]
    return np.concatenate([real.astype(complex), upper, upper.conj()])


def compared_at(model: control.StateSpace) -> Real:
    """Frequencies at which a filter is compared: spread evenly in log, and at every resonance."""
    return spread_over(np.asarray(model.poles(), dtype=complex), model.dt or 0.0)


def spread_over(poles: Complex, dt: float) -> Real:
    """Frequencies in rad/s at which a filter of these poles is compared."""
    size = np.abs(exponents_of(poles[np.abs(poles) > 0], dt))
    size = size[size > 0]
    top = np.pi / dt if dt else 30 * float(size.max(initial=1.0))
    low = min(float(size.min(initial=top)), top) / 30
    return np.unique(np.concatenate([np.geomspace(low, top * (1 - 1e-9), _POINTS), size[(size < top) & (size > low)]]))


def _lost(model: control.StateSpace, omega: Real, found: Complex, what: str) -> float:
    """Largest difference from the response of the model, in part of the larger of it and a millionth of its largest."""
    values = response_at(StateMatrices.of(model), points_of(omega, model.dt or 0.0))[:, 0, 0]
    size = np.maximum(np.abs(values), 1e-6 * float(np.abs(values).max()))
    lost = float(np.max(np.abs(found - values) / np.maximum(size, 1e-300)))
    if not lost <= _WORST:
        raise InputError(
            f"{what} would differ by {100 * lost:.2g} % from this model of order {model.nstates}; save it as .h or .m"
        )
    return lost
