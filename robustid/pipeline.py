"""The whole way: measurements to a proposal, a proof, a small model and a report."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid._arrays import Frozen
from robustid.advice import suggest_kautz, suggest_prior
from robustid.bases import kautz
from robustid.data import FrequencyResponse, TimeRecord
from robustid.interpolation import MixedProblem, Prior


@dataclasses.dataclass(frozen=True)
class Proposal(Frozen):
    """A problem with everything that it needs, and how each part was chosen.

    Attributes
    ----------
    problem : MixedProblem
    choices : tuple of str
        One paragraph per choice that the program made.
    """

    problem: MixedProblem
    choices: tuple[str, ...]


def propose(
    *,
    frequency: Sequence[FrequencyResponse] = (),
    time: Sequence[TimeRecord] = (),
    modes: Sequence[tuple[float, float]] | None = None,
    prior: Prior | None = None,
    repeat: int = 1,
    delay: int | None = None,
) -> Proposal:
    """A `MixedProblem` from data alone: modes and prior are suggested where they are not given.

    Parameters
    ----------
    frequency, time : sequences of experiments
    modes : sequence of (Hz, damping), optional
        Poles of the parametric part; empty for none; None to take them from the first frequency response.
    prior : Prior, optional
        None to take it from the curve of the smallest gain bound.
    repeat : int
        Multiplicity of each pole.
    delay : int, samples, optional
        Of the pairs; default what the data suggest, 1 where nothing does.

    Raises
    ------
    InputError, InputTypeError
        Data without sample time or bound, with several channels or different sample times.
    """
    choices = []
    placeholder = prior or Prior(gain_bound=1.0, decay_rate=1.05)
    # Refuses what lacks a sample time, a bound or a single channel, before anything is computed from it.
    step, basis = MixedProblem(frequency=frequency, time=time, prior=placeholder).dt, None
    if modes:
        hz, damping = np.array(modes, dtype=float).T
        basis = kautz(2 * np.pi * hz, damping, dt=step, repeat=repeat, delay=1 if delay is None else delay)
    elif modes is None and frequency:
        suggestion = suggest_kautz(frequency[0], repeat=repeat, delay=delay)
        basis = suggestion.basis
        choices.append("Modes taken from the frequency response:\n" + suggestion.summary())
    problem = MixedProblem(frequency=frequency, time=time, prior=placeholder, parametric=basis)
    if prior is None:
        found = suggest_prior(problem)
        choices.append("Prior taken from the curve of the smallest gain bound:\n" + found.summary())
        chosen = found.prior
        if chosen is None:  # nothing fits: a class large enough to show the contradiction of the data themselves
            size = max([np.abs(f.values).max() for f in frequency] + [np.abs(t.y).max() for t in time])
            chosen = Prior(gain_bound=100 * float(size) or 1.0, decay_rate=float(found.decay_rates[0]))
        problem = dataclasses.replace(problem, prior=chosen)
    return Proposal(problem, tuple(choices))
