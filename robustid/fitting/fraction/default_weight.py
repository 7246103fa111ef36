"""The weight that a fit takes when none is given: the covariance of the data as far as it is known, else relative."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting.fraction.criterion import SINGULAR, Weight

_PRIOR = 20.0  # degrees of freedom that the mean over neighbouring frequency points counts for
_NEAR = 1.15  # neighbours lie within this factor of the frequency
_NEAR_POINTS = 3  # or within so many frequency points
_OCTAVE = 2**0.5  # the level of the response is taken over an octave, half of it on either side
# The part of the level that a model of few states misses. On measured data 0.03 let the noise decide where the model errs
# (errors on withheld points up to 1.5 times those of unit weights), 0.3 lost where noise matters.
_MISSED = 0.1
_TOWARDS_OCTAVE = 1 / 8
_KNOWN = 1000.0  # degrees of freedom from which on a covariance is taken at its word
_SHRUNK = "the covariance of the data, shrunk as it is known from {:.4g} degrees of freedom"


def default_weight(frf: FrequencyResponse, measured: NDArray[np.bool_], *, correlated: bool = True) -> Weight:
    """Weight of the residual where the user gives none: of a covariance that counts as exact its inverse root (maximum
    likelihood), of an estimated one that of ``C = S^(1/2) ((1 - a) R + a I) S^(1/2) + m^2 L``, ``S = (d V + d0 V0)/(d + d0)``;
    without one, relative. If not `correlated`, every entry is weighted by its own variance in C: one number an entry.
    """
    # V are the variances, d their degrees of freedom, V0 their mean over neighbouring frequency points, d0 = 20 (`smyth2004`);
    # R the correlations, shrunk by the intensity a = sum (1 - |r|^2)^2/d / sum |r|^2 of complex ones (`schaefer2005`), here at
    # least n/(n + d) for n entries; L the squares of the response's level, smooth over frequency, m = 0.1. With thousands of
    # degrees of freedom a and m vanish. Missing entries have errors that are independent of all others. An inverse sample
    # covariance of 2 to 10 degrees of freedom believes in its smallest eigenvalues, which are the least known; and where a
    # model of few states errs by more than the noise, weights by noise alone are spent where the noise is small rather than
    # where the response is. Both made the error on withheld points of a measured mirror twice that of unit weights.
    if not np.any(frf.values):
        raise InputError("`frf` is zero everywhere; there is nothing to fit")
    if frf.covariance is None:
        note = "relative, 1/|P| per entry: the data have no covariance"
        return dataclasses.replace(Weight.relative(np.where(measured, frf.values, 1)).scaled(measured), note=note)
    ny, nu = frf.values.shape[1:]
    if exact_covariance(frf):
        covariance, note = frf.covariance, "the covariance of the data, taken as exact"
    else:
        dof = _freedom(frf)
        covariance = _shrunk(frf, measured, dof, _missed(dof))
        missed = 100 * np.sqrt(_missed(dof))
        note = f"{_SHRUNK.format(dof)}, with {missed:.2g} % of the response's level beside it for what the model misses"
    if correlated or ny * nu == 1:
        full = Weight.from_covariance(covariance, ny, nu)
        return dataclasses.replace(full, entries=full.entries * measured, note=note)
    variances = np.einsum("kaa->ka", covariance).real.reshape(-1, nu, ny).transpose(0, 2, 1)
    return Weight(measured / np.sqrt(variances), note=f"{note}; the variances alone, as poles are shared")


def other_weights(frf: FrequencyResponse, measured: NDArray[np.bool_]) -> tuple[Weight, ...]:
    """Weights that may predict better than the default where the covariance was estimated from few degrees of freedom: every
    entry's level alone, as if the noise were nothing beside what the model misses, and the noise alone (m = 0). None where the
    covariance is known well, or missing, or where every entry has a number of its own.
    """
    if frf.covariance is None or exact_covariance(frf) or (dof := _freedom(frf)) >= _KNOWN:
        return ()
    ny, nu = frf.values.shape[1:]
    found: list[Weight] = []
    power = np.sum(np.where(measured, np.abs(frf.values) ** 2, 0.0), axis=0) / np.maximum(measured.sum(axis=0), 1)
    if np.all(power > 0):
        found.append(Weight(measured / np.sqrt(power), note="one number an entry, the inverse of its level"))
    covariance = _shrunk(frf, measured, dof, 0.0)
    if np.all(np.einsum("kaa->ka", covariance).real > 0):
        noise = Weight.from_covariance(covariance, ny, nu)
        found.append(dataclasses.replace(noise, entries=noise.entries * measured, note=_SHRUNK.format(dof)))
    return tuple(found)


def exact_covariance(frf: FrequencyResponse) -> bool:
    """Return whether the covariance counts as exact: no degrees of freedom are stated, and it can be inverted everywhere."""
    return frf.covariance is not None and frf.dof is None and not np.any(_ranks(frf) < frf.covariance.shape[1])


def _ranks(frf: FrequencyResponse) -> NDArray[np.int_]:
    """Rank of the correlations at every frequency point, (F,)."""
    covariance = frf.covariance
    variances = np.einsum("kaa->ka", covariance).real
    if np.count_nonzero(covariance) == np.count_nonzero(variances):
        return np.sum(variances > 0, axis=1)
    values = np.linalg.eigvalsh(_correlations(covariance))
    return np.sum(values > SINGULAR * np.maximum(values[:, -1:], np.finfo(float).tiny), axis=1)


def _freedom(frf: FrequencyResponse) -> float:
    """Degrees of freedom that are stated; of a singular covariance as many as its rank shows."""
    return float(max(_ranks(frf).max(), 1)) if frf.dof is None else float(frf.dof)


def _missed(dof: float) -> float:
    """Square of the part of the level that the model is taken to miss."""
    return _MISSED**2 * _KNOWN / (_KNOWN + dof)


def _shrunk(frf: FrequencyResponse, measured: NDArray[np.bool_], dof: float, missed: float) -> NDArray[np.complex128]:
    """C of `default_weight`, (F, n, n), with the square m^2 of what the model misses."""
    points, count = frf.covariance.shape[:2]
    known = measured.transpose(0, 2, 1).reshape(points, count)
    own = np.where(known, np.maximum(np.einsum("fii->fi", frf.covariance).real, 0.0), 0.0)
    variances = (dof * own + _PRIOR * _local_mean(own, known, frf.omega, _NEAR)) / (dof + _PRIOR)
    variances = np.where(known, variances, 1.0)
    identity = np.eye(count)
    R = np.where(identity > 0, 1.0, _correlations(frf.covariance))
    off = np.abs(R * (1 - identity)) ** 2
    total, spread = off.sum(axis=(1, 2)), ((1 - off) ** 2 * (1 - identity)).sum(axis=(1, 2)) / dof
    intensity = np.clip(spread / np.where(total > 0, total, np.inf), count / (count + dof), 1.0)[:, None, None]
    scale = np.sqrt(variances)
    shrunk = ((1 - intensity) * R + intensity * identity) * (scale[:, :, None] * scale[:, None, :])
    C = shrunk + (missed * np.where(known, _level(frf, known), 0.0))[:, :, None] * identity
    # An entry that is zero without any scatter, everywhere: as sure as the least sure one beside it.
    diagonal = np.einsum("fii->fi", C).real
    silent = np.where(diagonal > 0, 0.0, diagonal.max(axis=1, keepdims=True))
    return C + silent[:, :, None] * identity


def _level(frf: FrequencyResponse, known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Square of the response's level (F, n), columns stacked: that in the whole band, moved an eighth of the way (of its
    logarithm) to that in the octave, so that modes far below the highest count a little more than with unit weights. All the
    way made errors on withheld points up to 1.4 times those of unit weights.
    """
    power = np.where(known, np.abs(frf.values.transpose(0, 2, 1).reshape(known.shape)) ** 2, 0.0)
    band = power.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    octave = _local_mean(power, known, frf.omega, _OCTAVE) / np.where(band > 0, band, 1.0)
    return band * octave**_TOWARDS_OCTAVE


def _local_mean(
    values: NDArray[np.float64], known: NDArray[np.bool_], omega: NDArray[np.float64], factor: float
) -> NDArray[np.float64]:
    """Mean over the frequency points within a factor, or a few points; values where nothing is known are 0."""
    here = np.arange(omega.size)
    first = np.minimum(np.searchsorted(omega, omega / factor), np.maximum(here - _NEAR_POINTS, 0))
    last = np.maximum(
        np.searchsorted(omega, omega * factor, side="right"), np.minimum(here + _NEAR_POINTS + 1, omega.size)
    )
    out = np.empty(values.shape)
    for k in here:  # sums of cumulated sums would lose small values beside large ones
        part = slice(first[k], last[k])
        out[k] = values[part].sum(axis=0) / np.maximum(known[part].sum(axis=0), 1)
    return out


def _correlations(covariance: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Correlations (F, n, n) with a diagonal of ones, or 0 where the variance is."""
    hermitian = (covariance + covariance.conj().transpose(0, 2, 1)) / 2
    scale = np.sqrt(np.maximum(np.einsum("fii->fi", hermitian).real, 0.0))
    scale = np.where(scale > 0, scale, np.inf)
    return hermitian / scale[:, :, None] / scale[:, None, :]
