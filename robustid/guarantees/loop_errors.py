r"""Errors of the two sides of a loop at a frequency: when they close it, which of them, and where its eigenvalues may be.

With both errors on the diagonal of :math:`\Delta`, ``I + Delta M`` is singular where ``det(I + G H) = 0``. For two discs that is
decided exactly by scaling: of a 2x2 matrix with two blocks of one entry the scaled bound is the structured singular value, and

.. math:: |1 + g h|^2 + a^2 b^2 - a^2 |h|^2 - b^2 |g|^2 - 2 a b > 0, \qquad a b < |1 + g h|

says that no product of values of the discs :math:`|G - g| \le a, |H - h| \le b` is -1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.guarantees.cells import Pieces, enclose
from robustid.guarantees.scaling import best_scaling, perron_scaling
from robustid.guarantees.value_set import norm_of_bounds

if TYPE_CHECKING:
    import control

_STEPS, _BISECTIONS = 60, 40
_CURVE = 0.05  # relative accuracy of the least eigenvalue on an arc
_ROUNDING = 100 * np.finfo(float).eps  # of eigenvalues


def structured_gain(loop: Complex, bound: Real) -> float:
    """Upper bound of the structured singular value of errors within bounds (p, q) around a loop (q, p), by scaling."""
    if not bound.any():
        return 0.0
    rows, columns = bound.any(axis=1), bound.any(axis=0)
    part, size = loop[np.ix_(columns, rows)][None], bound[np.ix_(rows, columns)][None]
    scaling = perron_scaling(part, size) if are_discs(bound) else best_scaling(part, size)
    return float(np.prod(scaling.gain(part, size)))


def are_discs(bound: Real) -> bool:
    """True for one disc a side, (2, 2) or (C, 2, 2): the scaling that makes the moduli symmetric is the best of all there."""
    return bound.shape[-2:] == (2, 2) and not bound[..., 0, 1].any() and not bound[..., 1, 0].any()


def factor_alone(loop: Complex, bound: Real, place: tuple[slice, slice] | None) -> float:
    """Largest factor, at most 1, on the bound of one side with which the condition holds, that of the other side as it is."""
    if place is None:
        return 1.0

    def holds(factor: float) -> bool:
        smaller = bound.copy()
        smaller[place] *= factor
        return structured_gain(loop, smaller) < 1

    if holds(1.0):
        return 1.0
    low, high = 0.0, 1.0
    if not holds(low):
        return 0.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class Closing(NamedTuple):
    """Errors whose loop is on its edge: `factor` times `errors`, of modulus `bound`; the part of each entry in that, 1 in all."""

    errors: Complex
    factor: float
    shares: Real


def closing_error(loop: Complex, bound: Real) -> Closing:
    """The errors that close the loop with the smallest factor that is found.

    A power iteration: along the gradient of an eigenvalue of Delta M the largest one does not fall. That eigenvalue is the sum of
    the parts of the entries; a bound larger by one per cent makes the factor smaller by so many per cent as its part says.
    """
    rng, best, found = (
        np.random.default_rng(0),
        0.0,
        Closing(np.zeros(bound.shape, complex), np.inf, np.zeros(bound.shape)),
    )
    starts = [np.exp(2j * np.pi * rng.random(bound.shape)) for _ in range(10)]
    left, _, right = np.linalg.svd(loop)
    starts.append(np.exp(1j * (np.angle(right[0].conj())[:, None] - np.angle(left[:, 0])[None])))
    for phases in starts:
        delta = bound * phases
        for _ in range(_STEPS):
            values, vectors = np.linalg.eig(delta @ loop)
            k = int(np.argmax(np.abs(values)))
            size, turn = float(np.abs(values[k])), np.exp(1j * np.angle(values[k]))
            direction = turn * np.outer(np.linalg.pinv(vectors)[k].conj(), np.conj(loop @ vectors[:, k]))
            if size > best:
                best, parts = size, np.maximum(np.real(np.conj(direction) * delta), 0.0)
                found = Closing(-delta / turn, 1 / size, parts / parts.sum())
            delta = bound * np.exp(1j * np.angle(direction))
    return found


def passive_factors(
    models: tuple[control.StateSpace, control.StateSpace],
    angles: Real,
    entries: tuple[Real, Real],
    classes: tuple[bool, bool],
) -> Real:
    """Largest factor on both bounds, on every cell, at which ``G + G^H`` and ``H + H^H`` stay positive there (C,).

    Then ``det(I + G H)`` is not zero: with x = -G y, y = H x, Re y^H x would be both positive and at most 0. A class whose systems
    are all passive needs no bound, if the other side is positive. 0 where nothing follows.
    """
    if models[0].noutputs != models[0].ninputs:
        return np.zeros(angles.size - 1)
    ways = [_positive_factor(*side) for side in zip(models, [angles] * 2, entries, strict=True)]
    found = np.minimum(*ways)
    for passive, other in zip(classes, ways[::-1], strict=True):
        found = np.maximum(found, other) if passive else found
    return found


def _finite(entries: Real) -> tuple[NDArray[np.bool_], Real]:
    """True where all bounds of a cell are finite, and the bounds with zeros elsewhere."""
    finite = np.asarray(np.all(np.isfinite(entries), axis=(1, 2)))
    return finite, np.where(finite[:, None, None], entries, 0.0)


def _positive_factor(model: control.StateSpace, angles: Real, entries: Real) -> Real:
    """Factor on the bounds at which the Hermitian part of one side stays positive, on every cell."""
    finite, known = _finite(entries)
    sizes = np.where(finite, norm_of_bounds((known + known.swapaxes(1, 2)) / 2), np.inf)

    def least(pieces: Pieces) -> tuple[Real, Real]:
        values = pieces.values
        middle: Real = np.asarray(np.linalg.eigvalsh((values + values.conj().swapaxes(1, 2)) / 2)[:, 0], dtype=float)
        around = pieces.radius + _ROUNDING * np.abs(values)
        return middle, middle - norm_of_bounds((around + around.swapaxes(1, 2)) / 2)

    def coarse(pieces: Pieces) -> NDArray[np.bool_]:
        middle, arc = least(pieces)
        return (middle > sizes[pieces.cell]) & (arc < (1 - _CURVE) * middle)

    pieces = enclose(model, angles, coarse)
    factors = np.full(angles.size - 1, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.maximum(least(pieces)[1], 0.0) / sizes[pieces.cell]
    np.minimum.at(factors, pieces.cell, np.nan_to_num(each, nan=0.0, posinf=np.inf))
    return factors


def loci(source: Complex, load: Complex, bounds: tuple[Real, Real]) -> tuple[Complex, Real]:
    """Eigenvalues of G0 H0 at frequencies (F, n), and radii of discs around them whose union holds those of all G H.

    Gershgorin's theorem in the coordinates of the eigenvectors V of the nominal product: rows of ``|V^-1| B |V|``, B a bound of the
    entries of G H - G0 H0. Infinite where the eigenvectors are dependent.
    """
    product, ((some, first), (others, second)) = source @ load, (_finite(bound) for bound in bounds)
    sizes = first @ np.abs(load) + np.abs(source) @ second + first @ second
    values, vectors = np.linalg.eig(product)
    radius = np.full(values.shape, np.inf)
    good = np.linalg.cond(vectors) < 1 / np.sqrt(np.finfo(float).eps)
    good &= some & others
    back = np.abs(np.linalg.inv(vectors[good]))
    found = back @ sizes[good] @ np.abs(vectors[good])
    # The rounding of the diagonal form itself, to first order.
    rounding = 100 * np.finfo(float).eps * (back @ np.abs(product[good]) @ np.abs(vectors[good])).sum(axis=2)
    radius[good] = found.sum(axis=2) + rounding
    return values, radius
