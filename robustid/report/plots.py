"""The plots with matplotlib, as figures of their own: no pyplot, no global state, any backend."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.report import charts, evidence, matrix_charts
from robustid.report.style import MATPLOTLIB, NOMINAL, number

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from robustid.identification import Identification
    from robustid.reduction import Reduction

_DASHES = {"": "none", "solid": "-", "dash": "--", "dashdot": "-.", "dot": ":"}
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "x": "x"}
_WIDTH, _HEIGHT = 7.2, 2.7  # inches, of a panel
_FURTHER, _LOW = 2.6, 1.9  # inches: width of each further column, height of one panel of a grid
_LABEL = 0.5  # inches that one label of an axis takes
_LETTERS = 14  # of a title in an inch


def plot_frequency_response(
    identification: Identification, models: Mapping[str, control.StateSpace] | None = None
) -> Figure:
    """Magnitude and phase of the models, and of every sample with its error disc: of every entry, and the singular values.

    Bars: |value| ± bound, and the phase ± arcsin(bound/|value|) of that disc (any phase where it holds 0); of a bound that
    entries share the disc that it leaves to one alone. The largest singular value of what was measured is drawn with the norm
    of the matrix of these bounds, at lines with every entry.

    Parameters
    ----------
    identification : Identification
    models : mapping of str to control.StateSpace, optional
        Further models with the sample time of the data, such as a reduced one.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError, InputTypeError
        If a model isn't a StateSpace with the channels and the sample time of the data.

    Examples
    --------
    >>> import robustid as rid
    >>> experiment = rid.flexible_structure(lines=5)
    >>> prior = rid.Prior(gain_bound=20.0, decay_rate=1.04)
    >>> result = rid.identify(rid.MixedProblem(frequency=experiment.frequency, prior=prior))
    >>> figure = plot_frequency_response(result, {"the plant itself": experiment.truth})
    >>> figure.axes[1].get_xlabel()
    'frequency [Hz]'
    """
    found = charts.frequency_charts(identification, models)
    if identification.problem.entries.single:
        return draw(found[0])
    entries, sigma = matrix_charts.lighter(found), matrix_charts.sigma_chart(identification, models).panels
    return draw(matrix_charts.side_by_side("frequency", entries, len(identification.problem.inputs), sigma))


def plot_time_response(
    identification: Identification, models: Mapping[str, control.StateSpace] | None = None
) -> Figure:
    """Every record with the interval of each sample against the models; their step and pulse responses.

    Parameters and errors as for `plot_frequency_response`. Several channels: every output of the records, and every entry of
    the responses to a step and a pulse. A record from an unknown state is compared with the
    best free response of the parametric part added.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01, outputs=["torsion [rad]"])
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> [axes.get_ylabel() for axes in plot_time_response(result).axes]
    ['torsion [rad]', 'torsion [rad]', 'torsion [rad]']
    """
    chart, columns = charts.time_chart(identification, models), len(identification.problem.inputs)
    if not identification.problem.entries.single:
        answers = matrix_charts.lighter(matrix_charts.answer_charts(identification, models))
        chart = _in_grid(chart, columns, matrix_charts.side_by_side("answers", answers, columns).panels)
    return draw(chart)


def plot_residuals(identification: Identification, models: Mapping[str, control.StateSpace] | None = None) -> Figure:
    """|residual|/bound of every sample, with the limit 1 and the margin, and who touches it.

    Parameters and errors as for `plot_frequency_response`; a panel for each entry or output, or for what shares a bound (the
    norm of those samples together). Samples within 1 % of max(1, margin) are marked; beyond a
    ratio of 3 the axis is logarithmic, and ratios below 1e-3 are drawn at 1e-3.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> plot_residuals(result).axes[0].get_ylabel()
    '|residual| / bound'
    """
    chart = evidence.residual_chart(identification, models)
    return draw(_in_grid(chart, len(identification.problem.inputs)) if chart.grid else chart)


def plot_hankel(identification: Identification, reduction: Reduction | None = None) -> Figure:
    """Hankel singular values of the full model, with the order that a reduction chose.

    Parameters
    ----------
    identification : Identification
    reduction : Reduction, optional
        Of `identification.model`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> plot_hankel(result).axes[0].get_title(loc="left")
    'Hankel singular values'
    """
    return draw(evidence.hankel_chart(identification, reduction))


def plot_poles(identification: Identification, models: Mapping[str, control.StateSpace] | None = None) -> Figure:
    """Poles in the z-plane with the unit circle and the circle 1/rho, and damping over frequency.

    Parameters and errors as for `plot_frequency_response`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> [axes.get_xlabel() for axes in plot_poles(result).axes]
    ['real part of z [–]', 'natural frequency [Hz]']
    """
    return draw(evidence.pole_chart(identification, models))


def _in_grid(chart: charts.Chart, columns: int, *groups: Any) -> charts.Chart:
    """The panels of a chart in rows, each with axes of its own, and further groups of panels below them."""
    found = matrix_charts.side_by_side(chart.name, [], columns, chart.panels, *groups)
    return dataclasses.replace(found, linked=False)


def draw(chart: charts.Chart) -> Figure:
    """The chart as a matplotlib figure."""
    import matplotlib
    from matplotlib.figure import Figure

    columns = chart.columns
    rows = -(-len(chart.panels) // columns)
    height = _HEIGHT if columns == 1 else _LOW if chart.grid else 4.2
    width = _WIDTH + _FURTHER * (columns - 1)
    with matplotlib.rc_context(MATPLOTLIB):
        figure = Figure(figsize=(width, height * rows + 0.5), layout="constrained", dpi=120)
        axes = figure.subplots(rows, columns, squeeze=False, sharex="col" if chart.linked else "none").ravel()
        handles: dict[str, Any] = {}
        for k, (ax, panel) in enumerate(zip(axes, chart.panels, strict=True)):
            for layer in panel.layers:
                handles.setdefault(layer.name, _draw_layer(ax, layer))
            lowest = not chart.linked or not any(below.layers for below in chart.panels[k + columns :: columns])
            if panel.layers:  # a blank one would change the axis that it shares
                _dress(ax, panel, label_x=lowest, size=(width / columns - 0.9, height - 0.5))
            if lowest:
                ax.tick_params(labelbottom=True)
            ax.set_visible(bool(panel.layers))
        figure.legend(
            list(handles.values()),
            [_plain(name) for name in handles],
            loc="outside upper left",
            ncols=columns + 1,
            fontsize=8.5,
        )
    return figure


def _draw_layer(ax: Axes, layer: charts.Layer) -> Any:
    marker = _MARKERS.get(layer.marker.removesuffix("-open"), "none")
    style: dict[str, Any] = {"color": layer.colour, "linestyle": _DASHES[layer.dash], "marker": marker}
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


def _dress(ax: Axes, panel: charts.Panel, *, label_x: bool, size: tuple[float, float]) -> None:
    """Titles, scales and ticks, as many as fit in this width and height in inches."""
    from matplotlib.ticker import AutoLocator, FuncFormatter, LogLocator, MultipleLocator, NullFormatter

    ax.set_title(textwrap.fill(_plain(panel.title), int(_LETTERS * size[0])))
    room = size[0] / _LABEL, 2 * size[1] / _LABEL
    for axis, side, described, labels in ((ax.xaxis, "x", panel.x, room[0]), (ax.yaxis, "y", panel.y, room[1])):
        getattr(ax, f"set_{side}scale")("log" if described.log else "linear")
        if described.range is not None:
            getattr(ax, f"set_{side}lim")(*described.range)
        if described.tick is not None:
            axis.set_major_locator(MultipleLocator(described.tick))
        elif not described.log:
            few = AutoLocator()
            few.set_params(nbins=max(3, min(9, int(labels))))
            axis.set_major_locator(few)
        if side == "y" or label_x:
            axis.set_label_text(_plain(described.label))
        if described.in_full and described.range is not None:
            decades = np.log10(described.range[1] / described.range[0])
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if 3 * decades <= labels else (1.0,)))
            axis.set_minor_formatter(NullFormatter())
            axis.set_major_formatter(FuncFormatter(lambda value, _: _plain(number(value))))
    if panel.square:
        ax.set_aspect("equal")


def _plain(text: str) -> str:
    """Text that matplotlib doesn't read as mathematics."""
    return text.replace("$", r"\$")
