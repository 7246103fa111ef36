"""A run with members: the data of each by themselves, one class for all, and the family that they make."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from robustid.app.run import findings
from robustid.app.run.class_choice import inflated_problem, with_inflation, with_prior
from robustid.app.run.class_settings import prior_keys
from robustid.app.run.kept_out import compared, with_frequencies
from robustid.app.run.measurements import Measured, measured
from robustid.app.run.modes import Box, with_fit, with_modes
from robustid.app.run.posing import without_class
from robustid.app.run.reading import Tables
from robustid.app.run.results import FamilyRun
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sequence import diagnosis_of, identified
from robustid.app.run.settings import Modes
from robustid.app.run.sources import MemberChoice
from robustid.app.run.work import Untouched
from robustid.core import Source
from robustid.errors import InconsistentDataError, InputError
from robustid.guarantees import Member, family, frequencies_of
from robustid.identification import Identification, MixedProblem, Prior

_AS_STATED = (
    "The band holds for the poles of the members as they were taken, not for their pole-uncertainty boxes, which could not"
    " be covered"
)
_NO_BOX = {"damping": None, "hz_interval": None, "damping_interval": None}
POLES = ("hz", *_NO_BOX)  # keys that say which poles a plant has


def run_members(run: RunFile, place: Path, around: Surroundings) -> FamilyRun:
    """The family that a run file with [[members]] describes: modes of the first member, or with ``over_poles = true`` as many
    of every member with the box that its data leave them; the largest gain bound and the smallest decay rate that any member
    asks for.
    """
    data: dict[str, Measured] = {}
    tables = Tables()  # a record of the noise floor may be of all
    for member in run.members:
        around.say(f"member {member.name}")
        stated, data[member.name] = measured(run.of_member(member.name), place, around, tables)
        run = run.with_member(member.name, stated)
    run = _with_own_poles(_with_modes(run, data, around), data, around)
    problems: dict[str, MixedProblem] = {}
    left: dict[str, Untouched] = {}
    for name, mine in data.items():
        run, problems[name], left[name] = without_class(run, mine, _modes_of(run, name))
    run = _one_inflation(run, problems, around)
    problems = {name: inflated_problem(problem, run) for name, problem in problems.items()}
    run, prior = _one_prior(run, problems, around)
    around.folder.choices(run)
    found: dict[str, Identification] = {}
    for k, (name, problem) in enumerate(problems.items(), start=1):
        posed = dataclasses.replace(problem, prior=prior)
        found[name] = identified(run, posed, around, of=f" of {name}", member=k)
    return _united(run, found, left, around)


def _with_modes(run: RunFile, data: dict[str, Measured], around: Surroundings) -> RunFile:
    """The poles of the parametric part, from the first member where they aren't stated, which their note says then."""
    name, first = next(iter(data.items()))
    found = with_modes(with_fit(run, first, around), first, around)
    if run.modes.hz is not None or not found.modes.hz:
        return found
    return found.changed("modes", note=f"{found.modes.note}\nOf {name}, the first of the members.")


def _with_own_poles(run: RunFile, data: dict[str, Measured], around: Surroundings) -> RunFile:
    """The poles of every member with the box that its own data leave them, where the band is to cover it."""
    if not run.worst_case.over_poles or not run.modes.hz:
        return run
    found: list[MemberChoice] = []
    one_box = run.modes.hz_interval is not None and run.modes.source is not Source.DATA
    for member in run.members:
        own = member
        if own.hz is None and one_box:
            own = dataclasses.replace(member, **{name: getattr(run.modes, name) for name in POLES})
        elif own.hz is None:
            around.say(f"looking for the modes of {member.name}")
            open_modes = dataclasses.replace(
                run.modes, hz=None, count=len(run.modes.hz), source=None, note=None, **_NO_BOX
            )
            try:
                modes = with_modes(run.changed("modes", **vars(open_modes)), data[member.name], around).modes
            except InputError as error:
                raise InputError(f"modes of member {member.name!r}: {error}") from None
            own = dataclasses.replace(member, **{name: getattr(modes, name) for name in POLES})
        if own.hz_interval is None or len(own.hz or ()) != len(run.modes.hz):
            raise InputError(
                f"over_poles = true needs the poles of member {member.name!r} and their box, and its data show"
                f" {len(own.hz or ())} of the {len(run.modes.hz)} modes of [modes]: give hz, damping, hz_interval and"
                " damping_interval in its [[members]], or leave over_poles out"
            )
        found.append(own)
    return dataclasses.replace(run, members=tuple(found))


def _modes_of(run: RunFile, name: str) -> Modes:
    """The poles of a member: its own, or those of all."""
    own = next(member for member in run.members if member.name == name)
    if own.hz is None:
        return run.modes
    return dataclasses.replace(run.modes, **{pole: getattr(own, pole) for pole in POLES})


def _one_inflation(run: RunFile, problems: dict[str, MixedProblem], around: Surroundings) -> RunFile:
    """The largest factor on the bounds that a member needs."""
    asked = [with_inflation(run, problem, around) for problem in problems.values()]
    return max(asked, key=lambda one: float(one.identify.inflate))


def _one_prior(run: RunFile, problems: dict[str, MixedProblem], around: Surroundings) -> tuple[RunFile, Prior]:
    """The smallest class that holds those that every member asks for."""
    found = [with_prior(run, problem, around, double=False) for problem in problems.values()]
    asked = [(one, problem.prior) for one, problem in found]
    if run.prior.is_stated:
        return asked[0]
    gain, decay = max(prior.gain_bound for _, prior in asked), min(prior.rate for _, prior in asked)
    first, prior = asked[0]
    stated = {name: one.prior for name, (one, _) in zip(problems, asked, strict=True)}
    note = (
        f"One class for all members, {gain:.4g} and {decay:.5g}: the largest gain bound and the smallest decay rate.\n"
        + "\n".join(f"{name}: {one.note}" for name, one in stated.items())
    )
    curves = "\n".join(f"{name}:\n{one.curve}" for name, one in stated.items() if one.curve)
    prior = dataclasses.replace(prior.with_rate(decay), gain_bound=gain)
    return first.changed("prior", **prior_keys(prior, run.prior), note=note, curve=curves or None), prior


def _box_of(member: MemberChoice) -> Box | None:
    """The pole-uncertainty box of a member, in rad/s; None where it has none."""
    if member.hz_interval is None:
        return None
    return 2 * np.pi * np.array(member.hz_interval), np.array(member.damping_interval)


def _said_of(run: RunFile, found: dict[str, Identification], around: Surroundings) -> list[str]:
    """Sentences on the class of every member, and on what contradicts it."""
    said: list[str] = []
    for name, one in found.items():
        diagnosis = diagnosis_of(one, around)
        help = [] if diagnosis is None else [diagnosis.summary()]
        said += [f"{name}: {words}" for words in [*findings.class_words(run, one), *help]]
    return said


def _united(
    run: RunFile, found: dict[str, Identification], left: dict[str, Untouched], around: Surroundings
) -> FamilyRun:
    """The family of the members, and what withheld data say of its band."""
    members = [
        Member(
            found[m.name],
            m.name,
            amplitude=m.amplitude,
            position=m.position,
            load=m.load,
            date=m.date,
            poles=_box_of(m) if run.worst_case.over_poles else None,
            delay=run.modes.delay or 0,
        )
        for m in run.members
    ]
    said, asked = _said_of(run, found, around), run.worst_case
    bases = [one.problem.parametric for one in found.values()]
    poles = np.unique(np.concatenate([np.zeros(0), *(basis.poles for basis in bases if basis is not None)]))
    withheld = [frf for one in left.values() for frf in one.withheld]
    plane = members[0].identification.problem.plane
    run = with_frequencies(run, frequencies_of(members), tuple(poles), plane, withheld)
    around.folder.choices(run)
    omega = 2 * np.pi * np.array(run.worst_case.at_hz)
    how: dict[str, Any] = asked.arguments | {"order": run.family.order}
    words = "bounding the members at every frequency"
    spread = around.counted(words)
    how |= {"omega": omega, "schedule": run.family.schedule, "interval": run.family.interval}
    try:
        with around.step(words, stated=asked.time_limit) as limit:
            try:
                one = family(members, time_limit=limit, **how, **spread)
            except InputError as error:
                if not asked.over_poles:
                    raise
                said.insert(0, f"{_AS_STATED} ({error}).")
                left_of = around.budget.seconds
                one = family([dataclasses.replace(m, poles=None) for m in members], time_limit=left_of, **how, **spread)
    except InconsistentDataError as error:
        return FamilyRun(
            identifications=found,
            family=None,
            withheld={},
            findings=(*said, str(error)),
            run_file=run,
            unfinished=around.stops.unfinished,
        )
    if asked.circle:
        spread = around.counted("bounding the members between the frequencies")
        one.on_circle(asked.rtol, executor=spread["executor"], progress=spread["progress"])
    if one.omega.size < omega.size:
        said.append(
            f"The time limit ended the sweep: {one.omega.size} of {omega.size} frequencies are bounded for all members, nothing is"
            " said of the others."
        )
    seen = {name: c for name, mine in left.items() if (c := compared(one, mine.withheld, mine.kind)) is not None}
    judged = [f"{name}: {words}" for name, c in seen.items() for words in c.sentences]
    bad = any(c.contradicted for c in seen.values())
    found_of = (*judged, *said) if bad else (*said, *judged)
    return FamilyRun(
        identifications=found,
        family=one,
        withheld=seen,
        findings=(*found_of, *one.not_known),
        run_file=run,
        unfinished=around.stops.unfinished,
    )
