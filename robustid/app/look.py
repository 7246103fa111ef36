"""look(): what is in a file, what it looks like, and the lines to go on with."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from robustid.app.arrays import array_faults, said_words, shape_words
from robustid.app.load_save import load
from robustid.app.run.reading import in_options, option_words, values_of_options
from robustid.app.run.toml import is_array
from robustid.app.run.undoing import command_line, with_option
from robustid.core import Frozen, Options, Record
from robustid.data import Fault, FaultKind, FrequencyResponse, TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError, Remedy, RobustIdError
from robustid.estimation import estimate_bound, experiment_faults, record_faults, response_faults
from robustid.formats import (
    FREQUENCY,
    TIME,
    StoredModel,
    Table,
    axis_role,
    contents,
    names_axis,
    origin,
    read_said,
    read_table,
    record_pairs,
)
from robustid.identification import sample_faults

_STANDS_FOR = {"dt": 1.0, "frequency_unit": "Hz"}  # for what nobody has said
_CORRECT = "--frequency-correct"
_SEEN = 2500  # values of a response from whose scatter a bound is taken
_MANY = 12  # things that are listed


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Look(Frozen):
    """Contents of a file, as far as they can be seen, and how to go on.

    Attributes
    ----------
    path : str
    how : str
        As what the file was read.
    rows : tuple of (address, shape, range or text)
    faults : tuple of Fault
        What is odd.
    error : RobustIdError or None
        Then why.
    arguments : dict
        Arguments of `load` to try, as the refusal names them.
    bound : str
        What a response without a bound says of its errors itself; "" where it says nothing.
    unknown : tuple of str
        Those of the `arguments` that stand for what nobody has said: a number, or the meaning of names that say nothing.
    records : tuple of dict
        The `fields` of each record, where pairs of arrays are of several.
    kind : {"frequency", "time", ""}
        Frequency response or time record, as far as the file or the arguments say it.
    joined : dict
        The same as the `fields` of one record of several inputs and outputs; {} where their lengths differ.
    found : object or None
        What was read, a model by its matrices; `data` is what `load` makes of it.
    proposed : object or None
        Where it needs to be told more: what the `arguments` make of it, whose faults are shown.
    """

    path: str
    how: str
    rows: tuple[tuple[str, str, str], ...]
    faults: tuple[Fault, ...]
    found: object = None
    error: RobustIdError | None = None
    arguments: Options = dataclasses.field(default_factory=Record)
    bound: str = ""
    unknown: tuple[str, ...] = ()
    records: tuple[dict[str, str], ...] = ()
    kind: str = ""
    joined: dict[str, list[str]] = dataclasses.field(default_factory=dict[str, list[str]])
    proposed: object = None

    @functools.cached_property
    def data(self) -> object:
        """The measurements or the model that `load` makes of it; None where it needs to be told more."""
        return self.found.model() if isinstance(self.found, StoredModel) else self.found

    @property
    def read_as(self) -> str:
        """Words for what was read; "" where it needs to be told more."""
        if self.found is None:
            return ""
        return self.found.words() if isinstance(self.found, StoredModel) else repr(self.found)

    @property
    def refusal(self) -> str:
        """Why it can't be read yet; "" where it can."""
        return "" if self.error is None else str(self.error)

    @property
    def argument(self) -> str | None:
        """The argument of `load` that is wrong or missing, where it is a single one."""
        return None if self.error is None else self.error.argument

    @property
    def asked_kind(self) -> str:
        """The kind by whose options it is to be told more."""
        return self.kind or ("frequency" if self.argument == "frequency_unit" else "time")

    def for_terminal(self) -> Look:
        """Return the same with options of commands for the arguments of Python in what it says."""
        if self.error is None:
            return self
        options = option_words(self.asked_kind)
        if "fields" in self.unknown:  # of either kind
            options["fields"] = f"{option_words('frequency')['fields']} or {option_words('time')['fields']}"
        spoken = self.error.reworded(options, lambda remedy: in_options(remedy, self.asked_kind))
        spoken.argument = self.argument
        return dataclasses.replace(self, error=spoken)

    @property
    def next(self) -> tuple[str, ...]:
        """Lines to go on with, in Python and for the program."""
        name = self.path
        if self.found is None and not self.arguments:
            return ()
        _, called = self.step
        if "fields" in self.unknown:  # there is nothing to load before somebody has said more
            return (command_line([*called, "-o", "run.toml"]),)
        written = {"new": ["-o", "run.toml"], "export": ["-o", "model.m"], "identify": ["--report", "report.html"]}
        given = "".join(f", {key}={json.dumps(value)}" for key, value in self.arguments.items())
        python = f"rid.load({json.dumps(name)}{given})"
        if self.correction:
            python = f"rid.prepare.correct({python}, {json.dumps(self.correction)})"
        if not called:
            return (python,)
        return python, command_line([*called, *written.get(called[0], ["--report", f"{called[0]}.html"])])

    @property
    def step(self) -> tuple[str, list[str]]:
        """The command to go on with: in words, and as arguments, with which it runs; none where no command takes the file."""
        if isinstance(self.found, FrequencyResponse):
            known = self.found.bound is not None or bool(self.bound)
            what = "a model with a proof" if known else "a model by least squares; with --frequency-bound, a proof"
            called = ["identify", "--frequency", self.path] if known else ["fit", self.path, "--order", "auto"]
            called += self.as_options()
            return what, with_option(called, _CORRECT, self.correction) if self.correction else called
        if not self.kind and self.found is not None:
            model = isinstance(self.found, StoredModel)
            return ("the model for another program", ["export", self.path]) if model else ("", [])
        period = next((fault.size for fault in self.faults if fault.kind is FaultKind.UNSTATED_PERIOD), None)
        alone = isinstance(self.found, TimeRecord) and self.found.u.shape[1] == 1 and not self.looped
        if period and alone and not self.faulty:
            called = ["frf", self.path, *self.as_options(), "--period", f"{period:.0f}"]
            return "the frequency response, with its bound", called
        fault = ", with what undoes the fault" if self.correction else ""
        loop = ", with the loop that it was measured in" if self.looped else ""
        return f"a run file, ready to edit{loop}{fault}", ["new", self.path]

    @property
    def looped(self) -> bool:
        """True of records with a reference: a controller ran."""
        records = self.found if is_array(self.found) else [self.found]
        return any(isinstance(one, TimeRecord) and one.reference is not None for one in records)

    def as_options(self) -> list[str]:
        """The arguments with which it was read, as options of a command."""
        kind = self.kind
        known = option_words(kind)
        found = values_of_options(Remedy({name: one for name, one in self.arguments.items() if name in known}), kind)
        pairs = [(flag, str(one)) for flag, value in found.items() for one in (value if is_array(value) else [value])]
        return [word for pair in pairs for word in pair]

    @property
    def faulty(self) -> bool:
        """True where data that could be read have a fault; a period that nothing states is found, and is none."""
        odd = [fault for fault in self.faults if not fault.undone and fault.kind is not FaultKind.UNSTATED_PERIOD]
        return (self.found is not None or self.proposed is not None) and bool(odd)

    @property
    def correction(self) -> str:
        """The first correction that undoes something odd of all that the file holds; "" where there is none."""
        if not isinstance(self.found, FrequencyResponse | TimeRecord):
            return ""
        of_records = isinstance(self.found, TimeRecord)
        fitting = (f for f in self.faults if not f.undone and (of_records or not f.of_records))
        return next((fault.correction for fault in fitting if fault.correction), "")

    def summary(self) -> str:
        """Plain text: contents, faults, what to do."""
        head = f"{self.path}: {self.how}"
        return "\n".join([head, *self.contents(), *self.sentences, *(f"next: {words}" for words in self.next)])

    def contents(self, most: int = _MANY) -> list[str]:
        """Lines on at most so many things that the file holds."""
        width = max((len(row[0]) for row in self.rows), default=0)
        size = max((len(row[1]) for row in self.rows), default=0)
        lines = [f"  {name.ljust(width)}  {shape:>{size}}  {words}".rstrip() for name, shape, words in self.rows[:most]]
        return lines + ([f"  and {len(self.rows) - most} more"] if len(self.rows) > most else [])

    @property
    def sentences(self) -> list[str]:
        """Sentences on what was made of it, and what is odd."""
        lines: list[str] = []
        if self.found is not None:
            lines.append(f"read as {self.read_as}")
        if self.bound:
            lines.append(f"no error bound is stated; one taken from the data: {self.bound}")
        if self.refusal:
            lines.append(f"to be told more: {self.refusal}")
        if self.proposed is not None:
            stated = {**self.arguments, **self.arguments.get("fields", {})}
            names = ", ".join(f"{name} = {_names(value)}" for name, value in stated.items() if name != "fields")
            lines.append(f"read so far, as by the run file of robustid new, with {names}")
        return lines + [f"looks odd: {fault}" for fault in self.faults]

    def __str__(self) -> str:
        return self.summary()


def look(path: str | os.PathLike[str], **options: Any) -> Look:
    r"""Look into a file before anything is taken for anything: names, shapes, ranges, what is odd, and how to go on.

    Parameters
    ----------
    path : str or path
        Any file that `load` reads.
    **options
        Arguments of `load`, to see what it makes of the file with them.

    Returns
    -------
    Look
        ``print(look(path))`` shows it.

    Raises
    ------
    InputError, FileFormatError
        No such file, or none that can be read.

    Examples
    --------
    >>> import pathlib, tempfile, robustid as rid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "sweep.csv"
    ...     _ = path.write_text("f,gain,phase\n1,-3,-20\n2,-6,-100\n3,-30,-170\n")
    ...     found = rid.look(path)
    >>> print(found.faults[0])
    gain has negative values: a magnitude in decibels
    """
    table = read_table(path, options.get("decimal"))
    pairs = record_pairs(table)
    apart = [dict(one) for one in pairs.fields] if pairs.apart and not options else []
    joined = pairs.joined if apart else {}
    found = contents(table)
    timed = any(axis_role(item.address) == "time" for item in found.items)  # then an angle is a signal, and no phase
    rows = tuple((item.address, shape_words(item), said_words(item, of_record=timed)) for item in found.items)
    odd = [fault for item in found.items if item.values is not None for fault in array_faults(item, timed)]
    try:
        data, how = ([load(table, fields=one) for one in apart], "") if apart else read_said(table, **options)
        how = found.how if apart or table.meta is not None else how
    except (InputError, InputTypeError, FileFormatError) as error:
        tried, unknown = _tried(error, {"fields": apart[0]} if apart else options)
        kind = _kind(tried) or origin(table, "frequency", None).kind or ""
        if "fields" not in options and _silent(tried.get("fields", {})):
            unknown = (*unknown, "fields")
        proposed = _proposed(table, tried, apart) if tried and not unknown else None
        told: Options = {
            "arguments": tried,
            "unknown": unknown,
            "records": tuple(apart),
            "joined": joined,
            "kind": kind,
            "error": error,
            "proposed": proposed,
        }
        if tried and unknown == ("dt",):  # a period counts samples
            odd += [
                fault for fault in _faults(_proposed(table, tried, apart)) if fault.kind is FaultKind.UNSTATED_PERIOD
            ]
        return Look(path=str(path), how=found.how, rows=rows, faults=(*odd, *_faults(proposed)), **told)
    odd += _faults(data)
    several: Sequence[object] = data if is_array(data) else [data]
    own = _own_bound(data) if isinstance(data, FrequencyResponse) and data.bound is None else ""
    first = several[0]
    told = {
        "arguments": {"fields": apart[0]} if apart else options,
        "records": tuple(apart),
        "joined": joined,
        "kind": "time"
        if isinstance(first, TimeRecord)
        else "frequency"
        if isinstance(first, FrequencyResponse)
        else "",
    }
    return Look(path=str(path), how=how, rows=rows, faults=tuple(odd), found=data, bound=own, **told)


def _proposed(table: Table, tried: Options, apart: Sequence[dict[str, str]]) -> object:
    """Measurements that the arguments to try make of a file; None where they are not enough."""
    several: list[Options] = [{**tried, "fields": fields} for fields in apart] or [tried]
    try:
        found: list[object] = [load(table, **one) for one in several]
    except (InputError, InputTypeError, FileFormatError):
        return None
    return found if apart else found[0]


def _faults(data: object) -> list[Fault]:
    """Faults of measurements: of each, and of responses against records."""
    several: Sequence[object] = data if is_array(data) else [data]
    responses = [one for one in several if isinstance(one, FrequencyResponse)]
    records = [one for one in several if isinstance(one, TimeRecord)]
    odd = [fault for one in responses for fault in response_faults(one)]
    if records and len(records) == len(several):
        bounded = all(one.bound is not None for one in records)  # then their samples are used
        odd += [fault for one in records for fault in sample_faults(one)] if bounded else record_faults(records)
    for one in responses:
        if same := [r for r in records if (len(r.outputs), len(r.inputs)) == one.values.shape[1:]]:
            odd += experiment_faults(one, same)
    return odd


def _tried(error: RobustIdError, given: Options) -> tuple[Options, tuple[str, ...]]:
    """Arguments of `load` to try after a refusal, and those of them that stand for what nobody has said."""
    measured = set(error.remedy) == {"dt"}  # the step of a time column, which stands for nothing
    remedy = error.remedy if measured or {"fields", "axes"} & set(error.remedy) else {}
    unknown = tuple(
        name for name in _STANDS_FOR if name == error.argument or (name == "dt" and name in remedy and not measured)
    )
    if not remedy and not unknown:
        return {}, ()
    tried = {**given, **remedy}
    return tried | {name: _STANDS_FOR[name] for name in unknown if name not in tried}, unknown


def _kind(tried: Mapping[str, Any]) -> str:
    """Kind of the arguments to try; "" where they say none."""
    roles = set(tried.get("fields", {}))
    return "time" if roles & set(TIME) else "frequency" if roles & set(FREQUENCY) else ""


def _silent(fields: Mapping[str, object]) -> bool:
    """Return whether an axis is proposed whose name doesn't say that it is one: that is a question, and no reading."""
    axes = [name for role in ("omega", "freq_hz", "time") if isinstance(name := fields.get(role), str)]
    return any(not names_axis(name) for name in axes)


def _own_bound(frf: FrequencyResponse) -> str:
    """Bound that a response has where nobody states one, in words."""
    step = -(-frf.values.size // _SEEN)
    seen = f"; seen at one frequency point in {step}, as a look is quick" if step > 1 else ""
    try:
        found = estimate_bound(frf.select(slice(None, None, step)))
        return found.bound.words(found.note) + seen
    except InputError:
        return ""


def _names(name: object) -> str:
    """Name of an array, or those of several."""
    return ", ".join(map(str, name)) if is_array(name) else str(name)
