"""From bounded data, or a problem, to the small model and its error: the steps in their order."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np

from robustid.advice import content
from robustid.app.run import findings
from robustid.app.run.class_choice import (
    chosen_points,
    inflated,
    inflated_problem,
    placeholder,
    with_inflation,
    with_larger_gain,
    with_prior,
)
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.kept_out import compared, looked_at, split_points
from robustid.app.run.measurements import Measured, Say, silent
from robustid.app.run.modes import basis_of, with_fit, with_modes
from robustid.app.run.proved_band import box_of_modes, proved_band, refined_band
from robustid.app.run.results import IdentifiedReduced
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import RunFolder
from robustid.app.run.settings import Modes
from robustid.core import Progress, Source
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InconsistentDataError, InputError
from robustid.fitting import RigidBody
from robustid.guarantees import (
    Band,
    Contradiction,
    WorstCaseError,
    WorstCaseOverPoles,
    contradiction,
    default_grid,
    worst_case_error,
    worst_case_over_poles,
)
from robustid.identification import Identification, MixedProblem, identify, largest_ratio
from robustid.reduction import (
    DoubtfulMode,
    ModelWorth,
    Reduction,
    model_worth_having,
    reduce_within_bounds,
    why_not_compared,
    without_doubtful_modes,
)

_PREDICTED = 2000  # samples that are compared with what the others leave, before the margin
_MANY = 400  # coefficients whose decision takes minutes
_LARGER = 4  # times that a gain bound which the program chose is doubled


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """Receiver of progress, folder of results, and workers."""

    say: Say = silent
    folder: RunFolder = dataclasses.field(default_factory=RunFolder)
    executor: Executor | int | None = None

    def counted(self, words: str) -> dict[str, Any]:
        """Arguments of what is computed at many frequencies: workers, finished ones, progress."""
        return {"executor": self.executor, "resume": self.folder.unfinished, "progress": self.progress(words)}

    def progress(self, words: str) -> Progress:
        """Receiver of the progress of something."""
        return lambda done, count: self.say(words, done, count)

    def begun(self, words: str) -> Progress:
        """Say what begins; receiver of its progress."""
        self.say(words)
        return self.progress(words)


def from_data(run: RunFile, data: Measured, around: Surroundings) -> IdentifiedReduced:
    """The result with modes, frequency points, bounds and prior as the run file says, or chosen."""
    return _decided(*posed(run, data, around), around)


def posed(
    run: RunFile, data: Measured, around: Surroundings, *, reference: bool = True
) -> tuple[RunFile, MixedProblem, Untouched]:
    """The run file with every choice made, the problem that it poses about data, and what it keeps out of it.

    `reference` is what becomes of a class that says nothing; see `with_prior`.
    """
    # Refuses what lacks a sample time or a bound, before anything is computed from it.
    say, folder = around.say, around.folder
    _check(run, MixedProblem(frequency=data.responses, time=data.records, prior=placeholder(run, data)))
    folder.responses(data.responses)
    run = with_modes(with_fit(run, data, say, folder), data, say)
    run, problem, left = without_class(run, data, run.modes)
    run = with_inflation(run, problem, say)
    problem = inflated_problem(problem, run)
    folder.choices(run)
    run, problem = with_prior(run, problem, say, reference=reference)
    folder.choices(run)
    return run, problem, left._replace(points=[inflated(frf, run) for frf in left.points])


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


def from_problem(run: RunFile, problem: MixedProblem, around: Surroundings) -> IdentifiedReduced:
    """The result with the class as the problem states it."""
    run = dataclasses.replace(
        run,
        prior=PriorChoice.of(problem.prior),
        modes=Modes(note="Parametric part as stated in the problem that was given in Python."),
    )
    _check(run, problem)
    run = with_inflation(run, problem, around.say)
    return _decided(
        run,
        inflated_problem(problem, run),
        Untouched([], [], "lines", problem.frequency, () if problem.frequency else problem.time),
        around,
    )


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


class Untouched(NamedTuple):
    """Data that were not used: frequency points with the bounds of those that were, and what was kept out, of one kind.

    `measured` are those that were used, with the bounds as they were measured; a small model is simulated over `records`.
    """

    points: list[FrequencyResponse]
    withheld: list[FrequencyResponse]
    kind: str
    measured: Sequence[FrequencyResponse | TimeRecord]
    records: Sequence[TimeRecord] = ()

    @property
    def response(self) -> FrequencyResponse | None:
        """The first frequency response that was used."""
        return next((one for one in self.measured if isinstance(one, FrequencyResponse)), None)


def _decided(run: RunFile, problem: MixedProblem, left: Untouched, around: Surroundings) -> IdentifiedReduced:
    """Consistency, the small model, its error, and what can be said of them."""
    refuted, result = _refuted(problem, around), _identified(run, problem, around)
    for _ in range(_LARGER):
        if (larger := with_larger_gain(run, result)) is None:
            break
        run, problem = larger
        around.folder.choices(run)
        refuted, result = _refuted(problem, around), _identified(run, problem, around)
    proved = _proved(run, result, around) if result.consistent and run.worst_case.compute else None
    reduction, worth, doubtful = _small_model(run, result, proved, left, around)
    found = [*findings.model_warnings(reduction, doubtful), *findings.class_words(run, result, around.say)]
    said = content(result) if result.consistent and problem.frequency else None
    if proved is not None:
        proved = proved.with_model(reduction.model)
        around.folder.proved(proved)
    if said is not None and said.empty:
        found.insert(0, said.summary())
    place = len(found)  # of what is said of the band, when it is refined
    if said is not None and not said.empty:
        found.append(said.summary())
    found.append(findings.sample_words(result, reduction.model, reduction.order))
    if worth is not None:
        found.append(worth.summary() + findings.withheld_words(worth, left.points or left.withheld))
    else:
        found.append(why_not_compared(result, reduction, left.response, left.records))
    found += [findings.unused_words(reduction.model, points) for points in left.points]
    error = small = over_poles = seen = None
    if said is not None and said.empty and run.worst_case.compute and run.worst_case.at_hz is None:
        found.append(findings.EMPTY)
    elif result.consistent and run.worst_case.compute:
        run, error, small = _bounded(run, result, reduction, left.withheld, proved, around)
        proved = refined_band(proved, small)
        seen = compared(small if proved is None else proved, left.withheld, left.kind)
        found.append(findings.error_words(small, seen))
        if run.modes.source is Source.DATA and run.modes.hz and not run.worst_case.over_poles:
            found.append(findings.pole_words(result, run.modes))
    if result.consistent and run.worst_case.over_poles:
        over_poles, words = _over_poles(run, result, reduction, proved, around)
        proved = refined_band(proved, small, over_poles)
        found.append(words)
    if proved is not None:
        found.insert(place, findings.band_words(proved, small))
    if left.kind != "lines":  # whether the records that were used bound the others, whatever the class is
        found += [findings.mean_words(frf, left.withheld, left.kind) for frf in problem.frequency]
    if seen is not None:
        found = [*seen.sentences, *found] if seen.contradicted else [*found, *seen.sentences]
    if refuted is not None and not result.consistent:
        found.insert(0, refuted.summary())
    return IdentifiedReduced(
        withheld=seen,
        identification=result,
        content=said,
        reduction=reduction,
        worth=worth,
        worst_case=error,
        error=small,
        over_poles=over_poles,
        band=proved,
        findings=tuple(found),
        run_file=run,
    )


def _proved(run: RunFile, result: Identification, around: Surroundings) -> Band | None:
    """The band that is proved at every frequency, kept as soon as it is there."""
    around.say("proving the error at every frequency")
    found = proved_band(result, box_of_modes(run.modes))
    if found is not None:
        around.folder.proved(found)
    return found


def _small_model(
    run: RunFile,
    result: Identification,
    band: Band | None,
    left: Untouched,
    around: Surroundings,
) -> tuple[Reduction, ModelWorth | None, tuple[DoubtfulMode, ...]]:
    """The smallest model inside the bounds, or one that is significantly better, without modes that the data don't show."""
    asked, told = run.small_model, around.begun("searching for the smallest order")
    bodies = asked.rigid_body
    body = None if bodies is None else RigidBody(bodies)
    reduction = reduce_within_bounds(result, rigid_body=body, band=band, time_limit=asked.time_limit, progress=told)
    worth = None
    if not why_not_compared(result, reduction, left.response, left.records):
        told = around.begun("comparing it with the best fits")
        worth = model_worth_having(result, reduction, left.response, records=left.records, progress=told)
        reduction = reduction if worth is None else worth.reduction
    model, doubtful = without_doubtful_modes(result, reduction.model, left.points)
    if model is not reduction.model:
        margin = largest_ratio(result.problem, model)
        reduction = dataclasses.replace(reduction, model=model, order=model.nstates, margin=margin, bound=np.inf)
    return reduction, worth, doubtful


def _refuted(problem: MixedProblem, around: Surroundings) -> Contradiction | None:
    """A contradiction between the data and the class that sums show, said at once; None where they show none.

    Of very many samples they take as long as the margin, and are left to it.
    """
    if problem.prior.positive_real or problem.samples > _PREDICTED:
        return None
    found = contradiction(problem)
    if found is not None:
        around.say(found.summary())
    return found


def _identified(run: RunFile, problem: MixedProblem, around: Surroundings) -> Identification:
    """Margin and model: those of an unfinished run of exactly this problem, or computed."""
    before = around.folder.identification(problem, run.identify.objective)
    if before is not None:
        around.say("margin and model: taken from the unfinished run")
        return before
    words = f"margin and model: {problem.coefficients} coefficients, {problem.samples} samples"
    if problem.coefficients >= _MANY and problem.frequency:
        around.say(
            "so many coefficients take minutes; every = 2 in [frequency_points] halves them, and tests with the others"
        )
    result = identify(problem, **run.identify.arguments, progress=around.begun(words))
    result = dataclasses.replace(result, choices=result.choices | run.choices)
    around.folder.identified(result)
    return result


def _bounded(
    run: RunFile,
    result: Identification,
    reduction: Reduction,
    withheld: list[FrequencyResponse],
    proved: Band | None,
    around: Surroundings,
) -> tuple[RunFile, WorstCaseError, WorstCaseError]:
    """Error of every consistent system around the identified and around the small model, for which it is made small."""
    asked, basis = run.worst_case, result.problem.parametric
    if asked.at_hz is None:
        poles = () if basis is None else basis.poles
        grid = looked_at(default_grid(result.problem), poles, result.problem.plane, withheld)
        run = run.changed("worst_case", at_hz=tuple((grid / (2 * np.pi)).tolist()))
        around.folder.choices(run)
    omega = 2 * np.pi * np.array(run.worst_case.at_hz)
    around.say(f"bounding the error at {omega.size} frequencies, at most {asked.time_limit:g} s")
    counted = around.counted("bounding the error at every frequency")
    small = worst_case_error(result, model=reduction.model, omega=omega, known=proved, **asked.arguments, **counted)
    if asked.circle:
        small = small.completed(executor=around.executor)
        small.on_circle(asked.rtol, **around.counted("bounding the error between the frequencies"))
    return run, small.with_model(result.model), small


def _over_poles(
    run: RunFile, result: Identification, reduction: Reduction, proved: Band | None, around: Surroundings
) -> tuple[WorstCaseOverPoles | None, str]:
    """Error around the small model with the poles anywhere in the pole-uncertainty box, and what to say of it."""
    modes = run.modes
    if not modes.hz or modes.hz_interval is None:
        return None, "There are no poles to vary: over_poles has nothing to bound."
    try:
        found = worst_case_over_poles(
            result,
            2 * np.pi * np.array(modes.hz_interval),
            np.array(modes.damping_interval),
            delay=modes.delay or 0,
            model=reduction.model,
            time_limit=run.worst_case.time_limit,
            known=proved,
            **around.counted("bounding the error over the pole-uncertainty box"),
        )
    except (InputError, InconsistentDataError) as error:
        return None, f"The guarantee with the poles anywhere in the pole-uncertainty box could not be computed: {error}"
    return found, findings.box_words(found)
