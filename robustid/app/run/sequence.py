"""From bounded data, or a problem, to the small model and its error: the steps, and the list of them that a run carries out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from robustid.advice import Diagnosis, content, diagnose
from robustid.app.run import findings
from robustid.app.run.candidates import tried
from robustid.app.run.class_choice import SPARE, inflated_problem, with_larger_gain
from robustid.app.run.designed import designed
from robustid.app.run.kept_out import compared, with_frequencies
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import box_of_modes, held_box
from robustid.app.run.posing import MARGIN_SHARE, posed, posed_as_stated
from robustid.app.run.results import IdentifiedReduced, WiderBand
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.work import Step, Untouched, Work, carry_out, narrowing_limit
from robustid.core import Budget, Interruptible, Real, Record, Source, pass_on
from robustid.errors import InconsistentDataError, InputError, Status
from robustid.fitting import RigidBody
from robustid.guarantees import (
    Contradiction,
    WorstCaseOverPoles,
    band,
    contradiction,
    default_grid,
    error_in_time,
    limiting_polygons,
    loop_bounds,
    worst_case_error,
    worst_case_over_poles,
)
from robustid.identification import Identification, MixedProblem, identify, largest_ratio
from robustid.reduction import (
    model_worth_having,
    reduce_plant,
    reduce_within_bounds,
    why_not_compared,
    without_doubtful_modes,
)

_PREDICTED = 2000  # samples that are compared with what the others leave, before the margin
_MANY = 400  # coefficients whose decision takes minutes
_LARGER = 4  # times that a gain bound which the program chose is doubled
_SUMS = 0.2  # of the time that is left when a step begins, as those of the next line
_BAND, _ORDER, _FITS, _CAUSES = 0.3, 0.3, 0.2, 0.5
_ORDER_LAST = 0.5  # of the time that is left, where nothing was decided: no band and no causes come after
_SWEPT, _JOINED, _LIMITING = 0.65, 0.3, 0.5  # of the time that is left: checks, and the loop itself, come after
_LONGEST_CAUSES = 60.0  # seconds
_LONGEST_FITS = 30.0  # seconds, after which fits tell nothing more


def from_data(run: RunFile, data: Measured, around: Surroundings) -> IdentifiedReduced:
    """The result with modes, frequency points, bounds and prior as the run file says, or chosen."""
    return _whole(*posed(run, data, around), around, data)


def from_problem(run: RunFile, problem: MixedProblem, around: Surroundings) -> IdentifiedReduced:
    """The result with the class as the problem states it."""
    return _whole(*posed_as_stated(run, problem, around), around)


def _whole(
    run: RunFile, problem: MixedProblem, left: Untouched, around: Surroundings, data: Measured | None = None
) -> IdentifiedReduced:
    """Consistency, the small model, its error, and what can be said of them."""
    work, asked = decided(run, problem, left, around), run.worst_case
    if data is not None:
        work.loop, work.controllers, work.structure = data.loop, data.controllers, data.structure
    small: list[Step] = [reduced, compared_with_fits, without_doubtful]
    if work.loop is not None:  # fits are those of the plant
        small = [reduced]
    if not work.identification.consistent:
        carry_out(work, [*([proved_if_wider] if asked.compute else []), *small, diagnosed])
    else:
        carry_out(work, [*([proved] if asked.compute else []), *small, refined, seen_between])
        nothing_said = work.content is not None and work.content.empty and asked.at_hz is None
        if asked.compute and not nothing_said:
            chosen = run.modes.source is Source.DATA and work.band is not None and work.band.box is not None
            swept: list[Step] = [gridded, bounded, circled, refined]
            if chosen and not (asked.over_poles or asked.circle):
                swept = [narrowed]
            elif work.loop is not None and asked.at_hz is None and not asked.circle:
                swept = [limiting, refined]
            carry_out(work, [*swept, judged])
        if asked.over_poles:
            carry_out(work, [bounded_over_box, refined])
    carry_out(work, [in_loop, tried, designed])
    return IdentifiedReduced(
        withheld=work.withheld,
        identification=work.identification,
        content=work.content,
        reduction=work.small,
        worth=work.worth,
        worst_case=None if work.error is None else work.error.with_model(work.identification.model),
        error=work.error,
        over_poles=work.over_poles,
        band=work.band,
        wider=None if work.wider is None else work.wider._replace(band=work.wider.band.with_model(work.model)),
        findings=findings.sentences(work),
        diagnosis=work.diagnosis,
        run_file=work.run,
        unfinished=around.unfinished,
        loop=work.looped,
        plant=work.plant,
        candidates=work.tried,
        design=work.design,
    )


def decided(run: RunFile, problem: MixedProblem, left: Untouched, around: Surroundings) -> Work:
    """Consistency with its proof; in a larger class, where the program chose one that is too small by a little."""
    refuted, result = _refuted(problem, around), identified(run, problem, around)
    for _ in range(_LARGER):
        if around.stops.interrupted or (larger := with_larger_gain(run, result)) is None:
            break
        run, problem = larger
        around.folder.choices(run)
        refuted, result = _refuted(problem, around), identified(run, problem, around)
    return Work(run=run, identification=result, around=around, left=left, refuted=refuted, box=box_of_modes(run.modes))


def _refuted(problem: MixedProblem, around: Surroundings) -> Contradiction | None:
    """A contradiction between the data and the class that sums show, said at once; None where they show none in their time.

    Of very many samples they take as long as the margin, and are left to it.
    """
    if problem.prior.positive_real or problem.samples > _PREDICTED:
        return None
    words = "looking for samples that no system explains"
    with around.step(words, _SUMS) as limit:
        found = contradiction(problem, time_limit=limit, progress=around.progress(words))
    if found is not None:
        around.say(found.summary())
    return found


def identified(
    run: RunFile, problem: MixedProblem, around: Surroundings, *, of: str = "", member: int | None = None
) -> Identification:
    """Margin and model: those of an unfinished run of exactly this problem, or computed; `of` a member of a family."""
    before = around.folder.identification(problem, run.identify.objective, member=member)
    if before is not None:
        around.say(f"margin and model{of}: taken from the unfinished run")
        return before
    # Of a class whose search was cut short nothing can be decided at once; a folder keeps the gains that were found for later.
    pass_on(around.stops.interrupted and around.folder.folder is None)
    if around.folder.folder is not None and problem.coefficients >= _MANY and problem.frequency:
        around.say(
            "so many coefficients take minutes; every = 2 in [frequency_points] halves them, and tests with the others"
        )
    words, asked = f"margin and model{of}: {problem.coefficients} coefficients, {problem.samples} samples", run.identify
    with around.step(words, MARGIN_SHARE, asked.time_limit) as limit:
        result = identify(problem, **asked.arguments, time_limit=limit, progress=around.progress(words))
    if result.claim.stopped:
        around.ended_early(words)
    result = dataclasses.replace(result, choices=result.choices | run.choices)
    around.folder.identified(result, member=member)
    return result


def proved(work: Work) -> None:
    """The band that is proved at every frequency, kept as soon as it is there; at the poles as they stand where there is no box."""
    result = work.identification
    if result.verified_status is not Status.CONSISTENT:
        return
    if result.prior.positive_real:  # a class without a gain has none
        return
    words, has_time = "proving the error at every frequency", math.isfinite(work.around.budget.left)
    with work.around.step(words, _BAND, None if has_time else work.run.worst_case.time_limit) as limit:
        told, box = work.around.progress(words), held_box(work.box, result.problem)
        work.band = band(result, box=box, time_limit=limit, progress=told)
    work.around.folder.proved(work.band)


def proved_if_wider(work: Work) -> None:
    """The band of data that are not consistent if every bound were larger, by 10 % more than the class needs."""
    result = work.identification
    if result.status is Status.FAILED or result.prior.positive_real or not np.isfinite(result.margin):
        return
    factor = SPARE * float(result.margin)
    problem = inflated_problem(
        result.problem, work.run.changed("identify", inflate=factor, inflate_source=Source.PROGRAM)
    )
    words = "proving the error for wider bounds"
    with work.around.step(words, _BAND) as limit:
        told, box = work.around.progress(words), held_box(work.box, problem)
        found = band(problem, box=box, model=result.model, time_limit=limit, progress=told)
    work.wider = WiderBand(factor, found)


def reduced(work: Work) -> None:
    """The smallest model inside the bounds."""
    asked, words = work.run.small_model, "searching for the smallest order"
    body = None if asked.rigid_body is None else RigidBody(asked.rigid_body)
    more = work.identification.status in (Status.CONSISTENT, Status.INCONSISTENT)
    with work.around.step(words, _ORDER if more else _ORDER_LAST, asked.time_limit) as limit:
        told = work.around.progress(words)
        how: Record = {"rigid_body": body, "band": work.band, "time_limit": limit, "progress": told}
        work.reduction = reduce_within_bounds(work.identification, **how)
    if work.reduction.stopped:
        work.around.ended_early(words)


def compared_with_fits(work: Work) -> None:
    """The small model, or one inside the bounds that is significantly better, beside the best fits of the data."""
    result, left = work.identification, work.left
    if work.around.stops.interrupted:
        work.not_compared = "Ctrl-C left out the comparison of the small model with the best fits of the data."
        return
    if work.around.budget.over:  # one fit alone takes long
        work.not_compared = "The time was over before the small model was compared with the best fits of the data."
        return
    work.not_compared = why_not_compared(result, work.small, left.response, left.records)
    if work.not_compared:
        return
    words, short = "comparing it with the best fits", _FITS * work.around.budget.left < _LONGEST_FITS
    with work.around.step(words, _FITS, _LONGEST_FITS, needed=short) as limit:
        told = work.around.progress(words)
        how: Record = {"records": left.records, "time_limit": limit, "progress": told}
        work.worth = model_worth_having(result, work.small, left.response, **how)
    if work.worth is not None:
        work.reduction = work.worth.reduction


def without_doubtful(work: Work) -> None:
    """The small model without modes that the data don't show."""
    small = work.small
    model, work.doubtful = without_doubtful_modes(work.identification, small.model, work.left.points)
    if model is not small.model:
        margin = largest_ratio(work.identification.problem, model)
        work.reduction = dataclasses.replace(small, model=model, order=model.nstates, margin=margin, bound=np.inf)


def diagnosed(work: Work) -> None:
    """The causes of a contradiction, with what would resolve it; nothing where there is none."""
    if work.diagnosis is None:
        work.diagnosis = diagnosis_of(work.identification, work.around)


def diagnosis_of(result: Identification, around: Surroundings) -> Diagnosis | None:
    """The same of an identification."""
    if result.status is not Status.INCONSISTENT:
        return None
    words = "what would help: units, signs, other modes, other priors"
    with around.step(words, _CAUSES, _LONGEST_CAUSES) as limit:
        return diagnose(result, time_limit=limit, progress=around.progress(words))


def seen_between(work: Work) -> None:
    """The content of the class: what it says between the frequency points."""
    if work.identification.problem.frequency:
        work.content = content(work.identification)


def refined(work: Work) -> None:
    """The band around the model, kept, with what polygons add: at exact poles those of the sweep, over a box those over it."""
    if work.band is None:
        return
    polygons = work.error if work.band.box is None else work.over_poles
    work.band = work.band.with_model(work.model)
    if polygons is not None and polygons.omega.size:
        with work.around.step("narrowing the band between semidefinite programs", _JOINED) as limit:
            work.band = work.band.between(polygons, Budget(limit))
    work.around.folder.proved(work.band)


def in_loop(work: Work) -> None:
    """The plant of a loop, and what holds of the loop for every consistent plant."""
    if work.loop is None:
        return
    words = "searching for the smallest plant"
    with work.around.step(words, _ORDER) as limit:
        how: Record = {"time_limit": limit, "progress": work.around.progress(words)}
        work.plant = reduce_plant(work.identification, work.loop, residual=work.model, **how)
    if work.band is not None and work.identification.consistent:
        with work.around.step("what holds of its loop", _BAND) as limit:
            work.looped = loop_bounds(work.band.with_model(work.model), work.loop, time_limit=limit)


def narrowed(work: Work) -> None:
    """The band over the box of poles, with polygons where they gain most or as stated; the run file keeps their frequencies."""
    if work.band is None:
        return
    work.band = work.band.with_model(work.model)
    if work.around.stops.interrupted:
        return
    asked, words = work.run.worst_case, "narrowing the band"
    stated = work.omega if asked.at_hz is None else 2 * np.pi * np.array(asked.at_hz)
    usual = narrowing_limit(work.run.time_limit, work.around.budget.left)
    seconds = asked.time_limit if stated is not None else min(usual, asked.time_limit)
    with work.around.step(words, stated=seconds, needed=stated is not None) as limit:
        how: Record = {"omega": stated, "time_limit": limit, **work.around.counted(words)}
        try:
            work.band = work.band.refine(work.identification, **how)
        except (InputError, InconsistentDataError) as error:
            work.not_over_poles = f"Nothing narrows the band further: {error}"
            return
    polygons = work.band.polygons
    if isinstance(polygons, WorstCaseOverPoles) and polygons.omega.size:
        work.over_poles = polygons
        work.run = work.run.changed("worst_case", at_hz=tuple((polygons.omega / (2 * np.pi)).tolist()))
        work.around.folder.choices(work.run)
    work.around.folder.proved(work.band)


def gridded(work: Work) -> None:
    """The frequencies of the worst case: as stated, or the usual ones and some that were kept out."""
    problem = work.identification.problem
    poles = () if problem.parametric is None else problem.parametric.poles
    work.run = with_frequencies(work.run, default_grid(problem), poles, problem.plane, work.left.withheld)
    work.around.folder.choices(work.run)
    work.omega = 2 * np.pi * np.array(work.run.worst_case.at_hz)


def bounded(work: Work) -> None:
    """The error of every consistent system around the model, which is made small for matrices.

    The limit of this step leaves one frequency at least; that of the run, and Ctrl-C, leave none if need be.
    """
    asked, result, around = work.run.worst_case, work.identification, work.around
    omega = default_grid(result.problem) if work.omega is None else work.omega
    ending = around.stops.interrupted or around.budget.left <= asked.time_limit
    bounding = error_in_time if ending else worst_case_error
    counted = around.counted("bounding the error at every frequency")
    with around.step(f"bounding the error at {omega.size} frequencies", _SWEPT, asked.time_limit) as limit:
        how: Record = asked.arguments | counted | {"omega": omega, "known": work.band, "time_limit": limit}
        work.error = bounding(result, model=work.model, **how)


def limiting(work: Work) -> None:
    """The error of R where the discs of its band limit what is said of the loop; the frequencies are kept in the run file."""
    if work.loop is None or work.band is None or work.around.stops.interrupted:
        return
    asked, result, words = work.run.worst_case, work.identification, "bounding R where it limits the loop"
    with work.around.step(words, _LIMITING, asked.time_limit) as limit:
        how: Record = asked.arguments | work.around.counted(words) | {"time_limit": limit}
        about = work.band.with_model(work.model), work.loop, result, default_grid(result.problem)
        work.error = limiting_polygons(*about, **how)
    if work.error is not None:
        work.run = work.run.changed("worst_case", at_hz=tuple((work.error.omega / (2 * np.pi)).tolist()))
        work.around.folder.choices(work.run)


def sharpened(work: Work) -> None:
    """The band of R with polygons where they limit the loop; over a box of poles, where they gain most."""
    if work.loop is not None and work.band is not None:
        for step in (limiting, refined) if work.band.box is None else (narrowed,):
            step(work)


def circled(work: Work) -> None:
    """The bound between the frequencies too, where it is asked for."""
    asked, around, words = work.run.worst_case, work.around, "bounding the error between the frequencies"
    if not asked.circle or work.error is None:
        return
    if not around.stops.interrupted:
        around.say(words)
        with Interruptible():  # the error at the frequencies stays
            work.error = work.error.completed(executor=around.executor)
            work.error.on_circle(asked.rtol, **around.counted(words))
    if work.error.known_circle is None:
        around.stops.late.append(words)


def judged(work: Work) -> None:
    """The verdict on the band of the data that were kept out."""
    shown = work.error if work.band is None else work.band
    if shown is not None:
        work.withheld = compared(shown, work.left.withheld, work.left.kind)


def bounded_over_box(work: Work) -> None:
    """The error around the small model with the poles anywhere in the box of the run file, or why there is none."""
    modes = work.run.modes
    if not modes.hz or modes.hz_interval is None:
        work.not_over_poles = "There are no poles to vary: over_poles has nothing to bound."
        return
    try:
        bounded_over(work, 2 * np.pi * np.array(modes.hz_interval), np.array(modes.damping_interval), modes.delay or 0)
    except (InputError, InconsistentDataError) as error:
        work.not_over_poles = (
            f"The guarantee with the poles anywhere in the pole-uncertainty box could not be computed: {error}"
        )


def bounded_over(
    work: Work, omega_interval: Real, damping_interval: Real, delay: int, omega: Real | None = None
) -> None:
    """The error around the model with the poles anywhere in a box."""
    words = "bounding the error over the pole-uncertainty box"
    with work.around.step(words, stated=work.run.worst_case.time_limit) as limit:
        how: Record = {"delay": delay, "model": work.model, "omega": omega, "time_limit": limit, "known": work.band}
        how |= work.around.counted(words)
        work.over_poles = worst_case_over_poles(work.identification, omega_interval, damping_interval, **how)
