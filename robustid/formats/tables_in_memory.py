"""Tables in memory: mappings of arrays, pandas and xarray objects, arrays of NumPy, all by what they offer, not by their class."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.formats.table import MOST_TEXTS, NAMELESS, Table, keep


def table_of(thing: Any) -> Table | None:
    """The arrays of an object by their names; None where it is no table.

    pandas: columns, and the index where it has a name or holds instants. xarray: variables with their coordinates, units from the
    attribute ``units``. An array without a name is addressed as in a .npy file.
    """
    table = Table(
        Path(type(thing).__name__), {}, how=f"{type(thing).__module__.partition('.')[0]} {type(thing).__name__}"
    )
    if isinstance(thing, np.ndarray):
        keep(NAMELESS, cast("object", thing), table)
    elif hasattr(thing, "dims") and hasattr(thing, "coords"):
        _labelled(thing, table)
    elif hasattr(thing, "columns") and hasattr(thing, "iloc"):
        _index(thing.index, table)
        for k, name in enumerate(cast("Iterable[object]", thing.columns)):
            _add(_words(name), thing.iloc[:, k], table)
    elif hasattr(thing, "index") and hasattr(thing, "iloc"):
        _index(thing.index, table)
        _add(_words(thing.name) if thing.name is not None else "values", thing, table)
    elif isinstance(thing, Mapping):
        for name, values in cast("Mapping[object, ArrayLike]", thing).items():
            _add(_words(name), values, table)
    else:
        return None
    return table


def _labelled(thing: Any, table: Table) -> None:
    """A DataArray or a Dataset."""
    variables = thing.data_vars if hasattr(thing, "data_vars") else {thing.name or "values": thing}
    for name, values in (*thing.coords.items(), *variables.items()):
        unit = values.attrs.get("units", "")
        _add(f"{name} [{unit}]" if isinstance(unit, str) and unit else str(name), values, table)
    for name, value in thing.attrs.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            table.columns.setdefault(str(name), np.array([value]))


def _index(index: Any, table: Table) -> None:
    """The row labels of pandas."""
    values = np.asarray(index)
    if index.name is not None or values.dtype.kind in "mM":
        _add("time" if index.name is None else _words(index.name), values, table)


def _add(name: str, values: ArrayLike, table: Table) -> None:
    """Keep one array; instants become seconds from the first."""
    array: NDArray[np.generic] = np.asarray(values)
    if array.dtype.kind in "mM" and array.ndim == 1 and array.size:
        keep(f"{name} [s]", (array - array[0]) / np.timedelta64(1, "ns") * 1e-9, table)
        return
    if array.dtype.kind == "O" and array.size:  # numbers with gaps, or texts
        try:
            array = array.astype(float)
        except (TypeError, ValueError):
            if array.size <= MOST_TEXTS:
                table.texts[name] = [str(item) for item in array.reshape(-1)]
            return
    keep(name, array, table)


def _words(name: object) -> str:
    """A name of one or several levels."""
    parts = cast("tuple[object, ...]", name) if isinstance(name, tuple) else (name,)
    return " ".join(str(part) for part in parts)
