"""Generalised Nyquist plot of two measured things: eigenvalues of the product of both, in discs that hold those of every pair."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robustid.core import Complex, Real, points_of, response_at
from robustid.guarantees import Interconnection, LoopBounds
from robustid.identification import as_system
from robustid.report.charts import ALERT, FAINT, FINE, FURTHER, NOMINAL, Chart, Layer, Panel
from robustid.report.value_sets import TURN, plane_layer, square_panel, with_gaps
from robustid.report.words import HZ, in_hz

_MOST = 60  # discs
_APART = 0.5  # of the larger radius: centres of discs that are drawn
_WIDE = 3.0  # times the largest eigenvalue, or 1: larger discs say nothing


def loci_chart(result: Interconnection, region: tuple[float, float] | None = None) -> Chart:
    """Eigenvalues of the product of both models, the discs around them, and -1: kept from it where no disc holds it.

    `region` is a forbidden one, a gain margin in dB and a phase margin in degrees.
    """
    values, radii = result.loci.ravel(), result.radius.ravel()
    shown = np.flatnonzero(radii <= _WIDE * max(1.0, float(np.abs(values).max())))
    outlines = _outlines(values[shown], radii[shown])
    layers = (
        [plane_layer("holds those of every pair", with_gaps(outlines), FAINT, dash="solid", size=FINE)]
        if outlines
        else []
    )
    place = int(np.argmin(np.abs(result.omega - result.frequency)))
    words = f"models at {in_hz(float(result.omega[place]) / HZ)}, which limits"
    layers += [
        plane_layer("models", values, NOMINAL, marker="circle", size=0.25),
        *([plane_layer(words, result.loci[place], ALERT, marker="diamond")] if np.isfinite(result.margin) else []),
        plane_layer("-1", np.array([-1.0 + 0j]), ALERT, marker="x"),
    ]
    if region is not None:
        layers.append(_forbidden(*region, float(np.abs(values).max())))
    title = "Eigenvalues of source times load"
    return Chart("loci", [square_panel(title, "of the eigenvalues [–]", layers)])


def _outlines(values: Complex, radii: Real, corners: Complex | None = None) -> list[Complex]:
    """Borders of discs, or of polygons where their corners (N, M) are known, a few that are apart from each other."""
    kept: list[int] = []
    for k in range(len(values)):
        away = np.abs(values[k] - values[kept])
        if np.all(away > _APART * np.maximum(radii[k], radii[kept])):
            kept.append(k)
    kept = kept[:: max(1, len(kept) // _MOST)]
    borders = [values[k] + radii[k] * TURN for k in kept]
    if corners is None or not corners.shape[1]:
        return borders
    polygons = corners[kept][:, [*range(corners.shape[1]), 0]]
    return [one if np.all(np.isfinite(one)) else disc for one, disc in zip(polygons, borders, strict=True)]


def _forbidden(gain: float, phase: float, largest: float) -> Layer:
    """Border of the region of a gain and phase margin about the negative real axis."""
    corner, angle, end = 10 ** (-gain / 20), math.radians(phase), max(1.5, largest)
    arc = corner * np.exp(1j * np.linspace(-angle, angle, 41))
    border = -np.concatenate([[end * np.exp(-1j * angle)], arc, [end * np.exp(1j * angle)]])
    return plane_layer(f"forbidden, {gain:g} dB and {phase:g}°", border, FURTHER[2], dash="dash")


def open_loop_chart(
    bounds: LoopBounds, omega: Real | None = None, further: Sequence[Layer] = (), name: str = "open-loop"
) -> Chart | None:
    """Nyquist plot of the open loop with discs that hold those of every consistent plant; None of matrices.

    The part around -1: of larger values nothing is decided. At frequencies, default those of the band; `further` layers lie below.
    """
    if bounds.loop.shape != (1, 1):
        return None
    omega = bounds.omega[bounds.omega > 0] if omega is None else omega
    panel = open_loop_panel(*open_loop_of(bounds, omega), further, _corners_of(bounds, omega))
    return None if panel is None else Chart(name, [panel])


def open_loop_panel(
    values: Complex, radii: Real, further: Sequence[Layer] = (), corners: Complex | None = None
) -> Panel | None:
    """Nyquist plot of discs that hold open loops, or of polygons by their corners; None where none is near -1."""
    near = np.isfinite(radii) & (np.abs(values) <= _WIDE + 0.5) & (radii <= _WIDE)
    shown = np.flatnonzero(near)
    if not shown.size:
        return None
    outlines = _outlines(values[shown], radii[shown], None if corners is None else corners[shown])
    line = np.where(np.abs(values) <= _WIDE + 0.5, values, np.nan)
    layers = [
        *further,
        plane_layer("holds that of every consistent plant", with_gaps(outlines), FAINT, dash="solid", size=FINE),
        plane_layer("centre", line, NOMINAL, dash="solid", marker="circle", size=0.4),
        plane_layer("-1", np.array([-1.0 + 0j]), ALERT, marker="x"),
    ]
    return square_panel("Open loop, plant times controller", "of the open loop [–]", layers)


def open_loop_of(bounds: LoopBounds, omega: Real) -> tuple[Complex, Real]:
    """Discs that hold the open loops of all consistent plants of one input and one output, (F,) each."""
    centre, radius = bounds.plant_at(omega)
    gain = _gain_of(bounds, omega)
    return centre[:, 0, 0] * gain, radius * np.abs(gain)


def _gain_of(bounds: LoopBounds, omega: Real) -> Complex:
    law = as_system("controller", bounds.controller)[0]
    return response_at(law, points_of(omega, bounds.loop.dt))[:, 0, 0]


def _corners_of(bounds: LoopBounds, omega: Real) -> Complex | None:
    """Corners of polygons that hold the open loops of plants that were measured without a controller, (F, M)."""
    model, corners = bounds.band.model, bounds.band.circle.sets_at(omega).corners
    if model is None or not (bounds.in_open_loop and corners.shape[1]):
        return None
    return (bounds.band.problem.plane.values_at(model, omega)[:, 0] + corners) * _gain_of(bounds, omega)[:, None]
