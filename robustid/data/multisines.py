"""Spectral lines that a multisine excites, and phases with a small crest factor: a growing norm in place of the peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import as_array, as_count
from robustid.errors import InputError

SPACINGS = ("all", "odd", "random-odd", "log")
_GROUP = 4  # of the odd lines, one in so many is left out at random
# DFT frequencies are often typed in decimal: an edge of the band this near to a line includes it.
_SAME_LINE = 1e-6
# From p = 512 on the norm differs from the peak by less than the local minima differ from each other.
_POWERS = tuple(2**k for k in range(1, 10))
_ITERATIONS = 100
_STARTS = 5
# A grid finer than 16 samples per shortest cycle moves the peak by less than (pi/16)^2/2 = 2 %.
_SAMPLES_PER_CYCLE = 16


def chosen_lines(
    band_hz: ArrayLike | None,
    lines: ArrayLike | None,
    spacing: str,
    lines_per_decade: int,
    period: int,
    dt: float,
    seed: int,
) -> np.ndarray:
    """The lines in the band, spaced as asked, or those given."""
    if spacing not in SPACINGS:
        raise InputError(f"`spacing` must be one of {', '.join(SPACINGS)}; got {spacing!r}")
    if (band_hz is None) == (lines is None):
        raise InputError("`band_hz` and `lines` both say which spectral lines are excited; give one of them")
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
            f"`band_hz` = ({edges[0]:g}, {edges[1]:g}) holds no {'odd ' * ('odd' in spacing)}spectral line: they are multiples of"
            f" {step:g} Hz, 1/(period*dt); take a wider band or a longer `period`"
        )
    return chosen


def given_lines(lines: ArrayLike, period: int) -> np.ndarray:
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


def low_crest_phases(
    rng: np.random.Generator, amplitude: np.ndarray, lines: np.ndarray, period: int, rotations: np.ndarray
) -> np.ndarray:
    """Phases (F,) [rad, of cosines] of a multisine with a small peak at all (R,) `rotations` of its phases: a random local minimum.

    Minimises ``log (mean |u|^(2p))^(1/2p)`` over the phases for p = 2, 4, ..., 512, each from the minimum before (`guillaume1991`);
    never worse than its own start or Schroeder's phases. The `lines` lie between 0 and Nyquist, both excluded.
    """
    # The sums are FFTs, and a quasi-Newton method in place of Gauss–Newton needs no Jacobian.
    schroeder = schroeder_phases(amplitude)
    goal = _peak(schroeder, amplitude, lines, period, rotations)
    phases = schroeder
    for start in (*(random_phases(rng, lines.size) for _ in range(_STARTS)), schroeder):
        phases = _descend(start, amplitude, lines, period, rotations)
        if _peak(phases, amplitude, lines, period, rotations) <= goal:
            break
    return phases


def random_phases(rng: np.random.Generator, count: int) -> np.ndarray:
    """Independent phases, uniform on the circle."""
    return rng.uniform(0, 2 * np.pi, count)


def schroeder_phases(amplitude: np.ndarray) -> np.ndarray:
    """``phi_k = -2 pi sum_{l<k} (k - l) p_l``, p_l the share of line l in the power (`schroeder1970`, eq. 11)."""
    power = amplitude**2 / np.sum(amplitude**2)
    return -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])


def synthesise(phases: np.ndarray, amplitude: np.ndarray, lines: np.ndarray, period: int) -> np.ndarray:
    """``u(n) = sum_k A_k cos(2 pi k n/period + phi_k)``: (..., F) to (..., period)."""
    spectrum = np.zeros((*phases.shape[:-1], period // 2 + 1), complex)
    spectrum[..., lines] = 0.5 * period * amplitude * np.exp(1j * phases)
    return np.fft.irfft(spectrum, period, axis=-1)


def _peak(phases: np.ndarray, amplitude: np.ndarray, lines: np.ndarray, period: int, rotations: np.ndarray) -> float:
    return float(np.abs(synthesise(phases + rotations[:, None], amplitude, lines, period)).max())


def _descend(
    start: np.ndarray, amplitude: np.ndarray, lines: np.ndarray, period: int, rotations: np.ndarray
) -> np.ndarray:
    """The best of the start and the minima for growing p."""
    from scipy.optimize import minimize

    grid = min(period, 1 << (_SAMPLES_PER_CYCLE * int(lines[-1]) - 1).bit_length())  # a power of 2: quick FFTs
    tried = [start]
    for p in _POWERS:
        options = {"maxiter": _ITERATIONS, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-9}
        given = (amplitude, lines, grid, rotations, p)
        tried.append(minimize(log_norm, tried[-1], given, method="L-BFGS-B", jac=True, options=options).x)
    return min(tried, key=lambda phases: _peak(phases, amplitude, lines, period, rotations))


def log_norm(
    phases: np.ndarray, amplitude: np.ndarray, lines: np.ndarray, period: int, rotations: np.ndarray, p: int
) -> tuple[float, np.ndarray]:
    """``f = log (mean |u|^(2p))^(1/2p)`` over samples and rotations, and its gradient in the phases (F,)."""
    turned = phases + rotations[:, None]
    u = synthesise(turned, amplitude, lines, period)
    peak = np.abs(u).max()
    u /= peak  # no power overflows
    weight = u ** (2 * p - 1)
    total = np.sum(weight * u)
    # df/dphi_k = sum_n w(n) du(n)/dphi_k / total with du/dphi_k = Re(j A_k e^{j(2 pi k n/period + phi_k)})/peak
    moments = np.fft.rfft(weight, axis=-1)[:, lines].conj()
    gradient = np.sum(amplitude * (1j * np.exp(1j * turned) * moments).real, axis=0) / (peak * total)
    return float(np.log(peak) + np.log(total / u.size) / (2 * p)), gradient
