"""Stretches of very long records: what is true of the whole of a record is found in one; what is of a place is sought in all."""

from __future__ import annotations

import numpy as np

from robustid.core import Real

LONG = 2**18  # samples of a stretch; a record of at most so many is looked at as a whole
_BESIDE = 1024  # samples on either side of a piece that are looked at with it


def liveliest(u: Real, parts: int = 1) -> slice:
    """Find the stretch of a record, or a part of one, in which inputs (T, nu) are largest; all of one that is not very long."""
    if len(u) <= LONG:
        return slice(0, len(u))
    length = LONG // parts
    power = np.cumsum(np.einsum("ij,ij->i", u, u))
    first = int(np.argmax(power[length:] - power[:-length]))
    return slice(first, first + length)


def thinned(values: Real) -> Real:
    """Return at most so many values as a stretch has, evenly spread: quantiles of them are those of all."""
    return values[:: -(-values.size // LONG)]


def pieces(samples: int, period: int | None) -> list[tuple[slice, slice]]:
    """Cut a very long record into stretches, of whole periods where it has some, and each with what is around it."""
    step = period or 1
    length, beside = max(LONG // step, 3) * step, -(-_BESIDE // step) * step
    starts = range(0, max(samples - length // 2, 1), length)
    ends = [*starts[1:], samples]
    return [
        (slice(first, last), slice(max(first - beside, 0), min(last + beside, samples)))
        for first, last in zip(starts, ends, strict=True)
    ]
