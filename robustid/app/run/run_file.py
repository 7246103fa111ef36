"""The run file: what is measured, and every choice from there to the report; what isn't stated is left to the program."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from robustid._version import __version__
from robustid.app.run.checks import AUTO, options, refuse_unknown, section
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.controller_settings import ControllerChoice
from robustid.app.run.loop_settings import LoopChoice
from robustid.app.run.settings import (
    LISTS,
    SECTIONS,
    Delay,
    Fit,
    FrequencyPoints,
    General,
    Identify,
    Modes,
    SmallModel,
    Withheld,
    WorstCase,
)
from robustid.app.run.sources import Estimate, FamilyChoice, MemberChoice, RecordSource, ResponseSource
from robustid.app.run.toml import is_array, is_table, read_toml, write_toml
from robustid.core import Choice, Frozen, Record, Source, digest
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", RecordSource, ResponseSource)
MODES_NOTE = "Modes taken from the frequency response:\n"
RECORD_MODES_NOTE = "Modes taken from a fit of the records:\n"
PRIOR_NOTE = "Prior taken from the curve of the smallest gain bound:\n"
_CHOICES = {  # name of a choice: its section, what its source, note and digest begin with, and the keys that are chosen
    "delay": ("delay", "", ("seconds",)),
    "modes": ("modes", "", ("hz", "damping")),
    "inflate": ("identify", "inflate_", ("inflate",)),
    "prior": ("prior", "", ("gain_bound", "decay_rate", "decay")),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunFile(Frozen, General):
    """Everything that a run is told; see `robustid run --help` for a file with every section."""

    record: tuple[RecordSource, ...] = ()
    frequency: tuple[ResponseSource, ...] = ()
    members: tuple[MemberChoice, ...] = ()
    family: FamilyChoice = dataclasses.field(default_factory=FamilyChoice)
    loop: LoopChoice = dataclasses.field(default_factory=LoopChoice)
    estimate: Estimate = dataclasses.field(default_factory=Estimate)
    delay: Delay = dataclasses.field(default_factory=Delay)
    frequency_points: FrequencyPoints = dataclasses.field(default_factory=FrequencyPoints)
    withheld: Withheld = dataclasses.field(default_factory=Withheld)
    fit: Fit = dataclasses.field(default_factory=Fit)
    modes: Modes = dataclasses.field(default_factory=Modes)
    prior: PriorChoice = dataclasses.field(default_factory=PriorChoice)
    identify: Identify = dataclasses.field(default_factory=Identify)
    small_model: SmallModel = dataclasses.field(default_factory=SmallModel)
    worst_case: WorstCase = dataclasses.field(default_factory=WorstCase)
    controller: ControllerChoice = dataclasses.field(default_factory=ControllerChoice)

    def __post_init__(self) -> None:
        _check_fit(self)
        _check_modes(self)
        _check_loop(self)
        _check_controller(self)
        self.prior.check({"gain_bound": "[prior] gain_bound", "passive": "[prior] passive"})
        points = self.frequency_points
        if points.near_hz is not None and points.every == 1:
            raise InputError(
                "[frequency_points] near_hz keeps points that every would leave out; give every = 2 or more too"
            )
        if points.band_hz is not None and not points.band_hz[0] < points.band_hz[1]:
            raise InputError(f"[frequency_points] band_hz must be [low, high]; got {list(points.band_hz)}")
        wanted = [name for name in ("circle", "over_poles") if getattr(self.worst_case, name)]
        if wanted and not self.worst_case.compute:
            raise InputError(f"[worst_case] {wanted[0]} = true contradicts compute = false")
        if self.worst_case.at_hz == ():
            raise InputError("[worst_case] at_hz is empty; leave it out, or say compute = false")

    @property
    def choices(self) -> dict[str, Choice]:
        """The choices that were left to the program, by their names; and what else a note was written on."""
        found: dict[str, Choice] = {}
        for name, (place, start, keys) in _CHOICES.items():
            part = getattr(self, place)
            value = {one: getattr(part, one) for one in keys if getattr(part, one) is not None}
            source, note = getattr(part, f"{start}source"), getattr(part, f"{start}note")
            if note or source:
                found[name] = Choice(value, source or Source.STATED, note or "", getattr(part, "curve", None) or "")
        return found

    def changed(self, name: str, **values: object) -> RunFile:
        """With other values in one section."""
        return dataclasses.replace(self, **{name: dataclasses.replace(getattr(self, name), **values)})

    def text(self) -> str:
        """As TOML; `read_run_file` gives back the same."""
        content = {name: value for name, value in dataclasses.asdict(self).items() if value != ()}
        for name, choice in self.choices.items():
            place, start, _ = _CHOICES[name]
            if choice.source != Source.STATED:
                content[place][f"{start}digest"] = _digest(choice)
        head = f"# Run file of robustid {__version__}: robustid run FILE -o FOLDER\n"
        if not self.record and not self.frequency:
            head += "# The data were given in Python: name their files in [[frequency]] and [[record]] to run it.\n"
        return head + "\n" + write_toml(content)

    def moved(self, old: Path, new: Path) -> RunFile:
        """With the names of files as seen from another folder."""

        def name(file: str) -> str:
            path = (old / file).resolve()
            try:
                return Path(os.path.relpath(path, new.resolve())).as_posix()
            except ValueError:  # another drive
                return str(path)

        return self._renamed(name)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all files that are read, each once."""
        found: list[str] = []
        self._renamed(lambda name: found.append(name) or name)
        return tuple(dict.fromkeys(found))

    def _renamed(self, name: Callable[[str], str]) -> RunFile:
        """With other names of its files."""

        def seen(source: S) -> S:
            return source if source.file is None else dataclasses.replace(source, file=name(source.file))

        record, frequency = tuple(map(seen, self.record)), tuple(map(seen, self.frequency))
        named = {
            one: name(file) for one in ("controller", "auxiliary") if (file := getattr(self.loop, one)) is not None
        }
        loop = dataclasses.replace(self.loop, **named)
        if loop.candidates is not None:
            loop = dataclasses.replace(loop, candidates=tuple(map(name, loop.candidates)))
        designed = self.controller.renamed(name)
        return dataclasses.replace(self, record=record, frequency=frequency, loop=loop, controller=designed)

    def of_member(self, name: str) -> RunFile:
        """The run file of one member alone; a record of the noise floor is of all that don't have their own."""
        record, frequency = (
            tuple(source for source in sources if source.member in (name, None))
            for sources in (self.record, self.frequency)
        )
        return dataclasses.replace(self, record=record, frequency=frequency, members=())

    def with_member(self, name: str, stated: RunFile) -> RunFile:
        """With what was read and chosen for one member."""
        record, frequency = iter(stated.record), iter(stated.frequency)
        return dataclasses.replace(
            stated,
            record=tuple(next(record) if source.member in (name, None) else source for source in self.record),
            frequency=tuple(next(frequency) if source.member in (name, None) else source for source in self.frequency),
            members=self.members,
        )

    def agrees(self, asked: RunFile) -> bool:
        """True if this answers what was asked: every value stated there is the same here."""
        many = [[len(getattr(run, name)) for name in LISTS] for run in (self, asked)]
        if many[0] != many[1]:
            return False
        pairs: list[tuple[DataclassInstance, DataclassInstance]] = [*zip(self.record, asked.record, strict=True)]
        pairs += zip(self.frequency, asked.frequency, strict=True)
        pairs += zip(self.members, asked.members, strict=True)
        pairs += [(getattr(self, name), getattr(asked, name)) for name in SECTIONS]
        open_values = (None, AUTO)
        points = FrequencyPoints()  # the program takes fewer where it must
        alike = all(
            getattr(have, f.name) == value or value in open_values or (want == points and f.name == "every")
            for have, want in pairs
            for f in dataclasses.fields(want)
            for value in [getattr(want, f.name)]
        )
        same = [(run.title, run.entry, run.column) for run in (self, asked)]
        return alike and same[0] == same[1]


def _check_fit(run: RunFile) -> None:
    """Refuse options of a fit that isn't asked for, and modes that are stated beside it."""
    fit, modes = run.fit, run.modes
    if fit.order is None:
        if fit != Fit():
            raise InputError('[fit] needs order = ..., a whole number or "auto"')
        return
    if fit.modal is None and (fit.symmetric or fit.quantity is not None):
        raise InputError("[fit] symmetric and quantity belong to a structure of the modes: give modal too")
    if modes.count is not None or (modes.hz is not None and modes.source != Source.DATA):
        raise InputError("[fit] takes the modes from a fit, [modes] states them otherwise: give one of them")


def _check_loop(run: RunFile) -> None:
    """Refuse what does not go with a plant in a loop."""
    run.loop.check("[loop]")
    if not run.loop.is_stated:
        return
    others = [source.use for source in run.record if source.use != "response"]
    wrong = {
        "[[members]]": bool(run.members),
        "entry": run.entry is not None,
        "column": run.column is not None,
        "[delay]": run.delay.seconds != 0.0,
        f"[[record]] use = {others[0] if others else ''!r}": bool(others),
    }
    for name, is_there in wrong.items():
        if is_there:
            raise InputError(
                f"{name} does not go with [loop]: records of a loop give the response of its stable system R, of all entries"
            )


def _check_controller(run: RunFile) -> None:
    """Refuse limits of a controller that is not asked for, and one that no band would be there for."""
    run.controller.check("[controller]")
    if not run.controller.is_stated:
        return
    if not run.worst_case.compute:
        raise InputError("[controller] needs the band of all consistent plants; leave [worst_case] compute = false out")


def _check_poles(place: str, modes: Modes | MemberChoice) -> None:
    """Refuse poles that are half stated, or in percent."""
    for name in ("damping", "hz_interval", "damping_interval"):
        value = getattr(modes, name)
        if value is not None and (modes.hz is None or len(value) != len(modes.hz)):
            size = "none" if modes.hz is None else str(len(modes.hz))
            raise InputError(f"{place} {name} has {len(value)} items, hz has {size}; give one of each for every mode")
    if modes.hz and modes.damping is None:
        raise InputError(f"{place} hz is given without damping; give both, or neither to have them taken from the data")
    if bad := [d for d in modes.damping or () if d > 1]:
        raise InputError(f"{place} damping is a ratio below 1, not percent; got {bad[0]:g} (1 stands for a real pole)")
    if (modes.hz_interval is None) != (modes.damping_interval is None):
        raise InputError(
            f"{place} hz_interval and damping_interval make one pole-uncertainty box; give both or neither"
        )


def _check_modes(run: RunFile) -> None:
    modes = run.modes
    _check_poles("[modes]", modes)
    if modes.hz is not None and modes.count is not None:
        raise InputError("[modes] count says how many to look for, hz which they are; give one of them")
    for k, member in enumerate(run.members, start=1):
        _check_poles(f"[[members]] {k}:", member)
        if member.hz is not None and modes.hz is not None and len(member.hz) != len(modes.hz):
            raise InputError(
                f"[[members]] {k}: hz has {len(member.hz)} items, that of [modes] {len(modes.hz)}; the poles may differ between"
                " members, their number may not"
            )


def _digest(choice: Choice) -> str:
    return digest({}, choice.value)


def _without_digests(run: RunFile) -> RunFile:
    """The run file, whose chosen values are those that were chosen: nobody has changed them."""
    for name, (place, start, _) in _CHOICES.items():
        key, choice = f"{start}digest", run.choices.get(name)
        have = getattr(getattr(run, place), key)
        if have is None or choice is None:
            continue
        if have != _digest(choice):
            raise InputError(
                f"[{place}] {start}note tells how other values were chosen than {_listed(choice.value)}: leave"
                f" {start}source, {start}note and {key} out, or write your own note"
            )
        run = run.changed(place, **{key: None})
    return run


def _listed(value: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {list(one) if is_array(one) else one}" for key, one in value.items())


def read_run_file(
    source: str | os.PathLike[str] | Mapping[str, object], place: str = "the run file", *, sources: bool = True
) -> RunFile:
    """A `RunFile` from a TOML file or its content: every key known, every value of its type, no contradiction.

    `place` is its name in sentences; with `sources` it must say where the data are.
    """
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        source, place = read_toml(path), path.name
    if not is_table(source):
        raise InputTypeError(f"{place} must be a path or a table of sections; got {type(source).__name__}")
    try:
        plain = {field.name: option.check for field, option in options(RunFile)}
        refuse_unknown(source, [*plain, *LISTS, *SECTIONS], "the file")
        parts: Record = {name: plain[name](name, source[name]) for name in plain if name in source}
        for name, kind in LISTS.items():
            items = source.get(name, [])
            if not is_array(items):
                raise InputTypeError(f"{name} must be written [[{name}]], once for each")
            parts[name] = tuple(section(kind, item, f"[[{name}]] {k + 1}:") for k, item in enumerate(items))
        parts |= {name: section(kind, source[name], f"[{name}]") for name, kind in SECTIONS.items() if name in source}
        run = _without_digests(RunFile(**parts))
        if sources:
            _check_sources(run)
    except (InputError, InputTypeError) as error:
        raise type(error)(f"{place}: {error}") from None
    return run


def _check_members(run: RunFile) -> None:
    """Refuse members without names or data, and data of members that are not there."""
    names = [m.name for m in run.members]
    sources = [(f"[[record]] {k}", s) for k, s in enumerate(run.record, start=1)]
    sources += [(f"[[frequency]] {k}", s) for k, s in enumerate(run.frequency, start=1)]
    for place, source in sources:
        if source.member is not None and source.member not in names:
            raise InputError(f"{place}: member = {source.member!r} is the name of none of the [[members]]")
        if names and source.member is None and getattr(source, "use", None) != "noise_floor":
            raise InputError(
                f"{place} needs member = ..., the name of the one of the [[members]] that it was measured of"
            )
    if run.members and len(names) < 2:
        raise InputError("one [[members]] makes no family: give two or more, or none for a plant by itself")
    for k, name in enumerate(names, start=1):
        if not name or names.count(name) > 1:
            raise InputError(f"[[members]] {k} needs name = ..., one of its own")
        if not any(source.member == name for _, source in sources):
            raise InputError(f"[[members]] {k}: no [[record]] and no [[frequency]] has member = {name!r}")
    if run.members and not run.worst_case.compute:
        raise InputError(
            "[worst_case] compute = false leaves nothing of a family; leave it out where there are [[members]]"
        )


def _check_sources(run: RunFile) -> None:
    """Refuse what contradicts itself, before any file is opened."""
    _check_members(run)
    lone = run.worst_case.over_poles and not run.members
    if lone and run.modes.hz is not None and run.modes.hz_interval is None:
        raise InputError(
            "[worst_case] over_poles = true needs the pole-uncertainty box: give hz_interval and damping_interval in [modes]"
        )
    if run.entry is not None and run.column is not None:
        raise InputError("entry is one of a column: leave column out, or entry for all outputs of that input")
    if not run.record and not run.frequency:
        raise InputError("no data: give [[record]] or [[frequency]] with file = ..., or dataset = ... in a [[record]]")
    for k, source in enumerate(run.record, start=1):
        if (source.file is None) == (source.dataset is None):
            raise InputError(f"[[record]] {k} needs either file or dataset")
        if source.combine is not None and run.entry is not None and run.entry[0] != 0:
            raise InputError(f"[[record]] {k}: combine leaves one output, number 0; entry asks for {run.entry[0]!r}")
        if source.past is not None and source.start is None and source.stop is None:
            raise InputError(f"[[record]] {k}: past belongs to a part of the record: give start or stop too")
        if source.until is not None and source.detrend is None:
            raise InputError(f"[[record]] {k}: until belongs to detrend, which is missing")
        if source.start is not None and source.stop is not None and source.start >= source.stop:
            raise InputError(f"[[record]] {k}: start = {source.start:g} s must be before stop = {source.stop:g} s")
    for k, source in enumerate(run.frequency, start=1):
        if source.file is None:
            raise InputError(f"[[frequency]] {k} needs file")
    uses = [source.use for source in run.record]
    if (run.estimate.method or run.estimate.period) and "response" not in uses:
        raise InputError(
            '[estimate] is about records that become a response; there is no [[record]] with use = "response"'
        )
    if uses.count("noise_floor") > max(1, len(run.members)):
        raise InputError('only one [[record]] can have use = "noise_floor"')
    if uses == ["noise_floor"] and not run.frequency:
        raise InputError('a record with use = "noise_floor" bounds others; there is nothing to bound')
    if "response" not in uses and not run.frequency and run.modes.hz is None and run.modes.count is not None:
        raise InputError("[modes] count needs a frequency response to look for modes in; give hz and damping instead")
