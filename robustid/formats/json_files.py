"""Numbers in a JSON object: lists by their names."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from robustid.errors import FileFormatError
from robustid.formats.table import Table
from robustid.formats.tables_in_memory import table_of


def read_json(path: Path) -> Table:
    """Lists of numbers, lists of such lists, numbers and texts of one object, by their names."""
    try:
        found = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path.name} can't be read as JSON ({error}); is the file cut off?") from None
    try:
        table = table_of(found) if isinstance(found, dict) else None
    except ValueError:  # lists of different lengths
        table = None
    if table is None:
        raise FileFormatError(
            f'{path.name} is JSON, of which one object with lists of numbers is read: {{"dt": 0.001, "u": [...], "y": [...]}}'
        )
    return dataclasses.replace(table, path=path, how="JSON")
