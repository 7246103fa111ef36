"""Variables of MATLAB and HDF5 files: numbers, texts, and the names of objects that only MATLAB can read."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from robustid.data._table import Table, check_growth, said
from robustid.errors import FileFormatError

_NUMBERS = {"double", "single"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_COMPRESSED = 15


def read_matlab(path: Path) -> Table:
    import scipy.io

    _check_sizes(path)
    table = Table(path, {})
    try:
        content = scipy.io.loadmat(str(path), appendmat=False, chars_as_strings=True)
    except Exception as error:  # scipy raises whatever the broken bytes lead it to
        raise FileFormatError(
            f"{path.name} can't be read as a MATLAB file ({said(error)}); is it cut off, or another kind of file?"
        ) from None
    for name, value in content.items():
        # Objects of MATLAB classes come under the name "None", and as arrays of internal references.
        if not name.startswith("__"):
            _flatten(name, value, table)
    return table


def _check_sizes(path: Path) -> None:
    """Every variable of a v5 file says its size: none may claim more than there is."""
    size = os.path.getsize(path)
    with path.open("rb") as file:
        head = file.read(128)
        if len(head) < 128 or head[126:128] not in (b"IM", b"MI"):
            return  # v4, or no MATLAB file at all
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, count = struct.unpack(f"{order}II", tag)
            left = size - file.tell()
            if count > left:
                raise FileFormatError(
                    f"{path.name} can't be read as a MATLAB file (a variable declares {count} bytes where {left} are"
                    " left); is it cut off?"
                )
            after = file.tell() + count
            if kind == _COMPRESSED:
                _check_compressed(path, file.read(min(count, 4096)), count, order)
            file.seek(after)


def _check_compressed(path: Path, start: bytes, count: int, order: str) -> None:
    try:
        inner = zlib.decompressobj().decompress(start, 8)
    except zlib.error as error:
        raise FileFormatError(f"{path.name} can't be read as a MATLAB file ({said(error)}); is it damaged?") from None
    if len(inner) == 8:
        check_growth(path, "a variable", struct.unpack(f"{order}II", inner)[1], count)


def _flatten(name: str, value: Any, table: Table) -> None:
    import scipy.io.matlab
    import scipy.sparse

    if isinstance(value, scipy.io.matlab.MatlabOpaque):
        _opaque(name, value, table)
    elif isinstance(value, scipy.io.matlab.MatlabObject):
        table.objects[name] = str(value.classname)
    elif scipy.sparse.issparse(value) or not isinstance(value, np.ndarray):
        pass
    elif value.dtype.names is not None:
        for field in value.dtype.names if value.size == 1 else ():
            _flatten(f"{name}.{field}", value.reshape(-1)[0][field], table)
    elif value.dtype.kind in "biufc" and value.size:
        table.columns[name] = value
    elif value.dtype.kind in "UO":
        items = [str(i.item()) if isinstance(i, np.ndarray) and i.size == 1 else i for i in value.reshape(-1)]
        if items and all(isinstance(item, str) for item in items):
            table.texts[name] = [str(item) for item in items]


def _opaque(name: str, value: Any, table: Table) -> None:
    """Name and class of an object, as far as the file tells them."""
    parts = {field: value.reshape(-1)[0][field] for field in value.dtype.names or () if value.size}
    own, _, kind = (parts[field].decode("utf-8", "replace") if isinstance(parts.get(field), bytes) else "" for field in
                    ("s0", "s1", "s2"))  # fmt: skip
    table.objects[own if name == "None" and own else name] = kind or "unknown"


def read_hdf5(path: Path) -> Table:
    import h5py

    table = Table(path, {})
    try:
        # visititems follows no soft and no external links: a file from a stranger opens no other file.
        with h5py.File(path, "r") as file:
            found: list[tuple[str, Any]] = []
            file.visititems(lambda name, item: found.append((name, item)))
            matlab = any("MATLAB_class" in item.attrs for _, item in found)
            if not matlab:
                _attributes("", file, table)
            for name, item in found:
                (_from_matlab73 if matlab else _from_hdf5)(name.replace("/", "."), item, file, table)
    except FileFormatError:
        raise
    except Exception as error:  # h5py raises OSError, RuntimeError, KeyError for broken bytes
        raise FileFormatError(f"{path.name} can't be read as HDF5 ({said(error)}); is the file cut off?") from None
    return table


def _from_matlab73(name: str, item: Any, file: Any, table: Table) -> None:
    import h5py

    kind = _word(item.attrs.get("MATLAB_class", ""))
    if name.startswith("#") or "MATLAB_empty" in item.attrs or not kind:
        return
    if "MATLAB_object_decode" in item.attrs:
        table.objects[name] = kind
    elif not isinstance(item, h5py.Dataset):
        return
    elif kind in _NUMBERS:
        # MATLAB stores by columns, HDF5 by rows: the axes come out reversed.
        table.columns[name] = _complex(_read(name, item, table)).T
    elif kind == "char":
        table.texts[name] = [_characters(_read(name, item, table))]
    elif kind == "cell" and h5py.check_ref_dtype(item.dtype) is not None:
        items = [file[reference] for reference in _read(name, item, table).reshape(-1)]
        if items and all(_word(i.attrs.get("MATLAB_class", "")) == "char" for i in items):
            table.texts[name] = [_characters(_read(name, i, table)) for i in items]


def _from_hdf5(name: str, item: Any, _: Any, table: Table) -> None:
    """Of a file that MATLAB didn't write: axes as they are stored, the unit from an attribute `units`."""
    import h5py

    _attributes(f"{name}.", item, table)
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        return
    numbers = item.dtype.kind in "biuf" or item.dtype.kind == "c" or item.dtype.names in (("r", "i"), ("real", "imag"))
    if numbers and item.size:
        unit = next((_word(item.attrs[key]) for key in ("units", "unit") if key in item.attrs), "")
        table.columns[f"{name} [{unit}]" if unit else name] = _complex(_read(name, item, table))


def _attributes(prefix: str, item: Any, table: Table) -> None:
    for key, value in item.attrs.items():
        if np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf":
            table.columns[f"{prefix}{key}"] = np.asarray(value).reshape(1)


def _read(name: str, item: Any, table: Table) -> np.ndarray:
    if item.external or item.is_virtual:
        raise FileFormatError(
            f"{table.path.name}: {name} lies in other files, which are never opened; copy it into one"
        )
    check_growth(table.path, name, item.size * item.dtype.itemsize, item.id.get_storage_size())
    return np.asarray(item[()])


def _complex(array: np.ndarray) -> np.ndarray:
    if array.dtype.names is None:
        return array
    values = np.empty(array.shape, complex)
    # Not real + 1j*imag, which loses the sign of zeros.
    values.real, values.imag = (array[part] for part in array.dtype.names)
    return values


def _characters(codes: np.ndarray) -> str:
    return "".join(map(chr, codes.T.reshape(-1).tolist()))


def _word(value: Any) -> str:
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value if isinstance(value, str) else ""
