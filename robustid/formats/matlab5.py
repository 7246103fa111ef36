"""Variables of MATLAB v5 files: numbers, texts, and the names of objects that only MATLAB can read.

A reader of our own, in Python and NumPy: `scipy.io.loadmat` ends the whole process (segmentation fault) at files with flipped
bytes. The format is MathWorks' "MAT-File Format": elements of a type, a size and data, matrices made of elements.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np

from robustid.errors import FileFormatError
from robustid.formats.table import Table, check_growth, said

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _OPAQUE = 1, 2, 3, 4, 5, 17
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_COMPLEX = 0x0800
_LARGEST_SPARSE = 10**7  # entries, zeros counted


def read_matlab5(path: Path) -> Table:
    """Arrays and texts of a MATLAB v5 file."""
    table = Table(path, {}, how="MATLAB v5")
    try:
        for order, data in _variables(path):
            name, value = _matrix(_Elements(data, order))
            if name and not name.startswith("__"):
                _store(name, value, table)
    except FileFormatError:
        raise
    except (
        ValueError,
        KeyError,
        TypeError,
        LookupError,
        struct.error,
        zlib.error,
        OverflowError,
        RecursionError,
    ) as error:
        raise FileFormatError(
            f"{path.name} can't be read as a MATLAB file ({said(error)}); is it cut off, or another kind of file?"
        ) from None
    return table


def _variables(path: Path) -> Iterator[tuple[str, memoryview]]:
    """The matrix of every variable, decompressed; none may claim more than there is."""
    size = os.path.getsize(path)
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}[file.read(128)[126:128]]
        while tag := file.read(8):
            kind, count = struct.unpack(f"{order}II", tag)
            left = size - file.tell()
            if count > left:
                raise ValueError(f"a variable declares {count} bytes where {left} are left")
            data = file.read(count)
            if kind == _COMPRESSED:
                inner = zlib.decompressobj()
                kind, count = struct.unpack(f"{order}II", inner.decompress(data, 8))
                check_growth(path, "a variable", count, len(data))
                data = inner.decompress(inner.unconsumed_tail, count)
                if len(data) != count:
                    raise ValueError(f"a variable declares {count} bytes and has {len(data)}")
            if kind == _MATRIX:
                yield order, memoryview(data)


class _Elements:
    """The elements of a matrix, one after the other."""

    def __init__(self, data: memoryview, order: str) -> None:
        self.data, self.order = data, order

    def next(self) -> tuple[int, memoryview]:
        kind, count = struct.unpack_from(f"{self.order}II", self.data)
        if kind >> 16:  # a small element: its size is in the upper half, its data in place of the size
            kind, count = kind & 0xFFFF, kind >> 16
            start, end = 4, 8
        else:
            start, end = 8, 8 + count + -count % 8
        if start + count > len(self.data) or (start == 4 and count > 4):
            raise ValueError("an element is longer than what holds it")
        value, self.data = self.data[start : start + count], self.data[end:]
        return kind, value

    def numbers(self) -> np.ndarray:
        kind, value = self.next()
        return np.frombuffer(value, f"{self.order}{_TYPES[kind]}")

    def text(self) -> str:
        kind, value = self.next()
        code = _TEXTS[kind]
        return bytes(value).decode(
            code if "8" in code or code == "latin-1" else code + ("-le" if self.order == "<" else "-be")
        )

    def matrix(self) -> Any:
        kind, value = self.next()
        if kind != _MATRIX:
            raise ValueError("a matrix is missing")
        return _matrix(_Elements(value, self.order))[1] if len(value) else np.empty((0, 0))


class _Unreadable(str):
    """The class of an object."""


def _matrix(parts: _Elements) -> tuple[str, Any]:
    """Name and value: an array, a list of texts, a dictionary for a structure; None for what isn't read."""
    flags = int(parts.numbers()[0])
    kind = flags & 0xFF
    if kind == _OPAQUE:
        name, _ = parts.text(), parts.text()
        return name, _Unreadable(parts.text())
    shape = tuple(parts.numbers().tolist())
    name = parts.text()
    count = math.prod(shape)
    if kind == _SPARSE and len(shape) == 2:
        return name, _sparse(parts, (shape[0], shape[1]), bool(flags & _COMPLEX))
    if min(shape, default=0) < 0 or count > 16 * len(parts.data) + 16:
        raise ValueError(f"an array declares the shape {shape} and has {len(parts.data)} bytes")
    if kind in _CLASSES:
        return name, _numeric(parts, shape, _CLASSES[kind], bool(flags & _COMPLEX))
    if kind == _CHAR:
        letters = list(parts.text()) if len(parts.data) else []
        rows = shape[0] if len(shape) == 2 and len(letters) == count else 0
        return name, ["".join(letters[k::rows]) for k in range(rows)]  # stored by columns
    if kind == _CELL:
        items = [parts.matrix() for _ in range(count)]
        single = all(isinstance(item, list) and len(cast("list[Any]", item)) == 1 for item in items)
        return name, [item[0] for item in items] if single else None
    if kind == _OBJECT:
        return name, _Unreadable(parts.text())
    if kind == _STRUCT and count == 1:
        width = int(parts.numbers()[0])
        fields = bytes(parts.next()[1])
        names = [fields[k : k + width].split(b"\0")[0].decode("latin-1") for k in range(0, len(fields), width)]
        return name, {field: parts.matrix() for field in names}
    return name, None


def _numeric(parts: _Elements, shape: tuple[int, ...], kind: str, is_complex: bool) -> np.ndarray:
    real = parts.numbers().astype(kind).reshape(shape, order="F")
    if not is_complex:
        return real
    values = np.empty(shape, complex, order="F")
    # Not real + 1j*imag, which loses the sign of zeros.
    values.real, values.imag = real, parts.numbers().astype(kind).reshape(shape, order="F")
    return values


def _sparse(parts: _Elements, shape: tuple[int, int], is_complex: bool) -> np.ndarray:
    """A sparse matrix, written out: rows of its entries, where each column begins, values."""
    if min(shape) < 0 or math.prod(shape) > _LARGEST_SPARSE:
        raise ValueError(f"a sparse matrix of shape {shape} is too large to be written out")
    rows, starts, values = parts.numbers(), parts.numbers(), parts.numbers().astype(float)
    counts = np.diff(starts)
    if starts.size != shape[1] + 1 or starts[0] != 0 or np.any(counts < 0) or starts[-1] > min(rows.size, values.size):
        raise ValueError("a sparse matrix has columns that do not fit together")
    used = slice(0, int(starts[-1]))
    if np.any(rows[used] < 0) or np.any(rows[used] >= shape[0]):
        raise ValueError("a sparse matrix has entries outside of it")
    if is_complex:
        values = values + 1j * parts.numbers().astype(float)
    full = np.zeros(shape, values.dtype)
    full[rows[used], np.repeat(np.arange(shape[1]), counts)] = values[used]
    return full


def _store(name: str, value: Any, table: Table) -> None:
    if isinstance(value, dict):
        for field, item in cast("dict[str, Any]", value).items():
            _store(f"{name}.{field}", item, table)
    elif isinstance(value, _Unreadable):
        table.objects[name] = str(value)
    elif isinstance(value, list) and value:
        table.texts[name] = value
    elif isinstance(value, np.ndarray):
        (table.columns if value.size else table.empty)[name] = value
