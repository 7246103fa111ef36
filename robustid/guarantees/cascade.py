"""SISO models as cascades of short sections, whose magnitude is known exactly on whole arcs of the circle."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import Complex, Real

if TYPE_CHECKING:
    import control

_EPS = np.finfo(float).eps
# Logarithms of a few dozen factors, each rounded to some units of the last place of numbers below 1e3.
_ROUNDING = 1e-12
_DEPTH = 80  # halvings of a cell: its width is rounding noise long before


class Factors(NamedTuple):
    """``|W|^2 = gain^2 prod(numerators)/prod(denominators)``: rows (v, m, s, q) of ``m + s t + q t^2``, ``t = 1 - cos(angle) - v``.

    v lies where the factor is smallest, so that nothing cancels there however lightly damped its roots are.
    """

    numerators: Real
    denominators: Real
    gain: float
    minimum_phase: bool


def cascade(zeros: Complex, poles: Complex, gain: float, dt: float) -> control.StateSpace:
    """The model ``gain prod(z - zeros) / prod(z - poles)``, conjugate pairs complete, in sections with ``B = [1, 0]'``, ``D = 1``.

    So it is written without any arithmetic: what `factors` reads from it is the model itself. A pair of poles stands as its real
    and imaginary parts (not as coefficients of a polynomial), which keeps digits of poles near z = 1.
    """
    import control

    sections = [_section(p, z) for p, z in zip(_units(poles), _units(zeros), strict=True)]
    r = poles.size
    A, B, C = np.zeros((r, r)), np.zeros((r, 1)), np.zeros((1, r))
    first = 0
    for block, row in sections:
        last = first + row.size
        A[first:last, first:last] = block
        A[last::2, first:last] = row  # the first state of every later section is driven by this one
        B[first, 0] = gain
        C[0, first:last] = row
        first = last
    return control.StateSpace(A, B, C, [[gain]], dt, remove_useless_states=False)


def _units(roots: Complex) -> list[Complex]:
    """Pairs of roots, by rising distance from z = 1, then the single real one of an odd number."""
    pairs = [np.array([root, root.conj()]) for root in roots[np.imag(roots) > 0]]
    real = roots[np.imag(roots) == 0]
    real = real[np.argsort(np.abs(1 - real))]
    pairs += [real[k : k + 2] for k in range(0, real.size - 1, 2)]
    pairs.sort(key=lambda pair: float(np.abs(1 - pair).min()))
    return pairs + ([real[-1:]] if real.size % 2 else [])


def _section(poles: Complex, zeros: Complex) -> tuple[Real, Real]:
    """A and C of ``prod(z - zeros)/prod(z - poles)`` with ``B = [1, 0]'``, ``D = 1``.

    ``A = [[a, b], [c, d]]`` gives the numerator ``det(zI - A) + C_1 (z - d) + C_2 c``; its value at d and its slope give C.
    """
    if poles.size == 1:
        return np.real(poles)[None], np.real(poles - zeros)
    if np.imag(poles[0]):
        a = d = poles[0].real
        c = -poles[0].imag
        b = -c
    else:
        a, d = np.real(poles)
        b, c = 0.0, float(np.abs(1 - poles).max())
    value = np.real((d - zeros[0]) * (d - zeros[1]))
    slope = np.real(a - zeros[0]) + np.real(d - zeros[1])
    return np.array([[a, b], [c, d]]), np.array([slope, (value + b * c) / c])


def factors(model: control.StateSpace) -> Factors | None:
    """Exact factors of the magnitude of a model written by `cascade`; None for any other model.

    The coefficients come from the entries of the model in rational arithmetic and are rounded once; stability and minimum
    phase are decided before rounding.
    """
    A, B, C, D = (np.asarray(getattr(model, name)) for name in "ABCD")
    r = A.shape[0]
    if B.shape != (r, 1) or C.shape != (1, r) or not D[0, 0] > 0:
        return None
    gain, expected = float(D[0, 0]), np.zeros_like(A)
    inside = True
    numerators: list[tuple[float, ...]] = []
    denominators: list[tuple[float, ...]] = []
    for first in range(0, r, 2):
        block = slice(first, min(first + 2, r))
        expected[block, block] = A[block, block]
        expected[first + 2 :: 2, block] = C[0, block]
        numerator, denominator = _polynomials(A[block, block], C[0, block])
        inside = inside and _stable(numerator) and _stable(denominator)
        numerators.append(_square(*numerator))
        denominators.append(_square(*denominator))
    driven = np.zeros(r)
    driven[::2] = gain
    if not (np.array_equal(A, expected) and np.array_equal(B[:, 0], driven)):
        return None
    return Factors(np.reshape(numerators, (-1, 4)), np.reshape(denominators, (-1, 4)), gain, inside)


def _polynomials(A: Real, C: Real) -> tuple[list[Fraction], list[Fraction]]:
    """Numerator and denominator of a section, without their leading 1: [b1, b2], or [b1] of a single state."""
    if C.size == 1:
        pole = Fraction(float(A[0, 0]))
        return [Fraction(float(C[0])) - pole], [-pole]
    a, b, c, d = (Fraction(float(entry)) for entry in A.ravel())
    c1, c2 = (Fraction(float(entry)) for entry in C)
    trace, determinant = -(a + d), a * d - b * c
    return [trace + c1, determinant - c1 * d + c2 * c], [trace, determinant]


def _stable(coefficients: list[Fraction]) -> bool:
    """Jury's test of z + b1 or z^2 + b1 z + b2."""
    b1, b2 = (*coefficients, Fraction(0))[:2]
    return abs(b2) < 1 and abs(b1) < 1 + b2


def _square(b1: Fraction, b2: Fraction | None = None) -> tuple[float, float, float, float]:
    """``|z + b1|^2`` or ``|z^2 + b1 z + b2|^2`` on the circle as a polynomial in y = 1 - cos, expanded about one point."""
    if b2 is None:
        constant, slope, curve = (1 + b1) ** 2, -2 * b1, Fraction(0)
        v = 2.0 if slope < 0 else 0.0
    else:
        constant, slope, curve = (1 + b1 + b2) ** 2, -2 * (b1 * (1 + b2) + 4 * b2), 4 * b2
        v = min(max(float(-slope / (2 * curve)), 0.0), 2.0) if curve else 0.0
    y = Fraction(v)
    return v, float(constant + y * (slope + curve * y)), float(slope + 2 * curve * y), float(curve)


def arcs(angles: Real) -> tuple[Real, Real]:
    """Ends of the cells in y = 1 - cos(angle), moved outwards by their rounding, but not beyond 2: there |W|^2 may be negative."""
    y = 2 * np.sin(angles / 2) ** 2
    return y[:-1] * (1 - 16 * _EPS), np.minimum(y[1:] * (1 + 16 * _EPS), 2.0)


def lowest_ratio(parts: Factors, low: Real, high: Real, bound: Real, tolerance: float = 2e-4) -> float:
    """Proved lower bound of min |W|/bound over all cells [low, high] in y, but for rounding at most 1 + tolerance times too low.

    Every factor is a parabola, whose range on a cell has a closed form, widened by a running bound of its rounding errors; the
    product of the ranges encloses the product. Cells are halved where that decides nothing yet.
    """
    offset = np.log(parts.gain) - np.log(bound)
    reached = proven = np.inf
    for _ in range(_DEPTH):
        lower = _log_bounds(parts, low, high)[0] + offset
        middle = (low + high) / 2
        point = [side + offset for side in _log_bounds(parts, middle, middle)]
        reached = min(reached, float(point[1].min()))
        # Where not even a single point can be told from less, rounding decides, and smaller pieces are no better.
        wide = (lower < reached - tolerance) & (point[0] >= reached - tolerance)
        proven = min(proven, float(lower[~wide].min(initial=np.inf)))
        if not wide.any():
            break
        low, middle, high, offset = low[wide], middle[wide], high[wide], np.tile(offset[wide], 2)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    else:
        return 0.0
    return float(np.exp(proven) * (1 - _ROUNDING))


def highest_ratio(parts: Factors, low: Real, high: Real, bound: Real) -> float:
    """Guaranteed upper bound of max |W|/bound over all cells."""
    inverse = Factors(parts.denominators, parts.numerators, 1 / parts.gain, parts.minimum_phase)
    lowest = lowest_ratio(inverse, low, high, 1 / bound)
    return 1 / lowest if lowest else np.inf


def _ranges(rows: Real, low: Real, high: Real) -> tuple[Real, Real]:
    """Least and largest value of every parabola on every cell, (factors, cells), outwards."""
    v, m, s, q = (column[:, None] for column in rows.T)
    vertex = v - s / np.where(q == 0, 1.0, 2 * q)
    values: list[tuple[Real, Real]] = []
    for y in (low, high, np.clip(vertex, low, high)):
        t = y - v
        values.append((m + t * (s + q * t), np.abs(m) + np.abs(t) * (np.abs(s) + np.abs(q * t))))
    # The place of the vertex is rounded too, which matters to second order.
    error = 8 * _EPS * np.max([size for _, size in values], axis=0) + 64 * np.abs(q) * _EPS**2
    least, most = (pick([value for value, _ in values], axis=0) for pick in (np.min, np.max))
    return np.maximum(least - error, 1e-300), most + error


def _log_bounds(parts: Factors, low: Real, high: Real) -> tuple[Real, Real]:
    """Lower and upper bound of log |W|, but for the gain, on every cell."""
    top, bottom = _ranges(parts.numerators, low, high), _ranges(parts.denominators, low, high)
    lower, upper = (np.log(top[k]).sum(axis=0) - np.log(bottom[1 - k]).sum(axis=0) for k in (0, 1))
    return lower / 2, upper / 2
