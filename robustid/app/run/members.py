"""A run with members: the data of each by themselves, one class for all, and the family that they make."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from robustid.app.run import findings
from robustid.app.run.class_choice import inflated_problem, with_inflation, with_prior
from robustid.app.run.class_settings import prior_keys
from robustid.app.run.designed import designed_for_members
from robustid.app.run.kept_out import compared, with_frequencies
from robustid.app.run.measurements import Measured, measured
from robustid.app.run.member_poles import POLES, modes_of, with_poles
from robustid.app.run.modes import box_of, with_faults
from robustid.app.run.posing import without_class
from robustid.app.run.reading import D, Tables
from robustid.app.run.results import FamilyRun
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sequence import diagnosis_of, identified
from robustid.app.run.work import Untouched
from robustid.core import Options, Record
from robustid.data import PlacedFault, Undoing
from robustid.errors import InconsistentDataError, InputError
from robustid.guarantees import Member, called_otherwise, family, frequencies_of, otherwise_words
from robustid.identification import Identification, MixedProblem, Prior

Undo = Callable[[str, Measured, Sequence[PlacedFault]], Undoing | None]
_WITH_CONTROLLER = 0.4  # of the time that is left, for the family
_AS_STATED = (
    "The band holds for the poles of the members as they were taken, not for their pole-uncertainty boxes, which could not"
    " be covered"
)


def run_members(run: RunFile, place: Path, around: Surroundings, undo: Undo) -> FamilyRun:
    """The family that a run file with [[members]] describes: as many modes of every member, from its own data where they aren't
    stated, with ``over_poles = true`` in any case and with the box that its data leave them; the largest gain bound and the
    smallest decay rate that any member asks for. `undo` gives the line that undoes a fault of the data of a member.
    """
    data: dict[str, Measured] = {}
    matched: list[str] = []
    tables = Tables()  # a record of the noise floor may be of all
    for member in run.members:
        around.say(f"member {member.name}")
        stated, data[member.name] = measured(run.of_member(member.name), place, around, tables)
        first = next(iter(data.values()))
        data[member.name], said = _named_alike(member.name, data[member.name], first)
        matched += said
        run = run.with_member(member.name, stated)
    run = with_poles(run, data, around)
    data = {name: with_faults(run.changed("modes", **_poles(run, name)), mine, around) for name, mine in data.items()}
    problems: dict[str, MixedProblem] = {}
    left: dict[str, Untouched] = {}
    for name, mine in data.items():
        run, problems[name], left[name] = without_class(run, mine, modes_of(run, name))
    # The largest factor on the bounds that a member needs.
    asked = [with_inflation(run, problem, around) for problem in problems.values()]
    run = max(asked, key=lambda one: float(one.identify.inflate))
    problems = {name: inflated_problem(problem, run) for name, problem in problems.items()}
    run, prior = _one_prior(run, problems, around)
    around.folder.choices(run)
    found: dict[str, Identification] = {}
    for k, (name, problem) in enumerate(problems.items(), start=1):
        posed = dataclasses.replace(problem, prior=prior)
        found[name] = identified(run, posed, around, of=f" of {name}", member=k)
    united = _united(run, found, left, around)
    if united.consistent:
        design, said = designed_for_members(united.run_file, found, next(iter(data.values())).structure, around)
        findings = (*united.findings, *said)
        united = dataclasses.replace(united, design=design, findings=findings, unfinished=around.unfinished)
    undoing = next((one for name in data if (one := undo(name, data[name], found[name].problem.placed_faults))), None)
    return dataclasses.replace(united, findings=(*matched, *united.findings), undoing=undoing)


def _named_alike(name: str, mine: Measured, first: Measured) -> tuple[Measured, list[str]]:
    """The data of a member with the signal names of the first, matched by their place, and sentences that say so.

    The arrays of its files may be called otherwise; units of their own stay.
    """
    one, own = (next(iter((*data.responses, *data.records))) for data in (first, mine))
    names: Record = {}
    said: list[str] = []
    for side in ("outputs", "inputs"):
        theirs, ours = getattr(one, side), getattr(own, side)
        if pairs := called_otherwise(ours, theirs):
            names[side] = [(there.name, signal.unit) for signal, there in zip(ours, theirs, strict=True)]
            said.append(otherwise_words(name, side, pairs))

    def named(item: D) -> D:
        return dataclasses.replace(item, **names)

    return (mine.each(named) if names else mine), said


def _poles(run: RunFile, name: str) -> Record:
    """The keys of the poles of a member."""
    modes = modes_of(run, name)
    return {key: getattr(modes, key) for key in POLES}


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


def _said_of(run: RunFile, found: dict[str, Identification], around: Surroundings) -> list[str]:
    """Words on every member: whether its data fit the class, and what would help."""
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
            poles=box_of(m) if run.worst_case.over_poles else None,
            delay=run.modes.delay or 0,
        )
        for m in run.members
    ]
    said = _said_of(run, found, around)
    asked = run.worst_case
    bases = [one.problem.parametric for one in found.values()]
    poles = np.unique(np.concatenate([np.zeros(0), *(basis.poles for basis in bases if basis is not None)]))
    withheld = [frf for one in left.values() for frf in one.withheld]
    plane = members[0].identification.problem.plane
    run = with_frequencies(run, frequencies_of(members), tuple(poles), plane, withheld)
    around.folder.choices(run)
    omega = 2 * np.pi * np.array(run.worst_case.at_hz)
    how: Options = asked.arguments | {"order": run.family.order}
    words = "bounding the members at every frequency"
    spread = around.counted(words)
    how |= {"omega": omega, "schedule": run.family.schedule, "interval": run.family.interval}
    try:
        share = _WITH_CONTROLLER if run.controller.is_stated else 1.0
        with around.step(words, share, asked.time_limit) as limit:
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
            unfinished=around.unfinished,
        )
    if asked.circle:
        spread = around.counted("bounding the members between the frequencies")
        one.on_circle(asked.rtol, executor=spread["executor"], progress=spread["progress"])
    if one.omega.size < omega.size:
        said.append(
            f"The time limit, or Ctrl-C, ended the sweep: {one.omega.size} of {omega.size} frequencies are bounded for all members,"
            " nothing is said of the others."
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
        unfinished=around.unfinished,
    )
