"""Exchange formats of measurement systems, each through a library of its own: universal files (58) and Touchstone."""

from __future__ import annotations

import io
import os
import re
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from robustid.data.io.table import Table, said
from robustid.data.io.units import FREQUENCY, TIME, factor
from robustid.errors import FileFormatError

_MARKS = re.compile(rb"    -1(?:[\r\n]|\Z| {74})")  # before and after every data set
_TIME_RESPONSE, _FRF = 1, 4
_FORCE = 13  # specific data type of an excitation; of its answer: displacement, velocity, acceleration
_ANSWERS = {8: "m", 11: "m/s", 12: "m/s^2"}
_ABSCISSA = {_TIME_RESPONSE: (17, TIME, "s"), _FRF: (18, FREQUENCY, "Hz")}


def _missing(path: Path, package: str, extra: str) -> FileFormatError:
    return FileFormatError(
        f"{path.name}: this format is read through the package {package}, which isn't installed here:"
        f" pip install 'robustid[{extra}]'"
    )


def read_universal(path: Path) -> Table:
    """Functions at nodal degrees of freedom (data set 58): frequency responses and time histories."""
    try:
        import pyuff
    except ImportError:
        raise _missing(path, "pyuff", "uff") from None
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
    for kind, assemble in ((_FRF, _responses), (_TIME_RESPONSE, _histories)):
        chosen = [s for s in sets if s["func_type"] == kind]
        if chosen:
            assemble(table, chosen, _abscissa(path, chosen, kind))
    if not table.columns:
        kinds = sorted({s["func_type"] for s in sets})
        raise FileFormatError(
            f"{path.name} holds no frequency response (function type 4) and no time response (1) of data set 58;"
            f" function types there: {kinds or 'none'}. Is it cut off?"
        )
    return table


def _abscissa(path: Path, sets: list[dict[str, Any]], kind: int) -> np.ndarray:
    """The common axis in Hz or s."""
    expected, units, standard = _ABSCISSA[kind]
    x, unit = np.asarray(sets[0]["x"]), _unit(sets[0]["abscissa_axis_units_lab"])
    for s in sets:
        if len(s["data"]) != s["num_pts"] or len(s["x"]) != s["num_pts"]:
            raise FileFormatError(
                f"{path.name}: {_name(s)} declares {s['num_pts']} points and has {len(s['data'])}; is the file cut off?"
            )
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


def _responses(table: Table, sets: list[dict[str, Any]], freq_hz: np.ndarray) -> None:
    """One function an entry of the matrix: responses are the outputs, references the inputs."""
    entries: dict[tuple[str, str], dict[str, Any]] = {}
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


def _histories(table: Table, sets: list[dict[str, Any]], time: np.ndarray) -> None:
    """Signals by the names of their degrees of freedom; forces are inputs where all types are told."""
    names = [_dof(s, "rsp") for s in sets]
    if len(set(names)) != len(names):
        raise FileFormatError(f"{table.path.name}: the signals {names} are not all different; store one record a file")
    if any(np.iscomplexobj(s["data"]) for s in sets):
        raise FileFormatError(f"{table.path.name}: a time response is complex; store real samples")
    table.columns.update({name: np.asarray(s["data"]) for name, s in zip(names, sets, strict=True)}, time=time)
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


def _dof(s: dict[str, Any], side: str) -> str:
    """Node and direction, such as 12Z+."""
    direction = int(s[f"{side}_dir"])
    axis = ["", "X", "Y", "Z", "RX", "RY", "RZ"][abs(direction)] if abs(direction) <= 6 else f"D{abs(direction)}"
    return f"{s[f'{side}_node']}{axis}{'' if direction == 0 else '+' if direction > 0 else '-'}"


def _name(s: dict[str, Any]) -> str:
    return f"the function {_dof(s, 'rsp')} / {_dof(s, 'ref')}"


def _unit(label: str) -> str:
    return "" if label.strip().upper() == "NONE" else label.strip()


def _touchstone_lines(path: Path) -> int:
    """Count the lines that begin a frequency: those with an odd number of numbers. Refuses what would allocate without end."""
    size, odd, options = os.path.getsize(path), 0, 0
    ports = re.fullmatch(r"\.[sgyzh](\d+)p", path.suffix.lower())
    stated = [int(ports[1][:9])] if ports else []
    with path.open(encoding="latin-1") as file:
        for line in file:
            words = line.partition("!")[0].split()
            options += line.lstrip().startswith("#")
            if words[:3] and line.lstrip().lower().startswith(("[number of ports]", "[number of noise")):
                stated += [int(word[:9]) for word in words[-1:] if word.isdigit()]
            elif words and words[0][0] not in "#[":
                odd += len(words) % 2
    if not options:
        raise FileFormatError(
            f"{path.name} has no option line such as '# Hz S RI R 50', which says the unit of its frequencies"
        )
    if any(4 * n * n > size for n in stated[:1]) or any(n > size for n in stated):
        raise FileFormatError(f"{path.name} declares {max(stated)} ports and has {size} bytes only; is it cut off?")
    return odd


def read_touchstone(path: Path) -> Table:
    """S-parameters: outgoing waves b from incoming waves a."""
    try:
        from skrf.io.touchstone import Touchstone
    except ImportError:
        raise _missing(path, "scikit-rf", "touchstone") from None
    counts = _touchstone_lines(path)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = Touchstone(str(path))
    except Exception as error:  # scikit-rf raises whatever the broken bytes lead it to
        raise FileFormatError(
            f"{path.name} can't be read as Touchstone ({said(error)}); is it cut off, or the number of ports in its"
            " ending wrong?"
        ) from None
    if file.parameter != "s":
        raise FileFormatError(
            f"{path.name} holds {str(file.parameter).upper()}-parameters; convert them to S-parameters (scikit-rf does) first"
        )
    lines, ports = len(file.f), int(file.rank or 0)
    rows = 0 if file.noise is None else len(file.noise)
    if not lines or counts != lines + rows:
        raise FileFormatError(
            f"{path.name}: {counts} lines begin a frequency where {lines} frequencies of {ports} x {ports} parameters were"
            " read; is the file cut off, or the number of ports in its ending wrong?"
        )
    table = Table(path, {"freq_hz": np.asarray(file.f), "values": np.asarray(file.s)}, how="Touchstone, S-parameters")
    table.facts["frequency"] = {
        side: [f"{wave}{k + 1}" for k in range(ports)] for side, wave in (("inputs", "a"), ("outputs", "b"))
    }
    return table
