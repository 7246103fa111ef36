r"""Cells of the circle: a bound that is constant on each, and enclosures of the values of a model on each.

With :math:`R = (z_0 I - A)^{-1}` and :math:`|z - z_0| \le h < 1/\|R\|`, the series of the resolvent gives

.. math:: |F(z) - F(z_0)|_{ij} \le \frac{h\,\|C_i R\|\,\|R B_j\|}{1 - h \|R\|}.

An array (C, p, q) bounds on every cell the largest singular value of each of p q blocks: (C, 1, 1) of the whole matrix,
(C, 1, nu) of every column, (C, ny, 1) of every row, (C, ny, nu) of every entry.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Real, as_array, counted, freeze, scaled_states
from robustid.errors import InputError
from robustid.guarantees.value_set import norm_of_bounds
from robustid.identification import check_model

if TYPE_CHECKING:
    import control

INPUT = "input_multiplicative"
KINDS = ("additive", "multiplicative", INPUT, "inverse")
_EPS = np.finfo(float).eps
_BLOCK = 100_000  # entries of all resolvents at once: what a cache holds
_FAR = 1e100  # where the series diverges: larger than any gain, and finite, so that an entry that is zero stays so
_DEPTH = 34  # halvings of a cell: what is left then is rounding
STRUCTURES = ("full", "input", "output", "entry")


class Cells(NamedTuple):
    """Edges in rad/s, the same as angles in rad (the last is pi), and the bound (C,) or (C, p, q)."""

    edges: Real
    angles: Real
    bound: Real

    @classmethod
    def read(cls, edges: ArrayLike, bound: ArrayLike, dt: float, plant: control.StateSpace | None = None) -> Cells:
        """Check what the user gave; shapes against a plant, where there is one."""
        edges, bound = as_array("edges", edges, ndim=1), as_array("bound", bound)
        if edges.size < 2 or np.any(np.diff(edges) <= 0) or edges[0] < 0:
            raise InputError(f"`edges` must rise from 0 rad/s or above, at least two of them; got {edges.size} edges")
        if not np.isclose(edges[-1] * dt, np.pi, rtol=1e-9, atol=0.0):
            raise InputError(
                f"`edges` must end at pi/dt = {np.pi / dt:.10g} rad/s, so that no frequency is left out; got {edges[-1]:.10g}"
            )
        shapes: list[tuple[int, ...]] = [(edges.size - 1,)]
        if plant is not None:
            ny, nu = plant.noutputs, plant.ninputs
            shapes += dict.fromkeys((edges.size - 1, p, q) for p, q in ((ny, nu), (1, nu), (ny, 1), (1, 1)))
        if bound.shape not in shapes:
            raise InputError(
                f"`bound` must have shape {' or '.join(map(str, shapes))}, one value for each of the {edges.size - 1} cells"
                f" between `edges`; got {bound.shape}"
            )
        if not np.all(bound > 0):
            first = int(np.argmin(bound.reshape(bound.shape[0], -1).min(axis=1)))
            raise InputError(
                f"`bound` must be positive; got {bound[first].min():g} from {edges[first]:g} to {edges[first + 1]:g} rad/s."
                " A weight can't be zero on a whole cell: give cells without error a floor, such as 1e-3 of the largest bound"
            )
        angles = edges * dt
        angles[-1] = np.pi
        return cls(freeze(edges), freeze(angles), freeze(bound))


def check_plant(nominal: control.StateSpace) -> control.StateSpace:
    """The nominal model, discrete and with its sample time."""
    plant = check_model("nominal", nominal)
    if plant.dt is True or not plant.dt:
        raise InputError(f"`nominal` must be discrete with its sample time in s; got dt = {plant.dt}")
    return plant


class Pieces(NamedTuple):
    """Every piece of arc: its cell, its middle and half of its length (rad), values (M, ny, nu) there and radii that hold on it."""

    cell: NDArray[np.intp]
    middle: Real
    half: Real
    values: Complex
    radius: Real

    def of(self, which: NDArray[np.bool_]) -> Pieces:
        """Some of the pieces."""
        return Pieces(self.cell[which], self.middle[which], self.half[which], self.values[which], self.radius[which])


def enclose(model: control.StateSpace, angles: Real, coarse: Callable[[Pieces], NDArray[np.bool_]]) -> Pieces:
    """Enclose a model on the cells between `angles`, halved for as long as `coarse` says so of a piece.

    Radii include an allowance for the rounding of the solution of linear systems, to first order.
    """
    return enclose_judged(model, angles, lambda pieces: (coarse(pieces), np.zeros(pieces.cell.size)))[0]


def enclose_judged(
    model: control.StateSpace, angles: Real, judge: Callable[[Pieces], tuple[NDArray[np.bool_], Real]]
) -> tuple[Pieces, Real]:
    """The same, with the numbers (N, ...) that `judge` finds of the pieces beside what is to be halved."""
    matrices = (*scaled_states(model.A, model.B, model.C), np.asarray(model.D))
    cell: NDArray[np.intp] = np.arange(angles.size - 1)
    low, high = angles[:-1], angles[1:]
    done, known = list[Pieces](), list[Real]()
    for depth in range(_DEPTH):
        pieces = Pieces(cell, (low + high) / 2, (high - low) / 2, *_on_arcs(matrices, low, high))
        split, numbers = judge(pieces)
        split = split & (depth < _DEPTH - 1)
        done.append(pieces.of(~split))
        known.append(numbers[~split])
        if not split.any():
            break
        low, high = _halves(low[split], pieces.middle[split], high[split])
        cell = np.tile(cell[split], 2)
    joined: list[Any] = [np.concatenate(parts) for parts in zip(*done, strict=True)]
    return Pieces(*joined), np.concatenate(known)


def _halves(low: Real, middle: Real, high: Real) -> tuple[Real, Real]:
    """Ends of the lower halves of arcs and of the upper ones."""
    return np.concatenate([low, middle]), np.concatenate([middle, high])


def _on_arcs(matrices: tuple[Real, Real, Real, Real], low: Real, high: Real) -> tuple[Complex, Real]:
    A, B, C, D = matrices
    n, pieces = A.shape[0], low.size
    values = np.tile(D.astype(complex), (pieces, 1, 1))
    radius = np.zeros(values.shape)
    if not n:
        return values, radius
    size = np.linalg.norm(A, 2) + 1
    step = max(1, _BLOCK // n**2)
    for first in range(0, pieces, step):
        part = slice(first, first + step)
        points = np.exp(0.5j * (low[part] + high[part]))
        resolvent = np.linalg.inv(points[:, None, None] * np.eye(n) - A)
        left, right = C @ resolvent, resolvent @ B
        sizes = np.abs(resolvent)
        norm = np.sqrt(sizes.sum(axis=1).max(axis=1) * sizes.sum(axis=2).max(axis=1))
        half = (high[part] - low[part]) / 2
        room = 1 - half * norm
        rows, columns = np.linalg.norm(left, axis=2), np.linalg.norm(right, axis=1)
        reach = np.where(room > 0, half / np.maximum(room, _EPS), _FAR) + 10 * n * _EPS * size
        values[part] += left @ B
        radius[part] = reach[:, None, None] * (rows[:, :, None] * columns[:, None, :])
    return values, radius + 8 * _EPS * np.abs(values)


def shape_of(structure: str, size: tuple[int, int]) -> tuple[int, int]:
    """Blocks of a structure by rows and columns, for a matrix of a size."""
    if structure not in STRUCTURES:
        raise InputError(f"`structure` must be one of {STRUCTURES}; got {structure!r}")
    return (size[0] if structure in ("output", "entry") else 1), (size[1] if structure in ("input", "entry") else 1)


def structure_of(bound: Real, size: tuple[int, int]) -> str:
    """Name of the structure of a bound (C, p, q) of a matrix of a size; of one row, its entries are its columns."""
    shapes = {shape_of(name, size): name for name in ("input", "output", "entry", "full")}
    return shapes[bound.shape[1], bound.shape[2]]


def as_bounds(plant: control.StateSpace, edges: ArrayLike, bound: ArrayLike) -> tuple[Cells, tuple[Real, ...]]:
    """The cells (with the first bound), and all bounds as (C, p, q); those of entries no larger than any other one says.

    `edges` are (C + 1,), in rad/s; a bound is (C,) or (C, p, q). All of a tuple hold, no two of the same structure.
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
            f"`bound` must hold one bound of each structure; got {', '.join(names)} for a model of"
            f" {counted(size[0], 'output')} and {size[1]}"
            " inputs. Where two of the same structure hold, take the smaller one on every cell"
        )
    if "entry" in names:
        place = names.index("entry")
        bounds[place] = functools.reduce(np.minimum, bounds)
    return given[0], tuple(freeze(one) for one in bounds)


def implied(bounds: tuple[Real, ...], structure: str, size: tuple[int, int]) -> Real:
    """Smallest bound of a structure ("full", "input", "output", "entry") that follows from those of others, (C, p, q).

    Of a block, the norm of the matrix of bounds of its parts, and the bounds of all that it is part of. `size`: outputs, inputs.
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
