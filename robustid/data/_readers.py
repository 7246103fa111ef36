"""From a file of any supported format to named arrays; nothing is executed and nothing unpickled."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robustid.errors import FileFormatError, InputError, InputTypeError

FORMAT = 1
_MARK = "# robustid "
_MATLAB_NUMBERS = {"double", "single"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


class Table(NamedTuple):
    """What a file holds: arrays by name, and the description that `save` leaves (None in other files).

    A text column that isn't made of numbers is kept as the error to raise where somebody asks for it.
    """

    path: Path
    columns: dict[str, np.ndarray | FileFormatError]
    meta: dict[str, Any] | None


def read_table(path: Any) -> Table:
    """Read a file, its format recognised by its first bytes and not by its name."""
    try:
        path = Path(path)
    except TypeError:
        raise InputTypeError(f"`path` must be the name of a file; got {type(path).__name__}") from None
    if path.is_dir():
        raise InputError(f"`path` = {str(path)!r} is a folder; give the name of a file in it")
    try:
        with path.open("rb") as file:
            head = file.read(520)
    except FileNotFoundError:
        raise InputError(f"`path` = {str(path)!r}: there is no such file; check the name and the folder") from None
    except OSError as error:
        raise InputError(f"`path` = {str(path)!r} can't be read: {error.strerror}") from None
    if not head:
        raise FileFormatError(f"{path.name} is empty (0 bytes); write or copy the file again")
    read = _reader(path, head)
    columns, meta = read(path)
    if not columns:
        raise FileFormatError(
            f"{path.name} holds no numeric arrays; store plain vectors or matrices (objects such as"
            " MATLAB's frd, timeseries and tables can't be read)"
        )
    return Table(path, columns, _checked(path, meta))


def _reader(path: Path, head: bytes) -> Callable[[Path], tuple[dict[str, Any], Any]]:
    signature = b"\x89HDF\r\n\x1a\n"
    if head.startswith(signature) or head[512:520] == signature:
        return _read_hdf5
    if head.startswith(b"PK"):
        return _read_npz
    if head.startswith(b"MATLAB 5.0") or path.suffix.lower() == ".mat":
        return _read_matlab
    if path.suffix.lower() in {".csv", ".tsv", ".txt"}:
        return _read_text
    raise FileFormatError(
        f"{path.name} isn't a file that robustid reads; give .csv, .tsv or .txt with column names in the"
        " first line,"
        " .npz (numpy.savez with names) or .mat (v5 or v7.3)"
    )


def _read_text(path: Path) -> tuple[dict[str, Any], Any]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileFormatError(f"{path.name} isn't UTF-8 text; export it as comma-separated text (UTF-8)") from None
    meta = lines[0][len(_MARK) :] if lines and lines[0].startswith(_MARK) else None
    rows = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if len(rows) < 2:
        raise FileFormatError(f"{path.name} holds no data; expected a line of column names, then lines of numbers")
    delimiter = next((mark for mark in "\t;," if mark in rows[0][1]), None)
    if delimiter is None:
        cells = [line.split() for _, line in rows]
    else:
        cells = [[cell.strip() for cell in row] for row in csv.reader((x for _, x in rows), delimiter=delimiter)]
    names = cells[0]
    if all(_is_number(name) for name in names):
        raise FileFormatError(f"{path.name} has no line of column names; put one at the top, such as time,u,y")
    if len(set(names)) != len(names):
        raise FileFormatError(f"{path.name}: the column names {names} are not all different; rename the equal ones")
    for (k, _), row in zip(rows, cells, strict=False):
        if len(row) != len(names):
            raise FileFormatError(
                f"{path.name}, line {k}: {len(row)} cells where the header has {len(names)}; is the file cut off?"
            )
    numbers = [k for k, _ in rows[1:]]
    columns = zip(*cells[1:], strict=True)
    return {name: _column(path, name, column, numbers) for name, column in zip(names, columns, strict=True)}, meta


def _column(path: Path, name: str, cells: tuple[str, ...], lines: list[int]) -> np.ndarray | FileFormatError:
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        pass
    values = []
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


def _read_npz(path: Path) -> tuple[dict[str, Any], Any]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:  # zipfile, zlib and numpy each have their own for broken bytes
        if "allow_pickle" in str(error):
            raise FileFormatError(
                f"{path.name} holds pickled Python objects, which can run code and are never loaded;"
                " store plain arrays of numbers with numpy.savez"
            ) from None
        raise FileFormatError(f"{path.name} can't be read as .npz ({_said(error)}); is the file cut off?") from None
    meta = arrays.pop("robustid", None)
    numeric = {k: v for k, v in arrays.items() if isinstance(v, np.ndarray) and v.dtype.kind in "biufc"}
    return numeric, None if meta is None else str(meta)


def _read_matlab(path: Path) -> tuple[dict[str, Any], Any]:
    import scipy.io

    try:
        content = scipy.io.loadmat(str(path), appendmat=False)
    except Exception as error:  # scipy raises whatever the broken bytes lead it to
        raise FileFormatError(
            f"{path.name} can't be read as a MATLAB file ({_said(error)}); is it cut off, or another kind of file?"
        ) from None
    columns: dict[str, Any] = {}
    for name, value in content.items():
        # Objects of MATLAB classes come without a name, or as arrays of internal references.
        if isinstance(name, str) and not name.startswith("__"):
            _flatten(name, value, columns)
    return columns, None


def _flatten(name: str, value: Any, columns: dict[str, Any]) -> None:
    import scipy.io.matlab

    if not isinstance(value, np.ndarray) or isinstance(value, scipy.io.matlab.MatlabOpaque):
        return
    if value.dtype.names is None:
        if value.dtype.kind in "biufc" and value.size:
            columns[name] = value
    elif value.size == 1:
        for field in value.dtype.names:
            _flatten(f"{name}.{field}", value.reshape(-1)[0][field], columns)


def _read_hdf5(path: Path) -> tuple[dict[str, Any], Any]:
    import h5py

    columns: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        filled = kind in _MATLAB_NUMBERS and "MATLAB_empty" not in item.attrs
        if filled and isinstance(item, h5py.Dataset) and not name.startswith("#"):
            columns[name.replace("/", ".")] = _from_hdf5(item[()])

    try:
        # visititems follows no soft and no external links: a file from a stranger opens no other file.
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except Exception as error:  # h5py raises OSError, RuntimeError, KeyError for broken bytes
        raise FileFormatError(f"{path.name} can't be read as HDF5 ({_said(error)}); is the file cut off?") from None
    if not columns:
        raise FileFormatError(
            f"{path.name} is an HDF5 file without MATLAB (v7.3) variables, so the order of its axes isn't"
            " known; store its arrays with numpy.savez"
        )
    return columns, None


def _from_hdf5(array: Any) -> np.ndarray:
    array = np.asarray(array)
    if array.dtype.names == ("real", "imag"):
        array = array["real"] + 1j * array["imag"]
    # MATLAB stores by columns, HDF5 by rows: the axes come out reversed.
    return array.T


def _checked(path: Path, meta: Any) -> dict[str, Any] | None:
    if meta is None:
        return None
    try:
        meta = json.loads(meta)
        version, kind = meta["robustid"], meta["kind"]
    except (ValueError, KeyError, TypeError):
        raise FileFormatError(f"{path.name}: the description that robustid.save wrote is damaged; save again") from None
    if version != FORMAT or kind not in ("frequency", "time"):
        raise FileFormatError(
            f"{path.name} was written in format {version!r} ({kind!r}), unknown here; use a newer robustid"
        )
    return meta


def _said(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
