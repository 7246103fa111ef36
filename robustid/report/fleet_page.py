"""The page of a fleet: verdicts, worst cases, machines that are unlike the others, and who waits for data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.guarantees import QUANTITIES, Fleet, FleetRow, FleetState
from robustid.report.charts import DATA, Axis, Chart, Layer, Panel, first_panel
from robustid.report.curves import magnitude_range, positive, rounded, thinned
from robustid.report.document import Block, Column, Document, Drawing, Glance, Heading, Table, Text, Verdict
from robustid.report.identified import Parts
from robustid.report.words import at_most, number

_LISTED = 10  # rows of a table at the terminal
_CELLS = 350
_DOTS = 18.0  # times the usual size, over the root of their number: few are large, many don't hide each other
_OUTLIERS = (
    "The logarithm of a quantity is more than 3.5 robust standard deviations from the median of all: of a normal spread five in ten"
    " thousand are that far. Unlike is not wrong: look at its data first."
)
_WORST = "Largest median of the guaranteed error as a share of the response."


def error_chart(found: Fleet) -> Chart:
    """Guaranteed errors of all, in ascending order."""
    count = np.arange(1, found.relative.size + 1)
    kept = thinned(count.astype(float), [found.relative], _CELLS)
    values = rounded(positive(found.relative[kept]))
    size = min(max(_DOTS / float(np.sqrt(count.size)), 0.7), 1.8)
    layer = Layer(found.thing, count[kept], values, DATA, marker="circle", size=size)
    reach = magnitude_range(float(np.max(found.relative)), [float(np.min(found.relative))])
    y = Axis("guaranteed error [% of the response]", log=True, range=reach)
    return Chart("errors", (Panel("", Axis(f"{found.things}, in the order of their error"), y, [layer]),), linked=True)


def fleet_verdict(found: Fleet) -> Verdict:
    """Verdict on all machines: consistent only if all are."""
    good = found.states.get(FleetState.CONSISTENT, 0)
    lost = sum(found.states.get(state, 0) for state in (FleetState.FAILED, FleetState.UNDECIDED, FleetState.WAITING))
    key = "consistent" if good == found.asked else "inconsistent" if found.refuted else "undecided"
    word = "All consistent" if good == found.asked else f"{good} of {found.asked} consistent"
    numbers = [(found.things, str(found.asked)), ("without a verdict", str(lost + found.open))]
    return Verdict(key, word, found.verdict, tuple(numbers))


def fleet_page(found: Fleet, heading: str | None, parts: Parts) -> Document:
    """Build the page of a fleet."""
    del parts
    chart = error_chart(found) if found.relative.size else None
    numbers = [*fleet_verdict(found).numbers]
    if found.relative.size:
        numbers.append(("guaranteed error, median", f"{at_most(float(np.median(found.relative)), 3)} %"))
    numbers += [("unlike the others", str(len({one.name for one in found.outliers})))]
    numbers += [("waiting for data", str(len(found.waiting)))]
    faults: list[Block] = []
    if found.faulty:
        words = f"The data of {found.faulty} of {found.asked} {found.things} have a fault that nothing has undone"
        faults.append(Text(f"{words}; their pages say which.", "warning", head="Warning"))
    columns = [_first(found), Column("For", "text")]
    cells = [(row.name, row.waits) for row in found.waiting]
    body: list[Block] = [
        Heading("Without a verdict"),
        *[Text(found.left_words)] * bool(found.left),
        _sentences(found, found.failed, "All that were run have one."),
        Heading("Refuted or contradicted"),
        _sentences(found, found.refuted, f"The data of no {found.thing} contradict its class or its band."),
        Heading("Who waits for data"),
        Table(columns, cells, empty=f"No {found.thing} does.", most=_LISTED),
        Heading("Worst cases"),
        Text(_WORST, "soft"),
        *([] if chart is None else [Drawing(chart)]),
        _worst(found),
        Heading("Unlike the others"),
        Text(_OUTLIERS, "soft"),
        _outliers(found),
    ]
    if found.unfinished:
        body += [Heading("Out of time"), _sentences(found, found.unfinished, "", unfinished=True)]
    return Document(
        heading or ("Fleet" if found.thing == "machine" else f"{found.things.capitalize()} of a matrix"),
        head=[fleet_verdict(found), *faults],
        body=body,
        glance=Glance(
            numbers=numbers,
            words=f"{number(found.seconds, 4)} s of runs in all. The table beside this page has a row for every {found.thing}.",
            chart=None if chart is None else first_panel(chart),
            next=[Text(_next(found))],
        ),
    )


def _first(found: Fleet) -> Column:
    return Column(found.thing.capitalize(), "whole")


def _sentences(found: Fleet, rows: Sequence[FleetRow], empty: str, unfinished: bool = False) -> Table:
    cells = [(row.name, row.state.value, row.unfinished if unfinished else row.sentence) for row in rows]
    columns = [_first(found), Column("State", "whole"), Column("In words", "text")]
    return Table(columns, cells, empty=empty, most=_LISTED)


def _worst(found: Fleet) -> Table:
    cells = [
        (
            row.name,
            at_most(row.relative, 3),
            at_most(row.error, 4),
            number(row.error_hz, 4),
            str(row.order),
            number(row.margin, 4),
            row.state.value,
        )
        for row in found.worst
    ]
    heads = ("Error [% of\nthe response]", "Largest\nerror", "at [Hz]", "Order", "Margin")
    columns = [_first(found), *(Column(head, "n") for head in heads), Column("State", "whole")]
    return Table(columns, cells, empty=f"No {found.thing} has a guaranteed error.", most=_LISTED)


def _outliers(found: Fleet) -> Table:
    cells = [
        (
            one.name,
            QUANTITIES[one.quantity],
            number(one.value, 4),
            number(one.median, 4),
            number(one.value / one.median, 3),
            number(one.score, 3),
        )
        for one in found.outliers
    ]
    heads = ("Value", "Median\nof all", "Ratio", "Robust\nscore")
    columns = [_first(found), Column("Quantity", "text"), *(Column(head, "n") for head in heads)]
    return Table(columns, cells, empty="None is.", most=_LISTED)


def _next(found: Fleet) -> str:
    if found.open:
        return "The same command goes on with those that have not been run yet."
    if found.failed:
        return "Correct what the sentences of the failed runs name; the same command with --force runs these again, no others."
    if found.waiting:
        return "The same command, when the data are there, runs those that wait for them, no others."
    if found.thing != "machine":
        return f"Model and band of every {found.thing} are in the folder of its name, with a page of their own."
    return (
        "One controller for all: robustid control FOLDER/*/ --structure ... names the machines that make it expensive."
    )
