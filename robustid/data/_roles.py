"""Which array of a file plays which role: names given or usual, several channels, units, the time axis."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from robustid._arrays import as_array, as_positive
from robustid.data._readers import Table
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError

# Roles and the names tried for them. Names whose unit isn't certain ("frequency", "phase") are left out on
# purpose.
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


class Lookup:
    """Finds roles in a table: by the names given, else by usual ones."""

    def __init__(self, table: Table, fields: dict[str, Any]) -> None:
        self.columns, self.file, self.fields = table.columns, table.path.name, fields
        self.text = table.path.suffix.lower() in {".csv", ".tsv", ".txt"}

    def _match(self, name: str) -> str | None:
        if name in self.columns:
            return name
        return next((known for known in self.columns if known.lower() == name.lower()), None)

    def find(self, role: str) -> Any:
        """Name in the file, or list of names, or None."""
        if role in self.fields:
            return self.fields[role]
        for name in NAMES[role]:
            if (match := self._match(name)) is not None:
                return match
            if role in ("u", "y", "reference", "bound"):
                numbered = (self._match(f"{name}{k}") for k in itertools.count(1))
                if several := list(itertools.takewhile(lambda match: match is not None, numbered)):
                    return several
        return None

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
        return None if frequency == time else "frequency" if frequency else "time"

    def sample_time(self) -> float | None:
        """A stored sample time: a variable of one number, never a column of a text file."""
        if "dt" in self.fields:
            return as_positive("fields['dt']", self.column("dt", self.fields["dt"]))
        for name in () if self.text else NAMES["dt"]:
            value = self.columns.get(name)
            # MATLAB's Ts is 0 for continuous time and -1 for "not said".
            if isinstance(value, np.ndarray) and value.size == 1 and np.isrealobj(value) and value.item() > 0:
                return float(value.item())
        return None

    def inventory(self) -> str:
        names = list(self.columns)
        return f"The file has {', '.join(names[:40])}{' …' if len(names) > 40 else ''}"

    def need(self, role: str) -> Any:
        """As `find`, or say what is missing."""
        if (name := self.find(role)) is None:
            raise InputError(f"no {role!r} found; name it by `fields={{{role!r}: ...}}`. {self.inventory()}")
        return name

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
        return np.column_stack(_equal(role, [self.column(role, item) for item in name]))

    def matrix(self, role: str, name: Any) -> np.ndarray:
        """A frequency-dependent (F,) or (F, ny, nu)."""
        if isinstance(name, str):
            return self.column(role, name)
        rows = list(name) if isinstance(name, list | tuple) else []
        if not rows or not all(isinstance(row, list | tuple) and len(row) == len(rows[0]) > 0 for row in rows):
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


def as_frequency(lookup: Lookup, options: dict[str, Any], in_hz: bool) -> FrequencyResponse:
    if "omega" in lookup.fields and "freq_hz" in lookup.fields:
        raise InputError("`fields` gives both 'omega' and 'freq_hz'; give one")
    role = "omega"
    if "freq_hz" in lookup.fields or ("omega" not in lookup.fields and lookup.find("omega") is None):
        role = "freq_hz"
    if lookup.find(role) is None:
        lookup.need("omega")
    omega = lookup.column(role, lookup.find(role))
    if role == "freq_hz" or in_hz:
        omega = 2 * np.pi * omega
    values = _values(lookup)
    if values.ndim == 3 and values.shape[0] != omega.size == values.shape[-1]:
        raise InputError(
            f"the values have shape {values.shape} with the frequency last, as MATLAB has it; frequency is"
            " the first axis here: store permute(G, [3 1 2]), or call FrequencyResponse(omega,"
            " numpy.moveaxis(values, -1, 0))"
        )
    if "bound" not in options and (name := lookup.find("bound")) is not None:
        options["bound"] = lookup.matrix("bound", name)
    if "dt" not in options:
        options["dt"] = lookup.sample_time()
    return FrequencyResponse(omega, values, **options)


def _values(lookup: Lookup) -> np.ndarray:
    given = set(lookup.fields) & {role for way in _WAYS for role in way}
    way = next((w for w in _WAYS if given <= set(w) and all(lookup.find(role) is not None for role in w)), None)
    if way is None:
        raise InputError(
            "needs 'values' (complex), or 'real' and 'imag', or 'magnitude' or 'magnitude_db' with"
            f" 'phase_deg' or 'phase_rad'; name them by `fields`. {lookup.inventory()}"
        )
    parts = [lookup.matrix(role, lookup.find(role)) for role in way]
    if len(parts) == 1:
        return parts[0]
    if parts[0].shape != parts[1].shape:
        raise InputError(f"{way[0]!r} and {way[1]!r} must have one shape; got {parts[0].shape}, {parts[1].shape}")
    if way[0] == "real":
        return parts[0] + 1j * parts[1]
    magnitude = 10 ** (parts[0] / 20) if way[0] == "magnitude_db" else parts[0]
    return magnitude * np.exp(1j * (np.deg2rad(parts[1]) if way[1] == "phase_deg" else parts[1]))


def as_time(lookup: Lookup, options: dict[str, Any]) -> TimeRecord:
    if "dt" in options and "time" in lookup.fields:
        raise InputError("`dt` and `fields['time']` are both given; give one")
    names = {role: lookup.need(role) for role in ("u", "y")}
    signals = {role: lookup.signal(role, name) for role, name in names.items()}
    for side, role in (("inputs", "u"), ("outputs", "y")):
        columns = [names[role]] if isinstance(names[role], str) else list(names[role])
        if side not in options and len(columns) == (1 if signals[role].ndim == 1 else signals[role].shape[1]):
            options[side] = columns
    if "dt" not in options:
        options["dt"] = time_step(lookup, len(signals["u"]))
    for role in ("bound", "reference"):
        if role not in options and (name := lookup.find(role)) is not None:
            options[role] = lookup.signal(role, name)
    return TimeRecord(**signals, **options)


def time_step(lookup: Lookup, samples: int) -> float:
    """Sample time of a record: of its time column, which goes before a stored number that wasn't named."""
    time = None if "dt" in lookup.fields else lookup.find("time")
    # A scalar T is found as "t" too.
    if time is not None and not (time == "T" and lookup.columns[time].size == 1 < samples):  # type: ignore[union-attr]
        return _uniform_step(lookup.column("time", time), samples)
    if (step := lookup.sample_time()) is None:
        raise InputError(f"no 'time' found; give `dt` or name it by `fields`. {lookup.inventory()}")
    return step


def _uniform_step(time: np.ndarray, samples: int) -> float:
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
