"""An identification in time: records, answers to a step and a pulse, and the guaranteed range of a response."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Signal, simulate
from robustid.guarantees import ResponseTube
from robustid.identification import Identification, Residual, model_residuals
from robustid.report.charts import (
    BAND,
    DATA,
    FAINT,
    FINE,
    MARKERS,
    NOMINAL,
    REACHED,
    Axis,
    Chart,
    Layer,
    Panel,
    in_rows,
    lighter,
    side_by_side,
)
from robustid.report.document import Block, Drawing, Facts, Grid, Heading, Text, certificates
from robustid.report.identified import (
    Models,
    Shown,
    about,
    checked,
    entry_unit,
    in_unit,
    numbered,
    shown_models,
    siso,
    started,
    transfer,
)
from robustid.report.words import at_least, at_most, number

if TYPE_CHECKING:
    import control

_Answers = tuple[
    np.ndarray, list[np.ndarray], list[np.ndarray]
]  # times, and of each model steps and pulses, (T, ny, nu)
_PERIODS, _INSTANTS = 60, 1201  # of the fastest oscillation that are drawn, and samples of the curves


def time_section(identification: Identification, models: Models) -> list[Block]:
    """Build the section of the time response, with the step and pulse responses of every entry of a MIMO one."""
    blocks: list[Block] = [Heading("Time response")]
    if not identification.problem.time:
        text = "No time records were given; these responses follow from the frequency samples."
        blocks.append(Text(text, "soft"))
    blocks.append(Drawing(time_chart(identification, models), titled=True))
    if siso(identification):
        return blocks
    pulse = (
        "it is one unit during the first sample"
        if identification.problem.dt
        else "it has an area of one unit second at 0 s"
    )
    above = f"Above: the input rises by one unit at 0 s; below: {pulse}."
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
        panels += _panels(identification, shown, _answers(identification, shown), 0, 0)
    return Chart("time", panels, grid=not siso(identification))


def answer_charts(identification: Identification, models: Models = None) -> list[Chart]:
    """Step and pulse responses of the models, entry by entry."""
    problem, shown = identification.problem, shown_models(identification, models)
    charts: list[Chart] = []
    answers = _answers(identification, shown)
    for i, j in np.ndindex(len(problem.outputs), len(problem.inputs)):
        label = entry_unit(identification, i, j)
        step, pulse = _panels(identification, shown, answers, i, j)
        panels = (
            dataclasses.replace(step, title=transfer(identification, i, j), y=Axis(f"step{label}")),
            dataclasses.replace(pulse, title="", y=Axis(f"pulse{label}")),
        )
        charts.append(Chart(f"answer-{i}-{j}", panels, linked=True, grid=True))
    return charts


def answer_titles(signal: Signal, dt: float = 1.0) -> dict[str, str]:
    """Titles of the answers to a step and to a pulse of an input; without a sample time to an impulse."""
    amount = f"1 {signal.unit}".rstrip()
    pulse = f"Pulse response: {signal.name} is {amount} during the first sample"
    return {
        "step": f"Step response: {signal.name} rises by {amount} at 0 s",
        "impulse": pulse
        if dt
        else f"Impulse response: {signal.name} has the area {amount} s at 0 s, seen from then on",
    }


def _panels(
    identification: Identification, shown: list[Shown], answers: _Answers, output: int, input_: int
) -> list[Panel]:
    """The panels of one entry, of the answers of all."""
    problem = identification.problem
    panels: list[Panel] = []
    effect, titles = str(problem.outputs[output]), answer_titles(problem.inputs[input_], problem.dt).values()
    t, steps, pulses = answers
    for title, curves in zip(titles, (steps, pulses), strict=True):
        layers = tuple(
            Layer(one.name, t, y[:, output, input_], one.colour, dash=one.dash)
            for one, y in zip(shown, curves, strict=True)
        )
        panels.append(Panel(title, Axis("time [s]"), Axis(effect), layers))
    return panels


def _answers(identification: Identification, shown: list[Shown]) -> _Answers:
    """Times, and the answers of models to a step and to a pulse of each input."""
    answer = _sampled_answers if identification.problem.dt else _continuous_answers
    return answer(identification, [one.model for one in shown])


def _sampled_answers(identification: Identification, models: Sequence[control.StateSpace]) -> _Answers:
    """The same of sampled models."""
    count, inputs = _settling(identification.model), len(identification.problem.inputs)
    first = np.eye(1, count).T
    pulses = [np.stack([simulate(model, first * one)[0] for one in np.eye(inputs)], axis=2) for model in models]
    return identification.problem.dt * np.arange(count), [np.cumsum(pulse, axis=0) for pulse in pulses], pulses


def _continuous_answers(identification: Identification, models: Sequence[control.StateSpace]) -> _Answers:
    """The same of continuous models, to an impulse from 0 s on, exact at these times."""
    poles = identification.model.poles()
    decays = -poles.real[poles.real < -1e-7 * np.abs(poles)]
    seconds = 3 / decays.min(initial=np.inf) or 1.0
    seconds = min(seconds, _PERIODS * 2 * np.pi / max(np.abs(poles.imag).max(initial=0.0), 1 / seconds))
    t = np.linspace(0.0, seconds, _INSTANTS)
    steps: list[np.ndarray] = []
    impulses: list[np.ndarray] = []
    for model in models:
        B, C, D = (np.asarray(part, dtype=float) for part in (model.B, model.C, model.D))
        n, inputs = B.shape
        # The states and the integrals of their inputs, all from one exponential.
        whole = np.zeros((n + inputs, n + inputs))
        whole[:n, :n], whole[:n, n:] = model.A, B
        turn = scipy.linalg.expm(whole * t[1])
        states = np.block([[np.zeros((n, inputs)), B], [np.eye(inputs), np.zeros((inputs, inputs))]])  # forced, free
        found = np.empty((t.size, len(C), 2 * inputs))
        for k in range(t.size):
            found[k] = C @ states[:n]
            states = turn @ states
        steps.append(found[:, :, :inputs] + D)
        impulses.append(found[:, :, inputs:])
    return t, steps, impulses


def _settling(model: control.StateSpace) -> int:
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
        Layer(one.name, t, y - residual.error, one.colour, dash=one.dash)
        for one, residual in zip(shown, residuals, strict=True)
    ]
    if not np.all(used):
        layers.append(Layer("not used", record.time[~used], record.y[~used, output], FAINT, marker="circle-open"))
    hover = tuple(f"{number(a, 6)} s: {number(b, 6)} ± {number(c)}" for a, b, c in zip(t, y, bound, strict=True))
    layers.append(
        Layer("data with their bounds", t, y, DATA, marker="circle", low=y - bound, high=y + bound, hover=hover)
    )
    title = f"{numbered('Record', index, len(problem.time))} {started(record)}"
    if not siso(identification):
        title += f": {record.outputs[output].name}"
    if np.any(bound > record.bound.radius[used, output] * (1 + 1e-12)):
        title += ", intervals widened by what the unknown past can add"
    return Panel(title, Axis("time [s]"), Axis(str(record.outputs[output])), layers)


def identified_time(identification: Identification, models: Models = None) -> Chart:
    """The records, then the step and pulse responses."""
    chart, columns = time_chart(identification, models), len(identification.problem.inputs)
    if siso(identification):
        return chart
    answers = side_by_side("answers", lighter(answer_charts(identification, models)), columns)
    return in_rows(chart, columns, answers.panels)


def tube_section(identification: Identification, tube: ResponseTube) -> list[Block]:
    """Build the section of the response in time, with its certificates."""
    checked("tube", tube, ResponseTube, "response_tube", identification)
    count = 2 * tube.solved + len(tube.parameters.certificates)
    proved = (
        "The range is proved at the samples with triangles, which consistent systems reach; between them it is interpolated"
        " for the eye."
        if tube.solved == tube.samples.size
        else "The range is proved at every sample: by semidefinite programs where there are triangles, which consistent systems"
        " reach, elsewhere by sums of the measurements, which are wider."
    )
    return [
        Heading("Guaranteed response in time"),
        Text(tube_sentence(tube), id="tube-sentence"),
        certificates(count, tube.verify(), "tube-certificates"),
        Facts(tube_rows(tube)),
        Drawing(tube_chart(tube), titled=True),
        Text(
            f"{proved} Records from zero initial conditions are shown if their input is this one, or a multiple of it.",
            "soft",
        ),
    ]


def tube_chart(tube: ResponseTube) -> Chart:
    """The response of the model inside the range of every consistent system, and the samples measured with this input.

    Between the samples that were bounded the distance of each end from the model is interpolated.
    """
    problem = tube.identification.problem
    output, input_ = problem.outputs[tube.entry[0]], problem.inputs[tube.entry[1]]
    t, y = problem.dt * np.arange(tube.u.size), tube.response
    inside = slice(tube.samples[0], tube.samples[-1] + 1)
    low, high = (y[inside] + np.interp(t[inside], tube.times, end - tube.nominal) for end in (tube.lower, tube.upper))
    hover = tuple(
        f"{number(at, 6)} s: {number(a)} … {number(b)}"
        for at, a, b in zip(tube.times, tube.lower, tube.upper, strict=True)
    )
    name = f"guaranteed range ({tube.samples.size} samples)"
    layers = (
        Layer(name, t[inside], y[inside], BAND, low=low, high=high, fill=True),
        Layer(f"model, order {tube.model.nstates}", t, y, NOMINAL, dash="solid", size=FINE),
        *_measured(tube),
        Layer(
            REACHED, np.tile(tube.times, 2), tube.attained.T.ravel(), DATA, marker=MARKERS[2], size=0.6, hover=2 * hover
        ),
    )
    panel = Panel(
        answer_titles(input_).get(tube.input, f"Response to the given {input_.name}"),
        Axis("time [s]"),
        Axis(str(output)),
        layers,
    )
    return Chart("tube", (panel,))


def _measured(tube: ResponseTube) -> list[Layer]:
    """Samples of the records from zero initial conditions whose input is that of the tube, or a multiple: the plant is linear."""
    layers: list[Layer] = []
    for number_, record in enumerate(tube.identification.problem.time):
        count = min(tube.u.size, record.u.shape[0])
        output, input_ = tube.entry
        u, known = record.u[:count, input_], tube.u[:count]
        scale = float(u @ known / (known @ known)) if np.any(known) else 0.0
        used = record.bound.used[:count, output]
        if (
            np.any(np.delete(record.u[:count], input_, axis=1))
            or record.initial != "rest"
            or not scale
            or not used.any()
            or not np.allclose(u, scale * known, atol=0, rtol=1e-9)
        ):
            continue
        y, bound = record.y[:count, output][used] / scale, record.bound.radius[:count, output][used] / abs(scale)
        name = f"record {number_ + 1} with its intervals" + (f", divided by {number(scale)}" if scale != 1 else "")
        at, ends = record.time[:count][used], (y - bound, y + bound)
        layers.append(Layer(name, at, y, DATA, marker="circle", low=ends[0], high=ends[1], size=0.6))
    return layers


def tube_sentence(tube: ResponseTube) -> str:
    """The guarantee in plain words."""
    problem = tube.identification.problem
    input_ = problem.inputs[tube.entry[1]]
    amount = f"1 {input_.unit}".rstrip()
    signals = {
        "step": f"a step of {input_.name} by {amount}",
        "impulse": f"a pulse of {input_.name}, {amount} for one sample,",
    }
    worst = int(np.argmax(tube.error_upper))
    within, reached = at_most(tube.error_upper[worst]), _with_unit(at_least(tube.error_lower[worst]), tube)
    found = f"; one of {reached} is reached there." if tube.error_lower[worst] > 0 else "."
    where = "at every sample" if tube.complete else f"at {tube.samples.size} of the {tube.u.size} samples"
    return (
        f"{about(tube.identification)}From zero initial conditions, every plant that agrees with the data and the assumptions"
        " answers"
        f" {signals.get(tube.input, 'the given ' + input_.name)} within {_with_unit(within, tube)} of the model, {where} until"
        f" {number(problem.dt * (tube.u.size - 1))} s. The largest error is possible at {number(tube.times[worst])} s{found}"
    )


def tube_rows(tube: ResponseTube) -> list[tuple[str, str]]:
    """Peaks over the horizon, and what lies after it, with their words."""
    peak, error = (_with_unit(at_most(value), tube) for value in (tube.peak, tube.error_peak))
    out = [
        (
            "Peak",
            f"The modulus of the response stays below {peak}, that of its error below {error}, over the whole horizon.",
        )
    ]
    if tube.input == "impulse":
        gain = in_unit(at_most(tube.error_l1), tube.identification)
        words = (
            f"The sum of the error’s moduli is at most {gain}: the peak-to-peak gain of plant minus model."
            if np.isfinite(tube.error_l1)
            else "No bound: the coefficient of an integrator is uncertain."
        )
        out.append(("Over all time", words))
    return out


def _with_unit(text: str, tube: ResponseTube) -> str:
    return f"{text} {tube.identification.problem.outputs[tube.entry[0]].unit}".rstrip()
