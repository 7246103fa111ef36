"""Certificates evaluated in ball arithmetic: every rounding error enclosed, with the library FLINT (extra `robustid[exact]`).

The formulas are those of `certificate`, the numbers y, E, P, A, c of the problem and the multipliers
exactly those that are stored, in double precision. This module must not import a solver.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
from collections.abc import Generator, Iterable
from types import ModuleType
from typing import Any

import numpy as np

from robustid.core import Numbers, Real, real_rows
from robustid.errors import InputError
from robustid.identification.certificate import Functional, MarginCertificate, SupportCertificate
from robustid.identification.entries import HALF
from robustid.identification.formulation.columns import BlockColumns, Columns
from robustid.identification.formulation.passive import PassiveMap
from robustid.identification.formulation.rows import Rows
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.formulation.taylor import ShiftMap
from robustid.identification.formulation.taylor_columns import ShiftColumns

_Ball = Any  # of FLINT, which states no types: a number or a matrix
_BITS = 128  # products of doubles take 106
_EPS = float(np.finfo(float).eps)


def verify_support_exactly(
    certificate: SupportCertificate, functional: Functional, rows: Rows, sarason: SarasonMap
) -> bool:
    """Say whether the stated value of a certificate is above what its multipliers prove, all rounding enclosed."""
    multipliers = certificate.samples, certificate.left @ certificate.right.T
    return enclose_support(functional, *multipliers, certificate.level, rows, sarason) <= certificate.value


def verify_margin_exactly(certificate: MarginCertificate, rows: Rows, sarason: SarasonMap) -> bool:
    """Say whether the stated value of a certificate is below what its multipliers prove, all rounding enclosed."""
    _flint()
    if certificate.value <= 0:
        return certificate.value == 0  # claims nothing
    return enclose_margin(certificate.samples, certificate.ball, certificate.upper, rows, sarason) >= certificate.value


def enclose_support(
    functional: Functional, samples: Numbers, Y: Real, level: float, rows: Rows, sarason: SarasonMap
) -> float:
    """A double above the bound of `evaluate_support`, evaluated without rounding errors."""
    with ball_arithmetic() as flint:
        S = sarason.stein(Y)
        size = _sizes(samples, rows)
        reach = [flint.arb(level) + tail for tail in rows.tail.tolist()]
        total = _inner(samples, rows.y) + _sum(a * b for a, b in zip(size, reach, strict=True))
        total += _largest_product(sarason, S, level) + _mismatched(-samples, S, rows, sarason, level, functional.x)
        total += _leaked(-samples, rows, level, sarason.largest(level), functional.p) + functional.tail
        return _above(total)


def enclose_margin(samples: Numbers, ball: Real, upper: float, rows: Rows, sarason: SarasonMap) -> float:
    """A double below the bound of `evaluate_certificate`, evaluated without rounding errors."""
    with ball_arithmetic():
        size = _sizes(samples, rows)
        weight = _sum(size)
        if not weight > 0:
            return 0.0
        total = _inner(samples, rows.y) - _largest_product(sarason, ball, upper)
        total -= _mismatched(samples, ball, rows, sarason, upper, np.zeros(sarason.size))
        total -= _leaked(samples, rows, upper, sarason.largest(upper), np.zeros(int(rows.P.shape[1])))
        total -= _sum(a * b for a, b in zip(size, rows.tail.tolist(), strict=True))
        return -_above(-total / weight)


def _sizes(samples: Numbers, rows: Rows) -> list[_Ball]:
    """|l| of every bound."""
    flint = _flint()
    if rows.cone is None:
        return [abs(flint.acb(*parts)) for parts in _parts(samples)]
    squares = [flint.arb(0)] * rows.cones
    for cone, (re, im) in zip(rows.cone.tolist(), _parts(samples), strict=True):
        squares[cone] += flint.arb(re) * re + flint.arb(im) * im
    return [square.sqrt() for square in squares]


@contextlib.contextmanager
def ball_arithmetic(bits: int = _BITS) -> Generator[ModuleType]:
    """The library FLINT, with as many bits as products of doubles take, or with so many."""
    flint = _flint()
    with flint.ctx.workprec(bits):
        yield flint


def _flint() -> ModuleType:
    try:
        import flint
    except ImportError:
        raise InputError("`exact` needs python-flint, which is not installed: pip install 'robustid[exact]'") from None
    return flint


def _above(x: _Ball) -> float:
    """A double that is surely not below."""
    top = float(x.upper())
    if x == top:  # exactly
        return top
    return math.nextafter(top, math.inf) if math.isfinite(top) else math.inf


def _parts(values: Numbers) -> list[tuple[float, float]]:
    return list(zip(np.real(values).tolist(), np.imag(values).tolist(), strict=True))


def _matrix(values: Numbers) -> _Ball:
    """The array, of one or two dimensions, as exact numbers."""
    values = np.real(values).reshape(values.shape[0], -1)
    return _flint().arb_mat(*values.shape, values.ravel().tolist())


def _sum(terms: Iterable[_Ball], kind: _Ball = None) -> _Ball:
    return sum(terms, (kind or _flint().arb)(0))


def _frobenius(matrix: _Ball) -> _Ball:
    return _sum(a * a for a in matrix.entries()).sqrt()


def _inner(left: Numbers, right: Numbers) -> _Ball:
    """Re <left, right>."""
    pairs = zip(real_rows(left).tolist(), real_rows(right).tolist(), strict=True)
    return _sum(_flint().arb(a) * b for a, b in pairs)


@functools.singledispatch
def _largest_product(sarason: SarasonMap, S: Real, level: float) -> _Ball:
    """Above ||Y||_*, Y = S - A S A': with any U, s, V it is at most sum|s| ||U|| ||V|| + sqrt(n) ||Y - U diag(s) V'||_F."""
    arb = _flint().arb
    if not S.size:
        return arb(0)
    Y = _matrix(S) - _moved(sarason, S)
    U, s, Vt = np.linalg.svd(np.array([float(a.mid()) for a in Y.entries()]).reshape(S.shape), full_matrices=False)
    left, right, scaled = _matrix(U), _matrix(Vt), _flint().arb_mat(s.size, s.size, np.diag(s).ravel().tolist())
    rest = Y - left * scaled * right
    total = _sum(arb(a) for a in s.tolist())
    return total * _norm_above(left) * _norm_above(right.transpose()) + arb(s.size).sqrt() * _frobenius(rest)


@_largest_product.register
def _(sarason: PassiveMap, S: Real, level: float) -> _Ball:
    """<Y, X> <= tr(N) + sqrt(n) ||Y + N||_F ||X|| with any N = U diag(s) U', s >= 0, since X + X' >= -2 I."""
    arb = _flint().arb
    if not S.size:
        return arb(0)
    Y = _matrix(S) - _moved(sarason, S)
    middle = np.array([float(a.mid()) for a in Y.entries()]).reshape(S.shape)
    values, U = np.linalg.eigh((middle + middle.T) / 2)
    root = _matrix(U * np.sqrt(np.maximum(-values, 0.0)))
    rest = Y + root * root.transpose()
    trace = _sum(a * a for a in root.entries())
    return trace + arb(values.size).sqrt() * _frobenius(rest) * sarason.largest(level)


@functools.singledispatch
def _moved(sarason: SarasonMap, S: Real) -> _Ball:
    """A S A', for MIMO with A (x) I."""
    (p, q), A = sarason.entries.shape, sarason.pair.A
    return _matrix(np.kron(A, np.eye(p))) * _matrix(S) * _matrix(np.kron(A, np.eye(q))).transpose()


@_moved.register
def _(sarason: ShiftMap, S: Real) -> _Ball:
    p, q = sarason.entries.shape
    return _matrix(np.pad(S[p:, q:], ((0, p), (0, q))))


def _norm_above(Q: _Ball) -> _Ball:
    """Above ||Q|| of an almost orthogonal matrix: ||Q||^2 <= 1 + ||Q'Q - I||."""
    n = Q.ncols()
    identity = _flint().arb_mat(n, n, np.eye(n).ravel().tolist())
    return (1 + _frobenius(Q.transpose() * Q - identity)).sqrt()


def _mismatched(samples: Numbers, S: Real, rows: Rows, sarason: SarasonMap, level: float, wanted: Real) -> _Ball:
    """Above r ||wanted + E'l - c S||, r the largest norm of x."""
    arb, entries = _flint().arb, sarason.entries
    if not wanted.size:
        return arb(0)
    row_of_inputs: Real = sarason.pair.c[0]
    inputs = np.kron(row_of_inputs, np.eye(entries.outputs))
    proved = (_matrix(inputs) * _matrix(S)).entries()  # p x nq, in the order (output, coefficient, input)
    row = np.arange(len(proved)).reshape(entries.outputs, -1, entries.inputs).transpose(0, 2, 1)
    if not entries.symmetric:
        column = [proved[k] for k in row.ravel()]
    else:
        column: list[_Ball] = []
        for a, b in itertools.combinations_with_replacement(range(entries.outputs), 2):
            for one, two in zip(row[a, b], row[b, a], strict=True):
                column.append(proved[one] if a == b else (proved[one] + proved[two]) * HALF)
    rest = _matrix(wanted) + _adjoint(rows.E, samples) - _flint().arb_mat(len(column), 1, column)
    reach = arb(min(entries.outputs, entries.inputs)).sqrt() * (1 + 4 * _EPS)
    return _frobenius(rest) * reach * sarason.largest(level)


@functools.singledispatch
def _adjoint(E: Columns, samples: Numbers) -> _Ball:
    """Re E^H l, as a column."""
    re, im = _transposed(E)
    return re * _matrix(np.real(samples)) + im * _matrix(np.imag(samples))


@_adjoint.register
def _(E: BlockColumns, samples: Numbers) -> _Ball:
    total = [_flint().arb(0)] * E.shape[1]
    for part in E.parts:
        found = _adjoint(part.block, samples[part.rows]).entries()
        for k, value in zip(range(*part.columns.indices(E.shape[1])), found, strict=True):
            total[k] += value
    return _flint().arb_mat(len(total), 1, total)


@functools.lru_cache(maxsize=16)
def _transposed(E: Columns) -> tuple[_Ball, _Ball]:
    return _matrix(np.real(E.dense()).T), _matrix(np.imag(E.dense()).T)


@_adjoint.register
def _(E: ShiftColumns, samples: Numbers) -> _Ball:
    """decay_j Re sum_k gain_k conj(l_k + kappa_k conj(l_k)) exp(-i theta_k j), by powers, and the rows that are stored."""
    flint = _flint()
    lines = E.angles.size
    terms: list[_Ball] = []
    turns: list[_Ball] = []
    tilts = np.zeros(lines, complex) if E.tilt is None else E.tilt
    for angle, gain, tilt, sample in zip(
        E.angles.tolist(), _parts(E.gain), _parts(tilts), _parts(samples[:lines]), strict=True
    ):
        at = flint.acb(*sample)
        weight = at + flint.acb(*tilt) * at.conjugate()
        terms.append(flint.acb(*gain) * weight.conjugate())
        turns.append(flint.acb(0, -flint.arb(angle)).exp())
    total: list[_Ball] = []
    for decay in E.decay.tolist():
        total.append(decay * _sum(terms, flint.acb).real)
        terms = [term * turn for term, turn in zip(terms, turns, strict=True)]
    column = flint.arb_mat(len(total), 1, total)
    return column + _matrix(E.real.T) * _matrix(np.real(samples[lines:])) if E.real.shape[0] else column


def _leaked(samples: Numbers, rows: Rows, upper: float, largest: float, wanted: Real) -> _Ball:
    """Above (wanted + P'l)'p over all parameters in their intervals, the free ones of margin <= upper."""
    arb, held = _flint().arb, rows.held
    if not held.size:
        return arb(0)
    slope = (
        _matrix(wanted)
        + _matrix(np.real(rows.P).T) * _matrix(np.real(samples))
        + _matrix(np.imag(rows.P).T) * _matrix(np.imag(samples))
    ).entries()
    total = arb(0)
    for k in np.flatnonzero(held):
        total += (slope[k] * rows.ends[k, 0]).max(slope[k] * rows.ends[k, 1])
    free = _sum(slope[k] ** 2 for k in np.flatnonzero(~held)).sqrt()
    return total + (free * _parameter_bound(upper, largest, rows) if not held.all() else arb(0))


def _parameter_bound(upper: float, largest: float, rows: Rows) -> _Ball:
    """Above ||p|| of the free parameters with margin <= upper."""
    # p = L P p + (I - L P) p with any L, hence ||p|| <= ||L|| ||P p|| / (1 - ||I - L P||), and P p = y - E x - e - (the
    # others).
    arb = _flint().arb
    P = real_rows(rows.P[:, ~rows.held])
    inverse, count = np.linalg.pinv(P), P.shape[1]
    identity = _flint().arb_mat(count, count, np.eye(count).ravel().tolist())
    off = _frobenius(_matrix(inverse) * _matrix(P) - identity)
    if not off < 1:
        return arb.pos_inf()
    reach = _norm(rows.y) + upper * arb(rows.cones).sqrt()
    reach += _larger(rows.E.norm, math.prod(rows.E.shape)) * _larger(rows.reach, 1) * largest
    reach += _norm(rows.tail)
    reach += _norm(rows.P[:, rows.held]) * _norm(np.abs(rows.ends[rows.held]).max(axis=1, initial=0.0))
    return _norm(inverse) * reach / (1 - off)


def _norm(values: Numbers) -> _Ball:
    """Above the Frobenius norm."""
    return _larger(float(np.linalg.norm(values)), values.size)


def _larger(norm: float, count: int) -> _Ball:
    """A norm of so many numbers, computed in doubles, with its rounding."""
    return _flint().arb(norm) * (1 + 4 * (count + 2) * _EPS)
