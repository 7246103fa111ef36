"""Ellipses in the complex plane as tilted discs: {e : |e + kappa conj(e)| <= bound}, |kappa| < 1."""

from __future__ import annotations

import numpy as np

from robustid.core import as_array
from robustid.errors import InputError

_ROUND = 1e-14  # an eigenvalue below this part of the other one is rounding


def tilted(values: np.ndarray, tilt: np.ndarray | None) -> np.ndarray:
    """The values e as e + kappa conj(e): a linear map that turns an ellipse into a disc; further axes of `values` follow."""
    if tilt is None:
        return values
    return values + tilt.reshape(tilt.shape + (1,) * (values.ndim - tilt.ndim)) * values.conj()


def bound_ratio(error: np.ndarray, bound: np.ndarray, tilt: np.ndarray | None = None) -> np.ndarray:
    """|error + kappa conj(error)|/bound, |error|/bound without kappa: at most 1 where a sample is inside its bound."""
    return np.abs(tilted(error, tilt)) / bound


def as_tilt(value: object, shape: tuple[int, ...], bound: np.ndarray | None) -> np.ndarray | None:
    """The kappa of every sample, (F, ny, nu), checked; None where there is none."""
    if value is None:
        return None
    if bound is None:
        raise InputError("`tilt` is the shape of `bound`, which is missing; give both or none")
    tilt = as_array("tilt", value, dtype=complex)
    if tilt.shape == shape[:1]:
        tilt = tilt.reshape(shape[:1] + (1,) * (len(shape) - 1))
    elif tilt.shape != shape:
        raise InputError(f"`tilt` must have shape (F,) = {shape[:1]} or {shape}; got {tilt.shape}")
    if not np.abs(tilt).max() < 1:
        raise InputError(
            f"`tilt` must be smaller than 1 in modulus (at 1 the ellipse is endless); got {np.abs(tilt).max():.9g}"
        )
    return np.broadcast_to(tilt, shape)


def ellipse_of(covariance: object, lines: int, deviations: float) -> tuple[np.ndarray, np.ndarray]:
    """Bound and kappa, (F,) each, of the ellipses e'C^-1 e <= deviations^2 for e = (Re e, Im e).

    With s1 >= s2 the roots of the eigenvalues of C: bound = 2 deviations s1 s2/(s1 + s2) and
    kappa = -(C11 - C22 + 2j C12)/(s1 + s2)^2, since |e + kappa conj(e)| <= bound has the semi-axes bound/(1 + |kappa|), in the
    direction arg(kappa)/2, and bound/(1 - |kappa|), across.
    """
    C = as_array("covariance", covariance)
    if C.shape != (lines, 2, 2):
        raise InputError(f"`covariance` must have shape (F, 2, 2) = {(lines, 2, 2)}; got {C.shape}")
    if not np.allclose(C, C.swapaxes(1, 2), rtol=1e-9, atol=0):
        raise InputError("`covariance` must be symmetric at every line: of (Re e, Im e)")
    small, large = np.linalg.eigvalsh(C).T
    bad = ~(small > _ROUND * large)
    if np.any(bad):
        raise InputError(
            f"`covariance` must be positive definite; line {int(np.argmax(bad))} has the eigenvalues {small[bad][0]:.3g} and"
            f" {large[bad][0]:.3g}. Give every direction an uncertainty"
        )
    small, large = np.sqrt(small), np.sqrt(large)
    tilt = -(C[:, 0, 0] - C[:, 1, 1] + 2j * C[:, 0, 1]) / (small + large) ** 2
    return 2 * deviations * small * large / (small + large), tilt
