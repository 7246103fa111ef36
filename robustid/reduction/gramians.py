r"""Stable and unstable part of a model, and factors of its Gramians straight from the Stein or Lyapunov equation.

Also those of a part of the frequencies or of the time, or seen through a weight. In coordinates in which the controllability
Gramian is the identity A is a contraction (in continuous time dissipative), and the part of the Gramian that a band or a horizon T
holds is a matrix between 0 and I, a function of A alone:

.. math:: S + S^T,\quad S(\omega) = \tfrac1\pi\,\mathrm{Im}\ln(j\omega I - A)
   \quad\text{or}\quad \tfrac{\theta}{2\pi} I + \tfrac1\pi\,\mathrm{Im}\ln(I - e^{-j\theta}A),
   \qquad\text{and}\quad I - e^{AT}e^{A^TT}

`gawronski1990`, with the difference of S at both ends of the band. The observability Gramian is the dual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Real, as_array, as_positive, balancing, counted, scaled_states
from robustid.errors import InputError
from robustid.identification import check_model, describe_poles

if TYPE_CHECKING:
    import control

_EPS = np.finfo(float).eps

# A double integrator, rounded in any coordinates, moves by about the square root of eps.
MOST_DOUBT = 1e-7

# Rows solved at a time: small enough that copies of a diagonal block cost nothing, large enough to call BLAS rarely.
_BLOCK = 96

Factors = tuple[Real, Real]

# A column of Hammarling's method: its diagonal entry, the entries above, and what the rows of B above change by along b_j.
_Parts = tuple[float, Complex, Complex]
_Column = Callable[[Complex, Complex, complex, float, Complex], _Parts]
Share = Callable[[Real], Real]


class Parts(NamedTuple):
    """A, B and C of a part of a model."""

    a: Real
    b: Real
    c: Real


def split(model: control.StateSpace, unstable: str) -> tuple[Parts, Parts]:
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


def is_stable(a: Real, dt: float | None) -> tuple[Complex, NDArray[np.bool_]]:
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
    move = np.minimum(10 * a.shape[0] * _EPS / np.maximum(cosine, _EPS), MOST_DOUBT)
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
    """Upper triangular T and unitary Q, a = Q T Q^H, from the real form, in a third of the time of a complex iteration: LAPACK
    leaves every pair as [[p, b], [c, p]] with b c < 0, whose eigenvectors and poles p ± i sqrt(-b c) are written down. The
    damping p comes through exactly.
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


def partial_gramian_factors(
    model: control.StateSpace,
    stable: Parts,
    *,
    band_hz: tuple[float, float] | None,
    horizon: float | None,
    weight: control.StateSpace | None,
) -> Factors:
    """Factors of the Gramians of the stable part of `model`, for the one of the three that isn't None."""
    if weight is not None:
        return _weighted_factors(stable, model, weight)
    share = _horizon_share(model, horizon) if band_hz is None else _band_share(model, band_hz)
    # limited: from coordinates in which the whole one is the identity, where nothing cancels
    balanced = balancing(*gramian_factors(stable, discrete=model.dt != 0))
    hankel = balanced.hankel
    order = int(np.sum(hankel > hankel.size * _EPS * np.max(hankel, initial=0.0)))
    left, right = balanced.coordinates(order)
    if not order:
        return left, right
    hankel = hankel[:order]
    a = left.T @ stable.a @ right
    return left @ _root(share((a / hankel).T)), right @ _root(share(a / hankel[:, None]))


def _band_share(model: control.StateSpace, band_hz: tuple[float, float] | None) -> Share:
    """The part between two frequencies in Hz of a Gramian that is the identity, a function of A."""
    band = as_array("band_hz", band_hz, ndim=1, finite=False)
    if band.size != 2 or not 0 <= band[0] < band[1]:
        raise InputError(
            f"`band_hz` must be (low, high) in Hz with 0 <= low < high, high = inf for no end; got {band_hz!r}"
        )
    step = _sample_time("band_hz", model)
    if step and np.isfinite(band[1]) and band[1] > 0.5 / step * (1 + 1e-9):
        raise InputError(f"`band_hz` must end at or below the Nyquist frequency, {0.5 / step:g} Hz; got {band[1]:g} Hz")
    omega = 2 * np.pi * band

    def share(a: Real) -> Real:
        low, high = (_below(a, edge, step) for edge in omega)
        return high - low + (high - low).T

    return share


def _below(a: Real, omega: float, step: float) -> Real:
    """S of the frequencies from 0 to omega."""
    eye = np.eye(a.shape[0])
    if omega == 0:
        return 0 * eye
    if np.isinf(omega) or (step and omega * step >= np.pi):
        return eye / 2
    if step:
        return (
            omega * step / (2 * np.pi) * eye + np.imag(scipy.linalg.logm(eye - np.exp(-1j * omega * step) * a)) / np.pi
        )
    return np.imag(scipy.linalg.logm(1j * omega * eye - a)) / np.pi


def _horizon_share(model: control.StateSpace, horizon: float | None) -> Share:
    """The part of the first seconds of a Gramian that is the identity, a function of A."""
    seconds, step = as_positive("horizon", horizon), _sample_time("horizon", model)
    samples = int(seconds / step * (1 + 1e-9)) if step else 0
    if step and not samples:
        raise InputError(f"`horizon` must hold a sample, {step:g} s, at least; got {seconds:g} s")

    def share(a: Real) -> Real:
        over = np.linalg.matrix_power(a, samples) if step else scipy.linalg.expm(a * seconds)
        return np.eye(a.shape[0]) - over @ over.T

    return share


def _sample_time(name: str, model: control.StateSpace) -> float:
    if model.dt is True:
        raise InputError(f"`{name}` needs the sample time of `model` in s; its dt is True")
    return float(model.dt or 0)  # None: without states


def _root(share: Real) -> Real:
    """A factor of a matrix between 0 and I, without what is rounding of the I."""
    values, vectors = scipy.linalg.eigh(share)
    held = values > share.shape[0] * _EPS
    return vectors[:, held] * np.sqrt(values[held])


def _weighted_factors(parts: Parts, model: control.StateSpace, weight: control.StateSpace) -> Factors:
    """The observability Gramian of weight times model, in the states of the model, with its own controllability Gramian."""
    weight = check_model("weight", weight)
    outputs = model.noutputs
    if weight.ninputs not in {1, outputs} or (weight.ninputs == 1 and weight.noutputs > 1 < outputs):
        raise InputError(
            f"`weight` must be SISO, or have the {counted(outputs, 'output')} of `model` as its inputs; got {weight.noutputs} x"
            f" {weight.ninputs}"
        )
    if weight.nstates and model.nstates and weight.dt != model.dt:
        raise InputError(f"`weight` must have the time base of `model`, dt = {model.dt}; got dt = {weight.dt}")
    own = Parts(*scaled_states(weight.A, weight.B, weight.C))
    poles, stable = is_stable(own.a, weight.dt)
    if not np.all(stable):
        raise InputError(f"`weight` must be stable; it has {describe_poles(poles[~stable], weight.dt)}")
    copies = np.eye(1 if weight.ninputs == outputs else outputs)
    a, b, c, d = (np.asarray(np.kron(copies, matrix), dtype=float) for matrix in (*own, weight.D))
    corner = np.zeros((parts.a.shape[0], a.shape[0]))
    both = Parts(
        np.block([[parts.a, corner], [b @ parts.c, a]]),
        np.zeros((corner.shape[0] + a.shape[0], 0)),
        np.hstack([d @ parts.c, c]),
    )
    discrete = model.dt != 0
    plain = gramian_factors(parts, discrete=discrete)
    if parts.a.size == 0:  # a static model has no time base for the weight
        return plain
    seen, _ = gramian_factors(both, discrete=discrete)
    return seen[: parts.a.shape[0]], plain[1]
