r"""Structures of an uncertainty, by the shape of a bound: of the whole matrix, of its columns, of its rows or of its entries.

An array (C, p, q) bounds on every cell the largest singular value of each of p q blocks: (C, 1, 1) of the whole matrix,
(C, 1, nu) of every column, (C, ny, 1) of every row, (C, ny, nu) of every entry.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from robustid.core import Real, freeze
from robustid.errors import InputError
from robustid.guarantees.cells import Cells
from robustid.guarantees.value_set import norm_of_bounds

STRUCTURES = ("full", "input", "output", "entry")


def shape_of(structure: str, size: tuple[int, int]) -> tuple[int, int]:
    """Blocks of a structure by rows and columns, for a matrix of a size."""
    if structure not in STRUCTURES:
        raise InputError(f"`structure` must be one of {STRUCTURES}; got {structure!r}")
    return (size[0] if structure in ("output", "entry") else 1), (size[1] if structure in ("input", "entry") else 1)


def structure_of(bound: Real, size: tuple[int, int]) -> str:
    """Name of the structure of a bound (C, p, q) of a matrix of a size; of one row, its entries are its columns."""
    shapes = {shape_of(name, size): name for name in ("input", "output", "entry", "full")}
    return shapes[bound.shape[1], bound.shape[2]]


def as_bounds(plant: Any, edges: Any, bound: Any) -> tuple[Cells, tuple[Real, ...]]:
    """The cells (with the first bound), and all bounds as (C, p, q); those of entries no larger than any other one says.

    Parameters
    ----------
    plant : control.StateSpace
    edges : (C + 1,) array, rad/s
    bound : (C,) or (C, p, q) array, or a tuple of such arrays
        All of a tuple hold.

    Raises
    ------
    InputError, InputTypeError
        If shapes don't fit, or two bounds of a tuple are of the same structure.
    """
    parts: list[Any] = list(bound) if isinstance(bound, tuple) else []  # type: ignore[reportUnknownArgumentType]
    if not parts or not all(np.ndim(one) for one in parts):
        parts = [bound]
    given = [Cells.read(edges, one, float(plant.dt), plant) for one in parts]
    bounds = [cells.bound.reshape(cells.bound.shape[0], *(cells.bound.shape[1:] or (1, 1))) for cells in given]
    size = plant.noutputs, plant.ninputs
    names = [structure_of(one, size) for one in bounds]
    if len(set(names)) < len(names):
        raise InputError(
            f"`bound` must hold one bound of each structure; got {', '.join(names)} for a model of {size[0]} outputs and {size[1]}"
            " inputs. Where two of the same structure hold, take the smaller one on every cell"
        )
    if "entry" in names:
        place = names.index("entry")
        bounds[place] = functools.reduce(np.minimum, bounds)
    return given[0], tuple(freeze(one) for one in bounds)


def implied(bounds: tuple[Real, ...], structure: str, size: tuple[int, int]) -> Real:
    """Smallest bound of a structure that follows from those of others, (C, p, q).

    Of a block, the norm of the matrix of bounds of its parts, and the bounds of all that it is part of.

    Parameters
    ----------
    bounds : tuple of (C, p, q) arrays
    structure : {"full", "input", "output", "entry"}
    size : (int, int)
        Outputs and inputs.
    """
    p, q = shape_of(structure, size)
    found: list[Real] = []
    for bound in bounds:
        parts = bound
        if p == 1 and parts.shape[1] > 1 and q == 1 and parts.shape[2] > 1:
            parts = norm_of_bounds(parts)[:, None, None]
        for axis, blocks in ((1, p), (2, q)):
            if blocks == 1 and parts.shape[axis] > 1:
                parts = np.linalg.norm(parts, axis=axis, keepdims=True) * (1 + 1e-12)
        found.append(np.broadcast_to(parts, (bound.shape[0], p, q)))
    return functools.reduce(np.minimum, found)


def log_volume(bound: Real, size: tuple[int, int]) -> Real:
    r"""Logarithm of the volume of all complex matrices that a bound (C, p, q) allows, over its 2 ny nu dimensions, (C,).

    The complex m x n matrices with :math:`\bar\sigma \le 1` have the volume
    :math:`\pi^{mn} \prod_{k<m} k! \prod_{k<n} k! / \prod_{k<m+n} k!` (`hua1963`).
    """
    _, p, q = bound.shape
    m, n = size[0] // p, size[1] // q
    ball = m * n * math.log(math.pi)
    ball += sum(math.lgamma(k + 1) for k in range(m)) + sum(math.lgamma(k + 1) for k in range(n))
    ball -= sum(math.lgamma(k + 1) for k in range(m + n))
    radii = np.asarray(np.log(bound).sum(axis=(1, 2)), dtype=float)
    return (p * q * ball + 2 * m * n * radii) / (2 * size[0] * size[1])
