"""Response of a plant in a loop: that of its output to the reference over that of its input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real

_OUTSIDE = 0.05  # chance that the error of any line is larger than what it is widened for
_UNKNOWN, _MOST = (
    0.5,
    0.99,
)  # of the answer of the inputs: errors with which a line tells nothing; and where it is asked for


def divided(values: np.ndarray, covariance: np.ndarray, ny: int) -> tuple[np.ndarray, np.ndarray]:
    """``G = G_y G_u^{-1}`` from the responses of (y, u) to the reference; dG = (dG_y - G dG_u) G_u^{-1} to first order."""
    to_u = values[:, ny:]
    inverse = np.linalg.inv(to_u)
    response = values[:, :ny] @ inverse
    mix = np.concatenate([np.broadcast_to(np.eye(ny), (len(values), ny, ny)), -response], axis=2)
    jacobian = np.einsum("fba,fcd->facbd", inverse, mix).reshape(len(values), response[0].size, -1)
    return response, jacobian @ covariance @ jacobian.conj().swapaxes(1, 2)


def widening(values: np.ndarray, covariance: np.ndarray, ny: int, dof: float) -> tuple[Real, NDArray[np.bool_]]:
    """Factors (f,) on the covariance of `divided` for what the first order leaves out; and lines that tell the response.

    dG = (dG_y - G dG_u) (G_u + dG_u)^{-1}, and with ``D = G_u^{-1} dG_u``, ||D|| <= d < 1, that is at most 1/(1 - d) times the
    first order. In a loop with noise at its output D and dG have one cause: the factor is reached. d is the size of D, in the norm
    of Frobenius, that it exceeds in no line but by chance: of errors with F-distributed squares, of 2 and 2 dof degrees of freedom.
    Where d is near 1 nothing is known: G is anything, and to first order the inverse of the controller.
    """
    lines, nz, nu = values.shape
    inverse = np.linalg.inv(values[:, ny:])
    of_u = covariance.reshape(lines, nu, nz, nu, nz)[:, :, ny:, :, ny:]
    square = np.einsum("fba,fjajc,fbc->f", inverse, of_u, inverse.conj(), optimize=True).real
    quantile = dof * ((_OUTSIDE / lines) ** (-1 / dof) - 1)
    size: Real = np.sqrt(quantile * np.maximum(square, 0))
    return 1 / (1 - np.minimum(size, _MOST)) ** 2, size < _UNKNOWN
