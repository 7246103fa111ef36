r"""Largest nu-gap from the model of a plant in a loop to any consistent one, on the whole axis.

With normalised factors :math:`G_0 = [D_0; N_0]` of the model :math:`P(R_0)`, their complement :math:`\tilde G_0`, and
:math:`M = [M_1, M_2]` the factors of the loop, the graph of :math:`P(R_0 + \Delta)` is that of
:math:`G_0 W + M_2 \Delta`, W outer. Its largest angle to that of the model has

.. math:: \tan\theta = \bar\sigma\left(\tilde G_0 M_2 \Delta \, (I - m \Delta)^{-1} W^{-1}\right), \qquad
          m = - W^{-1} G_0^* M_2, \qquad \delta_\nu = \sup_\omega \sin\theta ,

since the way there, :math:`R_0 + t \Delta`, is continuous, so that the winding number stays where all sines are below 1.

Of one input and one output with :math:`a = \tilde G_0 M_2 W^{-1}` the changes that stay within a tangent t,
:math:`|a \Delta| \le t\, |1 - m \Delta|`, are a disc where :math:`t |m| < |a|`: a polygon is in it if its corners are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Complex, Real, StateMatrices, series
from robustid.guarantees.circle import Peak
from robustid.guarantees.graphs import graph_complement, graph_factors
from robustid.guarantees.loop_axis import BandAxis
from robustid.guarantees.loop_values import Part, image_of, image_over

_ONE = 1 + 1e-9

if TYPE_CHECKING:
    import control

    from robustid.guarantees.band_result import Band
    from robustid.guarantees.cells import Pieces
    from robustid.identification import Loop


def farthest_plant(band: Band, loop: Loop, model: control.StateSpace) -> Peak:
    """Largest nu-gap of consistent plants from that of a model of R, the centre of the band, and the frequency near it."""
    nu, _ = loop.shape
    plant = StateMatrices.of(loop.plant_of(model))
    right = graph_factors("band", plant, loop.dt)  # [D; N]
    left = graph_complement(graph_factors("band", plant.transposed(), loop.dt).transposed())
    back = series(right, loop.back)
    parts = (
        left,
        right,
        StateMatrices(loop.factors.A, loop.factors.B[:, nu:], loop.factors.C, loop.factors.D[:, nu:]),
        StateMatrices(back.A, back.B, back.C[:nu], back.D[:nu]),
    )
    whole = StateMatrices(*(_beside([one[k] for one in parts]) for k in range(4)))
    axis = BandAxis(band)

    def sizes(pieces: Pieces, reach: Real, *_: Real) -> Real:
        complement, graph, second, inverse = _taken(pieces.values, reach, parts)
        outer, inner = _product(complement, second), _product(inverse, _product(_adjoint(graph), second))
        errors, inner = axis.errors(pieces), (-inner[0], inner[1])
        tangent = np.fmin(
            image_of(outer, inverse, inner, errors.bound).largest, image_over(outer, inverse, inner, errors).largest
        )
        return _sine(np.fmin(tangent, _at_corners(outer, inverse, inner, errors.corners)))[:, None]

    value, omega = axis.largest(whole, sizes, np.zeros(1))
    return Peak(float(value[0]), float(omega[0]))


def _at_corners(left: Part, right: Part, inner: Part, corners: Complex) -> Real:
    """Largest size of ``left Delta (1 - inner Delta)^-1 right`` over polygons (N, M) of one entry; infinite where it isn't known.

    All values within their radii: each has its disc, that of the largest size at a corner.
    """
    if not corners.shape[1]:
        return np.full(len(corners), np.inf)
    across, off = (one[:, 0, 0] for one in _product(left, right))
    m, reach = (one[:, 0, 0] for one in inner)
    size = np.abs(corners)
    with np.errstate(invalid="ignore", divide="ignore"):
        room = np.abs(1 - m[:, None] * corners) - reach[:, None] * size
        parts = np.where(room > 0, (np.abs(across) + off)[:, None] * size / room, np.inf)
        found = parts.max(axis=1) * _ONE
        convex = found * (np.abs(m) + reach) < np.abs(across) - off
    return np.where(convex, found, np.inf)


def _beside(blocks: list[Real]) -> Real:
    return np.asarray(scipy.linalg.block_diag(*blocks), dtype=float)


def _taken(values: Complex, reach: Real, parts: tuple[StateMatrices, ...]) -> list[Part]:
    """The blocks on the diagonal, with their radii."""
    found: list[Part] = []
    row = column = 0
    for one in parts:
        rows, columns = slice(row, row + len(one.D)), slice(column, column + len(one.D.T))
        found.append((values[:, rows, columns], reach[:, rows, columns]))
        row, column = rows.stop, columns.stop
    return found


def _adjoint(part: Part) -> Part:
    values, reach = part
    return values.conj().swapaxes(1, 2), reach.swapaxes(1, 2)


def _product(one: Part, other: Part) -> Part:
    reach = one[1] @ (np.abs(other[0]) + other[1]) + np.abs(one[0]) @ other[1]
    return one[0] @ other[0], reach


def _sine(tangent: Real) -> Real:
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(tangent), 1.0, tangent / np.hypot(1.0, tangent))
