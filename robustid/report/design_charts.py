"""Figures of a designed controller: worst cases with their limits, the open loop of every consistent plant."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from robustid.controllers import ControllerDesign, Limits
from robustid.core import Real, StateMatrices, points_of, response_at
from robustid.errors import InputError
from robustid.guarantees import Balls, LoopBounds
from robustid.report.charts import ALERT, BAND, FURTHER, NOMINAL, Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.curves import half_angle, phase_curves, span_of
from robustid.report.loci import open_loop_chart, open_loop_of
from robustid.report.loop_section import map_units
from robustid.report.magnitude_phase import MagnitudePhase, Ranged, phase_axis
from robustid.report.value_sets import TURN, plane_layer
from robustid.report.words import HZ, number

_POINTS, _DISCS = 700, 250  # frequencies of curves, and of discs in the plane
_FINER = 8  # times as many frequencies, of which those of discs are chosen
_BELOW = 10.0  # times the lowest frequency that is asked about: where the axis begins
_DEEP = 1e-5  # of the largest value: what is lower is not drawn
_ARC = 41  # points of an arc
_LOW = 1e-4  # of an open loop: what is lower decides nothing
_THIN = 0.6  # of a curve with many fine ripples
_NEAR = ((-2.0, 0.4), (-1.5, 0.9))  # real and imaginary parts of what is near -1
MAPS = {
    "sensitivity": ("S", "sensitivity_peak"),
    "complementary_sensitivity": ("T", "complementary_peak"),
    "process_sensitivity": ("P S", "process_peak"),
    "control_sensitivity": ("C S", "control_peak"),
}  # of the loop: letters, and the limit of the peak
LARGEST, SMALLEST = "largest with any consistent plant", "smallest with any consistent plant"
LIMIT, LEAST = "limit", "limit, at least"


def asked_of(design: ControllerDesign) -> Limits:
    """The limits that are proved: those that were stated, and that the goal reaches its level."""
    return design.goal.asked(design.limits, design.level) if design.controller is not None else design.limits


def design_chart(design: ControllerDesign) -> Chart:
    """Largest S, T, P S and C S with any consistent plant over frequency, each with its limits."""
    omega, limits = _frequencies(proofs_of(design)), asked_of(design)
    maps = [one.at(omega) for one in design.proofs]
    axis, panels, units = frequency_axis(omega), list[Panel](), map_units(design.proofs[0])
    for name, (letters, _) in MAPS.items():
        balls = [Balls(*one[name]) for one in maps]
        curves = [curve(LARGEST, omega, np.max([one.largest for one in balls], axis=0), NOMINAL)]
        if bounded_below(limits, name):
            curves.append(curve(SMALLEST, omega, np.min([one.least for one in balls], axis=0), FURTHER[0]))
        bounds = limit_layers(limits, name, omega)
        y = np.concatenate([curves[0].y, *(layer.y for layer in bounds)])
        y = y[np.isfinite(y)]
        span = span_of(np.maximum(y, _DEEP * y.max(initial=0.0)), 1.3) if y.size else None
        label = Axis(f"{'largest ' * (len(curves) == 1)}|{letters}|{units[name] or ' [–]'}", log=True, range=span)
        panels.append(Panel(letters, axis, label, [*curves, *bounds]))
    return Chart("design", panels, linked=True)


def curve(name: str, omega: Real, sizes: Real, colour: str) -> Layer:
    """Sizes over frequency, where they are finite and positive."""
    shown = np.where(np.isfinite(sizes) & (sizes > 0), sizes, np.nan)
    return Layer(name, omega / HZ, shown, colour, "solid", size=_THIN)


def bounded_below(limits: Limits, name: str) -> bool:
    """Return whether a template asks that a map of the loop is large."""
    return any(template.least and template.map == name for template, *_ in limits.rows)


def proofs_of(design: ControllerDesign) -> tuple[LoopBounds, ...]:
    """Worst cases of the controller with the plants of every band."""
    if not design.proofs:
        raise InputError(
            "`result` has no controller: none was found that keeps the limits, and there is nothing to draw"
        )
    return design.proofs


def _frequencies(proofs: tuple[LoopBounds, ...]) -> Real:
    """Frequencies of the curves: from below what was measured to the end of the axis."""
    known = np.concatenate([one.omega[one.omega > 0] for one in proofs])
    dt = proofs[0].loop.dt
    high = 0.9999 * np.pi / dt if dt else 3 * float(known.max())
    return np.geomspace(float(known.min()) / _BELOW, high, _POINTS)


def limit_layers(limits: Limits, name: str, omega: Real) -> list[Layer]:
    """Limits of a map of the loop: its peak as a line over the whole axis, ranges of frequencies as steps."""
    start, end, peak = float(omega[0]), float(omega[-1]), getattr(limits, MAPS[name][1])
    steps = [] if peak is None else [(LIMIT, start, end, peak)]
    for template, low, high, value in limits.rows:
        if template.map == name and max(low, start) < min(high, end):
            steps.append((LEAST if template.least else LIMIT, max(low, start), min(high, end), value))
    found: list[Layer] = []
    for said, dash in ((LIMIT, "dash"), (LEAST, "dashdot")):
        shown = [row for own, *row in steps if own == said]
        if shown:
            x = np.concatenate([[low, high, np.nan] for low, high, _ in shown]) / HZ
            y = np.concatenate([[value, value, np.nan] for *_, value in shown])
            found.append(Layer(said, x, y, ALERT, dash=dash))
    return found


def open_loop_bode(design: ControllerDesign) -> Chart:
    """Magnitude and phase of the open loop in the range of every consistent plant, and what the bandwidth asks."""
    proofs = proofs_of(design)
    omega, drawn = _frequencies(proofs), MagnitudePhase()
    x, found = omega / HZ, [open_loop_of(one, omega) for one in proofs]
    sizes = [np.where(np.isfinite(radius), np.abs(centre), np.nan) for centre, radius in found]  # nan: perhaps infinite
    top = 3.0 * max(map(np.nanmax, sizes))
    floor = max(0.3 * min(map(np.nanmin, sizes)), _LOW * min(top, 1.0))
    phases, (low, high) = phase_curves([centre for centre, _ in found])
    for (centre, radius), size, phase in zip(found, sizes, phases, strict=True):
        known = np.isfinite(radius)
        ends = [np.where(known, np.clip(size + sign * radius, floor, top), np.nan) for sign in (-1, 1)]
        turn = half_angle(size, np.where(known, radius, np.inf))
        turn = np.where(size > radius, turn, 180.0)
        angles = np.clip(phase - turn, low, high), np.clip(phase + turn, low, high)
        drawn.add(
            "range of every consistent plant",
            x,
            Ranged(size, ends[0], ends[1]),
            Ranged(phase, *angles),
            colour=BAND,
            under=True,
            fill=True,
        )
        drawn.add("centre", x, size, phase, colour=NOMINAL, dash="solid")
        del centre
    if (end := asked_of(design).bandwidth) is not None:
        ends = np.array([float(omega[0]), end]) / HZ
        drawn.add("bandwidth: at least 1 with every plant", ends, np.ones(2), colour=ALERT, dash="dash")
    y = Axis("|P C| [–]", log=True, range=(floor, top))
    turn = phase_axis((low, high), "phase of P C [°]")
    return drawn.chart("open-loop-bode", frequency_axis(omega), y, turn, "Open loop, P C")


def nyquist_charts(design: ControllerDesign) -> list[Chart]:
    """Nyquist plots of the open loops of every band, discs of all consistent plants, and what the limits keep them out of."""
    proofs, further = proofs_of(design), kept_out(asked_of(design))
    high = float(_frequencies(proofs)[-1])
    charts: list[Chart] = []
    for k, one in enumerate(proofs, start=1):
        omega = _along(one, float(one.omega[one.omega > 0].min()) / _BELOW, high)
        chart = open_loop_chart(one, omega, further, f"open-loop-{k}")
        if chart is not None:
            whole = chart.panels[0]
            if len(proofs) > 1:
                whole = dataclasses.replace(whole, title=f"{whole.title}, band {k}")
            x, y = (dataclasses.replace(axis, range=span) for axis, span in zip((whole.x, whole.y), _NEAR, strict=True))
            near = dataclasses.replace(whole, title="The same, near −1", x=x, y=y)
            charts.append(dataclasses.replace(chart, panels=[whole, near], columns=2))
    return charts


def _along(proof: LoopBounds, low: float, high: float) -> Real:
    """Frequencies of discs: half of them spread over the axis, half along the open loop, where a light mode is a circle."""
    fine, model = np.geomspace(low, high, _FINER * _DISCS), proof.band.model
    if model is None:
        return fine[::_FINER]
    points, loop = points_of(fine, proof.loop.dt), proof.loop
    plant, law = StateMatrices.of(loop.plant_of(model)), loop.as_controller(proof.controller)
    L = response_at(plant, points)[:, 0, 0] * response_at(law, points)[:, 0, 0]
    steps = np.abs(np.diff(L / (1 + np.abs(L))))  # what is far from -1 decides nothing
    length = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    share: Real = np.linspace(0.0, 1.0, fine.size) + length / (length[-1] or 1.0)
    chosen: Real = np.linspace(0.0, float(share[-1]), _DISCS)
    return np.asarray(np.interp(chosen, share, fine), dtype=float)


def kept_out(limits: Limits, said: str = "kept out: ") -> list[Layer]:
    """Parts of the plane of the open loop that limits keep every plant out of; `said` before their names."""
    found: list[Layer] = []
    if (peak := limits.sensitivity_peak) is not None:
        found.append(plane_layer(f"{said}|S| above {number(peak)}", -1 + TURN / peak, ALERT, dash="dash"))
    if (peak := limits.complementary_peak) is not None:
        size = peak / (peak**2 - 1)
        circle = -peak * size + size * TURN
        found.append(plane_layer(f"{said}|T| above {number(peak)}", circle, FURTHER[1], dash="dash"))
    if (gain := limits.gain_margin) is not None:
        ends = np.array([-1.0, -1 / gain], complex)
        found.append(plane_layer(f"{said}gain margin {number(gain)}", ends, FURTHER[2], dash="dash", size=1.5))
    if (phase := limits.phase_margin) is not None:
        arc = -np.exp(1j * np.linspace(-phase, phase, _ARC))
        words = f"{said}phase margin {number(math.degrees(phase))}°"
        found.append(plane_layer(words, arc, FURTHER[0], dash="dash"))
    return found
