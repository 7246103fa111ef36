"""Rational model of one output of records, with the transient of each: spectra of whole records, no windows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robustid.core import Complex, Real, real_rows
from robustid.estimation.pole_fit import companion, fractions

_ORDERS = (4, 8, 14, 20)
_RELOCATIONS, _A_POLE = 6, 6  # of the poles; spectral lines for each
_INSIDE, _SETTLED = 1 - 1e-9, 0.99
_CARRIES = 1e-2  # part of the largest amplitude of the inputs, over neighbours, from which on a line is used
_NEIGHBOURS = 9


class Piece(NamedTuple):
    """Spectra of a part of a record: z (F,), inputs (F, nu), one output (F,)."""

    z: Complex
    inputs: Complex
    output: Complex


class Fitted(NamedTuple):
    """Poles, and the squares that a model leaves of all pieces; their number less the unknowns; the part of the outputs."""

    poles: Complex
    cost: float
    spare: float
    part: float
    criterion: float

    @property
    def noise(self) -> float:
        """Mean square of what is left."""
        return self.cost / self.spare


def spectra_of(u: Real) -> Complex:
    """Spectra (T/2 + 1, nu) of inputs (T, nu) less their mean."""
    return np.fft.rfft(u - u.mean(axis=0), axis=0)


def carrying_lines(spectra: Complex, samples: int) -> np.ndarray:
    """Spectral lines that inputs of so many samples carry, by their spectra; without that of zero frequency."""
    size = np.sum(np.abs(spectra) ** 2, axis=1)
    size[0] = 0
    if samples % 2 == 0:
        size[-1] = 0
    near = np.convolve(size, np.ones(_NEIGHBOURS) / _NEIGHBOURS, mode="same")
    lines = np.flatnonzero((near >= _CARRIES**2 * near.max()) & (size > _CARRIES**2 * near.max()))
    return lines[lines > 0]


def piece(spectra: Complex, y: Real, lines: np.ndarray) -> Piece:
    """Inputs, by their spectra, and an output (T,) at spectral lines."""
    return Piece(np.exp(2j * np.pi * lines / y.size), spectra[lines], np.fft.rfft(y)[lines])


def fitted(
    pieces: Sequence[Piece], *, starts: Sequence[Complex] = (), orders: Sequence[int] = _ORDERS
) -> Fitted | None:
    """Model of all pieces, of the order with the smallest Bayesian information criterion; None where lines are too few."""
    count = sum(one.z.size for one in pieces)
    best, least = None, np.inf
    for order in orders:
        if order * _A_POLE > count or (found := _of_order(pieces, order, ())) is None:
            break
        if found.criterion >= least:
            break
        best, least = found, found.criterion
    for start in starts:
        found = _of_order(pieces, 0, (start,))
        if found is not None and found.criterion < least:
            best, least = found, found.criterion
    return best


def predictions_with(pieces: Sequence[Piece], poles: Complex) -> list[Complex]:
    """Predictions of the pieces by the best model with these poles, without their transients."""
    reduced = _reduced(pieces, poles)
    rows, rights = np.concatenate([one.rows for one in reduced]), np.concatenate([one.right for one in reduced])
    c = scaled_solution(rows, rights)
    return [one.block @ c for one in reduced]


class _Reduced(NamedTuple):
    """A piece with poles: functions (F, n + 1), those times the inputs; an orthonormal basis of transients, and what is beside it:
    of the block (2F, nu (n + 1)), and of the output (2F,).
    """

    functions: Complex
    block: Complex
    transients: Real
    rows: Real
    right: Real

    def beside(self, rows: Real) -> Real:
        """Rows less their best fit by a transient."""
        return rows - self.transients @ (self.transients.T @ rows)


def _reduced(pieces: Sequence[Piece], poles: Complex) -> list[_Reduced]:
    found: list[_Reduced] = []
    for one, before in zip(pieces, [None, *pieces], strict=False):
        if before is not None and np.array_equal(one.z, before.z):  # parts of one length have the same functions
            f, q = found[-1].functions, found[-1].transients
        else:
            f = _functions(one.z, poles)
            q = np.linalg.qr(real_rows(f))[0]
        block = np.hstack([f * one.inputs[:, [j]] for j in range(one.inputs.shape[1])])
        a, b = real_rows(block), real_rows(one.output)
        found.append(_Reduced(f, block, q, a - q @ (q.T @ a), b - q @ (q.T @ b)))
    return found


def without_transient(z: Complex, poles: Complex, values: Complex) -> Real:
    """Values, real then imaginary, less their best fit by a transient."""
    q = np.linalg.qr(real_rows(_functions(z, poles)))[0]
    real = real_rows(values)
    return real - q @ (q.T @ real)


def _of_order(pieces: Sequence[Piece], order: int, starts: Sequence[Complex]) -> Fitted | None:
    """Poles relocated from pairs over the band, or from others."""
    angles = np.concatenate([np.angle(one.z) for one in pieces])
    low, high = float(angles.min()), float(angles.max())
    middle = np.linspace(low, high, order // 2 + 2)[1:-1]
    poles = starts[0] if starts else np.exp(middle * (1j - 0.02))
    nu, power = pieces[0].inputs.shape[1], sum(float(np.sum(np.abs(one.output) ** 2)) for one in pieces)
    best: tuple[float, Complex] = (np.inf, poles)
    for _ in range(_RELOCATIONS):
        reduced = _reduced(pieces, poles)
        rows = np.concatenate([one.rows for one in reduced])
        size = np.linalg.norm(rows, axis=0)
        own = np.linalg.qr(rows / np.where(size > 0, size, 1))[0]
        left = np.concatenate([one.right for one in reduced])
        left -= own @ (own.T @ left)
        cost = float(left @ left)
        settled = cost > _SETTLED * best[0]
        if cost < best[0]:
            best = (cost, poles)
        if settled:
            break
        poles = _relocated(pieces, reduced, own, left, poles)
    degree = best[1].size + int(np.sum(np.imag(best[1]) != 0))
    unknowns = degree + (nu + len(pieces)) * (degree + 1)
    spare = 2 * sum(one.z.size for one in pieces) - unknowns
    if spare <= unknowns / 2 or not np.isfinite(best[0]) or power == 0:
        return None
    count = 2 * sum(one.z.size for one in pieces)
    criterion = count * float(np.log(max(best[0], 1e-300) / count)) + unknowns * float(np.log(count))
    return Fitted(best[1], best[0], float(spare), best[0] / power, criterion)


def _relocated(pieces: Sequence[Piece], reduced: Sequence[_Reduced], own: Real, left: Real, poles: Complex) -> Complex:
    """Zeros of sigma in sigma Y = N U + T of the same poles (`gustavsen2006`), inside the unit circle.

    With an orthonormal basis of N U beside the transients, and what it leaves of the outputs.
    """
    moving = np.concatenate(
        [
            part.beside(real_rows(part.functions[:, :-1] * one.output[:, None]))
            for one, part in zip(pieces, reduced, strict=True)
        ]
    )
    c = -scaled_solution(moving - own @ (own.T @ moving), left)
    zeros = np.linalg.eigvals(companion(poles, c))
    out = np.abs(zeros) > 1
    zeros[out] = 1 / np.conj(zeros[out])
    zeros *= np.minimum(1, _INSIDE / np.maximum(np.abs(zeros), 1e-300))
    return np.asarray(zeros[np.imag(zeros) >= 0], complex)


def _functions(z: Complex, poles: Complex) -> Complex:
    return np.hstack([fractions(z, poles), np.ones((z.size, 1))]).astype(complex)


def scaled_solution(rows: Real, right: Real) -> Real:
    """Least squares, the columns scaled."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1
    return np.asarray(np.linalg.lstsq(rows / size, right, rcond=None)[0], float) / size
