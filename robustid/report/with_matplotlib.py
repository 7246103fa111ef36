"""A chart as matplotlib draws it: a figure of its own, or axes of the user."""

# Keywords of matplotlib have no types.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, cast

import numpy as np

from robustid.core import Options, Record
from robustid.errors import InputError, InputTypeError
from robustid.report.charts import MATPLOTLIB, NOMINAL, Chart, Layer, Panel
from robustid.report.words import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DASHES = {"": "none", "solid": "-", "dash": "--", "dashdot": "-.", "dot": ":"}
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "x": "x"}
_WIDTH, _HEIGHT = 7.2, 2.7  # inches, of a panel
_FURTHER, _LOW = 2.6, 1.9  # inches: width of each further column, height of one panel of a grid
_TALL = 4.2  # inches: height of a square panel, and of panels beside each other
_LABEL = 0.5  # inches that one label of an axis takes
_LETTERS = 14  # of a title in an inch


def draw(chart: Chart, ax: object = None) -> Figure:
    """Draw the chart as a matplotlib figure, or on the axes `ax` (a sequence where the chart has several panels)."""
    import matplotlib

    if ax is not None:
        return _draw_on(chart, ax)
    from matplotlib.figure import Figure

    columns = chart.columns
    rows = -(-len(chart.panels) // columns)
    square = any(panel.square for panel in chart.panels)
    height = _LOW if chart.grid and columns > 1 else _TALL if columns > 1 or square else _HEIGHT
    width = _TALL + 1.0 if square and columns == 1 else _WIDTH + _FURTHER * (columns - 1)
    with matplotlib.rc_context(MATPLOTLIB):
        figure = Figure(figsize=(width, height * rows + 0.5), layout="constrained", dpi=120)
        axes = figure.subplots(rows, columns, squeeze=False, sharex="col" if chart.linked else "none").ravel()
        handles: Record = {}
        for k, (one, panel) in enumerate(zip(axes, chart.panels, strict=True)):
            for layer in panel.layers:
                handles.setdefault(layer.name, _draw_layer(one, layer))
            lowest = not chart.linked or not any(below.layers for below in chart.panels[k + columns :: columns])
            if panel.layers:  # a blank one would change the axis that it shares
                _dress(one, panel, label_x=lowest, size=(width / columns - 0.9, height - 0.5))
            if lowest:
                one.tick_params(labelbottom=True)
            one.set_visible(bool(panel.layers))
        figure.legend(
            list(handles.values()),
            [_plain(name) for name in handles],
            loc="outside upper left",
            ncols=columns + 1,
            fontsize=8.5,
        )
    return figure


def _draw_on(chart: Chart, ax: object) -> Figure:
    """Draw on axes of the user, whose style and size stay; each gets its own legend."""
    from matplotlib.axes import Axes

    panels = [panel for panel in chart.panels if panel.layers]
    given: list[object] = np.ravel(np.asarray(ax, dtype=object)).tolist()
    axes = [one for one in given if isinstance(one, Axes)]
    if not axes or len(axes) < len(given):
        raise InputTypeError(f"`ax` must be matplotlib axes, or a sequence of them; got {type(ax).__name__}")
    if len(axes) != len(panels):
        raise InputError(
            f"`ax` must have one pair of axes for each of the {len(panels)} panels of this figure; got {len(axes)}"
        )
    for one, panel in zip(axes, panels, strict=True):
        handles: Record = {}
        for layer in panel.layers:
            handles.setdefault(layer.name, _draw_layer(one, layer))
        box = one.get_window_extent()
        inches = box.width / one.figure.dpi, box.height / one.figure.dpi
        _dress(one, panel, label_x=True, size=inches)
        one.legend(list(handles.values()), [_plain(name) for name in handles], fontsize="small")
    return cast("Figure", axes[0].figure)


def _draw_layer(ax: Axes, layer: Layer) -> object:
    marker = _MARKERS.get(layer.marker.removesuffix("-open"), "none")
    style: Options = {"color": layer.colour, "linestyle": _DASHES[layer.dash], "marker": marker}
    if layer.marker.endswith("-open"):
        style["markerfacecolor"] = "none"
    style["markersize"] = 3.6 * layer.size
    # The nominal model is a broad line, so that a thin one on top of it doesn't hide it.
    style["linewidth"] = 2.4 * layer.size if layer.colour == NOMINAL else 1.2
    if layer.low is None or layer.high is None:
        return ax.plot(layer.x, layer.y, **style)[0]
    if layer.fill:
        return ax.fill_between(layer.x, layer.low, layer.high, color=layer.colour, alpha=0.25, linewidth=0)
    bars = np.maximum(np.stack([layer.y - layer.low, layer.high - layer.y]), 0)
    return ax.errorbar(layer.x, layer.y, yerr=bars, elinewidth=0.9, capsize=2, **style)


def _dress(ax: Axes, panel: Panel, *, label_x: bool, size: tuple[float, float]) -> None:
    """Titles, scales and ticks, as many as fit in this width and height in inches."""
    from matplotlib.ticker import AutoLocator, FuncFormatter, LogLocator, MultipleLocator, NullFormatter

    ax.set_title(textwrap.fill(_plain(panel.title), int(_LETTERS * size[0])))
    room = (min(size) if panel.square else size[0]) / _LABEL, 2 * size[1] / _LABEL
    for axis, side, described, labels in ((ax.xaxis, "x", panel.x, room[0]), (ax.yaxis, "y", panel.y, room[1])):
        # Nothing of it can be drawn where all is infinite, or zero: a logarithmic axis would have no ticks then.
        log = described.log and (described.range is not None or bool(np.isfinite(getattr(ax.dataLim, f"minpos{side}"))))
        getattr(ax, f"set_{side}scale")("log" if log else "linear")
        if described.range is not None:
            getattr(ax, f"set_{side}lim")(*described.range)
        if described.tick is not None:
            axis.set_major_locator(MultipleLocator(described.tick))
        elif not log:
            few = AutoLocator()
            few.set_params(nbins=max(3, min(9, int(labels))))
            axis.set_major_locator(few)
        if side == "y" or label_x:
            axis.set_label_text(_plain(described.label))
        if described.in_full and described.range is not None:
            decades = np.log10(described.range[1] / described.range[0])
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if 3 * decades <= labels else (1.0,)))
            axis.set_minor_formatter(NullFormatter())
            axis.set_major_formatter(FuncFormatter(_tick))
    if panel.square:
        ax.set_aspect("equal")


def _tick(value: float, _: object = None) -> str:
    return _plain(number(value))


def _plain(text: str) -> str:
    """Text that matplotlib doesn't read as mathematics."""
    return text.replace("$", r"\$")
