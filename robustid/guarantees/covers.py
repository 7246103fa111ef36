r"""Structured covers: the bound of an additive, a multiplicative or an inverse uncertainty from that of an error, on every cell.

With :math:`F = F_0 + E`, :math:`|E_{ij}| \le b_{ij}`, the uncertainty at the outputs is :math:`E F_0^{-1}`, at the inputs
:math:`F_0^{-1} E`; their norms are at most :math:`\|[b]\,|F_0^{-1}|\|` and :math:`\||F_0^{-1}|\,[b]\|`, and at most
:math:`\bar\sigma(E)/\underline\sigma(F_0)`. With m such a bound at the outputs, that of the inverse is :math:`m/(1 - m)`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real
from robustid.errors import InputError
from robustid.guarantees.bilinear import Image
from robustid.guarantees.cells import INPUT, KINDS, Cells, Pieces, check_plant, enclose

if TYPE_CHECKING:
    import control

_RESOLVED = 0.02  # largest relative radius of F_0 on a piece of arc
_ROUNDING = 1 + 1e-9
_PIECES = 20_000  # halved at once, at most: a plant that is singular all over is not resolved by more of them
_RELATIVE = 1e12  # a larger relative error is rounding of a plant that is singular
_SINGULAR = 1e100  # larger than the entries of any inverse, in units of the plant, and finite


def cover_bound(nominal: control.StateSpace, edges: Real, bound: Real, entries: Real, kind: str) -> Real:
    """Bound (C,) of the uncertainty of a kind on every cell between `edges` in rad/s, from bounds of F - F_0.

    `bound` (C,) is of its largest singular value, `entries` (C, ny, nu) of its entries. InputError for another kind; for a relative
    one also a plant that isn't square, and, with the frequency, an uncertainty that nothing bounds.
    """
    if kind not in KINDS:
        raise InputError(f"`kind` must be one of {KINDS}; got {kind!r}")
    if kind == "additive":
        return bound
    if (image := Image.of(nominal, edges)) is not None:
        return cover_bound(image.model("nominal", nominal), image.edges, bound, entries, kind)
    plant = check_plant(nominal)
    check_square(plant, kind)
    cells = Cells.read(edges, bound, float(plant.dt))
    least, frequency = smallest_gain(plant, cells)
    whole = np.divide(bound, least, out=np.full(least.size, np.inf), where=least > 0)
    size = np.minimum(whole, _entrywise(plant, cells, entries, kind))
    room = 1 - size if kind == "inverse" else np.where(size < _RELATIVE, 1.0, 0.0)
    if np.any(room <= 0):
        worst = int(np.argmax(size))
        raise unbounded(frequency[worst], least[worst], bound[worst], kind)
    return size / room * _ROUNDING


def check_square(plant: control.StateSpace, kind: str) -> None:
    """Refuse relative kinds where the plant has no inverse."""
    if plant.noutputs != plant.ninputs:
        raise InputError(
            f"`nominal` must have as many inputs as outputs for kind {kind!r}; got {plant.ninputs} and {plant.noutputs}."
            ' Use kind="additive"'
        )


def unbounded(omega: float, least: float, bound: float, kind: str) -> InputError:
    """The sentence about a bound that is not relative to anything."""
    return InputError(
        f"`bound` is not relative to anything at {omega:.6g} rad/s: |nominal| may be as small as"
        f" {max(least, 0.0):.3g} there, the bound is {bound:.3g}, so that the error of kind {kind!r} is"
        ' unbounded. Use kind="additive"'
    )


def smallest_gain(plant: control.StateSpace, cells: Cells) -> tuple[Real, Real]:
    """Lower bound of the smallest singular value of F_0 on every cell, and the frequency of the piece that decides."""

    def least(pieces: Pieces) -> tuple[Real, Real]:
        sizes = np.asarray(np.linalg.svd(pieces.values, compute_uv=False), dtype=float)
        return sizes[:, -1], np.linalg.norm(pieces.radius, axis=(1, 2))

    def coarse(pieces: Pieces) -> NDArray[np.bool_]:
        size, radius = least(pieces)
        return radius > _RESOLVED * size

    pieces = enclose(plant, cells.angles, _limited(coarse))
    size, radius = least(pieces)
    order = np.lexsort((size - radius, pieces.cell))
    decisive = order[np.searchsorted(pieces.cell[order], np.arange(cells.bound.size))]
    return (size - radius)[decisive] * (1 - 1e-12), pieces.middle[decisive] / plant.dt


def _limited(coarse: Callable[[Pieces], NDArray[np.bool_]]) -> Callable[[Pieces], NDArray[np.bool_]]:
    """The same, but for so many pieces at once that halving them leads nowhere."""

    def limited(pieces: Pieces) -> NDArray[np.bool_]:
        split = coarse(pieces)
        return split if split.sum() <= _PIECES else np.zeros(split.size, bool)

    return limited


def _entrywise(plant: control.StateSpace, cells: Cells, entries: Real, kind: str) -> Real:
    """Bound of the norm of E F_0^-1, or of F_0^-1 E, from the entries of E, (C,); inf where F_0 may be singular."""

    def inverse(pieces: Pieces) -> tuple[Real, Real]:
        """|V^-1| of the middle V, and the largest row sum of |V^-1| times the radius: F_0 = V (I + V^-1 (F_0 - V))."""
        scale = np.abs(pieces.values).max(initial=np.finfo(float).tiny)
        regular = np.abs(np.linalg.det(pieces.values / scale)) > 0
        sizes = np.full(pieces.values.shape, _SINGULAR / scale)
        sizes[regular] = np.minimum(np.abs(np.linalg.inv(pieces.values[regular])), _SINGULAR / scale)
        return sizes, (sizes @ pieces.radius).sum(axis=2).max(axis=1)

    pieces = enclose(plant, cells.angles, _limited(lambda pieces: inverse(pieces)[1] > _RESOLVED))
    sizes, change = inverse(pieces)
    found = np.full(change.size, np.inf)
    sure = change < 0.5
    # |F_0^-1| <= (I - |V^-1| R)^-1 |V^-1|
    identity = np.eye(plant.noutputs)
    around = np.linalg.solve(identity - sizes[sure] @ pieces.radius[sure], sizes[sure])
    here = entries[pieces.cell[sure]]
    product = around @ here if kind == INPUT else here @ around
    found[sure] = np.linalg.norm(product, 2, axis=(1, 2))
    largest = np.zeros(cells.bound.size)
    np.maximum.at(largest, pieces.cell, found)
    return largest
