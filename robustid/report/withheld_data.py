"""Withheld data against a guaranteed band: the verdict, the score of every record, and the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.guarantees import Coverage
from robustid.report.charts import ALERT, DATA, FAINT, MARKERS, Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.document import Block, Column, Drawing, Heading, Table, Text, Verdict, of_numbers
from robustid.report.words import HZ, at_hz, number, percent

CONTRADICTED = "What follows from the class and the data that were used: no guarantee, withheld data contradict it"


def withheld_verdict(found: Coverage) -> Verdict:
    """Verdict on the band: what it leaves out contradicts it."""
    sentence = found.finding[0].upper() + found.finding[1:]
    if found.contradicted:
        sentence += (
            " What is said below of every consistent system is about the class and the data that were used: it is no"
        )
        sentence += " guarantee for the machine."
    key = "inconsistent" if found.contradicted else "consistent"
    return Verdict(key, found.heading, sentence, (("inside", f"{percent(found.share, 4)}"),), id="withheld")


def not_guaranteed(blocks: Sequence[Block], found: Coverage | None) -> list[Block]:
    """Blocks about a band, which are not headed as a guarantee where withheld data contradict it."""
    if found is None or not found.contradicted:
        return list(blocks)
    other = Heading(CONTRADICTED)
    return [other if isinstance(b, Heading) and b.guarantee else b for b in blocks]


def withheld_section(found: Coverage | None) -> list[Block]:
    """Build the section of what was kept out; nothing where nothing was."""
    if found is None:
        return []
    shares = np.nanmean(np.where(np.isnan(found.error), np.nan, found.excess <= 1), axis=(1, 2, 3))
    rows = [
        (name, percent(share, 4), number(float(np.nanmax(excess))), number(score))
        for name, share, excess, score in zip(found.names, shares, found.excess, found.scores, strict=True)
    ]
    heads = "inside", "farthest,\nless its own bound", "score"
    return [
        Heading("Withheld data"),
        *(Text(sentence) for sentence in found.sentences),
        Table([Column("withheld"), *of_numbers(*heads)], rows),
        Text(
            "In units of the half-width of the band. Score: the factor on the band at which it holds the whole record, with its own"
            " bound.",
            "soft",
        ),
        Drawing(withheld_chart(found)),
    ]


def withheld_chart(found: Coverage) -> Chart:
    """Farthest entry of every withheld response at every frequency, with its own bound, in units of the band."""
    layers: list[Layer] = []
    for name, error, noise in zip(found.names, found.error, found.noise, strict=True):
        flat = np.where(np.isnan(error), -1.0, error).reshape(found.omega.size, -1)
        worst = np.argmax(flat, axis=1)[:, None]
        size, own = (np.take_along_axis(a.reshape(flat.shape), worst, axis=1)[:, 0] for a in (error, noise))
        known = np.isfinite(size)
        out = known & (size - own > 1)
        hover = at_hz(found.omega / HZ, "{} ± {}", size, own)
        for mask, colour, marker in ((known & ~out, DATA, "circle"), (out, ALERT, MARKERS[0])):
            if mask.any():
                words = name + (", outside" if colour == ALERT else "")
                low, high = np.maximum(size - own, 0.0)[mask], (size + own)[mask]
                said = tuple(text for text, one in zip(hover, mask, strict=True) if one)
                x, y = found.omega[mask] / HZ, size[mask]
                layers.append(Layer(words, x, y, colour, marker=marker, hover=said, low=low, high=high))
    x = frequency_axis(found.omega)
    ends = np.array(x.range if x.range else (0.0, 1.0))
    layers.append(Layer("edge of the band", ends, np.ones(2), FAINT, dash="dash"))
    panel = Panel("Withheld data in the band", x, Axis("|value − model| / half-width"), layers)
    return Chart("withheld", (panel,))
