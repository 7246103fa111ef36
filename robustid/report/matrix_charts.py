"""What is drawn of several channels at once: singular values, step and pulse responses of every entry, charts side by side."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.data import FrequencyResponse
from robustid.identification import Identification
from robustid.report.charts import (
    BLANK,
    HZ,
    Axis,
    Chart,
    Layer,
    Models,
    Panel,
    answer_panels,
    curves,
    hertz,
    responses,
    shown_band,
)
from robustid.report.facts import mixed, transfer, unit, unit_label
from robustid.report.mfd_charts import cells_per_entry, rounded, thinned
from robustid.report.style import DATA, FAINT, number

LARGEST = "σmax of the "
_SMALLER, _FINEST = 0.6, 0.45  # sizes of curves and markers in small figures


def sigma_chart(identification: Identification, models: Models = None, omega: np.ndarray | None = None) -> Chart:
    """Singular values of the models over frequency, at `omega` (rad/s) too, and the largest one of what was measured."""
    problem, shown = identification.problem, curves(identification, models)
    wanted = np.zeros(0) if omega is None else omega
    ends = shown_band(identification, wanted)
    at, values = responses([model for _, model, *_ in shown], problem, ends, wanted)
    sizes = [np.linalg.svd(value, compute_uv=False) for value in values]
    layers = [
        Layer(name="further singular values", x=at / HZ, y=size, colour=FAINT, dash="solid") for size in sizes[0].T[1:]
    ]
    for (name, _, colour, dash, _), size in zip(shown, sizes, strict=True):
        layers.append(Layer(name=LARGEST + name, x=at / HZ, y=size[:, 0], colour=colour, dash=dash))
    lines, sigma, radius = measured_sigma(problem)
    top = max(float(size.max()) for size in (*sizes, sigma + radius) if size.size)
    low = min(float(size.min()) for size in (sizes[0][:, 0], sigma[sigma > 0]) if size.size)
    floor = max(min(low / 2, float(np.quantile(sizes[0], 0.02))), 1e-8 * top)
    if lines.size:
        hover = tuple(
            f"{number(w / HZ, 6)} Hz: {number(a)} ± {number(b)}" for w, a, b in zip(lines, sigma, radius, strict=True)
        )
        bars: dict[str, Any] = {"low": np.maximum(sigma - radius, floor), "high": sigma + radius, "hover": hover}
        x, y = np.maximum(lines, ends[0]) / HZ, np.maximum(sigma, floor)
        layers.append(Layer(name="σmax of the data", x=x, y=y, colour=DATA, marker="circle", **bars))
    y_axis = Axis(label=f"singular value{sigma_unit(identification)}", log=True, range=(floor, 1.5 * top))
    panel = Panel(title="Singular values", x=hertz(problem, *ends), y=y_axis, layers=tuple(layers))
    return Chart(name="sigma", panels=(panel,), linked=True)


def sigma_unit(identification: Identification) -> str:
    """The unit of singular values, in brackets."""
    what = unit(identification)
    return " [mixed units]" if mixed(identification) else f" [{what}]" if what else ""


def measured_sigma(problem: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines in rad/s at which every entry was measured, the largest singular value there, and how far the true one can be.

    |E| <= R entry by entry has ||E|| <= ||R||. Of several experiments the one with the smallest bound counts, by entry.
    """
    shape = problem.angles.size, problem.entries.outputs, problem.entries.inputs
    values, radius = np.zeros(shape, complex), np.full(shape, np.inf)
    for frf in problem.frequency:
        if not isinstance(frf, FrequencyResponse):
            continue
        for k, line in enumerate(problem.node_index(frf.omega * problem.dt)):
            better = frf.outer_radius[k] < radius[line]
            values[line][better], radius[line][better] = frf.values[k][better], frf.outer_radius[k][better]
    known = np.isfinite(radius).all(axis=(1, 2))
    sigma, reach = (np.linalg.norm(part[known], 2, axis=(1, 2)) for part in (values, radius))
    return problem.angles[known] / problem.dt, sigma, reach


def answer_charts(identification: Identification, models: Models = None) -> list[Chart]:
    """Step and pulse responses of the models, entry by entry."""
    problem, shown, charts = identification.problem, curves(identification, models), []
    for i, j in np.ndindex(problem.entries.outputs, problem.entries.inputs):
        label = unit_label(problem.outputs[i].unit, problem.inputs[j].unit)
        titles = transfer(identification, i, j), ""
        panels = tuple(
            dataclasses.replace(panel, title=title, y=Axis(label=f"{what}{label}"))
            for panel, title, what in zip(
                answer_panels(identification, shown, i, j), titles, ("step", "pulse"), strict=True
            )
        )
        charts.append(Chart(name=f"answer-{i}-{j}", panels=panels, linked=True, grid=True))
    return charts


def side_by_side(name: str, charts: Sequence[Chart], columns: int, *further: Sequence[Panel]) -> Chart:
    """Charts of entries, row by row, as one; each group of further panels begins a row of its own."""
    rows = [charts[k : k + columns] for k in range(0, len(charts), columns)]
    panels = [panel for row in rows for parts in zip(*(chart.panels for chart in row), strict=True) for panel in parts]
    for group in further:
        panels += [*group, *[BLANK] * (-len(group) % columns)]
    return Chart(name=name, panels=tuple(panels), linked=True, columns=columns, grid=True)


def lighter(charts: Sequence[Chart]) -> list[Chart]:
    """With as many points and digits as small figures show, and finer: no peak and no notch is lost, the page stays small."""
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
    size = max(_SMALLER * layer.size, min(_FINEST, layer.size))
    return dataclasses.replace(
        layer, size=size, **{name: rounded(array[kept]) for name, array in arrays.items() if array is not None}
    )
