"""Columns of numbers from text files, block by block; of files with several tables, the one with the response."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from robustid.errors import FileFormatError, Remedy
from robustid.formats.clock_times import Row, in_seconds, tells_clock_times
from robustid.formats.role_names import NAMES, axis_role, is_usual
from robustid.formats.table import Table
from robustid.formats.text_layout import (
    Layout,
    addressed,
    cells_of,
    is_comment,
    layout_of,
    numbered,
    whole_row,
    with_point,
)

Column = np.ndarray | FileFormatError  # the error is raised where somebody asks for the column

_MARK = "# robustid "
_LONGEST = 2**24  # characters in a line: the header of a covariance of a 10 x 10 response has 2e6
_BLOCK = 20_000  # lines
_BLOCK_TEXT = 2**22  # characters
_HEAD, _HEAD_TEXT = 500, 2**18  # lines and characters from which the layout is taken
_FEWEST = 3  # lines, however long
_REMARKS = 200  # lines of remarks of which the last may hold the names
_STEPS = ("dt", "Ts", *NAMES["rate"])  # columns that can say one number
_MOST_SHOWN, _LONGEST_SHOWN = 3, 100  # names, and characters of one
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")


def read_text(path: Path, decimal: str | None = None) -> Table:
    """Columns of a text file by their names, else by their addresses; `decimal` is the mark where the numbers don't say."""
    try:
        with path.open(encoding=(encoding := _encoding(path))) as file:
            meta = file.readline(_LONGEST)
            file.seek(0)
            rows = section_of(path.name, _rows(path, file))
            head = next(_blocks(rows, _HEAD, _HEAD_TEXT), list[tuple[int, str]]())
            clock = any(tells_clock_times(line) for _, line in head[-_FEWEST:] if not is_comment(line))
            if clock:
                rows = in_seconds(itertools.chain(head, rows))
                head = [*itertools.islice(rows, len(head))]
            layout = layout_of(path.name, head, decimal)
            body = (row for row in itertools.chain(head, rows) if row[0] >= layout.first)
            footer: list[int] = []
            columns = _columns(path, _without_footer(path, body, layout, footer), layout)
            columns, words = _once(columns, layout)
    except UnicodeDecodeError:
        raise FileFormatError(f"{path.name} isn't UTF-8 text; export it as comma-separated text (UTF-8)") from None
    how = layout.words + words
    how += f", {_lines(footer)} at the end without numbers left out" if footer else ""
    how += ", times of day as seconds" if clock else ""
    how += "" if encoding.startswith("utf-8") else f", {encoding}"
    description = meta[len(_MARK) :] if meta.startswith(_MARK) else None
    columns |= {name: step for name in _STEPS if (step := _one_number(columns.get(name))) is not None}
    return Table(path, columns, description, how=how, text=True)


def _once(columns: dict[str, Column], layout: Layout) -> tuple[dict[str, Column], str]:
    """Columns without those that repeat a title and its values, and words about titles that are repeated.

    By their addresses, where a title that several columns keep is one of an axis or of a role: it would be one of them silently.
    """
    left = dict(columns)
    kept = list[str]()
    for title in layout.repeated:
        same = itertools.takewhile(columns.__contains__, (numbered(title, k) for k in itertools.count(2)))
        for name in same:
            first, other = columns[title], columns[name]
            if (
                isinstance(first, np.ndarray)
                and isinstance(other, np.ndarray)
                and np.array_equal(first, other, equal_nan=True)
            ):
                del left[name]
            elif title not in kept:
                kept.append(title)
    if any(axis_role(title) or any(is_usual(role, title) for role in NAMES) for title in kept):
        shown = ", ".join(title[:_LONGEST_SHOWN] for title in sorted(kept)[:_MOST_SHOWN])
        found = dict(zip(addressed(len(columns)), columns.values(), strict=True))
        return found, f"; names that are not all different ({shown}), so not used"
    again = len(columns) - len(left)
    once = (
        ""
        if not again
        else ", one that repeats another left out"
        if again == 1
        else f", {again} that repeat others left out"
    )
    return left, once + ", those of the same name numbered" * bool(kept)


def _one_number(column: Column | None) -> np.ndarray | None:
    """One number that a column repeats, or that stands in its first row alone; None where there is none."""
    if not isinstance(column, np.ndarray) or column.dtype.kind not in "fi":
        return None
    known = np.unique(column[np.isfinite(column)])
    return known if known.size == 1 else None


def _encoding(path: Path) -> str:
    """UTF-8; UTF-16 where the file says so; Latin-1 where it can't be UTF-8 and has no bytes that no text has."""
    with path.open("rb") as file:
        start = file.read(_LONGEST)
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # Cut within a character at the end of what was read, it is UTF-8 nonetheless.
        if error.start < _LONGEST - 4 and not _BINARY.search(start):
            return "latin-1"
    return "utf-8-sig"


def _rows(path: Path, file: IO[str]) -> Iterator[tuple[int, str]]:
    """Number and text of every line that isn't empty; remarks above the numbers too."""
    remarks = 0
    for k in itertools.count(1):
        if not (line := file.readline(_LONGEST)):
            return
        if len(line) == _LONGEST:
            raise FileFormatError(
                f"{path.name}, line {k} is longer than {_LONGEST} characters; is it a table of numbers?"
            )
        if is_comment(line):
            remarks += 1
        if line.strip() and (remarks < _REMARKS or not is_comment(line)):
            yield k, line


def _without_footer(
    path: Path, rows: Iterator[tuple[int, str]], layout: Layout, footer: list[int]
) -> Iterator[tuple[int, str]]:
    """The lines but for those at the end that have no number, whose own numbers go to `footer`."""
    for k, line in rows:
        if line.lstrip()[:1].isalpha() and not any(
            _is_number(cell, layout.decimal) for cell in cells_of(line, layout.separator)
        ):
            footer.append(k)
            continue
        if footer:
            raise FileFormatError(
                f"{path.name}, line {footer[0]} has no number, and more numbers follow it; make files of one table each"
            )
        yield k, line


def _is_number(cell: str, decimal: str) -> bool:
    try:
        complex(with_point(cell, decimal))
    except ValueError:
        return False
    return True


def _lines(numbers: list[int]) -> str:
    return f"line {numbers[0]}" if len(numbers) == 1 else f"lines {numbers[0]} to {numbers[-1]}"


def _blocks(rows: Iterator[tuple[int, str]], lines: int, text: int) -> Iterator[list[tuple[int, str]]]:
    """So many lines at a time; fewer, though 3, where they are long."""
    block: list[tuple[int, str]] = []
    size = 0
    for row in rows:
        block.append(row)
        size += len(row[1])
        if len(block) == lines or (size > text and len(block) >= _FEWEST):
            yield block
            block, size = [], 0
    if block:
        yield block


def _columns(path: Path, rows: Iterator[tuple[int, str]], layout: Layout) -> dict[str, np.ndarray | FileFormatError]:
    numbers = (row for row in rows if not is_comment(row[1]))
    parts: list[list[Column]] = [[] for _ in layout.names]
    for block in _blocks(numbers, _BLOCK, _BLOCK_TEXT):
        for part, values in zip(parts, _parsed(path, block, layout), strict=True):
            part.append(values)
    return {name: _joined(part) for name, part in zip(layout.names, parts, strict=True)}


def _joined(parts: list[Column]) -> np.ndarray | FileFormatError:
    wrong = next((part for part in parts if isinstance(part, FileFormatError)), None)
    return np.concatenate(parts) if wrong is None else wrong  # type: ignore[arg-type]


def _parsed(path: Path, block: list[tuple[int, str]], layout: Layout) -> list[Column]:
    """The columns of one block of lines."""
    count = len(layout.names)
    try:
        lines = [line for _, line in block]
        if layout.decimal == ",":
            lines = [line.replace(".", "'").replace(",", ".") for line in lines]
        numbers = np.loadtxt(lines, delimiter=layout.separator, comments=None, ndmin=2)
        if numbers.shape == (len(block), count):
            return list(numbers.T)
    except ValueError:
        pass  # something else than real numbers: cell by cell
    cells = [whole_row(line, layout.separator, count) for _, line in block]
    for (k, _), row in zip(block, cells, strict=True):
        if len(row) != count:
            raise FileFormatError(
                f"{path.name}, line {k}: {len(row)} cells where the lines above have {count}; is the file cut off?"
                " Remove the line if it is no line of numbers"
            )
    lines = [k for k, _ in block]
    return [
        _column(path, name, column, lines, layout)
        for name, column in zip(layout.names, zip(*cells, strict=True), strict=True)
    ]


def _column(
    path: Path, name: str, cells: tuple[str, ...], lines: list[int], layout: Layout
) -> np.ndarray | FileFormatError:
    cells = tuple(cell if cell else "nan" for cell in cells)  # an empty cell: not measured
    try:
        return np.array([float(with_point(cell, layout.decimal)) for cell in cells])
    except ValueError:
        pass
    values: list[complex] = []
    for cell, line in zip(cells, lines, strict=True):
        try:
            values.append(complex(with_point(cell, layout.decimal)))
        except ValueError:
            comma = layout.decimal != "," and "," in cell
            return FileFormatError(
                f"{path.name}, line {line}, column {name!r}: {cell[:40]!r} is not a number; numbers are"
                " written 0.5 (with a point) or 1+2j",
                *(["; if commas are decimal marks, give ", Remedy({"decimal": ","})] if comma else []),
                place=path.name,
            )
    return np.array(values)


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
