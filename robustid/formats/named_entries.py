"""Responses from columns that name output and input: "acc 1/force real [g/N]", "Im(x/F)", "y2/u1 dB", "y2/u1 phase [deg]"."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from robustid.formats import units
from robustid.formats.headed_columns import AXES, Column, Parts, complex_values
from robustid.formats.headings import PARTS, Heading
from robustid.formats.role_names import axis_role
from robustid.formats.table import Table

_UNITS = {"db": "magnitude", "deg": "phase", "rad": "phase"}  # words that say a part by its unit
_WORD = "|".join(sorted({**PARTS, **_UNITS}, key=len, reverse=True))
_NAMED = re.compile(
    rf"(?P<name>[^\[]+?)[\s_.:,(-]+(?P<part>{_WORD})\)?|(?P<first>{_WORD})[\s_.:,(-]+(?P<of>[^\[]+?)\)?", re.IGNORECASE
)
_QUOTIENT = re.compile(r"([^/]+)/([^/]+)")


def from_named_entries(table: Table) -> Table:
    """The response that columns make by the names of its signals; a file without such columns comes back as it is.

    All entries must be there, and every name, or every unit, a quotient: spectra of signals have the same columns.
    """
    axis = next((name for name in table.columns if axis_role(name) in AXES), None)
    if axis is None or "values" in table.columns:
        return table
    frequency = table.columns[axis]
    entries = _entries(table, frequency.size if isinstance(frequency, np.ndarray) else 0)
    outputs, inputs = (list(dict.fromkeys(key[k] for key in entries)) for k in (0, 1))
    values = [complex_values(entries.get((row, column), {})) for row in outputs for column in inputs]
    found = [one for one in values if one is not None]
    if not found or len(found) < len(values) or ("" in inputs and len(inputs) > 1):
        return table
    above = [(row, _side(entries[row, inputs[0]], 0)) for row in outputs]
    below = [(column or "u", _side(entries[outputs[0], column], 1)) for column in inputs]
    if inputs == [""] and not all(_side(parts, 1) for parts in entries.values()):
        return table
    matrix = np.stack(found, axis=-1).reshape(-1, len(outputs), len(inputs))
    names = [column.name for parts in entries.values() for column in parts.values()]
    return dataclasses.replace(
        table,
        columns={**table.columns, "values": matrix},
        facts={**table.facts, "frequency": {"outputs": above, "inputs": below}},
        how=f"{table.how}; response from {', '.join(map(repr, names[:4]))}" + " …" * (len(names) > 4),
        remarks={**table.remarks, "values": "made of the others"},
    )


def _entries(table: Table, points: int) -> dict[tuple[str, str], Parts]:
    """The parts of every output and input, the latter "" where names say none; nothing where a part is there twice."""
    entries: dict[tuple[str, str], Parts] = {}
    for name, values in table.columns.items():
        if not isinstance(values, np.ndarray) or np.iscomplexobj(values) or values.size != points:
            continue
        base, unit = units.in_brackets(name)
        if base.strip().lower() in PARTS:  # "Re(x/F)", whose brackets hold no unit
            base, unit = name, ""
        if (match := _NAMED.fullmatch(base.strip())) is None:
            continue
        word, entry = (match["part"] or match["first"]).lower(), (match["name"] or match["of"]).strip(" -_")
        part, unit = (_UNITS[word], word) if word in _UNITS else (PARTS[word], unit)
        quotient = _QUOTIENT.fullmatch(entry)
        signals = (quotient[1].strip(), quotient[2].strip()) if quotient else (entry, "")
        said = Heading("", "", part, unit, 1)
        part = "decibels" if part == "magnitude" and said.decibels else part
        parts = entries.setdefault(signals, {})
        if part in parts:
            return {}
        parts[part] = Column(name, said, values.reshape(-1))
    return entries


def _side(parts: Parts, side: int) -> str:
    """Unit of output (0) or input (1) by the unit of a part that is no phase: "g/N"."""
    found = [_QUOTIENT.fullmatch(one.heading.unit) for part, one in parts.items() if part != "phase"]
    return next((match[1 + side].strip() for match in found if match), "")
