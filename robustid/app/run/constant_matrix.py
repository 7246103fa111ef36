"""Constant matrices of run files and commands: rows of numbers, or a file that holds one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.run.checks import number, several
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.core import Real

Rows = tuple[tuple[float, ...], ...]


def matrix_text(name: str, content: str) -> object:
    """Rows from 1,0;0,1 on the command line; what holds other than numbers is the name of a file."""
    del name
    try:
        return [[float(part) for part in row.split(",")] for row in content.split(";")]
    except ValueError:
        return content


def matrix_or_file(name: str, value: object) -> Rows | str:
    """Check of a key: rows of numbers of one length, or the name of a file."""
    if isinstance(value, str):
        return value
    rows = several(several(number()))(name, value)
    if not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        raise InputError(
            f"{name} must be rows of numbers, all of one length, or a file; got rows of {[*map(len, rows)]}"
        )
    return rows


def matrix_of(name: str, value: Rows | str, folder: Path) -> Real:
    """The matrix; files are seen from a folder: text, or the only array of an .npz, .npy or .mat."""
    import numpy as np

    if not isinstance(value, str):
        return np.array(value, dtype=float)
    path = folder / value
    if not path.is_file():
        raise InputError(f"{name} {value}: there is no such file, and rows of numbers are written 1,0;0,1")
    from robustid.formats import read_table

    table = read_table(path)
    arrays = [table.numbers(one) for one in table.columns]
    if table.text:
        arrays = [np.stack(arrays, axis=1)]
    if len(arrays) != 1 or arrays[0].ndim != 2 or np.iscomplexobj(arrays[0]) or not np.all(np.isfinite(arrays[0])):
        shapes = ", ".join(str(one.shape) for one in arrays)
        raise InputError(f"{name} {value}: one real matrix of finite numbers is needed; got arrays of shape {shapes}")
    return arrays[0].astype(float)
