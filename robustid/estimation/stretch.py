"""Stretches of very long records: what is true of the whole of a record is found in one; what is of a place is sought in all."""

from __future__ import annotations

import numpy as np

from robustid.core import Real

LONG = 2**18  # samples of a stretch of one pair of signals; a record of at most so many is looked at as a whole
_PAIRS = 4  # of signals: a stretch is so many times shorter where there are as many, or more
_BESIDE = 1024  # samples on either side of a piece that are looked at with it


def stretch_length(inputs: int, outputs: int) -> int:
    """Return the samples of a stretch: fewer where each pair of many signals is looked at."""
    return LONG // min(inputs * outputs, _PAIRS)


def liveliest(u: Real, length: int = LONG) -> slice:
    """Find the stretch of a record in which inputs (T, nu) are largest; all of one that is not longer."""
    if len(u) <= length:
        return slice(0, len(u))
    power = np.cumsum(np.einsum("ij,ij->i", u, u))
    first = int(np.argmax(power[length:] - power[:-length]))
    return slice(first, first + length)


def thinned(values: Real) -> Real:
    """Return at most so many values as a stretch has, evenly spread: quantiles of them are those of all."""
    return values[:: -(-values.size // LONG)]


def pieces(samples: int, period: int | None, length: int = LONG) -> list[tuple[slice, slice]]:
    """Cut a very long record into stretches, of whole periods where it has some, and each with what is around it."""
    step = period or 1
    length, beside = max(length // step, 3) * step, -(-_BESIDE // step) * step
    starts = range(0, max(samples - length // 2, 1), length)
    ends = [*starts[1:], samples]
    return [
        (slice(first, last), slice(max(first - beside, 0), min(last + beside, samples)))
        for first, last in zip(starts, ends, strict=True)
    ]
