"""Layout of a table of text: separator, decimal mark, lines of names and of units, the first line of numbers."""

from __future__ import annotations

import cmath
import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from robustid.errors import FileFormatError, Remedy
from robustid.formats import units
from robustid.formats.headings import BY_ENDING
from robustid.formats.role_names import axis_role

COMMENTS = ("#", "%", "!", "//", "*")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_REAL = re.compile(rf"{_NUMBER}|[-+]?(?:nan|inf|infinity)", re.IGNORECASE)
_NOT_FINITE = ("nan", "inf", "infinity")
_LONGEST_NUMBER = 100  # characters
_LONGEST_NAME = 200
_MOST_CELLS = 2000  # of a line are looked at
_COMPLEX = re.compile(rf"\(?(?=.*\d)(?:{_NUMBER})?(?:[-+]|{_NUMBER})?j\)?")
# Two parts in one cell, as LTspice writes them; each with its point, since a comma alone may be a decimal mark.
_PART = r"([-+]?\d+\.\d*(?:[eE][-+]?\d+)?)"
_PARTS = re.compile(rf"\(?{_PART}(dB)?,\s*{_PART}(°)?\)?")
_MOST_DB = 6000  # more is no finite number
_THOUSANDS = re.compile(r"(?<![\d.,])\d{1,3}(?:\.\d{3})+,\d+")
_SIGN = re.compile(r"\s*([-+])\s*")
_LETTERS = str.maketrans("dDiIJ", "eejjj")
_SEPARATORS = ("\t", ";", ",", "|", None)  # None: white space
_WORDS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", None: "spaces"}
_MOST_NAMED, _MOST_ABOVE = 3, 8
_NO_NAMES = "no names"
_REMARKS = ("comment", "comments", "remark", "remarks")  # titles of a column that may be empty
_RULE = re.compile(r"[\s\-=_+|,;]*")  # a line of strokes
_END = re.compile(r"\W*end\W*(of\W*)?(comments?|header|head)\b", re.IGNORECASE)


class Layout(NamedTuple):
    """Layout of a table of text; lines count from 1."""

    separator: str | None  # None: white space
    decimal: str
    names: tuple[str, ...]  # of the columns, with units in brackets; addresses where the file has none
    first: int  # line of numbers
    words: str  # one line that says all this
    repeated: tuple[str, ...] = ()  # titles that several columns have; behind the first they are numbered


class _Reading(NamedTuple):
    """The head of a file, cut by one separator with one decimal mark.

    Its places are compared: more numbers than texts, lines that are numbers, part of the cells that are, names above, several
    columns, decimal point.
    """

    mostly: bool
    lines: int
    numbers: float
    named: bool
    several: bool
    point: bool
    separator: str | None
    width: int
    start: int  # place of the first line of numbers among the lines

    @property
    def decimal(self) -> str:
        return "." if self.point else ","


def cells_of(line: str, separator: str | None) -> list[str]:
    """The cells of a line, without the white space around them; a separator behind the last cell makes no cell."""
    if separator is None:
        return line.split()
    try:
        row = [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):  # a cell of more than 128 kB
        row = [cell.strip() for cell in line.split(separator)]
    return row[:-1] if len(row) > 1 and not row[-1] else row


def whole_row(line: str, separator: str | None, width: int) -> list[str]:
    """The cells of a line that has `width`, if need be an empty one behind the last separator."""
    row = cells_of(line, separator)
    if len(row) == width - 1 and separator is not None and line.rstrip(" \r\n").endswith(separator):
        row.append("")
    return row


def is_comment(line: str) -> bool:
    """Return whether a line is a remark."""
    return line.lstrip().startswith(COMMENTS)


def with_point(cell: str, decimal: str) -> str:
    """A number as Python writes it: decimal point, exponent with e, imaginary unit j, no spaces beside signs."""
    if len(cell) > _LONGEST_NUMBER or cell.lower().lstrip("+-") in _NOT_FINITE:
        return cell
    if "," in cell and decimal == "." and (pair := _PARTS.fullmatch(cell)):
        return _of_parts(*pair.groups())
    if decimal == ",":
        cell = cell.replace(".", "'").replace(",", ".")  # a point that is no decimal mark makes it no number
    return _SIGN.sub(r"\1", cell).translate(_LETTERS)


def _of_parts(first: str, db: str | None, second: str, degrees: str | None) -> str:
    """A complex number of real and imaginary part, or of dB and degrees, as Python writes it."""
    a, b = float(first), float(second)
    if not (db and degrees):
        return str(complex(a, b))
    if not (a < _MOST_DB and math.isfinite(b)):
        return "inf"
    return str(10 ** (a / 20) * cmath.exp(1j * math.radians(b)))


def is_number(cell: str, decimal: str = ".") -> bool:
    """Return whether a cell is a real or complex number, with this decimal mark."""
    if len(cell) > _LONGEST_NUMBER:
        return False
    cell = with_point(cell, decimal)
    return _REAL.fullmatch(cell) is not None or (cell[-1:] in ("j", ")") and _COMPLEX.fullmatch(cell) is not None)


def layout_of(name: str, lines: Sequence[tuple[int, str]], decimal: str | None) -> Layout:
    """The layout of a file that begins with these lines, empty ones left out; refused where it isn't certain.

    A line is one of numbers if the cells are numbers that most lines have as numbers; names stand in the last line of text above
    the first of them, or in a remark there, and units perhaps in a line between.
    """
    table = [line for line in lines if not is_comment(line[1])]
    bare = [line for _, line in table]
    found = [
        reading
        for separator in _SEPARATORS
        for mark in (".", ",")
        if mark in (decimal, decimal or mark) and _possible(separator, mark, bare, decimal)
        if (reading := _reading(bare, separator, mark)) is not None
    ]
    if not found:
        raise FileFormatError(
            f"{name} holds no data: no line of numbers was found; expected a line of column names, then lines of numbers"
        )
    best = max(found, key=lambda reading: reading[:6])
    number, line = table[best.start]
    if best.numbers < 1 and (mark := next(filter(None, (_THOUSANDS.search(line[:10_000]) for line in bare)), None)):
        raise FileFormatError(f"{name}: {mark[0]!r} has marks for thousands; export the numbers without them")
    other = next((r for r in found if r.decimal == "," and r.width == 1 and r.lines == best.lines), None)
    if best.separator == "," and best.width == 2 and other is not None and best.start == 0 and decimal is None:
        raise FileFormatError(
            f"{name}: {line.strip()!r} can be two numbers or one with a decimal comma; give ",
            Remedy({"decimal": "."}),
            " for two or ",
            Remedy({"decimal": ","}),
            " for one",
        )
    remarks = [remark for remark in lines if is_comment(remark[1]) and remark[0] < number]
    ends = best.separator is not None and line.rstrip(" \r\n").endswith(best.separator)
    names, words, repeated = _names(best, table[: best.start], remarks, ends)
    if words == _NO_NAMES and len(own := BY_ENDING.get(Path(name).suffix.lower(), ())) == best.width:
        names, words = own, f"names as files {Path(name).suffix} have them"
    how = f"text, {best.width} columns separated by {_WORDS[best.separator]}" if best.several else "text, one column"
    how += " with decimal commas" * (best.decimal == ",")
    return Layout(
        best.separator, best.decimal, names, number, f"{how}, {words}, numbers from line {number} on", repeated
    )


def _possible(separator: str | None, mark: str, lines: list[str], stated: str | None) -> bool:
    """Return whether the marks are there; commas are both only where quotes tell them apart."""
    there = separator is None or any(separator in line for line in lines)
    commas = mark == "." or mark == stated or any("," in line for line in lines)
    return there and commas and not (separator == mark == "," and all('"' not in line for line in lines))


def _reading(lines: list[str], separator: str | None, decimal: str) -> _Reading | None:
    """One way to cut the lines; None where no line of numbers comes out."""
    rows = [cells_of(line, separator) for line in lines]
    widest = max((len(row) for row in rows if all(not cell or is_number(cell, decimal) for cell in row)), default=0)
    rows = [
        whole_row(line, separator, widest) if len(row) < widest else row for line, row in zip(lines, rows, strict=True)
    ]
    patterns = [tuple(is_number(cell, decimal) for cell in row[:_MOST_CELLS]) for row in rows]
    counts = Counter((len(row), pattern) for row, pattern in zip(rows, patterns, strict=True) if any(pattern))
    if not counts:
        return None
    width, usual = max(counts, key=lambda key: (counts[key], sum(key[1]), key[0]))
    like = [_like(row, pattern, usual, width) for row, pattern in zip(rows, patterns, strict=True)]
    start = like.index(True)
    # A line above with more numbers than texts is one of numbers too, with a word such as "OVL" in it.
    while start and len(rows[start - 1]) == width and 2 * sum(patterns[start - 1]) > sum(usual):
        start -= 1
    last = max(k for k, pattern in enumerate(patterns) if any(pattern))  # below it there may be remarks
    inside = zip(rows[start : last + 1], patterns[start : last + 1], strict=True)
    below = [flag for row, pattern in inside for cell, flag in zip(row, pattern, strict=False) if cell]
    named = start == 0 or len(rows[start - 1]) == width
    return _Reading(
        2 * sum(below) > len(below),
        sum(like),
        sum(below) / len(below),
        named,
        width > 1,
        decimal == ".",
        separator,
        width,
        start,
    )


def _like(row: list[str], pattern: tuple[bool, ...], usual: tuple[bool, ...], width: int) -> bool:
    """Return whether all cells that are usually numbers are, or are empty."""
    return (
        len(row) == width
        and any(pattern)
        and all(here or not cell or not wanted for cell, here, wanted in zip(row, pattern, usual, strict=False))
    )


def _names(
    best: _Reading, above: Sequence[tuple[int, str]], remarks: Sequence[tuple[int, str]], ends: bool
) -> tuple[tuple[str, ...], str, tuple[str, ...]]:
    """Names of the columns, where they stand in words, and those that are repeated; without names their addresses."""
    addresses = addressed(best.width)
    bare = [(k, line.strip().lstrip("#%!/*").strip()) for k, line in remarks]
    bare = [(k, line) for k, line in bare if line]
    rows = _rows_of_text(above, best, ends) or _rows_of_text(bare, best, ends)
    if not rows:
        return addresses, _NO_NAMES, ()
    *rows, (at, row) = rows
    words, symbols = "", [""] * best.width
    if rows and _is_units(row):
        symbols = [cell.strip("[]() ") for cell in row]
        words = f" and units in line {at}"
        *rows, (at, row) = rows
    while len(set(row)) < len(row) and rows:
        *rows, (at, upper) = rows
        row = [f"{group} {cell}".strip() for group, cell in zip(_filled(upper), row, strict=True)]
    names = [
        f"{cell} [{unit}]" if unit and not units.in_brackets(cell)[1] else cell
        for cell, unit in zip(row, symbols, strict=True)
    ]
    usable = (
        name if 0 < len(name) <= _LONGEST_NAME else address for name, address in zip(names, addresses, strict=True)
    )
    names = [*usable]
    repeated = tuple(name for name, count in Counter(names).items() if count > 1)
    if len(set(each := _numbered(names))) < len(names):
        return addresses, f"names that are not all different ({', '.join(repeated)[:_LONGEST_NAME]}), so not used", ()
    return tuple(each), f"names in line {at}{words}", repeated


def addressed(width: int) -> tuple[str, ...]:
    """Addresses of the columns, which stand for their names."""
    return tuple(f"[:,{k}]" for k in range(width))


def numbered(name: str, k: int) -> str:
    """Name of the k-th column with the same title, the number before its unit."""
    base, unit = units.in_brackets(name)
    return name if k == 1 else f"{base} {k} [{unit}]" if unit else f"{name} {k}"


def _numbered(names: Sequence[str]) -> list[str]:
    seen = Counter[str]()
    found = list[str]()
    for name in names:
        seen[name] += 1
        found.append(numbered(name, seen[name]))
    return found


def _rows_of_text(lines: Sequence[tuple[int, str]], best: _Reading, ends: bool) -> list[tuple[int, list[str]]]:
    """The lowest lines with one text a column and without numbers, as cells."""
    found: list[tuple[int, list[str]]] = []
    lines = list(lines[-_MOST_ABOVE:])
    while lines and best.width > 1 and (_RULE.fullmatch(lines[-1][1]) or _END.match(lines[-1][1])):
        lines.pop()
    for k, line in reversed(lines[-4:]):
        cuts = (
            whole_row(line, best.separator, best.width),
            re.split(r"\s{2,}|\t", line.strip().strip('"').strip()),
            *(cells_of(line, mark) for mark in ",; "),
        )
        row = next((cut for cut in cuts if len(cut) == best.width), None)
        if row is None and len(words := line.split()) == best.width and any(map(axis_role, words)):
            row = words
        if row and (mark := row[0][-1:]) in (",", ";") and all(cell.endswith(mark) for cell in row[:-1]):
            row = [cell.rstrip(mark) for cell in row]  # a title with its own separators above numbers between spaces
        if row is None and len(cuts[0]) == best.width + 1 and (ends or cuts[0][-1].lower() in _REMARKS):
            row = cuts[0][:-1]  # the title of a column without numbers, behind the last separator
        if (
            row is None
            or not any(row)
            or any(is_number(cell) or is_number(cell, ",") or cell.endswith(":") for cell in row)
        ):
            break
        found.insert(0, (k, row))
    return found


def _is_units(row: list[str]) -> bool:
    """Return whether a line between names and numbers is one of units."""
    bare = [cell.strip("[]() ") for cell in row]
    axes = (units.FREQUENCY, units.TIME, units.PHASE)
    return all(
        text.strip()[:1] in ("[", "(")
        or cell.lower().removeprefix("db") in units.USUAL
        or any(units.factor(axis, cell) for axis in axes)
        for cell, text in zip(bare, row, strict=True)
    )


def _filled(row: list[str]) -> list[str]:
    """A title above several columns stands in the first of them only."""
    title, filled = "", list[str]()
    for cell in row:
        title = cell or title
        filled.append(title)
    return filled
