"""Roles of the arrays of a file: names given or usual, several signals, units, the time axis."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np

from robustid.core import as_array, as_positive
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.io import units
from robustid.data.io.readers import TEXTS, export
from robustid.data.io.table import Table
from robustid.data.time_record import TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError

# Roles and the names tried for them, which may have a unit: "frequency [Hz]", "time_ms". Names whose unit isn't certain
# ("frequency", "phase") are refused without one.
FREQUENCY = {
    "omega": ("omega", "w", "rad_s", "omega_rad_s"),
    "freq_hz": ("freq_hz", "frequency_hz", "f_hz", "hz"),
    "values": ("values", "frf", "response", "g", "h"),
    "real": ("real", "re"),
    "imag": ("imag", "im"),
    "magnitude": ("magnitude", "mag", "abs"),
    "magnitude_db": ("magnitude_db", "mag_db", "db"),
    "phase_deg": ("phase_deg", "phase_degrees"),
    "phase_rad": ("phase_rad",),
}
TIME = {
    "time": ("time", "t", "times"),
    "u": ("u", "input", "inputs"),
    "y": ("y", "output", "outputs"),
    "reference": ("reference",),
}
NAMES = {**FREQUENCY, **TIME, "bound": ("bound", "bounds"), "dt": ("dt", "Ts", "T")}
_WAYS: tuple[tuple[str, ...], ...] = (
    ("values",),
    ("real", "imag"),
    *itertools.product(("magnitude", "magnitude_db"), ("phase_deg", "phase_rad")),
)
_UNIFORM = 1e-6
_ANGULAR = ("omega", "ω", "w", "angular frequency", "angular_frequency")
_AXES = {
    **dict.fromkeys((*_ANGULAR, "frequency", "frequencies", "freq", "f"), "frequency"),
    **dict.fromkeys(("time", "t", "times"), "time"),
    **dict.fromkeys(("phase", "angle", "arg"), "phase"),
    **dict.fromkeys(("magnitude", "mag", "abs"), "magnitude"),
}
_UNSURE = "unsure "  # before the kind of an axis: its unit isn't known


def axis_role(name: str) -> str | None:
    """Role of a column that is an axis, by its name and unit; "unsure frequency" (time, ...) where the unit isn't certain."""
    base, unit = units.axis_label(name)
    base = base.lower()
    known = {"hz": "frequency", "rad_s": "frequency", "db": "magnitude"}
    kind = _AXES.get(base) or (known.get(unit.lower()) if not base else None)
    if kind == "frequency":
        if not unit:
            return "omega" if base in _ANGULAR else _UNSURE + kind
        scale = units.factor(units.FREQUENCY, unit)
        if scale is None or (base in _ANGULAR and "hz" in unit.lower()):
            return _UNSURE + kind
        return "freq_hz" if "hz" in unit.lower() else "omega"
    if kind == "time":
        return "time" if not unit or units.factor(units.TIME, unit) else _UNSURE + kind
    if kind == "phase":
        scale = units.factor(units.PHASE, unit)
        return _UNSURE + kind if scale is None else "phase_rad" if scale == 1 else "phase_deg"
    if kind == "magnitude":
        return "magnitude_db" if unit.lower() == "db" else _UNSURE + kind if "db" in unit.lower() else "magnitude"
    return None


def _rank(role: str, name: str) -> tuple[int, bool]:
    """Order among columns that could play a role: the most usual name first."""
    base = units.axis_label(name)[0]
    usual = [*dict.fromkeys(units.axis_label(known)[0] for known in NAMES[role])]
    return usual.index(base.lower()) if base.lower() in usual else len(usual), base != base.lower()


class Lookup:
    """Finds roles in a table: by the names given, else by usual ones."""

    def __init__(self, table: Table, fields: dict[str, Any]) -> None:
        self.columns, self.file, self.fields = table.columns, table.path.name, fields
        self.text, self.facts, self.export = table.path.suffix.lower() in TEXTS, table.facts, export(table)
        self.axes: dict[str, list[str]] = {}
        for name in self.columns:
            if (role := axis_role(name)) is not None:
                self.axes.setdefault(role, []).append(name)

    def _match(self, name: str) -> str | None:
        """As written, in other letters, or without its unit."""
        if name in self.columns:
            return name
        wanted = name.lower()
        found = [known for known in self.columns if known.lower() == wanted]
        return next(iter(found or [n for n in self.columns if units.in_brackets(n)[0].lower() == wanted]), None)

    def find(self, role: str) -> Any:
        """Name in the file, or list of names, or None."""
        if role in self.fields:
            return self.fields[role]
        if role in ("omega", "freq_hz", "time", "phase_deg", "phase_rad", "magnitude", "magnitude_db"):
            return min(self.axes.get(role, []), key=lambda name: _rank(role, name), default=None)
        for name in NAMES[role]:
            if (match := self._match(name)) is not None:
                return match
            if role in ("u", "y", "reference", "bound"):
                numbered = (self._match(f"{name}{k}") for k in itertools.count(1))
                if several := list(itertools.takewhile(lambda match: match is not None, numbered)):
                    return several
        return None

    def unsure(self, kind: str) -> str | None:
        """A column that is an axis in a unit that isn't known."""
        return next(iter(self.axes.get(_UNSURE + kind, [])), None)

    def kind(self) -> str:
        """Frequency or time, by the roles given, else by the names in the file."""
        given = set(self.fields)
        frequency, time = bool(given & set(FREQUENCY)), bool(given & set(TIME))
        if frequency != time:
            return "frequency" if frequency else "time"
        if not frequency and (kind := self.looks()) is not None:
            return kind
        raise InputError(
            f"{self.file}: can't tell whether it holds frequency or time data; give `kind` and `fields`."
            f" {self.inventory()}"
        )

    def looks(self) -> str | None:
        """Frequency or time, by the usual names in the file alone; None where both or neither are there."""
        frequency = (self.find("omega") or self.find("freq_hz")) is not None
        time = self.find("u") is not None and self.find("y") is not None
        if frequency == time:
            return "frequency" if not frequency and self.unsure("frequency") else None
        return "frequency" if frequency else "time"

    def sample_time(self) -> float | None:
        """A stored sample time: a variable of one number, never a column of a text file."""
        if "dt" in self.fields:
            return as_positive("fields['dt']", self.column("dt", self.fields["dt"])) * _seconds(self, self.fields["dt"])
        for name in () if self.text else NAMES["dt"]:
            value = self.columns.get(name)
            # MATLAB's Ts is 0 for continuous time and -1 for "not said".
            if isinstance(value, np.ndarray) and value.size == 1 and np.isrealobj(value) and value.item() > 0:
                return float(value.item())
        return None

    def inventory(self) -> str:
        """One sentence that lists the columns of the file."""
        names = list(self.columns)
        return f"The file has {', '.join(names[:40])}{' …' if len(names) > 40 else ''}{self.export}"

    def need(self, role: str) -> Any:
        """As `find`, or say what is missing."""
        if (name := self.find(role)) is None:
            raise InputError(f"no {role!r} found; name it by `fields={{{role!r}: ...}}`. {self.inventory()}")
        return name

    def name(self, name: Any) -> str:
        """As it stands in the file, with its unit."""
        return (self._match(name) if isinstance(name, str) else None) or str(name)

    def column(self, role: str, name: Any) -> np.ndarray:
        """One array by its name in the file."""
        if not isinstance(name, str):
            raise InputTypeError(f"`fields[{role!r}]` must name what is in the file; got {name!r}")
        if (match := self._match(name)) is None:
            raise InputError(f"`fields[{role!r}]` = {name!r} isn't in the file. {self.inventory()}")
        value = self.columns[match]
        if isinstance(value, FileFormatError):
            raise value
        return value.ravel() if value.size == max(value.shape, default=1) else value

    def signal(self, role: str, name: Any) -> np.ndarray:
        """A time signal (T,) or (T, n)."""
        if isinstance(name, str):
            return self.column(role, name)
        if not isinstance(name, list | tuple) or not name:
            raise InputTypeError(f"`fields[{role!r}]` must be a name or a list of names; got {name!r}")
        names: list[Any] = list(cast("Sequence[Any]", name))
        return np.column_stack(_equal(role, [self.column(role, item) for item in names]))

    def matrix(self, role: str, name: Any) -> np.ndarray:
        """A frequency-dependent (F,) or (F, ny, nu)."""
        if isinstance(name, str):
            return self.column(role, name)
        rows: list[Any] = list(cast("Sequence[Any]", name)) if isinstance(name, list | tuple) else []
        if not rows or not all(
            isinstance(row, list | tuple) and len(cast("Any", row)) == len(rows[0]) > 0 for row in rows
        ):
            raise InputError(
                f"`fields[{role!r}]` must be a name or a list of equally long rows of names, one row an"
                " output;"
                f" got {name!r}"
            )
        entries = _equal(role, [self.column(role, item) for row in rows for item in row])
        return np.stack(entries, axis=-1).reshape(-1, len(rows), len(rows[0]))


def _equal(role: str, columns: list[np.ndarray]) -> list[np.ndarray]:
    if len({column.shape for column in columns}) != 1 or columns[0].ndim != 1:
        raise InputError(f"`fields[{role!r}]` must name vectors of one length; got shapes {[c.shape for c in columns]}")
    return columns


def frequency_axis(lookup: Lookup, frequency_unit: str | None) -> tuple[Any, str | None]:
    """Name of the frequency axis, and its unit as far as the file states it."""
    if "omega" in lookup.fields and "freq_hz" in lookup.fields:
        raise InputError("`fields` gives both 'omega' and 'freq_hz'; give one")
    role = "freq_hz" if "freq_hz" in lookup.fields else "omega"
    name = lookup.find(role)
    if name is None:
        role, name = "freq_hz", lookup.find("freq_hz")
    if name is None and (unsure := lookup.unsure("frequency")) is not None:
        if frequency_unit is None or units.axis_label(unsure)[1]:
            both = " and `fields={'omega': ...}`" if units.axis_label(unsure)[1] else ""
            raise InputError(
                f"the unit of the frequencies in {unsure!r} isn't certain: give `frequency_unit` ('Hz' or 'rad/s'){both},"
                f" or call the column 'frequency [Hz]' or 'omega [rad/s]'. {lookup.inventory()}"
            )
        return unsure, None
    if name is None:
        lookup.need("omega")
    name = lookup.name(name)
    unit = units.axis_label(name)[1]
    if role in lookup.fields and units.factor(units.FREQUENCY, unit) is None:
        # The last word of a name that the user gives needn't be a unit; what stands in brackets is one.
        if units.in_brackets(name)[1] and (frequency_unit is None or role == "freq_hz"):
            raise InputError(
                f"`fields[{role!r}]` = {name!r}: {unit!r} is no certain unit of frequency; give `frequency_unit`"
            )
        unit = ""
    return name, unit or ("Hz" if role == "freq_hz" else None)


def _omega(lookup: Lookup, frequency_unit: str | None) -> np.ndarray:
    """The frequencies in rad/s."""
    name, unit = frequency_axis(lookup, frequency_unit)
    column = lookup.column("omega", name)
    for said, where in (
        (frequency_unit, "`frequency_unit`"),
        ("Hz" if "freq_hz" in lookup.fields else None, "the role"),
    ):
        if said and unit and ("hz" in said.lower()) != ("hz" in unit.lower()):
            raise InputError(
                f"{where} says {said}, and the name of {name!r} says {unit}; correct the one that is wrong"
            )
    scale = units.factor(units.FREQUENCY, unit or frequency_unit or "rad/s")
    return column * scale if scale != 1 else column


def as_frequency(lookup: Lookup, options: dict[str, Any], frequency_unit: str | None) -> FrequencyResponse:
    """The frequency response that the columns hold."""
    omega = _omega(lookup, frequency_unit)
    values = _values(lookup)
    if values.ndim == 3 and values.shape[0] != omega.size == values.shape[-1]:
        raise InputError(
            f"the values have shape {values.shape} with the frequency last, as MATLAB has it; frequency is"
            " the first axis here: store permute(G, [3 1 2]), or call FrequencyResponse(omega,"
            " numpy.moveaxis(values, -1, 0))"
        )
    if "bound" not in options and (name := lookup.find("bound")) is not None:
        _same_unit(lookup, name, [lookup.find(role) for role in ("values", "real", "magnitude", "magnitude_db")])
        options["bound"] = lookup.matrix("bound", name)
    if not lookup.fields:
        options = {**lookup.facts.get("frequency", {}), **options}
    if "dt" not in options:
        options["dt"] = lookup.sample_time()
    return FrequencyResponse(omega, values, **options)


def _same_unit(lookup: Lookup, bound: Any, signals: list[Any]) -> None:
    """A bound in another unit than what it bounds would be wrong without a word."""
    stated, others = (
        {units.in_brackets(lookup.name(name))[1] for name in _flat(names)} - {""} for names in (bound, signals)
    )
    others = {unit for unit in others if unit.lower() != "db"}
    if (stated and others and stated != others) or any("db" in unit.lower() for unit in stated):
        raise InputError(
            f"the bound is in {', '.join(sorted(stated))} and what it bounds in {', '.join(sorted(others)) or 'no stated unit'};"
            " store both in one linear unit, or give `bound`"
        )


def _flat(names: Any) -> list[str]:
    parts = cast("Iterable[Any]", names or [])
    return [names] if isinstance(names, str) else [name for part in parts for name in _flat(part)]


def _values(lookup: Lookup) -> np.ndarray:
    given = set(lookup.fields) & {role for way in _WAYS for role in way}
    way = next((w for w in _WAYS if given <= set(w) and all(lookup.find(role) is not None for role in w)), None)
    if way is None:
        if (unsure := lookup.unsure("phase") or lookup.unsure("magnitude")) is not None:
            raise InputError(
                f"the unit of {unsure!r} isn't certain: give `fields={{'phase_deg': ...}}` or 'phase_rad', and 'magnitude' or"
                f" 'magnitude_db', or call the columns 'phase [deg]' and 'magnitude [dB]'. {lookup.inventory()}"
            )
        raise InputError(
            "needs 'values' (complex), or 'real' and 'imag', or 'magnitude' or 'magnitude_db' with"
            f" 'phase_deg' or 'phase_rad'; name them by `fields`. {lookup.inventory()}"
        )
    for role in way:
        _check_unit(lookup, role)
    parts = [lookup.matrix(role, lookup.find(role)) for role in way]
    if len(parts) == 1:
        return parts[0]
    if any(np.iscomplexobj(part) for part in parts):
        raise InputError(f"{way[0]!r} and {way[1]!r} must be real; for complex numbers name one role, 'values'")
    if parts[0].shape != parts[1].shape:
        raise InputError(f"{way[0]!r} and {way[1]!r} must have one shape; got {parts[0].shape}, {parts[1].shape}")
    if way[0] == "real":
        return parts[0] + 1j * parts[1]
    if way[0] == "magnitude" and np.any(parts[0] < 0):
        raise InputError("'magnitude' has negative values: is it in dB? Then name it by `fields={'magnitude_db': ...}`")
    magnitude = 10 ** (parts[0] / 20) if way[0] == "magnitude_db" else parts[0]
    return magnitude * np.exp(1j * (np.deg2rad(parts[1]) if way[1] == "phase_deg" else parts[1]))


def _check_unit(lookup: Lookup, role: str) -> None:
    """A magnitude or phase named by the user must not say another unit than its role."""
    for name in map(lookup.name, _flat(lookup.fields.get(role))):
        said = axis_role(name) or ""
        if units.axis_label(name)[1] and said != role and said.split("_")[0] in ("magnitude", "phase"):
            raise InputError(f"`fields[{role!r}]` = {name!r} says another unit; give the role {said!r}")


def as_time(lookup: Lookup, options: dict[str, Any]) -> TimeRecord:
    """The time record that the columns hold."""
    if "dt" in options and "time" in lookup.fields:
        raise InputError("`dt` and `fields['time']` are both given; give one")
    if not lookup.fields:
        options = {**lookup.facts.get("time", {}), **options}
    names = {role: lookup.need(role) for role in ("u", "y")}
    signals = {role: lookup.signal(role, name) for role, name in names.items()}
    for side, role in (("inputs", "u"), ("outputs", "y")):
        columns = [names[role]] if isinstance(names[role], str) else list(names[role])
        if side not in options and len(columns) == (1 if signals[role].ndim == 1 else signals[role].shape[1]):
            options[side] = [units.in_brackets(lookup.name(column)) for column in columns]
    if "dt" not in options:
        options["dt"] = time_step(lookup, len(signals["u"]))
    for role in ("bound", "reference"):
        if role not in options and (name := lookup.find(role)) is not None:
            if role == "bound":
                _same_unit(lookup, name, [names["y"]])
            options[role] = lookup.signal(role, name)
    return TimeRecord(**signals, **options)


def time_step(lookup: Lookup, samples: int) -> float:
    """Sample time of a record: of its time column, which goes before a stored number that wasn't named."""
    time = None if "dt" in lookup.fields else lookup.find("time")
    # A scalar T is found as "t" too.
    if time is not None and not (time == "T" and lookup.columns[time].size == 1 < samples):  # type: ignore[union-attr]
        column = lookup.column("time", time)
        return uniform_step(column, samples) * _seconds(lookup, time)
    if time is None and "dt" not in lookup.fields and (unsure := lookup.unsure("time")) is not None:
        _seconds(lookup, unsure)
    if (step := lookup.sample_time()) is None:
        raise InputError(f"no 'time' found; give `dt` or name it by `fields`. {lookup.inventory()}")
    return step


def _seconds(lookup: Lookup, name: str) -> float:
    """Factor from the unit of a time column to s; a name without a unit is in seconds."""
    name = lookup.name(name)
    unit = units.axis_label(name)[1]
    scale = units.factor(units.TIME, unit)
    if scale is None and units.in_brackets(name)[1]:
        raise InputError(f"{name!r}: {unit!r} is no unit of time that is known; give `dt` in s. {lookup.inventory()}")
    return scale or 1.0


def uniform_step(time: np.ndarray, samples: int) -> float:
    """The sample time of instants that are uniform; else a sentence."""
    if time.shape != (samples,):
        raise InputError(f"the time has shape {time.shape} where `u` has {samples} samples; give `dt` instead")
    if samples < 2:
        raise InputError("one sample gives no sample time; give `dt`")
    steps = np.diff(as_array("time", time))
    step = as_positive("time step", (time[-1] - time[0]) / (samples - 1))
    if np.max(np.abs(steps - step)) > _UNIFORM * step:
        k = int(np.argmax(np.abs(steps - np.median(steps))))
        raise InputError(
            f"the time is not uniform: from {time[k]:.9g} s (sample {k}) to {time[k + 1]:.9g} s the step is"
            f" {steps[k]:.6g} s, the median step {np.median(steps):.6g} s; resample the record, or give `dt`"
        )
    return float(step)
