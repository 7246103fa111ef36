"""Halves of the measurement that answer in two ways beyond chance: what they differ by is part of the error of the mean.

Noise is not all that keeps a mean response from that of the plant: it warms up, changes half-way, or another one was measured. The
scatter of periods, or around a local model, holds that in part at most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real

CHANGED = "; halves of the measurement differ beyond chance, and the bound holds that"
_CHANCE = 1e-3  # of any block of lines, in any entry
_AROUND = 2  # lines on either side over which the squared difference is taken together


def added_variance(
    difference: np.ndarray, noise: Real, dof: float, *, chance: float = _CHANCE, shared: float = 1.0
) -> Real:
    """Variance of the mean of two halves that their difference D (F, ...) makes necessary, beyond the noise: 0 where there is none.

    Without a difference D has the variance s^2, twice the `noise` of a half, estimated, and ``dof log(1 + |D|^2/(dof s^2))`` is
    exponentially distributed: its sum over a block of lines has a gamma distribution (`pintelon2012`, section 2.6). Blocks are all
    lines, halves of them, quarters, and so on; so many lines as are `shared` say the same, where windows overlap, at most 1 where
    they do not. In a block beyond chance the halves scatter about their mean with |D|^2/4.
    """
    beyond, square = beyond_chance(difference, noise, dof, chance, shared), np.abs(difference) ** 2
    around = np.arange(len(square))[:, None] + np.arange(-_AROUND, _AROUND + 1)
    mean = square[np.clip(around, 0, len(square) - 1)].mean(axis=1)
    return np.where(beyond, np.maximum(square, mean) / 4, 0.0)


def beyond_chance(difference: np.ndarray, noise: Real, dof: float, chance: float, shared: float) -> NDArray[np.bool_]:
    """Places of a difference (F, ...) that its noise does not explain: see `added_variance`."""
    from scipy.special import gammaincc

    lines, square = len(difference), np.abs(difference) ** 2
    known = noise > 0
    seen = np.where(known, dof * np.log1p(square / (2 * dof * np.where(known, noise, 1))), 0.0)
    levels = int(np.log2(max(lines, 1))) + 1
    limit = chance / (2**levels * max(seen[0].size, 1))
    beyond = np.zeros(seen.shape, dtype=bool)
    for level in range(levels):
        for block in np.array_split(np.arange(lines), 2**level):
            count = max(block.size / max(shared, 1.0), 1.0)  # of lines that say something of their own, each no more
            beyond[block] |= gammaincc(count, count * seen[block].mean(axis=0)) < limit
    return beyond & known
