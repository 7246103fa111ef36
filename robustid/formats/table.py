"""Result of the readers of all formats: named arrays, and guards against files that claim to be enormous."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, cast

import numpy as np

from robustid.core import Options
from robustid.errors import FileFormatError

# Deflate, the densest code of these formats, can't shrink data to less than 1/1032.
_DENSEST = 1032
_USUAL = 200  # measurements never shrink as far
_LARGE = 2**30  # bytes; what expands to less does no harm

NAMELESS = ""  # of the one array of a file that gives it no name
MOST_TEXTS = 10_000  # texts in an array


@dataclasses.dataclass(frozen=True)
class Table:
    """Arrays by name, and what else a file says.

    A text column that isn't made of numbers is kept as the error to raise where somebody asks for it.
    """

    path: Path
    columns: dict[str, np.ndarray | FileFormatError]
    meta: Any = None  # the description that `save` leaves
    texts: dict[str, list[str]] = dataclasses.field(default_factory=dict[str, list[str]])
    objects: dict[str, str] = dataclasses.field(default_factory=dict[str, str])  # name and class of what can't be read
    # Arguments that the file states, by kind.
    facts: dict[str, Options] = dataclasses.field(default_factory=dict[str, Options])
    # Arrays without entries, of their shape.
    empty: dict[str, np.ndarray] = dataclasses.field(default_factory=dict[str, np.ndarray])
    remarks: dict[str, str] = dataclasses.field(default_factory=dict[str, str])  # on arrays, by their names
    how: str = ""  # format, and for text what its lines were taken for
    text: bool = False

    def numbers(self, name: str) -> np.ndarray:
        """The numbers of a column, or raise why it has none."""
        if isinstance(values := self.columns[name], FileFormatError):
            raise values
        return values


def keep(name: str, value: object, table: Table) -> None:
    """Keep numbers and texts; nothing else is plain."""
    if not isinstance(value, np.ndarray):
        return
    array = cast("np.ndarray", value)
    if array.dtype.names is not None:
        for field in array.dtype.names:
            keep(f"{name}.{field}" if name else field, array[field], table)
    elif array.dtype.kind in "biufc":
        (table.columns if array.size else table.empty)[name] = array
    elif array.dtype.kind in "US" and array.size <= MOST_TEXTS:
        table.texts[name] = [str(text) for text in array.reshape(-1).astype(str)]


def check_growth(path: Path, name: str, declared: int, stored: int) -> None:
    """Refuse what declares more bytes than its stored bytes can hold, before anything is allocated."""
    if declared > _DENSEST * stored + 4096 or (declared > _LARGE and declared > _USUAL * stored):
        raise FileFormatError(
            f"{path.name}: {name} declares {declared:.3g} bytes and the file holds {stored:.3g} for it; it is cut off or"
            " damaged. Write it again, uncompressed if it really holds so much"
        )


def said(error: BaseException) -> str:
    """First line of what a foreign library says."""
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


def missing(path: Path, package: str, extra: str) -> FileFormatError:
    """Say which package reads a format, and the extra that brings it."""
    return FileFormatError(
        f"{path.name}: this format is read through the package {package}, which isn't installed here:"
        f" pip install 'robustid[{extra}]'"
    )
