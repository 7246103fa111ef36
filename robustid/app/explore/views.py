"""The pages of a run file: one for every entry of a matrix, and of every member of a family, with a class of its own."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from robustid.app.explore.session import Session, Shared
from robustid.app.run.measurements import Measured, all_entries, without_points
from robustid.app.run.member_poles import POLES, modes_of
from robustid.app.run.reading import Tables
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sources import MemberChoice
from robustid.core import Progress, counted
from robustid.errors import InputError

Entry = tuple[int | str, int | str]
Page = tuple[str, Entry | None]  # the member and the entry
_TOGETHER = (
    "One class for all members, from their pages in robustid explore: the largest gain bound and the smallest decay."
)


class View(NamedTuple):
    """A page: its name in the list of them, and what opens it."""

    name: str
    open: Callable[[Progress], Session]


class Family:
    """The members of a run file, with the run files that the pages of those state that were opened."""

    def __init__(self, run: RunFile) -> None:
        self._run = run
        self._data: dict[Page, Measured] = {}
        self._stated: dict[Page, RunFile] = {}

    def joined(self, page: Page, session: Session) -> Session:
        """The session of a page, which writes the run file of all members."""
        self._data[page] = session.data
        note, whole = functools.partial(self._note, page), functools.partial(self._whole, page)
        note(session.stated(session.start))
        return dataclasses.replace(session, shared=Shared(note, whole))

    def many(self, entry: Entry | None) -> int | None:
        """The number of modes on the pages of an entry; None where none is open."""
        return next((len(one.modes.hz or ()) for (_, of), one in self._stated.items() if of == entry), None)

    def _note(self, page: Page, stated: RunFile) -> None:
        self._stated[page] = stated

    def _whole(self, page: Page, stated: RunFile) -> RunFile:
        """The run file of all members, from that of a page: the poles of each, and the smallest class that holds those of all.

        InputError: a member that the run file states no poles of was not opened; the pages differ in the number of modes,
        or in lines.
        """
        own, entry = page
        runs = {one.name: self._stated[key] for one in self._run.members if (key := (one.name, entry)) in self._stated}
        runs[own] = stated
        members = tuple(self._member(one, runs.get(one.name), stated) for one in self._run.members)
        left = sorted({hz for run in runs.values() for hz in run.frequency_points.leave_out_hz or ()})
        whole = dataclasses.replace(self._run, members=members, modes=stated.modes, fit=stated.fit)
        for name, run in (*runs.items(), (own, stated)):
            without_points(self._data[name, entry], left)  # says where a member has no such line
            whole = whole.with_member(name, run)
        whole = whole.changed("frequency_points", leave_out_hz=tuple(left) or None)
        whole = whole.changed("worst_case", over_poles=all(run.worst_case.over_poles for run in runs.values()))
        priors = [run.prior for run in runs.values()]
        if any(one != stated.prior for one in priors):
            gain, name = (
                max(float(one.gain_bound or 0) for one in priors),
                "decay" if stated.prior.decay else "decay_rate",
            )
            given: dict[str, object] = {"gain_bound": gain, name: min(float(getattr(one, name)) for one in priors)}
            whole = whole.changed("prior", **given, source=None, note=_TOGETHER, curve=None, without=None)
        return whole

    def _member(self, asked: MemberChoice, own: RunFile | None, stated: RunFile) -> MemberChoice:
        """The member with the poles of its page; with those that the run file states where it was not opened."""
        modes = own.modes if own is not None else asked if asked.hz is not None else self._run.modes
        many = len(stated.modes.hz or ())
        if modes.hz is None:
            raise InputError(
                f"The run file states the modes of every member: open the page of {asked.name} first, which finds its own"
            )
        if len(modes.hz) != many:
            raise InputError(
                f"The poles may differ between members, their number may not: {asked.name} has {len(modes.hz)}, this page {many}"
            )
        return dataclasses.replace(asked, **{key: getattr(modes, key) for key in POLES})


def views(run: RunFile, folder: Path, progress: Progress, tables: Tables | None = None) -> list[View]:
    """The pages of a run file, in the order of its members; the data of the first are read at once."""
    tables, family = tables or Tables(), Family(run)
    names = [member.name for member in run.members] or [""]
    found: dict[str, tuple[RunFile, Measured]] = {}

    def read(name: str, progress: Progress) -> tuple[RunFile, Measured]:
        if name not in found:
            progress("reading the data, and estimating their response where they are records", 0, 0)
            alone = dataclasses.replace(run.of_member(name), modes=modes_of(run, name)) if name else run
            found[name] = all_entries(alone, folder, Surroundings(progress), tables)
        return found[name]

    def opened(name: str, entry: Entry | None, progress: Progress) -> Session:
        stated, data = read(name, progress)
        stated = dataclasses.replace(stated, entry=entry, column=None)
        if not name:
            return Session.of(stated, data, folder, progress)
        return family.joined((name, entry), _alike(stated, family.many(entry), data, folder, progress))

    pairs = itertools.product(names, _entries(run, read(names[0], progress)[1]))
    return [
        View(": ".join(filter(None, (name, words))), functools.partial(opened, name, entry))
        for name, (entry, words) in pairs
    ]


def _alike(run: RunFile, many: int | None, data: Measured, folder: Path, progress: Progress) -> Session:
    """The session of a member, with so many modes where its data show them and nothing else is asked for."""
    if many and run.modes.hz is None and run.modes.count is None and run.fit.order is None:
        with contextlib.suppress(InputError):
            return Session.of(run.changed("modes", count=many), data, folder, progress)
    return Session.of(run, data, folder, progress)


def _entries(run: RunFile, data: Measured) -> list[tuple[Entry | None, str]]:
    """The entries that have pages, with their names: the one that is asked for, or all of the matrix."""
    if not data.responses:
        raise InputError("explore needs a frequency response: a [[frequency]], or a [[record]] that is used for one")
    first = data.responses[0]
    size = len(first.outputs), len(first.inputs)
    if run.entry is not None or size == (1, 1):
        return [(run.entry, "")]
    if run.loop.is_stated:
        raise InputError(
            "explore shows one entry of a matrix, and a plant in a loop is identified as a whole: this one has"
            f" {counted(size[0], 'output')}"
            f" and {counted(size[1], 'input')}"
        )
    places = itertools.product(range(size[0]), range(size[1]))
    return [((i, j), f"{first.outputs[i]} / {first.inputs[j]}") for i, j in places]
