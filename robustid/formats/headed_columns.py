"""Responses from columns whose headings say what they are: impedances, scattering parameters, matrices; their signs and units."""

from __future__ import annotations

import dataclasses
import re
from typing import NamedTuple

import numpy as np

from robustid.core import Options
from robustid.errors import FileFormatError, InputError
from robustid.formats import units
from robustid.formats.headings import Heading, heading, turned
from robustid.formats.role_names import UNSURE, axis_role
from robustid.formats.table import Table

_ORDER = "dqpn123456789"  # of outputs and inputs
_ROUNDED = 0.01  # of a phase, in rad: instruments write a tenth of a degree
AXES = ("omega", "freq_hz", f"{UNSURE}frequency")
_SCALES = {"Z": units.OHM, "Y": units.SIEMENS}
_SIGNALS = {"Z": (("voltage", "v", "V"), ("current", "i", "A")), "Y": (("current", "i", "A"), ("voltage", "v", "V")),
            "S": (("b", "b", ""), ("a", "a", ""))}  # fmt: skip
_SECONDS = re.compile(r"(s|sec|min|h)(\^?\d|\*\*\d|²)?")  # of a rate, not of an input
_QUOTIENT = re.compile(r"\(?([^()/]+|[^()]*\([^()]*\)[^()]*|[^()]+)\)?\s*/\s*([^()/]+)")


class Column(NamedTuple):
    """A column that is a part of a response."""

    name: str
    heading: Heading
    values: np.ndarray


Parts = dict[str, Column]  # by part, "decibels" for a magnitude in dB, "complex" for both


def from_headings(table: Table, kind: str | None) -> Table:
    """The response that the columns of a file make by their headings; a file that says none comes back as it is."""
    axis = next((name for name in table.columns if axis_role(name) in AXES), None)
    if kind not in (None, "frequency") or axis is None or "values" in table.columns:
        return table
    frequency = table.columns[axis]
    found = _quantities(table, frequency.size if isinstance(frequency, np.ndarray) else 0)
    for (quantity, _), entries in found.items():
        if not quantity and all(column.heading.sign > 0 and not _sides(column)[1] for column in entries[""].values()):
            continue  # without a quantity, a sign or the unit of an input the roles say as much
        complete = {entry: values for entry, parts in entries.items() if (values := complex_values(parts)) is not None}
        if not complete:
            continue
        _check_matrix(quantity, entries, set(complete))
        return _with_response(table, axis, quantity, complete, {entry: entries[entry] for entry in complete})
    for name, error in table.columns.items():
        if isinstance(error, FileFormatError) and (said := heading(name)) is not None and said.quantity and said.part:
            raise error  # a part is there, and holds text
    for (quantity, _), entries in found.items():
        if quantity and (alone := [column for parts in entries.values() for column in parts.values()]):
            raise InputError(
                f"{alone[0].name!r} is {alone[0].heading.words}, and what makes a response with it isn't there: export real and"
                " imaginary part, or magnitude and phase"
            )
    return table


def _quantities(table: Table, points: int) -> dict[tuple[str, str], dict[str, Parts]]:
    """Parts by quantity and entry, in the order of the file; what says no quantity belongs to the one that lacks it.

    Those that are no vector of so many points are something else; of those that stand there twice nothing says which is meant.
    """
    found: dict[tuple[str, str], dict[str, Parts]] = {}
    twice: set[tuple[str, str]] = set()
    for name, values in table.columns.items():
        if not isinstance(values, np.ndarray) or values.size != points or (said := heading(name)) is None:
            continue
        whole = np.iscomplexobj(values)
        if bool(said.part) == whole or (whole and not said.entry):
            continue
        key = (said.quantity, "")
        part = "decibels" if said.part == "magnitude" and said.decibels else said.part or "complex"
        parts = found.setdefault(key, {}).setdefault(said.entry, {})
        if part in parts and not np.array_equal(parts[part].values, values.reshape(-1)):
            twice.add(key)
        parts.setdefault(part, Column(name, said, values.reshape(-1)))
    found = {key: entries for key, entries in found.items() if key not in twice}
    named = [entries[""] for (quantity, _), entries in found.items() if quantity and set(entries) == {""}]
    if bare := found.get(("", ""), {}).get("", {}):
        lacking = [parts for parts in named if complex_values(parts) is None] or named
        if len(lacking) == 1 and not set(lacking[0]) & set(bare):
            lacking[0].update(bare)
            del found["", ""]
    return found


def complex_values(parts: Parts) -> np.ndarray | None:
    """The complex numbers that the parts make, with the signs that their names say; None where one is missing."""
    if "complex" in parts:
        return parts["complex"].values
    turn = None  # the phase, as a number of size 1
    if (phase := parts.get("phase")) and (scale := units.factor(units.PHASE, phase.heading.unit)) is not None:
        turn = np.exp(1j * phase.heading.sign * scale * phase.values)
    if {"real", "imag"} <= set(parts):
        real, imag = parts["real"], parts["imag"]
        values = real.heading.sign * real.values + 1j * imag.heading.sign * imag.values
        if phase and turn is not None and _turned(values, turn):
            raise InputError(
                f"{imag.name!r} and {phase.name!r} contradict each other: one of them is the negative of what its name says."
                " Name the columns that are right by `fields`, or write a minus before the name of the other"
            )
        return values
    size = parts.get("magnitude") or parts.get("decibels")
    if size is None or turn is None:
        return None
    magnitude = 10 ** (size.values / 20) if size.heading.decibels else size.values
    if np.any(magnitude < 0):
        raise InputError(f"{size.name!r} is a magnitude and has negative values: is it in dB?")
    return magnitude * turn


def _turned(values: np.ndarray, turn: np.ndarray) -> bool:
    """Return whether a phase is that of the conjugates rather than that of the values."""
    there = np.isfinite(values) & np.isfinite(turn) & (values != 0)
    unit = values[there] / np.abs(values[there])
    return bool(
        np.sum(np.abs(unit - turn[there])) > 4 * np.sum(np.abs(unit.conj() - turn[there])) + _ROUNDED * unit.size
    )


def _check_matrix(quantity: str, entries: dict[str, Parts], complete: set[str]) -> None:
    """All entries of the rows and columns that a matrix has, or say which are missing."""
    outputs, inputs = ({entry[k : k + 1] for entry in entries} for k in (0, 1))
    wanted = {row + column for row in outputs for column in inputs}
    if missing := sorted(wanted - complete):
        shown = ", ".join(quantity + entry for entry in missing)
        first = sorted(complete)[0]
        names = [entries[first][part].name for part in ("complex", "real", "imag", "magnitude", "decibels", "phase")
                 if part in entries[first]]  # fmt: skip
        verb = "are" if len(missing) > 1 else "is"
        raise InputError(
            f"the columns are entries of a matrix {quantity}, of which {shown} {verb} missing: export all,"
            f" or name one entry by `fields`; {quantity}{first} is in {', '.join(map(repr, names))}"
        )


def _with_response(
    table: Table, axis: str, quantity: str, values: dict[str, np.ndarray], used: dict[str, Parts]
) -> Table:
    """The table with the response as the usual array, and with what the file says of its signals."""
    outputs, inputs = (sorted({entry[k : k + 1] for entry in values}, key=_ORDER.index) for k in (0, 1))
    matrix = np.stack([values[row + column] for row in outputs for column in inputs], axis=-1)
    matrix = matrix.reshape(-1, len(outputs), len(inputs))
    parts = next(iter(used.values()))
    first = next(parts[part] for part in ("complex", "real", "magnitude", "decibels") if part in parts)
    unit = _unit(first)
    sizes = [column for one in used.values() for part, column in one.items() if part != "phase"]
    if other := next((column for column in sizes if _unit(column).lower() != unit.lower()), None):
        raise InputError(
            f"{first.name!r} is in {unit or 'no unit'} and {other.name!r} in {_unit(other) or 'no unit'}: export one unit"
        )
    scale = units.factor(_SCALES.get(quantity, {}), unit)
    matrix = matrix * (scale or 1.0)
    said = [column for entry in sorted(used) for column in _taken(used[entry])]
    of, names = f"{quantity} " if quantity else "", [column.name for column in said]
    how = f"{table.how}; response {of}from {', '.join(map(repr, names[:4]))}" + " …" * (len(names) > 4)
    how += turned(names)
    signals = _signals(quantity, outputs, inputs, _sides(first), scale)
    facts: Options = dict(zip(("outputs", "inputs"), signals, strict=True))
    columns = {**table.columns, "values": matrix}
    frequency = table.columns[axis]
    if isinstance(frequency, np.ndarray) and frequency.size == len(matrix):
        idle = (frequency.reshape(-1) == 0) & ~np.any(matrix.reshape(len(matrix), -1), axis=1)
        if np.any(idle) and not np.all(idle):
            how += f"; {int(idle.sum())} rows without frequency and response left out"
            columns = {name: one[~idle] if isinstance(one, np.ndarray) and one.shape[:1] == idle.shape else one
                       for name, one in columns.items()}  # fmt: skip
    facts = {side: labels for side, labels in facts.items() if labels is not None}
    facts |= {"dt": None} if quantity in _SIGNALS else {}  # nothing is sampled in a network
    remarks = {**table.remarks, "values": "made of the others"}
    return dataclasses.replace(
        table, columns=columns, facts={**table.facts, "frequency": facts}, how=how, remarks=remarks
    )


def _taken(parts: Parts) -> list[Column]:
    """The columns of an entry that its values are made of."""
    if "complex" in parts:
        return [parts["complex"]]
    wanted = ("real", "imag") if {"real", "imag"} <= set(parts) else ("magnitude", "phase")
    wanted = wanted if wanted[0] in parts else ("decibels", "phase")
    return [parts[part] for part in wanted]


def _unit(column: Column) -> str:
    """Unit without its decibels: "dBOhm" are of Ohm."""
    return column.heading.unit[2:].lstrip(" ") if column.heading.decibels else column.heading.unit


def _sides(column: Column) -> tuple[str, str]:
    """Units of output and input: "g/N" is of both, "m/s" of the output alone, and that of a phase of none."""
    unit = "" if column.heading.part == "phase" else _unit(column)
    match = _QUOTIENT.fullmatch(unit)
    if match is None or _SECONDS.fullmatch(match[2].strip()):
        return unit, ""
    return match[1].strip(), match[2].strip()


def _signals(
    quantity: str, outputs: list[str], inputs: list[str], sides: tuple[str, str], scale: float | None
) -> tuple[list[tuple[str, str]] | None, list[tuple[str, str]] | None]:
    """Names and units of outputs and inputs; None where the headings say nothing of them."""
    if quantity in _SIGNALS:
        usual = _SIGNALS[quantity]
        own = [side[2] for side in usual] if scale is not None else ["/".join(filter(None, sides)), ""]
        names = ([word if not index else f"{letter}{'_' * index.isalpha()}{index}" for index in side]
                 for (word, letter, _), side in zip(usual, (outputs, inputs), strict=True))  # fmt: skip
        above, below = ([(name, one) for name in side] for side, one in zip(names, own, strict=True))
        return above, below
    above, below = sides
    if quantity in ("H", "G") or (below and not quantity):
        return [(f"y{row}", above) for row in outputs], [(f"u{column}", below) for column in inputs]
    return ([(quantity, above)], None) if quantity else (None, None)
