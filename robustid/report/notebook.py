"""Heads of results in notebooks: the first screen without its plot, or the first lines of a summary."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

from robustid.core import Unfinished, hz_span
from robustid.data import FrequencyResponse, TimeRecord
from robustid.fitting import MatrixFraction
from robustid.guarantees import WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification
from robustid.report import html
from robustid.report.data_faults import problem_verdict
from robustid.report.document import Code, Document, Glance, Text, Verdict, unfinished_notice
from robustid.report.first_screen import glance
from robustid.report.identification_page import identification_verdict, margin_interval
from robustid.report.pages import verdict
from robustid.report.response_charts import ResponseView
from robustid.report.response_page import response_fault_verdict

if TYPE_CHECKING:
    from robustid.report.identified import Parts

_LINES = 18  # of a summary


def notebook_head(result: object) -> str | None:
    """Head of the page about a result as HTML; of what has no page, the first lines of its summary, or None."""
    document = _head(result)
    return None if document is None else html.render_head(document)


def _head(result: object) -> Document | None:
    if isinstance(result, Identification):
        return _identified(result)
    if isinstance(result, WorstCaseError):
        return _identified(result.identification, worst_case=result)
    if isinstance(result, WorstCaseOverPoles):
        return _identified(result.identification, over_poles=result)
    if callable(own := getattr(result, "first_screen", None)) and isinstance(found := own(), Document):  # of any run
        return found
    if isinstance(result, MatrixFraction):
        said = verdict(result)
        found = _first_screen(said, Glance(said.numbers))
        return dataclasses.replace(found, notice=unfinished_notice(result.unfinished))
    if isinstance(result, FrequencyResponse):
        low, high = result.freq_hz[[0, -1]]
        size = ("frequency points", f"{result.omega.size}"), ("range", hz_span(low, high))
        before = response_fault_verdict(ResponseView(result))
        return _first_screen(verdict(result), Glance([*size, _signals(result), _sample_time(result.dt)]), before)
    if isinstance(result, TimeRecord):
        return _record(result)
    summary = getattr(result, "summary", None)
    return _listed(type(result).__name__, str(summary())) if callable(summary) else None


def _first_screen(said: Verdict, glance: Glance, before: Sequence[Verdict] = ()) -> Document:
    return Document("", head=[*before, said], body=[], glance=glance)


def _identified(identification: Identification, **parts: Unpack[Parts]) -> Document:
    margin = margin_interval(identification)
    shown = glance(identification, margin, parts, drawn=False, bounding="rid.worst_case_error(result)")
    steps = [Text(step.text) for step in shown.next]
    said = identification_verdict(identification, parts.get("reduction"))
    found = _first_screen(said, Glance(shown.numbers, shown.words, next=steps), problem_verdict(identification.problem))
    left_out = parts.get("unfinished") or Unfinished.of(identification.choices)
    return dataclasses.replace(found, notice=unfinished_notice(left_out))


def _signals(data: FrequencyResponse | TimeRecord) -> tuple[str, str]:
    return "outputs × inputs", f"{len(data.outputs)} × {len(data.inputs)}"


def _sample_time(dt: float | None) -> tuple[str, str]:
    return "sample time", "continuous" if dt is None else f"{dt:.6g} s"


def _record(record: TimeRecord) -> Document:
    inputs, outputs = (", ".join(map(str, group)) for group in (record.inputs, record.outputs))
    bound = "No bound on the errors." if record.bound is None else f"{record.bound.words(record.note)}."
    sentence = f"{inputs} to {outputs}. {bound[0].upper()}{bound[1:]}"
    said = Verdict("consistent" if record.bound is not None else "", "Time record", sentence)
    numbers = [("samples", f"{len(record.u)}"), _sample_time(record.dt), _signals(record)]
    return _first_screen(said, Glance([*numbers, ("before the first sample", record.initial)]))


def _listed(name: str, summary: str) -> Document:
    lines = summary.splitlines()
    more = f"\n… {len(lines) - _LINES} more lines: print(result.summary())" if len(lines) > _LINES else ""
    return Document(name, head=[], body=[Code("\n".join(lines[:_LINES]) + more)])
