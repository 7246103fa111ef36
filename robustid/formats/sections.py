"""Files of text that hold more than one table, or a head of known length: the lines of the one with the response."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from robustid.errors import FileFormatError

Row = tuple[int, str]  # number and text of a line


class _Section(NamedTuple):
    """Marks of a table: the first line of its files, the line before it, and the line behind it."""

    first_line: re.Pattern[str]
    begin: re.Pattern[str]
    end: re.Pattern[str]
    missing: str


_SECTIONS = (
    # Gamry Framework: tables of curves, each line of which begins with a tab; the others are of time.
    _Section(
        re.compile(r"EXPLAIN\b"), re.compile(r"ZCURVE\b"), re.compile(r"\S"), "table ZCURVE, which holds the impedance"
    ),
    # VersaStudio: the line of names begins with "Definition=".
    _Section(re.compile(r"<Application>"), re.compile(r"<Segment\d+>"), re.compile(r"</Segment"), "section <Segment1>"),
    # Network analysers by Keysight and others.
    _Section(re.compile(r"!\s*CSV\b"), re.compile(r"BEGIN\b"), re.compile(r"END\b"), "line BEGIN"),
)
_EC_LAB = re.compile(r"(EC|BT)-Lab ASCII FILE")
_HEAD_LINES = re.compile(r"Nb header lines\s*:\s*(\d{1,6})")
_DEFINITION = re.compile(r"^Definition=|(?<=\S),\s*0\s*$")


def section_of(name: str, rows: Iterator[Row]) -> Iterator[Row]:
    """The lines of the table of a file; all where its first line is none of those that are known."""
    first = next(rows, None)
    if first is None:
        return
    for section in _SECTIONS:
        if section.first_line.match(first[1]):
            yield from _between(name, rows, section)
            return
    if _EC_LAB.match(first[1]):
        yield from _below_head(rows)
        return
    yield first
    yield from rows


def _below_head(rows: Iterator[Row]) -> Iterator[Row]:
    """The lines from the names on: the last line of a head that says how long it is."""
    names = 0
    for k, line in rows:
        if not names and (match := _HEAD_LINES.match(line)):
            names = int(match[1])
        elif k >= names > 0:
            yield k, line


def _between(name: str, rows: Iterator[Row], section: _Section) -> Iterator[Row]:
    """The lines of the first table, and an error where another one follows: nothing says which is meant."""
    begun = ended = 0
    for k, line in rows:
        if section.begin.match(line):
            if ended:
                raise FileFormatError(
                    f"{name} holds several tables, from lines {begun} and {k} on: make files of one table each"
                )
            begun = k
        elif begun and not ended:
            if section.end.match(line):
                ended = k
                continue
            line = line.lstrip("\t")
            yield k, _DEFINITION.sub("", line) if line.startswith("Definition=") else _without_signs(line)
    if not begun:
        raise FileFormatError(f"{name} has no {section.missing}; export the file again")


def _without_signs(line: str) -> str:
    """A line of units may begin with "#", of a number that counts; it is no remark."""
    return f"-{line[1:]}" if line.startswith("#\t") else line
