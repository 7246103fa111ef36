"""Sets in which errors lie: discs, ellipses as tilted discs, ellipsoids of whole matrices; radii that hold with a probability."""

from __future__ import annotations

import numpy as np

from robustid.core import Complex, Real, as_array
from robustid.errors import InputError

_HERMITIAN = 1e-9  # asymmetry of a matrix with ones on its diagonal
_ROUND = 1e-14  # an eigenvalue below this part of the largest one is rounding


def tilted(values: np.ndarray, tilt: np.ndarray | None) -> np.ndarray:
    """The values e as e + kappa conj(e): a linear map that turns an ellipse into a disc; further axes of `values` follow."""
    if tilt is None:
        return values
    return values + tilt.reshape(tilt.shape + (1,) * (values.ndim - tilt.ndim)) * values.conj()


def bound_ratio(error: np.ndarray, bound: np.ndarray, tilt: np.ndarray | None = None) -> np.ndarray:
    """|error + kappa conj(error)|/bound, |error|/bound without kappa: at most 1 where a sample is inside its bound."""
    return np.abs(tilted(error, tilt)) / bound


def stacked(matrices: np.ndarray) -> np.ndarray:
    """(F, ny, nu) to (F, ny*nu), columns stacked."""
    return matrices.transpose(0, 2, 1).reshape(matrices.shape[0], -1)


def variances(covariance: np.ndarray, shape: tuple[int, ...]) -> Real:
    """The diagonal of the covariance of vec(G), columns stacked, as (F, ny, nu)."""
    points, ny, nu = shape
    return np.einsum("fii->fi", covariance).real.reshape(points, nu, ny).transpose(0, 2, 1)


def as_tilt(value: object, shape: tuple[int, ...]) -> Complex:
    """The kappa of every sample, (F, ny, nu), checked."""
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


def as_ellipsoid(value: object, shape: tuple[int, ...]) -> Complex:
    """E of {e : vec(e)^H E^-1 vec(e) <= 1}, (F, ny*nu, ny*nu), Hermitian and positive definite, checked."""
    size = shape[1] * shape[2]
    E: Complex = as_array("ellipsoid", value, dtype=complex)
    if E.shape != (shape[0], size, size):
        raise InputError(f"`ellipsoid` must have shape (F, ny*nu, ny*nu) = {(shape[0], size, size)}; got {E.shape}")
    if np.any(bad := ~np.all(np.einsum("fii->fi", E).real > 0, axis=1)):
        raise InputError(
            f"`ellipsoid` must have positive numbers on its diagonal; frequency point {int(np.argmax(bad))} has not"
        )
    scaled = correlations(E)
    if np.abs(scaled - scaled.conj().swapaxes(1, 2)).max() > _HERMITIAN:
        raise InputError("`ellipsoid` must be Hermitian at every frequency point")
    eigenvalues = np.linalg.eigvalsh(scaled)
    if np.any(bad := ~(eigenvalues[:, 0] > _ROUND * size * eigenvalues[:, -1])):
        raise InputError(
            f"`ellipsoid` must be positive definite; frequency point {int(np.argmax(bad))} has the smallest eigenvalue"
            f" {eigenvalues[bad][0, 0]:.3g} with every diagonal entry scaled to 1. Give every combination of entries an"
            " uncertainty"
        )
    return (E + E.conj().swapaxes(1, 2)) / 2


def correlations(E: Complex) -> Complex:
    """E with its diagonal scaled to 1."""
    radius = np.sqrt(np.einsum("fii->fi", E).real)
    scaled: Complex = E / (radius[:, :, None] * radius[:, None, :])
    return scaled


def ellipse_of(covariance: object, points: int, deviations: float) -> tuple[Real, Complex]:
    """Radius and kappa, (F,) each, of the ellipses e'C^-1 e <= deviations^2 for e = (Re e, Im e)."""
    # With s1 >= s2 the roots of the eigenvalues of C: radius = 2 deviations s1 s2/(s1 + s2) and
    # kappa = -(C11 - C22 + 2j C12)/(s1 + s2)^2, since |e + kappa conj(e)| <= radius has the semi-axes radius/(1 + |kappa|), in the
    # direction arg(kappa)/2, and radius/(1 - |kappa|), across.
    C = as_array("covariance", covariance)
    if C.shape != (points, 2, 2):
        raise InputError(f"`covariance` must have shape (F, 2, 2) = {(points, 2, 2)}; got {C.shape}")
    if not np.allclose(C, C.swapaxes(1, 2), rtol=1e-9, atol=0):
        raise InputError("`covariance` must be symmetric at every frequency point: of (Re e, Im e)")
    small, large = np.linalg.eigvalsh(C).T
    bad = ~(small > _ROUND * large)
    if np.any(bad):
        raise InputError(
            f"`covariance` must be positive definite; frequency point {int(np.argmax(bad))} has the eigenvalues"
            f" {small[bad][0]:.3g} and {large[bad][0]:.3g}. Give every direction an uncertainty"
        )
    small, large = np.sqrt(small), np.sqrt(large)
    tilt = -(C[:, 0, 0] - C[:, 1, 1] + 2j * C[:, 0, 1]) / (small + large) ** 2
    return 2 * deviations * small * large / (small + large), tilt


def joint_radius(
    probability: float, entries: int, dof: float | Real | None, real: np.ndarray | None = None
) -> np.ndarray:
    """Radius over standard deviation that no error exceeds with the probability, whatever the dependence of the entries.

    With s^2 an estimate of the variance with dof degrees of freedom, |e|^2/s^2 is F(2, 2 dof) distributed, ``P(|e|^2 > x s^2) =
    (1 + x/dof)^(-dof)``; alpha = (1 - probability)/entries (Bonferroni). A known variance: exp(-x). At frequency points where all
    is real: Student's t. `dof` may be that of every frequency point, (F,), or entry, (F, ny, nu).
    """
    from scipy.special import ndtri, stdtrit

    alpha = (1 - probability) / entries
    if dof is None:
        radius, student = np.sqrt(-np.log(alpha)), -ndtri(alpha / 2)
    else:
        # expm1 keeps the digits where alpha**(-1/dof) is close to 1.
        radius, student = np.sqrt(dof * np.expm1(-np.log(alpha) / dof)), stdtrit(dof, 1 - alpha / 2)
    if real is None:
        return radius
    of_entries = isinstance(dof, np.ndarray) and dof.ndim == 3
    found = np.asarray(np.where(real[:, None, None] if of_entries else real, student, radius), dtype=float)
    return found if of_entries else found[:, None, None]


def chance_beyond(ratio: Real, dof: Real, real: np.ndarray) -> Real:
    """Probability of an error of so many standard deviations, or more, at its place alone: the inverse of `joint_radius`.

    `ratio` and `dof`, (F, ny, nu), `real` (F,).
    """
    from scipy.special import stdtr

    return np.where(real[:, None, None], 2 * stdtr(dof, -ratio), np.exp(-dof * np.log1p(ratio**2 / dof)))
