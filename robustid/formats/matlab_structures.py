"""Structures with the fields of MATLAB's idfrd, frd and iddata: their axis order, units and sample time, brought into ours."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np

from robustid.core import Options
from robustid.errors import FileFormatError, InputError
from robustid.formats.table import Table
from robustid.formats.units import FREQUENCY, TIME, factor

STRUCTURE_TIME = {**TIME, **{f"{word}seconds": scale for word, scale in (("milli", 1e-3), ("micro", 1e-6), ("nano", 1e-9))},
               "hours": 3600.0, "days": 86400.0}  # fmt: skip
_LOGGED = re.compile(r"signals(\(\d+\))?\.values")  # of a structure with time
_MARKS = {"frequency": ("ResponseData", "Frequency"), "time": ("OutputData", "InputData")}


def from_structure(table: Table, kind: str | None, frequency_unit: str | None) -> Table:
    """The one structure of a file as arrays with usual names; a file without any comes back as it is."""
    found = [
        (mark, name[: -len(parts[0])])
        for mark, parts in _MARKS.items()
        for name in table.columns
        if kind in (None, mark)
        and (name == parts[0] or name.endswith(f".{parts[0]}"))
        and name[: -len(parts[0])] + parts[1] in table.columns
    ]
    if not found:
        return table
    if len(found) > 1:
        names = ", ".join(repr(prefix[:-1] or "the top level") for _, prefix in found)
        raise InputError(f"the file holds several structures of measurements ({names}); store one a file")
    mark, prefix = found[0]
    part = _Part(table, prefix)
    return (_response if mark == "frequency" else _record)(table, part, frequency_unit)


class _Part:
    """The fields of one structure."""

    def __init__(self, table: Table, prefix: str) -> None:
        self.table, self.prefix = table, prefix

    def numbers(self, field: str) -> Any:  # an array, None, or why a column has none
        return self.table.columns.get(self.prefix + field)

    def word(self, *fields: str) -> str:
        return next((t[0] for f in fields if len(t := self.table.texts.get(self.prefix + f, [])) == 1), "")

    def channels(self, side: str, count: int) -> list[tuple[str, str]] | None:
        """Names and units; None where no signal has a name."""
        names, units = (self.table.texts.get(f"{self.prefix}{side}{field}", []) for field in ("Name", "Unit"))
        if len(names) != count or not all(names):
            return None
        return list(zip(names, units if len(units) == count else [""] * count, strict=True))

    def time_unit(self) -> float | None:
        word = self.word("TimeUnit")
        return factor(STRUCTURE_TIME, word) if word else None

    def step(self) -> float | None:
        """Ts in s; 0 is continuous time and -1 isn't said."""
        value = self.numbers("Ts")
        if value is None or np.size(value) != 1 or not np.isrealobj(value) or value.item() < 0:
            return None
        word = self.word("TimeUnit")
        scale = self.time_unit() if word else 1.0  # seconds, MATLAB's default
        if scale is None:
            raise FileFormatError(
                f"{self.prefix}TimeUnit = {word!r} is no unit of time that is known; give `dt` and `fields`"
            )
        return float(value.item()) * scale


def _response(table: Table, part: _Part, frequency_unit: str | None) -> Table:
    omega, values = part.numbers("Frequency").reshape(-1), part.numbers("ResponseData")
    if values.ndim == 2:
        values = values[:, :, None] if omega.size == 1 else values
    if values.ndim != 3 or values.shape[-1] != omega.size:
        raise InputError(
            f"`{part.prefix}ResponseData` must have the shape (ny, nu, F) that MATLAB gives it, with F = {omega.size} from"
            f" {part.prefix}Frequency; got {values.shape}"
        )
    for name in ("InputDelay", "OutputDelay", "IODelay", "ioDelay"):
        delay = part.numbers(name)
        if delay is not None and np.any(delay):
            raise InputError(
                f"`{part.prefix}{name}` isn't zero; call absorbDelay in MATLAB before storing the response"
            )
    omega = omega * _frequency_scale(part, frequency_unit)
    step = part.step()
    facts: Options = {"dt": step or None, "inputs": part.channels("Input", values.shape[1]),
                      "outputs": part.channels("Output", values.shape[0])}  # fmt: skip
    columns = {"omega": omega, "values": np.moveaxis(values, -1, 0)}
    if (covariance := part.numbers("CovarianceData")) is not None:
        facts["covariance"] = _covariance(part, covariance, values.shape)
    facts = {name: value for name, value in facts.items() if value is not None or (name == "dt" and step == 0)}
    return dataclasses.replace(table, columns=columns, facts={"frequency": facts})


def _frequency_scale(part: _Part, frequency_unit: str | None) -> float:
    """Factor from the unit of the frequencies to rad/s."""
    unit = part.word("FrequencyUnit", "Units")
    turns, per = {"rad": 1.0, "cycles": 2 * np.pi}.get(unit.lower().removesuffix("/timeunit")), part.time_unit()
    if unit.lower() == "rpm":
        scale = 2 * np.pi / 60
    elif turns is not None:
        scale = turns / per if per else None
    else:
        scale = factor(FREQUENCY, unit)
    if frequency_unit is not None:
        stated = factor(FREQUENCY, frequency_unit)
        if not unit and stated is not None:
            return stated
        if scale is not None and scale != stated:
            raise InputError(
                f"`frequency_unit` says {frequency_unit}, and {part.prefix}FrequencyUnit says {unit}; correct one"
            )
    if scale is not None:
        return scale
    said = "isn't there" if not unit else f"is {unit!r}" + ("" if turns is None else " and TimeUnit isn't known")
    raise InputError(
        f"the unit of the frequencies isn't certain: {part.prefix}FrequencyUnit {said}; store it (and TimeUnit), or give"
        " `frequency_unit` ('Hz' or 'rad/s') where it is missing",
        argument="frequency_unit",
    )


def _covariance(part: _Part, data: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Covariance with E|e|^2 on the diagonal, from that of real and imaginary part, (ny, nu, F, 2, 2); zero between entries."""
    if data.shape != (*shape, 2, 2):
        raise InputError(f"`{part.prefix}CovarianceData` must have the shape {(*shape, 2, 2)}; got {data.shape}")
    power = np.trace(data, axis1=3, axis2=4)  # (ny, nu, F)
    ny, nu, lines = shape
    covariance = np.zeros((lines, ny * nu, ny * nu), complex)
    entry = np.arange(ny * nu)
    # Entries of vec(G): columns stacked.
    covariance[:, entry, entry] = power.transpose(2, 1, 0).reshape(lines, -1)
    return covariance


def _record(table: Table, part: _Part, _: str | None) -> Table:
    if part.word("Domain").lower() == "frequency":
        raise InputError(f"`{part.prefix}Domain` is 'Frequency'; store the time record, or the response by spafdr")
    columns = {"u": part.numbers("InputData"), "y": part.numbers("OutputData")}
    facts: Options = {
        side: part.channels(word, columns[role].shape[-1])
        for side, word, role in (("inputs", "Input", "u"), ("outputs", "Output", "y"))
    }
    # Ts = 0 is no record of samples: its time axis is not read.
    facts["dt"] = part.step() or None
    return dataclasses.replace(
        table, columns=columns, facts={"time": {k: v for k, v in facts.items() if v is not None}}
    )


def name_logged_signals(table: Table) -> None:
    """Name the signals that a simulation has logged as a structure with time: by their labels, one alone by its variable.

    The times of several such variables are one column, where they are equal.
    """
    columns = table.columns
    logs = [name.removesuffix("time") for name in columns if name.endswith(".time")]
    logs = [
        log
        for log in logs
        if any(_LOGGED.fullmatch(name.removeprefix(log)) for name in columns if name.startswith(log))
    ]
    if not logs:
        return
    first = columns[f"{logs[0]}time"]
    one = all(np.array_equal(first, columns[f"{log}time"]) for log in logs[1:])  # type: ignore[arg-type]
    named: dict[str, Any] = {}
    for name, values in columns.items():
        log = next((log for log in logs if name.startswith(log)), None)
        rest = "" if log is None else name.removeprefix(log)
        if log is not None and (signal := _LOGGED.fullmatch(rest)):
            label = " ".join(table.texts.get(f"{log}signals{signal[1] or ''}.label", [])).strip()
            title = label or (name if signal[1] else log[:-1])
            named[title if title not in named else name] = values
        elif log is None or rest == "time":
            named["time" if one and rest == "time" else name] = values
    columns.clear()
    columns.update(named)
