"""Charts, prepared once for two renderers, and their looks; `with_matplotlib` and `with_plotly` draw them and compute nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.report.curves import cells_per_entry, log_axis, rounded, thinned
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
    low = float(omega.min()) / HZ
    beyond = 0.02 * (high - low or high)
    return Axis("frequency [Hz]", range=(low - beyond, high + beyond))


def whole_axis(low: float, high: float, beyond: float, label: str = "order [–]") -> Axis:
    """Axis of whole numbers, at most some fifteen ticks."""
    return Axis(label, range=(low - beyond, high + beyond), tick=float(max(1, np.ceil((high - low) / 14))))


def named(panel: Panel, name: str) -> Layer:
    """Return the layer of this name."""
    return next(layer for layer in panel.layers if layer.name == name)


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
