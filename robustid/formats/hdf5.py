"""Variables of HDF5 files, MATLAB's v7.3 and others: numbers, texts, and the names of objects that only MATLAB can read."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from robustid.errors import FileFormatError
from robustid.formats.matlab_structures import name_logged_signals
from robustid.formats.table import Table, check_growth, said

_Item = Any  # of h5py, which states no types: a group, a data set, or a file
_NUMBERS = {"double", "single"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def read_hdf5(path: Path) -> Table:
    """Arrays and texts of an HDF5 file, MATLAB's v7.3 included."""
    import h5py

    table = Table(path, {}, how="HDF5")
    try:
        # visititems follows no soft and no external links: a file from a stranger opens no other file.
        with h5py.File(path, "r") as file:
            found: list[tuple[str, _Item]] = []

            def keep(name: str, item: _Item) -> None:
                found.append((name, item))

            file.visititems(keep)
            matlab = any("MATLAB_class" in item.attrs for _, item in found)
            if matlab:
                table = dataclasses.replace(table, how="MATLAB v7.3")
            else:
                _attributes("", file, table)
            for name, item in found:
                (_from_matlab73 if matlab else _from_hdf5)(name.replace("/", "."), item, file, table)
        if matlab:
            name_logged_signals(table)
    except FileFormatError:
        raise
    except Exception as error:  # h5py raises OSError, RuntimeError, KeyError for broken bytes
        raise FileFormatError(f"{path.name} can't be read as HDF5 ({said(error)}); is the file cut off?") from None
    return table


def _from_matlab73(name: str, item: _Item, file: _Item, table: Table) -> None:
    import h5py

    kind = _word(item.attrs.get("MATLAB_class", ""))
    if name.startswith("#") or "MATLAB_empty" in item.attrs:
        return
    if not kind and isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is not None:
        group, _, field = name.rpartition(".")  # of an array of structures
        for k, reference in enumerate(_read(name, item, table).reshape(-1)):
            if _word(file[reference].attrs.get("MATLAB_class", "")):
                _from_matlab73(f"{group}({k + 1}).{field}", file[reference], file, table)
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


def _from_hdf5(name: str, item: _Item, _: _Item, table: Table) -> None:
    """Read an item of a file that MATLAB didn't write: axes as they are stored, the unit from an attribute `units`."""
    import h5py

    _attributes(f"{name}.", item, table)
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        return
    numbers = item.dtype.kind in "biuf" or item.dtype.kind == "c" or item.dtype.names in (("r", "i"), ("real", "imag"))
    if numbers and item.size:
        unit = next((_word(item.attrs[key]) for key in ("units", "unit") if key in item.attrs), "")
        table.columns[f"{name} [{unit}]" if unit else name] = _complex(_read(name, item, table))


def _attributes(prefix: str, item: _Item, table: Table) -> None:
    for key, value in item.attrs.items():
        if np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf":
            table.columns[f"{prefix}{key}"] = np.asarray(value).reshape(1)


def _read(name: str, item: _Item, table: Table) -> np.ndarray:
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


def _word(value: object) -> str:
    one: _Item = value
    one = one.item() if isinstance(value, np.ndarray) and one.size == 1 else one
    return one.decode("utf-8", "replace") if isinstance(one, bytes) else one if isinstance(one, str) else ""
