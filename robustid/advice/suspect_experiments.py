"""Experiments that contradict the others: the gain bound that the data ask for with them and without them, and what undoes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from robustid.advice.causes import judged_margin
from robustid.advice.experiment_corrections import (
    Correction,
    Experiment,
    corrections_for,
    experiments,
    without_experiments,
)
from robustid.advice.gain_curve import possible_rates, representatives
from robustid.advice.smallest_gain import CEILINGS, response_sizes, selected, smallest_gain
from robustid.core import Budget
from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.errors import InputError, SolverError
from robustid.identification import MixedProblem, identify, model_residuals

FACTOR = 5.0  # by which an experiment multiplies the smallest gain bound before it is suspected
_ALIKE = 2.0  # factor between gain bounds within which two experiments are suspected alike


class Posed(NamedTuple):
    """Problems that tell whether some experiments contradict the others."""

    rest: MixedProblem  # the others, at poles that are theirs
    # whole, joined: All data, at the same poles, and at these and those that the experiments show by themselves
    whole: MixedProblem
    joined: MixedProblem
    # the experiments by themselves, at their own poles; None where they do not excite every input, or see every
    # output
    alone: MixedProblem | None


def suspect_experiments(
    problem: MixedProblem, posed: Callable[[tuple[Experiment, ...]], Posed], budget: Budget
) -> dict[Experiment, str]:
    """The experiment, or all records, that contradict the others, each with the correction that undoes it, "" for none.

    At the slowest decay rate, where a class holds most: the smallest gain bound of all data is larger than every response, so that
    the class says nothing, whichever poles it has, and without the suspects it is five times smaller at least, and no larger than
    the largest response. A correction has to do the same; what no correction helps is held by a class when it is alone.
    """
    try:
        rate = float(possible_rates(problem)[0])
        largest, floor = response_sizes(problem)
        asked = _gain(problem, problem, rate, budget)
    except InputError:
        return {}
    if asked <= largest:
        return {}
    every = experiments(problem)
    together = tuple(one for one in every if one.kind == "time")
    groups = [(one,) for one in every] + ([together] if len(every) > len(together) > 1 else [])
    found: list[tuple[float, tuple[Experiment, ...], Posed]] = []
    for group in groups:
        if budget.over or (len(group) > 1 and found):
            break
        try:
            tried = posed(group)
            gain = max(_gain(tried.rest, problem, rate, budget), floor)
            most = max(largest, FACTOR * gain)
            if gain > largest or FACTOR * gain > asked:
                continue
            if all(_gain(one, problem, rate, budget) > most for one in (tried.whole, tried.joined)):
                found.append((gain, group, tried))
        except InputError:  # the others do not excite every input, or see every output
            continue
    if not found:
        return {}
    least = min(gain for gain, *_ in found)
    # Of two that contradict each other the record is suspected, whose poles are not those of the class, and the later one.
    alike = [one for one in found if one[0] <= _ALIKE * least or len(every) == 2]
    gain, group, tried = max(alike, key=lambda one: (one[1][0].kind == "time", one[1][0].place))
    most = min(response_sizes(tried.rest)[0], asked / FACTOR)
    corrections: dict[Experiment, str] = {}
    for one in group:
        beside, place = _beside(tried.joined, one, group)
        rest = tried.rest.with_prior(gain_bound=2 * gain, rate=rate)
        corrections[one] = _by_gain(beside, rest, place, most, rate, budget)
    # What no class holds when it is alone contradicts the class, not the others.
    sound = tried.alone is None or _gain(tried.alone, problem, rate, budget) <= largest
    return corrections if sound or all(corrections.values()) else {}


def _by_gain(
    problem: MixedProblem, rest: MixedProblem, one: Experiment, most: float, rate: float, budget: Budget
) -> str:
    """The correction of one experiment with which the data ask for the smallest gain bound; "" where none is below `most`."""
    part = _representing(problem).with_prior(gain_bound=most, rate=rate)
    for tried in _corrections(problem, rest, one):
        found = [
            (smallest_gain(changed, rate, rest, CEILINGS[:1], budget), correction.correction)
            for correction in tried
            if _margin(part, one, correction.correction, budget) <= 1
            and (changed := one.corrected(part, correction.correction)) is not None
        ]
        if found:
            return min(found, key=lambda each: each[0])[1]
    return ""


def _representing(problem: MixedProblem) -> MixedProblem:
    """The problem with the points that stand for all."""
    masks = representatives(problem)
    return problem if masks is None else selected(problem, masks)


def _beside(problem: MixedProblem, one: Experiment, suspects: Sequence[Experiment]) -> tuple[MixedProblem, Experiment]:
    """The problem without all suspects but one, and the place of that one in it."""
    beside = without_experiments(problem, [other for other in suspects if other != one])
    before = sum(other.kind == one.kind and other.place < one.place for other in suspects)
    return beside, Experiment(one.kind, one.place - before)


def _corrections(problem: MixedProblem, rest: MixedProblem, one: Experiment) -> Iterator[list[Correction]]:
    """Corrections to try, those of sign, phase and unit before delays, and these before a factor that is no unit."""
    tried = list(corrections_for(one.of(problem)))
    for late in (False, True):
        yield [correction for correction in tried if (correction.kind is FaultKind.LATE) is late]
    if (factor := _factor(problem, rest, one)) is not None:
        words = f"the others ask for {factor:.4g} times the {_WHAT[one.kind]}"
        yield [Correction(f"times {factor:.4g}", words, FaultKind.UNIT, 1 / factor)]


def _gain(problem: MixedProblem, whole: MixedProblem, rate: float, budget: Budget) -> float:
    """Smallest gain bound of the points that stand for all; inf beyond 8 times the largest response."""
    return smallest_gain(_representing(problem), rate, whole, CEILINGS[:1], budget)


def contradiction_faults(
    problem: MixedProblem, suspects: Sequence[Experiment], budget: Budget
) -> dict[Experiment, Fault]:
    """Faults of experiments that contradict the others, whose class is that of the problem.

    A correction with which the class holds the experiment beside the others names it; where none does, it is of another plant,
    or tells what the others cannot.
    """
    found: dict[Experiment, Fault] = {}
    for one in suspects:  # each by itself beside those that are not suspected
        beside, place = _beside(problem, one, suspects)
        if not _inside(beside, budget):
            found[one] = _numbered(_fault(beside, place, budget), one, problem)
    return found


def _inside(problem: MixedProblem, budget: Budget) -> bool:
    """Tell whether the class holds the data."""
    try:
        return judged_margin(problem, 1.0, budget) <= 1
    except (InputError, SolverError):
        return False


def _fault(problem: MixedProblem, one: Experiment, budget: Budget) -> Fault:
    """The fault of one experiment beside others that make the class."""
    rest, rate = without_experiments(problem, [one]), float(possible_rates(problem)[0])
    least = max(_gain(rest, problem, rate, budget), response_sizes(problem)[1])
    times = _gain(problem, problem, rate, budget) / least
    more = (
        f"K would have to be {times:.3g} times as large" if np.isfinite(times) else "no K that says anything would do"
    )
    what, two = _WHAT[one.kind], len(experiments(problem)) == 2
    others, ask = ("the other experiment", "asks") if two else ("the others", "ask")
    more = f"K would have to be {times:.3g} times as large as for {others} alone"
    more = more if np.isfinite(times) else "no K that says anything would do"
    if (best := _best_correction(problem, rest, one, budget)) is None:
        whose = f"one of the two is of another plant or another point of operation, or the {what} tells what the other cannot"
        if not two:
            whose = f"it is of another plant or another point of operation, or tells what {others} cannot"
        evidence = (
            f"{more}, and no correction helps; {whose}. Measure again with nothing changed between them, or leave it out"
            f" ({_LEFT_OUT[one.kind]})"
        )
        return Fault(FaultKind.OTHER_PLANT, f"the {what} contradicts {others}", evidence, size=float(times))
    correction, margin = best
    evidence = (
        f"the class that {others} {ask} for holds it with the correction alone (margin {margin:.3g}), without it {more}"
    )
    evidence += "; or the mistake is in the other one" * two
    return Fault(correction.kind, correction.words, evidence, correction.correction, size=correction.size)


_WHAT = {"frequency": "response", "time": "record"}
_LEFT_OUT = {
    "frequency": "its [[frequency]] or [[record]] in a run file, its --frequency on the command line, its item of a call",
    "time": "its [[record]] in a run file, its --time on the command line, its item of a call",
}


def _numbered(fault: Fault, one: Experiment, problem: MixedProblem) -> Fault:
    """The fault with the number of its experiment: of a response always, of a record among several."""
    if one.kind == "frequency":
        return fault._replace(response=one.place + 1)
    return fault._replace(record=one.place + 1 if one.several(problem) else 0)


def _best_correction(
    problem: MixedProblem, rest: MixedProblem, one: Experiment, budget: Budget
) -> tuple[Correction, float] | None:
    """The correction of one experiment with which the class holds it beside the others, and the margin with it."""
    part = _representing(problem)
    for tried in _corrections(problem, rest, one):
        found = [(_margin(part, one, each.correction, budget), k, each) for k, each in enumerate(tried)]
        for margin, _, correction in sorted(found, key=lambda each: each[:2]):
            if margin <= 1 and (margin := _margin(problem, one, correction.correction, budget)) <= 1:
                return correction, margin
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
