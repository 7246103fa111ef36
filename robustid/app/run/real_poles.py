"""Slow real poles beside the modes that a response shows: those of friction, or of a plant that warms up."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.advice import HEAVY, SAFETY, RealPoles, response_sizes, typical_bound
from robustid.app.run.settings import Modes
from robustid.core import Source, counted, hz_words
from robustid.identification import MixedProblem, Prior

_Ends = tuple[float, float]
_WORDS = (
    "{poles} of the response ({hz}){behind}: beside the modes alone no class that says anything holds the data; beside"
    " {these}{free} too one does."
)


def with_real_poles(modes: Modes, slow: RealPoles, integrators: int) -> Modes:
    """The modes with real poles and integrators beside them, taken as exact, all by rising frequency; behind the delay of these."""
    hz, damping = (slow.omega / (2 * np.pi)).tolist(), slow.damping.tolist()
    boxes = list(zip(modes.hz_interval or (), modes.damping_interval or (), strict=True))
    both = [*_beside(modes, boxes, slow), *zip(hz, damping, strict=True)]
    ends = [*boxes, *(((one, one), (zeta, zeta)) for one, zeta in zip(hz, damping, strict=True))]
    order = sorted(range(len(both)), key=lambda k: both[k])
    several = len(hz) > 1
    words = _WORDS.format(
        poles=slow.words,
        hz=", ".join(hz_words(one, 4) for one in hz),
        behind=f", behind {slow.delay} sample{'s' * (slow.delay > 1)} of delay" if slow.delay else "",
        these="these" if several else "this one",
        free=f" and {counted(integrators, 'integrator')}" if integrators else "",
    )
    return dataclasses.replace(
        modes,
        hz=tuple(both[k][0] for k in order),
        damping=tuple(both[k][1] for k in order),
        hz_interval=tuple(ends[k][0] for k in order) if modes.hz_interval else None,
        damping_interval=tuple(ends[k][1] for k in order) if modes.damping_interval else None,
        delay=slow.delay,
        integrators=integrators,
        note=f"{modes.note}\n{words}",
    )


def _beside(modes: Modes, boxes: Sequence[tuple[_Ends, _Ends]], slow: RealPoles) -> list[tuple[float, float]]:
    """Frequency and damping of every mode: of the pair in its box that with the slow poles keeps all bounds, if there is one."""
    found = list(zip(modes.hz or (), modes.damping or (), strict=True))
    if slow.largest > 1:
        return found
    left = [(omega / (2 * np.pi), damping) for omega, damping in slow.light]
    for k, (frequency, ratio) in enumerate(boxes):
        inside = (one for one in left if frequency[0] <= one[0] <= frequency[1] and ratio[0] <= one[1] <= ratio[1])
        if (pair := next(inside, None)) is not None:
            left.remove(pair)
            found[k] = pair
    return found


def above_errors(prior: Prior, problem: MixedProblem, modes: Modes) -> tuple[Prior, str]:
    """The prior of a process, with a gain bound of twice the typical bound at least, and a sentence on it; else as it is.

    Its poles come from the data and are taken as exact: what they miss is left to the non-parametric part, and where it is smaller
    than most bounds the data do not tell how large it is. A class that says nothing then stays as it was.
    """
    known = modes.source is not Source.DATA or not modes.damping or min(modes.damping) < HEAVY
    least = 0.0 if known else float(f"{SAFETY * typical_bound(problem):.4g}")
    if not prior.gain_bound < least <= SAFETY * response_sizes(problem)[0]:
        return prior, ""
    words = (
        f"\nK = {least:.4g}, twice the median bound: the real poles are taken as exact, and a non-parametric part smaller than most"
        " bounds can't be told from none"
    )
    return dataclasses.replace(prior, gain_bound=least), words
