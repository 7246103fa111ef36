"""Modes of one machine in several setups: what all leave, and which of them contradict each other; block and page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.advice import CommonModes, Moved, disagreement_words, ends_words
from robustid.report.document import Block, Column, Document, Facts, Glance, Heading, Table, Text, Verdict
from robustid.report.identified import Parts
from robustid.report.words import HZ, number, percent, plural

_JOINT = (
    "Of each mode the part of its pole that the boxes of all setups have in common. Where they have none, the two setups that are"
    " farthest apart stand in its place: no average of a contradiction is a mode of the machine."
)


def setups_verdict(found: CommonModes) -> Verdict:
    """Verdict on agreement."""
    key, word = ("consistent", "They agree") if found.compared else ("undecided", "Nothing compared")
    if found.disagreements:
        key, word = "inconsistent", "They contradict each other"
    numbers = (("setups", str(len(found.names))), ("modes of several", str(found.compared)))
    return Verdict(key, word, found.verdict, numbers)


def setups_page(found: CommonModes, heading: str | None, parts: Parts) -> Document:
    """Build the page of the modes of several setups."""
    del parts
    body: list[Block] = [Heading("Modes"), Text(_JOINT, "soft"), _modes(found)]
    if found.disagreements:
        body += [
            Heading("Contradictions"),
            Facts([(f"Mode {one.mode + 1}", disagreement_words(one)) for one in found.disagreements]),
        ]
        if found.odd is not None:
            body += [Heading(f"{found.odd} beside the others"), moved_table(found.moved(found.odd))]
            body += [Heading(f"Modes without {found.odd}"), _modes(found.without(found.odd))]
    body += [Heading("Every setup"), _boxes(found)]
    body += [Heading("What this stands on"), *(Text(f"{one[0].upper()}{one[1:]}.") for one in found.assumed)]
    return Document(
        heading or "Modes of several setups",
        head=[setups_verdict(found)],
        body=body,
        glance=Glance(
            numbers=[*setups_verdict(found).numbers],
            words=" ".join(
                f"Mode {k + 1}: {found.mode_words(k)}." for k in range(len(found.used)) if found.used[k].any()
            ),
            next=[Text(_next(found))],
        ),
    )


def moved_table(rows: Sequence[Moved]) -> Table:
    """Modes before and after, and the change that both leave; what is shown to have moved stands out."""
    cells = [
        (
            str(one.mode + 1),
            "frequency [Hz]" if one.quantity == "frequency" else "damping",
            ends_words(one.before),
            ends_words(one.after),
            f"{percent(one.change[0], 3)} to {percent(one.change[1], 3)}",
            "moved" if one.shown else "",
        )
        for one in rows
    ]
    columns = [Column("Mode", "n"), Column("of", "whole"), Column("before", "whole"), Column("now", "whole")]
    columns += [Column("change", "whole"), Column("shown", "text")]
    return Table(columns, cells, strong=[one.shown for one in rows], empty="No mode is shown by both.")


def _modes(found: CommonModes) -> Table:
    hz, damping, seen = found.freq_hz_interval, found.damping_interval, found.used.sum(axis=1)
    rows = [
        (
            str(k + 1),
            _interval(hz[k]),
            _interval(damping[k]),
            f"{seen[k]} of {len(found.names)}",
            number(float(found.probability[k]), 4),
            "contradicted" if np.isnan(hz[k, 0]) and seen[k] else "" if seen[k] else "not used",
        )
        for k in range(len(seen))
    ]
    columns = [
        Column("Mode", "n"),
        Column("Frequency [Hz]", "whole"),
        Column("Damping", "whole"),
        Column("Setups", "whole"),
    ]
    columns += [Column("Probability,\nat least", "n"), Column("Finding", "text")]
    return Table(columns, rows, strong=[row[-1] == "contradicted" for row in rows], empty="No setup shows a mode.")


def _boxes(found: CommonModes) -> Table:
    rows = [
        (
            str(mode + 1),
            found.names[setup],
            _interval(found.omega_intervals[mode, setup] / HZ),
            _interval(found.damping_intervals[mode, setup]),
            number(float(found.level[mode, setup]), 3),
            "" if found.used[mode, setup] else "takes no part",
        )
        for mode, setup in np.argwhere(np.isfinite(found.omega_intervals[..., 0])).tolist()
    ]
    columns = [
        Column("Mode", "n"),
        Column("Setup", "text"),
        Column("Frequency [Hz]", "whole"),
        Column("Damping", "whole"),
    ]
    return Table([*columns, Column("Bounds times", "n"), Column("", "text")], rows, empty="No setup shows a mode.")


def _interval(ends: np.ndarray) -> str:
    return "–" if np.isnan(ends).any() else ends_words((float(ends[0]), float(ends[1])))


def _next(found: CommonModes) -> str:
    if found.odd is not None:
        return (
            f"Look at {found.odd}: the mass of a sensor or shaker lowers modes where it sits, a loosened joint lowers some."
            " Leave it out, or measure it again."
        )
    if found.disagreements:
        return "A third setup tells which of two changed; of several days, a condition that differs is a member of a family."
    count = int(np.sum(found.used.sum(axis=1) == 1))
    return (
        f"{count} mode{plural(count)} shown by one setup alone: its sensors and inputs are the ones to keep."
        if count
        else ("The intervals stand for this machine in all of its setups: state them as the modes of the class.")
    )
