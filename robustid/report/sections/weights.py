"""Weights of structured uncertainties: what each structure costs, and the weight of every block above its bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.core import responses
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import StructuredWeight
from robustid.identification import Identification
from robustid.report.charts import Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.curves import span_of
from robustid.report.document import Block, Column, Drawing, Heading, Table, Text, Verdict
from robustid.report.sections.stability import WORDS_OF, stability_chart
from robustid.report.style import ALERT, NOMINAL
from robustid.report.words import HZ, at_least, number

_POINTS = 600  # of the response of a weight, evenly spaced along the axis


def weights_section(
    identification: Identification, weights: StructuredWeight | Sequence[StructuredWeight]
) -> list[Block]:
    """Build the section of the weights: a table of the structures, their margins over frequency, and the first one drawn."""
    found, problem = as_weights(weights), identification.problem
    size = len(problem.outputs), len(problem.inputs)
    for one in found:
        nominal: Any = one.nominal
        if (nominal.noutputs, nominal.ninputs) != size or not np.isclose(nominal.dt, problem.dt, rtol=1e-9):
            raise InputError(
                f"`weights` must be about a model of {size[0]} x {size[1]} entries with dt = {problem.dt:g} s, as the"
                f" identification reported; got {nominal.noutputs} x {nominal.ninputs} and {nominal.dt:g} s"
            )
    first = found[0]
    blocks: list[Block] = [
        Heading("Weights of the uncertainty"),
        Text(
            "The error of the model is F − F_id = L Δ R with blocks on the diagonal of Δ, each of largest singular value at most 1."
            " With a controller the structure that leaves the largest margin costs the least; without one, that which allows the"
            " smallest set of errors (mean radius)."
        ),
        weights_verdict(found),
        structure_table(found),
    ]
    margins = {f"bounds of {WORDS_OF[one.structure]}": one.margin for one in found if one.margin is not None}
    if margins and all(margin.margins.all() for margin in margins.values()):
        blocks += [Heading("What each structure leaves of the margin", 3), Drawing(_renamed(stability_chart(margins)))]
    words = f"Weights of {WORDS_OF[first.structure]}, with the bounds that they cover"
    return [*blocks, Heading(words, 3), Drawing(weights_chart(first, *_names(identification)))]


def weights_summary(weight: StructuredWeight) -> list[Block]:
    """Build the summary of one structure at the terminal."""
    return [weights_verdict([weight]), structure_table([weight])]


def weights_verdict(weights: Sequence[StructuredWeight]) -> Verdict:
    """Verdict on the weights, each of which must be above its bound now."""
    if all(one.certified for one in weights):
        sentence = "Every weight is stable, minimum-phase and above its bound on the whole circle: decided again from its numbers."
        return Verdict("consistent", "Proved", sentence, id="weights-verdict")
    sentence = "Not every weight is above its bound, decided again from its numbers. Don’t rely on these."
    return Verdict("failed", "Not proved", sentence, id="weights-verdict")


def structure_table(weights: Sequence[StructuredWeight]) -> Table:
    """Structures with their weights, the states of these, the size of what they allow, and the margin that they leave."""
    rows = [
        (
            WORDS_OF[one.structure],
            f"{len(one.weights)}",
            f"{one.order}",
            number(max(weight.ratio for weight in one.weights), 3),
            number(one.radius),
            at_least(one.margin.margin) if one.margin is not None else "–",
        )
        for one in weights
    ]
    heads = ("weights", "states in all", "largest weight / bound", "mean radius", "margin")
    return Table([Column("Blocks"), *(Column(head, "n") for head in heads)], rows, title="Structures")


def weights_chart(
    weight: StructuredWeight, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None
) -> Chart:
    """Modulus of the weight of every block over the bound that it covers, rows of blocks below each other."""
    _, p, q = weight.bound.shape
    axis = frequency_axis(weight.edges)
    low, high = axis.range or tuple(weight.edges[[0, -1]] / HZ)
    hz = np.geomspace(low, high, _POINTS) if axis.log else np.linspace(low, high, _POINTS)
    hz = np.unique(np.append(hz, weight.edges / HZ))
    hz = hz[(hz >= max(low, 0.0)) & (hz <= weight.edges[-1] / HZ)]
    steps = np.maximum(np.repeat(weight.edges, 2)[1:-1] / HZ, low)
    panels: list[Panel] = []
    for k, (i, j) in enumerate(np.ndindex(p, q)):
        model: Any = weight.weights[k].model
        sizes = np.abs(responses(model, HZ * hz * model.dt)[:, 0, 0])
        layers = (
            Layer(
                name="bound of the error", x=steps, y=np.repeat(weight.bound[:, i, j], 2), colour=ALERT, dash="solid"
            ),
            Layer(name="|weight|", x=hz, y=sizes, colour=NOMINAL, dash="solid"),
        )
        title = _block(weight.structure, i, j, outputs, inputs)
        y = Axis(label="size of the error", log=True, range=span_of(np.concatenate([one.y for one in layers]), 1.5))
        panels.append(Panel(title=title, x=axis, y=y, layers=layers))
    return Chart(name="weights", panels=tuple(panels), linked=True, columns=q, grid=p * q > 1)


def _block(structure: str, i: int, j: int, outputs: Sequence[str] | None, inputs: Sequence[str] | None) -> str:
    row = outputs[i] if outputs else f"output {i + 1}"
    column = inputs[j] if inputs else f"input {j + 1}"
    return {"full": "all entries", "input": column, "output": row, "entry": f"{row} / {column}"}[structure]


def _names(identification: Identification) -> tuple[list[str], list[str]]:
    problem = identification.problem
    return [str(signal) for signal in problem.outputs], [str(signal) for signal in problem.inputs]


def _renamed(chart: Chart) -> Chart:
    return Chart(name="structures", panels=chart.panels)


def as_weights(weights: Any) -> tuple[StructuredWeight, ...]:
    """One structure or several, as `structured_weights` gives them."""
    found = (weights,) if isinstance(weights, StructuredWeight) else weights
    if not isinstance(found, Sequence) or not found or not all(isinstance(one, StructuredWeight) for one in found):
        raise InputTypeError(
            "`weights` must be a StructuredWeight or a sequence of them, from structured_weights(); got"
            f" {type(weights).__name__}"
        )
    return tuple(found)
