"""Frequency responses at the excited spectral lines of periodic experiments, and slow drifts of their sensors, removed."""

from __future__ import annotations

import logging

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from robustid.core import Real, as_array, as_count, counted
from robustid.data import Caveat, TimeRecord, stacked
from robustid.errors import InputError, Remedy
from robustid.estimation.changes import CHANGED, added_variance
from robustid.estimation.distortion import detected
from robustid.estimation.divided import factors, spread_of_inputs
from robustid.estimation.estimate import Estimate
from robustid.estimation.mean_periods import of_mean_periods
from robustid.estimation.scatter import scattered

_Spectra = dict[str, np.ndarray]  # of u, y and reference: (K, blocks, periods, signals, experiments)
_log = logging.getLogger("robustid")

# A line counts as excited from a fifth of the largest line on: measured inputs carry disturbance lines of
# 10-15 % (drives, mains), while a multisine meant for identification is flat to a factor of 2 or 3.
EXCITED = 0.2
_MAX_CONDITION = 1e6
_SIGNIFICANT = 5.0  # standard deviations
_DRIFT_SAID = 0.01  # part of the rms of an output from which on a drift is worth a word
_DRIFT_DEGREE = 3  # of the polynomial of a drift in time, at most; and below the number of periods
_DRIFT_SIGNIFICANT = 6.0  # standard deviations of white noise
_TRANSIENT_BAND = 8  # lines over which a transient is looked for: that of a lightly damped mode fills a few only


def periodic(records: list[TimeRecord], period: int | None, lines: ArrayLike | None) -> Estimate:
    """Ratios of the spectra averaged over the periods, nu experiments a block: see `estimate_frf`."""
    first = records[0]
    samples, nu = len(first.u), first.u.shape[1]
    period = samples if period is None else as_count("period", period, least=2)
    if samples % period:
        raise InputError(
            f"`record` has {samples} samples, not a whole number of periods of {period}; cut it to ",
            Remedy({"samples": (whole := samples // period * period)}, f"{whole} samples"),
            " or correct `period`",
        )
    loop = all(r.reference is not None for r in records)
    driven = _driven(_spectra(records, "reference" if loop else "u", period).mean(axis=1), period)
    if len(records) % nu or _in_turn(driven):
        return of_mean_periods(records, period, lines, driven)
    if samples // period * len(records) // nu < 2:
        raise InputError(
            f"`record` holds one period of {counted(period, 'sample')} for each of the {counted(nu, 'experiment')}: nothing"
            " to estimate the noise from; give at least two periods (`period` in samples), or further"
            " realisations"
        )
    spectra = {name: _spectra(records, name, period) for name in ("u", "y", *["reference"] * loop)}
    index = _excited(driven) if lines is None else _checked_lines(lines, period)
    skipped, steady = transient_periods(np.concatenate([spectra["u"], spectra["y"]], axis=3), index)
    drifts = steady
    if all(r.initial == "periodic" for r in records):
        # Nothing is left out of what is stated to be steady; but what a transient does is no drift.
        drifts, skipped, steady = skipped == 0, 0, True
    elif not steady:
        _log.warning(
            "the record is not in steady state even after %d periods: its bounds hold for steady data", skipped
        )
    # (K, blocks, periods, signals, experiments)
    kept = {name: _steady(records, name, period, skipped, drifts) for name in spectra}
    whole = {name: by_block(dft(signals, period), nu) for name, (signals, _) in kept.items()}
    found = _estimate(records, index, period, whole, _skipped(skipped, steady) + _drifted(*kept["y"]))
    return found if steady else found._replace(caveats=(Caveat.UNSTEADY, *found.caveats))


def _estimate(records: list[TimeRecord], index: np.ndarray, period: int, whole: _Spectra, skipped: str) -> Estimate:
    first = records[0]
    u, y, r = whole["u"][index], whole["y"][index], whole["reference"][index] if "reference" in whole else None
    blocks, periods = u.shape[1:3]
    values, inverse, base, source = _response(u, y, r, index, period, first.dt)
    left = y - values[:, None, None] @ u
    rounding = _rounding(records, values, inverse)
    scatter = scattered(left, inverse, values, u, index, rounding)
    if blocks == 1:
        drive, at_inputs, at_outputs = (whole[name][:, 0] for name in ("u" if r is None else "reference", "u", "y"))
        found = detected(drive, at_inputs, at_outputs, index, values, inverse[:, 0])
        scatter = scatter.with_distortion(found)
    changes = _of_halves(left @ inverse[:, :, None])
    wider = np.ones(index.size) if r is None else factors(spread_of_inputs(u, base), scatter.dof)[0]
    power = np.mean(np.abs(y) ** 2, axis=(2, 4)).mean(axis=1)
    rest = np.mean(np.abs(left) ** 2, axis=(2, 4)).mean(axis=1)
    rest *= blocks * periods / max(blocks * periods - 1, 1)
    return Estimate(
        index=index,
        step=2 * np.pi / (period * first.dt),
        values=values,
        covariance=(scatter.covariance + stacked(changes)[:, None, :] * np.eye(values[0].size)) * wider[:, None, None],
        dof=scatter.dof,
        coherence=np.clip(1 - rest / np.where(power > 0, power, 1), 0, 1),
        rounding=rounding,
        source=f"{source}scatter over {scatter.words}{skipped}{CHANGED if np.any(changes) else ''}",
        excitations=blocks,
        changing=scatter.changing,
        noise=scatter.noise,
        distortion=scatter.distortion,
        changed=np.sqrt(changes) if np.any(changes) else None,
        real=(2 * index) % period == 0,
        caveats=(Caveat.CHANGING,) * bool(np.any(changes)),
    )


def _of_halves(errors: np.ndarray) -> Real:
    """Variances (F, ny, nu) that the later half of the periods adds, of errors (F, B, P, ny, nu) of the response of each."""
    blocks, half = errors.shape[1], errors.shape[2] // 2
    if half < 2:
        return np.zeros((len(errors), *errors.shape[3:]))
    halves = np.stack([errors[:, :, :half], errors[:, :, -half:]])  # (2, F, B, half, ny, nu)
    means = halves.mean(axis=3)
    dof = 2.0 * blocks * (half - 1)
    noise = np.sum(np.abs(halves - means[:, :, :, None]) ** 2, axis=(0, 2, 3)) / (dof * blocks * half)
    first, last = means.mean(axis=2)
    return added_variance(last - first, noise, dof)


def _response(
    u: np.ndarray, y: np.ndarray, r: np.ndarray | None, index: np.ndarray, period: int, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Values (F, ny, nu), the inverse of the inputs of every block, (F, blocks, nu, nu), that of what moves them, and by what."""
    if r is not None and r.shape[3] == u.shape[3] and u.shape[1] > 1:
        # Indirect: responses to the reference, averaged before the division, so that noise in u biases nothing in the mean.
        by_reference = inverse_spectra(r.mean(axis=2), index, period, dt, "reference")
        to_u = (u.mean(axis=2) @ by_reference).mean(axis=1, keepdims=True)
        inverse, source = by_reference @ inverse_spectra(to_u, index, period, dt, "u"), "by the reference, "
    else:
        inverse, source = inverse_spectra(u.mean(axis=2), index, period, dt, "u"), ""
        by_reference = inverse
    return (y.mean(axis=2) @ inverse).mean(axis=1), inverse, by_reference, source


def _skipped(count: int, steady: bool) -> str:
    if not count:
        return ""
    return f"; the first {count} left out (transient)" + ("" if steady else ", still not steady")


def _steady(records: list[TimeRecord], name: str, period: int, skipped: int, drifts: bool) -> tuple[Real, Real]:
    """Signals (R, T, n) after the periods that are left out, without drift, and the range of the drift."""
    signals = np.stack([getattr(r, name) for r in records])[:, skipped * period :]
    return without_drift(signals, period) if drifts else (signals, np.zeros(signals[:, 0].shape))


def _drifted(signals: np.ndarray, drift: np.ndarray) -> str:
    """Say how far outputs (R, T, ny) drifted, relative to their rms."""
    size = drift / np.maximum(signals.std(axis=1), np.finfo(float).tiny)
    if size.max() < _DRIFT_SAID:
        return ""
    return f"; drifts of the outputs of up to {100 * size.max():.2g} % of their rms removed"


def _checked_lines(lines: ArrayLike, period: int) -> np.ndarray:
    index = as_array("lines", lines, ndim=1)
    if index.size == 0 or np.any(index != np.round(index)) or index.min() < 0 or index.max() > period // 2:
        raise InputError(f"`lines` must be whole numbers from 0 to period//2 = {period // 2}; got {lines!r}")
    if len(np.unique(index)) != index.size:
        raise InputError(f"`lines` must be all different; got {lines!r}")
    return np.sort(index).astype(int)


def _spectra(records: list[TimeRecord], name: str, period: int) -> np.ndarray:
    """(R, periods, period//2+1, n): amplitudes per period."""
    return dft(np.stack([getattr(r, name) for r in records]), period)


def dft(signals: np.ndarray, period: int) -> np.ndarray:
    """(R, T, n) real -> (R, periods, period//2+1, n): amplitudes per period."""
    cut = signals.reshape(len(signals), -1, period, signals.shape[-1])
    return np.fft.rfft(cut, axis=2) / period


def by_block(spectra: np.ndarray, nu: int) -> np.ndarray:
    """(R, P, F, n) -> (F, blocks, P, n, nu): the experiments of a block side by side."""
    split = spectra.reshape(-1, nu, *spectra.shape[1:])
    return split.transpose(3, 0, 2, 4, 1)


def _driven(spectra: np.ndarray, period: int) -> np.ndarray:
    """Lines (K, n) that signals of the excitation (R, K, n) drive."""
    amplitude = np.abs(spectra).max(axis=0)
    amplitude[0] = 0
    if period % 2 == 0:
        amplitude[-1] = 0
    largest = amplitude.max(axis=0)
    return (amplitude >= EXCITED * largest) & (largest > 0)


def _in_turn(driven: np.ndarray) -> bool:
    """Return whether every signal has lines, and no line all signals."""
    return bool(np.all(np.any(driven, axis=0)) and not np.any(np.all(driven, axis=1)))


def _excited(driven: np.ndarray) -> np.ndarray:
    index = np.flatnonzero(np.all(driven, axis=1))
    if index.size == 0:
        raise InputError(
            "`record`: no spectral line is excited in every input; check the input signals, or give `lines`"
        )
    return index


def inverse_spectra(u: np.ndarray, index: np.ndarray, period: int, dt: float, name: str = "u") -> np.ndarray:
    """U^{-1} at every line, (F, ..., nu, nu); or say which experiments are not independent where."""
    # Rows scaled to unit size first: the units of the inputs must not decide on independence.
    what = "inputs" if name == "u" else "references"
    size = np.abs(u).max(axis=(0, 1, 3), keepdims=True)
    if np.all(size > 0) and np.all(np.abs(u).max(axis=(2, 3)) > 0):
        condition = np.linalg.cond(u / size).max(axis=1)
        if condition.max() < _MAX_CONDITION:
            return np.asarray(np.linalg.inv(u / size), dtype=complex) / size.swapaxes(-1, -2)
        worst = index[np.argmax(condition)] / (period * dt)
        raise InputError(
            f"`record`: the {what} of the experiments are not independent at {worst:g} Hz (condition"
            f" {condition.max():.1g}); use other inputs, such as an orthogonal multisine, or leave the line"
            " out"
        )
    raise InputError(
        f"`record`: {'an input' if name == 'u' else 'a reference'} is zero at a spectral line that is asked for; correct `lines` or"
        " leave the input out"
    )


def _rounding(records: list[TimeRecord], values: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Rounding error of the estimate: the DFT's is relative to the largest sample, not to the line."""
    u_size, y_size = (np.max([np.abs(getattr(r, s)).max(axis=0) for r in records], axis=0) for s in ("u", "y"))
    numerator = y_size[:, None] + np.abs(values) @ u_size[:, None]
    gain = np.abs(inverse).sum(axis=2).max(axis=1)
    return 16 * np.finfo(float).eps * numerator * gain[:, None, :]


def transient_periods(spectra: np.ndarray, index: np.ndarray) -> tuple[int, bool]:
    """Number of periods at the start, at most half, that differ more than the later ones do; whether those are steady.

    ``x_k = |Y_p(k) - mean|^2/(s^2 (1 + 1/m))``, mean and variance s^2 over the m periods after p, is F(2, 2(m-1)) distributed in
    steady state; the mean of log x over all lines of (R, P, K, n), those between the used ones too, and over every few is tested.
    """
    from scipy.special import polygamma, psi

    periods = spectra.shape[1]
    if periods < 4:
        return 0, True
    band = spectra[:, :, index.min() : index.max() + 1]
    channels = band.shape[0] * band.shape[3]
    # Well above rounding: periods that are the same up to it are steady.
    floor = (64 * np.finfo(float).eps * np.abs(spectra).max(axis=(1, 2), keepdims=True)) ** 2
    last = periods // 2
    for p in range(last + 1):
        later = band[:, p + 1 :]
        m = later.shape[1]
        if m < 2:
            return p, True
        scatter = later.var(axis=1, ddof=1) * (1 + 1 / m)
        away = np.abs(band[:, p] - later.mean(axis=1)) ** 2
        # Signals that repeat up to rounding, as an ideal input does, say nothing either way.
        alive = np.maximum(scatter, away) > floor[:, 0]
        ratio = np.where(alive, away, 1) / np.where(alive, scatter + floor[:, 0], 1)
        mean, variance = psi(1) - psi(m - 1) + np.log(m - 1), polygamma(1, 1) + polygamma(1, m - 1)
        log = np.log(np.maximum(ratio, np.finfo(float).tiny)) - mean
        each = np.where(alive, log, 0).sum(axis=(0, 2))  # (K,): all records and signals
        width = min(_TRANSIENT_BAND, each.size)
        local = np.convolve(each, np.ones(width), mode="valid").max() / np.sqrt(variance * channels * width)
        whole = each.sum() / np.sqrt(variance * channels * each.size)
        if max(local, whole) <= _SIGNIFICANT:
            return p, True
    return last, False


def without_drift(signals: np.ndarray, period: int) -> tuple[Real, Real]:
    """Signals (R, T, n) of whole periods in steady state without their drift, and its range (R, n): 0 where noise hides it.

    ``y(t) = s(t mod period) + sum_j c_j t^j + e(t)``, least squares over s and c together. Exact for a polynomial of third degree,
    or of one less than there are periods.
    """
    # The powers of t, less their mean over the periods at every sample of a period, are regressed on y less its own. A drift
    # repeats in every period as a sawtooth, which no scatter between periods shows; it is removed as well.
    records, samples, count = signals.shape
    degree = min(_DRIFT_DEGREE, samples // period - 1)
    powers = legendre.legvander(np.linspace(-1, 1, samples), degree)[:, 1:]
    size = np.zeros((records, count))
    if degree < 1:
        return signals, size
    basis, mix = np.linalg.qr(_between(powers[None], period)[0])
    left = _between(signals, period)
    found = basis.T @ left  # (R, degree, n)
    spare = samples - samples // (samples // period) - degree
    noise = (np.sum(left**2, axis=1) - np.sum(found**2, axis=1)) / max(spare, 1)
    rounding = (64 * np.finfo(float).eps * np.abs(signals).max(axis=1)) ** 2
    there = found**2 > _DRIFT_SIGNIFICANT**2 * np.maximum(noise, rounding)[:, None]
    # All powers up to the highest that stands out.
    kept = np.where(np.cumsum(there[:, ::-1], axis=1)[:, ::-1] > 0, found, 0.0)
    drift = powers @ np.linalg.solve(mix, kept)
    drift -= drift.mean(axis=1, keepdims=True)
    return signals - drift, np.ptp(drift, axis=1)


def _between(signals: np.ndarray, period: int) -> Real:
    """(R, T, n) less the mean over the periods."""
    cut = signals.reshape(len(signals), -1, period, signals.shape[2])
    return (cut - cut.mean(axis=1, keepdims=True)).reshape(signals.shape)
