"""Which lines of the DFT a multisine excites."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import as_array, as_count
from robustid.errors import InputError

SPACINGS = ("all", "odd", "random-odd", "log")
_GROUP = 4  # of the odd lines, one in so many is left out at random
# DFT frequencies are often typed in decimal: an edge of the band this near to a line includes it.
_SAME_LINE = 1e-6


def chosen_lines(
    band_hz: Any, lines: Any, spacing: str, lines_per_decade: int, period: int, dt: float, seed: int
) -> np.ndarray:
    """The lines in the band, spaced as asked, or those given."""
    if spacing not in SPACINGS:
        raise InputError(f"`spacing` must be one of {', '.join(SPACINGS)}; got {spacing!r}")
    if (band_hz is None) == (lines is None):
        raise InputError("`band_hz` and `lines` both say which lines are excited; give one of them")
    if lines is not None:
        if spacing != "all":
            raise InputError(f"`spacing` = {spacing!r} chooses lines in a band; give `band_hz`, or leave `spacing` out")
        return given_lines(lines, period)
    edges = as_array("band_hz", band_hz, ndim=1)
    nyquist, step = 0.5 / dt, 1 / (period * dt)
    if edges.size != 2 or not 0 < edges[0] <= edges[1] < nyquist:
        raise InputError(
            f"`band_hz` must be (low, high) with 0 < low <= high < {nyquist:g} Hz, half the sampling rate; got {band_hz!r}"
        )
    first, last = (edges * period * dt + np.array([-_SAME_LINE, _SAME_LINE])).tolist()
    first, last = max(int(np.ceil(first)), 1), min(int(np.floor(last)), (period - 1) // 2)
    chosen = np.arange(first, last + 1)
    if chosen.size and spacing == "log":
        per_decade = as_count("lines_per_decade", lines_per_decade, least=1)
        steps = max(round(per_decade * np.log10(last / first)), 1)
        chosen = np.unique(np.round(np.geomspace(first, last, steps + 1)).astype(int))
    elif spacing != "all":
        chosen = chosen[chosen % 2 == 1]
    if spacing == "random-odd":
        rng = np.random.default_rng([seed, 0])
        out = np.arange(0, chosen.size - _GROUP + 1, _GROUP)
        chosen = np.delete(chosen, out + rng.integers(_GROUP, size=out.size))
    if not chosen.size:
        raise InputError(
            f"`band_hz` = ({edges[0]:g}, {edges[1]:g}) holds no {'odd ' * ('odd' in spacing)}line: they are multiples of"
            f" {step:g} Hz, 1/(period*dt); take a wider band or a longer `period`"
        )
    return chosen


def given_lines(lines: Any, period: int) -> np.ndarray:
    """Lines (F,) between 0 and Nyquist, ascending."""
    index = as_array("lines", lines, ndim=1)
    last = (period - 1) // 2
    if not index.size or np.any(index != np.round(index)) or index.min() < 1 or index.max() > last:
        raise InputError(
            f"`lines` must be whole numbers from 1 to {last}, between 0 and Nyquist for a period of {period} samples; got"
            f" {lines!r}"
        )
    if np.any(np.diff(index) <= 0):
        raise InputError(f"`lines` must ascend, each line once; got {lines!r}")
    return index.astype(int)
