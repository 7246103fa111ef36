"""Arrays that NumPy wrote, .npz and .npy; pickled objects are refused."""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np

from robustid.errors import FileFormatError
from robustid.formats.table import NAMELESS, Table, check_growth, keep, said

_WORKBOOKS = ("xl/workbook.xml", "content.xml")


def read_npz(path: Path) -> Table:
    """Arrays of an archive, by their names; the fields of a structured array by ``name.field``."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            if any(name in archive.zip.namelist() for name in _WORKBOOKS):
                raise FileFormatError(f"{path.name} is a workbook of a spreadsheet; export its sheet as text (.csv)")
            for info in archive.zip.infolist():
                check_growth(path, info.filename, info.file_size, info.compress_size)
                with archive.zip.open(info) as member:
                    _check_header(path, info.filename, member, info.file_size)
            arrays = {name: archive[name] for name in archive.files}
    except FileFormatError:
        raise
    except Exception as error:  # zipfile, zlib and numpy each have their own for broken bytes
        raise FileFormatError(f"{path.name} can't be read as .npz ({said(error)}); is the file cut off?") from None
    meta = arrays.pop("robustid", None)
    table = Table(path, {}, None if meta is None else str(meta), how="NumPy archive")
    for name, value in arrays.items():
        keep(name, value, table)
    return table


def read_npy(path: Path) -> Table:
    """One array, without a name; the fields of a structured array by their names."""
    try:
        with path.open("rb") as file:
            _check_header(path, "the array", file, path.stat().st_size)
        array = np.load(path, allow_pickle=False)
    except FileFormatError:
        raise
    except Exception as error:  # numpy raises whatever the broken bytes lead it to
        raise FileFormatError(f"{path.name} can't be read as .npy ({said(error)}); is the file cut off?") from None
    table = Table(path, {}, how="NumPy array")
    keep(NAMELESS, array, table)
    return table


def _check_header(path: Path, name: str, member: IO[bytes], size: int) -> None:
    """Refuse a header that says objects, or a larger array than there are bytes: numpy allocates it before it reads."""
    if size < 8 or member.read(6) != b"\x93NUMPY":
        return
    version = tuple(member.read(2))
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(member)
    if dtype.hasobject:
        raise FileFormatError(
            f"{path.name} holds pickled Python objects, which can run code and are never loaded;"
            f" store plain arrays of numbers with numpy.save{'z' * (path.suffix != '.npy')}"
        )
    declared = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if declared > size:
        raise FileFormatError(
            f"{path.name}: {name} declares {declared:.3g} bytes where {size:.3g} are stored; is the file cut off?"
        )
