"""A problem from data alone, for `robustid identify` and `demo`: modes and prior are suggested where they aren't stated."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.advice import response_sizes, suggest_kautz
from robustid.app.choices import DOUBLED, basis_of, default_prior, from_records, suggested, with_roll_off
from robustid.app.options import Modes
from robustid.app.passive_class import chosen_decay, relaxations
from robustid.app.prior_options import PriorChoice, prior_keys
from robustid.app.proved import box_of_modes
from robustid.app.run_file import MODES_NOTE, PRIOR_NOTE
from robustid.bases import kautz, passive_modes
from robustid.core import Choice, Frozen, Source
from robustid.data import FrequencyResponse, TimeRecord
from robustid.identification import MixedProblem, Prior


@dataclasses.dataclass(frozen=True)
class Proposal(Frozen):
    """A problem with everything that it needs, and how each part was chosen.

    Attributes
    ----------
    problem : MixedProblem
    choices : dict of str to Choice
        Those that the program made, by their names.
    box : pair of (M, 2) arrays, or None
        What the data leave to the poles that were taken from them.
    """

    problem: MixedProblem
    choices: dict[str, Choice]
    box: Any = None


def propose(
    *,
    frequency: Sequence[FrequencyResponse] = (),
    time: Sequence[TimeRecord] = (),
    modes: Modes | None = None,
    prior: Prior | None = None,
    shape: dict[str, Any] | None = None,
    roll_off: bool = False,
    passive: str | None = None,
    slack: float | None = None,
) -> Proposal:
    """Propose a `MixedProblem`.

    Parameters
    ----------
    frequency, time : sequences of experiments
    modes : Modes, optional
        Poles of the parametric part; without, or without `hz`, those of the first frequency response.
    prior : Prior, optional
        None to take it from the curve of the smallest gain bound.
    shape : dict, optional
        `roll_off` and `corner` of a prior that is taken from there.
    roll_off : bool
        Add the roll-off that the responses show.
    passive, slack : str and float, optional
        The physical property of a class whose decay is to be chosen.

    Raises
    ------
    InputError, InputTypeError
        Data without sample time or bound, with different signals or sample times.
    """
    choices, modes = dict[str, Choice](), modes or Modes()
    placeholder = prior or default_prior((*frequency, *time), shape)
    # Refuses what lacks a sample time or a bound, before anything is computed from it.
    dt, basis = MixedProblem(frequency=frequency, time=time, prior=placeholder).dt, None
    twice = box = None
    kind = passive or (prior.passive if prior else "")
    if modes.hz is not None:
        delay = int(dt > 0) if modes.delay is None else modes.delay
        basis = basis_of(dataclasses.replace(modes, delay=delay), dt, kind)
    elif kind:
        decades = relaxations(frequency, kind, prior.decay if prior else None)
        if decades is not None:
            basis = passive_modes(decades.omega, decades.damping)
            choices["modes"] = Choice(
                {"hz": (decades.omega / (2 * np.pi)).tolist()}, Source.DATA, MODES_NOTE + decades.summary()
            )
    elif frequency:
        suggestion = suggest_kautz(frequency[0], repeat=modes.repeat, delay=modes.delay)
        basis = suggestion.basis
        hz, intervals = suggestion.omega / (2 * np.pi), suggestion.omega_interval / (2 * np.pi)
        box = box_of_modes(hz.tolist(), suggestion.damping, intervals, suggestion.damping_interval)
        if modes.repeat == 1 and suggestion.omega.size:
            twice = kautz(suggestion.omega, suggestion.damping, dt=dt, repeat=2, delay=suggestion.delay)
        choices["modes"] = Choice({"hz": hz.tolist()}, Source.DATA, MODES_NOTE + suggestion.summary())
    elif time:
        found_modes = from_records(modes, time)
        basis = basis_of(found_modes, dt)
        twice = (
            basis_of(dataclasses.replace(found_modes, repeat=2), dt) if found_modes.hz and modes.repeat == 1 else None
        )
        choices["modes"] = Choice({"hz": found_modes.hz}, Source(found_modes.source), str(found_modes.note))
    problem = MixedProblem(frequency=frequency, time=time, prior=placeholder, parametric=basis)
    if passive and prior is None:
        prior, words = chosen_decay(problem, passive, slack, PriorChoice.without_decay("--passive", "--decay"))
        choices["prior"] = Choice({"decay": prior.rate}, Source.DATA, words)
        problem = dataclasses.replace(problem, prior=prior)
    if prior is None:
        problem, found, doubled = suggested(problem, twice)
        chosen = found.prior
        if chosen is None:  # nothing fits: a class large enough to show the contradiction of the data themselves
            size = 100 * response_sizes(problem)[0]
            chosen = dataclasses.replace(placeholder.with_rate(float(found.decay_rates[0])), gain_bound=size or 1.0)
        problem = dataclasses.replace(problem, prior=chosen)
        if doubled:
            choices["repeat"] = Choice(2, Source.PROGRAM, DOUBLED)
        source = Source.PROGRAM if found.prior is None else Source.DATA
        choices["prior"] = Choice(prior_keys(chosen), source, PRIOR_NOTE + found.reason, found.table)
    if roll_off:
        problem, words = with_roll_off(problem)
        choices["roll_off"] = Choice(problem.prior.roll_off, Source.PROGRAM, words)
    return Proposal(problem, choices, box)
