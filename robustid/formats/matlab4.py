"""Variables of MATLAB files before v5: a plain list of matrices, each with a header of five whole numbers.

Source: The MathWorks, *MAT-File Format*, "Version 4 MAT-Files". A reader of our own for the reason that `matlab5` gives.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robustid.errors import FileFormatError
from robustid.formats.table import Table

_HEADER = struct.calcsize("<5i")
_FORMATS = ("f8", "f4", "i4", "i2", "u2", "u1")  # by the third digit of the type
_LONGEST_NAME = 4096
_FULL = 0  # the last digit; 1: text, 2: sparse


def read_matlab4(path: Path) -> Table:
    """Full matrices of numbers; texts and sparse matrices are passed over."""
    content, at = path.read_bytes(), 0
    columns: dict[str, NDArray[np.generic] | FileFormatError] = {}
    while at < len(content):
        name, matrix, at = _matrix(path, content, at)
        if matrix is not None:
            columns[name] = matrix
    return Table(path, columns, how="MATLAB v4")


def _matrix(path: Path, content: bytes, at: int) -> tuple[str, NDArray[np.generic] | None, int]:
    """Name and numbers (None: no full matrix) of the matrix that begins at a place, and the place behind it."""
    if len(content) - at < _HEADER:
        raise _broken(path, "it ends within a header")
    order = "<" if 0 <= struct.unpack_from("<i", content, at)[0] < 1000 else ">"
    kind, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", content, at)
    machine, rest = divmod(kind, 1000)
    number, shape = divmod(rest, 10)
    known = machine == (order == ">") and number < len(_FORMATS) and shape < 3 and imaginary in (0, 1)
    if not known or min(rows, columns) < 0 or not 0 < length <= _LONGEST_NAME:
        raise _broken(path, "a header is none of MATLAB's")
    start = at + _HEADER + length
    form = np.dtype(f"{order}{_FORMATS[number]}")
    count = rows * columns
    end = start + count * form.itemsize * (1 + imaginary)
    if end > len(content):
        raise _broken(path, f"a matrix declares {rows} x {columns} numbers, more than the file holds")
    name = content[at + _HEADER : start].split(b"\0")[0].decode("latin-1")
    if shape != _FULL:
        return name, None, end
    parts = np.frombuffer(content, form, count * (1 + imaginary), start).reshape(1 + imaginary, count)
    values = parts[0] + 1j * parts[1] if imaginary else parts[0].astype(form.newbyteorder("="))
    return name, values.reshape(rows, columns, order="F"), end


def _broken(path: Path, why: str) -> FileFormatError:
    return FileFormatError(
        f"{path.name} can't be read as a MATLAB file ({why}); is it cut off, or another kind of file?"
    )
