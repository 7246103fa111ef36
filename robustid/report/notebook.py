"""Heads of pages for notebooks: the verdict and the numbers of the first screen, in any light, without computing anything new."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, Unpack

from robustid.data import FrequencyResponse, TimeRecord
from robustid.guarantees import WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification
from robustid.mfd import MatrixFraction
from robustid.report.document import Verdict
from robustid.report.first_screen import BETWEEN, BOUND, glance
from robustid.report.identification import identification_verdict, margin_interval
from robustid.report.identified import Parts
from robustid.report.write import verdict

_LINES = 18  # of a summary
_COLOURS = {"consistent": "0,158,115", "inconsistent": "213,94,0", "failed": "120,120,120"}
_OTHER = "230,159,0"


def head(result: Any) -> str | None:
    """Head of the page about a result as HTML; of what has no page, the first lines of its summary, or None.

    Text has the colour of the notebook, behind it a veil, so that it can be read in light and dark ones.
    """
    if isinstance(result, Identification):
        return _identified(result)
    if isinstance(result, WorstCaseError):
        return _identified(result.identification, worst_case=result)
    if isinstance(result, WorstCaseOverPoles):
        return _identified(result.identification, over_poles=result)
    identification = getattr(result, "identification", None)
    if isinstance(identification, Identification) and hasattr(result, "reduction"):
        return _identified(identification, reduction=result.reduction, worst_case=getattr(result, "error", None))
    if isinstance(result, (MatrixFraction, FrequencyResponse)):
        said = verdict(result)
        return _html(said, _size(result) if isinstance(result, FrequencyResponse) else said.numbers)
    if isinstance(result, TimeRecord):
        return _record(result)
    summary = getattr(result, "summary", None)
    return _text(type(result).__name__, str(summary())) if callable(summary) else None


def _identified(identification: Identification, **parts: Unpack[Parts]) -> str:
    shown = glance(identification, margin_interval(identification), parts)
    said = identification_verdict(identification, parts.get("reduction"))
    steps = [text.text.replace(BOUND, "rid.worst_case_error(result)") for text in shown.next]
    words = shown.words.removesuffix(BETWEEN)
    return _html(said, shown.numbers, [words] * bool(words), steps)


def _size(frf: FrequencyResponse) -> list[tuple[str, str]]:
    low, high = frf.freq_hz[[0, -1]]
    return [
        ("frequency points", f"{frf.omega.size}"),
        ("range", f"{low:.5g} to {high:.5g} Hz"),
        ("outputs × inputs", f"{len(frf.outputs)} × {len(frf.inputs)}"),
        ("sample time", "continuous" if frf.dt is None else f"{frf.dt:.6g} s"),
    ]


def _record(record: TimeRecord) -> str:
    names = ", ".join(map(str, record.inputs)), ", ".join(map(str, record.outputs))
    bound = "No bound on the errors." if record.bound is None else f"{record.bound.words(record.note)}."
    bound = bound[0].upper() + bound[1:]
    said = Verdict(
        "consistent" if record.bound is not None else "", "Time record", f"{names[0]} to {names[1]}. {bound}"
    )
    numbers = [
        ("samples", f"{len(record.u)}"),
        ("sample time", f"{record.dt:.6g} s"),
        ("outputs × inputs", f"{len(record.outputs)} × {len(record.inputs)}"),
        ("before the first sample", record.initial),
    ]
    return _html(said, numbers)


def _html(
    said: Verdict, numbers: Sequence[tuple[str, str]], words: Sequence[str] = (), steps: Sequence[str] = ()
) -> str:
    colour = _COLOURS.get(said.key, _OTHER)
    cells = "".join(
        '<div style="margin-right:1.6em"><div style="opacity:.8;font-size:.85em">'
        f'{escape(name)}</div><div style="font-size:1.15em">{escape(value)}</div></div>'
        for name, value in numbers
    )
    lines = "".join(f'<p style="margin:.4em 0 0">{escape(text)}</p>' for text in words)
    listed = "".join(f"<li>{escape(text)}</li>" for text in steps)
    return (
        f'<div style="max-width:60em;padding:.6em 1em;border-left:6px solid rgb({colour});background:rgba({colour},.12)">'
        f'<strong style="font-size:1.2em">{escape(said.word)}</strong><p style="margin:.2em 0 .5em">{escape(said.sentence)}</p>'
        f'<div style="display:flex;flex-wrap:wrap;gap:.4em 0">{cells}</div>{lines}'
        + (f'<ul style="margin:.5em 0 0;padding-left:1.2em">{listed}</ul>' if listed else "")
        + "</div>"
    )


def _text(name: str, summary: str) -> str:
    lines = summary.splitlines()
    more = f"\n… {len(lines) - _LINES} more lines: print(result.summary())" if len(lines) > _LINES else ""
    body = escape("\n".join(lines[:_LINES]) + more)
    return f'<div><strong>{escape(name)}</strong><pre style="white-space:pre-wrap;margin:.3em 0 0">{body}</pre></div>'
