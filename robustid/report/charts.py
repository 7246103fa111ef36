"""Charts, prepared once for two renderers, and their looks; `with_matplotlib` and `with_plotly` draw them and compute nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypedDict

import numpy as np

from robustid.report.curves import cells_per_entry, log_axis, phase_tick, rounded, thinned
from robustid.report.words import HZ

# Okabe and Ito's palette: told apart with every kind of colour blindness, and by their grey when printed.
DATA = "#222222"
FAINT = "#8a8a8a"
NOMINAL = "#0072B2"
ALERT = "#D55E00"
FURTHER = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9")
# Colour is never the only difference: models also differ by their dashes and markers.
DASHES = ("dash", "dashdot", "dot")
MARKERS = ("square-open", "diamond-open", "triangle-up-open")
BAND = FURTHER[3]  # of a guaranteed range
REACHED = "reached by consistent systems"
FINE = 0.45  # size of a curve or marker that must not hide what is around it
MATPLOTLIB: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": "#444444",
    "axes.edgecolor": "#8a8a8a",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
}
_SMALLER = 0.6  # size of curves and markers in small figures


def further(index: int) -> tuple[str, str, str]:
    """Colour, dash and marker of the further model number `index`."""
    return FURTHER[index % len(FURTHER)], DASHES[index % len(DASHES)], MARKERS[index % len(MARKERS)]


@dataclasses.dataclass(frozen=True)
class Axis:
    """One axis: label with unit, scale, and range (None: as the data want)."""

    label: str
    log: bool = False
    range: tuple[float, float] | None = None
    tick: float | None = None

    @property
    def in_full(self) -> bool:
        """True where the numbers of a logarithmic axis are written in full, 0.5, 1, 2, and not as powers of ten."""
        if not self.log or self.range is None or self.range[1] > 2e4 * self.range[0]:
            return False
        return self.range[1] < 30 * self.range[0] or (self.range[0] >= 1e-4 and self.range[1] <= 1e5)


@dataclasses.dataclass(frozen=True)
class Layer:
    """A curve (`dash`), samples (`marker`), or both; `low` and `high` are the ends of the bars, or of an area (`fill`).

    The points of a `choice` can be chosen in a live figure, by their abscissae.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    colour: str
    dash: str = ""
    marker: str = ""
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    hover: tuple[str, ...] = ()
    size: float = 1.0
    fill: bool = False
    choice: bool = False


class Ends(TypedDict, total=False):
    """Ends of the bars or of the area of a layer; none where they are not known."""

    low: np.ndarray
    high: np.ndarray


@dataclasses.dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    x: Axis
    y: Axis
    layers: Sequence[Layer]
    square: bool = False


BLANK = Panel("", Axis(""), Axis(""), ())  # a place that stays empty


@dataclasses.dataclass(frozen=True)
class Chart:
    """One figure: panels below each other on one x axis (`linked`), or each with its own; `grid`: one of many low ones."""

    name: str
    panels: Sequence[Panel]
    linked: bool = False
    columns: int = 1
    grid: bool = False


def frequency_axis(omega: np.ndarray) -> Axis:
    """Axis in Hz over the frequencies."""
    log = log_axis(omega)
    low, high = float(omega[omega > 0].min(initial=omega.max())) / HZ, float(omega.max()) / HZ
    if not high:
        return Axis("frequency [Hz]")
    if log:
        at_zero = " (0 Hz has no place on it)" if omega.min() == 0 else ""
        return Axis(f"frequency [Hz]{at_zero}", log=True, range=(low / 1.05, high * 1.05))
    return Axis("frequency [Hz]", range=(float(omega.min()) / HZ - 0.02 * high, 1.02 * high))


def phase_axis(span: tuple[float, float], label: str = "phase [°]", tick: float | None = None) -> Axis:
    """Axis of a phase in degrees."""
    return Axis(label, range=span, tick=tick or phase_tick(span))


def order_axis(low: float, high: float, beyond: float) -> Axis:
    """Axis of whole numbers, at most some fifteen ticks."""
    return Axis("order [–]", range=(low - beyond, high + beyond), tick=float(max(1, np.ceil((high - low) / 14))))


def stacked(
    name: str, x: Axis, drawn: Sequence[tuple[Axis, Sequence[Layer]]], titles: Sequence[str], *, grid: bool = False
) -> Chart:
    """Chart of panels below each other on one x axis: each with its y axis, its layers and its title."""
    panels = [Panel(title, x, y, layers) for (y, layers), title in zip(drawn, titles, strict=True)]
    return Chart(name, panels, linked=True, grid=grid)


def named(panel: Panel, name: str) -> Layer:
    """Return the layer of this name."""
    return next(layer for layer in panel.layers if layer.name == name)


def behind(panel: Panel, layers: Sequence[Layer], span: tuple[float, float]) -> Panel:
    """Put layers under those of the panel, whose curves become fine lines, and give it another range of y."""
    fine = (dataclasses.replace(layer, size=FINE) if layer.dash else layer for layer in panel.layers)
    return dataclasses.replace(panel, layers=(*layers, *fine), y=dataclasses.replace(panel.y, range=span))


def side_by_side(name: str, charts: Sequence[Chart], columns: int, *further: Sequence[Panel]) -> Chart:
    """Make charts of entries, row by row, one chart; each group of further panels begins a row of its own."""
    rows = [charts[k : k + columns] for k in range(0, len(charts), columns)]
    panels = [panel for row in rows for parts in zip(*(chart.panels for chart in row), strict=True) for panel in parts]
    for group in further:
        panels += [*group, *[BLANK] * (-len(group) % columns)]
    return Chart(name, panels, linked=True, columns=columns, grid=True)


def first_panel(chart: Chart) -> Chart:
    """Keep the first panel of a chart, for the first screen of a page."""
    return Chart("first", chart.panels[:1], linked=True)


def in_rows(chart: Chart, columns: int, *groups: Sequence[Panel]) -> Chart:
    """Put the panels of a chart in rows, each with axes of its own, and further groups of panels below them."""
    return dataclasses.replace(side_by_side(chart.name, [], columns, chart.panels, *groups), linked=False)


def lighter(charts: Sequence[Chart]) -> list[Chart]:
    """Keep as many points and digits as small figures show, and finer: no peak and no notch is lost, the page stays small."""
    cells = cells_per_entry(len(charts))
    return [
        dataclasses.replace(
            chart,
            panels=tuple(
                dataclasses.replace(panel, layers=tuple(_light(layer, panel.x.log, cells) for layer in panel.layers))
                for panel in chart.panels
            ),
        )
        for chart in charts
    ]


def _light(layer: Layer, log: bool, cells: int) -> Layer:
    kept = np.arange(layer.x.size)
    if not layer.marker and layer.x.size:
        position = np.log(layer.x) if log else layer.x
        bounds = [end for end in (layer.low, layer.high) if end is not None]
        kept = thinned(position, bounds or [layer.y], cells)
    arrays = {name: getattr(layer, name) for name in ("x", "y", "low", "high")}
    size = max(_SMALLER * layer.size, min(FINE, layer.size))
    return dataclasses.replace(
        layer, size=size, **{name: rounded(array[kept]) for name, array in arrays.items() if array is not None}
    )


def band_around(name: str, curve: Layer, at: np.ndarray, offsets: np.ndarray, bottom: float = -np.inf) -> list[Layer]:
    """Areas around a curve, exact at the frequencies `at` in Hz; one for each piece of a curve with gaps.

    Between them the offsets are interpolated in the logarithm. One of NaN is a phase that can be anything: half a turn to both
    sides, up to the next frequencies.
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


def error_range(layers: list[Layer]) -> tuple[float, float] | None:
    """Range of an axis of errors; None where there are none."""
    values = np.concatenate([layer.y for layer in layers])
    values = values[np.isfinite(values) & (values > 0)]
    return (0.6 * float(values.min()), 1.6 * float(values.max())) if values.size else None
