"""The time response of an identification: records against the models, and their answers to a step and a pulse."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import simulate
from robustid.identification import Identification, Residual, model_residuals
from robustid.report.charts import Axis, Chart, Layer, Panel, lighter
from robustid.report.document import Block, Drawing, Grid, Heading, Text
from robustid.report.identified import Models, Shown, numbered, shown_models, siso, started, transfer
from robustid.report.style import DATA, FAINT
from robustid.report.words import number, unit_label


def time_section(identification: Identification, models: Models) -> list[Block]:
    """Build the section of the time response, with the step and pulse responses of every entry of a MIMO one."""
    blocks: list[Block] = [Heading("Time response")]
    if not identification.problem.time:
        text = "No time records were given; these responses follow from the frequency samples."
        blocks.append(Text(text, "soft"))
    blocks.append(Drawing(time_chart(identification, models), titled=True))
    if siso(identification):
        return blocks
    above = "Above: the input rises by one unit at 0 s; below: it is one unit during the first sample."
    return [
        *blocks,
        Heading("Step and pulse responses of every entry", 3),
        Text(above, "soft"),
        Grid(lighter(answer_charts(identification, models)), len(identification.problem.inputs)),
    ]


def time_chart(identification: Identification, models: Models = None) -> Chart:
    """Every record against the models; of a SISO problem also the step and pulse responses of the models."""
    problem, shown = identification.problem, shown_models(identification, models)
    # The nominal model keeps the initial state that was identified with it.
    found = [identification.residuals, *(model_residuals(problem, one.model) for one in shown[1:])]
    panels = [
        _record_panel(identification, shown, answers)
        for answers in zip(*found, strict=True)
        if answers[0].kind == "time"
    ]
    if siso(identification):
        panels += answer_panels(identification, shown, 0, 0)
    return Chart(name="time", panels=tuple(panels), grid=not siso(identification))


def answer_charts(identification: Identification, models: Models = None) -> list[Chart]:
    """Step and pulse responses of the models, entry by entry."""
    problem, shown, charts = identification.problem, shown_models(identification, models), []
    for i, j in np.ndindex(len(problem.outputs), len(problem.inputs)):
        label = unit_label(problem.outputs[i].unit, problem.inputs[j].unit)
        step, pulse = answer_panels(identification, shown, i, j)
        panels = (
            dataclasses.replace(step, title=transfer(identification, i, j), y=Axis(label=f"step{label}")),
            dataclasses.replace(pulse, title="", y=Axis(label=f"pulse{label}")),
        )
        charts.append(Chart(name=f"answer-{i}-{j}", panels=panels, linked=True, grid=True))
    return charts


def answer_titles(signal: Any) -> dict[str, str]:
    """Titles of the answers to a step and to a pulse of an input."""
    amount = f"1 {signal.unit}".rstrip()
    return {
        "step": f"Step response: {signal.name} rises by {amount} at 0 s",
        "impulse": f"Pulse response: {signal.name} is {amount} during the first sample",
    }


def answer_panels(identification: Identification, shown: list[Shown], output: int, input_: int) -> list[Panel]:
    """Step and pulse response of one entry of the models."""
    problem = identification.problem
    count = _settling(identification.model)
    t, u = problem.dt * np.arange(count), np.zeros((count, len(problem.inputs)))
    u[0, input_] = 1
    pulses = [simulate(one.model, u)[0][:, output] for one in shown]
    panels, effect = [], str(problem.outputs[output])
    titles = answer_titles(problem.inputs[input_]).values()
    for title, answers in zip(titles, ([np.cumsum(pulse) for pulse in pulses], pulses), strict=True):
        layers = tuple(
            Layer(name=one.name, x=t, y=y, colour=one.colour, dash=one.dash)
            for one, y in zip(shown, answers, strict=True)
        )
        panels.append(Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=effect), layers=layers))
    return panels


def _settling(model: Any) -> int:
    """Samples until the slowest decaying mode is down to 5 %, within reason."""
    size = np.abs(model.poles())
    slowest = max(size[size < 1 - 1e-7], default=0.0)
    return int(np.clip(3 / -np.log(slowest), 40, 600)) if slowest > 0 else 40


def _record_panel(identification: Identification, shown: list[Shown], residuals: tuple[Residual, ...]) -> Panel:
    problem, (index, output) = identification.problem, (residuals[0].index, residuals[0].entry[0] or 0)
    record = problem.time[index]
    used = record.bound.used[:, output]
    t, y, bound = record.time[used], record.y[used, output], residuals[0].bound
    layers = [
        Layer(name=one.name, x=t, y=y - residual.error, colour=one.colour, dash=one.dash)
        for one, residual in zip(shown, residuals, strict=True)
    ]
    if not np.all(used):
        style: dict[str, Any] = {"name": "not used", "colour": FAINT, "marker": "circle-open"}
        layers.append(Layer(x=record.time[~used], y=record.y[~used, output], **style))
    hover = tuple(f"{number(a, 6)} s: {number(b, 6)} ± {number(c)}" for a, b, c in zip(t, y, bound, strict=True))
    bars = {"low": y - bound, "high": y + bound, "hover": hover}
    layers.append(Layer(name="data with their intervals", x=t, y=y, colour=DATA, marker="circle", **bars))
    title = f"{numbered('Record', index, len(problem.time))} {started(record)}"
    if not siso(identification):
        title += f": {record.outputs[output].name}"
    if np.any(bound > record.bound.radius[used, output] * (1 + 1e-12)):
        title += ", intervals widened by what the unknown past can add"
    return Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=str(record.outputs[output])), layers=tuple(layers))
