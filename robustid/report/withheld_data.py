"""Withheld data against a guaranteed band: the verdict, the score of every record, and the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.guarantees import Coverage, Judgement
from robustid.report.charts import ALERT, DATA, FAINT, MARKERS, Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.document import Block, Column, Drawing, Heading, Table, Text, Verdict, of_numbers
from robustid.report.words import HZ, at_hz, number, percent

CONTRADICTED = "What follows from the class and the data that were used: no guarantee, withheld data contradict it"

_KEYS = {Judgement.SUPPORTED: "consistent", Judgement.CONTRADICTED: "inconsistent", Judgement.NOT_TESTED: "weak"}


def withheld_verdict(found: Coverage) -> Verdict:
    """Verdict on the band: what it leaves out contradicts it."""
    sentence = found.finding[0].upper() + found.finding[1:]
    if found.contradicted:
        sentence += (
            " What is said below of every consistent system is about the class and the data that were used: it is no"
        )
        sentence += " guarantee for the machine."
    number = ("inside", percent(found.share, 4)) if found.contradicted else ("power", percent(found.power, 3))
    return Verdict(_KEYS[found.judgement], found.heading, sentence, (number,), id="withheld")


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
    rows: list[tuple[str, ...]] = []
    for name, error, noise, excess, score in zip(
        found.names, found.error, found.noise, found.excess, found.scores, strict=True
    ):
        known = np.isfinite(error)
        judging = known & (found.counts | (excess > 1))
        inside = 1 - int((excess[judging] > 1).sum()) / int(judging.sum()) if judging.any() else np.nan
        seen = (f"{known.sum()}", f"{(known & found.counts).sum()}", percent(inside, 4))
        sizes = number(float(excess[known].max())), number(float(np.quantile(noise[known], 0.5)))
        rows.append((name, *seen, *sizes, *[number(score)] * found.scored))
    heads = [
        "samples",
        "that count",
        "inside",
        "farthest,\nless its own bound",
        "own bound,\nmedian",
        *["score"] * found.scored,
    ]
    words = (
        "In units of the half-width of the band. Samples with errors of their own as large as the band do not count."
    )
    if found.scored:
        words += " Score: the factor on the band at which it holds the whole record, with its own bound."
    return [
        Heading("Withheld data"),
        *(Text(sentence) for sentence in found.sentences),
        Table([Column("withheld"), *of_numbers(*heads)], rows),
        Text(words, "soft"),
        Drawing(withheld_chart(found)),
    ]


def withheld_chart(found: Coverage) -> Chart:
    """Farthest entry of every withheld response at every frequency, with its own bound, in units of the band."""
    layers: list[Layer] = []
    judging = found.counts.reshape(found.omega.size, -1)
    for name, error, noise in zip(found.names, found.error, found.noise, strict=True):
        flat = np.where(np.isnan(error), -1.0, error).reshape(found.omega.size, -1)
        worst = np.argmax(flat, axis=1)[:, None]
        size, own = (np.take_along_axis(a.reshape(flat.shape), worst, axis=1)[:, 0] for a in (error, noise))
        known = np.isfinite(size)
        out = known & (size - own > 1)
        counts = known & ~out & np.take_along_axis(judging, worst, axis=1)[:, 0]
        hover = at_hz(found.omega / HZ, "{} ± {}", size, own)
        for mask, colour, marker, said in (
            (counts, DATA, "circle", ""),
            (known & ~out & ~counts, FAINT, "circle", ", does not count"),
            (out, ALERT, MARKERS[0], ", outside"),
        ):
            if mask.any():
                words = name + said
                low, high = np.maximum(size - own, 0.0)[mask], (size + own)[mask]
                texts = tuple(text for text, one in zip(hover, mask, strict=True) if one)
                x, y = found.omega[mask] / HZ, size[mask]
                layers.append(Layer(words, x, y, colour, marker=marker, hover=texts, low=low, high=high))
    x = frequency_axis(found.omega)
    ends = np.array(x.range if x.range else (0.0, 1.0))
    layers.append(Layer("edge of the band", ends, np.ones(2), FAINT, dash="dash"))
    panel = Panel("Withheld data in the band", x, Axis("|value − model| / half-width"), layers)
    return Chart("withheld", (panel,))
