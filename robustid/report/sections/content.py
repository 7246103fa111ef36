"""Statements of the class between the frequency points: the verdict, and the picture of the widths."""

from __future__ import annotations

import numpy as np

from robustid.advice import Content
from robustid.report.charts import Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.curves import span_of
from robustid.report.document import Block, Drawing, Heading, Text, Verdict
from robustid.report.style import ALERT, DATA, NOMINAL
from robustid.report.words import HZ, number


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
        f"{number(f, 6)} Hz: {number(100 * b, 3)} % between, {number(100 * o, 3)} % on the points beside it"
        for f, b, o in zip(hz, found.between, found.on, strict=True)
    )
    wide = bool(np.any(ratios > 1)) and bool(found.signs)
    layers = (
        Layer(name="on the points", x=hz, y=found.on, colour=DATA, marker="circle", hover=hover),
        Layer(
            name="between them",
            x=hz,
            y=found.between,
            colour=ALERT if wide else NOMINAL,
            marker="diamond-open",
            hover=hover,
            size=1.6,
        ),
    )
    span = span_of(np.concatenate([found.on, found.between]), 2) or (1e-3, 1.0)
    panel = Panel(
        title="Width of the set of consistent values",
        x=frequency_axis(found.omega),
        y=Axis(label="half-width / |response| [–]", log=True, range=span),
        layers=layers,
    )
    return Chart(name="content", panels=(panel,))
