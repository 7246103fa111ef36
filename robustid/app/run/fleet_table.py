"""The table of a fleet: a row for each machine, as CSV or as Parquet, written while the rows are read."""

from __future__ import annotations

import csv
import importlib
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from robustid.core import atomic_write
from robustid.errors import InputError
from robustid.guarantees import FleetRow

ENDINGS = (".csv", ".parquet")
_AT_ONCE = 1000  # rows of a group in a Parquet file
_NUMBERS = {"order": "int64", "faults": "int64"} | dict.fromkeys(
    ("margin", "error", "error_hz", "relative", "peak", "peak_hz", "seconds"), "float64"
)


def check_table(path: Path) -> None:
    """Refuse a table that could not be written, before anything is computed."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"--table {path} must end in {' or '.join(ENDINGS)}", argument="table", got=str(path))
    if path.suffix.lower() == ".parquet":
        _arrow()


def write_table(path: Path, rows: Iterable[FleetRow]) -> None:
    """Write the rows, one after the other."""
    if path.suffix.lower() == ".parquet":
        _write_parquet(path, rows)
        return
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(FleetRow._fields)
        writer.writerows(_values(row) for row in rows)


def _values(row: FleetRow) -> list[object]:
    """Cells of a row: nothing where there is no number."""
    return [None if one != one else one for one in row._replace(state=row.state.value)]  # type: ignore[arg-type]


def _write_parquet(path: Path, rows: Iterable[FleetRow]) -> None:
    arrow, parquet = _arrow()
    schema = arrow.schema([(name, _NUMBERS.get(name, "string")) for name in FleetRow._fields])
    coming: Iterator[FleetRow] = iter(rows)
    with atomic_write(path, "wb") as file, parquet.ParquetWriter(file, schema) as writer:
        while group := [_values(row) for row in itertools.islice(coming, _AT_ONCE)]:
            columns = dict(zip(FleetRow._fields, map(list, zip(*group, strict=True)), strict=True))
            writer.write_table(arrow.table(columns, schema))


def _arrow() -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            "--table in Parquet needs pyarrow, which is not installed: pip install 'robustid[parquet]'; or give NAME.csv",
            argument="table",
        ) from None
