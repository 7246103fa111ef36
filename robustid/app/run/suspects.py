"""Experiments that contradict the others where the program chooses the class: found, left out of the choice, and named."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from robustid.advice import Experiment, contradiction_faults, response_sizes, suspect_experiments, without_experiments
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import basis_of, with_modes
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.core import Budget, Source
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem

_SHARE = 0.2  # of the time that is left, for what is found out about experiments


def chosen_from_parts(run: RunFile, data: Measured) -> bool:
    """Tell whether a class is chosen from several experiments, or was chosen without some of them."""
    open_ = not run.prior.is_stated and run.prior.passive is None
    return len(data.responses) + len(data.records) > 1 and (open_ or run.prior.without is not None)


def accused_records(problem: MixedProblem) -> tuple[Experiment, ...]:
    """The records that every response contradicts, before any class is assumed; () where that leaves no data."""
    responses = [one for one in problem.frequency if isinstance(one, FrequencyResponse)]
    accused: list[set[int]] = []
    for frf in responses:
        alone = dataclasses.replace(problem, frequency=(frf,))
        accused.append({max(fault.record - 1, 0) for fault in alone.record_faults})
    every = set.intersection(*accused) if accused else set[int]()
    return tuple(Experiment("time", k) for k in sorted(every))


def suspected(
    asked: RunFile, run: RunFile, problem: MixedProblem, data: Measured, around: Surroundings
) -> tuple[Experiment, ...]:
    """The experiments that contradict the others, where the class that all of them ask for says nothing."""
    prior = problem.prior
    says = run.prior.source is Source.DATA and prior.gain_bound <= _LARGEST * response_sizes(problem)[0]
    if says or prior.physical:
        return ()
    stated = asked.modes.hz is not None or asked.fit.order is not None

    def others(left_out: tuple[Experiment, ...]) -> MixedProblem:
        rest = data.without(left_out)
        moved = not stated and (not rest.responses or Experiment("frequency", 0) in left_out)
        modes = with_modes(asked, rest, around).modes if moved else run.modes
        left = without_experiments(problem, left_out)
        return dataclasses.replace(left, parametric=basis_of(modes, problem.dt)) if moved else left

    around.say("holding the class against the experiments one by one")
    with around.step("holding the class against the experiments one by one", _SHARE, needed=False) as limit:
        return suspect_experiments(problem, others, Budget(limit))


_LARGEST = 2.0  # times the largest response: a non-parametric part that says something


def suspects_of(run: RunFile, data: Measured) -> tuple[Experiment, ...]:
    """The experiments that a run file leaves out of the choice of the class."""
    suspects = tuple(Experiment.named(name) for name in run.prior.without or ())
    counts = {"frequency": len(data.responses), "time": len(data.records)}
    for one in suspects:
        if one.index >= counts[one.kind]:
            raise InputError(
                f'[prior] without names "{one.name}", and there are {counts[one.kind]} such experiments; leave it out'
            )
    if len(set(suspects)) >= sum(counts.values()):
        raise InputError("[prior] without leaves no experiment to choose the class from; leave one of its names out")
    return suspects


def chosen_from_others(run: RunFile, suspects: Sequence[Experiment], problem: MixedProblem) -> RunFile:
    """The run file with a class that was chosen from the other experiments, which its note says."""
    names = ", ".join(one.called(problem) for one in suspects)
    return run.changed("prior", note=f"{run.prior.note}\nChosen without {names}: see the faults of the data.")


def with_contradictions(problem: MixedProblem, suspects: Sequence[Experiment], around: Surroundings) -> MixedProblem:
    """The problem with the faults of experiments that contradict the others, those that no response has named yet."""
    named = {max(fault.record - 1, 0) for fault in problem.record_faults}
    left = [one for one in suspects if one.kind == "frequency" or one.index not in named]
    if not left:
        return problem
    with around.step("what would undo the contradiction", _SHARE, needed=False) as limit:
        found = contradiction_faults(problem, left, Budget(limit))
    for fault in found:
        around.say(str(fault))
    return dataclasses.replace(problem, faults=found)
