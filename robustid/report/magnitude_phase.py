"""Magnitude and phase over frequency: the one drawing of responses, their ranges and errors, of single entries and of matrices."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, TypedDict, Unpack

import numpy as np

from robustid.report.charts import BAND, FINE, Axis, Chart, Layer, Panel
from robustid.report.curves import phase_tick


class Ranged(NamedTuple):
    """Values with the ends of their bars, or of the area around them."""

    y: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Look(TypedDict, total=False):
    """Further looks of a layer, as `Layer` describes them."""

    dash: str
    marker: str
    hover: tuple[str, ...]
    size: float
    fill: bool
    choice: bool


class MagnitudePhase:
    """Magnitude and phase of one entry, drawn layer by layer: what is added last lies on top."""

    def __init__(self) -> None:
        self.magnitude: list[Layer] = []
        self.phase: list[Layer] = []

    def add(
        self,
        name: str,
        x: np.ndarray,
        magnitude: np.ndarray | Ranged,
        phase: np.ndarray | Ranged | None = None,
        *,
        colour: str,
        under: bool = False,
        **look: Unpack[Look],
    ) -> None:
        """Draw a magnitude, and a phase in degrees where it has one, over `x` in Hz; `under` everything that is there."""
        for layers, values in ((self.magnitude, magnitude), (self.phase, phase)):
            if values is not None:
                y, low, high = values if isinstance(values, Ranged) else (values, None, None)
                layers.insert(0 if under else len(layers), Layer(name, x, y, colour, low=low, high=high, **look))

    def chart(
        self, name: str, x: Axis, size: Axis, turn: Axis, title: str, below: str = "", *, grid: bool = False
    ) -> Chart:
        """Chart of the magnitude, over its axis, and of the phase below it; both with their titles."""
        panels = Panel(title, x, size, self.magnitude), Panel(below, x, turn, self.phase)
        return Chart(name, panels, linked=True, grid=grid)


def phase_axis(span: tuple[float, float], label: str = "phase [°]") -> Axis:
    """Axis of a phase in degrees."""
    return Axis(label, range=span, tick=phase_tick(span))


def behind(panel: Panel, layers: Sequence[Layer], span: tuple[float, float]) -> Panel:
    """Put layers under those of the panel, whose curves become fine lines, and give it another range of y."""
    fine = (dataclasses.replace(layer, size=FINE) if layer.dash else layer for layer in panel.layers)
    return dataclasses.replace(panel, layers=(*layers, *fine), y=dataclasses.replace(panel.y, range=span))


def band_around(name: str, curve: Layer, at: np.ndarray, offsets: np.ndarray, bottom: float = -np.inf) -> list[Layer]:
    """Areas around a curve, exact at the frequencies `at` in Hz, one for each piece of a curve with gaps; between them offsets
    are interpolated in the logarithm. One of NaN, a phase that can be anything, is half a turn to both sides.
    """
    if not at.size:
        return []
    inside = (curve.x >= at[0]) & (curve.x <= at[-1])
    x, y = curve.x[inside], curve.y[inside]
    known = np.interp(np.log(x), np.log(at), np.isnan(offsets[:, 0])) == 0
    low, high = (
        np.maximum(y + np.where(known, _between(x, at, end), any_phase), bottom)
        for end, any_phase in zip(offsets.T, (-180.0, 180.0), strict=True)
    )
    pieces = np.split(np.arange(x.size), np.flatnonzero(~np.isfinite(y)))
    kept = [piece[np.isfinite(y[piece])] for piece in pieces]
    return [Layer(name, x[k], y[k], BAND, low=low[k], high=high[k], fill=True) for k in kept if k.size]


def _between(x: np.ndarray, at: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Offsets between the frequencies: straight on logarithmic axes, as errors are drawn; linear where the sign changes."""
    sign = np.sign(offset[0])
    if sign and np.all(sign * offset > 0):
        return sign * np.exp(np.interp(np.log(x), np.log(at), np.log(np.abs(offset))))
    return np.interp(np.log(x), np.log(at), np.nan_to_num(offset))


def error_range(layers: Sequence[Layer]) -> tuple[float, float] | None:
    """Range of an axis of errors; None where there are none."""
    values = np.concatenate([layer.y for layer in layers])
    values = values[np.isfinite(values) & (values > 0)]
    return (0.6 * float(values.min()), 1.6 * float(values.max())) if values.size else None


def error_panel(title: str, x: Axis, label: str, layers: Sequence[Layer]) -> Panel:
    """Panel of errors on a logarithmic axis."""
    return Panel(title, x, Axis(label, log=True, range=error_range(layers)), layers)
