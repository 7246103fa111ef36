"""Spectral lines at which a response is estimated: those that are excited and say something, or those that are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Array, Complex, Real, as_array
from robustid.errors import InputError

_EXCITED = 0.02  # of the largest line: a sweep leaves out nothing of its band, and the bound says how much it knows
# Times what lines leak by chance: to a line from those beside it on, and to three lines from the next on.
_LEAKED = (1.25, 1.5)
_NEAR, _SMOOTH = 3, 0.02  # lines on either side, and what a polynomial leaves of them
_MOST = 5000  # lines by default
_SILENT = 3.0  # times the largest response that is known: a bound that is larger says nothing of its size
_FEW = 0.1  # of the windows with an excitation: fewer that tell a response are chance


def window_means(power: np.ndarray, half: int) -> np.ndarray:
    """Mean over the window of every line, (K, n)."""
    total = np.concatenate([np.zeros((1, power.shape[1])), np.cumsum(power, axis=0)])
    low = np.clip(np.arange(len(power)) - half, 0, None)
    high = np.clip(np.arange(len(power)) + half + 1, None, len(power))
    return (total[high] - total[low]) / (high - low)[:, None]


def excited_lines(x: np.ndarray, half: int, last: int, least: int) -> np.ndarray:
    """Spectral lines where every signal of the excitation is there, 5000 at most.

    In the window of each are at `least` so many excited lines of every signal, and of all experiments so many times the signals, as
    many as a response has coefficients there: beside the last line of a multisine one or two tell nothing of the lines that it
    leaves out.
    """
    peak = np.max(np.abs(x), axis=0)
    amplitude = np.sqrt(window_means(peak**2, half))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(peak, ((half, half), (0, 0))), 2 * half + 1, axis=0)
    amplitude[0] = 0
    amplitude[last + 1 :] = 0
    near = _present(amplitude).size
    there = around >= _EXCITED * amplitude[..., None]
    amplitude[np.sum(there, axis=2) < least] = 0
    amplitude[len(x) * np.sum(np.any(there, axis=1), axis=1) < least * x.shape[2]] = 0
    index = _present(amplitude)
    if index.size < _FEW * near:
        raise InputError(
            f"`record` is excited on single spectral lines, of which {index.size} of {near} windows of {2 * half + 1} lines hold"
            f" {least * x.shape[2]}, as many as a model of them needs: a periodic excitation needs its `period`, and as many"
            " experiments as inputs"
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


def driven_lines(x: Complex, half: int) -> NDArray[np.bool_]:
    """Lines (K,) that every signal of the excitation (R, K, n) drives, or that lie between two such lines of half a window.

    A short part of a slow sweep drives a few lines. All others have what these leak to them, as smooth over the lines as a
    transient is: what a window says of the response there is an extrapolation, and no bound of noise holds its error. A step leaks
    alike, but in the middle of a record it turns from line to line, as no transient does.
    """
    from scipy.ndimage import label

    power, smooth = np.max(np.abs(x) ** 2, axis=0), _smooth(x)
    found = np.ones(power.shape, bool)
    for n, driven in enumerate(_between(_driven(power), half).T):
        parts = label(~driven)[0]
        found[:, n] = ~np.isin(parts, np.unique(parts[~driven & smooth[:, n]]))
    return np.all(found, axis=1)


def _driven(power: Real) -> NDArray[np.bool_]:
    """Lines (K, n) of more power than others leak there, and of more, with those beside them, than lines that are farther do.

    A tone leaks 1/(pi m) of itself to the m-th line from it, where a record ends inside a period.
    """
    from scipy.signal import fftconvolve

    around, lines = _mirrored(power, len(power) - 1), len(power)
    m = np.abs(np.arange(-lines + 1, lines))
    found = np.ones(power.shape, bool)
    for beside, times in enumerate(_LEAKED):
        leaks = np.where(m > beside, 1 / (np.pi * np.maximum(m, 1)) ** 2, 0.0)[:, None]
        found &= window_means(power, beside) > times**2 * fftconvolve(around, leaks, mode="valid", axes=0)
    return found


def _between(driven: NDArray[np.bool_], half: int) -> NDArray[np.bool_]:
    """Lines (K, n) that are driven, or lie between two driven ones of one half of a window: any other is extrapolated."""
    lines = len(driven)
    there, at = _mirrored(driven, lines - 1), np.arange(3 * lines - 2)[:, None]
    below = np.maximum.accumulate(np.where(there, at, -at.size), axis=0)
    above = np.minimum.accumulate(np.where(there, at, 2 * at.size)[::-1], axis=0)[::-1]
    return (above - below <= half)[lines - 1 : 2 * lines - 1]


def _smooth(x: Complex) -> NDArray[np.bool_]:
    """Lines (K, n) around which every experiment (R, K, n) is a polynomial of second degree, as a transient is over so few."""
    around = np.stack([_mirrored(one, _NEAR) for one in (x.real, x.imag)])
    around[1, :, :_NEAR] *= -1  # negative frequencies are conjugates
    around[1, :, -_NEAR:] *= -1
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * _NEAR + 1, axis=2)
    powers = np.vander(np.arange(-_NEAR, _NEAR + 1) / _NEAR, 3)
    left = windows - windows @ (powers @ np.linalg.pinv(powers)).T
    return np.all(np.sum(left**2, axis=(0, 4)) <= _SMOOTH**2 * np.sum(windows**2, axis=(0, 4)), axis=0)


def _mirrored(values: Array, more: int) -> Array:
    """Values (..., K, n) with so many of negative frequencies, and of those beyond the last line."""
    return np.pad(values, [(0, 0)] * (values.ndim - 2) + [(more, more), (0, 0)], mode="reflect")


def silent_lines(values: Complex, radius: Real) -> NDArray[np.bool_]:
    """Lines (F,) that say nothing of any entry (F, ny, nu): their bounds are far larger than every response that is known.

    Known is a response that is larger than its bound. Where next to nothing but leakage excites a line, its bound may be 1e9 times
    that: it excludes nothing, and the largest value of such lines would pass for the size of the response.
    """
    size = np.abs(values)
    known = np.max(np.where(radius < size, size, 0.0), axis=0)
    return np.all((radius > _SILENT * known) & (known > 0), axis=(1, 2))
