"""Arrays of a file that are input and output of a record each, by their names: u1, y1, u2, y2, or a.u, a.y of structures."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from robustid.formats.role_names import NAMES
from robustid.formats.table import Table

# Structure, role and number of a name such as "run.u", "u_2", "input3".
_NAME = re.compile(r"(?P<structure>.*\.)?(?P<role>[A-Za-z_ ]*?)_?(?P<number>\d*)")
_ROLES = {name.lower(): role for role in ("u", "y", "time", "dt", "rate") for name in NAMES[role]} | {"t": "time"}


class RecordPairs(NamedTuple):
    """Names of the arrays of every record by their roles; `apart` where they are of several records rather than of one.

    They are where structures hold them, where their lengths differ, or where each pair stands together in the file.
    """

    fields: tuple[dict[str, str], ...]
    apart: bool
    lengths: tuple[int, ...]

    @property
    def joined(self) -> dict[str, list[str]]:
        """The names of all of them as one record of several inputs and outputs; {} where their lengths differ."""
        if len(set(self.lengths)) != 1:
            return {}
        return {role: [one[role] for one in self.fields] for role in "uy"}


def record_pairs(table: Table) -> RecordPairs:
    """The pairs of arrays of a file that is no text: the columns of a text are of one time."""
    groups: dict[tuple[str, str], dict[str, str]] = {}
    lengths: dict[tuple[str, str], int] = {}
    for name, values in table.columns.items():
        found = _NAME.fullmatch(name)
        if table.text or found is None or not isinstance(values, np.ndarray) or np.iscomplexobj(values):
            continue
        structure = found["structure"] or ""
        role, key = _ROLES.get(found["role"].lower()), (structure, found["number"])
        if role is None or (values.size == 1) != (role in ("dt", "rate")):
            continue
        groups.setdefault(key, {}).setdefault(role, name)
        if role in ("u", "y"):
            lengths.setdefault(key, len(values) if values.size > max(values.shape) else values.size)
    pairs = {key: fields for key, fields in groups.items() if {"u", "y"} <= set(fields)}
    order = list(table.columns)
    places = [sorted(order.index(fields[role]) for role in "uy") for fields in pairs.values()]
    together = all(one[1] < other[0] for one, other in zip(sorted(places), sorted(places)[1:], strict=False))
    structures = len({structure for structure, _ in pairs}) > 1
    counts = tuple(lengths[key] for key in pairs)
    apart = len(pairs) > 1 and (together or structures or len(set(counts)) > 1)
    return RecordPairs(tuple(pairs.values()), apart, counts)
