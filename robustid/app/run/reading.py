"""One source of data: its file parsed once, its mistakes undone, its bound; and remedies in the words of those who asked."""

from __future__ import annotations

import hashlib
import os
import shlex
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar, overload

from robustid.app.run.sources import RecordSource, ResponseSource
from robustid.app.run.toml import is_array, write_toml
from robustid.core import Record
from robustid.data import Fault, FrequencyResponse, TimeRecord
from robustid.errors import FileFormatError, InputError, Remedy
from robustid.estimation import BOUND_SOURCES, correct, default_bound, operating_point
from robustid.formats import NAMES, Table, datasets, read_said, read_table

Data = FrequencyResponse | TimeRecord
D = TypeVar("D", FrequencyResponse, TimeRecord)
_KEYS = {"frequency_unit": "unit"}
_KEPT, _BYTES = 4, 2**27  # tables that a process keeps, and the size of all of them
RUN_FILE = {  # keys for the arguments of `load` and `default_bound` as sentences have them
    **{name: f"{name} = ..." for name in ("bound", "averages")},
    **{f"fields={{{role!r}: ...}}": f'fields = {{ {role} = "NAME" }}' for role in NAMES},
    "fields": 'fields = { ROLE = "NAME" }',
    "frequency_unit": "unit",
}


class _Last:
    """The tables that a process has parsed last, for its later runs: found by name and content of their files."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str | None, bytes], Table] = {}
        self._one = threading.Lock()

    def of(self, path: Path, decimal: str | None) -> Table:
        """The arrays of a file as it is now."""
        try:
            with path.open("rb") as file:
                key = os.path.abspath(path), decimal, hashlib.file_digest(file, "sha256").digest()
        except (OSError, ValueError):  # the reader has the sentence
            return read_table(path, decimal)
        with self._one:
            table = self._kept.pop(key, None)
        if table is None:
            table = read_table(path, decimal)
        with self._one:
            self._kept[key] = table
            while len(self._kept) > _KEPT or sum(map(_bytes, self._kept.values())) > _BYTES:
                del self._kept[next(iter(self._kept))]
        return table


def _bytes(table: Table) -> int:
    return sum(0 if isinstance(one, FileFormatError) else one.nbytes for one in table.columns.values())


_LAST = _Last()


class Tables:
    """Files that were parsed: each once, however often something in it is asked for; the last also for later runs of a process."""

    def __init__(self) -> None:
        self._parsed: dict[tuple[Path, str | None], Table] = {}

    def of(self, path: Path, decimal: str | None = None) -> Table:
        """The arrays of a file."""
        if (path, decimal) not in self._parsed:
            self._parsed[path, decimal] = _LAST.of(path, decimal)
        return self._parsed[path, decimal]


class Read(NamedTuple, Generic[D]):
    """Data as a file has them, without its mistakes, and with bounds; what these are or are taken from, and how it was read.

    `level` is the point of operation from which records are counted that nobody said how they begin, undone by `correct`.
    """

    raw: list[D]
    corrected: list[D]
    data: list[D]
    bound: float | str | None
    how: str
    correct: tuple[str, ...] | None = None
    level: Fault | None = None

    def level_words(self, rest: str) -> str:
        """Sentence on the point of operation, and on the option that leaves it in; empty where there is none."""
        if self.level is None:
            return ""
        return f"{self.level.said_alone}: this is done, since nothing says how the record begins; {rest} leaves it in"


@overload
def read_source(source: RecordSource, folder: Path, tables: Tables, *, bounded: bool) -> Read[TimeRecord]: ...
@overload
def read_source(source: ResponseSource, folder: Path, tables: Tables, *, bounded: bool) -> Read[FrequencyResponse]: ...
def read_source(
    source: RecordSource | ResponseSource, folder: Path, tables: Tables, *, bounded: bool
) -> Read[TimeRecord] | Read[FrequencyResponse]:
    """The data of a source, several records where its axes have realisations; with a bound, where one is asked for.

    That is the one that the source states or asks to be taken from the data; else the one that the data state, or show.
    """
    if isinstance(source, RecordSource):
        return _read(TimeRecord, source, folder, tables, bounded)
    return _read(FrequencyResponse, source, folder, tables, bounded)


def _read(kind: type[D], source: RecordSource | ResponseSource, folder: Path, tables: Tables, bounded: bool) -> Read[D]:
    options = source.arguments
    if isinstance(source, RecordSource) and source.file is None:
        given = {name: value for name, value in options.items() if value is not None}
        found, how = datasets.load(str(source.dataset), **given), "published data set"
    else:
        table = tables.of(folder / str(source.file), source.decimal)
        found, how = read_said(table, kind=source.kind, **options)
    several = found if is_array(found) else [found]
    raw = [one for one in several if isinstance(one, kind)]
    if len(raw) < len(several):
        raise InputError("this data set is a model, not a record")
    level = _level(raw, source)
    corrections = source.correct if level is None else (level.correction,)
    corrected = [correct(one, *(corrections or ())) for one in raw]
    if not bounded:
        return Read(raw, corrected, corrected, source.bound, how, corrections, level)
    data = [_with_bound(one, source) for one in corrected]
    return Read(raw, corrected, [one for one, _ in data], data[0][1], how, corrections, level)


def _level(records: Sequence[Data], source: RecordSource | ResponseSource) -> Fault | None:
    """The point of operation of records of which nothing says how they begin, where it can be taken out."""
    if not isinstance(source, RecordSource) or (source.initial, source.correct, source.detrend) != (None, None, None):
        return None
    found = [operating_point(one) for one in records if isinstance(one, TimeRecord)]
    first = next((fault for fault in found if fault is not None), None)
    if first is None or any(one.bound is not None for one in records):
        return None
    return first


def _with_bound(data: D, source: RecordSource | ResponseSource) -> tuple[D, float | str | None]:
    word = source.bound if source.bound in BOUND_SOURCES else None
    if data.bound is not None and word is None:
        return data, source.bound
    return default_bound(data, word, averages=getattr(source, "averages", None))


def in_run_file(remedy: Remedy) -> str:
    """A remedy as lines of a run file."""
    keys = {_KEYS.get(name, name): value for name, value in remedy.arguments.items()}
    lines = (write_toml({"x": {name: value}}).split("\n")[1] for name, value in keys.items())
    return remedy.words or f"`{'; '.join(lines)}`"


def in_options(remedy: Remedy, kind: str) -> str:
    """A remedy as options for a file of this kind."""
    if remedy.words:
        return remedy.words
    return " ".join(
        f"{flag} {shlex.quote(str(one))}"
        for flag, value in values_of_options(remedy, kind).items()
        for one in (value if is_array(value) else [value])
    )


def values_of_options(remedy: Remedy, kind: str) -> Record:
    """The same as values by their options; of fields a list."""
    found: Record = {}
    for name, value in remedy.arguments.items():
        if name == "fields":
            several = {role: names if is_array(names) else [names] for role, names in value.items()}
            found[f"--{kind}-field"] = [f"{role}={one}" for role, names in several.items() for one in names]
        else:
            found[option_words(kind)[name]] = value
    return found


def option_words(kind: str) -> dict[str, str]:
    """Options for a file of this kind, by the arguments of `load` and `default_bound` as sentences have them."""
    field = f"--{kind}-field"
    return {
        **{name: f"--{name}" for name in ("dt", "rate", "axes", "decimal", "averages")},
        **{name: f"--frequency-{name}" for name in ("start", "step")},
        **{f"fields[{role!r}]": f"{field} {role}" for role in NAMES},
        **{f"fields={{{role!r}: ...}}": f"{field} {role}=NAME" for role in NAMES},
        "frequency_unit": "--frequency-unit",
        "bound": f"--{kind}-bound",
        "fields": f"{field} ROLE=NAME",
    }
