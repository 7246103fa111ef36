"""The parts of a passive class that are chosen from the data: real poles over decades, and the decay of what they leave."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.advice import KautzSuggestion, possible_rates, suggest_kautz
from robustid.app.options import Modes
from robustid.app.prior_options import POSITIVE_REAL, PriorChoice
from robustid.bases import ParametricBasis, passive_modes
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem, Prior, identify, prior_from

_SPARE = 0.5  # of the fastest decay that the data allow


def passive_basis(modes: Modes, dt: float, kind: str) -> ParametricBasis:
    """The modes that are stated beside a passive class.

    Raises
    ------
    InputError
        A class that takes none.
    """
    if kind != POSITIVE_REAL or dt:
        what = "is of continuous time" if kind == POSITIVE_REAL else f'is "{POSITIVE_REAL}", of continuous time'
        raise InputError(f"modes have a place beside a passive class only where it {what}; leave them out")
    if modes.integrators:
        raise InputError("integrators have no place beside a passive class: its plants are stable; leave them out")
    return passive_modes(2 * np.pi * np.array(modes.hz), np.array(modes.damping))


def relaxations(frequency: Sequence[FrequencyResponse], kind: str, decay: float | None) -> KautzSuggestion | None:
    """Poles of a response over decades; None where there are none, or the class with its stated decay holds them all itself."""
    if kind != POSITIVE_REAL or not frequency or frequency[0].dt:
        return None
    found = suggest_kautz(frequency[0])
    slow = decay is None or bool(np.any(found.damping * found.omega < decay))
    return found if slow and np.any(found.damping == 1) else None


def chosen_decay(problem: MixedProblem, kind: str, slack: float | None) -> tuple[Prior, str]:
    """The passive class beside the modes of a problem, with half the fastest decay at which the data are consistent, and words.

    Raises
    ------
    InputError
        No modes, or no continuous time.
    """
    if kind != POSITIVE_REAL or problem.dt or problem.parametric is None:
        raise InputError(PriorChoice.without_decay("`passive`", "`decay`"))
    rates = possible_rates(problem)
    fields = {"passive": kind, "slack": slack}
    low, high, margin, tried = -1, rates.size, np.inf, float(rates[0])
    while high - low > 1:  # the slower the decay, the larger the class: consistent at low, not at high
        middle = (low + high) // 2
        prior = prior_from({**fields, "decay": float(rates[middle])})
        found = float(identify(dataclasses.replace(problem, prior=prior)).margin)
        if found <= 1:
            low = middle
        else:
            high = middle
        if found <= 1 or high == 0:
            margin, tried = found, float(rates[middle])
    decay = float(f"{_SPARE * tried:.3g}")
    words = f"Decay of what the modes leave to the {kind} class: {decay:g} 1/s, half of {tried:.5g} 1/s, "
    words += (
        f"the fastest of those tried at which the data are consistent (margin {margin:.3g}). An assumption: data can refute it,"
        " never prove it"
        if margin <= 1
        else f"the slowest that is tried; the data contradict it (margin {margin:.4g})"
    )
    return prior_from({**fields, "decay": decay}), words
