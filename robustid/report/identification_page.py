"""An identification: the verdict, the consistency margin, its verification and parameters; its page and its summary."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Source, Unfinished, counted
from robustid.errors import Status
from robustid.guarantees import Band
from robustid.identification import Identification
from robustid.report import words
from robustid.report.assumptions import CAUTION, assumptions, assumptions_section, chosen, experiments, shared_words
from robustid.report.data_faults import problem_verdict, problem_warnings
from robustid.report.design_page import design_section
from robustid.report.document import (
    Block,
    Code,
    Column,
    Document,
    Facts,
    Heading,
    Table,
    Text,
    Verdict,
    checked_by_another,
    checks_table,
    unfinished_notice,
)
from robustid.report.first_screen import glance, proves_nothing
from robustid.report.frequency import frequency_section
from robustid.report.guarantee import guarantee_section
from robustid.report.identified import Parts, further_models, scope, siso, unit
from robustid.report.loop_section import loop_section, loop_verdict
from robustid.report.pole_box import pole_box_section
from robustid.report.poles import modes_table, poles_section, slowest_poles
from robustid.report.proved_band import proved_band_section
from robustid.report.residual_charts import active_section, active_table, residual_section
from robustid.report.sensitivity_section import content_section, content_verdict, sensitivity_section
from robustid.report.small_model import matrices_section, order_section, reduction_words, worth_section, worth_verdict
from robustid.report.stability import stability_section, weights_section
from robustid.report.time_response import time_section, tube_section
from robustid.report.withheld_data import not_guaranteed, withheld_section, withheld_verdict
from robustid.report.words import number

if TYPE_CHECKING:
    from robustid.reduction import Reduction

_MOST_EXPERIMENTS = 6  # at the terminal
_AGAIN = "robustid run FILE -o FOLDER"
_BLAME = "a bound is too small, or an assumption is wrong"
_NO_CLASS = {  # in whose place the program took the one that is refuted
    Source.PROGRAM: "the class does not fit. Of those that were tried none that says anything holds the data; this one was taken"
    " for reference",
    Source.STOPPED: "the class does not fit. The time was over before one was found that holds the data; this one was taken in its"
    " place",
}


def identification_head(identification: Identification, title: str | None, parts: Parts) -> Document:
    """Build the first screen of an identification, which is soon there, without its plot."""
    return _head(identification, title, parts, drawn=False)


def _head(identification: Identification, title: str | None, parts: Parts, *, drawn: bool) -> Document:
    problem, diagnosis = identification.problem, parts.get("diagnosis")
    advice = [] if diagnosis is None else diagnosis.next_steps
    return Document(
        title or words.title("Identification", problem.outputs, problem.inputs),
        head=[
            *_verdicts(identification, parts),
            *checked_by_another(parts.get("independent")),
            *_warnings(identification, parts.get("loop") is None),
        ],
        body=[],
        foot=_foot(identification),
        glance=glance(identification, margin_interval(identification), parts, advice, drawn=drawn),
        notice=_left_out(identification, parts),
    )


def _left_out(identification: Identification, parts: Parts) -> Text | None:
    """Words that come first where the run, the one that its file is of, or the sweep of frequencies ended before its end."""
    error = parts.get("worst_case")
    kept = [identification.choices, *([] if error is None else [error.identification.choices])]
    found = next(filter(None, [parts.get("unfinished"), *map(Unfinished.of, kept)]), None)
    if found is None and error is not None and error.missing.size:
        return Text(error.unfinished, "warning", "unfinished", head="Unfinished")
    return unfinished_notice(found)


def identification_page(identification: Identification, title: str | None, parts: Parts) -> Document:
    """Build the page of an identification, with what is guaranteed of it."""
    withheld, findings = parts.get("withheld"), parts.get("findings", ())
    reduction, diagnosis = parts.get("reduction"), parts.get("diagnosis")
    looped = loop_section(identification, parts.get("loop"), parts.get("plant"), parts.get("candidates"))
    design = [] if (designed := parts.get("design")) is None else design_section(designed)
    shown = further_models(reduction, parts.get("models"))
    nominal = f"nominal model, order {identification.order}", identification.model
    name, model = nominal if reduction is None else (f"reduced model, order {reduction.order}", reduction.model)
    own = [
        *withheld_section(withheld),
        Heading("Consistency margin"),
        Facts([("Proven interval", margin_interval(identification))]),
        Text(margin_words(identification)),
        *assumptions_section(identification),
        *content_section(parts.get("content")),
        *not_guaranteed(_guaranteed(identification, parts), withheld),
        *frequency_section(identification, shown),
        *time_section(identification, shown),
        *residual_section(identification, shown),
        *active_section(identification, refuted(identification)),
        *order_section(identification, reduction),
        *worth_section(parts.get("worth")),
        *poles_section(identification, shown),
        *matrices_section(name, model, identification.problem.dt),
        Heading("Verification"),
        Text("This package evaluated every claim again from the numbers, along other paths than it was found."),
        checks_table(identification.verification.checks),
        *_parameters_section(identification),
    ]
    body = [
        *findings_section(findings),
        *([Heading("What would help"), Code(diagnosis.summary())] if diagnosis is not None else []),
        *not_guaranteed([*design, *looped], withheld),
        *(map(_of_residual, own) if looped else own),
        *run_file_section(parts.get("run_file")),
    ]
    return dataclasses.replace(_head(identification, title, parts, drawn=True), body=body)


def _of_residual(block: Block) -> Block:
    """Say in the heading of a section that it is about R, the stable system that is identified of a plant in a loop."""
    if isinstance(block, Heading) and block.level == 2:
        return dataclasses.replace(block, text=f"R: {block.text[0].lower()}{block.text[1:]}")
    return block


def _guaranteed(identification: Identification, parts: Parts) -> list[Block]:
    """Sections of the guarantees; the polygons of a band, which may be those of another section, are verified once."""
    band, error, over_poles = parts.get("band"), parts.get("worst_case"), parts.get("over_poles")
    polygons = band.polygons if isinstance(band, Band) else None
    holds = polygons is None or polygons.verify()
    found = [] if band is None else proved_band_section(identification, band, error, holds)
    if error is not None:
        found += guarantee_section(identification, error, holds if error is polygons else None)
    if over_poles is not None:
        found += pole_box_section(identification, over_poles, error, holds if over_poles is polygons else None)
    if (stability := parts.get("stability")) is not None:
        found += stability_section(identification, stability)
    if (weights := parts.get("weights")) is not None:
        found += weights_section(identification, weights)
    if (tube := parts.get("tube")) is not None:
        found += tube_section(identification, tube)
    if (sensitivity := parts.get("sensitivity")) is not None:
        found += sensitivity_section(identification, sensitivity)
    return found


def _verdicts(identification: Identification, parts: Parts) -> list[Verdict]:
    """The verdict on the class, after those that deprive it of its worth: a fault of the data, contradicted by withheld data,
    nothing between points.

    The others follow.
    """
    withheld, content, worth = parts.get("withheld"), parts.get("content"), parts.get("worth")
    own = identification_verdict(identification, parts.get("reduction"), nothing=proves_nothing(parts))
    others = [withheld_verdict(withheld)] if withheld is not None else []
    said = [content_verdict(content)] if content is not None and content.on.size else []
    model = [worth_verdict(worth)] if worth is not None else []
    first = problem_verdict(identification.problem)
    first = first + others if withheld is not None and withheld.contradicted else first
    first = first + said if content is not None and content.empty else first
    if (looped := parts.get("loop")) is not None:
        first = [*first, loop_verdict(looped)]
    return [*first, own, *(verdict for verdict in others + said + model if verdict not in first)]


def identification_summary(
    identification: Identification, reduction: Reduction | None = None, unfinished: Unfinished | None = None
) -> list[Block]:
    """Build the summary at the terminal."""
    notice = unfinished_notice(unfinished or Unfinished.of(identification.choices))
    active = active_table(identification, refuted(identification))
    modes = modes_table(identification)
    return [
        *([] if notice is None else [notice]),
        *problem_verdict(identification.problem),
        identification_verdict(identification),
        *_warnings(identification),
        Facts(_overview(identification, reduction)),
        *chosen(identification),
        checks_table(identification.verification.checks),
        *[active] * bool(active.rows),
        *[modes] * bool(modes.rows),
        slowest_poles(identification, reduction),
        Text(CAUTION, "caution"),
    ]


def _overview(identification: Identification, reduction: Reduction | None) -> list[tuple[str, str]]:
    rows = [("Consistency margin", margin_interval(identification)), ("", margin_words(identification))]
    measured = experiments(identification)
    rows += [
        (row.name, f"{row.of}: {counted(row.samples, 'sample')}, {row.span}, {row.bound} (source: {row.source})")
        for row in measured[:_MOST_EXPERIMENTS]
    ]
    if (more := len(measured) - _MOST_EXPERIMENTS) > 0:
        rows.append(("", f"and {more} more; the HTML report lists all"))
    if shared := shared_words(identification):
        rows.append(("Bounds", shared))
    rows += assumptions(identification)[:-1]  # the bounds stand with their experiments
    rows.append(("Model", f"order {identification.order}, {_time_base(identification, 'dt =')}"))
    if reduction is not None:
        rows.append(("Reduced model", reduction_words(identification, reduction)))
    return rows


def _warnings(identification: Identification, alone: bool = True) -> list[Text]:
    """Warnings of the data and of the class, which may say little of the R of a loop: it does not stand `alone`."""
    problem = identification.problem
    about = [Text(sentence, "warning") for sentence in problem.about]
    about += problem_warnings(problem)
    own = identification.warnings if alone else ()
    return about + [Text(f"{sentence}.", "warning", head="Warning") for sentence in own]


def identification_verdict(
    identification: Identification, reduction: Reduction | None = None, *, nothing: bool = False
) -> Verdict:
    """The verdict in plain words; a model that failed its verification is never called consistent.

    `nothing` says that a proof of its error was tried, and that there is none at any frequency.
    """
    order = f"{identification.order}" + (f" → {reduction.order}" if reduction is not None else "")
    key, word, sentence = _said(identification)
    if nothing and key == "consistent":
        key, word = "weak", f"{word}, but no error is proved"
    return Verdict(key, word, sentence, (("margin", margin_interval(identification)), ("order", order)))


def refuted(identification: Identification) -> bool:
    """Return whether the verdict is that the data contradict the assumptions."""
    return _said(identification)[0] == "inconsistent"


def _said(identification: Identification) -> tuple[str, str, str]:
    """Key, word and sentence of the verdict."""
    count, status, of = identification.problem.samples, identification.status, scope(identification)
    prior = identification.choices.get("prior")
    blame = _NO_CLASS[prior.source] if prior is not None and prior.in_place else _BLAME
    sentences = {
        Status.CONSISTENT: f"A system of the assumed class keeps all {counted(count, 'sample')} within their bounds.",
        Status.INCONSISTENT: f"It is proved that no system of the assumed class keeps all {counted(count, 'sample')} within"
        f" their bounds: {blame}.",
        Status.UNDECIDED: "The proven interval of the margin contains 1: "
        + ("more time narrows it." if identification.claim.stopped else "ask for a smaller `accuracy`."),
        Status.FAILED: "No solver returned numbers that could be verified to the accuracy asked.",
    }
    if status is not Status.FAILED and not identification.verification.passed:
        return "failed", "Not verified", _unverified(identification, sentences[status])
    if status is Status.CONSISTENT and identification.warnings:
        return "weak", f"Consistent{of}, but the class says little", sentences[status]
    if status is Status.CONSISTENT:
        key = "weak" if identification.problem.open_faults else "consistent"
        return key, f"Consistent{of}", sentences[status]
    return status.name.lower(), status.name.capitalize(), sentences[status]


def _unverified(identification: Identification, found: str) -> str:
    """Say what of `found` was verified and what was not, and what that means to whoever wanted it."""
    found, verification = found.rstrip("."), identification.verification
    misses = "; ".join(
        f"{check.name}, {number(check.measured, 3)} where {number(check.limit, 6)} is the limit"
        for check in verification.failed
    )
    if verification.answered:
        return (
            f"Verified from the numbers: {found[0].lower()}{found[1:]}. Not verified: the model that is written with this answer"
            f" ({misses}). What is said of the data stands; the model is no better than these numbers, and no band was computed"
            " around it. Another `form` or `solver` writes it in another way."
        )
    return (
        f"The solver's answer was “{identification.status.name.lower()}”, but its numbers don't prove it ({misses}):"
        " neither that the data fit the class nor that they contradict it. Another `solver` or `form`, or a larger"
        " `accuracy`, asks the question again."
    )


def margin_interval(identification: Identification) -> str:
    """The proven interval of the margin."""
    lower, upper = identification.margin_lower, identification.margin
    if not 1e-3 < upper < 1e6:
        first, last = number(lower, 2), number(upper, 2)
    else:  # as many decimals in both
        decimals = 5 - int(np.floor(np.log10(upper)))
        first, last = (f"{value:.{decimals}f}" if value > 0 else "0" for value in (lower, upper))
    return last if first == last else f"{first} … {last}"


def margin_words(identification: Identification) -> str:
    """Meaning of the margin here."""
    upper = identification.margin
    meaning = (
        "The consistency margin is the smallest factor on all bounds at which a system of the class still keeps every sample."
        " Its upper end is reached by a system, its lower end is proved by a certificate; both were recomputed"
        " from the numbers."
    )
    if not identification.formulation.exact:
        meaning += (
            f" They were found in a finite form of G, {identification.form}; what it leaves out moves no sample by more"
            f" than {number(identification.tail, 2)} of its bound, and both ends allow for that."
        )
    if identification.status is Status.INCONSISTENT:
        return f"{meaning} Here every bound would have to be {number(upper)} times as large."
    if identification.status is not Status.CONSISTENT:
        return meaning
    if upper < 1e-3:
        return f"{meaning} Here it is practically 0: the class could follow these samples exactly."
    return f"{meaning} Here every bound could shrink to {number(100 * upper, 3)} % of its size."


def _parameters_section(identification: Identification) -> list[Block]:
    """Coefficients of the parametric part; none where there is no such part."""
    problem = identification.problem
    if problem.parametric is None:
        return []
    labels = [function.name for function in problem.parametric.functions]
    values, what = identification.parameters, unit(identification)
    if siso(identification):
        columns = [Column("Function", "text"), Column(f"Coefficient [{what}]" if what else "Coefficient", "n")]
        rows = [(label, number(float(value), 6)) for label, value in zip(labels, values, strict=True)]
    else:
        columns = [
            *(Column("Coefficient matrix of"), Column("to", "text")),
            *(Column(f"from {signal}", "n") for signal in problem.inputs),
        ]
        rows = [
            (label if i == 0 else "", str(output), *(number(float(value), 6) for value in row))
            for label, matrix in zip(labels, values, strict=True)
            for i, (output, row) in enumerate(zip(problem.outputs, matrix, strict=True))
        ]
    return [Heading("Parameters"), Table(columns, rows)]


def _time_base(identification: Identification, name: str) -> str:
    dt = identification.problem.dt
    return f"{name} {number(dt, 6)} s" if dt else "continuous time"


def _foot(identification: Identification) -> list[Text]:
    timing = ", ".join(f"{stage} {number(seconds, 2)} s" for stage, seconds in identification.timing.items())
    return [
        Text(
            f"Objective “{identification.objective}”, solver “{identification.solver}”, accuracy of the margin"
            f" {number(identification.accuracy, 2)}, {_time_base(identification, 'sample time')}."
        ),
        Text(f"Time: {timing}."),
    ]


def findings_section(findings: Sequence[str]) -> list[Block]:
    """Build the section of the findings."""
    return [Heading("What was found"), *map(Text, findings)] if findings else []


def run_file_section(run_file: str | None) -> list[Block]:
    """Build the section of the run file."""
    if run_file is None:
        return []
    words = (
        "Every choice of this result stands in the run file below, those of the program with their reason (note). Saved as a"
        f" file, {_AGAIN} makes the same again; names of data in it are seen from the folder of the results. Any line can be"
        " changed."
    )
    return [Heading("How this was made"), Text(words, code=("note", _AGAIN)), Code(run_file, id="run-file")]
