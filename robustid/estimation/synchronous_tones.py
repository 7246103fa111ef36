"""Tones that repeat with the excitation: at lines that nothing drives, and at excited lines whose response stands out."""

from __future__ import annotations

import math

import numpy as np

from robustid.core import Complex, Real
from robustid.data import Fault
from robustid.estimation.periodic import EXCITED
from robustid.estimation.tone_faults import tone_fault

_FALSE_ALARM = 1e-4
_FREE = 0.02  # of the largest line of an input: nothing but noise drives the line, and no resonance shows there
_ALONE = 100.0  # times the power of its neighbours: a line that something drives, and no resonance of some width
_GAP = 4  # lines between two that nothing drives, at most
_USUAL = 5.0  # times the lines around, at most
_AROUND = 20  # lines on either side
_FEWEST = 12  # lines
_CERTAIN = 8.0  # standard deviations of the noise
_PATTERN = np.array([1 / 6, -2 / 3, 1.0, -2 / 3, 1 / 6])  # one line that is off, in what interpolation leaves
_EXPLAINED = 0.95  # of what interpolation leaves around the line
_STANDS_OUT = 8.0  # times the median of what it leaves
_WIDTH = 0.1  # lines: a resonance is wider
_REMEDY = "leave these frequencies out, or change the period so that they fall between the lines"


def synchronous_tones(u: Real, y: Real, period: int, dt: float, outputs: list[str]) -> list[Fault]:
    """Tones of whole periods of records (R, T, n) in steady state."""
    if period < 2 * _FEWEST:
        return []
    cut = [x.reshape(len(x), -1, period, x.shape[2]) for x in (u, y)]
    each_u, each_y = (np.fft.rfft(x, axis=2)[:, :, 1 : (period + 1) // 2] / period for x in cut)
    periods = each_y.shape[1]
    noise, inputs = (x.var(axis=1, ddof=1) / periods for x in (each_y, each_u))  # (R, K, n), of the means
    U, Y = each_u.mean(axis=1), each_y.mean(axis=1)
    size = np.abs(U).max(axis=0)
    largest = size.max(axis=0)
    if np.any(largest == 0):
        return []
    excited = np.all(size >= EXCITED * largest, axis=1)
    free = np.all(
        (size < EXCITED * largest) & (size <= _USUAL * np.maximum(_smooth_each(size), 1e-9 * largest)), axis=1
    )
    if excited.sum() < _FEWEST:
        return []
    found: list[Fault] = []
    for i, where in enumerate(outputs):
        level = _smooth(noise[:, :, i].mean(axis=0)) + _through(U, Y[:, :, i], inputs, excited)
        off = _at_free_lines(
            np.mean(np.abs(Y[:, :, i]) ** 2, axis=0), level, free, np.any(size >= _FREE * largest, axis=1)
        )
        off |= _at_excited_lines(U, Y[:, :, i], level, excited)
        if off:
            order = sorted(off, key=lambda k: -off[k])
            rms = float(y[:, :, i].std())
            hz = [(k + 1) / (period * dt) for k in order]
            how = "the same in all periods"
            fault = tone_fault(hz, 2 * off[order[0]], rms, where, how, _REMEDY)
            found += [] if fault is None else [fault]
    return found


def _through(U: Complex, y: Complex, inputs: Real, excited: np.ndarray) -> Real:
    """Noise of measured inputs in the output, (K,), by the response at every excited line."""
    found = np.zeros(U.shape[1])
    if len(U) >= U.shape[2]:
        values = np.linalg.pinv(U[:, excited].transpose(1, 0, 2)) @ y[:, excited].T[:, :, None]
        found[excited] = np.sum(np.abs(values[:, :, 0]) ** 2 * inputs[:, excited].mean(axis=0), axis=1)
    return found


def _smooth(power: Real) -> Real:
    """Median of neighbouring lines, as a mean of exponential values."""
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(power, min(2 * _AROUND + 1, power.size), mode="reflect"), dtype=float)


def _smooth_each(size: Real) -> Real:
    return np.stack([_smooth(one) for one in size.T], axis=1)


def _at_free_lines(power: Real, noise: Real, free: np.ndarray, driven: np.ndarray) -> dict[int, float]:
    """Amplitudes at lines that nothing drives and that stand out of the other such lines around, and of the noise."""
    lines = np.flatnonzero(free)
    found: dict[int, float] = {}
    for part in np.split(lines, np.flatnonzero(np.diff(lines) > _GAP) + 1):
        if part.size < _AROUND:
            continue
        level = np.maximum(_smooth(power[part]) / math.log(2), noise[part])
        limit = 3 * math.log(lines.size / _FALSE_ALARM)
        contrast = power[part] / np.maximum(level, np.finfo(float).tiny)
        for k in part[contrast > limit]:
            beside = np.delete(power[max(k - 2, 0) : k + 3], min(k, 2))
            if not driven[k] or power[k] > _ALONE * beside.max():
                found[int(k)] = math.sqrt(power[k])
    return found


def _at_excited_lines(U: Complex, y: Complex, noise: Real, excited: np.ndarray) -> dict[int, float]:
    """Amplitudes at excited lines where records contradict each other, or where one line's response is off the others'."""
    records, nu = len(U), U.shape[2]
    lines = np.flatnonzero(excited)
    if records > nu:
        found = _inconsistent(U[:, lines], y[:, lines], noise[lines], lines)
    elif records == nu:
        found = _standing_out(U[:, lines], y[:, lines], noise[lines], lines)
    else:
        found = {}
    return found


def _inconsistent(U: Complex, y: Complex, noise: Real, lines: np.ndarray) -> dict[int, float]:
    """Lines where records contradict each other that agree at the lines around."""
    stacked, answer = U.transpose(1, 0, 2), y.T[:, :, None]  # (K, R, nu), (K, R, 1)
    values = np.linalg.pinv(stacked) @ answer
    spare = U.shape[0] - U.shape[2]
    left = np.sum(np.abs(answer - stacked @ values) ** 2, axis=(1, 2)) / spare
    level = np.maximum(_smooth(left), noise)
    limit = 4 * _CERTAIN + 2 * math.log(lines.size / _FALSE_ALARM)
    contrast = left / np.maximum(level, np.finfo(float).tiny)
    own = contrast > limit
    own[1:] &= left[1:] > 4 * left[:-1]
    own[:-1] &= left[:-1] > 4 * left[1:]
    return {int(k): math.sqrt(size) for k, size in zip(lines[own], left[own], strict=True)}


def _standing_out(U: Complex, y: Complex, noise: Real, lines: np.ndarray) -> dict[int, float]:
    """Lines whose response is off the curve through its neighbours, which no resonance of some width explains."""
    stacked = U.transpose(1, 0, 2)
    drive = np.sqrt(np.mean(np.abs(stacked) ** 2, axis=(1, 2)))
    if np.any(np.linalg.cond(stacked) > 1e6):
        return {}
    inverse = np.linalg.inv(stacked)
    values = (inverse @ y.T[:, :, None])[:, :, 0]  # (K, nu)
    error = noise * np.sum(np.abs(inverse) ** 2, axis=(1, 2))
    step = int(np.min(np.diff(lines)))
    found: dict[int, float] = {}
    for part in np.split(np.arange(lines.size), np.flatnonzero(np.diff(lines) != step) + 1):
        if part.size < _FEWEST:
            continue
        own = values[part]
        d = np.zeros_like(own)
        d[2:-2] = own[2:-2] - (4 * (own[1:-3] + own[3:-1]) - own[:-4] - own[4:]) / 6
        size = np.sum(np.abs(d) ** 2, axis=1)
        usual = _smooth(size)
        for at in range(4, part.size - 4):
            near = d[at - 2 : at + 3]
            height = _PATTERN @ near / (_PATTERN @ _PATTERN)
            power = float(np.sum(np.abs(height) ** 2))
            whole = float(np.sum(np.abs(d[at - 3 : at + 4]) ** 2))
            if power < _CERTAIN**2 * error[part[at - 2 : at + 3]].max() or power < _STANDS_OUT**2 * usual[at]:
                continue
            if power * float(_PATTERN @ _PATTERN) > _EXPLAINED * whole and not _resonates(own[at - 4 : at + 5]):
                found[int(lines[part[at]])] = math.sqrt(power) * float(drive[part[at]])
    return found


def _resonates(values: Complex) -> bool:
    """Return whether one pole of some width explains nine lines of responses (9, n): ``G (1 - a x) = c0 + c1 x + c2 x^2``."""
    x = np.arange(-4.0, 5.0)
    blocks = np.stack([np.ones(9), x, x**2], axis=1)
    n = values.shape[1]
    system = np.concatenate([np.kron(np.eye(n), blocks), (values * x[:, None]).T.reshape(-1, 1)], axis=1)
    answer = values.T.ravel()
    found = np.linalg.lstsq(system, answer, rcond=None)[0]
    left = float(np.sum(np.abs(answer - system @ found) ** 2))
    near = float(np.sum(np.abs(values - values.mean(axis=0)) ** 2))
    pole = 1 / found[-1] if found[-1] != 0 else math.inf
    return left < 0.01 * near and abs(np.imag(pole)) > _WIDTH
