"""The choices of a run beside its modes: frequency points, bounds and class; as stated, or made from the data and written down."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from robustid.advice import (
    SLIGHTLY,
    PriorSuggestion,
    RealPoles,
    entry_sizes,
    missing_integrators,
    possible_rates,
    response_sizes,
    says_something,
    slow_poles,
    suggest_kautz,
    suggest_prior,
    suggest_roll_off,
    suggest_scaling,
    useful_prior,
)
from robustid.app.run.checks import AUTO
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.every_mode import with_every_mode
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import basis_of
from robustid.app.run.reading import D, Data
from robustid.app.run.real_poles import above_errors, with_real_poles
from robustid.app.run.run_file import PRIOR_NOTE, RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.bases import ParametricBasis
from robustid.core import Budget, Options, Source, hz_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError, Status
from robustid.identification import Identification, MixedProblem, Prior, any_prior, identify, prior_from

DOUBLED = (
    "Each pair is taken twice (repeat = 2, terms k a^k, which absorb small errors of the poles): with single pairs no class that"
    " says much between the samples holds the data."
)
FREE = (
    "integrators = {count}: the response rises towards low frequencies, and beside the modes alone no class that says anything"
    " holds the data; beside {count} pole{s} at {place} one does."
)
FEWER = "One of {every} frequency points is used, the others test what is found: {why}."
TOO_LARGE = (
    "in this class, which decays slowly beside the range of the points, all of them need more coefficients than can be computed"
    " with"
)
TOO_SLOW = "all of them take longer than the time limit leaves"
_LARGEST = 2.0  # times the largest response: a non-parametric part that is chosen
_LARGE = 100.0  # times the largest response: one that holds whatever does not contradict itself
SPARE = 1.1  # beyond the smallest inflation of the bounds
_PRIOR = 0.3  # of the time that is left
_HALF = 0.5  # of the fastest decay that the data allow
_HALVED = 8  # times that the decay of the slowest pole is halved at most
_POINTS, _MANY = 40, 100  # frequency points from which a decay is chosen before all are asked, where there are many
_ROUGH = 0.01  # accuracy of margins that decide only whether a decay is too fast


def chosen_points(run: RunFile, frf: FrequencyResponse) -> tuple[FrequencyResponse, FrequencyResponse | None]:
    """The frequency points that are used, and those that are left to test with."""
    asked = run.frequency_points
    used = np.arange(frf.omega.size) % asked.every == 0
    if asked.near_hz is not None:
        for hz in run.modes.hz or ():
            used |= np.abs(frf.freq_hz - hz) <= asked.near_hz
    if used.all():
        return frf, None
    few, others = (dataclasses.replace(frf.select(part), judged=True) for part in (used, ~used))
    return few, others


def with_step(run: RunFile, every: int, why: str) -> RunFile:
    """The run file with one of so many frequency points, and why; the others test what is found."""
    note = f"{run.prior.note}\n{FEWER.format(every=every, why=why)}"
    return run.changed("prior", note=note).changed("frequency_points", every=every)


def with_inflation(run: RunFile, problem: MixedProblem, around: Surroundings) -> RunFile:
    """The factor on all bounds: as stated, or 10 % more than a reference class needs, never below 1."""
    if run.identify.inflate != "auto":
        return run
    around.say("looking for the smallest factor on the bounds")
    reference, what = _reference(run, problem)
    margin = identify(dataclasses.replace(problem, prior=reference)).margin
    factor = max(1.0, SPARE * float(margin))
    note = (
        f"Bounds: {what} (|G| <= {reference.gain_bound:.4g} in {reference.where}) needs them"
        f" {margin:.4g} times as large. "
        + (
            "They are left as they are."
            if factor == 1
            else f"All are multiplied by {factor:.4g}"
            f' (that and {100 * (SPARE - 1):.0f} %), as inflate = "auto" asks: every result holds for these wider bounds only.'
        )
    )
    return run.changed("identify", inflate=factor, inflate_source=Source.DATA, inflate_note=note)


def placeholder(run: RunFile, data: Measured) -> Prior:
    """A prior of no meaning but its shape and scaling: as stated, or the sizes of the entries where the class isn't stated."""
    if run.prior.gain_bound is None and run.prior.scaling is None:
        return _default_prior((*data.responses, *data.records), run.prior.shape(data.dt))
    return any_prior(data.dt, run.prior.scaling, **run.prior.shape(data.dt))


def _default_prior(data: Sequence[Data], shape: Options | None = None) -> Prior:
    """A prior of no meaning but its shape and scaling, the sizes of the entries of a MIMO response."""
    several = bool(data) and (len(data[0].outputs), len(data[0].inputs)) != (1, 1)
    scaling = suggest_scaling(data) if several else None
    return any_prior(getattr(data[0], "dt", None) if data else None, scaling, **(shape or {}))


def _reference(run: RunFile, problem: MixedProblem) -> tuple[Prior, str]:
    """A class that says something: as stated, or a non-parametric part that is not larger than the data and decays."""
    if (stated := run.prior.stated(problem.dt)) is not None:
        return stated, "the class as stated"
    sizes = np.concatenate([np.zeros(0), *(entry_sizes(problem, f) for f in problem.frequency)])
    small = run.modes.hz and sizes.size
    size = float(np.median(sizes)) if small else response_sizes(problem)[0]
    rates = possible_rates(problem)
    part = "a non-parametric part as large as the"
    words = f"the modes beside {part} median response" if small else f"{part} response"
    return dataclasses.replace(problem.prior.with_rate(float(rates[len(rates) // 2])), gain_bound=size), words


def inflated(data: D, run: RunFile) -> D:
    """Data with all bounds multiplied by the factor of the run file, which their note says; about what they were, of as many
    excitations. Their probability goes: it was stated of the narrower bound.
    """
    factor = run.identify.inflate
    if factor == 1:
        return data
    why = "as stated" if run.identify.inflate_source in (None, Source.STATED) else "as the program found"
    note = f"{data.note or 'bound of the data'}; times {factor:.4g}, {why}"
    return data.with_bound(dataclasses.replace(data.bound.inflated(factor), probability=None, dof=None), note)


def inflated_problem(problem: MixedProblem, run: RunFile) -> MixedProblem:
    """The problem with the bounds of all its data multiplied."""
    wide = {kind: tuple(inflated(d, run) for d in getattr(problem, kind)) for kind in ("frequency", "time")}
    return dataclasses.replace(problem, **wide)


def with_prior(
    run: RunFile,
    problem: MixedProblem,
    around: Surroundings,
    *,
    double: bool = True,
    reference: bool = True,
    delay: int | None = None,
) -> tuple[RunFile, MixedProblem]:
    """Gain bound and decay rate; modes that the program chose are taken twice where they contradict the data, if `double`.
    Where only a class of anything at all fits, a `reference` class that is then refuted; else that class, or where none fits
    one so large that it shows the contradiction of the data themselves. `delay`: that of the pairs, where it was stated.
    """
    if (stated := run.prior.stated(problem.dt)) is not None:
        problem = dataclasses.replace(problem, prior=stated)
        if run.prior.roll_off != AUTO:
            return run, problem
        problem, words = _with_roll_off(problem, around)
        return _with_choice(run, problem.prior, Source.PROGRAM, words), problem
    if (kind := run.prior.passive) is not None:
        around.say("looking for a prior")
        prior, words = _chosen_decay(problem, kind, run.prior.slack, around)
        return _with_choice(run, prior, Source.DATA, words), dataclasses.replace(problem, prior=prior)
    chosen = run.modes
    own = double and chosen.hz and chosen.repeat == 1 and chosen.source is Source.DATA
    twice = basis_of(dataclasses.replace(chosen, repeat=2), problem.dt) if own else None
    single = problem
    problem, found, doubled = _suggested(problem, twice, around, reference)
    more = None
    of_data = double and chosen.source is Source.DATA  # modes or none: a valve that integrates has none
    if of_data and not says_something(problem, found):
        slow = _slow_poles_of(single, around, delay) if own else None
        asked = run, single, around
        ways = [functools.partial(_with_integrators, *asked)]
        if slow is not None:  # which integrators alone leave, if they are there beside these
            ways.insert(0 if slow.beside else 1, functools.partial(_with_slow_poles, *asked, slow))
        ways += [functools.partial(with_every_mode, *asked)] * bool(own)
        more = next((one for way in ways if (one := way()) is not None), None)
    if more is not None:
        run, problem, found = more
    elif doubled:
        run = run.changed("modes", repeat=2, note=f"{chosen.note}\n{DOUBLED}")
    prior, note = found.prior, PRIOR_NOTE + found.reason
    source = Source.DATA if found.complete else Source.STOPPED
    if reference and not says_something(problem, found):
        prior, what = _reference(run, problem)
        source = Source.PROGRAM if found.complete else Source.STOPPED
        note += (
            f"\nNot taken: a non-parametric part larger than every response says nothing. In its place {what}:"
            f" |G| <= {prior.gain_bound:.4g} in {prior.where}"
        )
    elif prior is None:
        size, slowest = _LARGE * response_sizes(problem)[0], problem.prior.with_rate(float(found.decay_rates[0]))
        prior = dataclasses.replace(slowest, gain_bound=size or 1.0)
        source = Source.PROGRAM if found.complete else Source.STOPPED
    else:
        prior, words = above_errors(prior, problem, run.modes)
        note += words
    problem = dataclasses.replace(problem, prior=prior)
    if run.prior.roll_off == AUTO:
        problem, words = _with_roll_off(problem, around)
        note += f"\n{words}"
    return _with_choice(run, problem.prior, source, note, curve=found.table), problem


def _with_choice(run: RunFile, prior: Prior, source: Source, note: str, curve: str | None = None) -> RunFile:
    """The run file with a prior that was chosen."""
    return dataclasses.replace(run, prior=PriorChoice.of(prior, note, run.prior, source=source, curve=curve))


def with_larger_gain(run: RunFile, result: Identification) -> tuple[RunFile, MixedProblem] | None:
    """The class with twice the gain bound, where the program chose one that all data together contradict by a little: it was
    taken from points that stand for all, and some beside them ask for more. None where the class was stated, chosen without
    experiments that contradict the others, or is far from the data.
    """
    chosen = run.prior.is_from_data and run.prior.gain_bound is not None and not run.prior.without
    if result.status is not Status.INCONSISTENT or not chosen or result.margin > SLIGHTLY:
        return None
    prior = dataclasses.replace(result.problem.prior, gain_bound=2 * float(result.problem.prior.gain_bound))
    if prior.gain_bound > _LARGEST * response_sizes(result.problem)[0]:
        return None  # larger than every response it says nothing
    note = (
        f"{run.prior.note}\nAll samples together contradict K = {result.problem.prior.gain_bound:.4g} (margin"
        f" {result.margin:.4g}); twice as large: K = {prior.gain_bound:.4g}"
    )
    found = _with_choice(run, prior, Source.DATA, note, curve=run.prior.curve)
    return found, dataclasses.replace(result.problem, prior=prior)


def _with_roll_off(problem: MixedProblem, around: Surroundings) -> tuple[MixedProblem, str]:
    """The problem with the roll-off that its responses show, where they show one; and what was found."""
    around.say("looking for a roll-off")
    if not problem.frequency:
        return problem, "No roll-off: it is taken from a frequency response, and there is none."
    prior = suggest_roll_off(problem)
    if prior is None:
        return problem, "No roll-off: none leaves a gain bound nearly as small and half of it at the highest frequency."
    corner = prior.corner / (2 * np.pi)
    words = (
        f"Roll-off: K = {prior.gain_bound:.4g} falls as frequency^-{prior.roll_off} above {hz_words(corner, 4)}, twice the"
        " smallest that fits; what lies above the data is assumed too"
    )
    return dataclasses.replace(problem, prior=prior), words


def _suggested(
    problem: MixedProblem, twice: ParametricBasis | None, around: Surroundings, reference: bool
) -> tuple[MixedProblem, PriorSuggestion, bool]:
    """The prior for a problem, with the basis `twice` where that is much better than one that says little: problem, prior, whether.

    A non-parametric part that may be larger than the typical response says little; much better is half the gain bound. Where a
    `reference` class is taken in place of one that says nothing, the search goes no further than it takes to see that.
    """
    search = functools.partial(useful_prior, kept=around.folder.gains) if reference else suggest_prior
    with around.step("looking for a prior", _PRIOR) as limit:
        found = search(problem, time_limit=limit, progress=around.told)
    something = says_something(problem, found)
    if twice is None or (something and _gain(found) <= found.safety * _typical_size(problem)):
        return problem, found, False
    wider = dataclasses.replace(problem, parametric=twice)
    try:
        with around.step("looking for a prior with each pair twice", _PRIOR) as limit:
            other = search(wider, time_limit=limit, progress=around.told)
    except InputError:  # functions that the samples can't tell apart
        return problem, found, False
    better = says_something(wider, other) and (not something or 2 * _gain(other) <= _gain(found))
    return (wider, other, True) if better and other.complete else (problem, found, False)


def _with_integrators(
    run: RunFile, problem: MixedProblem, around: Surroundings
) -> tuple[RunFile, MixedProblem, PriorSuggestion] | None:
    """The fewest integrators beside the modes with which a class says something, as of a machine that is free to move."""
    for count in missing_integrators(problem):
        modes = dataclasses.replace(run.modes, integrators=count)
        wider = dataclasses.replace(problem, parametric=basis_of(modes, problem.dt))
        try:
            with around.step("looking for a prior beside integrators", _PRIOR) as limit:
                found = useful_prior(wider, time_limit=limit, progress=around.told, kept=around.folder.gains)
        except InputError:  # functions that the samples can't tell apart
            continue
        if found.complete and says_something(wider, found):
            words = FREE.format(count=count, s="s" * (count > 1), place=problem.plane.standstill)
            return run.changed("modes", integrators=count, note=f"{run.modes.note}\n{words}"), wider, found
    return None


def _slow_poles_of(problem: MixedProblem, around: Surroundings, delay: int | None) -> RealPoles | None:
    """The slow real poles of the response; None of records alone, or where there are none."""
    frf = next((one for one in problem.frequency if isinstance(one, FrequencyResponse)), None)
    if frf is None:
        return None
    with around.step("looking for slow real poles", _PRIOR) as limit:
        return slow_poles(frf, Budget(limit), delay)


def _with_slow_poles(
    run: RunFile, problem: MixedProblem, around: Surroundings, slow: RealPoles
) -> tuple[RunFile, MixedProblem, PriorSuggestion] | None:
    """The slow real poles of the response beside the modes, where a class says something then: a drive with friction has one.

    Beside integrators too, where the response has poles of a machine that is free to move.
    """
    free = min(slow.standing, 2) if missing_integrators(problem) else 0
    for count in dict.fromkeys((free, run.modes.integrators)):
        modes = with_real_poles(run.modes, slow, count)
        try:
            wider = dataclasses.replace(problem, parametric=basis_of(modes, problem.dt))
            with around.step("looking for a prior beside slow real poles", _PRIOR) as limit:
                found = useful_prior(wider, time_limit=limit, progress=around.told, kept=around.folder.gains)
        except InputError:  # functions that the samples can't tell apart
            continue
        if found.complete and says_something(wider, found):
            return dataclasses.replace(run, modes=modes), wider, found
    return None


def _gain(found: PriorSuggestion) -> float:
    """The recommended gain bound; inf where there is none."""
    return float("inf") if found.prior is None else float(found.prior.gain_bound)


def _typical_size(problem: MixedProblem) -> float:
    """Median of the measured responses, over scaling and weight of the prior; inf where there are none."""
    sizes = np.concatenate([np.zeros(0), *(entry_sizes(problem, f) for f in problem.frequency)])
    return float(np.median(sizes)) if sizes.size else float("inf")


def _chosen_decay(problem: MixedProblem, kind: str, slack: float | None, around: Surroundings) -> tuple[Prior, str]:
    """The passive class beside the modes of a problem, and words: half the fastest decay at which the data are consistent, of those
    tried, which are none faster than the slowest pole that the response shows where the class holds all poles.
    """
    dt, slowest, few = problem.dt, _slowest_pole(problem), _few_points(problem)
    if np.isfinite(slowest):
        rates = slowest * _HALF ** np.arange(_HALVED, -1.0, -1.0)
    else:
        rates = possible_rates(problem)
        rates = np.log(rates) / dt if dt else rates  # 1/s

    def prior_of(decay: float) -> Prior:
        rate = {"decay_rate": float(f"{np.exp(decay * dt):.6g}")} if dt else {"decay": float(f"{decay:.3g}")}
        return prior_from({"passive": kind, "slack": slack, **rate})

    def margin_at(decay: float, data: MixedProblem) -> float:
        around.say(f"looking for a decay: {decay:.3g} 1/s")
        return float(identify(dataclasses.replace(data, prior=prior_of(decay)), accuracy=_ROUGH).margin)

    low, high, margin, decay = -1, rates.size, np.inf, float(rates[0])
    while high - low > 1:  # the slower the decay, the larger the class: consistent at low, not at high
        middle = (low + high) // 2
        found = margin_at(float(rates[middle]), few)
        low, high = (middle, high) if found <= 1 else (low, middle)
        if found <= 1 or high == 0:
            margin, decay = found, float(rates[middle])
    if few is not problem and margin <= 1:  # few points leave more than all of them
        fastest = decay
        for halvings in range(_HALVED):
            decay = fastest * _HALF**halvings
            if (margin := margin_at(decay, problem)) <= 1:
                break
    whole = "the plant" if problem.parametric is None else "what the modes leave to the class"
    words = f"Decay of {whole}, {kind}: {_HALF * decay:.3g} 1/s, half of {decay:.5g} 1/s, "
    if margin > 1:
        return prior_of(
            _HALF * decay
        ), f"{words}the slowest that is tried; the data contradict it (margin {margin:.4g})"
    words += (
        "the decay of the slowest pole that the response shows" if decay == slowest else "the fastest of those tried"
    )
    words += (
        f" at which the data are consistent (margin {margin:.3g}). An assumption: data can refute it, never prove it"
    )
    return prior_of(_HALF * decay), words


def _few_points(problem: MixedProblem) -> MixedProblem:
    """The problem with frequency points that stand for all, where there are many."""
    if sum(len(frf.omega) for frf in problem.frequency) <= _MANY:
        return problem
    spread = [np.linspace(0, len(f.omega) - 1, min(len(f.omega), _POINTS)).astype(int) for f in problem.frequency]
    chosen = [f.select(np.isin(np.arange(len(f.omega)), k)) for f, k in zip(problem.frequency, spread, strict=True)]
    return dataclasses.replace(problem, frequency=tuple(chosen))


def _slowest_pole(problem: MixedProblem) -> float:
    """Least decay that the response leaves to its poles, in 1/s, where no modes stand beside the class; inf where none is seen."""
    if problem.parametric is not None or not problem.frequency:
        return float("inf")
    found = suggest_kautz(problem.frequency[0])
    return float(np.min(found.omega_interval[:, 0] * found.damping_interval[:, 0], initial=np.inf))
