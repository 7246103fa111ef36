"""The guaranteed range of a response in time: the sentence, its certificates, and the chart."""

from __future__ import annotations

import numpy as np

from robustid.guarantees import ResponseTube
from robustid.identification import Identification
from robustid.report.charts import Axis, Chart, Layer, Panel
from robustid.report.document import Block, Drawing, Facts, Heading, Text
from robustid.report.identified import about, in_unit
from robustid.report.sections.claims import certificates, checked
from robustid.report.sections.guarantee_charts import BAND, REACHED
from robustid.report.sections.time import answer_titles
from robustid.report.style import DATA, FINE, MARKERS, NOMINAL
from robustid.report.words import at_least, at_most, number


def tube_section(identification: Identification, tube: ResponseTube) -> list[Block]:
    """Build the section of the response in time, with its certificates."""
    checked("tube", tube, ResponseTube, "response_tube", identification)
    count = len(tube.certificates) + len(tube.parameters.certificates)
    return [
        Heading("Guaranteed response in time"),
        Text(sentence(tube), id="tube-sentence"),
        certificates(count, tube.verify(), "tube-certificates"),
        Facts(rows(tube)),
        Drawing(tube_chart(tube), titled=True),
        Text(
            "The range is proved at the samples with triangles, which consistent systems reach; between them it is interpolated"
            " for the eye. Records from zero initial conditions are shown if their input is this one, or a multiple of it.",
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
        Layer(name=name, x=t[inside], y=y[inside], colour=BAND, low=low, high=high, fill=True),
        Layer(name=f"model, order {tube.model.nstates}", x=t, y=y, colour=NOMINAL, dash="solid", size=FINE),
        *_measured(tube),
        Layer(
            name=REACHED,
            x=np.tile(tube.times, 2),
            y=tube.attained.T.ravel(),
            colour=DATA,
            marker=MARKERS[2],
            size=0.6,
            hover=2 * hover,
        ),
    )
    panel = Panel(
        title=answer_titles(input_).get(tube.input, f"Response to the given {input_.name}"),
        x=Axis(label="time [s]"),
        y=Axis(label=str(output)),
        layers=layers,
    )
    return Chart(name="tube", panels=(panel,))


def _measured(tube: ResponseTube) -> list[Layer]:
    """Samples of the records from zero initial conditions whose input is that of the tube, or a multiple: the plant is linear."""
    layers = []
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
        style = {"colour": DATA, "marker": "circle", "size": 0.6}
        layers.append(Layer(name=name, x=record.time[:count][used], y=y, low=y - bound, high=y + bound, **style))
    return layers


def sentence(tube: ResponseTube) -> str:
    """The guarantee in plain words."""
    problem = tube.identification.problem
    input_ = problem.inputs[tube.entry[1]]
    amount = f"1 {input_.unit}".rstrip()
    signals = {
        "step": f"a step of {input_.name} by {amount}",
        "impulse": f"a pulse of {input_.name}, {amount} for one sample,",
    }
    worst = int(np.argmax(tube.error_upper))
    within, reached = at_most(tube.error_upper[worst]), at_least(tube.error_lower[worst])
    where = "at every sample" if tube.complete else f"at {tube.samples.size} of the {tube.u.size} samples"
    return (
        f"{about(tube.identification)}From zero initial conditions, every plant that agrees with the data and the assumptions"
        " answers"
        f" {signals.get(tube.input, 'the given ' + input_.name)} within {_with_unit(within, tube)} of the model, {where} until"
        f" {number(problem.dt * (tube.u.size - 1))} s. The largest error is possible at {number(tube.times[worst])} s; one of"
        f" {_with_unit(reached, tube)} is reached there."
    )


def rows(tube: ResponseTube) -> list[tuple[str, str]]:
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
