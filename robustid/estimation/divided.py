"""Response of a plant in a loop: that of its output to the reference over that of its input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real
from robustid.errors import InputError

_OUTSIDE = 0.05  # chance that the error of any line is larger than what it is widened for
_MOST = 0.8  # of the answer of the inputs: errors beyond which a line tells nothing by itself
_AROUND = 9  # lines whose scatter is taken together


def divided(values: np.ndarray, covariance: np.ndarray, ny: int) -> tuple[np.ndarray, np.ndarray]:
    """``G = G_y G_u^{-1}`` from the responses of (y, u) to the reference; dG = (dG_y - G dG_u) G_u^{-1} to first order."""
    to_u = values[:, ny:]
    inverse = np.linalg.inv(to_u)
    response = values[:, :ny] @ inverse
    mix = np.concatenate([np.broadcast_to(np.eye(ny), (len(values), ny, ny)), -response], axis=2)
    jacobian = np.einsum("fba,fcd->facbd", inverse, mix).reshape(len(values), response[0].size, -1)
    return response, jacobian @ covariance @ jacobian.conj().swapaxes(1, 2)


def widening(values: np.ndarray, covariance: np.ndarray, ny: int, dof: float) -> tuple[Real, NDArray[np.bool_]]:
    """Factors (f,) on the covariance of `divided` for what the first order leaves out; and lines that tell the response."""
    lines, nz, nu = values.shape
    inverse = np.linalg.inv(values[:, ny:])
    of_u = covariance.reshape(lines, nu, nz, nu, nz)[:, :, ny:, :, ny:]
    return factors(np.einsum("fba,fjajc,fbc->f", inverse, of_u, inverse.conj(), optimize=True).real, dof)


def some_told(told: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the lines that tell the response; refused where none does."""
    if not np.any(told):
        raise InputError(
            "`record`: the reference moves the inputs at no spectral line surely more than noise does; give a larger reference,"
            " or a longer record"
        )
    return told


def factors(square: Real, dof: Real | float) -> tuple[Real, NDArray[np.bool_]]:
    """Factors (f,) on the covariance of G to first order, by E ||D||^2 with ``D = G_u^{-1} dG_u``; and lines that tell G.

    The error of the quotient is that of first order, about the quotient that was found, and itself times D: with ||D|| <= d < 1 it
    is at most 1/(1 - d) times the first order. d is the size of D, in the norm of Frobenius, that it exceeds in no line but by
    chance: of errors with F-distributed squares, of 2 and 2 dof degrees of freedom. Beyond, where both answers are of noise alone,
    the quotient is near the inverse of the controller, and its error to first order next to nothing. In a loop with one noise at
    its output, and a reference that drives the line, the factor is 1 + q s/|G_u|, of the true G_u and deviations s: five, which
    is the most, holds it up to 4.
    """
    quantile = dof * ((_OUTSIDE / square.size) ** (-1 / dof) - 1)
    size: Real = np.sqrt(quantile * np.maximum(square, 0))
    return 1 / (1 - np.minimum(size, _MOST)) ** 2, size < _MOST


def spread_of_inputs(u: np.ndarray, base: np.ndarray) -> Real:
    """E ||D||^2 (f,) of the mean of the answers ``u base`` of inputs (f, B, P, nu, E) in B blocks and P periods, by their scatter.

    Means over neighbouring lines: a few periods say little of a line.
    """
    answers = u @ base[:, :, None]
    mean, count = answers.mean(axis=(1, 2), keepdims=True), u.shape[1] * u.shape[2]
    apart = np.asarray(np.linalg.inv(mean) @ (answers - mean), dtype=complex)
    square: Real = np.sum(np.abs(apart) ** 2, axis=(1, 2, 3, 4)) / (max(count - 1, 1) * count)
    around = np.ones(min(_AROUND, square.size))
    return np.convolve(square, around, "same") / np.convolve(np.ones(square.size), around, "same")
