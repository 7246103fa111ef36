"""Robust stability margins of controllers, and weights of structured uncertainties."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from robustid.core import hz_words, responses
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import MarginStatus, RobustStabilityMargin, StructuredWeight
from robustid.identification import Identification
from robustid.report.charts import ALERT, DATA, NOMINAL, Axis, Chart, Layer, Panel, frequency_axis, further
from robustid.report.curves import positive, span_of, spread
from robustid.report.document import (
    Block,
    Column,
    Drawing,
    Facts,
    Heading,
    Share,
    Table,
    Text,
    Verdict,
    of_numbers,
    proved,
)
from robustid.report.identified import about, by_name
from robustid.report.words import HZ, at_least, at_most, in_hz, number, percent

Margins = RobustStabilityMargin | Mapping[str, RobustStabilityMargin]
WORDS_OF = {"full": "the whole matrix", "input": "every column", "output": "every row", "entry": "every entry"}
_KEYS = {MarginStatus.GUARANTEED: "consistent", MarginStatus.OPEN: "weak", MarginStatus.UNSTABLE: "inconsistent"}
_ROWS = 6  # arcs in the table
_POINTS = 600  # of the response of a weight, evenly spaced along the axis


def stability_section(identification: Identification, margins: Margins) -> list[Block]:
    """Build the section of the robust stability margins of controllers for the nominal model."""
    found, problem = named_margins("stability", margins), identification.problem
    for name, one in found.items():
        shape, nyquist = (len(problem.outputs), len(problem.inputs)), problem.plane.top
        if one.shares.shape != shape or (one.margins.size and not np.isclose(one.edges[-1], nyquist, rtol=1e-9)):
            raise InputError(
                f"`stability`{_of(name)} must be about a model of {shape[0]} x {shape[1]} entries up to {hz_words(nyquist / HZ, 6)}"
                ", as the identification reported; take it from WorstCaseError.robust_stability_margin(controller)"
            )
    names = [[str(signal) for signal in group] for group in (problem.outputs, problem.inputs)]
    intro = f"{about(identification)}The upper bound is that of the structured singular value: below 1 at every frequency, every"
    intro += " plant within the bounds of the error is stabilised. Its reciprocal is the margin, the factor by which all errors"
    drawn = {name: one for name, one in found.items() if one.margins.all()}  # nothing of a loop that isn't stable
    return [
        Heading("Robust stability"),
        Text(f"{intro} could grow before that is no longer guaranteed."),
        *([Drawing(stability_chart(drawn))] if drawn else []),
        Text(
            "The bound holds on whole arcs, between the frequencies too; what lies far below the largest is rough. Assumed:"
            " linearity, the class of the identification (gain bound, decay and the poles of its parametric part) and the"
            " bounds of the samples, from which those of the error follow. The margin was computed from these; it is not"
            " computed again for this page.",
            "soft",
        ),
        *(
            block
            for k, (name, one) in enumerate(found.items())
            for block in _on_page(f"stability-verdict-{k}", name, one, *names)
        ),
    ]


def _on_page(id: str, name: str, margin: RobustStabilityMargin, *names: Sequence[str]) -> list[Block]:
    blocks: list[Block] = [Heading(name, 3)] if name else []
    blocks += [dataclasses.replace(stability_verdict(margin), id=id), Facts(_rows(margin))]
    for table in _tables(margin, *names):
        blocks += [Heading(table.title, 3), table, *([Text(table.note, "soft")] if table.note else [])]
    return blocks


def stability_summary(margin: RobustStabilityMargin) -> list[Block]:
    """Build the summary of one margin at the terminal; signals have numbers, since a margin knows no names."""
    ny, nu = margin.shares.shape
    names = [f"output {i + 1}" for i in range(ny)], [f"input {j + 1}" for j in range(nu)]
    return [stability_verdict(margin), Facts(_rows(margin)), *_tables(margin, *names)]


def _tables(margin: RobustStabilityMargin, outputs: Sequence[str], inputs: Sequence[str]) -> list[Table]:
    found = [arc_table(margin)] if margin.margins.size and margin.margin else []
    if margin.shares.size > 1 and margin.shares.any():
        found.append(share_table(margin, outputs, inputs))
    return found


def stability_verdict(margin: RobustStabilityMargin) -> Verdict:
    """Verdict on one controller: stabilises every plant, not guaranteed, or unstable with the nominal model."""
    words = {
        MarginStatus.GUARANTEED: (
            "Stable",
            f"The controller stabilises every plant of the set; all errors could be {at_least(margin.margin)} times as large.",
        ),
        MarginStatus.OPEN: (
            "Not guaranteed",
            "The nominal loop is stable, but a plant of the set may not be: guaranteed if all errors were at most"
            f" {at_least(margin.margin)} times as large.",
        ),
        MarginStatus.UNSTABLE: ("Unstable", "The loop of the controller and the nominal model is not stable."),
    }
    numbers = (("margin", at_least(margin.margin, 3)), ("at [Hz]", number(margin.frequency / HZ)))
    return Verdict(_KEYS[margin.status], *words[margin.status], numbers, id="stability-verdict")


def _rows(margin: RobustStabilityMargin) -> list[tuple[str, str]]:
    if margin.status is MarginStatus.UNSTABLE:
        return [("Pole", f"The outermost pole of the loop lies at {in_hz(margin.frequency / HZ)}.")]
    bound = at_most(1 / margin.margin if margin.margin else np.inf)
    rows = [("Upper bound", f"At most {bound}, at {in_hz(margin.frequency / HZ)}.")]
    if margin.shares.size > 1:
        rows.append(("Structure", f"There it comes from the bounds of the errors of {WORDS_OF[margin.structure]}."))
    return rows


def arc_table(margin: RobustStabilityMargin) -> Table:
    """The arcs on which the upper bound is larger than on both beside them, largest first."""
    sizes = 1 / margin.margins
    ends = np.append(
        np.flatnonzero(np.diff(sizes)), sizes.size - 1
    )  # the last of all arcs of one size beside each other
    firsts = np.append(0, ends[:-1] + 1)
    runs = np.concatenate([[-1.0], sizes[ends], [-1.0]])
    peaks = np.flatnonzero((runs[1:-1] > runs[:-2]) & (runs[1:-1] > runs[2:]))
    rows: list[list[str]] = []
    for k in peaks[np.argsort(-sizes[ends[peaks]], kind="stable")][:_ROWS].tolist():
        low, high = (float(margin.edges[edge]) / HZ for edge in (firsts[k], ends[k] + 1))
        size, least = float(sizes[ends[k]]), float(margin.margins[ends[k]])
        rows.append([number(low, 5), number(high, 5), at_most(size), at_least(least)])
    heads = ("from [Hz]", "to [Hz]", "upper bound", "margin")
    return Table(of_numbers(*heads), rows, title="Where the bound is largest")


def share_table(margin: RobustStabilityMargin, outputs: Sequence[str], inputs: Sequence[str]) -> Table:
    """Part of every entry in the bound at the frequency that limits: where a smaller error helps."""
    rows: list[tuple[str | Share, ...]] = []
    for (output, input_), share in zip(itertools.product(outputs, inputs), margin.shares.ravel().tolist(), strict=True):
        rows.append((output, input_, Share(percent(share), share)))
    note = "A bound smaller by 1 % makes the margin larger by this part of 1 %."
    columns = [Column("Output"), Column("Input"), Column("part in the limit", "share")]
    return Table(columns, rows, title="Whose error limits", note=note)


def stability_chart(margins: Margins) -> Chart:
    """Upper bound of the structured singular value over frequency, its largest value, and the limit 1, of every controller."""
    found = named_margins("result", margins)
    if not all(one.margins.size and one.margins.all() for one in found.values()):
        raise InputError(
            "`result` must hold margins of nominal loops that are stable, with their cells, as robust_stability_margin() gives"
            " them: of others there is no bound to be drawn"
        )
    edges = np.unique(np.concatenate([one.edges for one in found.values()]))
    axis = frequency_axis(edges[np.isfinite(edges)])  # in continuous time the last arc has no end
    low, high = axis.range or (0.0, 1.0)
    layers: list[Layer] = []
    for k, (name, one) in enumerate(found.items()):
        colour, dash = (NOMINAL, "solid") if k == 0 else further(k - 1)[:2]
        hz, sizes = np.clip(np.repeat(one.edges, 2)[1:-1] / HZ, low, high), np.repeat(positive(1 / one.margins), 2)
        layers.append(Layer(name or "upper bound", hz, sizes, colour, dash=dash))
    layers += [_mark(one, low, high) for one in found.values() if np.isfinite(one.margin)]
    layers.append(Layer("limit", np.array([low, high]), np.ones(2), ALERT, dash="dot"))
    y = Axis("upper bound [–]", log=True, range=span_of(np.concatenate([layer.y for layer in layers]), 1.5))
    title = "Upper bound of the structured singular value"
    return Chart("stability", (Panel(title, axis, y, layers),))


def _mark(margin: RobustStabilityMargin, left: float, right: float) -> Layer:
    """The largest value of the bound, at its frequency."""
    hz, largest = margin.frequency / HZ, 1 / margin.margin
    words = f"{in_hz(hz, 6)}: at most {at_most(largest)}, margin {at_least(margin.margin)}"
    place = np.array([min(max(hz, left), right)]), np.array([largest])
    return Layer("largest", place[0], place[1], DATA, marker="diamond", hover=(words,))


def named_margins(argument: str, margins: object) -> dict[str, RobustStabilityMargin]:
    """Margins by the names of their controllers; one alone has none."""
    if isinstance(margins, RobustStabilityMargin):
        return {"": margins}
    wanted = "be a RobustStabilityMargin, or map names of controllers to such"
    found: dict[str, RobustStabilityMargin] = {}
    for name, one in by_name(argument, margins or None, wanted).items():
        if not isinstance(one, RobustStabilityMargin):
            raise InputTypeError(
                f"`{argument}` must map names to RobustStabilityMargin; got {name!r}: {type(one).__name__}"
            )
        found[name] = one
    return found


def _of(name: str) -> str:
    return f"[{name!r}]" if name else ""


def weights_section(
    identification: Identification, weights: StructuredWeight | Sequence[StructuredWeight]
) -> list[Block]:
    """Build the section of the weights: a table of the structures, their margins over frequency, and the first one drawn."""
    found, problem = as_weights(weights), identification.problem
    size = len(problem.outputs), len(problem.inputs)
    for one in found:
        nominal = one.nominal
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
        blocks += [
            Heading("What each structure leaves of the margin", 3),
            Drawing(dataclasses.replace(stability_chart(margins), name="structures")),
        ]
    words = f"Weights of {WORDS_OF[first.structure]}, with the bounds that they cover"
    return [*blocks, Heading(words, 3), Drawing(weights_chart(first, *_names(identification)))]


def weights_summary(weight: StructuredWeight) -> list[Block]:
    """Build the summary of one structure at the terminal."""
    return [weights_verdict([weight]), structure_table([weight])]


def weights_verdict(weights: Sequence[StructuredWeight]) -> Verdict:
    """Verdict on the weights, each of which must be above its bound now."""
    above = (
        "Every weight is stable, minimum-phase and above its bound on the whole circle: decided again from its numbers."
    )
    below = (
        "Not every weight is above its bound, decided again from its numbers: such a weight leaves out plants that are"
        " consistent with the data, and a design with it proves nothing of those."
    )
    return proved(all(one.certified for one in weights), above, below, "weights-verdict")


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
    return Table([Column("Blocks"), *of_numbers(*heads)], rows, title="Structures")


def weights_chart(
    weight: StructuredWeight, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None
) -> Chart:
    """Modulus of the weight of every block over the bound that it covers, rows of blocks below each other."""
    _, p, q = weight.bound.shape
    axis = frequency_axis(weight.edges)
    low, high = axis.range or tuple(weight.edges[[0, -1]] / HZ)
    hz = np.unique(np.append(spread(low, high, _POINTS, axis.log), weight.edges / HZ))
    hz = hz[(hz >= max(low, 0.0)) & (hz <= weight.edges[-1] / HZ)]
    steps = np.maximum(np.repeat(weight.edges, 2)[1:-1] / HZ, low)
    panels: list[Panel] = []
    for k, (i, j) in enumerate(np.ndindex(p, q)):
        model = weight.weights[k].model
        sizes = np.abs(responses(model, HZ * hz * model.dt)[:, 0, 0])
        layers = (
            Layer("bound of the error", steps, np.repeat(weight.bound[:, i, j], 2), ALERT, dash="solid"),
            Layer("|weight|", hz, sizes, NOMINAL, dash="solid"),
        )
        title = _block(weight.structure, i, j, outputs, inputs)
        y = Axis("size of the error", log=True, range=span_of(np.concatenate([one.y for one in layers]), 1.5))
        panels.append(Panel(title, axis, y, layers))
    return Chart("weights", panels, linked=True, columns=q, grid=p * q > 1)


def _block(structure: str, i: int, j: int, outputs: Sequence[str] | None, inputs: Sequence[str] | None) -> str:
    row = outputs[i] if outputs else f"output {i + 1}"
    column = inputs[j] if inputs else f"input {j + 1}"
    return {"full": "all entries", "input": column, "output": row, "entry": f"{row} / {column}"}[structure]


def _names(identification: Identification) -> tuple[list[str], list[str]]:
    problem = identification.problem
    return [str(signal) for signal in problem.outputs], [str(signal) for signal in problem.inputs]


def as_weights(weights: object) -> tuple[StructuredWeight, ...]:
    """One structure or several, as `structured_weights` gives them."""
    found = [weights] if isinstance(weights, StructuredWeight) else weights
    each = cast("Sequence[object]", found) if isinstance(found, Sequence) else ()
    good = tuple(one for one in each if isinstance(one, StructuredWeight))
    if not good or len(good) < len(each):
        raise InputTypeError(
            "`weights` must be a StructuredWeight or a sequence of them, from structured_weights(); got"
            f" {type(weights).__name__}"
        )
    return good
