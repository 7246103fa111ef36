"""The problem that a run poses about its data, with every choice that the run file leaves open, and what is kept out of it."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import math
from collections.abc import Mapping

from robustid.advice import Experiment, computable_step
from robustid.app.run.class_choice import (
    TOO_LARGE,
    TOO_SLOW,
    chosen_points,
    inflated,
    inflated_problem,
    placeholder,
    with_inflation,
    with_prior,
    with_step,
)
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.fewer_modes import without_dependent
from robustid.app.run.kept_out import split_points
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import basis_of, with_faults, with_fit, with_modes, with_questions
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Modes
from robustid.app.run.suspects import (
    accused_records,
    chosen_from_others,
    chosen_from_parts,
    suspected,
    suspects_of,
    with_contradictions,
    without_contradictions,
)
from robustid.app.run.work import Untouched
from robustid.core import Source
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem

MARGIN_SHARE = 0.5  # of the time that is left, for margin and model


def posed(
    run: RunFile, data: Measured, around: Surroundings, *, reference: bool = True
) -> tuple[RunFile, MixedProblem, Untouched]:
    """The run file with every choice made, the problem that it poses about data, and what it keeps out of it.

    A class that is chosen is held against the experiments one by one: from those that contradict the others it is not taken, and
    the problem says so. `reference` is what becomes of a class that says nothing; see `with_prior`.
    """
    importlib.import_module("control")  # half a second, for which a Ctrl-C in what comes would have to wait
    # Refuses what lacks a sample time or a bound, before anything is computed from it.
    alone = MixedProblem(frequency=data.responses, time=data.records, prior=placeholder(run, data))
    _check(run, alone)
    around.folder.responses(data.responses)
    if not chosen_from_parts(run, data):
        return _posed(run, data, around, reference)
    corrections = dict.fromkeys(suspects_of(run, data), "")
    if run.prior.without is None and not (corrections := accused_records(alone)):
        found = _posed(run, data, around, reference)
        corrections = suspected(run, found[0], found[1], data, around)
        if not corrections:
            return found
    return _from_others(run, data, corrections, around, reference)


def _from_others(
    run: RunFile, data: Measured, corrections: Mapping[Experiment, str], around: Surroundings, reference: bool
) -> tuple[RunFile, MixedProblem, Untouched]:
    """The same, of a class that some experiments contradict: it is chosen with their corrections, or without them."""
    suspects = tuple(corrections)
    stated = run.changed("prior", without=tuple(one.name for one in suspects))
    if not run.prior.is_stated:
        others, left_out = without_contradictions(data, corrections)
        try:
            stated, _, _ = _posed(stated, others, around, reference)
        except InputError:  # they do not excite every input, or see every output
            return _posed(run, data, around, reference)
        stated = chosen_from_others(stated, suspects, left_out)
    stated, problem, left = _posed(stated, data, around, reference)
    return stated, with_contradictions(problem, suspects, around), left


def _posed(
    run: RunFile, data: Measured, around: Surroundings, reference: bool
) -> tuple[RunFile, MixedProblem, Untouched]:
    """The same, of a class that all data are taken for."""
    asked, folder = run.modes, around.folder
    run = with_modes(with_fit(run, data, around), data, around)
    data = with_faults(run, with_questions(run, data, asked, around), around)
    run, problem, left = told_apart(run, data, asked)
    run = with_inflation(run, problem, around)
    problem = inflated_problem(problem, run)
    folder.choices(run)
    free = run
    run, problem = with_prior(run, problem, around, reference=reference, delay=asked.delay)
    if not free.prior.is_stated and run.frequency_points.every == 1:
        fewer = _fewer_points(free, run, problem, data, asked, around, reference)
        run, problem, left = fewer or (run, problem, left)
    folder.choices(run)
    return run, problem, left._replace(points=[inflated(frf, run) for frf in left.points])


def _fewer_points(
    free: RunFile,
    run: RunFile,
    problem: MixedProblem,
    data: Measured,
    asked: Modes,
    around: Surroundings,
    reference: bool,
) -> tuple[RunFile, MixedProblem, Untouched] | None:
    """The same with one of so many points, and the rest as tests; None where some form of the class takes all in its time.

    Where no class holds all points, one is chosen for the fewer that there is time for, as with the run file before, `free`; the
    class stays, and the points that some form takes, where there is none for these either.
    """
    seconds = around.budget.share(MARGIN_SHARE).seconds
    step = functools.partial(computable_step, form=run.identify.form, accuracy=run.identify.accuracy)
    if run.prior.source == Source.STOPPED:  # nothing is decided in a class that nobody has looked for to the end
        seconds = None
    if step(problem, seconds=seconds) == 1:
        return None
    whole = dataclasses.replace(problem, frequency=data.responses)
    least, every = step(whole), step(whole, seconds=seconds)
    late = f"margin and model of all frequency points (one of {every} is used, the others test the result)"
    if every > least and not run.prior.is_from_data:
        found, fewer, left = told_apart(with_step(run, every, TOO_SLOW), data, asked)
        found, fewer = dataclasses.replace(found, prior=free.prior), inflated_problem(fewer, found)
        found, fewer = with_prior(found, fewer, around, reference=reference, delay=asked.delay)
        if found.prior.is_from_data:
            around.ended_early(late)
            return with_step(found, every, TOO_SLOW), fewer, left
        every = least
    if every == 1:
        return None
    if every > least:
        around.ended_early(late)
    found, fewer, left = told_apart(with_step(run, every, TOO_SLOW if every > least else TOO_LARGE), data, asked)
    return found, dataclasses.replace(inflated_problem(fewer, found), prior=problem.prior), left


def told_apart(run: RunFile, data: Measured, asked: Modes) -> tuple[RunFile, MixedProblem, Untouched]:
    """The same as `without_class`, without modes that the program chose, not `asked`, and that the data cannot tell apart."""
    found, problem, left = without_class(run, data, run.modes)
    while (modes := without_dependent(run.modes, asked, problem)) is not None:
        run = dataclasses.replace(run, modes=modes)
        found, problem, left = without_class(run, data, modes)
    return found, problem, left


def without_class(run: RunFile, data: Measured, modes: Modes) -> tuple[RunFile, MixedProblem, Untouched]:
    """The problem that data and modes pose, with a prior of no meaning, and the data that it keeps out."""
    prior = placeholder(run, data)
    dt = MixedProblem(frequency=data.responses, time=data.records, prior=prior).dt
    parts = [chosen_points(run, frf) for frf in data.responses]
    unused = [rest for _, rest in parts if rest is not None]
    run, used, out, kind = _kept_out(run, data, [points for points, _ in parts], unused)
    basis = basis_of(modes, dt, run.prior.passive)
    problem = MixedProblem(frequency=used, time=data.records, prior=prior, parametric=basis)
    records = data.excited if used else data.records
    return run, problem, Untouched(out if kind == "lines" else unused, out, kind, used, records)


def _kept_out(
    run: RunFile, data: Measured, used: list[FrequencyResponse], unused: list[FrequencyResponse]
) -> tuple[RunFile, list[FrequencyResponse], list[FrequencyResponse], str]:
    """Withheld data that test the result: records or periods, frequency points that are not used, or one of so many."""
    if data.withheld:
        return run, used, list(data.withheld), data.kind
    if unused:
        return run.changed("withheld", every=0), used, unused, "lines"
    kept: list[FrequencyResponse] = []
    for k, frf in enumerate(used):
        stated, used[k], out = split_points(run, frf)
        kept += [out] if out is not None else []
        run = stated if k == len(used) - 1 else run
    return run, used, kept, "lines"


def posed_as_stated(
    run: RunFile, problem: MixedProblem, around: Surroundings
) -> tuple[RunFile, MixedProblem, Untouched]:
    """The same for a problem that states its class itself."""
    note = "Parametric part as stated in the problem that was given in Python."
    run = dataclasses.replace(run, prior=PriorChoice.of(problem.prior), modes=Modes(note=note))
    _check(run, problem)
    run = with_inflation(run, problem, around)
    left = Untouched(measured=problem.frequency, records=() if problem.frequency else problem.time)
    return run, inflated_problem(problem, run), left


def _check(run: RunFile, problem: MixedProblem) -> None:
    """Refuse what doesn't go with the data before anything is computed: frequencies beyond Nyquist, rigid-body modes."""
    dt, bodies = problem.dt, run.small_model.rigid_body
    heads = min(problem.entries.outputs, problem.entries.inputs)
    if bodies and bodies != heads:
        raise InputError(
            f"[small_model] rigid_body must be {heads}, a mode for every signal on the side with fewer; got {bodies}"
        )
    pairs = zip(run.modes.hz or (), run.modes.damping or (), strict=True)
    oscillating = [hz for hz, damping in pairs if dt and hz * math.sqrt(1 - damping**2) > 0.5 / dt * (1 + 1e-9)]
    for place, stated in (("[modes] hz", oscillating), ("[worst_case] at_hz", run.worst_case.at_hz)):
        if stated and dt and max(stated) > 0.5 / dt * (1 + 1e-9):
            raise InputError(
                f"{place} holds {max(stated):g} Hz, above the Nyquist frequency of {0.5 / dt:g} Hz at dt = {dt:g} s"
            )
