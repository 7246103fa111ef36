"""Experiments that contradict the others: the gain bound that the data ask for with them and without them, and what undoes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from robustid.advice.causes import judged_margin
from robustid.advice.experiment_corrections import (
    Correction,
    Experiment,
    corrections_for,
    experiments,
    without_experiments,
)
from robustid.advice.gain_curve import possible_rates
from robustid.advice.prior import representatives
from robustid.advice.smallest_gain import CEILINGS, response_sizes, selected, smallest_gain
from robustid.core import Budget
from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.errors import InputError, SolverError
from robustid.identification import MixedProblem, identify, model_residuals

FACTOR = 5.0  # by which an experiment multiplies the smallest gain bound before it is suspected
_ALIKE = 2.0  # factor between gain bounds within which two experiments are suspected alike


def suspect_experiments(
    problem: MixedProblem, others: Callable[[tuple[Experiment, ...]], MixedProblem], budget: Budget
) -> tuple[Experiment, ...]:
    """The experiment, or all records, without which the data ask for a gain bound several times smaller; () where there is none.

    At the slowest decay rate, where a class holds most: the smallest gain bound of all data is larger than every response, so that
    the class says nothing, and without the suspect it is five times smaller at least, and no larger than the largest response.
    `others` poses the data that are left, with poles of their own where those came from what is left out.
    """
    try:
        rate = float(possible_rates(problem)[0])
        largest, floor = response_sizes(problem)
        asked = _gain(problem, problem, rate, budget)
    except InputError:
        return ()
    if asked <= largest:
        return ()
    every = experiments(problem)
    together = tuple(one for one in every if one.kind == "time")
    groups = [(one,) for one in every] + ([together] if len(every) > len(together) > 1 else [])
    found: list[tuple[float, tuple[Experiment, ...]]] = []
    for group in groups:
        if budget.over or (len(group) > 1 and found):
            break
        try:
            gain = max(_gain(others(group), problem, rate, budget), floor)
        except InputError:  # the others do not excite every input, or see every output
            continue
        if FACTOR * gain <= asked and gain <= largest:
            found.append((gain, group))
    least = min((gain for gain, _ in found), default=np.inf)
    # Of two that contradict each other the record is suspected, whose poles are not those of the class, and the later one.
    alike = [group for gain, group in found if gain <= _ALIKE * least or len(every) == 2]
    return max(alike, key=lambda group: (group[0].kind == "time", group[0].index), default=())


def _gain(problem: MixedProblem, whole: MixedProblem, rate: float, budget: Budget) -> float:
    """Smallest gain bound of the points that stand for all; inf beyond 8 times the largest response."""
    masks = representatives(problem)
    part = problem if masks is None else selected(problem, masks)
    return smallest_gain(part, rate, whole, CEILINGS[:1], budget)


def contradiction_faults(problem: MixedProblem, suspects: Sequence[Experiment], budget: Budget) -> tuple[Fault, ...]:
    """Faults of experiments that contradict the others, whose class is that of the problem.

    A correction with which the class holds the experiment beside the others names it; where none does, it is of another plant,
    or tells what the others cannot.
    """
    found: list[Fault] = []
    for one in suspects:
        # Each by itself beside those that are not suspected.
        beside = without_experiments(problem, [other for other in suspects if other != one])
        before = sum(other.kind == one.kind and other.index < one.index for other in suspects)
        place = Experiment(one.kind, one.index - before)
        found.append(_numbered(_fault(beside, place, budget), one, problem))
    return tuple(found)


def _fault(problem: MixedProblem, one: Experiment, budget: Budget) -> Fault:
    """The fault of one experiment beside others that make the class."""
    rate, rest = problem.prior.rate, without_experiments(problem, [one])
    least = max(_gain(rest, problem, rate, budget), response_sizes(problem)[1])
    times = _gain(problem, problem, rate, budget) / least
    what = "response" if one.kind == "frequency" else "record"
    two = len(experiments(problem)) == 2
    against = "it contradicts the other experiment" + ("" if two else "s")
    asked = f"the smallest K is {times:.3g} times as large" if np.isfinite(times) else "the class says nothing"
    asked = f"with it {asked} at the poles and the decay rate of the class without it"
    if (best := _best_correction(problem, rest, one, budget)) is None:
        words = f"the {what} contradicts the other experiment{'' if two else 's'}"
        remedy = (
            f"{'One of the two' if two else 'It'} is of another plant or another point of operation, or the {what} tells what the"
            f" other{'' if two else 's'} cannot: measure again with nothing changed between them, or leave it out"
            f" ({_LEFT_OUT[one.kind]})"
        )
        return Fault(FaultKind.OTHER_PLANT, words, f"{asked}. {remedy}", size=float(times))
    correction, margin = best
    evidence = f"{against}; {asked}, which holds it after the correction (margin {margin:.3g})"
    evidence += "; or the mistake is in the other one" * two
    return Fault(correction.kind, correction.words, evidence, correction.correction, size=correction.size)


_LEFT_OUT = {
    "frequency": "its [[frequency]] or [[record]] in a run file, its --frequency on the command line, its item of a call",
    "time": "its [[record]] in a run file, its --time on the command line, its item of a call",
}


def _numbered(fault: Fault, one: Experiment, problem: MixedProblem) -> Fault:
    """The fault with the number of its experiment among several."""
    if len(getattr(problem, one.kind)) == 1:
        return fault
    return fault._replace(**{"record" if one.kind == "time" else "response": one.index + 1})


def _best_correction(
    problem: MixedProblem, rest: MixedProblem, one: Experiment, budget: Budget
) -> tuple[Correction, float] | None:
    """The correction of one experiment with which the class holds it beside the others, and the margin with it.

    Corrections of sign, phase and unit come before delays, and these before a factor that is no unit.
    """
    masks = representatives(problem)
    part = problem if masks is None else selected(problem, masks)
    tried = list(corrections_for(one.of(problem)))
    kinds = {correction.kind for correction in tried}
    for late in (False, True):
        found = [
            (margin, k, correction)
            for k, correction in enumerate(tried)
            if (correction.kind is FaultKind.LATE) is late
            and (margin := _margin(part, one, correction.correction, budget)) <= 1
        ]
        for _, _, correction in sorted(found, key=lambda each: each[:2]):
            if (margin := _margin(problem, one, correction.correction, budget)) <= 1:
                return correction, margin
    if FaultKind.UNIT in kinds and (factor := _factor(problem, rest, one)) is not None:
        noun = one.kind == "frequency"
        words = f"the others ask for {factor:.4g} times the {'response' if noun else 'outputs of the record'}"
        scaled = Correction(f"times {factor:.4g}", words, FaultKind.UNIT, 1 / factor)
        if (margin := _margin(problem, one, scaled.correction, budget)) <= 1:
            return scaled, margin
    return None


def _margin(problem: MixedProblem, one: Experiment, correction: str, budget: Budget) -> float:
    """The margin of a problem with a correction of one experiment; inf where it does not go with the data."""
    changed = one.corrected(problem, correction)
    if changed is None or budget.over:
        return np.inf
    try:
        return judged_margin(changed, 1.0, budget)
    except (InputError, SolverError):
        return np.inf


def _factor(problem: MixedProblem, rest: MixedProblem, one: Experiment) -> float | None:
    """The factor on the data of one experiment with which a model of the others misses them least."""
    item = one.of(problem)
    name = "values" if isinstance(item, FrequencyResponse) else "y"
    alone = without_experiments(problem, [other for other in experiments(problem) if other != one])
    silent = dataclasses.replace(item, **{name: np.zeros_like(getattr(item, name))})
    try:
        model = identify(rest).model
        missed = model_residuals(alone, model)
        predicted = model_residuals(dataclasses.replace(alone, **{one.kind: silent}), model)
    except (InputError, SolverError):
        return None
    data = np.concatenate([np.ravel((a.error - b.error) / a.bound) for a, b in zip(missed, predicted, strict=True)])
    model_ = np.concatenate([np.ravel(-b.error / b.bound) for b in predicted])
    gain = float(np.real(np.vdot(data, model_)) / max(np.real(np.vdot(data, data)), np.finfo(float).tiny))
    return gain if np.isfinite(gain) and gain != 0 else None
