"""Slow real poles beside the modes that a response shows: those of friction, or of a plant that warms up."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.advice import RealPoles
from robustid.app.run.settings import Modes
from robustid.core import hz_words

_WORDS = (
    "{count} real pole{s} of the response ({hz}){behind}: beside the modes alone no class that says anything holds the data; beside"
    " {these} too one does."
)


def with_real_poles(modes: Modes, slow: RealPoles) -> Modes:
    """The modes with real poles beside them, taken as exact, all by rising frequency; behind the delay of these."""
    hz = (slow.omega / (2 * np.pi)).tolist()
    both = [*zip(modes.hz or (), modes.damping or (), strict=True), *((one, 1.0) for one in hz)]
    boxes = zip(modes.hz_interval or (), modes.damping_interval or (), strict=True)
    ends = [*boxes, *(((one, one), (1.0, 1.0)) for one in hz)]
    order = sorted(range(len(both)), key=lambda k: both[k])
    several = len(hz) > 1
    words = _WORDS.format(
        count=len(hz),
        s="s" * several,
        hz=", ".join(hz_words(one, 4) for one in hz),
        behind=f", behind {slow.delay} sample{'s' * (slow.delay > 1)} of delay" if slow.delay else "",
        these="these" if several else "this one",
    )
    return dataclasses.replace(
        modes,
        hz=tuple(both[k][0] for k in order),
        damping=tuple(both[k][1] for k in order),
        hz_interval=tuple(ends[k][0] for k in order) if modes.hz_interval else None,
        damping_interval=tuple(ends[k][1] for k in order) if modes.damping_interval else None,
        delay=slow.delay,
        note=f"{modes.note}\n{words}",
    )
