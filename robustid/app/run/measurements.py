"""From the files that a run file names to bounded responses and records: all entries, or one."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from robustid.advice import Experiment
from robustid.app.run.controllers import read_controllers
from robustid.app.run.kept_out import Split, estimate_of, split
from robustid.app.run.looped import auxiliary_words, faults_of, loop_of, with_faults
from robustid.app.run.moved_alone import with_all_inputs
from robustid.app.run.reading import RUN_FILE, D, Data, Tables, in_run_file, read_source
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sources import USES, RecordSource, ResponseSource
from robustid.controllers import Factor, Matrix
from robustid.core import Source, counted, digest, hz_words
from robustid.data import Fault, FrequencyResponse, TimeRecord, decimate, detrend, points_at
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.estimation import bounds_from_noise_floor, estimate_delay, response_faults
from robustid.formats import origin
from robustid.identification import Loop

if TYPE_CHECKING:
    import control

S = TypeVar("S", RecordSource, ResponseSource)
Used = list[tuple[str, list[TimeRecord]]]  # records, with what they are used for


class Change(Protocol):
    """Change of a response, or of a record."""

    def __call__(self, item: D, /) -> D:
        """The item as it becomes."""
        ...


class Place(NamedTuple):
    """Source of data in a run file: the list, and the number there, from 0."""

    section: Literal["record", "frequency"]
    number: int


class Origins(NamedTuple):
    """The sources of responses (None of those that were estimated), of records, and of records that one was estimated from."""

    responses: tuple[Place | None, ...] = ()
    records: tuple[Place, ...] = ()
    excited: tuple[Place, ...] = ()


class Measured(NamedTuple):
    """Measured responses and records, with bounds, and responses of one kind that were kept out.

    `excited` are the records that a response was estimated from, where all of them is used.
    """

    responses: tuple[FrequencyResponse, ...]
    records: tuple[TimeRecord, ...]
    withheld: tuple[FrequencyResponse, ...] = ()
    kind: str = "records"
    excited: tuple[TimeRecord, ...] = ()
    origins: Origins = Origins()
    loop: Loop | None = None  # that responses and records are opened from
    controllers: Mapping[str, control.StateSpace] = {}  # others that are tried in it
    structure: tuple[Factor, ...] | Matrix = ()  # of the controller that is designed

    @property
    def dt(self) -> float | None:
        """Sample time in s; None in continuous time."""
        return next((item.dt for item in (*self.responses, *self.records)), None)

    def without(self, left_out: Sequence[Experiment]) -> Measured:
        """Without some experiments."""
        gone = {(one.kind, one.place) for one in left_out}
        responses = tuple(one for k, one in enumerate(self.responses) if ("frequency", k) not in gone)
        records = tuple(one for k, one in enumerate(self.records) if ("time", k) not in gone)
        return self._replace(responses=responses, records=records)

    def only(self, kept: Sequence[Experiment]) -> Measured:
        """With some experiments only."""
        responses, records = (
            tuple(every[one.place] for one in kept if one.kind == kind)
            for kind, every in (("frequency", self.responses), ("time", self.records))
        )
        return self._replace(responses=responses, records=records)

    def each(self, change: Change) -> Measured:
        """With a change of every response and record."""
        records, excited = (tuple(map(change, kept)) for kept in (self.records, self.excited))
        return self.each_response(change)._replace(records=records, excited=excited)

    def each_response(self, change: Callable[[FrequencyResponse], FrequencyResponse]) -> Measured:
        """With a change of every response."""
        return self._replace(responses=tuple(map(change, self.responses)), withheld=tuple(map(change, self.withheld)))


def measured(
    run: RunFile, folder: Path, around: Surroundings, tables: Tables | None = None
) -> tuple[RunFile, Measured]:
    """All data of a run file, read from `folder`, and the run file with what was read and chosen."""
    return part_of(*all_entries(run, folder, around, tables))


def all_entries(
    run: RunFile, folder: Path, around: Surroundings, tables: Tables | None = None
) -> tuple[RunFile, Measured]:
    """The same with every entry and frequency point, delays not taken out."""
    tables = tables or Tables()
    for source in (*run.record, *run.frequency):
        if source.file is not None and not (folder / source.file).is_file():
            raise InputError(f"there is no file {folder / source.file}; names are seen from the folder of the run file")
    run, records = _records(run, folder, around, tables)
    run, read = _responses(run, folder, around, tables)
    run = _with_method(run, records)
    loop, records, read, faults = _opened(run, folder, around, records, read)
    run, data = _bounded(run, records)
    if loop is not None:
        data = data._replace(responses=tuple(with_faults(one, faults) for one in data.responses))
        others = read_controllers([folder / name for name in run.loop.candidates or ()], "[loop] candidates:", loop)
        data = data._replace(controllers=others)
    if run.controller.is_stated:
        data = data._replace(structure=run.controller.read("[controller] {}".format, folder))
    origins = _origins(records, len(data.responses), len(read))
    return run, data._replace(responses=(*data.responses, *read), origins=origins, loop=loop)


def part_of(run: RunFile, data: Measured) -> tuple[RunFile, Measured]:
    """The entry or column, the band and the points that a run file asks for, of all that was read for it, without the delay."""
    entry, column = run.entry, run.column
    if entry is not None or column is not None:
        if any(len(record.inputs) > 1 for record in data.excited):  # the output answers to the other inputs too
            data = data._replace(excited=())
        try:
            data = data.each(lambda item: item[:, :, column] if entry is None else item.entry(*entry))
        except InputError as error:
            said = f"column = {column!r} is the number or name of an input"
            if entry is not None:
                said = f"entry = {list(entry)} is the number or name of an output and an input"
            raise InputError(f"{said}: {error}") from None
    run, data = _without_delay(run, data)
    if (band := run.frequency_points.band_hz) is not None:
        data = data.each_response(lambda frf: frf.band(*band))._replace(excited=())
    return run, without_points(data, run.frequency_points.leave_out_hz or ())


def without_points(data: Measured, left_out_hz: Sequence[float]) -> Measured:
    """The data without the frequency points at these frequencies in Hz, each of which a response must have beside others."""
    found: set[float] = set()

    def without(frf: FrequencyResponse) -> FrequencyResponse:
        kept = np.ones(frf.omega.size, bool)
        for hz in left_out_hz:
            at = points_at(frf.omega, 2 * np.pi * hz)
            kept[at] = False
            if at.size:
                found.add(hz)
        if not kept.any():
            raise InputError("[frequency_points] leave_out_hz leaves no frequency point of a response; leave one in")
        return frf.select(kept)

    if not left_out_hz:
        return data
    rest = data.each_response(without)
    if missing := [hz for hz in left_out_hz if hz not in found]:
        raise InputError(
            f"[frequency_points] leave_out_hz: no response has a frequency point at {hz_words(missing[0], 6)}"
        )
    return rest


def _records(run: RunFile, folder: Path, around: Surroundings, tables: Tables) -> tuple[RunFile, Used]:
    """The records, prepared, with what each is used for."""
    sources: list[RecordSource] = []
    records: Used = []
    quiet = all(source.use != "noise_floor" for source in run.record)
    for k, source in enumerate(run.record, start=1):
        name = source.file or source.dataset
        place = f"[[record]] {k}, {name}"
        with _said_of(place):
            bounded = source.use == "samples" and (quiet or source.bound is not None)
            found = read_source(source, folder, tables, bounded=bounded)
            raw, made = found.raw, [_prepared(record, source) for record in found.data]
        around.say(
            f"read {name}: {len(raw)} record{'s' * (len(raw) > 1)}, {made[0].u.shape[0]} samples used as {source.use}; {found.how}"
        )
        if found.level is not None:
            around.say(found.level_words('initial = "rest"'))
        _say_bound(around, name, source.bound, found.bound, made[0])
        stated = dataclasses.replace(source, bound=found.bound, correct=found.correct)
        sources.append(_with_digest(_with_past(stated, raw[0]), raw, place))
        records.append((source.use, made))
    every, said = with_all_inputs([one for _, made in records for one in made])
    if said:
        around.say(said)
        records = [(use, [every.pop(0) for _ in made]) for use, made in records]
    return dataclasses.replace(run, record=tuple(sources)), records


def _responses(
    run: RunFile, folder: Path, around: Surroundings, tables: Tables
) -> tuple[RunFile, list[FrequencyResponse]]:
    """The responses that were measured elsewhere."""
    sources: list[ResponseSource] = []
    responses: list[FrequencyResponse] = []
    for k, source in enumerate(run.frequency, start=1):
        place = f"[[frequency]] {k}, {source.file}"
        with _said_of(place):
            found = read_source(source, folder, tables, bounded=True)
            frf, table = found.data[0], tables.of(folder / str(source.file), source.decimal)
        around.say(f"read {source.file}: {counted(frf.omega.size, 'frequency point')}; {found.how}")
        sources.append(_with_digest(dataclasses.replace(source, bound=found.bound), found.corrected, place))
        for fault in response_faults(found.corrected[0]):
            around.say(f"{source.file}: {fault}")
        if frf.dt is None and not origin(table, source.kind, source.fields).continuous:
            around.say(
                f"{source.file} has no sample time: it is taken as a response of continuous time (dt = ... says otherwise)"
            )
        _say_bound(around, str(source.file), source.bound, found.bound, frf)
        responses.append(frf)
    return dataclasses.replace(run, frequency=tuple(sources)), responses


def _opened(
    run: RunFile, folder: Path, around: Surroundings, records: Used, read: list[FrequencyResponse]
) -> tuple[Loop | None, Used, list[FrequencyResponse], tuple[Fault, ...]]:
    """The loop that the data were measured in, records and responses of R, and faults of the records as they were; without one as
    they are.
    """
    if not run.loop.is_stated:
        return None, records, read, ()
    excited, how = [one for _, made in records for one in made], run.estimate
    estimate: dict[str, object] = {"period": how.period, "method": how.method, "probability": how.probability}
    loop = loop_of(run.loop, folder, excited, read, estimate)
    around.say(auxiliary_words(loop, run.loop))
    faults = faults_of(loop, excited, how.period) if excited else ()
    for fault in faults:
        around.say(f"records: {fault}")
    period = how.period if how.method in (None, "periodic") else None
    opened = [(use, [loop.opened(one, period=period) for one in made]) for use, made in records]
    return loop, opened, [loop.opened_response(one) for one in read], faults


def _origins(records: Used, estimated: int, read: int) -> Origins:
    """The sources of what was made of records, and of what was read."""
    places = [(use, Place("record", k)) for k, (use, made) in enumerate(records) for _ in made]
    of_use = {word: tuple(place for use, place in places if use == word) for word in USES}
    responses = (*[None] * estimated, *(Place("frequency", k) for k in range(read)))
    return Origins(responses, of_use["samples"], of_use["response"])


@contextlib.contextmanager
def _said_of(place: str) -> Generator[None]:
    """Say of which source a sentence is."""
    try:
        yield
    except (InputError, InputTypeError, FileFormatError) as error:
        raise type(error)(f"{place}: {error.said(RUN_FILE, in_run_file)}") from None


def _with_digest(source: S, data: Sequence[Data], place: str) -> S:
    """The source with the digest of what was read; refused where it was made with other data."""
    names = ("u", "y", "reference", "omega", "values", "bound")
    arrays = {f"{k}/{n}": a for k, d in enumerate(data) for n in names if (a := getattr(d, n, None)) is not None}
    have = digest(arrays)
    if source.digest not in (None, have):
        raise InputError(
            f"{place}: these aren't the data that the run file was made with; leave digest out to use them"
        )
    return dataclasses.replace(source, digest=have)


def _prepared(record: TimeRecord, source: RecordSource) -> TimeRecord:
    """Outputs combined, a part cut out, offsets removed, fewer samples: in this order."""
    if source.combine is not None:
        record = _combined(record, source.combine)
    if source.start is not None or source.stop is not None:
        record = record.window(source.start or 0.0, source.stop, past=str(_with_past(source, record).past))
    if source.detrend is not None:
        record = _detrended(record, source)
    return record if source.decimate is None else decimate(record, source.decimate)


def _detrended(record: TimeRecord, source: RecordSource) -> TimeRecord:
    """The record without its offset or drift; a bound of one from an unknown state is about what is left of it.

    Nothing bounds what a transient leaves in the mean of such a record.
    """
    kind, until = source.detrend or "mean", source.until
    if record.bound is None or record.initial != "free":
        return detrend(record, kind=kind, until=until)
    bound, note = record.bound, record.note
    return detrend(record.with_bound(None), kind=kind, until=until).with_bound(
        bound, f"{note or 'bound as stated'}, of what is left by detrend"
    )


def _with_past(source: RecordSource, record: TimeRecord) -> RecordSource:
    """The source with what is known of the input outside the part of the record that is used."""
    if source.past is not None or (source.start is None and source.stop is None):
        return source
    usual = "known" if source.use == "samples" else "periodic" if record.initial == "periodic" else "unknown"
    return dataclasses.replace(source, past=usual)


def _combined(record: TimeRecord, weights: Mapping[str, float]) -> TimeRecord:
    names = [output.name for output in record.outputs]
    if missing := [name for name in weights if name not in names]:
        raise InputError(f"combine names {missing[0]!r}; the outputs are {', '.join(names)}")
    w = np.array([weights.get(name, 0.0) for name in names])
    bound = record.bound
    if bound is not None:
        used = w != 0
        bound = dataclasses.replace(bound, radius=bound.radius[:, used] @ np.abs(w[used]))
    units = {output.unit for output, weight in zip(record.outputs, w, strict=True) if weight}
    label = " + ".join(name if weights[name] == 1 else f"{weights[name]:g} {name}" for name in weights)
    output = (label, units.pop() if len(units) == 1 else "")
    return dataclasses.replace(record, y=record.y @ w, bound=bound, outputs=[output])


def _say_bound(
    around: Surroundings, name: str | None, stated: float | str | None, taken: float | str | None, data: Data
) -> None:
    """Say what a bound was taken from that nobody stated."""
    if taken != stated:
        around.say(f"{name} states no error bound, so it is taken from the data: {data.bound.words(data.note)}")


def _with_method(run: RunFile, records: Used) -> RunFile:
    """The method that `estimate_frf` takes by itself, said."""
    excited = [record for use, made in records if use == "response" for record in made]
    if run.estimate.method is not None or not excited:
        return run
    periodic = run.estimate.period is not None or all(record.initial == "periodic" for record in excited)
    return run.changed("estimate", method="periodic" if periodic else "local")


def _bounded(run: RunFile, records: Used) -> tuple[RunFile, Measured]:
    """The response of the records that are used for one, and the samples of the others, with bounds from the noise floor."""
    quiet = next((made[0] for use, made in records if use == "noise_floor"), None)
    noise = None if quiet is None else bounds_from_noise_floor(quiet, factor=run.estimate.noise_floor_factor)
    excited = [record for use, made in records if use == "response" for record in made]
    estimated, kept = [], Split([], (), "records")
    if excited:
        run, kept = split(run, excited)
        how = run.estimate
        frf = estimate_of(run)(
            kept.used, period=how.period, method=how.method, probability=how.probability, about=how.about
        )
        estimated = [frf if noise is None else noise.bound_response(frf, kept.used, period=how.period)]
    samples: list[TimeRecord] = []
    for record in (record for use, made in records if use == "samples" for record in made):
        samples.append(record if record.bound is not None else noise.bound_record(record))  # type: ignore[union-attr]
    return run, Measured(tuple(estimated), tuple(samples), kept.withheld, kept.kind, tuple(kept.used))


def _without_delay(run: RunFile, data: Measured) -> tuple[RunFile, Measured]:
    source, note, seconds = run.delay.source, run.delay.note, 0.0
    if isinstance(run.delay.seconds, float):
        seconds = run.delay.seconds
    else:
        if not data.responses:
            raise InputError('[delay] seconds = "auto" needs a frequency response; give the seconds')
        found = estimate_delay(data.responses[0])
        dt = float(data.responses[0].dt or 0)
        whole = any(record.initial != "periodic" for record in data.records)
        seconds = round(found.seconds / dt) * dt if whole else found.seconds
        source, note = (
            None,
            (
                f"Delay of {seconds:.6g} s taken out of all data, estimated from the response: {found.seconds:.6g} s with standard"
                f" deviation {found.deviation:.2g} s" + (", rounded to whole samples for the records" if whole else "")
            ),
        )
    if not seconds:
        return run.changed("delay", seconds=0.0), data
    if source is None:  # nothing was said of it yet
        source = Source.STATED if isinstance(run.delay.seconds, float) else Source.DATA
        note = note or f"Delay of {seconds:.6g} s taken out of all data, as stated"
        note += "; the models are those of the plant without it, with_delay(model, seconds) puts it back"
    kept = data.each(lambda item: item.without_delay(seconds))
    return run.changed("delay", seconds=float(seconds), source=source, note=note), kept
