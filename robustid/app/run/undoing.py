"""Text that undoes a fault of the data where it is pasted: the command as it was called, or a line of the run file."""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from robustid.app.run.run_file import RunFile
from robustid.app.run.toml import write_toml
from robustid.data import Fault, FaultKind, FrequencyResponse, PlacedFault, Undoing
from robustid.estimation import all_faults

if TYPE_CHECKING:
    from robustid.app.run.measurements import Measured, Place

_LEAVE_OUT, _ABOVE, _BELOW = "leave out ", "above ", "below "
_POINTS = "frequency_points"


def command_line(arguments: Sequence[str]) -> str:
    """Arguments of the program as one line for the shell of this machine."""
    words = ["robustid", *arguments]
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def with_option(arguments: Sequence[str], flag: str, value: str) -> list[str]:
    """Arguments of a command with one more value of an option that takes several, separated by commas."""
    found = list(arguments)
    for k in range(len(found) - 1, -1, -1):
        name, equals, given = found[k].partition("=")
        if name == flag:
            if equals:
                found[k] = f"{flag}={given}, {value}"
            else:
                found[k + 1] = f"{found[k + 1]}, {value}"
            return found
    return [*found, flag, value]


def with_value(arguments: Sequence[str], flag: str, value: str) -> list[str]:
    """Arguments of a command with another value of an option that it was called with."""
    before = ["", *arguments[:-1]]
    changed = (value if last == flag else word for last, word in zip(before, arguments, strict=True))
    return [f"{flag}={value}" if word.startswith(f"{flag}=") else word for word in changed]


def options_among(arguments: Sequence[str], flags: set[str]) -> list[str]:
    """Options with one value that a command was called with, as far as they are among the flags."""
    found: list[str] = []
    for k, word in enumerate(arguments):
        name, equals, _ = word.partition("=")
        if name in flags:
            found += [word] if equals else arguments[k : k + 2]
    return found


def again(arguments: Sequence[str]) -> list[str]:
    """Arguments of a command that was carried out, to replace what it has written."""
    return [*arguments] if "--force" in arguments else [*arguments, "--force"]


def in_command(
    called: Sequence[str], faults: Sequence[PlacedFault], frequency: Sequence[Path], time: Sequence[Path]
) -> Undoing | None:
    """The command with what undoes the first fault that has a correction; None where there is no such fault.

    `frequency` and `time` are the files of the experiments.
    """
    for fault, kind, number in faults:
        files = frequency if kind == "frequency" else time
        if not _undoable(fault) or (kind == "frequency" and fault.of_records):
            continue
        said = fault.correction
        if number is not None and len(set(files)) > 1:
            said = f"{files[number]}: {said}"
        if number is None or files.count(files[number]) == 1:
            return Undoing(fault, command_line(with_option(called, f"--{kind}-correct", said)))
    return None


def in_run_file(
    asked: RunFile, name: str, command: str, data: Measured, faults: Sequence[PlacedFault]
) -> Undoing | None:
    """The line of the run file that undoes the first fault that has a correction; None where there is no such line."""
    for fault, kind, number in faults:
        if not _undoable(fault):
            continue
        line = _line_of_source(asked, _place(fault, kind, number, data), fault.correction)
        if line is None and kind == "frequency" and number is not None and data.origins.responses[number] is None:
            line = _line_of_points(asked, fault.correction, data)
        if line is not None:
            return Undoing(fault, line.text, f"{name}, {line.place}", command)
    return None


def in_run_file_of_member(
    asked: RunFile, name: str, command: str, member: str, data: Measured, faults: Sequence[PlacedFault]
) -> Undoing | None:
    """The same of a member, whose data came from the sources that are its own or of all."""

    def whole(place: Place) -> Place:
        own = [k for k, source in enumerate(getattr(asked, place.section)) if source.member in (member, None)]
        return place._replace(number=own[place.number])

    responses, records, excited = data.origins
    origins = data.origins._replace(
        responses=tuple(None if one is None else whole(one) for one in responses),
        records=tuple(map(whole, records)),
        excited=tuple(map(whole, excited)),
    )
    return in_run_file(asked, name, command, data._replace(origins=origins), faults)


def _undoable(fault: Fault) -> bool:
    return bool(fault.correction) and not fault.undone


class _Line(NamedTuple):
    """A line of a run file, and its place there."""

    text: str
    place: str


def placed_faults(frf: FrequencyResponse, records: int = 0) -> list[PlacedFault]:
    """Faults of a response; those of the records that it was estimated from, if so many were read with it, placed there."""
    alone = 0 if records == 1 else None
    return [
        PlacedFault(fault, "time", fault.record - 1 if fault.record else alone)
        if records and fault.of_records
        else PlacedFault(fault, "frequency", 0)
        for fault in all_faults(frf)
    ]


def _place(fault: Fault, kind: str, number: int | None, data: Measured) -> Place | None:
    """The source that a fault is of; None where it is of no single one, or of an estimate."""
    origins = data.origins
    if kind == "frequency" and number is not None and (read := origins.responses[number]) is not None:
        return None if fault.of_records else read
    if kind == "frequency":
        if not fault.of_records and fault.kind is not FaultKind.EXCHANGED:
            return None
        number, of = (fault.record - 1 if fault.record else None), origins.excited
    else:
        of = origins.records
    if number is not None:
        return of[number] if number < len(of) and of.count(of[number]) == 1 else None
    return of[0] if len(set(of)) == 1 else None


def _line_of_source(asked: RunFile, place: Place | None, correction: str) -> _Line | None:
    """The corrections of a source with one more."""
    if place is None:
        return None
    source = getattr(asked, place.section)[place.number]
    where = f"[[{place.section}]] {place.number + 1} ({source.file or source.dataset})"
    if source.correct:
        where += ", in place of its correct = ..."
    if place.section == "frequency" and source.digest is not None:
        where += ", without its digest = ..."
    return _Line(_line("correct", [*(source.correct or ()), correction]), where)


def _line_of_points(asked: RunFile, correction: str, data: Measured) -> _Line | None:
    """The frequency points that are left out of a response that was estimated."""
    if not correction.startswith(_LEAVE_OUT):
        return None
    left_out, points = correction.removeprefix(_LEAVE_OUT), asked.frequency_points
    low, high = points.band_hz or (0.0, 0.5 / data.dt if data.dt else None)
    before = {"band_hz": points.band_hz, "leave_out_hz": points.leave_out_hz}
    if left_out.startswith(_ABOVE):
        name, value = "band_hz", [low, float(left_out.removeprefix(_ABOVE))]
    elif left_out.startswith(_BELOW):
        name, value = "band_hz", [float(left_out.removeprefix(_BELOW)), high]
    else:
        name, value = "leave_out_hz", [*(points.leave_out_hz or ()), *map(float, left_out.split())]
    if None in value or (name == "band_hz" and any(one is not None for one in data.origins.responses)):
        return None  # of other responses nothing is left out
    where = f"[{_POINTS}]" + (f", in place of its {name} = ..." if before[name] is not None else "")
    return _Line(_line(name, value), where)


def _line(name: str, value: Sequence[object]) -> str:
    """A line of TOML."""
    return write_toml({name: list(value)}).strip()
