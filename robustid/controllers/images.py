r"""Values of the plants of one entry that sets of R make: images of discs by a Möbius map, which are discs, or outside of one.

With :math:`P = P_0 + k \Delta / (1 - m \Delta)` a disc of Δ about e with the radius r is the disc with

.. math:: \text{centre } P_0 + \frac{k}{1 - m e}\left(e + \frac{\bar m r^2}{\rho}\right), \qquad
          \text{radius } \frac{|k|\, r}{|\rho|}, \qquad \rho = |1 - m e|^2 - |m|^2 r^2,

or, where :math:`\rho < 0`, all that is outside of it: the plant may be infinite there, as one with an integrator is.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from robustid.controllers.discs import Discs
from robustid.core import Complex, Real
from robustid.guarantees import ErrorSets

_NARROW = 0.95  # of the diameter of a disc: polygons that are narrower in some direction
_EDGE = 1e-3  # of the distance of a disc's centre from where the plant is infinite: a border as near has an image without end


class Chart(NamedTuple):
    """The plant about that of the model, (N,) each: ``value + slope Delta/(1 - inner Delta)``."""

    value: Complex
    slope: Complex
    inner: Complex


def smallest_sets(errors: ErrorSets, factor: Real) -> ErrorSets:
    """The smaller of the two discs of every set, and its polygon, all times factors (N,) about the centres of these discs."""
    about_model = errors.bound < errors.radius
    centre = np.where(about_model, 0.0, errors.centre)
    radius = np.minimum(errors.bound, errors.radius) * factor[:, None, None]
    middle = centre[:, 0]
    return ErrorSets(np.abs(centre) + radius, centre, radius, middle + (errors.corners - middle) * factor[:, None])


def discs_of_entry(omega: Real, chart: Chart, errors: ErrorSets) -> Discs:
    """The smallest discs of one input and one output, in open loop with polygons that are narrower."""
    if not np.any(chart.inner):
        middle = chart.value[:, None, None] + chart.slope[:, None, None] * errors.centre
        found = Discs.of(omega, middle, errors.radius[:, 0, 0], np.ones((omega.size, 1)))
        # polygons about the centres, where they are narrower than the discs
        corners = errors.corners - errors.centre[:, 0]
        count = int(corners.shape[1])
        if not count:
            return found
        turns: Complex = np.exp(-2j * np.pi * np.arange(count) / count)
        turned = corners[:, None] * turns[:, None]
        narrow = np.ptp(turned.real, axis=2).min(axis=1) < _NARROW * 2 * found.radius
        return found._replace(
            corners=np.where(narrow[:, None], corners, 0.0), around=np.where(narrow, 0.0, found.radius)
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        infinite = 1 / chart.inner
    found = [_images(omega, chart, held.centre[:, 0, 0], held.radius[:, 0, 0]) for held in errors.discs(infinite)]
    return functools.reduce(_narrower, found)


def _images(omega: Real, chart: Chart, centre: Complex, radius: Real) -> Discs:
    """Images of discs; one that has no end is widened to one that holds infinity."""
    about, size = 1 - chart.inner * centre, np.abs(chart.inner)
    far = np.abs(about)
    with np.errstate(divide="ignore", invalid="ignore"):
        edge = np.abs(far - size * radius) < _EDGE * far
        radius = np.where(edge, far * (1 + _EDGE) / size, radius)
        room = (far - size * radius) * (far + size * radius)
        middle = chart.value + chart.slope / about * (centre + chart.inner.conj() * radius**2 / room)
        plant = chart.value + chart.slope / about * centre
        reach = np.abs(chart.slope) * radius / np.abs(room)
    found = Discs.of(omega, middle[:, None, None], reach, np.ones((omega.size, 1)))
    return found._replace(outside=room < 0, plant=plant[:, None, None])


def _narrower(one: Discs, other: Discs) -> Discs:
    """At every frequency the one of two that has an end, and the smaller radius; of two without an end the larger one."""
    sizes = [np.where(discs.outside, np.inf, discs.radius) for discs in (one, other)]
    first = np.where(np.isinf(sizes[0]) & np.isinf(sizes[1]), one.radius >= other.radius, sizes[0] <= sizes[1])
    parts: list[Any] = [
        np.where(first.reshape(-1, *[1] * (mine.ndim - 1)), mine, theirs)
        for mine, theirs in zip(one, other, strict=True)
    ]
    return Discs(*parts)
