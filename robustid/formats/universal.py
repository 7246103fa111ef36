"""Universal files, data set 58: responses and time histories, read through pyuff; responses written in the binary form."""

from __future__ import annotations

import io
import re
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from robustid.core import Complex, atomic_write
from robustid.data import FrequencyResponse
from robustid.errors import FileFormatError, Remedy
from robustid.formats.table import Table, missing, said
from robustid.formats.units import FREQUENCY, TIME, factor

_Set = dict[str, Any]  # a data set as pyuff gives it: numbers, texts and arrays by its names
_MARKS = re.compile(rb"    -1(?:[\r\n]|\Z| {74})")  # before and after every data set
_TIME_RESPONSE, _FRF = 1, 4
_FORCE = 13  # specific data type of an excitation; of its answer: displacement, velocity, acceleration
_ANSWERS = {8: "m", 11: "m/s", 12: "m/s^2"}
_WORDS = {8: "displacement", 11: "velocity", 12: "acceleration", _FORCE: "force"}
_ABSCISSA = {_TIME_RESPONSE: (17, TIME, "s"), _FRF: (18, FREQUENCY, "Hz")}
_FUNCTIONS = {_TIME_RESPONSE: "time response", _FRF: "frequency response"}
_ROLES = {_TIME_RESPONSE: ("time", "u", "y"), _FRF: ("freq_hz", "values")}
_MOST_LISTED = 20
_AXIS_OF_FREQUENCY, _AXIS_UNKNOWN = 18, 0
_COMPLEX = 6  # numbers of the ordinate: complex, double precision


def read_universal(path: Path) -> Table:
    """Functions at nodal degrees of freedom (data set 58): frequency responses and time histories."""
    try:
        import pyuff
    except ImportError:
        raise missing(path, "pyuff", "uff") from None
    if len(_MARKS.findall(path.read_bytes())) % 2:
        raise FileFormatError(f"{path.name}: a data set has no end; is the file cut off?")
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            file = pyuff.UFF(str(path))
            places = np.flatnonzero(np.asarray(file.get_set_types()) == 58)
            sets = [file._read_set(int(k)) for k in places]
    except Exception as error:  # pyuff raises plain Exception
        raise FileFormatError(
            f"{path.name} can't be read as a universal file ({said(error)}); is it cut off?"
        ) from None
    table = Table(path, {}, how="universal file, data sets 58")
    _check_counts(path, sets)
    for kind, assemble in ((_FRF, _responses), (_TIME_RESPONSE, _histories)):
        chosen = {k: s for k, s in enumerate(sets, start=1) if s["func_type"] == kind}
        if not chosen:
            continue
        try:
            assemble(table, list(chosen.values()), _abscissa(path, list(chosen.values()), kind))
        except FileFormatError as error:  # what is no one matrix or record is addressed one by one
            _one_by_one(table, chosen, kind, error)
    if not table.columns:
        kinds = sorted({s["func_type"] for s in sets})
        raise FileFormatError(
            f"{path.name} holds no frequency response (function type 4) and no time response (1) of data set 58;"
            f" function types there: {kinds or 'none'}. Is it cut off?"
        )
    return table


def _check_counts(path: Path, sets: list[_Set]) -> None:
    for s in sets:
        if len(s["data"]) != s["num_pts"] or len(s["x"]) != s["num_pts"]:
            raise FileFormatError(
                f"{path.name}: {_name(s)} declares {s['num_pts']} points and has {len(s['data'])}; is the file cut off?"
            )


def _one_by_one(table: Table, sets: dict[int, _Set], kind: int, why: FileFormatError) -> None:
    """Axis and values of every function by its number in the file; the usual roles lead to a table of contents."""
    listed: list[str] = []
    for k, s in sets.items():
        unit = _unit(s["abscissa_axis_units_lab"]) or _ABSCISSA[kind][2]
        table.columns[f"{k}.x [{unit}]"], table.columns[f"{k}.y"] = np.asarray(s["x"]), np.asarray(s["data"])
        ends = f"{s['x'][0]:.5g} to {s['x'][-1]:.5g} {unit}" if len(s["x"]) else "none"
        listed.append(f"{k}: {_FUNCTIONS[kind]} {_dof(s, 'rsp')} / {_dof(s, 'ref')}, {len(s['x'])} points, {ends}")
    numbers = list(sets)
    if kind == _FRF:
        fields = {"freq_hz": f"{numbers[0]}.x", "values": f"{numbers[0]}.y"}
    else:
        fields = {"time": f"{numbers[0]}.x", "u": f"{numbers[0]}.y", "y": f"{numbers[1 % len(numbers)]}.y"}
    more = f"; and {len(listed) - _MOST_LISTED} more" if len(listed) > _MOST_LISTED else ""
    error = FileFormatError(
        f"{why}. Or take functions by their numbers, such as ",
        Remedy({"fields": fields}),
        f". The file has {'; '.join(listed[:_MOST_LISTED])}{more}",
        place=table.path.name,
    )
    table.columns.update(dict.fromkeys(_ROLES[kind], error))


def _abscissa(path: Path, sets: list[_Set], kind: int) -> np.ndarray:
    """The common axis in Hz or s."""
    expected, units, standard = _ABSCISSA[kind]
    x, unit = np.asarray(sets[0]["x"]), _unit(sets[0]["abscissa_axis_units_lab"])
    for s in sets:
        here = _unit(s["abscissa_axis_units_lab"]), s["abscissa_spec_data_type"]
        if here != (unit, sets[0]["abscissa_spec_data_type"]):
            raise FileFormatError(
                f"{path.name}: the functions have axes of different units; store them in different files"
            )
        if not np.array_equal(s["x"], x):
            raise FileFormatError(
                f"{path.name}: {_name(s)} has another axis than {_name(sets[0])}; store one axis a file"
            )
    if not unit and sets[0]["abscissa_spec_data_type"] == expected:
        unit = standard  # without a label, the standard's
    scale = factor(units, unit)
    if scale is None:
        raise FileFormatError(
            f"{path.name}: the axis has the data type {sets[0]['abscissa_spec_data_type']} and the unit {unit!r}, which isn't"
            f" {'a frequency' if kind == _FRF else 'a time'}; store {standard}"
        )
    return x * (scale / units[standard])


def _responses(table: Table, sets: list[_Set], freq_hz: np.ndarray) -> None:
    """One function an entry of the matrix: responses are the outputs, references the inputs."""
    entries: dict[tuple[str, str], _Set] = {}
    for s in sets:
        key = (_dof(s, "rsp"), _dof(s, "ref"))
        if key in entries:
            raise FileFormatError(f"{table.path.name}: {_name(s)} is there twice; keep one of them")
        entries[key] = s
    outputs, inputs = (list(dict.fromkeys(key[side] for key in entries)) for side in (0, 1))
    if missing := [f"{i} / {j}" for i in outputs for j in inputs if (i, j) not in entries]:
        raise FileFormatError(
            f"{table.path.name}: of {len(outputs)} outputs and {len(inputs)} inputs the entries {', '.join(missing[:5])}"
            f"{' ...' if len(missing) > 5 else ''} are missing; store a full matrix"
        )
    values = np.empty((len(freq_hz), len(outputs), len(inputs)), complex)
    units: dict[str, dict[str, str]] = {"out": {}, "in": {}}
    for (i, j), s in entries.items():
        values[:, outputs.index(i), inputs.index(j)] = s["data"]
        for side, name, part in (("out", i, "ordinate"), ("in", j, "orddenom")):
            unit = _unit(s[f"{part}_axis_units_lab"])
            if units[side].setdefault(name, unit) != unit:
                raise FileFormatError(
                    f"{table.path.name}: {name} is in {units[side][name]!r} in one function and in {unit!r} in another"
                )
    table.columns.update(freq_hz=freq_hz, values=values)
    table.facts["frequency"] = {
        "outputs": [(name, units["out"][name]) for name in outputs],
        "inputs": [(name, units["in"][name]) for name in inputs],
    }


def _histories(table: Table, sets: list[_Set], time: np.ndarray) -> None:
    """Signals by the names of their degrees of freedom; forces are inputs where all types are told."""
    names = [_dof(s, "rsp") for s in sets]
    if len(set(names)) != len(names):
        raise FileFormatError(f"{table.path.name}: the signals {names} are not all different; store one record a file")
    if any(np.iscomplexobj(s["data"]) for s in sets):
        raise FileFormatError(f"{table.path.name}: a time response is complex; store real samples")
    table.columns.update({name: np.asarray(s["data"]) for name, s in zip(names, sets, strict=True)}, time=time)
    for name, s in zip(names, sets, strict=True):
        if (kind := s["ordinate_spec_data_type"]) in _WORDS:
            table.remarks[name] = f"{_WORDS[kind]} {_unit(s['ordinate_axis_units_lab'])}".strip()
    types = [s["ordinate_spec_data_type"] for s in sets]
    if all(kind == _FORCE or kind in _ANSWERS for kind in types):
        sides = {
            "u": [k for k, t in enumerate(types) if t == _FORCE],
            "y": [k for k, t in enumerate(types) if t != _FORCE],
        }
        if all(sides.values()):
            facts = table.facts.setdefault("time", {})
            for role, side in (("u", "inputs"), ("y", "outputs")):
                table.columns[role] = np.column_stack([sets[k]["data"] for k in sides[role]])
                facts[side] = [(names[k], _unit(sets[k]["ordinate_axis_units_lab"])) for k in sides[role]]


def _dof(s: _Set, side: str) -> str:
    """Node and direction, such as 12Z+."""
    direction = int(s[f"{side}_dir"])
    axis = ["", "X", "Y", "Z", "RX", "RY", "RZ"][abs(direction)] if abs(direction) <= 6 else f"D{abs(direction)}"
    return f"{s[f'{side}_node']}{axis}{'' if direction == 0 else '+' if direction > 0 else '-'}"


def _name(s: _Set) -> str:
    return f"the function {_dof(s, 'rsp')} / {_dof(s, 'ref')}"


def _unit(label: str) -> str:
    return "" if label.strip().upper() == "NONE" else label.strip()


def write_universal(path: Path, frf: FrequencyResponse) -> None:
    """Write all entries, in the binary form, which keeps all digits; bounds have no place in the format."""
    frf.require_complete("a universal file")
    with atomic_write(path, "wb") as file:
        for output, input in np.ndindex(frf.values.shape[1:]):
            value: Complex = frf.values[:, output, input]
            numbers = np.stack([frf.freq_hz, value.real, value.imag], axis=1).astype("<f8").tobytes()
            title = f"{frf.outputs[output]} / {frf.inputs[input]}"
            lines = [
                f"{'58b':>7}{1:6d}{2:6d}{11:12d}{len(numbers):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
                *(f"{text[:80]:<80}" for text in (title, "written by robustid", "NONE", "NONE", "NONE")),
                f"{_FRF:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{output + 1:10d}{1:4d} {'NONE':<10}{input + 1:10d}{1:4d}",
                f"{_COMPLEX:10d}{value.size:10d}{0:10d}{0.0:13.5e}{0.0:13.5e}{0.0:13.5e}",
                _axis(_AXIS_OF_FREQUENCY, "Frequency", "Hz"),
                _axis(_AXIS_UNKNOWN, frf.outputs[output].name, frf.outputs[output].unit),
                _axis(_AXIS_UNKNOWN, frf.inputs[input].name, frf.inputs[input].unit),
                _axis(_AXIS_UNKNOWN, "NONE", "NONE"),
            ]
            text = "\n".join(["    -1", *lines, ""])
            file.write(text.encode("ascii", "replace") + numbers + b"\n    -1\n")


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label[:20]:<20} {(unit or 'NONE')[:20]:<20}"
