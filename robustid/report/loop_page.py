"""A controller with every consistent plant: its page, its verdict first, and those of other controllers beside it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from robustid.core import counted
from robustid.guarantees import LoopBounds, LoopStatus
from robustid.report.charts import first_panel
from robustid.report.data_faults import shown_faults
from robustid.report.document import (
    Block,
    Document,
    Drawing,
    Facts,
    Glance,
    Heading,
    Text,
    Verdict,
    checked_by_another,
    proved,
)
from robustid.report.identified import Parts
from robustid.report.loci import open_loop_chart
from robustid.report.loop_section import (
    candidates_section,
    loop_chart,
    loop_numbers,
    loop_rows,
    loop_verdict,
    peaks_table,
    refuting_plant,
)
from robustid.report.proved_band import poles_words
from robustid.report.words import HZ, in_hz, number
from robustid.report.words import title as heading

NOT_IN_LOOP = "plants outside the class, limits of the actuator, a delay of the computer that the file does not have"


def loop_page(bounds: LoopBounds, title: str | None, parts: Parts) -> Document:
    """Build the page of a controller with every consistent plant."""
    problem, candidates = bounds.band.problem, parts.get("candidates")
    drawn = loop_chart(bounds)
    nyquist = open_loop_chart(bounds)
    body: list[Block] = [
        *candidates_section(candidates, level=2),
        Heading("The loop with every consistent plant", guarantee=True),
        peaks_table(bounds),
        Facts(loop_rows(bounds)),
        Drawing(drawn),
        *([] if nyquist is None else [Heading("Open loop", 3), Drawing(nyquist)]),
        *refuting_plant(bounds),
        Heading("What it stands on"),
        Text(loop_stands_on(bounds)),
        proved(
            bounds.band.certified,
            "The sums of the band were evaluated again for this page, without a solver.",
            "The proofs do not give what is stated.",
            "band-certificates",
        ),
    ]
    return Document(
        title or heading("Loop", problem.outputs, problem.inputs),
        head=[
            *shown_faults([problem]),
            loop_verdict(bounds),
            *_others(bounds, candidates),
            *checked_by_another(parts.get("independent")),
        ],
        body=body,
        glance=Glance(
            numbers=[*loop_numbers(bounds), *_margin(bounds)],
            words=_words(bounds),
            chart=first_panel(drawn if nyquist is None else nyquist),
            next=[Text(one) for one in _next(bounds)],
            not_covered=NOT_IN_LOOP if bounds.status is LoopStatus.STABLE else "",
        ),
    )


def _others(bounds: LoopBounds, candidates: Mapping[str, LoopBounds] | None) -> list[Verdict]:
    """Verdicts on the other controllers, each with its name."""
    found = {name: loop_verdict(one) for name, one in (candidates or {}).items() if one is not bounds}
    return [
        dataclasses.replace(one, word=f"Controller {name}: {one.word.lower()}", id=f"loop-verdict-{k}")
        for k, (name, one) in enumerate(found.items(), start=1)
    ]


def _margin(bounds: LoopBounds) -> list[tuple[str, str]]:
    if bounds.stability is None or bounds.stability.status.name == "UNSTABLE":
        return []
    size = bounds.stability.margin
    return [("robust stability margin", f"{number(size, 3)} at {in_hz(bounds.stability.frequency / HZ, 4)}")]


def _words(bounds: LoopBounds) -> str:
    """The result in words, with what it is about."""
    about = bounds.band.problem.scope
    if bounds.status is LoopStatus.STABLE and not bounds.unbounded:
        return f"Every plant that agrees with the data and the assumptions keeps these margins, proved at every frequency{about}."
    if bounds.refuted_by is not None:
        return "The data allow a plant that is not stabilised, so that nothing is promised of this controller."
    return f"{bounds.unbounded[:1].upper()}{bounds.unbounded[1:]}{about}." if bounds.unbounded else ""


def _next(bounds: LoopBounds) -> list[str]:
    if bounds.status is LoopStatus.STABLE and not bounds.unbounded:
        return [
            "Before it runs: limits of the actuator are in none of these margins, a delay of the computer only if the file has it."
        ]
    if bounds.band.open_ranges:
        return [f"Measure frequency points from {bounds.band.open_words}: nothing is proved there."]
    if bounds.stability is None or bounds.refuted_by is None or not bounds.stability.margin:
        steps = [
            "Try a controller nearer to the one that ran: smaller changes of gain and phase where the loop gain is near 1."
        ]
    else:
        steps = ["Keep the loop gain away from -1 where the discs of the open loop hold it, or measure better there."]
    if bounds.stability is not None and bounds.stability.margin:
        hz = number(bounds.stability.frequency / HZ, 4)
        steps.append(f"A narrower band near {hz} Hz helps first: further frequency points or a smaller bound there.")
    return steps


def loop_stands_on(bounds: LoopBounds) -> str:
    """The measurement that it is about."""
    band = bounds.band
    low, high = (number(float(end) / HZ, 4) for end in (band.omega.min(), band.omega.max()))
    who = "the plant, measured in open loop" if bounds.in_open_loop else "the stable system R of the loop that ran"
    law = "" if bounds.in_open_loop else f", u = {bounds.loop.law}"
    poles = f", {poles_words(band)}" if band.problem.parametric is not None else ""
    count = int(np.sum(band.bounded))
    between = f", nothing is from {band.open_words}" if band.open_ranges else ", and all between and beyond them"
    return (
        f"A band of {who}{law}: {counted(band.problem.samples, 'sample')}; {count} of"
        f" {counted(band.omega.size, 'frequency')} of its table from {low} to"
        f" {high} Hz are bounded{between}{poles}."
    )
