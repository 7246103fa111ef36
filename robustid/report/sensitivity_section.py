"""The assumptions that a guarantee depends on, and the width of the class between the frequency points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.advice import Content, Sensitivity, Variation
from robustid.core import as_kind
from robustid.errors import InputError
from robustid.identification import Identification
from robustid.report.charts import ALERT, DATA, NOMINAL, Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.curves import span_of
from robustid.report.document import Block, Column, Drawing, Grid, Heading, Table, Text, Verdict, of_numbers
from robustid.report.identified import unit
from robustid.report.words import HZ, at_frequencies, at_most, in_hz, number

_SAME = 2e-3  # difference of two margins of one problem, at most
_KINDS = {"gain": "gain_bound", "decay": "decay_rate", "lines": "lines"}
_CAUTION = (
    "A guarantee that moves much with an assumption depends on it. A smaller class gives a narrower range because more is"
    " assumed, not because more is known: data can refute assumptions, never prove them."
)
_WORDS = {"gain": "the gain bound", "decay": "the decay rate", "lines": "the number of frequency points"}


def sensitivity_section(identification: Identification, given: object) -> list[Block]:
    """Build the section of how the guarantee moves with its assumptions."""
    table = _checked(given, identification)
    words = (
        f"Half of the largest width of the guaranteed set of values, relative to the response, {at_frequencies(table.omega)}."
        " Every row changes one assumption, keeps the others, and is identified anew; the poles of the parametric part and the"
        " bounds of the samples stay as stated in all of them."
    )
    return [
        Heading("What the guarantee depends on"),
        Text(sensitivity_sentence(table), id="sensitivity-sentence"),
        Text(words),
        Grid([sensitivity_chart(table, identification)], 3),
        _table(table),
        Text(_CAUTION, "caution"),
    ]


def _checked(given: object, identification: Identification) -> Sensitivity:
    """The table; refused is what isn't one, or belongs to another problem, as far as its margin tells."""
    table = as_kind("sensitivity", given, Sensitivity, "a Sensitivity, from sensitivity()")
    margin, low, high = table.variations[0].margin, identification.margin_lower, identification.margin
    if np.isfinite(margin) and not (1 - _SAME) * low - _SAME <= margin <= (1 + _SAME) * high + _SAME:
        raise InputError(
            f"`sensitivity` is about another problem than the one reported: its margin is {margin:.6g}, that of the"
            f" identification {high:.6g}; compute sensitivity(identification.problem)"
        )
    return table


def sensitivity_chart(table: Sensitivity, identification: Identification) -> Chart:
    """Median and largest half-width over each assumption, one panel an assumption, one scale for all."""
    rows = table.variations
    largest = max((row.worst for row in rows if np.isfinite(row.worst)), default=1.0)
    y = Axis("half-width / response [%]", range=(0.0, 112 * largest))
    axes = {
        "gain": ("gain bound K", unit(identification) or "–"),
        "decay": ("decay rate ρ", "–") if identification.problem.dt else ("decay α", "1/s"),
        "lines": ("frequency points", "–"),
    }
    panels: list[Panel] = []
    for kind, (name, of) in axes.items():
        found = sorted(
            (row for row in rows if row.kind in ("stated", kind)), key=lambda row: getattr(row, _KINDS[kind])
        )
        if len(found) == 1:
            continue
        x = np.array([getattr(row, _KINDS[kind]) for row in found], dtype=float)
        room = 0.12 * np.ptp(x)
        axis = Axis(f"{name} [{of}]", range=(float(x.min() - room), float(x.max() + room)))
        panels.append(Panel(name, axis, y, _layers(found, x)))
    return Chart("sensitivity", panels)


def _layers(rows: Sequence[Variation], x: np.ndarray) -> tuple[Layer, ...]:
    stated = [row.kind == "stated" for row in rows]
    looks = (
        ("worst", "worst of the frequencies", ALERT, "dash", "square"),
        ("median", "median over the frequencies", NOMINAL, "solid", "circle"),
    )
    curves: list[Layer] = []
    rings: list[Layer] = []
    for part, name, colour, dash, marker in looks:
        y = 100 * np.array([getattr(row, part) for row in rows])
        hover = tuple(f"{row.what}: {number(v, 3)} %" for row, v in zip(rows, y, strict=True))
        curves.append(Layer(name, x, y, colour, dash=dash, marker=marker, hover=hover))
        rings.append(Layer("as stated", x[stated], y[stated], DATA, marker="circle-open", size=2.0))
    return (*curves, *rings)


def sensitivity_sentence(table: Sensitivity) -> str:
    """Name the assumption with which the guarantee moves most."""
    stated, *others = table.variations
    moved = [(abs(np.log(row.median / stated.median)), row) for row in others if row.median > 0 and stated.median > 0]
    if not moved:
        return "None of the variations leaves a guarantee to compare with: as stated, or with every change, the data don’t fit."
    _, most = max(moved, key=lambda pair: pair[0])
    return (
        f"The guarantee moves most with {_WORDS[most.kind]}: with {_change(most, stated)} the median half-width is"
        f" {at_most(100 * most.median, 3)} % of the response instead of {at_most(100 * stated.median, 3)} %."
    )


def _change(row: Variation, stated: Variation) -> str:
    return f"gain bound × {row.gain_bound / stated.gain_bound:g}" if row.kind == "gain" else row.what


def _table(table: Sensitivity) -> Table:
    """Table of the variations, as stated first; the change is that of the median."""
    stated = table.variations[0]
    rows = [
        (
            _change(row, stated),
            *(_margin(row), _percent(row.median), _percent(row.worst), _against(row.median, stated.median)),
        )
        for row in table.variations
    ]
    heads = ("margin", "median", "worst", "median against stated")
    return Table([Column("Assumed"), *of_numbers(*heads)], rows)


def _margin(row: Variation) -> str:
    if np.isnan(row.margin):
        return "not solved"
    return f"{number(row.margin)}{': refuted' if row.margin > 1 else ''}"


def _percent(value: float) -> str:
    return f"{at_most(100 * value, 3)} %" if np.isfinite(value) else "–"


def _against(median: float, stated: float) -> str:
    return f"× {number(median / stated, 3)}" if median > 0 and stated > 0 else "–"


def content_verdict(found: Content) -> Verdict:
    """Verdict on what the class says, whatever the data: with content, little, or none."""
    key, word = "consistent", "The class says as much between the points as on them"
    if found.empty:
        key, word = "inconsistent", "The class says nothing between the points"
    elif found.signs:
        key, word = "weak", "The class says little between the points"
    return Verdict(key, word, found.summary(), (("between / on", number(found.ratio, 3)),), id="content")


def content_section(found: Content | None) -> list[Block]:
    """Build the section of the widths; nothing where there are no neighbouring points."""
    if found is None or not found.on.size:
        return []
    words = "Half-widths of an ellipsoid inside the set of consistent values, relative to the response: to be compared with each"
    return [
        Heading("What the class says between the points"),
        Text(found.summary()),
        Text(f"{words} other, not a guarantee.", "soft"),
        Drawing(content_chart(found)),
    ]


def content_chart(found: Content) -> Chart:
    """Width of the set between neighbouring frequency points and on them, relative to the response."""
    hz, ratios = found.omega / HZ, found.between / found.on
    hover = tuple(
        f"{in_hz(f, 6)}: {number(100 * b, 3)} % between, {number(100 * o, 3)} % on the points beside it"
        for f, b, o in zip(hz, found.between, found.on, strict=True)
    )
    wide = bool(np.any(ratios > 1)) and bool(found.signs)
    layers = (
        Layer("on the points", hz, found.on, DATA, marker="circle", hover=hover),
        Layer(
            "between them", hz, found.between, ALERT if wide else NOMINAL, marker="diamond-open", hover=hover, size=1.6
        ),
    )
    span = span_of(np.concatenate([found.on, found.between]), 2) or (1e-3, 1.0)
    panel = Panel(
        "Width of the set of consistent values",
        frequency_axis(found.omega),
        Axis("half-width / |response| [–]", log=True, range=span),
        layers,
    )
    return Chart("content", (panel,))
