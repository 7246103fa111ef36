"""Stable and unstable part of a model, and factors of its Gramians straight from the Stein or Lyapunov equation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Real, scaled_states
from robustid.errors import InputError
from robustid.identification import describe_poles

_EPS = np.finfo(float).eps

# A double integrator, rounded in any coordinates, moves by about the square root of eps.
_MOST_DOUBT = 1e-7

# Rows solved at a time: small enough that copies of a diagonal block cost nothing, large enough to call BLAS rarely.
_BLOCK = 96


Factors = tuple[Real, Real]

# A column of Hammarling's method: its diagonal entry, the entries above, and what the rows of B above change by along b_j.
_Parts = tuple[float, Complex, Complex]
_Column = Callable[[Complex, Complex, complex, float, Complex], _Parts]


class Parts(NamedTuple):
    """A, B and C of a part of a model."""

    a: Real
    b: Real
    c: Real


def split(model: Any, unstable: str) -> tuple[Parts, Parts]:
    """Stable and unstable part, in coordinates of balanced scales; the feedthrough belongs to neither."""
    parts = Parts(*scaled_states(model.A, model.B, model.C))
    poles, stable = is_stable(parts.a, model.dt)
    if np.all(stable):
        return parts, Parts(np.zeros((0, 0)), np.zeros((0, model.ninputs)), np.zeros((model.noutputs, 0)))
    if unstable == "refuse":
        raise InputError(
            f"`model` must be stable to be reduced; it has {describe_poles(poles[~stable], model.dt)} on or"
            ' beyond the stability boundary. Pass unstable="keep" to keep those states and reduce the others'
        )

    # LAPACK reorders with slightly different poles: each is judged as the nearest of those judged above.
    def leads(real: float, imag: float = 0.0) -> bool:
        return bool(stable[np.argmin(np.abs(poles - complex(real, imag)))])

    schur, basis, first = scipy.linalg.schur(parts.a, output="real", sort=leads)
    b, c = basis.T @ parts.b, parts.c @ basis
    a, coupling, rest = schur[:first, :first], schur[:first, first:], schur[first:, first:]
    x = scipy.linalg.solve_sylvester(a, -rest, -coupling)  # a x - x rest = -coupling decouples the blocks
    kept = Parts(rest, b[first:], c[:, first:] + c[:, :first] @ x)
    return Parts(a, b[:first] - x @ b[first:], c[:, :first]), kept


def is_stable(a: Real, dt: Any) -> tuple[Complex, NDArray[np.bool_]]:
    """Poles, and which of them lie inside the stability boundary by more than rounding."""
    poles, doubt = doubtful_distance(a)
    distance = -np.real(poles) if dt == 0 else 1 - np.abs(poles)
    return poles, distance > doubt


def doubtful_distance(a: Real) -> tuple[Complex, Real]:
    """Poles, and how far rounding may have moved each: the pair of a rigid body far, a simple pole hardly.

    First-order perturbation, n eps |A| over the cosine between left and right eigenvector, capped where the
    first order fails (defective poles: their distance grows with a root of eps only).
    """
    if a.size == 0:
        return np.zeros(0, dtype=complex), np.zeros(0)
    poles, left, right = scipy.linalg.eig(a, left=True, right=True)
    cosine = np.abs(np.sum(left.conj() * right, axis=0))
    move = np.minimum(10 * a.shape[0] * _EPS / np.maximum(cosine, _EPS), _MOST_DOUBT)
    return poles, move * np.linalg.norm(a, 2)


def gramian_factors(parts: Parts, *, discrete: bool) -> Factors:
    """Real factors: observability Gramian = left left', controllability Gramian = right right'."""
    if parts.a.size == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    schur, basis = _complex_schur(parts.a)
    column = _discrete_column if discrete else _continuous_column
    right = basis @ _hammarling(schur, basis.conj().T @ parts.b, column)
    # The dual equation has A^H; reversing the order of the states makes it upper triangular again.
    dual = _hammarling(schur.conj().T[::-1, ::-1], (parts.c @ basis).conj().T[::-1], column)
    return _real_factor(basis @ dual[::-1]), _real_factor(right)


def _complex_schur(a: Real) -> tuple[Complex, Complex]:
    """Upper triangular T and unitary Q, a = Q T Q^H: from the real form, in a third of the time of a complex iteration.

    LAPACK leaves every pair as [[p, b], [c, p]] with b c < 0, whose eigenvectors and poles p ± i sqrt(-b c) are written down:
    the damping p comes through exactly.
    """
    schur, basis = (matrix.astype(complex) for matrix in scipy.linalg.schur(a, output="real"))
    first = np.flatnonzero(np.diagonal(schur, -1))
    second = first + 1
    upper, lower = schur[first, second].real, schur[second, first].real
    poles = schur[first, first].real + 1j * np.sqrt(np.abs(upper)) * np.sqrt(np.abs(lower))
    size = np.sqrt(np.abs(upper) + np.abs(lower))
    x, y = np.sign(upper) * np.sqrt(np.abs(upper)) / size, 1j * np.sqrt(np.abs(lower)) / size  # x real, y imaginary
    for matrix in (schur, basis):
        left, right = matrix[:, first], matrix[:, second]
        matrix[:, first], matrix[:, second] = left * x + right * y, left * y + right * x
    above, below = schur[first], schur[second]
    schur[first], schur[second] = x[:, None] * above - y[:, None] * below, x[:, None] * below - y[:, None] * above
    schur[first, first], schur[second, second], schur[second, first] = poles, poles.conj(), 0
    return schur, basis


def _real_factor(factor: Complex) -> Real:
    return np.asarray(np.linalg.qr(np.hstack([np.real(factor), np.imag(factor)]).T, mode="r")).T


def _hammarling(a: Complex, b: Complex, column: _Column) -> Complex:
    """Upper triangular U, U U^H the controllability Gramian of (A, B), A upper triangular: its columns, the last one first.

    What a column leaves of the equation is that of the states before it, with another B.
    """
    a, b = np.asarray(a), b.astype(complex)
    u = np.zeros_like(a, dtype=complex)
    for j in range(a.shape[0] - 1, -1, -1):
        norm = np.linalg.norm(b[j])
        if norm == 0:
            continue  # the state is not reached: its row and column of the Gramian are zero
        direction = b[j] / norm
        above, beside, pole = a[:j, :j], a[:j, j], a[j, j]
        u[j, j], u[:j, j], change = column(above, beside, pole, float(norm), b[:j] @ direction.conj())
        b[:j] += np.outer(change, direction)
    return u


def _continuous_column(above: Complex, beside: Complex, pole: complex, norm: float, along: Complex) -> _Parts:
    """Column of the U with A U U^H + U U^H A^H + B B^H = 0, Re diag(A) < 0."""
    alpha = np.sqrt(-2 * pole.real)
    last = norm / alpha
    x = _solve_shifted(above, pole.conjugate(), 1.0, -beside * last - alpha * along)
    return last, x, -alpha * x


def _discrete_column(above: Complex, beside: Complex, pole: complex, norm: float, along: Complex) -> _Parts:
    """Column of the U with A U U^H A^H - U U^H + B B^H = 0, |diag(A)| < 1."""
    beta = np.sqrt((1 - abs(pole)) * (1 + abs(pole)))
    last = norm / beta
    x = _solve_shifted(above, 1.0, -pole.conjugate(), pole.conjugate() * beside * last + beta * along)
    return last, x, beta * (above @ x + beside * last) - pole * along - along


def _solve_shifted(a: Complex, shift: complex, factor: complex, right: Complex) -> Complex:
    """Solve (shift I + factor A) x = right, A upper triangular: by blocks, since a copy of A a column would take the time."""
    x = right
    for end in range(right.size, 0, -_BLOCK):
        rows = slice(max(0, end - _BLOCK), end)
        matrix = factor * a[rows, rows]
        matrix[np.diag_indices_from(matrix)] += shift
        x[rows] = scipy.linalg.solve_triangular(matrix, x[rows], check_finite=False)
        x[: rows.start] -= factor * (a[: rows.start, rows] @ x[rows])
    return x
