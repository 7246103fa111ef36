"""From bounded data, or a problem, to the small model and its error: the steps in their order."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.advice import diagnose
from robustid.app import run_steps as steps
from robustid.app.run_file import MODES_NOTE, Modes, PriorChoice, RunFile
from robustid.app.run_result import IdentifiedReduced, Store
from robustid.app.run_steps import Say
from robustid.app.sources import Measured
from robustid.data import FrequencyResponse
from robustid.errors import InconsistentDataError, InputError, Status
from robustid.guarantees import (
    WorstCaseError,
    WorstCaseOverPoles,
    default_grid,
    worst_case_error,
    worst_case_over_poles,
)
from robustid.identification import Identification, MixedProblem, identify, prior_fields, validate
from robustid.mfd import RigidBody
from robustid.reduction import Reduction, reduce_within_bounds
from robustid.report import at_most

_FIXED_POLES = (
    "The poles were taken from these data, which leave them a box. This bound holds for the poles as they were taken, not for the"
    " box: over_poles = true in [worst_case] covers it (minutes{})."
)


def from_data(run: RunFile, data: Measured, say: Say, store: Store, executor: Any) -> IdentifiedReduced:
    """Modes, lines, bounds and prior as the run file says, or chosen; then the rest."""
    # Refuses what lacks a sample time or a bound, before anything is computed from it.
    placeholder = steps.placeholder(run, data)
    everything = MixedProblem(frequency=data.responses, time=data.records, prior=placeholder)
    dt = everything.dt
    _check_frequencies(run, dt)
    if run.worst_case.over_poles and not everything.entries.single:
        raise InputError(
            "[worst_case] over_poles = true bounds one entry: add channel = [output, input], by number or name, or leave it out"
        )
    store.responses(data.responses)
    run = steps.with_modes(run, data, say)
    parts = [steps.chosen_lines(run, frf) for frf in data.responses]
    basis = steps.basis_of(run.modes, dt)
    used = [lines for lines, _ in parts]
    problem = MixedProblem(frequency=used, time=data.records, prior=placeholder, parametric=basis)
    run = steps.with_inflation(run, problem, say)
    problem = _inflated(problem, run)
    store.choices(run)
    run, prior = steps.with_prior(run, problem, say)
    store.choices(run)
    unused = [steps.inflated(rest, run) for _, rest in parts if rest is not None]
    return _decided(run, dataclasses.replace(problem, prior=prior), unused, say, store, executor)


def _check_frequencies(run: RunFile, dt: float) -> None:
    """What is stated in Hz, against the sample time of the data."""
    for place, stated in (("[modes] hz", run.modes.hz), ("[worst_case] at_hz", run.worst_case.at_hz)):
        if stated and max(stated) > 0.5 / dt * (1 + 1e-9):
            raise InputError(
                f"{place} holds {max(stated):g} Hz, above the Nyquist frequency of {0.5 / dt:g} Hz at dt = {dt:g} s"
            )


def from_problem(run: RunFile, problem: MixedProblem, say: Say, executor: Any) -> IdentifiedReduced:
    """The class as the problem states it."""
    run = dataclasses.replace(
        run,
        prior=PriorChoice(**prior_fields(problem.prior)),
        modes=Modes(note="Parametric part as stated in the problem that was given in Python."),
    )
    _check_frequencies(run, problem.dt)
    run = steps.with_inflation(run, problem, say)
    return _decided(run, _inflated(problem, run), [], say, Store(), executor)


def _inflated(problem: MixedProblem, run: RunFile) -> MixedProblem:
    wide = {kind: tuple(steps.inflated(d, run) for d in getattr(problem, kind)) for kind in ("frequency", "time")}
    return dataclasses.replace(problem, **wide)


def _decided(
    run: RunFile,
    problem: MixedProblem,
    unused: list[FrequencyResponse],
    say: Say,
    store: Store,
    executor: Any,
) -> IdentifiedReduced:
    """Consistency, the small model, its error, and what can be said of them."""
    how = run.identify
    result = store.identification(problem, how.objective)
    if result is None:
        say(f"margin and model: {problem.coefficients} coefficients, {problem.samples} samples")
        result = identify(problem, objective=how.objective, solver=how.solver, accuracy=how.accuracy, form=how.form)
        result = dataclasses.replace(result, notes=(*result.notes, *run.choices))
        store.identified(result)
    else:
        say("margin and model: taken from the unfinished run")
    say("searching for the smallest order")
    bodies = run.small_model.rigid_body
    reduction = reduce_within_bounds(result, rigid_body=None if bodies is None else RigidBody(bodies))
    findings = [*_about_class(run, result, say), steps.sample_words(result, reduction.model, reduction.order)]
    findings += [steps.unused_words(validate(reduction.model, lines)) for lines in unused]
    error = small = band = None
    if result.consistent and run.worst_case.compute:
        run, error, small = _bounded(run, result, reduction, say, store, executor)
        findings.append(_error_words(small))
        if (run.modes.note or "").startswith(MODES_NOTE) and run.modes.hz and not run.worst_case.over_poles:
            single = problem.entries.single
            findings.append(_FIXED_POLES.format("" if single else "; of one entry, channel = [output, input]"))
    if result.consistent and run.worst_case.over_poles:
        band, words = _over_poles(run, result, reduction, say, store, executor)
        findings.append(words)
    return IdentifiedReduced(
        identification=result,
        reduction=reduction,
        worst_case=error,
        error=small,
        over_poles=band,
        findings=tuple(findings),
        run_file=run,
    )


def _about_class(run: RunFile, result: Identification, say: Say) -> list[str]:
    """Whether the data fit, and if not, what would help."""
    factor = run.identify.inflate
    wider = "" if factor == 1 else f", with every bound {factor:.4g} times as large as measured"
    if result.status is not Status.INCONSISTENT:
        return [f"The data are {result.status.value}{wider} (margin {result.margin:.4g})."]
    say("what would help: other modes, other priors")
    needed = float(steps.SPARE * result.margin * (factor if isinstance(factor, float) else 1.0))
    return [
        diagnose(result).summary(),
        f"Nothing was widened{' further' if wider else ''}. To go on with wider bounds, state them: inflate = {needed:.4g}"
        f' (10 % more than this class needs) or inflate = "auto", in [identify]; every result then says so.',
    ]


def _bounded(
    run: RunFile, result: Identification, reduction: Reduction, say: Say, store: Store, executor: Any
) -> tuple[RunFile, WorstCaseError, WorstCaseError]:
    """What every consistent system can be away from the identified and from the small model."""
    asked = run.worst_case
    if asked.at_hz is None:
        run = run.changed("worst_case", at_hz=tuple((default_grid(result) / (2 * np.pi)).tolist()))
        store.choices(run)
    omega = 2 * np.pi * np.array(run.worst_case.at_hz)
    words = "bounding the error at every frequency"
    spread = {"executor": executor, "resume": store.unfinished}
    error = worst_case_error(
        result,
        omega=omega,
        directions=asked.directions,
        rtol=asked.rtol,
        progress=lambda done, count: say(words, done, count),
        **spread,
    )
    small = error.with_model(reduction.model)
    if asked.circle:
        words_between = "bounding the error between the frequencies"
        small.on_circle(asked.rtol, progress=lambda done, count: say(words_between, done, count), **spread)
    return run, error, small


def _error_words(error: WorstCaseError) -> str:
    upper = error.upper
    size = np.abs(np.reshape(error.nominal, upper.shape))
    k, i, j = np.unravel_index(np.argmax(upper), upper.shape)
    problem = error.identification.problem
    place = f"{error.omega[k] / (2 * np.pi):.5g} Hz{steps.of_entry(problem, int(i), int(j))}"
    entries = "" if upper[0].size == 1 else " in every entry"
    text = (
        f"Every consistent system is within {at_most(upper.max())} of the small model{entries} at {len(upper)} frequencies"
        f" (largest at {place}), in the median {100 * np.median(upper / np.maximum(size, 1e-300)):.3g} % of the response."
    )
    circle = error.known_circle
    return text + ("" if circle is None else f" At all frequencies: within {at_most(circle.largest)}.")


def _over_poles(
    run: RunFile, result: Identification, reduction: Reduction, say: Say, store: Store, executor: Any
) -> tuple[WorstCaseOverPoles | None, str]:
    """The same with the poles anywhere in their box."""
    modes, words = run.modes, "bounding the error over the box of the poles"
    if not modes.hz or modes.hz_interval is None:
        return None, "There are no poles to vary: over_poles has nothing to bound."
    try:
        band = worst_case_over_poles(
            result,
            2 * np.pi * np.array(modes.hz_interval),
            np.array(modes.damping_interval),
            delay=modes.delay or 0,
            model=reduction.model,
            executor=executor,
            progress=lambda done, count: say(words, done, count),
            resume=store.unfinished,
        )
    except (InputError, InconsistentDataError) as error:
        return None, f"The guarantee with the poles anywhere in their box could not be computed: {error}"
    text = f"With the poles anywhere in their box: within {at_most(band.upper.max())} of the small model"
    return band, f"{text} at {band.omega.size} frequencies."
