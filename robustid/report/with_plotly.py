"""A chart as plotly draws it: data and layout, ready for JSON."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.report.charts import NOMINAL, Axis, Chart, Layer, Panel
from robustid.report.curves import between_gaps

Drawn = dict[str, Any]  # as plotly reads it
_POWERS = 0.85  # size of the ticks of powers of ten, which plotly draws a quarter larger than others
_LARGE = 1e6  # ends of axes from which ticks have prefixes
_PLOT, _SQUARE, _SMALL = 240, 480, 150  # pixels: height of one panel, of a square figure, of one panel among many


class Figure:
    """One plotly figure: its id in the page, its description, its height."""

    def __init__(self, id: str, panels: Sequence[Panel], *, square: bool = False, small: bool = False) -> None:
        self.id = id
        self.height = _SQUARE if square else 150 + _PLOT * len(panels)
        if small:
            self.height = 60 + _SMALL * len(panels)
        self.panels, self.small, self.square = panels, small, square
        self.label = "; ".join(panel.title for panel in panels if panel.title)
        self.spec = plotly_figure(panels, self.height, small=small)

    @property
    def alternative(self) -> str:
        """The figure in words: its title, its curves, its axes."""
        layers = dict.fromkeys(layer.name for panel in self.panels for layer in panel.layers)
        axes = dict.fromkeys(panel.y.label for panel in self.panels if panel.layers)
        drawn = f"{'; '.join(axes)} over {self.panels[-1].x.label}: {', '.join(layers)}"
        return (f"{self.label}. {drawn}" if self.label else drawn).replace("\n", " ")


def figures(chart: Chart, *, small: bool = False) -> list[Figure]:
    """Draw a chart as one figure, or as one a panel where they aren't linked."""
    parts = [chart.panels] if chart.linked else [(panel,) for panel in chart.panels]
    square = chart.columns > 1
    return [Figure(f"{chart.name}-{k}", part, square=square, small=small) for k, part in enumerate(parts)]


def plotly_figure(
    panels: Sequence[Panel], height: int, *, small: bool = False, domains: Sequence[tuple[float, float]] = ()
) -> Drawn:
    """Describe panels below each other on one x axis as plotly does: data and layout. A `small` one is one of many, under one
    legend; `domains`: the ends of each panel of a live figure, as parts of its height.
    """
    layout: Drawn = {
        "height": height,
        "margin": {"l": 50, "r": 10, "t": 6, "b": 40} if small else {"l": 78, "r": 40, "t": 12, "b": 52},
        "modebar": {"orientation": "v"},  # beside the plot: above it stands the legend
        "font": {
            "family": "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif",
            "size": 11 if small else 13,
            "color": "#222222",
        },
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.01, "yanchor": "bottom"},
    }
    if small:
        layout["showlegend"] = False
    letters = layout["font"]["size"]
    if domains:  # a tall figure that is watched: more room for its curves
        layout["legend"]["font"] = {"size": 12}
    count, gap = len(panels), 0.08
    traces: list[Drawn] = []
    named: set[str] = set()
    for k, panel in enumerate(panels):
        suffix = "" if k == 0 else str(k + 1)
        top = 1 - k * (1 + gap) / (count + (count - 1) * gap)
        low, top = domains[k] if domains else (max(top - 1 / (count + (count - 1) * gap), 0.0), top)
        # One x axis for all panels, drawn under the last: zooming one zooms all.
        if k == 0:
            layout["xaxis"] = {**_axis(panel.x, letters), "anchor": f"y{'' if count == 1 else count}"}
            if small:
                layout["xaxis"]["nticks"] = 3 if panel.x.log else 5
        layout[f"yaxis{suffix}"] = {**_axis(panel.y, letters), "domain": [low, top], "anchor": "x"}
        if panel.square:
            layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
            layout["xaxis"] |= {"constrain": "domain"}
        for layer in panel.layers:
            trace = _trace(layer) | ({"customdata": _numbers(layer.x)} if domains and layer.choice else {})
            traces.append({**trace, "xaxis": "x", "yaxis": f"y{suffix}", "showlegend": layer.name not in named})
            named.add(layer.name)
    return {"data": traces, "layout": layout}


def _axis(axis: Axis, letters: int) -> Drawn:
    out: Drawn = {
        "title": {"text": _plain(axis.label), "standoff": 8},
        "type": "log" if axis.log else "linear",
        "gridcolor": "#e6e6e6",
        "zeroline": False,
        "showline": True,
        "linecolor": "#8a8a8a",
        "ticks": "outside",
        "automargin": True,
        "exponentformat": "power",
    }
    if axis.log:
        out["minor"] = {"ticks": "outside"}
        decades = np.log10(axis.range[1] / axis.range[0]) if axis.range else 9
        # With about this many ticks plotly chooses 0.5, 1, 2, 5, …, or powers of ten only; fixed ticks would leave none
        # after zooming in. The format has it write them in full, not as small digits between powers of ten.
        out["nticks"] = max(3, round(decades / 0.4)) if axis.in_full else max(3, int(decades / 0.75))
        if axis.in_full:
            large = axis.range is not None and axis.range[1] >= _LARGE
            out["tickformat"] = "~s" if large else "~g"  # 2G in place of 2e+9
        else:
            out["tickfont"] = {"size": _POWERS * letters}
    if axis.range is not None:
        out["range"] = [float(v) for v in (np.log10(axis.range) if axis.log else axis.range)]
    if axis.tick is not None:
        out["dtick"] = axis.tick
    return out


def _trace(layer: Layer) -> Drawn:
    if layer.fill and layer.low is not None and layer.high is not None:
        return _area(layer, layer.low, layer.high)
    broad = layer.colour == NOMINAL
    trace: Drawn = {
        "type": "scatter",
        "name": _plain(layer.name),
        "legendgroup": _plain(layer.name),
        "x": _numbers(layer.x),
        "y": _numbers(layer.y),
        "mode": "+".join([*["lines"] * bool(layer.dash), *["markers"] * bool(layer.marker)]),
        "line": {
            "color": layer.colour,
            "width": 3 * layer.size if broad else 1.6,
            "dash": layer.dash or "solid",
            "simplify": False,
        },
    }
    if layer.marker:
        line = {"width": 1.6} if layer.marker.endswith("-open") else {}
        symbol = "x-thin" if layer.marker == "x" else layer.marker
        if symbol == "x-thin":
            line = {"width": 1.8, "color": layer.colour}
        trace["marker"] = {"symbol": symbol, "color": layer.colour, "size": 6 * layer.size, "line": line}
    if layer.hover:
        trace |= {"hovertext": [_plain(text) for text in layer.hover], "hoverinfo": "text+name"}
    if layer.low is not None and layer.high is not None:
        trace["error_y"] = {
            "type": "data",
            "symmetric": False,
            "array": _numbers(np.maximum(layer.high - layer.y, 0)),
            "arrayminus": _numbers(np.maximum(layer.y - layer.low, 0)),
            "color": layer.colour,
            "thickness": 1.1,
            "width": 3,
        }
    return trace


def _area(layer: Layer, low: np.ndarray, high: np.ndarray) -> Drawn:
    """From `low` to `high`, as a polygon; several ones where there are gaps."""
    gap = np.full(1, np.nan)
    x: list[np.ndarray] = []
    y: list[np.ndarray] = []
    for piece in between_gaps(low + high):
        x += [layer.x[piece], layer.x[piece][::-1], gap]
        y += [high[piece], low[piece][::-1], gap]
    return {
        "type": "scatter",
        "name": _plain(layer.name),
        "legendgroup": _plain(layer.name),
        "x": _numbers(np.concatenate(x[:-1])) if x else [],
        "y": _numbers(np.concatenate(y[:-1])) if y else [],
        "mode": "lines",
        "fill": "toself",
        "fillcolor": layer.colour + "40",
        "line": {"width": 0, "color": layer.colour},
        "hoverinfo": "skip",
    }


def _numbers(values: np.ndarray) -> list[float | None]:
    """JSON has no NaN: a gap."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _plain(text: str) -> str:
    """Text that plotly, which reads a subset of HTML in its labels, shows as it stands."""
    return html.escape(text, quote=False).replace("\n", "<br>")
