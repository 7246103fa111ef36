"""Columns of numbers from text files, block by block."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from robustid.data.io.table import Table
from robustid.errors import FileFormatError

Column = np.ndarray | FileFormatError  # the error is raised where somebody asks for the column

_MARK = "# robustid "
_LONGEST = 2**24  # characters in a line: the header of a covariance of a 10 x 10 response has 2e6
_BLOCK = 20_000  # lines


def read_text(path: Path) -> Table:
    """Columns of a text file, by their names."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            meta = file.readline(_LONGEST)
            file.seek(0)
            columns = _columns(path, _rows(path, file))
    except UnicodeDecodeError:
        raise FileFormatError(f"{path.name} isn't UTF-8 text; export it as comma-separated text (UTF-8)") from None
    return Table(path, columns, meta[len(_MARK) :] if meta.startswith(_MARK) else None, how="text")


def _rows(path: Path, file: IO[str]) -> Iterator[tuple[int, str]]:
    """Number and text of every line that isn't empty and no comment."""
    for k in itertools.count(1):
        if not (line := file.readline(_LONGEST)):
            return
        if len(line) == _LONGEST:
            raise FileFormatError(
                f"{path.name}, line {k} is longer than {_LONGEST} characters; is it a table of numbers?"
            )
        if line.strip() and not line.startswith("#"):
            yield k, line


def _columns(path: Path, rows: Iterator[tuple[int, str]]) -> dict[str, np.ndarray | FileFormatError]:
    header = next(rows, (0, ""))[1]
    delimiter = next((mark for mark in "\t;," if mark in header), None)
    blocks = iter(lambda: list(itertools.islice(rows, _BLOCK)), [])
    first = next(blocks, None)
    if first is None:
        raise FileFormatError(f"{path.name} holds no data; expected a line of column names, then lines of numbers")
    names = _cells(header, delimiter)
    if all(_is_number(name) for name in names):
        raise FileFormatError(f"{path.name} has no line of column names; put one at the top, such as time,u,y")
    if len(set(names)) != len(names):
        equal = sorted({name for name in names if names.count(name) > 1})[:5]
        raise FileFormatError(
            f"{path.name}: the column names are not all different: {equal} several times; rename them"
        )
    parts: list[list[Column]] = [[] for _ in names]
    for block in itertools.chain([first], blocks):
        for part, values in zip(parts, _parsed(path, block, names, delimiter), strict=True):
            part.append(values)
    return {name: _joined(part) for name, part in zip(names, parts, strict=True)}


def _joined(parts: list[Column]) -> np.ndarray | FileFormatError:
    wrong = next((part for part in parts if isinstance(part, FileFormatError)), None)
    return np.concatenate(parts) if wrong is None else wrong  # type: ignore[arg-type]


def _parsed(path: Path, block: list[tuple[int, str]], names: list[str], delimiter: str | None) -> list[Column]:
    """The columns of one block of lines."""
    try:
        numbers = np.loadtxt([line for _, line in block], delimiter=delimiter, comments=None, ndmin=2)
        if numbers.shape == (len(block), len(names)):
            return list(numbers.T)
    except ValueError:
        pass  # something else than real numbers: cell by cell
    cells = [_cells(line, delimiter) for _, line in block]
    for (k, _), row in zip(block, cells, strict=True):
        if len(row) != len(names):
            raise FileFormatError(
                f"{path.name}, line {k}: {len(row)} cells where the header has {len(names)}; is the file cut off?"
            )
    lines = [k for k, _ in block]
    return [_column(path, name, column, lines) for name, column in zip(names, zip(*cells, strict=True), strict=True)]


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error:  # a cell of more than 128 kB
        return [cell.strip() for cell in line.split(delimiter)]


def _column(path: Path, name: str, cells: tuple[str, ...], lines: list[int]) -> np.ndarray | FileFormatError:
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        pass
    values: list[complex] = []
    for cell, line in zip(cells, lines, strict=True):
        try:
            values.append(complex(cell.replace(" ", "").replace("i", "j")))
        except ValueError:
            return FileFormatError(
                f"{path.name}, line {line}, column {name!r}: {cell[:40]!r} is not a number; numbers are"
                " written 0.5 (with a point) or 1+2j"
            )
    return np.array(values)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
