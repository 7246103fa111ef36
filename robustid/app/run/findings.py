"""Sentences about what was found: whether the data fit, which samples lie outside, how far the truth can be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.app.run.candidates import candidate_words
from robustid.app.run.class_choice import SPARE
from robustid.app.run.designed import NOT_DESIGNED, design_words
from robustid.app.run.run_file import RunFile
from robustid.app.run.settings import Modes
from robustid.app.run.work import Work
from robustid.core import Real, Source, counted, hz_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError, Status
from robustid.guarantees import (
    Band,
    Coverage,
    Judgement,
    LoopBounds,
    WorstCaseError,
    WorstCaseOverPoles,
    checked_box,
    coverage,
    largest_error,
    real_poles,
)
from robustid.identification import Identification, MixedProblem, model_residuals, validate
from robustid.reduction import DoubtfulMode, ModelWorth, PlantReduction, Reduction, is_stable
from robustid.report import at_most, stands_on

if TYPE_CHECKING:
    import control

_MOST_NAMED = 6
_EMPTY = (
    "The worst-case error was not computed: a class that says nothing between the frequency points has none that is worth its time."
    " State other modes or a larger decay rate; at_hz in [worst_case] has it computed all the same."
)
_FIXED_POLES = (
    "The poles were taken from these data, which leave them a pole-uncertainty box. This bound holds for the poles as they were"
    " taken, not for the box"
)
_OVER_POLES = ": over_poles = true in [worst_case] covers it (minutes)"
_REAL_POLES = (
    "The real poles were chosen from these data and are a part of the class: the plant may have others, which these follow over the"
    " frequency points. This bound holds for the class; data can refute it, never prove it."
)


def sentences(work: Work) -> tuple[str, ...]:
    """Everything that can be said of a run: what refutes the class or the band first, then what was found."""
    run, result, left, small, said = work.run, work.identification, work.left, work.small, work.content
    found = [*model_warnings(small, work.doubtful), *class_words(run, result)]
    if work.plant is not None:  # a small R of order 0 is no fault: the auxiliary plant says it all
        found = [plant_words(work.plant, work.looped), *class_words(run, result)]
        found[1:1] = [candidate_words(name, one) for name, one in work.tried.items()]
        if work.controllers and work.looped is None:
            found.insert(1, "No controller was tried: there is no band of R that plants could be taken from.")
    if said is not None and said.empty:
        found.insert(0, said.summary())
    if work.design is not None:
        found.append(design_words(work.design))
    elif work.not_designed:
        found.append(NOT_DESIGNED.format(work.not_designed))
    looped = work.plant is not None
    if work.band is not None and not looped:
        found.append(band_words(work.band, work.error, work.withheld))
    if work.wider is not None:
        found.append(
            f"No guarantee, but what would be one if every bound were {work.wider.factor:.4g} times as large (10 % more than this"
            f" class needs)."
            f" {band_words(work.wider.band.with_model(work.model), None)}"
        )
    if said is not None and not said.empty:
        found.append(said.summary())
    found.append(sample_words(result, small.model, small.order))
    if work.worth is not None:
        found.append(work.worth.summary() + withheld_words(work.worth, left.points or left.withheld))
    elif work.not_compared:
        found.append(work.not_compared)
    found += [unused_words(small.model, points) for points in left.points]
    if work.error is not None:
        found += [work.error.unfinished] * bool(looped and work.error.missing.size)
        found += [] if looped else [error_words(work.error, work.withheld)]
        if run.modes.source is Source.DATA and run.modes.hz and not run.worst_case.over_poles:
            found.append(pole_words(result, run.modes))
    elif said is not None and said.empty and run.worst_case.compute:
        found.append(_EMPTY)
    if work.over_poles is not None and run.worst_case.over_poles:
        found.append(box_words(work.over_poles))
    elif work.not_over_poles:
        found.append(work.not_over_poles)
    if left.kind != "lines":  # whether the records that were used bound the others, whatever the class is
        found += [mean_words(frf, left.withheld, left.kind) for frf in result.problem.frequency]
    if (seen := work.withheld) is not None:
        found = [*seen.sentences, *found] if seen.contradicted else [*found, *seen.sentences]
    if work.refuted is not None and not result.consistent:
        found.insert(0, work.refuted.summary())
    return tuple(found)


def plant_words(plant: PlantReduction, looped: LoopBounds | None) -> str:
    """Sentences on the plant of a loop, and what holds of the loop."""
    unstable = int(np.sum(~is_stable(plant.model.A, plant.model.dt)[1]))
    poles = f"with {unstable} unstable pole{'s' * (unstable > 1)}" if unstable else "stable"
    found = "What follows is about the stable system R of the loop, the deviation from the auxiliary plant. The plant: a model of"
    found += (
        f" order {plant.order}, {poles}, which the controller that ran stabilises and whose R keeps every sample within"
    )
    found += f" {plant.margin:.4g} of its bound."
    if looped is None:
        return found
    if looped.unbounded:
        return f"{found} Of the loop with every consistent plant {looped.unbounded}."
    peak, margins = looped.peaks["sensitivity"], looped.margins
    low, high = margins.gain
    omega = looped.omega[looped.omega > 0]
    (centre, radius), model = looped.plant_at(omega), looped.loop.response_of(plant.model, omega)
    away = np.linalg.norm(centre - model, 2, axis=(1, 2)) + radius
    share = 100 * float(np.median(away / np.linalg.norm(model, 2, axis=(1, 2))))
    found += f" Every consistent plant is within {at_most(share, 3)} % of this model's response in the median of {omega.size}"
    found += f" frequencies up to {hz_words(omega.max() / (2 * np.pi), 4)}{looped.band.problem.scope}."
    return (
        f"{found} With every consistent plant the sensitivity is at most {peak.value:.4g} (zone {looped.zone} of ISO 14839-3:2006),"
        f" and the loop is stable for gains from {low:.3g} to {high:.3g} times that of the controller and phases up to"
        f" {np.degrees(margins.phase):.3g} degrees either way."
    )


def class_words(run: RunFile, result: Identification) -> list[str]:
    """Sentences that say whether the data fit, and if not, that nothing was done about it."""
    factor = run.identify.inflate
    about = [*result.problem.about, *(f"{fault.heading}: {fault}." for fault in result.problem.data_faults)]
    wider = "" if factor == 1 else f", with every bound {factor:.4g} times as large as measured"
    if result.status is not Status.INCONSISTENT:
        return [*about, f"The data are {result.status.value}{wider} (margin {result.margin:.4g})."]
    needed = float(SPARE * result.margin * (factor if isinstance(factor, float) else 1.0))
    return [
        *about,
        f"Nothing was widened{' further' if wider else ''}. To go on with wider bounds, state them: inflate = {needed:.4g}"
        f' (10 % more than this class needs) or inflate = "auto", in [identify]; every result then says so.',
    ]


def pole_words(identification: Identification, modes: Modes) -> str:
    """Sentence on poles that were taken from the data, and the bound that covers their box where there is one."""
    if 1 in (modes.damping or ()):
        return _REAL_POLES
    if modes.hz_interval is None:
        return f"{_FIXED_POLES}."
    try:
        checked_box(identification, 2 * np.pi * np.array(modes.hz_interval), modes.damping_interval, modes.delay or 0)
    except InputError:
        return f"{_FIXED_POLES}."
    return f"{_FIXED_POLES}{_OVER_POLES}."


def band_words(band: Band, error: WorstCaseError | None, withheld: Coverage | None = None) -> str:
    """Sentences on the band that is proved at every frequency, and on what it stands, beside a sweep of exact poles."""
    poles = "" if band.problem.parametric is None else ", poles taken as exact"
    if band.box is not None:
        real = ", but real ones taken as exact" * bool(real_poles(band.problem))
        poles = f", the poles anywhere in the pole-uncertainty box that the data leave{real}"
    known = band.bounded
    if not known.any():
        return f"No error is proved{poles}: {band.why_nothing}."
    but = f" but from {band.open_words}, where the box of a mode reaches undamped ones" if band.open_ranges else ""
    return (
        f"Proved at every frequency{but}{poles}{band.problem.scope}: every consistent system is within"
        f" {at_most(largest_error(band).value)} of the model of order {band.order} (median"
        f" {band.relative.words}).{_not_of_the_machine(withheld)}"
        f" {stands_on(band, error)} {band.unfinished}"
    ).rstrip()


def box_words(band: WorstCaseOverPoles) -> str:
    """Sentence on the error with the poles anywhere in their box, and on what is too wide for one."""
    upper, start = band.sigma_upper, "With the poles anywhere in the pole-uncertainty box"
    known, wide = np.isfinite(upper), band.too_wide or "a mode"
    advice = (
        f"the box of {wide} is too wide; measure more frequency points around it, or state a smaller box that you know"
    )
    if not known.any():
        return f"{start} nothing is guaranteed at any of {upper.size} frequencies: {advice}."
    start += band.identification.problem.scope
    text = f"{start}: within {at_most(upper[known].max())} of the small model at {known.sum()}"
    if known.all():
        return f"{text} frequencies."
    return f"{text} of {upper.size} frequencies. At the others nothing is guaranteed: {advice}."


def sample_words(identification: Identification, model: control.StateSpace, order: int) -> str:
    """Sentence that says whether a model keeps all samples, or names those that it doesn't."""
    problem = identification.problem
    residuals = model_residuals(problem, model)
    outside = [
        (float(ratio), _place(residual.kind, float(at), of_entry(problem, *residual.entry)))
        for residual in residuals
        for at, ratio in zip(residual.axis, residual.ratio, strict=True)
        if ratio > 1 + 1e-5
    ]
    total = sum(residual.axis.size for residual in residuals)
    largest = max(float(residual.ratio.max()) for residual in residuals)
    if not outside:
        return (
            f"The model of order {order} keeps all {counted(total, 'sample')} within their bounds (largest"
            f" |residual|/bound {largest:.4g})."
        )
    return (
        f"The model of order {order} leaves {len(outside)} of {total} samples outside their bounds: {_named(outside)}."
    )


def unused_words(model: control.StateSpace, data: FrequencyResponse) -> str:
    """Sentence about the small model at frequency points that were not used."""
    ratio = data.ratio(validate(model, data).residuals)
    joint = data.bound.joint
    outside: list[tuple[float, str]] = []
    for k, i, j in np.argwhere(ratio > 1):
        entry = (None if joint != "entry" else int(i), None if joint == "matrix" else int(j))
        place = _place("frequency", float(data.omega[k]), of_entry(data, *entry))
        outside.append((float(ratio[k, i, j]), place))
    count = ratio.shape[0] if ratio[0].size == 1 else f"{ratio.shape[0]} frequency points of {ratio[0].size}"
    text = f"Of {count} {'frequency points' if ratio[0].size == 1 else 'entries each'} that were not used, "
    if not outside:
        return text + f"the small model has all within their bounds (largest |residual|/bound {ratio.max():.4g})."
    return text + f"the small model has {len(outside)} outside their bounds: {_named(outside)}."


def model_warnings(reduction: Reduction, doubtful: Sequence[DoubtfulMode]) -> list[str]:
    """Sentences about a small model that says nothing, and modes that the data hardly show: to be said first."""
    found = [one.summary() for one in doubtful]
    if reduction.order == 0:
        found.insert(
            0,
            "The small model has order 0, a constant: the bounds are so wide that they hold no dynamics. It is no model of the"
            " machine; narrower bounds (more records, longer ones) are what is needed.",
        )
    return found


def withheld_words(worth: ModelWorth, unused: Sequence[FrequencyResponse]) -> str:
    """Sentence that compares small model and best fit at frequency points that were not used; empty where all were."""
    if not unused:
        return ""
    small, best = (100 * validate(model, unused[0]).fit.ravel() for model in (worth.reduction.model, worth.fit.model))
    return (
        f" At the {unused[0].omega.size} frequency points that were not used it fits {_percent(small)}, the best fit"
        f" {_percent(best)}."
    )


def _percent(values: Real) -> str:
    return ", ".join(f"{value:.1f}" for value in values) + " %"


def of_entry(data: FrequencyResponse | MixedProblem, output: int | None, input: int | None) -> str:
    """Name of the entry, output or input that a sample is of, where there are several."""
    if len(data.outputs) == len(data.inputs) == 1:
        return ""
    parts = [str(side[k].name) for side, k in ((data.outputs, output), (data.inputs, input)) if k is not None]
    return f" ({' / '.join(parts)})" if parts else ""


def _place(kind: str, at: float, of: str = "") -> str:
    return (hz_words(at / (2 * np.pi)) if kind == "frequency" else f"{at:.5g} s") + of


def _named(outside: list[tuple[float, str]]) -> str:
    largest = sorted(outside, reverse=True)[:_MOST_NAMED]
    text = ", ".join(f"{place} ({ratio:.4g} bounds)" for ratio, place in largest)
    return text + (f" and {len(outside) - len(largest)} more" if len(outside) > len(largest) else "")


def error_words(error: WorstCaseError, withheld: Coverage | None = None) -> str:
    """Sentence that says how far every consistent system can be from the small model; no guarantee where data contradict it."""
    upper = error.upper
    k, i, j = np.unravel_index(np.argmax(upper), upper.shape)
    problem = error.identification.problem
    place = f"{hz_words(error.omega[k] / (2 * np.pi))}{of_entry(problem, int(i), int(j))}"
    entries = "" if upper[0].size == 1 else " in every entry"
    text = (
        f"Every consistent system is within {at_most(upper.max())} of the small model{entries} at {len(upper)}"
        f" frequencies{problem.scope} (largest at {place}), the median is {error.relative.words}."
    )
    text += _not_of_the_machine(withheld)
    if error.missing.size:
        text += f" {error.unfinished}"
    circle = error.known_circle
    return text + ("" if circle is None else f" At all frequencies: within {at_most(circle.largest)}.")


def _not_of_the_machine(withheld: Coverage | None) -> str:
    """Sentence that follows a claim which withheld data contradict; empty else."""
    if withheld is None or not withheld.contradicted:
        return ""
    return " That is about the class and the data that were used, not about the machine: withheld data contradict it."


def mean_words(used: FrequencyResponse, withheld: Sequence[FrequencyResponse], kind: str) -> str:
    """Sentence that says how many samples of withheld records lie within the bounds of the used ones, which have another mean."""
    found = coverage(used, withheld, kind=kind)
    of, share = f"the {len(found.names)} withheld {kind}", f"{100 * found.power:.3g} % of such tests"
    if found.judgement is Judgement.NOT_TESTED:
        return (
            f"The bounds of the samples that were used are not tested by {of}: bounds three times too narrow would"
            f" surely have shown in only {share}."
        )
    rest = f"; bounds three times too narrow would have shown in {share}"
    if found.contradicted:
        rest = f", the farthest at {found.largest:.4g} bounds ({found.where})"
    return f"Within the bounds of the samples that were used lie {100 * found.share:.4g} % of those of {of}{rest}."
