"""The choices of a run: each is read from the run file, or made from the data and written there."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.advice import (
    SLIGHTLY,
    PriorSuggestion,
    entry_sizes,
    possible_rates,
    response_sizes,
    suggest_kautz,
    suggest_prior,
    suggest_roll_off,
    suggest_scaling,
)
from robustid.app.checks import AUTO
from robustid.app.measurements import Measured, Say
from robustid.app.options import Modes
from robustid.app.passive_class import chosen_decay, passive_basis, relaxations
from robustid.app.prior_options import PriorChoice
from robustid.app.record_modes import modes_of_records
from robustid.app.run_file import MODES_NOTE, PRIOR_NOTE, RECORD_MODES_NOTE, RunFile
from robustid.bases import ParametricBasis, integrators, kautz, stack_bases
from robustid.core import Source
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError, Status
from robustid.fitting import MatrixFraction, ModeRow, RecordFit, mode_table
from robustid.identification import Identification, MixedProblem, Prior, any_prior, identify

DOUBLED = (
    "Each pair is taken twice (repeat = 2, terms k a^k, which absorb small errors of the poles): with single pairs no class that"
    " says much between the samples holds the data."
)
_LARGEST = 2.0  # times the largest response: a non-parametric part that is chosen
SPARE = 1.1  # beyond the smallest inflation of the bounds


def with_modes(run: RunFile, data: Measured, say: Say) -> RunFile:
    """The poles of the parametric part, from the response where they aren't stated."""
    if run.modes.hz is not None:
        return run if run.modes.delay is not None else run.changed("modes", delay=int(bool(data.dt)))
    chosen = run.modes
    if (kind := run.prior.passive) is not None:
        found = relaxations(data.responses, kind, run.prior.decay)
        if found is None:
            note = "No parametric part: a passive class is about the whole plant."
            return run.changed("modes", hz=(), damping=(), delay=1, source=Source.PROGRAM, note=note)
        hz = tuple((found.omega / (2 * np.pi)).tolist())
        said = {"source": Source.DATA, "note": MODES_NOTE + found.summary()}
        return run.changed("modes", hz=hz, damping=tuple(found.damping.tolist()), delay=0, **said)
    if not data.responses:
        say("looking for modes in the records")
        return dataclasses.replace(run, modes=from_records(chosen, data.records))
    say("looking for modes in the frequency response")
    found = suggest_kautz(data.responses[0], modes=chosen.count, repeat=chosen.repeat, delay=chosen.delay)
    box: dict[str, Any] = {}
    if found.omega.size:
        box = {
            "hz_interval": _pairs(found.omega_interval / (2 * np.pi)),
            "damping_interval": _pairs(found.damping_interval),
        }
    modes = Modes(
        hz=tuple((found.omega / (2 * np.pi)).tolist()),
        damping=tuple(found.damping.tolist()),
        repeat=chosen.repeat,
        integrators=chosen.integrators,
        delay=found.delay,
        source=Source.DATA,
        note=MODES_NOTE + found.summary(),
        **box,
    )
    return dataclasses.replace(run, modes=modes)


def from_records(chosen: Modes, records: Sequence[TimeRecord]) -> Modes:
    """The poles of the parametric part from records alone, by a fit of them."""
    rows, words = modes_of_records(records, chosen.count)
    return dataclasses.replace(
        chosen,
        hz=tuple(row.hz for row in rows),
        damping=tuple(row.damping for row in rows),
        count=None,
        delay=1 if chosen.delay is None else chosen.delay,
        source=Source.DATA if rows else Source.PROGRAM,
        note=RECORD_MODES_NOTE + words if rows else words,
    )


def _pairs(intervals: np.ndarray) -> tuple:
    return tuple(tuple(pair) for pair in intervals.tolist())


def basis_of(modes: Modes, dt: float, passive: str | None = None) -> ParametricBasis | None:
    """The Kautz pairs and integrators that the run file states, or the modes beside a passive class; None for none."""
    if passive and (modes.hz or modes.integrators):
        return passive_basis(modes, dt, passive)
    parts = [integrators(modes.integrators, dt=dt)] if modes.integrators else []
    if modes.hz:
        omega = 2 * np.pi * np.array(modes.hz)
        parts.append(kautz(omega, np.array(modes.damping), dt=dt, repeat=modes.repeat, delay=modes.delay or 0))
    return stack_bases(parts) if parts else None


def stated_modes(modes: Any) -> dict[str, Any]:
    """Keys of the section [modes] for the argument `modes`: pairs (Hz, damping), a fit, or rows of its mode table.

    The poles at z = 1 of a fit become integrators.

    Raises
    ------
    InputError, InputTypeError
        Something else; more than two integrators.
    """
    if isinstance(modes, MatrixFraction | RecordFit):
        modes = mode_table(modes if isinstance(modes, MatrixFraction) else modes.model)
    if not isinstance(modes, Sequence) or isinstance(modes, str):
        raise InputTypeError(
            f"`modes` must be pairs (Hz, damping), a fit, or its mode table; got {type(modes).__name__}"
        )
    if not any(isinstance(row, ModeRow) for row in modes):
        pairs = [_pair(row) for row in modes]
        return {"hz": [hz for hz, _ in pairs], "damping": [damping for _, damping in pairs]}
    rows = [row for row in modes if isinstance(row, ModeRow)]
    rigid = sum(row.count for row in rows if row.rigid)
    rows = [row for row in rows if not row.rigid]
    if bad := [row for row in rows if not 0 < row.damping <= 1 or not row.hz > 0]:
        raise InputError(f"`modes`: the fit has a pole that is not damped, at {bad[0].hz:.5g} Hz; leave its row out")
    found: dict[str, Any] = {"hz": [row.hz for row in rows], "damping": [row.damping for row in rows]}
    return found | ({"integrators": rigid} if rigid else {})


def _pair(row: Any) -> tuple[float, float]:
    try:
        hz, damping = (float(number) for number in row)
    except (TypeError, ValueError):
        raise InputTypeError(f"`modes` must hold pairs (Hz, damping); got {row!r}") from None
    return hz, damping


def chosen_points(run: RunFile, frf: FrequencyResponse) -> tuple[FrequencyResponse, FrequencyResponse | None]:
    """The frequency points that are used, and those that are left to test with."""
    asked = run.frequency_points
    used = np.arange(frf.omega.size) % asked.every == 0
    if asked.near_hz is not None:
        for hz in run.modes.hz or ():
            used |= np.abs(frf.freq_hz - hz) <= asked.near_hz
    return frf.select(used), None if used.all() else frf.select(~used)


def with_inflation(run: RunFile, problem: MixedProblem, say: Say) -> RunFile:
    """The factor on all bounds: as stated, or 10 % more than a reference class needs, never below 1."""
    if run.identify.inflate != "auto":
        return run
    say("looking for the smallest factor on the bounds")
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
        return default_prior((*data.responses, *data.records), run.prior.shape(data.dt))
    return any_prior(data.dt, run.prior.scaling, **run.prior.shape(data.dt))


def default_prior(data: Sequence[Any], shape: dict[str, Any] | None = None) -> Prior:
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


def inflated(data: Any, run: RunFile) -> Any:
    """Data with all bounds multiplied by the factor of the run file, which their note says.

    What the bound is about stays, and from how many excitations it was taken: a wider bound doesn't measure how the plant varies.
    Its probability goes: it was stated of the narrower bound.
    """
    factor = run.identify.inflate
    if factor == 1:
        return data
    why = "as stated" if run.identify.inflate_source in (None, Source.STATED) else "as the program found"
    note = f"{data.note or 'bound of the data'}; times {factor:.4g}, {why}"
    return data.with_bound(dataclasses.replace(data.bound.inflated(factor), probability=None, dof=None), note)


def with_prior(run: RunFile, problem: MixedProblem, say: Say, *, double: bool = True) -> tuple[RunFile, MixedProblem]:
    """Gain bound and decay rate; where only a class of anything at all fits, a reference class that is then refuted.

    Where modes that the program chose contradict the data, each pair is taken twice, if `double` allows it.
    """
    if (stated := run.prior.stated(problem.dt)) is not None:
        problem = dataclasses.replace(problem, prior=stated)
        if run.prior.roll_off != AUTO:
            return run, problem
        problem, words = with_roll_off(problem, say)
        return _with_choice(run, problem.prior, Source.PROGRAM, words), problem
    say("looking for a prior")
    if (kind := run.prior.passive) is not None:
        prior, words = chosen_decay(problem, kind, run.prior.slack, run.prior.without_decay("[prior] passive"))
        return _with_choice(run, prior, Source.DATA, words), dataclasses.replace(problem, prior=prior)
    chosen = run.modes
    own = double and chosen.hz and chosen.repeat == 1 and chosen.source is Source.DATA
    twice = basis_of(dataclasses.replace(chosen, repeat=2), problem.dt) if own else None
    problem, found, doubled = suggested(problem, twice, say)
    if doubled:
        run = run.changed("modes", repeat=2, note=f"{chosen.note}\n{DOUBLED}")
    prior, source, note = found.prior, Source.DATA, PRIOR_NOTE + found.reason
    if prior is None or not says_something(problem, found):
        (prior, what), source = _reference(run, problem), Source.PROGRAM
        note += (
            f"\nNot taken: a non-parametric part larger than every response says nothing. In its place {what}:"
            f" |G| <= {prior.gain_bound:.4g} in {prior.where}"
        )
    problem = dataclasses.replace(problem, prior=prior)
    if run.prior.roll_off == AUTO:
        problem, words = with_roll_off(problem, say)
        note += f"\n{words}"
    return _with_choice(run, problem.prior, source, note, curve=found.table), problem


def _with_choice(run: RunFile, prior: Prior, source: Source, note: str, **said: str | None) -> RunFile:
    """The run file with a prior that was chosen."""
    return dataclasses.replace(run, prior=PriorChoice.of(prior, note, run.prior, source=source, **said))


def with_larger_gain(run: RunFile, result: Identification) -> tuple[RunFile, MixedProblem] | None:
    """The class with twice the gain bound, where the program chose one that all data together contradict by a little.

    A prior is taken from frequency points that stand for all; where some beside them ask for slightly more, the class was chosen
    too small, and nothing about the plant was found. None where the class was stated, or is far from the data.
    """
    chosen = run.prior.source is Source.DATA and run.prior.gain_bound is not None
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


def with_roll_off(problem: MixedProblem, say: Say | None = None) -> tuple[MixedProblem, str]:
    """The problem with the roll-off that its responses show, where they show one; and what was found."""
    if say is not None:
        say("looking for a roll-off")
    if not problem.frequency:
        return problem, "No roll-off: it is taken from a frequency response, and there is none."
    prior = suggest_roll_off(problem)
    if prior is None:
        return problem, "No roll-off: none leaves a gain bound nearly as small and half of it at the highest frequency."
    corner = prior.corner / (2 * np.pi)
    words = (
        f"Roll-off: K = {prior.gain_bound:.4g} falls as frequency^-{prior.roll_off} above {corner:.4g} Hz, twice the smallest that"
        " fits; what lies above the data is assumed too"
    )
    return dataclasses.replace(problem, prior=prior), words


def suggested(
    problem: MixedProblem, twice: ParametricBasis | None, say: Say | None = None
) -> tuple[MixedProblem, PriorSuggestion, bool]:
    """The prior for a problem, with the basis `twice` where that is much better than one that says little: problem, prior, whether.

    A non-parametric part that may be larger than the typical response says little; much better is half the gain bound.
    """
    progress = None if say is None else lambda done, count: say("looking for a prior", done, count)
    found = suggest_prior(problem, progress=progress)
    something = says_something(problem, found)
    if twice is None or (something and _gain(found) <= found.safety * _typical_size(problem)):
        return problem, found, False
    wider = dataclasses.replace(problem, parametric=twice)
    try:
        other = suggest_prior(wider, progress=progress)
    except InputError:  # functions that the samples can't tell apart
        return problem, found, False
    better = says_something(wider, other) and (not something or 2 * _gain(other) <= _gain(found))
    return (wider, other, True) if better else (problem, found, False)


def _gain(found: PriorSuggestion) -> float:
    """The recommended gain bound; inf where there is none."""
    return float("inf") if found.prior is None else float(found.prior.gain_bound)


def _typical_size(problem: MixedProblem) -> float:
    """Median of the measured responses, over scaling and weight of the prior; inf where there are none."""
    sizes = np.concatenate([np.zeros(0), *(entry_sizes(problem, f) for f in problem.frequency)])
    return float(np.median(sizes)) if sizes.size else float("inf")


def says_something(problem: MixedProblem, found: PriorSuggestion) -> bool:
    """Tell whether a suggested non-parametric part is not larger than every response."""
    return found.prior is not None and found.prior.gain_bound <= found.safety * response_sizes(problem)[0]
