"""The line that makes a file readable, where its names don't say what is what: an example with the addresses of its arrays."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from robustid.data import uniform_step
from robustid.errors import FileFormatError, InputError, Remedy
from robustid.formats import units
from robustid.formats.addresses import parse, written
from robustid.formats.headings import PARTS
from robustid.formats.readers import read_table
from robustid.formats.record_pairs import record_pairs
from robustid.formats.role_names import UNSURE, axis_role, speaks_of_frequency
from robustid.formats.table import NAMELESS, Table

_ACTING = ("n", "kn", "mn", "nm", "n m", "n*m", "mnm", "a", "ma", "v", "mv")  # units of what drives a machine
_DRIVES = {"force", "torque", "current", "voltage", "pwm", "duty", "drive", "command", "cmd", "actuator", "effort", "throttle",
           "heater", "heating", "valve", "input"}  # words for it  # fmt: skip
_REFERENCES = {"reference", "ref", "setpoint", "sollwert", "soll", "desired", "target", "demand"}
_MOST_SIGNALS = 12  # a matrix with more columns is hardly one of signals
_CARTESIAN = ("real", "imag")
_PARTS_WORDS = "'values' (complex), 'real' and 'imag', or 'magnitude' or 'magnitude_db' and 'phase_deg' or 'phase_rad'"
_RECORD = "As a time record, if these are its inputs and outputs: "
_SIDES = {"u": "its input", "y": "its output"}
_PAIRS = (("u", "y"), ("y", "u"), ("in", "out"), ("out", "in"), ("input", "output"), ("output", "input"),
          ("inputs", "outputs"), ("outputs", "inputs"))  # fmt: skip


def example(table: Table, *, dt: bool) -> list[str | Remedy]:
    """Sentences with arguments that `load` takes, as far as the arrays can be signals; else none. `dt`: it must be given."""
    if pairs := record_pairs(table).fields:
        return [_RECORD, *_given(dict(pairs[0]), dt and not {"time", "dt", "rate"} & set(pairs[0])), "."]
    array = table.columns.get(NAMELESS)
    if isinstance(array, np.ndarray) and array.ndim > 2:
        return _axes(table, array, dt)
    columns = list(_columns(table))
    if not columns:
        return []
    if len(columns) == 1 and _kind(columns[0][0]) == "time":
        others = _beside(table.path)[2]
        fields = {"time": columns[0][0], "u": others, "y": others}
        return ["As the time of a record with its signals in another file: ", Remedy({"fields": fields}), "."]
    lengths = [len(values) for _, values in columns]
    length = max(set(lengths), key=lambda count: (lengths.count(count), count))
    columns = [(address, values) for address, values in columns if len(values) == length]
    spoken = (column for column in columns if _kind(column[0]) == "frequency" or speaks_of_frequency(column[0]))
    frequency = next((column for column in spoken if _runs(column[1])), None)  # the speed of a motor is no axis
    timed = (column for column in columns if axis_role(column[0]) == "time")
    first = frequency or next(timed, columns[0])
    enough = len(columns) > 2 or (len(columns) == 2 and _kind(first[0]) is not None) or _complex(columns[1:])
    axis = first if enough and (frequency is not None or _increases(first[1])) else None
    rest = [address for address, _ in columns if axis is None or address != axis[0]]
    words: list[str | Remedy] = []
    if frequency is None and not _complex(columns):
        signals = [address for address, values in columns if address in rest and not _counts(address, values)]
        time = None if axis is not None and _counts(*axis) else axis
        words += _time(table, time, signals, dt) if len(signals) > 1 else _time(table, axis, rest, dt)
    parts = _parts([column for column in columns if column[0] in rest], axis if frequency is None else None)
    if _kind(first[0]) != "time" and parts:
        words += [*[" "] * bool(words), *_frequency(axis, parts)]
    elif frequency is not None:
        words.append(f"As a frequency response: say by `fields` which columns are {_PARTS_WORDS}.")
    return words


def _kind(address: str) -> str | None:
    """Frequency or time, as far as the name of an axis or its unit says."""
    role, unit = axis_role(address) or "", units.in_brackets(address)[1]
    if role in ("omega", "freq_hz", f"{UNSURE}frequency") or (unit and units.factor(units.FREQUENCY, unit)):
        return "frequency"
    return "time" if role == "time" or (unit and units.factor(units.TIME, unit)) else None


def names_axis(address: str) -> bool:
    """Return whether the name of a column says that it is frequency or time."""
    name = address if (found := parse(address)) is None else found.name
    return _kind(name) is not None or speaks_of_frequency(name)


def _counts(address: str, values: np.ndarray) -> bool:
    """Return whether a column numbers the rows: it is no signal, and no time."""
    return _kind(address) is None and np.isrealobj(values) and bool(np.all(np.diff(values.astype(float)) == 1))


def _complex(columns: list[tuple[str, np.ndarray]]) -> bool:
    return any(np.iscomplexobj(values) for _, values in columns)


def _parts(columns: list[tuple[str, np.ndarray]], axis: tuple[str, np.ndarray] | None) -> dict[str, object]:
    """Roles of the parts of a response, by names and units; the first two are an example where nothing says which are."""
    if _complex(columns):
        return {"values": next(address for address, values in columns if np.iscomplexobj(values))}
    names = [address for address, _ in columns]
    found: dict[str, list[str]] = {}
    for name in names:
        base, unit = (part.lower() for part in units.axis_label(name))
        scale = units.factor(units.PHASE, unit) if unit else None
        phase = "phase_rad" if scale == 1 else "phase_deg"
        part = PARTS.get(base.split()[-1], "") if base else ""
        role = "magnitude_db" if unit == "db" else phase if scale else part if part in _CARTESIAN else ""
        found.setdefault(role, []).append(name)
    others, levels = found.pop("", []), found.get("magnitude_db", [])
    if phase := next((role for role in found if role.startswith("phase")), None):
        size = "magnitude_db" if levels else "magnitude"
        pairs = [(level, angle) for angle in found[phase] for level in levels or others[:1]]
        # Of several the two of one signal, "Channel 2 Magnitude" and "Channel 2 Phase".
        same = [pair for pair in pairs if len(pairs) == 1 or len({_signal(name) for name in pair}) == 1]
        return {size: same[0][0], phase: same[0][1]} if same else {}
    if set(found) >= set(_CARTESIAN):
        return {role: found[role][0] for role in _CARTESIAN}
    return {"real": names[0], "imag": names[1]} if axis is not None and len(names) > 1 else {}


def _signal(name: str) -> str:
    """Name without its last word, which says the part."""
    return units.in_brackets(name)[0].lower().rpartition(" ")[0]


def _columns(table: Table) -> Iterator[tuple[str, np.ndarray]]:
    """Vectors that can be signals or axes, with their addresses."""
    for name, values in table.columns.items():
        if not isinstance(values, np.ndarray) or values.size < 2:
            continue
        if values.size == max(values.shape):
            yield ("[:]" if name == NAMELESS else name), values.reshape(-1)
        elif values.ndim >= 2 and values.shape[1] <= _MOST_SIGNALS < values.shape[0]:
            inner = (0,) * (values.ndim - 2)
            for k in range(values.shape[1]):
                yield written(name, (slice(None), k, *inner)), values[(slice(None), k, *inner)]
        elif values.ndim == 2 and values.shape[0] <= _MOST_SIGNALS < values.shape[1]:
            for k, row in enumerate(values):
                yield written(name, (k, slice(None))), row


def _runs(values: np.ndarray) -> bool:
    """Return whether the values rise or fall throughout, as those of an axis do."""
    return _increases(values) or _increases(values[::-1])


def _increases(values: np.ndarray) -> bool:
    return np.isrealobj(values) and bool(np.all(np.diff(values.astype(float)) > 0))


def _time(table: Table, axis: tuple[str, np.ndarray] | None, rest: list[str], dt: bool) -> list[str | Remedy]:
    """As a time record: the first half are inputs where nothing is named, else one, and outputs are those of one other unit.

    What drives a machine is no output beside what doesn't; what is wanted of it is the reference of a loop. Of numbered names
    those of the first kind are inputs, where all others are of one other kind; so are forces and currents. Names that have a
    word in common are of one kind, too.
    """
    fields: dict[str, object] = {}
    if axis is not None:
        role = axis_role(axis[0]) or ""
        if role.startswith(UNSURE) or (role != "time" and not _is_uniform(axis[1].astype(float))):
            return []
        fields["time"], dt = axis[0], False
    if len(rest) == 1:
        return _alone(table, rest[0], fields, dt)
    wanted = [name for name in rest if _words(name) & _REFERENCES]
    if wanted and len(rest) - len(wanted) > 1:
        fields["reference"], rest = _one(wanted), [name for name in rest if name not in wanted]
    if not _drives(rest[0]):
        rest = sorted(rest, key=_drives, reverse=True)
    half = len(rest) // 2 if len(rest) <= _MOST_SIGNALS and all("[:," in name or ",:]" in name for name in rest) else 1
    outputs, unit = rest[half : 2 * half], units.in_brackets(rest[half])[1]
    if half == 1 and unit and unit != units.in_brackets(rest[0])[1]:
        outputs = [name for name in rest[1:] if units.in_brackets(name)[1] == unit]
    elif half == 1 and _kin(rest[1:]) and not _kin(rest):
        outputs = rest[1:]
    inputs = rest[:half]
    if half == 1 and (alike := _alike(rest)) and (others := rest[alike:]) and _another(rest[0], others):
        inputs, outputs = rest[:alike], others
    elif half == 1 and (alike := _families(rest) or _acting(rest)):
        inputs, outputs = rest[:alike], rest[alike:]
    fields |= {"u": _one(inputs), "y": _one(outputs)}
    left = [name for name in rest if name not in inputs + outputs]
    return [_RECORD, *_given(fields, dt), f", without {', '.join(left)}." if left else "."]


def _is_uniform(instants: np.ndarray) -> bool:
    try:
        uniform_step(instants, instants.size)
    except InputError:
        return False
    return True


def _words(name: str) -> set[str]:
    return set(re.split(r"[\W_\d]+", units.in_brackets(name)[0].lower()))


def _drives(name: str) -> bool:
    """Return whether the name or the unit of a signal is one of what drives a machine."""
    return bool(_words(name) & _DRIVES) or units.in_brackets(name)[1].lower() in _ACTING


def _alike(names: list[str]) -> int:
    """Number of names at the beginning that differ in their number alone, "F1 (N)" and "F2 (N)"; 0 for one."""
    plain = [re.sub(r"\d+", "", name) for name in names]
    same = next((k for k, name in enumerate(plain) if name != plain[0]), len(plain))
    return same if same > 1 and len(set(names)) == len(names) else 0


def _another(name: str, others: list[str]) -> bool:
    """Return whether others are numbered names of one kind, or have other units all."""
    unit = units.in_brackets(name)[1]
    apart = unit and all(units.in_brackets(other)[1] not in ("", unit) for other in others)
    return _alike(others) == len(others) or bool(apart)


def _kin(names: list[str]) -> bool:
    """Return whether names have their first word in common, or their last: w_motor and w_load, "x position" and "y position"."""
    words = [re.split(r"[\W_]+", units.in_brackets(name)[0].strip().lower()) for name in names]
    return all(len(one) > 1 for one in words) and any(len({one[end] for one in words}) == 1 for end in (0, -1))


def _families(names: list[str]) -> int:
    """Number of names of one kind at the beginning before others of one other kind, v_d and v_q before i_d and i_q; 0 for none."""
    parts = range(2, len(names) - 1)
    return 0 if _kin(names) else next((k for k in parts if _kin(names[:k]) and _kin(names[k:])), 0)


def _acting(names: list[str]) -> int:
    """Number of names at the beginning of one unit that inputs have, before others of one other unit; 0 where they are none."""
    each = [units.in_brackets(name)[1] for name in names]
    same = next((k for k, unit in enumerate(each) if unit != each[0]), len(each))
    return same if each[0].lower() in _ACTING and len(set(each)) == 2 and len(set(each[same:])) == 1 else 0


def _alone(table: Table, name: str, fields: dict[str, object], dt: bool) -> list[str | Remedy]:
    """One signal: the other is in another file."""
    mine, other, sibling = _beside(table.path)
    pair = {mine: name, other: sibling}
    given = _given(fields | {r: pair[r] for r in "uy"}, dt)
    return [f"As a time record with {_SIDES[other]} in another file: ", *given, "."]


def _axes(table: Table, array: np.ndarray, dt: bool) -> list[str | Remedy]:
    """An array of several axes: their order must be said."""
    mine, other, sibling = _beside(table.path)
    pair, order = {mine: "[:]", other: sibling}, ",".join(("time", "signal", "realisation", "period")[: array.ndim])
    given = _given({r: pair[r] for r in "uy"}, dt, axes=order)
    return [f"With {_SIDES[other]} in another file, and the axes in their order: ", *given, "."]


def _beside(path: Path) -> tuple[str, str, str]:
    """Role that the name of a file says, the other role, and the array for that in the file beside it, which may be there."""
    for word, other in _PAIRS:
        apart = rf"(?<![a-z]){word}(?![a-z])" if len(word) < len("input") else word
        first = rf"^{word}(?=[a-z])" if len(word) == 1 else apart  # "uval.mat" and "yval.mat"
        for pattern in (apart, first):
            name = re.sub(pattern, other, path.name, flags=re.IGNORECASE)
            if name != path.name and (file := path.with_name(name)).is_file():
                mine = "u" if word in ("u", "in", "input", "inputs") else "y"
                return mine, "y" if mine == "u" else "u", name + _only_array(file)
    return "y", "u", f"OTHER{path.suffix}" + ("" if path.suffix == ".npy" else ":NAME")


def _only_array(path: Path) -> str:
    """Behind the name of a file, its only array; NAME where it has several."""
    if path.suffix == ".npy":
        return ""
    try:
        addresses = [address for address, _ in _columns(read_table(path))]
    except FileFormatError:
        addresses = []
    only = addresses[0] if len(addresses) == 1 else "NAME"
    return only if only.startswith("[") else f":{only}"


def _one(names: list[str]) -> str | list[str]:
    return names[0] if len(names) == 1 else names


def _frequency(axis: tuple[str, np.ndarray] | None, parts: dict[str, object]) -> list[str | Remedy]:
    if axis is None:
        given = _given(parts, False, start=1.0, step=1.0, frequency_unit="Hz")
        return ["As a frequency response: ", *given, " with its own numbers."]
    unit = units.in_brackets(axis[0])[1]
    if axis_role(axis[0]) in ("omega", "freq_hz") or (unit and units.factor(units.FREQUENCY, unit)):
        return ["As a frequency response: ", *_given({"omega": axis[0], **parts}, False), "."]
    given = _given({"freq_hz": axis[0], **parts}, False)
    other = f"; or as it is, of {_PARTS_WORDS}" if set(parts) == set(_CARTESIAN) else ""
    return ["As a frequency response in Hz ('omega' for rad/s): ", *given, f"{other}."]


def _given(fields: dict[str, object], dt: bool, **more: object) -> list[str | Remedy]:
    """Arguments of `load`; the sample time stands for one that nobody has said."""
    arguments = {"fields": fields, **more}
    return [Remedy(arguments | {"dt": 1.0}), " with the sample time in s for 1.0"] if dt else [Remedy(arguments)]
