"""The page of a watch: alarms, the history of the scores, where in frequency the last record lies, and the loop."""

from __future__ import annotations

import functools

import numpy as np

from robustid.advice import Moved, moved_modes
from robustid.core import Real, counted
from robustid.errors import InputError
from robustid.guarantees import Watch, Watched
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    first_panel,
    frequency_axis,
    whole_axis,
)
from robustid.report.curves import magnitude_range, positive, rounded
from robustid.report.document import (
    Block,
    Column,
    Document,
    Drawing,
    Facts,
    Glance,
    Heading,
    Table,
    Text,
    Verdict,
    of_numbers,
)
from robustid.report.identified import Parts
from robustid.report.setups_page import moved_table
from robustid.report.words import HZ, number

_LISTED = 20
_SCORES = (
    "Score: the smallest factor on the band and on the record's own bound, together, that holds it. Evidence of a drift: the sums"
    " of the e-values of the ranks; where they reach the limit an alarm is given, and they begin anew."
)
_WHERE = (
    "Distance from the middle of the band as a share of its half-width and the record's own bound together, at every frequency and"
    " in the entry where it is largest: of the last record, of the one with the first alarm, and of the records from before the"
    " watch their range."
)


def history_chart(found: Watch) -> Chart:
    """Scores of the records in their order, and the evidence of a drift against the limit of the alarm."""
    count = np.arange(1, len(found.records) + 1)
    before = np.arange(1 - len(found.usual), 1)
    ends = np.array([float(before[0]) if before.size else 1.0, float(count[-1]) if count.size else 1.0])
    label = "record (0 and before: from before the watch)" if found.usual else "record"
    axis = whole_axis(ends[0], ends[1], 0.5, label)
    layers: list[Layer] = []
    if found.usual:
        layers.append(Layer("before the watch", before, rounded(found.usual_scores), FAINT, marker="circle"))
    names = tuple(found.names)
    layers.append(Layer("watched", count, rounded(found.scores), DATA, marker="circle", hover=names))
    for word, alarmed, marker in (
        ("refuted", [one.refuted is not None for one in found.history], "diamond-open"),
        ("drifted", [one.drifted for one in found.history], "square-open"),
    ):
        mask = np.array(alarmed, dtype=bool)
        if mask.any():
            layers.append(Layer(word, count[mask], rounded(found.scores[mask]), ALERT, marker=marker, size=1.4))
    layers.append(Layer("band and bound", ends, np.ones(2), FAINT, dash="dash"))
    scores = np.concatenate([found.usual_scores, found.scores, [1.0]])
    sizes = Panel(
        "", axis, Axis("score [–]", log=True, range=magnitude_range(float(scores.max()), [float(scores.min())])), layers
    )
    limit = 1 / found.rate
    sums = positive(np.array(found.drift.sums))
    evidence = [
        Layer("evidence", count, rounded(sums), NOMINAL, dash="solid", marker="circle", size=0.5),
        Layer("limit of the alarm", ends, np.full(2, limit), ALERT, dash="dash"),
    ]
    reach = magnitude_range(float(np.max(sums, initial=limit)), [float(np.min(sums, initial=1.0))])
    return Chart(
        "history",
        (sizes, Panel("", axis, Axis("evidence of a drift [–]", log=True, range=reach), evidence)),
        linked=True,
    )


def where_chart(found: Watch) -> Chart:
    """Distances from the middle of the band over frequency: of the last record and of the first alarm, beside the usual ones."""
    coverage, first = found.coverage, len(found.usual)
    if coverage is None or not found.history:
        return Chart("where", ())
    axis = frequency_axis(coverage.omega)
    used = np.flatnonzero((coverage.omega > 0) | (not axis.log))
    sizes = _largest(found.shares)[:, used]
    x, layers = rounded(coverage.omega[used] / HZ), list[Layer]()
    if first:
        low, high = np.nanmin(sizes[:first], axis=0), np.nanmax(sizes[:first], axis=0)
        layers.append(
            Layer("before the watch", x, rounded(high), FAINT, low=rounded(low), high=rounded(high), fill=True)
        )
    drawn = {len(found.history) - 1: DATA}
    if alarmed := [k for k, one in enumerate(found.history) if _alarmed(one)]:
        drawn = {alarmed[0]: ALERT} | {k: c for k, c in drawn.items() if k != alarmed[0]}
    for k, colour in drawn.items():
        layers.append(
            Layer(found.names[k], x, rounded(sizes[first + k]), colour, dash="solid", marker="circle", size=0.45)
        )
    layers.append(Layer("band and bound", x[[0, -1]], np.ones(2), FAINT, dash="dash"))
    known = sizes[np.isfinite(sizes) & (sizes > 0)]
    reach = magnitude_range(float(known.max()), [float(np.quantile(known, 0.02))]) if known.size else None
    return Chart("where", (Panel("", axis, Axis("share of band and bound [–]", log=True, range=reach), layers),))


def _largest(sizes: Real) -> Real:
    """Largest entry at every frequency of every record; NaN where nothing was measured."""
    flat = np.where(np.isnan(sizes), -1.0, sizes).reshape(*sizes.shape[:2], -1).max(axis=2)
    return np.where(flat < 0, np.nan, flat)


def _alarmed(one: Watched) -> bool:
    return one.drifted or one.refuted is not None


def watch_verdict(found: Watch) -> Verdict:
    """Verdict: quiet, drifted or refuted, on all that was watched."""
    refuted, drifted = bool(found.refuted), bool(found.drifted)
    key = "inconsistent" if refuted else "undecided" if drifted or not found.history else "consistent"
    word = "Refuted" if refuted else "Drifted" if drifted else "No alarm" if found.history else "Nothing watched yet"
    numbers = [("records", str(len(found.records)))]
    if found.history:
        numbers.append(("last score", number(found.history[-1].score, 3)))
    return Verdict(key, word, found.verdict, tuple(numbers))


def watch_page(found: Watch, heading: str | None, parts: Parts) -> Document:
    """Build the page of a watch."""
    del parts
    chart, where = history_chart(found), where_chart(found)
    body: list[Block] = [Heading("History"), Text(_SCORES, "soft")]
    if found.history:
        body += [Drawing(chart), Heading("Where in frequency"), Text(_WHERE, "soft"), Drawing(where)]
    moved = _moved(found)
    if moved:
        body += [Heading("Which mode moved"), *moved]
    body += [
        Heading("Records"),
        _records(found),
        Heading("What the alarms mean"),
        *(Text(one) for one in found.sentences[1:]),
        Facts(
            [
                ("Refuted", "a proof: no plant of the class explains the data of the band and this record"),
                ("Drifted", f"on average at most one false alarm in {number(1 / found.rate)} records"),
                (
                    "Assumed for a drift",
                    "while nothing changes the records are exchangeable: measured in one way, independent",
                ),
                ("From before the watch", counted(len(found.usual), "record")),
            ]
        ),
    ]
    return Document(
        heading or "Watch",
        head=[watch_verdict(found)],
        body=body,
        glance=Glance(
            numbers=[*watch_verdict(found).numbers, ("before the watch", str(len(found.usual)))],
            words=" ".join([*found.sentences[1:-1], *(one.text for one in moved[:1] if isinstance(one, Text))]),
            chart=first_panel(chart) if found.history else None,
            next=[Text(_next(found))],
        ),
    )


def _moved(found: Watch) -> list[Block]:
    """Modes of the last record beside those from before, where it gave an alarm."""
    if not found.history or not _alarmed(found.history[-1]):
        return []
    try:
        rows = _rows_of(found)
    except InputError as error:
        return [Text(f"No mode is compared: {error}.")]
    shown = [one for one in rows if one.shown]
    if not shown:
        return [
            Text("No mode is shown to have moved: its boxes before and now have a part in common."),
            moved_table(rows),
        ]
    words = "; ".join(one.words for one in shown)
    return [Text(f"{words[0].upper()}{words[1:]}."), moved_table(rows)]


@functools.lru_cache(maxsize=1)
def _rows_of(found: Watch) -> tuple[Moved, ...]:
    """The modes of the last record; screen and page of one command ask for them one after the other."""
    return moved_modes(found)


def _records(found: Watch) -> Table:
    named = any(one.member for one in found.history)
    rows = [
        (
            one.name,
            number(one.score, 4),
            found.where(one.at),
            number(one.e_value, 3),
            number(one.evidence, 3),
            "refuted" if one.refuted is not None else "drifted" if one.drifted else "",
            *([one.member] if named else []),
        )
        for one in reversed(found.history)
    ]
    columns = [
        Column("record"),
        Column("score", "n"),
        Column("at", "whole"),
        *of_numbers("e-value", "evidence"),
        Column("alarm"),
        *([Column("nearest member")] if named else []),
    ]
    return Table(columns, rows, empty="No record has come yet.", most=_LISTED)


def _next(found: Watch) -> str:
    if found.refuted or found.drifted:
        return (
            "Ask first if the setup or a condition has changed. If the machine is to stay as it is now, identify it anew; a"
            " condition that comes back, such as temperature or load, is a member of a family."
        )
    return "Give it the next record: robustid watch STATE RECORD."
