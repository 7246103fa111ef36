"""Bounds on the errors of several entries together: of one column, or of the whole matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import as_array
from robustid.data.ellipses import bound_ratio
from robustid.errors import InputError

JOINT = ("entry", "column", "matrix")
_HERMITIAN, _ROUND = 1e-9, 1e-14  # asymmetry, and smallest eigenvalue, of a matrix with ones on its diagonal


def stacked(matrices: np.ndarray) -> np.ndarray:
    """(F, ny, nu) to (F, ny*nu), columns stacked."""
    return matrices.transpose(0, 2, 1).reshape(matrices.shape[0], -1)


def as_ellipsoid(value: Any, shape: tuple[int, ...]) -> np.ndarray | None:
    """E of {e : vec(e)^H E^-1 vec(e) <= 1}, (F, ny*nu, ny*nu), Hermitian and positive definite; None where there is none."""
    if value is None:
        return None
    size = shape[1] * shape[2]
    E = as_array("ellipsoid", value, dtype=complex)
    if E.shape != (shape[0], size, size):
        raise InputError(f"`ellipsoid` must have shape (F, ny*nu, ny*nu) = {(shape[0], size, size)}; got {E.shape}")
    if np.any(bad := ~np.all(np.einsum("fii->fi", E).real > 0, axis=1)):
        raise InputError(f"`ellipsoid` must have positive numbers on its diagonal; line {int(np.argmax(bad))} has not")
    scaled = correlations(E)
    if np.abs(scaled - scaled.conj().swapaxes(1, 2)).max() > _HERMITIAN:
        raise InputError("`ellipsoid` must be Hermitian at every line")
    eigenvalues = np.linalg.eigvalsh(scaled)
    if np.any(bad := ~(eigenvalues[:, 0] > _ROUND * size * eigenvalues[:, -1])):
        raise InputError(
            f"`ellipsoid` must be positive definite; line {int(np.argmax(bad))} has the smallest eigenvalue"
            f" {eigenvalues[bad][0, 0]:.3g} with every diagonal entry scaled to 1. Give every combination of entries an"
            " uncertainty"
        )
    return (E + E.conj().swapaxes(1, 2)) / 2


def correlations(E: np.ndarray) -> np.ndarray:
    """E with its diagonal scaled to 1."""
    radius = np.sqrt(np.einsum("fii->fi", E).real)
    return E / (radius[:, :, None] * radius[:, None, :])


def as_joint(
    joint: Any, bound: np.ndarray | None, ellipsoid: np.ndarray | None, tilt: Any, shape: tuple[int, ...]
) -> np.ndarray | None:
    """The bound of every entry alone, the projection of the joint one; what belongs together is checked."""
    if joint not in JOINT:
        raise InputError(f"`joint` must be one of {JOINT}; got {joint!r}")
    if joint != "entry" and tilt is not None:
        raise InputError(f'`tilt` shapes the disc of one entry: it goes with joint="entry"; got joint={joint!r}')
    if (joint == "matrix") != (ellipsoid is not None):
        raise InputError(
            '`ellipsoid` is the set of joint="matrix": give both or none;'
            f" got joint={joint!r} {'with' if ellipsoid is not None else 'without'} an ellipsoid"
        )
    if joint == "column" and bound is None:
        raise InputError(
            'joint="column" says how `bound` is meant, which is missing; give it, or with_column_bound(...)'
        )
    if ellipsoid is None:
        return bound
    lines, ny, nu = shape
    projection = np.sqrt(np.einsum("fii->fi", ellipsoid).real).reshape(lines, nu, ny).transpose(0, 2, 1)
    if bound is not None and np.any(np.isinf(bound)):
        raise InputError(
            '`bound` is infinite somewhere, and joint="matrix" needs every entry of the matrix; select the complete lines, or'
            ' use joint="column"'
        )
    if bound is not None and not np.allclose(bound, projection, rtol=1e-9, atol=0):
        raise InputError(
            "`bound` must be the square root of the diagonal of `ellipsoid`; leave it out, or change both by with_ellipsoid(...)"
        )
    return projection


def joint_ratio(
    error: np.ndarray, bound: np.ndarray, joint: str, tilt: np.ndarray | None, ellipsoid: np.ndarray | None
) -> np.ndarray:
    """The size of an error in units of its bound, as `FrequencyResponse.ratio` says."""
    if joint == "entry":
        return bound_ratio(error, bound, tilt)
    if ellipsoid is None:
        return np.linalg.norm(error / bound, axis=1, keepdims=True)
    # The correlations rather than E: nothing depends on the units of the entries.
    white = np.linalg.solve(np.linalg.cholesky(correlations(ellipsoid)), stacked(error / bound)[..., None])
    return np.linalg.norm(white, axis=1, keepdims=True)


def largest_combination(weights: np.ndarray, bound: np.ndarray, joint: str, ellipsoid: np.ndarray | None) -> np.ndarray:
    """Maximum of |sum(weights * e)| over the errors e that the bound allows, (F, l, r), for weights (F, l, r, ny, nu)."""
    if ellipsoid is not None:
        w = weights.swapaxes(3, 4).reshape(*weights.shape[:3], -1)
        return np.sqrt(np.einsum("fijp,fpq,fijq->fij", w, ellipsoid, w.conj()).real)
    reach = np.abs(weights)
    # An infinite bound counts where its entry has a weight.
    parts = np.multiply(reach, bound[:, None, None], out=np.zeros(reach.shape), where=reach > 0)
    if joint == "column":
        parts = np.linalg.norm(parts, axis=3)
        return parts.sum(axis=3)
    return parts.sum(axis=(3, 4))
