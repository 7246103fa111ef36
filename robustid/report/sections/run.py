"""A run: its findings, and the run file that makes the same again."""

from __future__ import annotations

from collections.abc import Sequence

from robustid.report.document import Block, Code, Heading, Text

_AGAIN = "robustid run FILE -o FOLDER"


def findings_section(findings: Sequence[str]) -> list[Block]:
    """Build the section of the findings; those with line breaks keep them."""
    if not findings:
        return []
    return [Heading("What was found"), *(Code(words) if "\n" in words else Text(words) for words in findings)]


def diagnosis_section(diagnosis: str | None) -> list[Block]:
    """Build the section of what would make the data consistent."""
    return [Heading("What would help"), Code(diagnosis)] if diagnosis else []


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
