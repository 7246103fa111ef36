"""Arrays of a file that are input and output of a record each, by their names: u1, y1, u2, y2; a.u, a.y; uEst, yEst, uVal, yVal."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from robustid.formats.role_names import NAMES
from robustid.formats.table import Table

# Structure, role and number of a name such as "run.u", "u_2", "input3".
_NAME = re.compile(r"(?P<structure>.*\.)?(?P<role>[A-Za-z_ ]*?)_?(?P<number>\d*)")
_ROLES = {name.lower(): role for role in ("u", "y", "time", "dt", "rate") for name in NAMES[role]} | {
    "t": "time",
    "z": "z",
}
_SIDE = "u|y|z|in|out|input|output"
_WORDS = (rf"(?P<role>{_SIDE})(?P<word>[A-Z]\w*|_[A-Za-z]\w*)", rf"(?P<word>[A-Za-z]\w*_)(?P<role>{_SIDE})",
          r"(?P<role>[uyz])(?P<word>[a-z]{2,})")  # fmt: skip
_USES = {"est", "estimation", "val", "validation", "train", "training", "test", "testing", "id", "ident", "identification",
         "learn", "learning"}  # words for what a record is for  # fmt: skip


_SIGNALS = ("u", "y", "z")


class _Key(NamedTuple):
    """Parts of a name that both arrays of a pair have in common."""

    structure: str = ""
    number: str = ""
    word: str = ""


class RecordPairs(NamedTuple):
    """Names of the arrays of every record by their roles; `apart` where they are of several records rather than of one.

    They are where structures hold them, where their lengths differ, or where each pair stands together in the file.
    """

    fields: tuple[dict[str, str], ...]
    apart: bool
    lengths: tuple[int, ...]
    uses: bool = False  # their names say what each record is for

    @property
    def joined(self) -> dict[str, list[str]]:
        """The names of all of them as one record of several inputs and outputs; {} where they can't be one."""
        if self.uses or len(set(self.lengths)) != 1:
            return {}
        return {role: [one[role] for one in self.fields] for role in "uy"}


def record_pairs(table: Table) -> RecordPairs:
    """The pairs of arrays of a file; of a text, whose columns are of one time, those alone whose names say what each is for."""
    groups: dict[_Key, dict[str, str]] = {}
    lengths: dict[_Key, int] = {}
    for name, values in table.columns.items():
        if (
            not isinstance(values, np.ndarray)
            or np.iscomplexobj(values)
            or (key_role := _named(name, table.text)) is None
        ):
            continue
        role, key = key_role
        if (values.size == 1) != (role in ("dt", "rate")):
            continue
        groups.setdefault(key, {}).setdefault(role, name)
        if role in _SIGNALS:
            lengths.setdefault(key, len(values) if values.size > max(values.shape) else values.size)
    for fields in groups.values():
        if (z := fields.pop("z", "")) and "u" in fields:
            fields.setdefault("y", z)
    pairs = {key: fields for key, fields in groups.items() if {"u", "y"} <= set(fields)}
    if len(pairs) > 1:  # u_d, u_q, y_d, y_q are signals of one record
        pairs = {key: fields for key, fields in pairs.items() if not key.word or _is_use(key.word)}
    order = list(table.columns)
    places = [sorted(order.index(fields[role]) for role in "uy") for fields in pairs.values()]
    together = all(one[1] < other[0] for one, other in zip(sorted(places), sorted(places)[1:], strict=False))
    structures = len({(key.structure, key.word) for key in pairs}) > 1
    counts = tuple(lengths[key] for key in pairs)
    apart = len(pairs) > 1 and (together or structures or len(set(counts)) > 1)
    return RecordPairs(tuple(pairs.values()), apart, counts, uses=any(key.word for key in pairs))


def _named(name: str, text: bool) -> tuple[str, _Key] | None:
    """Role of an array and the rest of its name; None where it has none."""
    found = _NAME.fullmatch(name)
    if found is not None and not text and (role := _ROLES.get(found["role"].lower())):
        return role, _Key(found["structure"] or "", found["number"])
    for pattern in _WORDS:
        if found := re.fullmatch(pattern, name):
            word = found["word"].strip("_").lower()
            if _is_use(word) or not text:
                return _ROLES[{"in": "u", "out": "y"}.get(found["role"], found["role"])], _Key(word=word)
    return None


def _is_use(word: str) -> bool:
    """Return whether a word says what a record is for, "est" or "validation"."""
    return word.rstrip("0123456789_") in _USES
