"""Parts of a signal that lie inside a band of frequencies, whatever there is outside: concentrated sequences."""

from __future__ import annotations

import functools

import numpy as np

from robustid.core import Real

_CONCENTRATED, _WELL, _MANY = (
    1 - 1e-4,
    1 - 1e-8,
    40,
)  # part of the power of a sequence inside the band; of one among many
_MOST = 256  # sequences


@functools.lru_cache(maxsize=16)
def band_sequences(samples: int, low: float, high: float) -> Real:
    """Orthonormal sequences (samples, n) with their power inside `low` to `high`, in cycles a sample (`slepian1978`).

    Their products with a signal don't see what lies outside the band, though the signal is short. Of a band that begins at 0
    all of them, else the products of those of half the width with the cosine and the sine of its middle.
    """
    from scipy.signal.windows import dpss

    if low * samples < 1:
        low = 0.0
    half = high if low == 0 else (high - low) / 2
    count = min(int(2 * half * samples) + 1, samples, _MOST)
    width = half * samples
    if half >= 0.5:
        return np.eye(samples)
    if width <= 0 or count < 1:
        return np.zeros((samples, 0))
    found, ratios = dpss(samples, min(width, (samples - 1) / 2), count, return_ratios=True)
    chosen: Real = np.asarray(found[ratios > (_WELL if count > _MANY else _CONCENTRATED)].T, float)
    if low == 0 or chosen.shape[1] == 0:
        return chosen
    turn = np.pi * (low + high) * np.arange(samples)[:, None]
    return np.linalg.qr(np.hstack([chosen * np.cos(turn), chosen * np.sin(turn)]))[0]
