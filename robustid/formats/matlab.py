"""Variables of MATLAB files, v5 and before: numbers, texts, and the names of objects that only MATLAB can read.

Readers of our own, in Python and NumPy: `scipy.io.loadmat` ends the whole process (segmentation fault) at files with flipped
bytes. The formats are MathWorks' "MAT-File Format": of v5 elements of a type, a size and data, matrices made of elements; before
it a plain list of matrices, each with a header of five whole numbers. Those of v7.3 are HDF5.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from robustid.core import Record
from robustid.errors import FileFormatError
from robustid.formats.matlab_objects import Subsystem, plain
from robustid.formats.matlab_structures import name_logged_signals
from robustid.formats.table import Table, check_growth, said

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _OPAQUE = 1, 2, 3, 4, 5, 17
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_COMPLEX = 0x0800
_READABLE = (("ResponseData", "Frequency"), ("num", "den"), ("z", "p", "k"), ("a", "b", "c"))  # of objects
_LARGEST_SPARSE = 10**7  # entries, zeros counted
_HEADER4 = struct.calcsize("<5i")
_FORMATS4 = ("f8", "f4", "i4", "i2", "u2", "u1")  # by the third digit of the type
_LONGEST_NAME4 = 4096
_FULL4 = 0  # the last digit; 1: text, 2: sparse


def read_matlab5(path: Path) -> Table:
    """Arrays and texts of a MATLAB v5 file."""
    table = Table(path, {}, how="MATLAB v5")
    objects: dict[str, _Object] = {}
    try:
        for order, data in _variables(path):
            name, value = _matrix(_Elements(data, order))
            if name and not name.startswith("__"):
                _store(name, value, table, objects)
            elif not name and isinstance(value, np.ndarray) and value.dtype == np.uint8 and objects:
                # A table of objects in a form that isn't known leaves the other variables as they are.
                with contextlib.suppress(ValueError, KeyError, TypeError, LookupError, struct.error, RecursionError):
                    _open(objects, value.tobytes(order="F"), order, table)
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
        raise _broken(path, said(error)) from None
    name_logged_signals(table)
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

    def matrix(self) -> _Value:
        kind, value = self.next()
        if kind != _MATRIX:
            raise ValueError("a matrix is missing")
        return _matrix(_Elements(value, self.order))[1] if len(value) else np.empty((0, 0))


@dataclasses.dataclass(frozen=True)
class _Object:
    """The class of an object, and what the file has of it: fields of old ones, references of new ones."""

    kind: str
    value: _Value = None


# An array, a list of texts, a structure, an object, a cell; None for what isn't read.
_Value = np.ndarray | list[str] | dict[str, "_Value"] | _Object | tuple["_Value", ...] | None


def _matrix(parts: _Elements) -> tuple[str, _Value]:
    """Name and value of a matrix."""
    flags = int(parts.numbers()[0])
    kind = flags & 0xFF
    if kind == _OPAQUE:
        name, _ = parts.text(), parts.text()
        return name, _Object(parts.text(), parts.matrix() if len(parts.data) else None)
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
        texts = [item[0] for item in items if isinstance(item, list) and len(item) == 1]
        return name, texts if len(texts) == len(items) else tuple(items)
    owner = parts.text() if kind == _OBJECT else ""
    if kind in (_STRUCT, _OBJECT) and (count == 1 or not owner):
        width = int(parts.numbers()[0])
        titles = bytes(parts.next()[1])
        names = [titles[k : k + width].split(b"\0")[0].decode("latin-1") for k in range(0, len(titles), width)]
        each: list[dict[str, _Value]] = [{field: parts.matrix() for field in names} for _ in range(count)]
        return name, _Object(owner, each[0]) if owner else each[0] if count == 1 else tuple(each)
    return name, _Object(owner) if owner else None


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


def _store(name: str, value: object, table: Table, objects: dict[str, _Object]) -> None:
    if isinstance(value, _Object):
        table.objects[name] = value.kind
        objects[name] = value
        if isinstance(value.value, dict):  # of a class of before 2008: its fields stand in it
            _keep_plain(name, _fields(value.value), table)
    elif isinstance(value, dict):
        for field, item in cast("dict[str, object]", value).items():
            _store(f"{name}.{field}", item, table, objects)
    elif isinstance(value, tuple):
        for k, item in enumerate(cast("tuple[object, ...]", value)):
            if isinstance(item, _Object):
                _store(f"{name}{{{k + 1}}}", item, table, objects)
            elif isinstance(item, dict):  # of an array of structures, or a cell of them
                _store(f"{name}({k + 1})", cast("object", item), table, objects)
    elif isinstance(value, list) and value:
        table.texts[name] = value
    elif isinstance(value, np.ndarray):
        (table.columns if value.size else table.empty)[name] = value


def _fields(value: _Value) -> Any:
    """Structures and old objects as mappings, cells as tuples."""
    if isinstance(value, _Object):
        return _fields(value.value)
    if isinstance(value, dict):
        return {name: _fields(item) for name, item in value.items()}
    return tuple(map(_fields, value)) if isinstance(value, tuple) else value


def _open(objects: dict[str, _Object], content: bytes, order: str, table: Table) -> None:
    """Keep what the subsystem of a file has of its objects; those that can't be followed stay named only."""
    read = _matrix(_Elements(memoryview(content)[16:], order))[1] if len(content) > 16 else None
    wrapper = read.get("MCOS") if isinstance(read, dict) else None
    if not isinstance(wrapper, _Object) or not isinstance(wrapper.value, tuple):
        return
    system = Subsystem([_fields(cell) for cell in wrapper.value], order)
    for name, one in objects.items():
        if isinstance(one.value, np.ndarray):
            found = system.of_reference(one.value)
            if isinstance(found, dict):
                _keep_plain(name, cast("Record", found), table)


def _keep_plain(name: str, properties: Record, table: Table) -> None:
    """Keep the numbers and texts of an object; it is no longer one that can't be read where they are a response or a model."""
    fields = plain(properties)
    if any(set(parts) <= set(fields) for parts in _READABLE):
        del table.objects[name]
        for field, item in fields.items():
            _store(f"{name}.{field}", item, table, {})


# --- before v5 -------------------------------------------------------------------------------------------------------------------


def read_matlab4(path: Path) -> Table:
    """Full matrices of numbers; texts and sparse matrices are passed over."""
    content, at = path.read_bytes(), 0
    columns: dict[str, NDArray[np.generic] | FileFormatError] = {}
    while at < len(content):
        name, matrix, at = _matrix4(path, content, at)
        if matrix is not None:
            columns[name] = matrix
    return Table(path, columns, how="MATLAB v4")


def _matrix4(path: Path, content: bytes, at: int) -> tuple[str, NDArray[np.generic] | None, int]:
    """Name and numbers (None: no full matrix) of the matrix that begins at a place, and the place behind it."""
    if len(content) - at < _HEADER4:
        raise _broken(path, "it ends within a header")
    order = "<" if 0 <= struct.unpack_from("<i", content, at)[0] < 1000 else ">"
    kind, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", content, at)
    machine, rest = divmod(kind, 1000)
    number, shape = divmod(rest, 10)
    known = machine == (order == ">") and number < len(_FORMATS4) and shape < 3 and imaginary in (0, 1)
    if not known or min(rows, columns) < 0 or not 0 < length <= _LONGEST_NAME4:
        raise _broken(path, "a header is none of MATLAB's")
    start = at + _HEADER4 + length
    form = np.dtype(f"{order}{_FORMATS4[number]}")
    count = rows * columns
    end = start + count * form.itemsize * (1 + imaginary)
    if end > len(content):
        raise _broken(path, f"a matrix declares {rows} x {columns} numbers, more than the file holds")
    name = content[at + _HEADER4 : start].split(b"\0")[0].decode("latin-1")
    if shape != _FULL4:
        return name, None, end
    parts = np.frombuffer(content, form, count * (1 + imaginary), start).reshape(1 + imaginary, count)
    values = parts[0] + 1j * parts[1] if imaginary else parts[0].astype(form.newbyteorder("="))
    return name, values.reshape(rows, columns, order="F"), end


def _broken(path: Path, why: str) -> FileFormatError:
    return FileFormatError(
        f"{path.name} can't be read as a MATLAB file ({why}); is it cut off, or another kind of file?"
    )
