"""Two measurements beside each other: where they differ by more than noise; figure, page and summary."""

from __future__ import annotations

import numpy as np

from robustid.identification import Comparison
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    FURTHER,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    first_panel,
    frequency_axis,
    side_by_side,
)
from robustid.report.curves import (
    cells_per_entry,
    low_quantile,
    magnitude_range,
    measured_phase,
    next_to,
    position,
    positive,
    rounded,
    thinned,
    with_gaps,
)
from robustid.report.document import Block, Column, Document, Facts, Glance, Grid, Heading, Table, Text, Verdict
from robustid.report.identified import Parts
from robustid.report.magnitude_phase import MagnitudePhase, phase_axis
from robustid.report.words import HZ, in_hz, number, percent, title, unit_label

_LISTED = 20  # places at the terminal
_FEW = 300  # points, up to which each gets a marker
_WORDS = (
    "First and second response, and below them the size of their difference with the limit that noise alone reaches nowhere at the"
    " stated probability. What lies beyond is marked."
)


def comparison_chart(found: Comparison) -> Chart:
    """Both responses of every entry, their difference and what noise explains."""
    charts = _entries(found)
    return side_by_side("comparison", charts, found.chance.shape[2])


def _entries(found: Comparison) -> list[Chart]:
    cells = cells_per_entry(found.chance[0].size)
    return [_entry(found, i, j, cells) for i, j in np.ndindex(found.chance.shape[1:])]


def _entry(found: Comparison, i: int, j: int, cells: int) -> Chart:
    axis, name = frequency_axis(found.omega), found.entry(i, j)
    used = np.flatnonzero(found.compared[:, i, j] & ((found.omega > 0) | (not axis.log)))
    if not used.size:
        nothing = Axis("")
        drawn = MagnitudePhase().chart(f"entry-{i}-{j}", axis, nothing, nothing, f"{name}: not compared")
        return Chart(drawn.name, (*drawn.panels, Panel("", axis, nothing, ())), linked=True)
    omega, first, second = found.omega[used], found.first.values[used, i, j], found.second.values[used, i, j]
    difference, limit = np.abs(found.difference[used, i, j]), found.limit[used, i, j]
    beyond = found.beyond[used, i, j]
    kept = thinned(position(omega, axis.log), [np.abs(first), np.abs(second), difference], cells)
    angle, span = measured_phase(omega, first, None)
    turned = next_to(np.degrees(np.angle(second)), angle)
    x, drawn, marker = rounded(omega[kept] / HZ), MagnitudePhase(), "circle" if kept.size <= _FEW else ""
    for called, values, turn, colour, dash in (
        ("first", first, angle, DATA, "solid"),
        ("second", second, turned, NOMINAL, "dash"),
    ):
        curve = rounded(positive(np.abs(values[kept]))), rounded(with_gaps(turn[kept]))
        drawn.add(called, x, *curve, colour=colour, dash=dash, marker=marker, size=0.45)
    out = kept[beyond[kept]]
    if out.size:
        places = rounded(np.abs(second[out])), rounded(turned[out])
        drawn.add("beyond noise", rounded(omega[out] / HZ), *places, colour=ALERT, marker="circle-open", size=1.2)
    sizes = np.abs(np.concatenate([first, second]))
    y = Axis(
        f"magnitude{_unit(found, i, j)}",
        log=True,
        range=magnitude_range(float(sizes.max()), [low_quantile(sizes), float(sizes.max()) / 10]),
    )
    chart = drawn.chart(f"entry-{i}-{j}", axis, y, phase_axis(span), name)
    layers = [
        Layer("limit of noise", x, rounded(positive(limit[kept])), FAINT, dash="dash"),
        Layer(
            "|second − first|",
            x,
            rounded(positive(difference[kept])),
            FURTHER[1],
            dash="solid",
            marker=marker,
            size=0.45,
        ),
    ]
    if out.size:
        at = rounded(omega[out] / HZ), rounded(difference[out])
        layers.append(Layer("beyond noise", *at, ALERT, marker="circle-open", size=1.2))
    shown = np.concatenate([part[part > 0] for part in (difference, limit)])
    reach = magnitude_range(float(shown.max()), [low_quantile(shown)]) if shown.size else None
    below = Panel("", axis, Axis(f"difference{_unit(found, i, j)}", log=True, range=reach), layers)
    return Chart(chart.name, (*chart.panels, below), linked=True)


def _unit(found: Comparison, i: int, j: int) -> str:
    return unit_label(found.first.outputs[i].unit, found.first.inputs[j].unit)


def comparison_verdict(found: Comparison) -> Verdict:
    """Verdict on the difference."""
    key, word = ("inconsistent", "They differ") if found.differ else ("consistent", "Noise explains all")
    numbers = (("frequency points", str(found.omega.size)), ("by chance", number(found.by_chance, 2)))
    return Verdict(key, word, found.verdict, numbers)


def comparison_page(found: Comparison, heading: str | None, parts: Parts) -> Document:
    """Build the page of a comparison."""
    del parts
    entries, several = _entries(found), found.chance[0].size > 1
    body: list[Block] = [
        Heading("Both responses"),
        Text(_WORDS, "soft"),
        Grid(entries, found.chance.shape[2], small=found.chance.shape[2] > 1, titled=several),
        Heading("Where they differ"),
        _places(found),
        Heading("How probable it is by chance"),
        Facts(_facts(found)),
        *(Text(f"{one[0].upper()}{one[1:]}.") for one in found.assumed),
    ]
    k, i, j = found.most
    shown = next(one for one in entries if one.name == f"entry-{i}-{j}")
    size = ("largest difference", f"{number(float(np.abs(found.difference[k, i, j])), 3)} at {in_hz(found.hz, 4)}")
    faults = [f"{name}: {one}" for name in ("first", "second") for one in getattr(found, name).faults]
    return Document(
        heading or title("Comparison", found.first.outputs, found.first.inputs),
        head=[comparison_verdict(found), *(Text(one, "warning", head="Warning") for one in faults)],
        body=body,
        glance=Glance(
            numbers=[*comparison_verdict(found).numbers, size],
            chart=Chart("first", shown.panels[2:], linked=True) if found.differ else first_panel(shown),
            next=[Text(_next(found))],
        ),
    )


def _next(found: Comparison) -> str:
    if not found.differ:
        return "Both may go into one model. Smaller differences than the noise show with more periods or realisations."
    return (
        "Ask first if the setup has changed (rid.prepare.experiment_faults finds a wrong sign, unit, delay or exchanged columns); a"
        " plant that moves with its condition is a family: rid.family."
    )


def _places(found: Comparison) -> Table:
    rows = [
        (
            found.entry(one.output, one.input),
            f"{number(one.low, 5)}" if one.points == 1 else f"{number(one.low, 5)} to {number(one.high, 5)}",
            str(one.points),
            number(float(np.abs(found.difference[one.worst, one.output, one.input])), 3),
            percent(_share(found, one.worst, one.output, one.input)),
            number(one.times, 3),
        )
        for one in found.where
    ]
    heads = ("Points", "Largest\ndifference", "of the first", "over the\nlimit")
    columns = [Column("Entry", "text"), Column("Frequencies [Hz]", "whole"), *(Column(head, "n") for head in heads)]
    return Table(columns, rows, empty="No single place is beyond what noise explains.", most=_LISTED)


def _share(found: Comparison, k: int, i: int, j: int) -> float:
    size = float(np.abs(found.first.values[k, i, j]))
    return float(np.abs(found.difference[k, i, j])) / size if size else np.inf


def _facts(found: Comparison) -> list[tuple[str, str]]:
    rows = [
        ("The largest difference", f"{number(found.largest, 2)}, whatever depends on what (Bonferroni over all places)")
    ]
    if found.together is not None:
        rows.append(("All together", f"{number(found.together, 2)}, from their sum"))
    rows.append(
        ("From both", f"{number(found.by_chance, 2)}; called different at {number(1 - found.probability, 3)} or less")
    )
    return rows
