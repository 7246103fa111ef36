"""Checks of what a bound is made from, each with its sentence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import as_array, as_float
from robustid.errors import InputError


def in_part(value: object, size: NDArray[np.float64]) -> object:
    """A text such as "5%" as that part of the size of each value; anything else as it is."""
    if not isinstance(value, str):
        return value
    number, sign, rest = value.partition("%")
    try:
        part = float(number) / 100
    except ValueError:
        part = np.nan
    if not sign or rest.strip() or not np.isfinite(part) or part <= 0:
        raise InputError(f'`bound` as text is a part of each value, such as "5%"; got {value!r}')
    if not np.all(size[np.isfinite(size)] > 0):
        raise InputError(
            f"`bound` = {value!r} is zero where a value is zero; give radii in units of the response there"
        )
    return np.where(np.isfinite(size), part * size, np.inf)


def as_radius(value: object) -> NDArray[np.float64]:
    """Positive numbers; infinite where nothing is known."""
    radius = as_array("bound", value, finite=False)
    if np.any(np.isnan(radius)):
        raise InputError(f"`bound` must not contain NaN; got {int(np.isnan(radius).sum())} of them")
    if np.any(radius <= 0):
        raise InputError(
            f"`bound` must be positive (it divides the residuals); got a smallest value of {radius.min():g}."
            " For samples known exactly give a bound small against the data, such as 1e-6 of their size"
        )
    return radius


def broadcast(radius: NDArray[np.float64], shape: tuple[int, ...], axis: str) -> NDArray[np.float64]:
    """One number, or one a sample, or one a sample and entry, to one a sample and entry."""
    if radius.ndim == 1 and radius.shape == shape[:1]:
        radius = radius.reshape(shape[:1] + (1,) * (len(shape) - 1))
    elif radius.ndim != 0 and radius.shape != shape:
        raise InputError(
            f"`bound` must be a scalar or have shape ({axis},) = {shape[:1]} or {shape}; got {radius.shape}"
        )
    return np.broadcast_to(radius, shape)


def projected(
    ellipsoid: NDArray[np.complex128], radius: NDArray[np.float64] | None, shape: tuple[int, ...], axis: str
) -> NDArray[np.float64]:
    """Radius that an ellipsoid leaves to every entry alone; a radius that was given must be the same."""
    points, ny, nu = shape
    projection = np.sqrt(np.einsum("fii->fi", ellipsoid).real).reshape(points, nu, ny).transpose(0, 2, 1)
    if radius is None:
        return projection
    radius = broadcast(radius, shape, axis)
    if np.any(np.isinf(radius)):
        raise InputError(
            '`bound` is infinite somewhere, and joint="matrix" needs every entry of the matrix; select the complete frequency'
            ' points, or use joint="column"'
        )
    if not np.allclose(radius, projection, rtol=1e-9, atol=0):
        raise InputError(
            "`bound` must be the square root of the diagonal of `ellipsoid`; leave it out, or change both by with_ellipsoid(...)"
        )
    return projection


def as_probability(value: object) -> float:
    """A number between 0 and 1."""
    number = as_float("probability", value)
    if not 0 < number < 1:
        raise InputError(f"`probability` must be between 0 and 1; got {number:g}")
    return number
