"""Residuals of an identification against their bounds, and the active constraints: the samples that carry the proof."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.identification import Identification, Residual, model_residuals
from robustid.report.assumptions import shared_words
from robustid.report.charts import ALERT, DATA, NOMINAL, Axis, Chart, Layer, Panel, in_rows, lighter
from robustid.report.document import Block, Column, Drawing, Grid, Heading, Share, Table, Text
from robustid.report.identified import Models, Shown, band, experiment_words, hertz, shown_models, siso, transfer, where
from robustid.report.words import HZ, in_hz, number

_TOUCHES = 0.99  # of the limit: the sample is marked
_BESIDE = 1.1  # of the axis beside the first and the last frequency point
_SMALLEST_RATIO = 1e-3
_MOST = 8  # samples at the terminal


def residual_section(identification: Identification, models: Models) -> list[Block]:
    """Residuals against their bounds."""
    words = "Each sample divided by its own bound: 1 is the limit. Marked samples touch it, or lie outside."
    if shared_words(identification):
        words += " Of samples that share a bound the norm of all together."
    blocks, chart = (
        [Heading("Residuals against their bounds"), Text(words, "soft")],
        residual_chart(identification, models),
    )
    if siso(identification):
        return [*blocks, Drawing(chart, titled=True)]
    return [*blocks, Grid(lighter([chart]), len(identification.problem.inputs))]


class Active(NamedTuple):
    """A sample that carries the proof, with its dual weight."""

    experiment: str
    of: str
    place: str
    weight: float
    ratio: float


def active_constraints(identification: Identification) -> list[Active]:
    """Samples that keep the margin from being smaller, or contradict each other, largest dual weight first.

    None where nothing was proved: a margin of 0 has no active constraints.
    """
    if identification.margin_lower <= 0:
        return []
    rows: list[Active] = []
    for residual, index, share in identification.limiting():
        at = residual.axis[index]
        ratio = float(residual.ratio[residual.axis == at].max())  # of repeated points the worst
        place = in_hz(at / HZ) if residual.kind == "frequency" else f"{number(at, 5)} s"
        experiment = experiment_words(identification, residual.kind, residual.index)
        rows.append(Active(experiment, where(identification, residual), place, share, ratio))
    return rows


def active_title(inconsistent: bool) -> str:
    """Heading of the table of active constraints."""
    return "Samples that contradict the assumptions" if inconsistent else "Active constraints"


def active_section(identification: Identification, inconsistent: bool) -> list[Block]:
    """The active constraints with their dual weights."""
    heading, table = Heading(active_title(inconsistent)), active_table(identification, inconsistent)
    if not table.rows:
        return [heading, Text("None: the class is rich enough to pass through every sample.")]
    words = "These samples keep the margin from being smaller."
    if inconsistent:
        words = "The proof is a weighted sum of residuals, and these samples carry it: no system of the class reaches all of them."
    words += " The dual weight is the share of the sample in the proof; weights below 1 % are left out."
    return [heading, Text(words), table]


def active_table(identification: Identification, inconsistent: bool) -> Table:
    """Table of the active constraints; of a MIMO problem with the entry or signal."""
    several = not siso(identification)
    columns = [
        Column("Experiment", "whole"),
        *[Column("Of", "text", "Response")] * several,
        Column("At", "n"),
        Column("Dual weight", "share", "Dual\nweight"),
        Column("|residual| / bound", "n", "|residual|\n/ bound"),
    ]
    rows = [
        (
            row.experiment,
            *[row.of] * several,
            row.place,
            Share(f"{number(100 * row.weight, 2)} %", row.weight),
            number(row.ratio),
        )
        for row in active_constraints(identification)
    ]
    return Table(columns, rows, title=active_title(inconsistent), most=_MOST)


def residual_chart(identification: Identification, models: Models = None) -> Chart:
    """|residual|/bound of every sample, the limit, and who touches it: a panel for each entry or output that has bounds."""
    problem, shown = identification.problem, shown_models(identification, models)
    found = [list(identification.residuals), *(model_residuals(problem, one.model) for one in shown[1:])]
    panels: list[Panel] = []
    for kind in ("frequency", "time"):
        places = [k for k, r in enumerate(found[0]) if r.kind == kind]
        if not places:
            continue
        parts = [[residuals[k] for k in places] for residuals in found]
        # One scale for all: they are compared.
        largest = max(identification.margin, *(float(r.ratio.max()) for residuals in parts for r in residuals))
        smallest = min(float(r.ratio.min()) for residuals in parts for r in residuals)
        for group, label in _grouped(identification, parts[0]):
            part = [[residuals[k] for k in group] for residuals in parts]
            panels.append(_panel(identification, kind, label, part, shown, (smallest, largest)))
    return Chart("residuals", panels, grid=not siso(identification))


def _grouped(identification: Identification, residuals: list[Residual]) -> list[tuple[list[int], str]]:
    """Group the residuals that belong in one panel, those of one entry in several experiments for instance, with its name."""
    if siso(identification):
        label = transfer(identification) if residuals[0].kind == "frequency" else where(identification, residuals[0])
        return [(list(range(len(residuals))), f"{label}: {residuals[0].kind} samples")]
    names: dict[str, list[int]] = {}
    # Row by row; what belongs to no row, or to none at all, at the end.
    places = [[np.inf if index is None else index for index in residual.entry] for residual in residuals]
    for k in sorted(range(len(residuals)), key=places.__getitem__):
        names.setdefault(where(identification, residuals[k]), []).append(k)
    return [(places, name) for name, places in names.items()]


def _panel(
    identification: Identification,
    kind: str,
    label: str,
    parts: list[list[Residual]],
    shown: list[Shown],
    span: tuple[float, float],
) -> Panel:
    margin, (smallest, largest) = identification.margin, span
    x, low = _axis(identification, kind, parts[0])
    log = largest > 3
    decade = 10 ** np.floor(np.log10(max(smallest, _SMALLEST_RATIO)))
    floor = float(np.clip(decade, _SMALLEST_RATIO, 0.1)) if log else 0.0
    layers: list[Layer] = []
    for one, residuals in zip(shown, parts, strict=True):
        at = np.concatenate([np.maximum(r.axis, low) / HZ if kind == "frequency" else r.axis for r in residuals])
        true = np.concatenate([r.ratio for r in residuals])
        ratio = np.maximum(true, floor)
        hover = tuple(f"{number(a, 6)}: {number(r)} of the bound" for a, r in zip(at, true, strict=True))
        nominal = one.colour == NOMINAL
        low_end, high_end = (np.full(at.size, floor), ratio) if nominal else (None, None)
        layers.append(
            Layer(one.name, at, ratio, one.colour, marker=one.marker, hover=hover, low=low_end, high=high_end)
        )
        if nominal:
            layers += _marked(at, ratio, max(1.0, margin))
    ends = np.array(x.range)
    layers.append(Layer("limit: residual = bound", ends, np.ones(2), DATA, dash="solid"))
    # A margin of almost 0 would be a line on the axis.
    if margin > max(floor, 1e-3):
        name = f"smallest reachable: {number(margin)}"
        layers.append(Layer(name, ends, np.full(2, margin), ALERT, dash="dash"))
    reach = (floor, 2 * largest) if log else (0.0, 1.12 * max(largest, 1.0))
    y = Axis("|residual| / bound", log=log, range=reach)
    return Panel(label, x, y, layers)


def _axis(identification: Identification, kind: str, residuals: list[Residual]) -> tuple[Axis, float]:
    """The axis over the samples, and its lower end in rad/s (0 for time)."""
    last = max(float(r.axis.max()) for r in residuals)
    if kind == "time":
        return Axis("time [s]", range=(-0.02 * last, 1.02 * last)), 0.0
    low, high = band(identification.problem)
    if last > 0:
        first = min(float(r.axis.min(where=r.axis > 0, initial=last)) for r in residuals)
        low, high = max(low, first / _BESIDE), min(high, last * _BESIDE)
    return hertz(identification.problem, low, high), low


def _marked(at: np.ndarray, ratio: np.ndarray, limit: float) -> list[Layer]:
    """Rings around the samples outside their bound, and around those that touch the limit."""
    touches = ratio >= _TOUCHES * limit
    outside = (ratio > 1) & ~touches
    groups = (
        (touches, "touches the limit" if limit == 1 else "touches margin × bound", "diamond-open", 2.2),
        (outside, "outside its bound", "circle-open", 2.0),
    )
    return [
        Layer(name, at[mask], ratio[mask], ALERT, marker=marker, size=size)
        for mask, name, marker, size in groups
        if np.any(mask)
    ]


def identified_residuals(identification: Identification, models: Models = None) -> Chart:
    """The residuals, a row for every output where entries have panels of their own."""
    chart = residual_chart(identification, models)
    return in_rows(chart, len(identification.problem.inputs)) if chart.grid else chart
