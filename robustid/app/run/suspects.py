"""Experiments that contradict the others where the program chooses the class: found, left out of the choice, and named."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from robustid.advice import (
    Experiment,
    Posed,
    contradiction_faults,
    experiments,
    response_sizes,
    suspect_experiments,
    without_experiments,
)
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import basis_of, with_modes
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Modes
from robustid.core import Budget
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.estimation import correct
from robustid.identification import MixedProblem

_LARGEST = 2.0  # times the largest response: a non-parametric part that says something
_SAME = 0.1  # part by which frequencies of modes may differ and be one
_SHARE = 0.2  # of the time that is left, for what is found out about experiments


def chosen_from_parts(run: RunFile, data: Measured) -> bool:
    """Tell whether a class is chosen from several experiments, or was chosen without some of them."""
    open_ = not run.prior.is_stated and run.prior.passive is None
    return len(data.responses) + len(data.records) > 1 and (open_ or run.prior.without is not None)


def accused_records(problem: MixedProblem) -> dict[Experiment, str]:
    """The records that every response contradicts, before any class is assumed, each with what undoes it, "" for nothing."""
    responses = [one for one in problem.frequency if isinstance(one, FrequencyResponse)]
    found: list[dict[int, str]] = []
    for frf in responses:
        faults = dataclasses.replace(problem, frequency=(frf,)).record_faults
        found.append({max(fault.record - 1, 0): fault.correction for fault in reversed(faults)})
    first, *others = found or [{}]
    return {Experiment("time", k): first[k] for k in sorted(first) if all(k in one for one in others)}


def suspected(
    asked: RunFile, run: RunFile, problem: MixedProblem, data: Measured, around: Surroundings
) -> dict[Experiment, str]:
    """The experiments that contradict the others, where the class that all of them ask for says nothing; what undoes each."""
    says = run.prior.is_from_data and problem.prior.gain_bound <= _LARGEST * response_sizes(problem)[0]
    if says or problem.prior.physical:
        return {}
    stated = asked.modes.hz is not None or asked.fit.order is not None

    def at_poles(part: MixedProblem, modes: Modes) -> MixedProblem:
        return dataclasses.replace(part, parametric=basis_of(modes, problem.dt))

    def posed(left_out: tuple[Experiment, ...]) -> Posed:
        rest, left = data.without(left_out), without_experiments(problem, left_out)
        kept = [one for one in experiments(problem) if one not in left_out]
        try:
            alone = without_experiments(problem, kept)
        except InputError:
            alone = None
        if stated:
            return Posed(left, problem, problem, alone)
        moved = not rest.responses or Experiment("frequency", 0) in left_out
        modes = with_modes(asked, rest, around).modes if moved else run.modes
        own = with_modes(asked, data.only(left_out), around).modes
        joined = at_poles(problem, _joined(run.modes, modes, own))
        alone = None if alone is None else at_poles(alone, own)
        if moved:
            return Posed(at_poles(left, modes), at_poles(problem, modes), joined, alone)
        return Posed(left, problem, joined, alone)

    with around.step("holding the class against the experiments one by one", _SHARE, needed=False) as limit:
        return suspect_experiments(problem, posed, Budget(limit))


def _joined(modes: Modes, *others: Modes) -> Modes:
    """Modes, and those of others that are not among them."""
    pairs = list(zip(modes.hz or (), modes.damping or (), strict=True))
    for hz, damping in [pair for one in others for pair in zip(one.hz or (), one.damping or (), strict=True)]:
        if all(abs(hz - one) > _SAME * one or (damping == 1) != (ratio == 1) for one, ratio in pairs):
            pairs.append((hz, damping))
    hz, damping = zip(*pairs, strict=True) if pairs else ((), ())
    return dataclasses.replace(modes, hz=hz, damping=damping, hz_interval=None, damping_interval=None)


def suspects_of(run: RunFile, data: Measured) -> tuple[Experiment, ...]:
    """The experiments that a run file leaves out of the choice of the class."""
    suspects = tuple(Experiment.named(name) for name in run.prior.without or ())
    counts = {"frequency": len(data.responses), "time": len(data.records)}
    for one in suspects:
        if one.place >= counts[one.kind]:
            raise InputError(
                f'[prior] without names "{one.name}", and there are {counts[one.kind]} such experiments; leave it out'
            )
    if len(set(suspects)) >= sum(counts.values()):
        raise InputError("[prior] without leaves no experiment to choose the class from; leave one of its names out")
    return suspects


def without_contradictions(data: Measured, corrections: Mapping[Experiment, str]) -> tuple[Measured, list[Experiment]]:
    """The data with the corrections of some experiments, and without those that have none, which are listed."""
    kept: dict[str, list[Any]] = {"frequency": list(data.responses), "time": list(data.records)}
    left_out: list[Experiment] = []
    for one, words in corrections.items():
        item = kept[one.kind][one.place]
        try:
            changed = correct(item, words) if words else item
        except InputError:
            changed = item
        if changed is item or changed.dt != item.dt:  # another sample time does not go with the other data
            left_out.append(one)
        kept[one.kind][one.place] = changed
    whole = data._replace(responses=tuple(kept["frequency"]), records=tuple(kept["time"]))
    return whole.without(left_out), left_out


def chosen_from_others(run: RunFile, suspects: Sequence[Experiment], left_out: Sequence[Experiment]) -> RunFile:
    """The run file with a class that was chosen from the other experiments, which its note says."""
    said = [f"without {one.name}" if one in left_out else f"with {one.name} corrected" for one in suspects]
    return run.changed("prior", note=f"{run.prior.note}\nChosen {', '.join(said)}: see the faults of the data.")


def with_contradictions(problem: MixedProblem, suspects: Sequence[Experiment], around: Surroundings) -> MixedProblem:
    """The problem with the faults of experiments that contradict the others.

    Nothing is said of those that no class is needed for (`record_faults`), unless it is what undoes them.
    """
    named = {Experiment("time", max(fault.record - 1, 0)): fault.correction for fault in problem.record_faults}
    left = [one for one in suspects if not named.get(one)]
    if not left:
        return problem
    with around.step("what would undo the contradiction", _SHARE, needed=False) as limit:
        found = contradiction_faults(problem, left, Budget(limit))
    found = {one: fault for one, fault in found.items() if fault.correction or one not in named}
    for fault in found.values():
        around.say(str(fault))
    return dataclasses.replace(problem, faults=tuple(found.values())) if found else problem
