"""The arrays of a file by their roles: names and addresses given, or usual names."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from robustid.core import as_positive
from robustid.data.io import units
from robustid.data.io.addresses import columns, parse, taken
from robustid.data.io.names import FREQUENCY, NAMES, TIME, UNSURE, axis_role, rank
from robustid.data.io.readers import TEXTS, export, read_table
from robustid.data.io.table import NAMELESS, Table
from robustid.errors import FileFormatError, InputError, InputTypeError

_ELSEWHERE = re.compile(
    r"(?P<file>[^:\[\]]+\.(?:npy|npz|mat|h5|hdf5|csv|tsv|txt|dat|uff|unv))(?:$|:|(?=\[))(?P<rest>.*)", re.IGNORECASE
)


class Lookup:
    """Finds roles in a table: by the names given, else by usual ones."""

    def __init__(self, table: Table, fields: dict[str, Any]) -> None:
        self.columns, self.path, self.file, self.fields = table.columns, table.path, table.path.name, fields
        self._others: dict[str, Lookup] = {}
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
            return min(self.axes.get(role, []), key=lambda name: rank(role, name), default=None)
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
        return next(iter(self.axes.get(UNSURE + kind, [])), None)

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
            return as_positive("fields['dt']", self.column("dt", self.fields["dt"])) * seconds(self, self.fields["dt"])
        for name in () if self.text else NAMES["dt"]:
            value = self.columns.get(name)
            # MATLAB's Ts is 0 for continuous time and -1 for "not said".
            if isinstance(value, np.ndarray) and value.size == 1 and np.isrealobj(value) and value.item() > 0:
                return float(value.item())
        return None

    def inventory(self) -> str:
        """One sentence that lists the columns of the file; the shape of those that are no vectors."""
        names = [_shown(name, values) for name, values in self.columns.items()]
        return f"The file has {', '.join(names[:40])}{' …' if len(names) > 40 else ''}{self.export}"

    def need(self, role: str) -> Any:
        """As `find`, or say what is missing."""
        if (name := self.find(role)) is None:
            raise InputError(f"no {role!r} found; name it by `fields={{{role!r}: ...}}`. {self.inventory()}")
        return name

    def name(self, name: Any) -> str:
        """As it stands in the file, with its unit; of an address the array that it is a part of."""
        if not isinstance(name, str):
            return str(name)
        if (match := self._match(name)) is not None:
            return match
        there, name = self._place(name)
        if there is not self:
            return there.name(name)
        address = parse(name)
        return name if address is None else self._match(address.name) or address.name

    def labels(self, name: Any) -> list[tuple[str, str]]:
        """Name and unit of every column that a role is given."""
        if not isinstance(name, str):
            return [label for one in cast("Sequence[Any]", name) for label in self.labels(one)]
        there, rest = (self, name) if self._match(name) is not None else self._place(name)
        address = parse(rest)
        if address is None or there._match(rest) is not None:
            return [units.in_brackets(there.name(rest))]
        base, unit = units.in_brackets(there.name(rest))
        return [
            (label, unit)
            for label in columns(address._replace(name=base or there.path.stem), there._array(address.name).shape)
        ]

    def column(self, role: str, name: Any) -> np.ndarray:
        """One array, or a part of it, by its name or address in the file."""
        if not isinstance(name, str):
            raise InputTypeError(f"`fields[{role!r}]` must name what is in the file; got {name!r}")
        there, rest = (self, name) if self._match(name) is not None else self._place(name)
        what, address = f"`fields[{role!r}]` = {name!r}", parse(rest)
        if (match := there._match(rest)) is not None:
            value = _numbers(there.columns[match])
        elif address is not None and (address.name == NAMELESS or there._match(address.name) is not None):
            value = taken(what, address.parts, there._array(address.name))
        else:
            raise InputError(f"{what} isn't in the file. {there.inventory()}")
        return value.ravel() if value.size == max(value.shape, default=1) else value

    def _array(self, name: str) -> np.ndarray:
        """The array that an address begins with; without a name the only one, or all columns side by side."""
        if name != NAMELESS or NAMELESS in self.columns:
            return _numbers(self.columns[self._match(name) or name])
        arrays = [_numbers(values) for values in self.columns.values()]
        if len(arrays) == 1:
            return arrays[0]
        if any(array.shape != arrays[0].shape or array.ndim != 1 for array in arrays):
            raise InputError(f"an address without a name is of the only array of a file. {self.inventory()}")
        return np.column_stack(arrays)

    def _place(self, text: str) -> tuple[Lookup, str]:
        """The file that an address is about, and the rest: ``"other.npy[:,0]"``, ``"other.mat:y"``; usually this one."""
        if (match := _ELSEWHERE.fullmatch(text)) is None:
            return self, text
        if match["file"] not in self._others:
            self._others[match["file"]] = Lookup(read_table(self.path.parent / match["file"]), {})
        there = self._others[match["file"]]
        return there, match["rest"] or "[...]"

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


def _numbers(values: np.ndarray | FileFormatError) -> np.ndarray:
    """The numbers of a column, or why it has none."""
    if isinstance(values, FileFormatError):
        raise values
    return values


def _shown(name: str, values: np.ndarray | FileFormatError) -> str:
    """Name, and the shape of what is no vector; of an array without a name an address."""
    if not isinstance(values, np.ndarray) or (name != NAMELESS and values.size == max(values.shape, default=1)):
        return name
    shape = " x ".join(map(str, values.shape))
    return f"{name} ({shape})" if name != NAMELESS else f'one array without a name ({shape}), "[:]"'


def _equal(role: str, columns: list[np.ndarray]) -> list[np.ndarray]:
    if len({column.shape for column in columns}) != 1 or columns[0].ndim != 1:
        raise InputError(f"`fields[{role!r}]` must name vectors of one length; got shapes {[c.shape for c in columns]}")
    return columns


def seconds(lookup: Lookup, name: str) -> float:
    """Factor from the unit of a time column to s; a name without a unit is in seconds."""
    name = lookup.name(name)
    unit = units.axis_label(name)[1]
    scale = units.factor(units.TIME, unit)
    if scale is None and units.in_brackets(name)[1]:
        raise InputError(f"{name!r}: {unit!r} is no unit of time that is known; give `dt` in s. {lookup.inventory()}")
    return scale or 1.0
