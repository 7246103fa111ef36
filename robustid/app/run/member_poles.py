"""The poles of the members of a family: as stated, or of each from its own data, as many of all."""

from __future__ import annotations

import dataclasses

from robustid.app.run.fewer_modes import INTEGRATOR, superfluous, without_mode, without_number
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import with_fit, with_modes
from robustid.app.run.posing import without_class
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import RunFolder, Surroundings
from robustid.app.run.settings import Modes
from robustid.app.run.sources import MemberChoice
from robustid.core import Source, hz_words
from robustid.errors import InputError

_NO_BOX = {"damping": None, "hz_interval": None, "damping_interval": None}
POLES = ("hz", *_NO_BOX)  # keys that say which poles a plant has


def with_poles(run: RunFile, data: dict[str, Measured], around: Surroundings) -> RunFile:
    """The poles of all members: from the data of each where they aren't stated, as many as the first shows; with the box that
    its data leave them where the band is to cover it; without those that the data of a member cannot tell apart.
    """
    asked, (name, first) = run, next(iter(data.items()))
    run = with_modes(with_fit(run, first, around), first, around)
    if not run.modes.hz:
        return run
    if asked.modes.hz is None:
        run = run.changed("modes", note=f"{run.modes.note}\nOf {name}, the first of the members.")
    if run.worst_case.over_poles:
        run = _with_boxes(run, data, around)
    elif asked.modes.hz is None:
        run = _with_own(run, asked, data, around)
    return _told_apart(run, asked, data)


def _with_own(run: RunFile, asked: RunFile, data: dict[str, Measured], around: Surroundings) -> RunFile:
    """The poles of every member from its own data; those of the first where they show no such number, which the note says."""
    first, found, words = run.members[0].name, list(run.members), [run.modes.note]
    for k, member in enumerate(run.members):
        if member.hz is not None or not k:
            continue
        around.say(f"looking for the modes of {member.name}")
        modes = _own_modes(run, asked, data[member.name], around)
        if modes is None:
            words.append(f"{member.name}: those of {first}; its own data show no such number of modes.")
            continue
        found[k] = dataclasses.replace(member, **{name: getattr(modes, name) for name in POLES})
        words.append(f"{member.name}: {', '.join(hz_words(hz) for hz in modes.hz or ())}, from its own data.")
    return dataclasses.replace(run, members=tuple(found)).changed("modes", note="\n".join(map(str, words)))


def _own_modes(run: RunFile, asked: RunFile, data: Measured, around: Surroundings) -> Modes | None:
    """Modes that data show, as many and as many real ones as the run has; None where they show no such number."""
    alone = dataclasses.replace(around, folder=RunFolder())  # the fit that is kept is of the first member
    for count in (None, len(run.modes.hz or ())):
        open_run = _open(run, count).changed("modes", integrators=asked.modes.integrators)
        if count is not None:
            open_run = open_run.changed("fit", order=None)
        try:
            modes = with_modes(with_fit(open_run, data, alone), data, alone).modes
        except InputError:
            continue
        if _shape(modes) == _shape(run.modes):
            return modes
    return None


def _shape(modes: Modes) -> list[bool]:
    """Real poles and pairs of modes, whose functions differ in number."""
    return sorted(damping == 1 for damping in modes.damping or ())


def _open(run: RunFile, count: int | None) -> RunFile:
    """The run file with modes that are to be looked for, so many or any."""
    return run.changed("modes", hz=None, count=count, source=None, note=None, **_NO_BOX)


def _told_apart(run: RunFile, asked: RunFile, data: dict[str, Measured]) -> RunFile:
    """The run file without modes, of all members, that the program chose and the data of a member cannot tell apart."""
    if any(member.hz is not None for member in asked.members):
        return run
    while (number := _superfluous(run, asked, data)) is not None:
        members = run.members
        if number != INTEGRATOR:
            members = tuple(
                m if m.hz is None else dataclasses.replace(m, **without_number(m, number)) for m in run.members
            )
        run = dataclasses.replace(run, modes=without_mode(run.modes, number), members=members)
    return run


def _superfluous(run: RunFile, asked: RunFile, data: dict[str, Measured]) -> int | None:
    for name, mine in data.items():
        modes = modes_of(run, name)
        number = superfluous(modes, asked.modes, without_class(run, mine, modes)[1])
        if number is not None:
            return number
    return None


def _with_boxes(run: RunFile, data: dict[str, Measured], around: Surroundings) -> RunFile:
    """The poles of every member with the box that its own data leave them, where the band is to cover it."""
    found: list[MemberChoice] = []
    one_box = run.modes.hz_interval is not None and run.modes.source is not Source.DATA
    for member in run.members:
        own = member
        if own.hz is None and one_box:
            own = dataclasses.replace(member, **{name: getattr(run.modes, name) for name in POLES})
        elif own.hz is None:
            around.say(f"looking for the modes of {member.name}")
            try:
                modes = with_modes(_open(run, len(run.modes.hz or ())), data[member.name], around).modes
            except InputError as error:
                raise InputError(f"modes of member {member.name!r}: {error}") from None
            own = dataclasses.replace(member, **{name: getattr(modes, name) for name in POLES})
        if own.hz_interval is None or len(own.hz or ()) != len(run.modes.hz or ()):
            raise InputError(
                f"over_poles = true needs the poles of member {member.name!r} and their box, and its data show"
                f" {len(own.hz or ())} of the {len(run.modes.hz or ())} modes of [modes]: give hz, damping, hz_interval and"
                " damping_interval in its [[members]], or leave over_poles out"
            )
        found.append(own)
    return dataclasses.replace(run, members=tuple(found))


def modes_of(run: RunFile, name: str) -> Modes:
    """The poles of a member: its own, or those of all."""
    own = next(member for member in run.members if member.name == name)
    if own.hz is None:
        return run.modes
    return dataclasses.replace(run.modes, **{pole: getattr(own, pole) for pole in POLES})
