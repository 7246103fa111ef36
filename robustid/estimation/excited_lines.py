"""Spectral lines at which a response is estimated: those that are excited and say something, or those that are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Real, as_array
from robustid.errors import InputError

_EXCITED = 0.02  # of the largest line: a sweep leaves out nothing of its band, and the bound says how much it knows
_MOST = 5000  # lines by default
_SILENT = 100.0  # times the largest response that is known: a bound that is larger says nothing
_FEW = 0.1  # of the windows with an excitation: fewer that tell a response are chance


def window_means(power: np.ndarray, half: int) -> np.ndarray:
    """Mean over the window of every line, (K, n)."""
    total = np.concatenate([np.zeros((1, power.shape[1])), np.cumsum(power, axis=0)])
    low = np.clip(np.arange(len(power)) - half, 0, None)
    high = np.clip(np.arange(len(power)) + half + 1, None, len(power))
    return (total[high] - total[low]) / (high - low)[:, None]


def excited_lines(x: np.ndarray, half: int, last: int, least: int) -> np.ndarray:
    """Spectral lines where every signal of the excitation is there, 5000 at most.

    In the window of each are at `least` so many excited lines, as many as a response has coefficients there: beside the last line
    of a multisine one or two tell nothing of the lines that it leaves out.
    """
    peak = np.max(np.abs(x), axis=0)
    amplitude = np.sqrt(window_means(peak**2, half))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(peak, ((half, half), (0, 0))), 2 * half + 1, axis=0)
    amplitude[0] = 0
    amplitude[last + 1 :] = 0
    near = _present(amplitude).size
    amplitude[np.sum(around >= _EXCITED * amplitude[..., None], axis=2) < least] = 0
    index = _present(amplitude)
    if index.size < _FEW * near:
        raise InputError(
            f"`record` is excited on single spectral lines, of which {index.size} of {near} windows of {2 * half + 1} lines hold"
            f" {least}, as many as a model of them needs: a periodic excitation has its `period`, which is to be given"
        )
    if index.size == 0:
        raise InputError(
            "`record`: no spectral line is excited in every input; check the input signals, or give `lines`"
        )
    return index[:: -(-index.size // _MOST)]


def _present(amplitude: np.ndarray) -> NDArray[np.intp]:
    """Lines around which every signal is there."""
    largest = amplitude.max(axis=0)
    return np.flatnonzero(np.all(amplitude >= _EXCITED * largest, axis=1) & np.all(largest > 0))


def checked_lines(lines: ArrayLike, last: int) -> np.ndarray:
    """Lines given by the user, ascending."""
    index = as_array("lines", lines, ndim=1)
    if index.size == 0 or np.any(index != np.round(index)) or index.min() < 1 or index.max() > last:
        raise InputError(f"`lines` must be whole numbers from 1 to {last}; got {lines!r}")
    return np.unique(index).astype(int)


def silent_lines(values: Complex, radius: Real) -> NDArray[np.bool_]:
    """Lines (F,) that say nothing of any entry (F, ny, nu): their bounds are far larger than every response that is known.

    Known is a response that is larger than its bound. Where next to nothing but leakage excites a line, its bound may be 1e9 times
    that: it excludes nothing, and the largest value of such lines would pass for the size of the response.
    """
    size = np.abs(values)
    known = np.max(np.where(radius < size, size, 0.0), axis=0)
    return np.all((radius > _SILENT * known) & (known > 0), axis=(1, 2))
