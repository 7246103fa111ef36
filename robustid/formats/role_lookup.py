"""The arrays of a file by their roles: names and addresses given, or usual names."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np

from robustid.core import as_positive
from robustid.errors import FileFormatError, InputError, InputTypeError, Remedy
from robustid.formats import units
from robustid.formats.addresses import FREQUENCY_AXES, Address, arranged, columns, expanded, parse, taken
from robustid.formats.headings import heading, turned
from robustid.formats.load_example import example
from robustid.formats.readers import export, read_table
from robustid.formats.role_names import FREQUENCY, NAMES, TIME, UNSURE, axis_role, is_usual, rank
from robustid.formats.table import NAMELESS, Table

_SIGNED = ("real", "imag", "phase_deg", "phase_rad")
_STEPS = ("dt", "Ts")  # names of a sample time and of nothing else
_LONGEST_SHOWN = 80  # characters of a name
_ELSEWHERE = re.compile(
    r"(?P<file>[^:\[\]]+\.(?:npy|npz|mat|h5|hdf5|csv|tsv|txt|dat|uff|unv))(?:$|:|(?=\[))(?P<rest>.*)", re.IGNORECASE
)


class _Place(NamedTuple):
    """An array of a file, and an address in it."""

    there: Lookup
    name: str
    address: Address | None


class Lookup:
    """Finds roles in a table: by the names given, else by usual ones."""

    def __init__(
        self,
        table: Table,
        fields: Mapping[str, object],
        named_axes: Sequence[str] | None = None,
        *,
        dt_known: bool = False,
    ) -> None:
        self.table, self.dt_known = table, dt_known
        self.columns, self.path, self.file, self.fields = table.columns, table.path, table.path.name, fields
        self.named_axes, self.how = named_axes, table.how
        self.clock = ""  # words on instants that scatter
        self._others: dict[str, Lookup] = {}
        self.text, self.facts, self.export = table.text, table.facts, export(table)
        self.structure = _structure(self.columns)
        self.axes: dict[str, list[str]] = {}
        for name in self.columns:
            if (role := axis_role(self._plain(name))) is not None:
                self.axes.setdefault(role, []).append(name)

    def _plain(self, name: str) -> str:
        """Name without that of the structure that holds everything."""
        return name.removeprefix(self.structure)

    def _match(self, name: str) -> str | None:
        """As written, in other letters, or without its unit; of a field of the only structure its name there too."""
        for asked in dict.fromkeys((name, self.structure + name)):
            if asked in self.columns:
                return asked
            wanted = asked.lower()
            found = [known for known in self.columns if known.lower() == wanted]
            if found := found or [n for n in self.columns if units.in_brackets(n)[0].lower() == wanted]:
                return found[0]
        return None

    def find(self, role: str) -> object:
        """Name in the file, or list of names, or None."""
        if role in self.fields:
            return self.fields[role]
        if role in ("omega", "freq_hz", "time", "phase_deg", "phase_rad", "magnitude", "magnitude_db"):
            found = sorted(self.axes.get(role, []), key=lambda name: rank(role, self._plain(name)))
            # Two magnitudes with other titles than usual are of two channels: neither is taken.
            first, *others = [self._plain(name) for name in found] or [""]
            unusual = bool(others) and rank(role, first)[0] == rank(role, others[0])[0]
            return None if not found or (unusual and not is_usual(role, first)) else found[0]
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
        words = "can't tell whether it holds frequency or time data; say which column is what by `fields`. "
        raise InputError(words, *self.help(), argument="fields")

    def looks(self) -> str | None:
        """Frequency or time, by the usual names in the file alone; None where both or neither are there."""
        if (kind := self.measured()) is not None:
            return kind
        frequency = (self.find("omega") or self.find("freq_hz")) is not None
        return "time" if not frequency and self.find("time") is not None else None

    def measured(self) -> str | None:
        """Frequency or time, by what else than a time axis is there: a model may have one beside its matrices."""
        frequency = (self.find("omega") or self.find("freq_hz")) is not None
        time = self.find("u") is not None and self.find("y") is not None
        if frequency == time:
            return "frequency" if not frequency and self._rises(self.unsure("frequency")) else None
        return "frequency" if frequency else "time"

    def _rises(self, name: str | None) -> bool:
        """Tell whether a column rises or falls all the time: beside a time, one that doesn't is a force "F", and no frequency."""
        if name is None or self.find("time") is None:
            return name is not None
        values = self.columns[name]
        if isinstance(values, FileFormatError) or not np.isrealobj(values):
            return False
        steps = np.diff(values.ravel().astype(float))
        return bool(np.all(steps > 0) or np.all(steps < 0))

    def sample_time(self) -> float | None:
        """A stored sample time or rate: a variable of one number, or a column of a text that repeats one."""
        if "dt" in self.fields:
            return as_positive("fields['dt']", self.column("dt", self.fields["dt"])) * seconds(self, self.fields["dt"])
        if "rate" in self.fields:
            return 1 / (as_positive("fields['rate']", self.column("rate", self.fields["rate"])) * self._hz())
        for role in ("dt", "rate"):
            for name in NAMES[role]:
                value = self.columns.get(self.structure + name)
                # MATLAB's Ts is 0 for continuous time and -1 for "not said".
                if isinstance(value, np.ndarray) and value.size == 1 and np.isrealobj(value) and value.item() > 0:
                    return float(value.item()) if role == "dt" else 1 / float(value.item())
        return None

    def refuse_step(self, *but: float) -> None:
        """Refuse a stored sample time or rate that is no positive number, nor one of these."""
        for name in () if self.text or "dt" in self.fields or "rate" in self.fields else (*_STEPS, *NAMES["rate"]):
            value, texts, got = self.columns.get(self.structure + name), self.table.texts.get(self.structure + name), ""
            if texts is not None:
                got = f"the text {', '.join(texts[:1])!r}"
            elif isinstance(value, np.ndarray) and value.size != 1:
                got = f"{value.size} numbers"
            elif isinstance(value, np.ndarray) and value.item() not in but:
                got = "" if np.isrealobj(value) and 0 < value.item() < np.inf else f"{value.item():g}"
            if got:
                what, unit = ("time", "s") if name in _STEPS else ("rate", "Hz")
                words = f"the sample {what} {name!r} in the file must be one positive number in {unit}; got {got}. Give `dt`"
                raise InputError(words, argument="dt")

    def _hz(self) -> float:
        """Factor from the unit of a sample rate to Hz; a name without a unit is in Hz."""
        unit = units.axis_label(self.name(self.fields["rate"]))[1]
        return (units.factor(units.FREQUENCY, unit) or 2 * np.pi) / (2 * np.pi)

    def inventory(self) -> str:
        """One sentence that lists the columns of the file; the shape of those that are no vectors."""
        remarks = {name: f" ({words})" for name, words in self.table.remarks.items()}
        names = [_shown(name, values) + remarks.get(name, "") for name, values in self.columns.items()]
        unread = [f"; {error.said({})}" for error in self.columns.values() if isinstance(error, FileFormatError)]
        return (
            f"The file has {', '.join(names[:40])}{' …' if len(names) > 40 else ''}{self.export}{''.join(unread[:1])}"
        )

    def help(self) -> list[str | Remedy]:
        """The inventory, and a line that works as far as the arrays say it: parts of a sentence."""
        said = self.inventory() + f". Read as {self.how}" * self.text
        line = [] if self.fields else example(self.table, dt=not self.dt_known and self.sample_time() is None)
        return [f"{said}. ", *line] if line else [said]

    def need(self, role: str) -> object:
        """As `find`, or say what is missing."""
        if (name := self.find(role)) is None:
            words = f"no {role!r} found; name it by `fields={{{role!r}: ...}}`. "
            raise InputError(words, *self.help(), argument="fields")
        return name

    def name(self, name: object) -> str:
        """As it stands in the file, with its unit; of an address the array that it is a part of."""
        place = self._place(name) if isinstance(name, str) else None
        return str(name) if place is None else place.name

    def labels(self, name: object) -> list[tuple[str, str]]:
        """Name and unit of every column that a role is given."""
        if not isinstance(name, str):
            return [label for one in cast("Sequence[object]", name) for label in self.labels(one)]
        place = self._place(name)
        if place is None or place.address is None:
            base, unit = units.in_brackets(self._plain(self.name(name)))
            return [(f"{self.path.stem}{base}" if base.startswith("[") else base, unit)]
        base, unit = units.in_brackets(place.name)
        address = place.address._replace(name=base or place.there.path.stem)
        titles = columns(address, place.there.whole(place.name).shape)
        return [(title, unit) for title in titles]

    def title(self, name: object) -> str:
        """Name of an array, without its unit; of one without a name that of its file."""
        place = self._place(name) if isinstance(name, str) else None
        base = "" if place is None else units.in_brackets(place.there._plain(place.name))[0]
        return base or (self if place is None else place.there).path.stem

    def column(self, role: str, name: object) -> np.ndarray:
        """One array, or a part of it, by its name or address in the file; negated where its name has a minus that says so."""
        value = self._value(role, name)[0]
        said = heading(self.name(name)) if role in _SIGNED else None
        value = -value if said is not None and said.sign < 0 else value
        return value.ravel() if value.size == max(value.shape, default=1) else value

    def turned(self) -> str:
        """Words on the columns given by their names that are negated, as `headings.turned` has them."""
        return turned(self.name(name) for role in _SIGNED for name in flat(self.fields.get(role)))

    def arranged(self, role: str, name: object, order: Sequence[str]) -> np.ndarray:
        """One array, or several side by side along its last axis, with the axes that `axes` names in this order."""
        if isinstance(name, list | tuple):
            parts = [self.arranged(role, one, order) for one in cast("Sequence[object]", name)]
            if len({part.shape for part in parts}) != 1:
                raise InputError(f"`fields[{role!r}]` must name arrays of one shape; got {[p.shape for p in parts]}")
            return np.concatenate(parts, axis=-1)
        value, index = self._value(role, name)
        names = list(cast("Sequence[str]", self.named_axes))
        what = f"`fields[{role!r}]` = {name!r}"
        if index is not None and value.ndim != 1:
            parts = [None if isinstance(part, int) else part for part in index]
            if len(parts) != len(names):
                raise InputError(f"`axes` names {len(names)} axes ({', '.join(names)}), and {what} has {len(parts)}")
            names = [axis for axis, part in zip(names, parts, strict=True) if part is not None]
        return arranged(what, value, names, order)

    def _value(self, role: str, name: object) -> tuple[np.ndarray, tuple[int | slice, ...] | None]:
        """The numbers that a name or an address is about, and the whole index of the address."""
        if not isinstance(name, str):
            raise InputTypeError(f"`fields[{role!r}]` must name what is in the file; got {name!r}")
        what, place = f"`fields[{role!r}]` = {name!r}", self._place(name)
        if place is None:
            held = self._file_of(name)[0].inventory()
            raise InputError(f"{what} isn't in the file. {held}", argument="fields", got=name)
        value = place.there.whole(place.name)
        if place.address is None:
            return value, None
        return taken(what, place.address.parts, value), expanded(what, place.address.parts, value.shape)

    def _place(self, text: str) -> _Place | None:
        """The array that a name or an address is about; None where there is none."""
        if (match := self._match(text)) is not None:
            return _Place(self, match, None)
        there, rest = self._file_of(text)
        if there is not self and (match := there._match(rest)) is not None:
            return _Place(there, match, None)
        if (address := parse(rest)) is None:
            return None
        match = NAMELESS if address.name == NAMELESS else there._match(address.name)
        return None if match is None else _Place(there, match, address)

    def whole(self, name: str) -> np.ndarray:
        """An array of the file; without a name the only one, or all columns side by side."""
        if name in self.columns:
            return self.table.numbers(name)
        arrays = [values for values in self.columns.values() if isinstance(values, np.ndarray)]
        if len(self.columns) == len(arrays) == 1:
            return arrays[0]
        if not arrays or any(array.shape != arrays[0].shape or array.ndim != 1 for array in arrays):
            raise InputError(f"an address without a name is of the only array of a file. {self.inventory()}")
        gap = np.full(arrays[0].shape, np.nan)  # a column of words
        return np.column_stack([values if isinstance(values, np.ndarray) else gap for values in self.columns.values()])

    def _file_of(self, text: str) -> tuple[Lookup, str]:
        """The file that an address is about, and the rest: ``"other.npy[:,0]"``, ``"other.mat:y"``; usually this one."""
        if (match := _ELSEWHERE.fullmatch(text)) is None:
            return self, text
        if match["file"] not in self._others:
            self._others[match["file"]] = Lookup(read_table(self.path.parent / match["file"]), {})
        there = self._others[match["file"]]
        return there, match["rest"] or "[...]"

    def _is_vector(self, role: str, name: object) -> bool:
        values = self._value(role, name)[0]
        return values.size == max(values.shape, default=1)

    def signal(self, role: str, name: object) -> np.ndarray:
        """A time signal (T,) or (T, n)."""
        if isinstance(name, str):
            return self.column(role, name)
        if not isinstance(name, list | tuple) or not name:
            raise InputTypeError(f"`fields[{role!r}]` must be a name or a list of names; got {name!r}")
        names = list(cast("Sequence[object]", name))
        return np.column_stack(_equal(role, [self.column(role, item) for item in names]))

    def matrix(self, role: str, name: object) -> np.ndarray:
        """A frequency-dependent (F,) or (F, ny, nu)."""
        one = role in ("bound", "coherence") and isinstance(name, str)  # of all entries alike: a number, or one a point
        if self.named_axes is not None and not (one and self._is_vector(role, name)):
            return self.arranged(role, name, FREQUENCY_AXES)
        if isinstance(name, str):
            return self.column(role, name)
        rows = list(cast("Sequence[Sequence[object]]", name)) if isinstance(name, list | tuple) else []
        if not rows or not all(isinstance(row, list | tuple) and len(row) == len(rows[0]) > 0 for row in rows):
            raise InputError(
                f"`fields[{role!r}]` must be a name or a list of equally long rows of names, one row an"
                " output;"
                f" got {name!r}"
            )
        entries = _equal(role, [self.column(role, item) for row in rows for item in row])
        return np.stack(entries, axis=-1).reshape(-1, len(rows), len(rows[0]))


def _structure(columns: Iterable[str]) -> str:
    """Beginning of all names, "meas.", of a file that holds one structure and nothing else; else empty."""
    found = {name.rpartition(".")[0] for name in columns}
    return f"{found.pop()}." if len(found) == 1 and found != {""} else ""


def flat(names: object) -> list[str]:
    """The names that a role is given, in one list."""
    parts = cast("Iterable[object]", names or [])
    return [names] if isinstance(names, str) else [name for part in parts for name in flat(part)]


def _shown(name: str, values: np.ndarray | FileFormatError) -> str:
    """Name, and the shape of what is no vector; of an array without a name an address."""
    if len(name) > _LONGEST_SHOWN:
        name = f"{name[:_LONGEST_SHOWN]}…"
    if not isinstance(values, np.ndarray) or (name != NAMELESS and values.size == max(values.shape, default=1)):
        return name
    shape = " x ".join(map(str, values.shape))
    return f"{name} ({shape})" if name != NAMELESS else f'one array without a name ({shape}), "[:]"'


def _equal(role: str, columns: list[np.ndarray]) -> list[np.ndarray]:
    if len({column.shape for column in columns}) != 1 or columns[0].ndim != 1:
        raise InputError(f"`fields[{role!r}]` must name vectors of one length; got shapes {[c.shape for c in columns]}")
    return columns


def seconds_in(title: str) -> float | None:
    """Factor from the unit in the name of a time column to s; None where none that is known stands there."""
    return units.factor(units.TIME, units.axis_label(title)[1])


def seconds(lookup: Lookup, name: object) -> float:
    """Factor from the unit of a time column to s; a name without a unit is in seconds."""
    title = lookup.name(name)
    scale, unit = seconds_in(title), units.in_brackets(title)[1]
    if scale is None and unit:
        raise InputError(f"{title!r}: {unit!r} is no unit of time that is known; give `dt` in s. {lookup.inventory()}")
    return scale or 1.0
