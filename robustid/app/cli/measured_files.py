"""From files to measurements: what was read is said, and what is wrong with it names an option."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, overload

import numpy as np

from robustid.app.cli.screen import say, warn
from robustid.app.run.checks import options
from robustid.app.run.reading import Data, Tables, in_options, option_words, read_source, values_of_options
from robustid.app.run.sources import RecordSource, ResponseSource
from robustid.core import Signal, counted, hz_span, hz_words
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError, Remedy
from robustid.estimation import BOUND_SOURCES, response_faults
from robustid.formats import Origin, origin
from robustid.identification import sample_faults

if TYPE_CHECKING:
    from robustid.app.cli.terminal import Terminal


S = TypeVar("S", ResponseSource, RecordSource)
_SHARED = ("--dt", "--rate", "--axes", "--decimal")  # by files of both kinds
_NOTE = "given on the command line"
_SAME_STEP = 1e-6
_MOST_NAMED = 4


@dataclasses.dataclass(frozen=True, kw_only=True)
class Files(Generic[S]):
    """Files of one kind, how they are read, and which part of them is used."""

    paths: Sequence[Path]
    source: S  # its `file` is that of each
    entry: tuple[int | str, int | str] | None = None  # output and input
    band_hz: tuple[float, float] | None = None
    first: int | None = None  # samples of records
    bounded: bool = False  # whether sample time and bound are needed
    tables: Tables = dataclasses.field(default_factory=Tables, repr=False)
    origins: list[Path] = dataclasses.field(default_factory=list[Path], repr=False)  # of everything that was read

    def __post_init__(self) -> None:
        stated = {option.flag: getattr(self.source, field.name) for field, option in options(self.source)}
        stated |= {"--band": self.band_hz, "--first": self.first, None: None} | dict.fromkeys(_SHARED)
        if not self.paths and (given := [flag for flag, value in stated.items() if value is not None]):
            raise InputError(f"{given[0]} is given without a file: add --{self.kind} FILE, or leave {given[0]} out")
        if self.first is not None and self.first < 1:
            raise InputError(f"--first must be positive; got {self.first}")
        if self.first is not None and getattr(self.source, "initial", None) == "periodic":
            raise InputError("--first cuts a record, which --initial periodic needs whole; leave one of them out")

    @property
    def kind(self) -> str:
        """Frequency or time."""
        return self.source.kind

    @overload
    def read(self: Files[ResponseSource], out: Terminal) -> list[FrequencyResponse]: ...
    @overload
    def read(self: Files[RecordSource], out: Terminal) -> list[TimeRecord]: ...
    def read(self, out: Terminal) -> Sequence[Data]:
        """The measurements, one line said about each."""
        seen: set[Path] = set()
        data: list[Data] = []
        for path in self.paths:
            own = self._read_one(out, path)
            self.origins.extend([path] * len(own))
            data += own
            if path.resolve() in seen:
                warn(out, f"{path} is given twice: its samples count twice")
            seen.add(path.resolve())
        return data

    def _correct(self, path: Path) -> tuple[str, ...] | None:
        """Corrections of a file: those of all, and those that its name stands before."""
        split = [words.rpartition(":") for words in self.source.correct or ()]
        named = {name.strip() for name, colon, _ in split if colon}
        if missing := named - {str(one) for one in self.paths}:
            flag, name = f"--{self.kind}-correct", sorted(missing)[0]
            raise InputError(f"{flag} names {name}, which is none of the files; write it as in --{self.kind}")
        return tuple(words.strip() for name, _, words in split if name.strip() in ("", str(path))) or None

    def _read_one(self, out: Terminal, path: Path) -> list[Data]:
        """The measurements of a file: several records where its axes have realisations."""
        how, unit = self.source, getattr(self.source, "unit", None)
        with _named(path, self.kind):
            found = origin(self.tables.of(path, how.decimal), self.kind, how.fields)
            if found.kind not in (None, self.kind):
                other = "use it from Python" if found.kind == "tangential" else f"use --{found.kind} {path}"
                wanted = {
                    "frequency": f"a frequency response is needed: robustid frf {path} estimates one",
                    "time": f"a time record is needed; a response goes on with robustid identify --frequency {path}",
                }[self.kind]
                needed = other if self.bounded else wanted
                raise InputError(f"{path.name} holds {found.kind} data; {needed}", place=path.name)
            own = dataclasses.replace(how, file=path.name, correct=self._correct(path))
            source = read_source(own, path.parent, self.tables, bounded=self.bounded)
            read = [self._taken(data, path) for data in source.data]
        words, data = read[0]
        count = f"{len(read)} realisations, each " if len(read) > 1 else ""
        say(out, f"read {path}: {count}{_described(data, words)}{_unit_words(found, unit)}; {found.how}")
        if source.bound != how.bound:
            taken = f"it is taken from the data: {source.data[-1].bound.words(source.data[-1].note)}; --{self.kind}-bound states it"
            warn(out, f"{path.name} states no error bound, so {taken}")
        if source.level is not None:
            warn(out, f"{path.name}: {source.level_words('--initial rest')}")
        for fault in self._faults([data for _, data in read]):
            warn(out, f"{path.name}: {fault}")
        if found.unit_known and unit is not None and getattr(how, "step", None) is None:
            warn(out, f"--frequency-unit is ignored: {path.name} says the unit of its frequencies")
        if self.bounded and data.dt is None and not found.continuous:
            warn(
                out,
                f"{path.name} has no sample time: it is taken as a response of continuous time; give --dt for a sampled one",
            )
        if how.dt and found.dt and abs(found.dt - how.dt) > _SAME_STEP * how.dt:
            warn(out, f"--dt {how.dt:g} s is used; {path.name} has {found.dt:.6g} s ({found.dt_from})")
        return [data for _, data in read]

    def _taken(self, data: Data, path: Path) -> tuple[str, Data]:
        """The part that is asked for, with its bound, and what it is in words."""
        if self.bounded and self.source.bound is not None and self.source.bound not in BOUND_SOURCES:
            data = data.with_bound(data.bound, note=_NOTE)
        words, data = self._entry_of(data, path)
        return words, self._part_of(data)

    def _faults(self, data: Sequence[Data]) -> list[str]:
        """Faults that the data show, before any class is assumed."""
        responses = [one for one in data if isinstance(one, FrequencyResponse)]
        records = [one for one in data if isinstance(one, TimeRecord)]
        found = [fault.said(", --frequency-correct") for one in responses for fault in response_faults(one)]
        return found + [str(fault) for one in records if self.bounded for fault in sample_faults(one)]

    def _entry_of(self, data: Data, path: Path) -> tuple[str, Data]:
        """The entry that is asked for, else the whole matrix, and what it is in words."""
        outputs, inputs = len(data.outputs), len(data.inputs)
        size = f"{outputs} output{'s' * (outputs > 1)} and {inputs} input{'s' * (inputs > 1)}"
        words = f"{_names(data.outputs)} / {_names(data.inputs)}"
        if self.entry is None:
            hint = " (--entry OUTPUT,INPUT for one entry)" if self.bounded else ""
            return (words if outputs * inputs == 1 else f"{words}, all of {size}{hint}"), data
        try:
            one = data.entry(*self.entry)
        except (InputError, InputTypeError):
            asked = ",".join(map(str, self.entry))
            names = "" if outputs * inputs == 1 else f": {words}"
            sentence = f"--entry {asked} (OUTPUT,INPUT) isn't in {path.name}, which has {size}{names}"
            raise InputError(sentence, place=path.name) from None
        if (outputs, inputs) == (1, 1):
            return words, data
        words = f"{one.outputs[0]} / {one.inputs[0]} (one entry of {size}; without --entry the whole matrix)"
        return words, one

    def _part_of(self, data: Data) -> Data:
        """The band or the first samples asked for."""
        if isinstance(data, FrequencyResponse):
            return data if self.band_hz is None else data.band(*self.band_hz)
        if self.first is None:
            return data
        if data.initial == "periodic":
            raise InputError("--first cuts the record, which is periodic and needed whole; leave --first out")
        arrays = {name: getattr(data, name) for name in ("u", "y", "bound", "reference")}
        return dataclasses.replace(data, **{k: v[: self.first] for k, v in arrays.items() if v is not None})


def _of_options(remedy: Remedy, kind: str) -> Remedy:
    """A remedy whose arguments are options."""
    values = remedy.arguments if remedy.words else values_of_options(remedy, kind)
    return Remedy(values, in_options(remedy, kind))


def _names(signals: Sequence[Signal]) -> str:
    return ", ".join(map(str, signals)) if len(signals) <= _MOST_NAMED else f"{len(signals)} signals"


def _described(data: FrequencyResponse | TimeRecord, words: str) -> str:
    if isinstance(data, FrequencyResponse):
        span = hz_span(float(data.freq_hz[0]), float(data.freq_hz[-1]))
        text = f"frequency response, {counted(data.omega.size, 'frequency point')}, {span}, {words}, "
    else:
        text = f"time record, {data.time.size} samples, {data.time[0]:.5g} to {data.time[-1]:.5g} s, {words}, "
    text += "continuous time" if data.dt is None else f"dt = {data.dt:g} s"
    if isinstance(data, FrequencyResponse):
        return text + (", with covariance" if data.covariance is not None else "")
    if data.reference is not None:
        count = data.reference.shape[1]
        text += f"; {count} reference{'s' * (count > 1)}"
    return text + ("; in steady state" if data.initial == "periodic" else "")


def _unit_words(found: Origin, unit: str | None) -> str:
    """The unit that the frequencies were read in, where the file doesn't say it."""
    if found.unit_known:
        return ""
    if unit not in (None, "rad/s"):
        return f"; omega read as {unit}"
    return "; omega read as rad/s (--frequency-unit Hz if the file has Hz)"


@contextlib.contextmanager
def _named(path: Path, kind: str) -> Generator[None]:
    """Name the file and the options in what is wrong with it."""
    try:
        yield
    except (InputError, InputTypeError, FileFormatError) as error:
        if error.argument == "omega":
            got, nyquist = error.got / (2 * np.pi), error.remedy["omega"] / (2 * np.pi)
            error = InputError(
                f"a frequency point at {hz_words(got)} lies above the Nyquist frequency of {hz_words(nyquist)}; check --dt, and"
                " --frequency-unit: an omega column is in rad/s unless it says Hz"
            )
        options = option_words(kind)
        spoken = error.reworded(options, lambda remedy: _of_options(remedy, kind))
        spoken.argument = options.get(str(error.argument), error.argument)
        # What can't be read names its file.
        raise (spoken if isinstance(error, FileFormatError) else spoken.at(path.name)) from None
