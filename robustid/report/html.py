"""The report as one HTML file that needs nothing else: no network, no server, no other file."""

from __future__ import annotations

import datetime
import html
import importlib.metadata
import json
import os
import platform
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid._files import atomic_write
from robustid._version import __version__
from robustid.errors import InputTypeError
from robustid.identification import Identification
from robustid.report import charts, evidence, facts
from robustid.report.poles import pole_table
from robustid.report.style import NOMINAL, number

if TYPE_CHECKING:
    import control

    from robustid.reduction import Reduction

_PACKAGES = ("numpy", "scipy", "cvxpy", "clarabel", "control")
_PLOT, _SQUARE = 240, 480  # pixels: height of one panel, and of a square figure


def write_report(
    identification: Identification,
    path: str | os.PathLike[str],
    *,
    reduction: Reduction | None = None,
    title: str | None = None,
    models: Mapping[str, control.StateSpace] | None = None,
) -> None:
    """Write everything there is to know about an identification as one self-contained HTML page.

    Verdict, margin, assumptions, every sample against the models, residuals against their bounds, the samples that
    limit the result, order, poles, verification, versions. The page works offline and fetches nothing.

    Parameters
    ----------
    identification : Identification
        Consistent or not.
    path : str or path
        The file to create or replace; what was there stays if anything goes wrong.
    reduction : Reduction, optional
        Of `identification.model`; shown beside the nominal model.
    title : str, optional
        Heading; default: the names of the channels.
    models : mapping of str to control.StateSpace, optional
        Further models with the sample time of the data.

    Raises
    ------
    InputError, InputTypeError
        If a model has other channels or another sample time, or the file can't be written.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = pathlib.Path(folder) / "report.html"
    ...     write_report(result, page, title="Four samples")
    ...     "Four samples" in page.read_text()
    True
    """
    text = render_report(identification, reduction=reduction, title=title, models=models)
    with atomic_write(path) as file:
        file.write(text)


def render_report(
    identification: Identification,
    *,
    reduction: Reduction | None = None,
    title: str | None = None,
    models: Mapping[str, control.StateSpace] | None = None,
) -> str:
    """The page of `write_report` as text."""
    import jinja2
    from plotly.offline import get_plotlyjs

    if not isinstance(identification, Identification):
        raise InputTypeError(f"`identification` must be an Identification; got {type(identification).__name__}")
    if title is not None and not isinstance(title, str):
        raise InputTypeError(f"`title` must be text; got {type(title).__name__}")
    shown = further_models(reduction, models)
    figures = {
        chart.name: [
            _Figure(f"{chart.name}-{k}", part, square=chart.columns > 1) for k, part in enumerate(_parts(chart))
        ]
        for chart in (
            charts.frequency_chart(identification, shown),
            charts.time_chart(identification, shown),
            evidence.residual_chart(identification, shown),
            evidence.hankel_chart(identification, reduction),
            evidence.pole_chart(identification, shown),
        )
    }
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robustid.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    return environment.get_template("template.html.j2").render(
        title=title or f"Identification of {facts.transfer(identification)}",
        result=identification,
        facts=facts,
        figures=figures,
        tables=[(name, pole_table(model)) for name, model, *_ in charts.curves(identification, shown)],
        reduction=reduction,
        versions=versions(),
        date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        # The only text that isn't escaped: the library itself, and JSON made safe below.
        plotly=_script(get_plotlyjs()),
        data=_json({figure.id: figure.spec for parts in figures.values() for figure in parts}),
    )


def further_models(reduction: Reduction | None, models: Mapping[str, control.StateSpace] | None) -> dict[str, Any]:
    """The reduced model under its name, and the other ones."""
    out: dict[str, Any] = {}
    if reduction is not None:
        out[f"reduced model, order {reduction.order}"] = reduction.model
    if models is not None and not isinstance(models, Mapping):
        raise InputTypeError(f"`models` must map names to control.StateSpace; got {type(models).__name__}")
    return out | dict(models or {})


def versions() -> list[tuple[str, str]]:
    """What computed this."""
    first = [("robustid", __version__), ("Python", platform.python_version())]
    return first + [(name, importlib.metadata.version(name)) for name in _PACKAGES]


class _Figure:
    """One plotly figure: its id in the page, its description, its height."""

    def __init__(self, id: str, panels: tuple[charts.Panel, ...], *, square: bool) -> None:
        self.id = id
        self.height = _SQUARE if square else 150 + _PLOT * len(panels)
        self.label = "; ".join(panel.title for panel in panels)
        self.spec = plotly_figure(panels, self.height)


def _parts(chart: charts.Chart) -> list[tuple[charts.Panel, ...]]:
    return [chart.panels] if chart.linked else [(panel,) for panel in chart.panels]


def plotly_figure(panels: tuple[charts.Panel, ...], height: int) -> dict[str, Any]:
    """Panels below each other on one x axis, as plotly's description of a figure: data and layout."""
    layout: dict[str, Any] = {
        "height": height,
        "margin": {"l": 78, "r": 40, "t": 12, "b": 52},
        "modebar": {"orientation": "v"},  # beside the plot: above it stands the legend
        "font": {"family": "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif", "size": 13, "color": "#222222"},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.01, "yanchor": "bottom"},
    }
    count, gap, traces, named = len(panels), 0.08, [], set()
    for k, panel in enumerate(panels):
        suffix = "" if k == 0 else str(k + 1)
        top = 1 - k * (1 + gap) / (count + (count - 1) * gap)
        low = top - 1 / (count + (count - 1) * gap)
        # One x axis for all panels, drawn under the last: zooming one zooms all.
        if k == 0:
            layout["xaxis"] = {**_axis(panel.x), "anchor": f"y{'' if count == 1 else count}"}
        layout[f"yaxis{suffix}"] = {**_axis(panel.y), "domain": [max(low, 0.0), top], "anchor": "x"}
        if panel.square:
            layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
            layout["xaxis"] |= {"constrain": "domain"}
        for layer in panel.layers:
            traces.append({**_trace(layer), "xaxis": "x", "yaxis": f"y{suffix}", "showlegend": layer.name not in named})
            named.add(layer.name)
    return {"data": traces, "layout": layout}


def _axis(axis: charts.Axis) -> dict[str, Any]:
    out: dict[str, Any] = {
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
        full = decades < 4.3
        out["nticks"] = max(3, round(decades / 0.4)) if full else int(decades / 0.75)
        if full:
            out["tickformat"] = "~g"
    if axis.range is not None:
        out["range"] = [float(v) for v in (np.log10(axis.range) if axis.log else axis.range)]
    if axis.tick is not None:
        out["dtick"] = axis.tick
    return out


def _trace(layer: charts.Layer) -> dict[str, Any]:
    broad = layer.colour == NOMINAL
    trace: dict[str, Any] = {
        "type": "scatter",
        "name": _plain(layer.name),
        "legendgroup": _plain(layer.name),
        "x": _numbers(layer.x),
        "y": _numbers(layer.y),
        "mode": "+".join([*["lines"] * bool(layer.dash), *["markers"] * bool(layer.marker)]),
        "line": {"color": layer.colour, "width": 3 if broad else 1.6, "dash": layer.dash or "solid", "simplify": False},
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


def _numbers(values: np.ndarray) -> list[float | None]:
    """JSON has no NaN: a gap."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _plain(text: str) -> str:
    """Text that plotly, which reads a subset of HTML in its labels, shows as it stands."""
    return html.escape(text, quote=False).replace("\n", "<br>")


def _json(value: Any) -> Any:
    """JSON that can't end the script element it stands in."""
    import markupsafe

    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return markupsafe.Markup(text)


def _script(source: str) -> Any:
    """The source of a library, in whose strings an end tag may stand."""
    import markupsafe

    return markupsafe.Markup(source.replace("</script", "<\\/script"))
