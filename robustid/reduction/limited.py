r"""Gramians of a part of the frequencies or of the time, or seen through a weight.

In coordinates in which the controllability Gramian is the identity A is a contraction (in continuous time dissipative), and the
part of the Gramian that a band or a horizon T holds is a matrix between 0 and I, a function of A alone:

.. math:: S + S^T,\quad S(\omega) = \tfrac1\pi\,\mathrm{Im}\ln(j\omega I - A)
   \quad\text{or}\quad \tfrac{\theta}{2\pi} I + \tfrac1\pi\,\mathrm{Im}\ln(I - e^{-j\theta}A),
   \qquad\text{and}\quad I - e^{AT}e^{A^TT}

`gawronski1990`, with the difference of S at both ends of the band. The observability Gramian is the dual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg

from robustid.core import Real, as_array, as_positive, balancing, scaled_states
from robustid.errors import InputError
from robustid.identification import check_model, describe_poles
from robustid.reduction.gramians import Factors, Parts, gramian_factors, is_stable

_EPS = np.finfo(float).eps

Share = Callable[[Real], Real]


def limited(model: Any, stable: Parts, *, band_hz: Any, horizon: Any, weight: Any) -> Factors:
    """Factors of the Gramians of the stable part of `model`, for the one of the three that isn't None."""
    if weight is not None:
        return _weighted_factors(stable, model, weight)
    share = _horizon_share(model, horizon) if band_hz is None else _band_share(model, band_hz)
    return _limited_factors(stable, share, discrete=model.dt != 0)


def _band_share(model: Any, band_hz: Any) -> Share:
    """The part between two frequencies in Hz of a Gramian that is the identity, a function of A."""
    band = as_array("band_hz", band_hz, ndim=1, finite=False)
    if band.size != 2 or not 0 <= band[0] < band[1]:
        raise InputError(
            f"`band_hz` must be (low, high) in Hz with 0 <= low < high, high = inf for no end; got {band_hz!r}"
        )
    step = _sample_time("band_hz", model)
    if step and np.isfinite(band[1]) and band[1] > 0.5 / step * (1 + 1e-9):
        raise InputError(f"`band_hz` must end at or below the Nyquist frequency, {0.5 / step:g} Hz; got {band[1]:g} Hz")
    omega = 2 * np.pi * band

    def share(a: Real) -> Real:
        low, high = (_below(a, edge, step) for edge in omega)
        return high - low + (high - low).T

    return share


def _below(a: Real, omega: float, step: float) -> Real:
    """S of the frequencies from 0 to omega."""
    eye = np.eye(a.shape[0])
    if omega == 0:
        return 0 * eye
    if np.isinf(omega) or (step and omega * step >= np.pi):
        return eye / 2
    if step:
        return (
            omega * step / (2 * np.pi) * eye + np.imag(scipy.linalg.logm(eye - np.exp(-1j * omega * step) * a)) / np.pi
        )
    return np.imag(scipy.linalg.logm(1j * omega * eye - a)) / np.pi


def _horizon_share(model: Any, horizon: Any) -> Share:
    """The part of the first seconds of a Gramian that is the identity, a function of A."""
    seconds, step = as_positive("horizon", horizon), _sample_time("horizon", model)
    samples = int(seconds / step * (1 + 1e-9)) if step else 0
    if step and not samples:
        raise InputError(f"`horizon` must hold a sample, {step:g} s, at least; got {seconds:g} s")

    def share(a: Real) -> Real:
        over = np.linalg.matrix_power(a, samples) if step else scipy.linalg.expm(a * seconds)
        return np.eye(a.shape[0]) - over @ over.T

    return share


def _sample_time(name: str, model: Any) -> float:
    if model.dt is True:
        raise InputError(f"`{name}` needs the sample time of `model` in s; its dt is True")
    return float(model.dt or 0)  # None: without states


def _limited_factors(parts: Parts, share: Share, *, discrete: bool) -> Factors:
    """Factors of both Gramians, limited: from coordinates in which the whole one is the identity, where nothing cancels."""
    balanced = balancing(*gramian_factors(parts, discrete=discrete))
    hankel = balanced.hankel
    order = int(np.sum(hankel > hankel.size * _EPS * np.max(hankel, initial=0.0)))
    left, right = balanced.coordinates(order)
    if not order:
        return left, right
    hankel = hankel[:order]
    a = left.T @ parts.a @ right
    return left @ _root(share((a / hankel).T)), right @ _root(share(a / hankel[:, None]))


def _root(share: Real) -> Real:
    """A factor of a matrix between 0 and I, without what is rounding of the I."""
    values, vectors = scipy.linalg.eigh(share)
    held = values > share.shape[0] * _EPS
    return vectors[:, held] * np.sqrt(values[held])


def _weighted_factors(parts: Parts, model: Any, weight: Any) -> Factors:
    """The observability Gramian of weight times model, in the states of the model, with its own controllability Gramian."""
    weight = check_model("weight", weight)
    outputs = model.noutputs
    if weight.ninputs not in {1, outputs} or (weight.ninputs == 1 and weight.noutputs > 1 < outputs):
        raise InputError(
            f"`weight` must be SISO, or have the {outputs} outputs of `model` as its inputs; got {weight.noutputs} x"
            f" {weight.ninputs}"
        )
    if weight.nstates and model.nstates and weight.dt != model.dt:
        raise InputError(f"`weight` must have the time base of `model`, dt = {model.dt}; got dt = {weight.dt}")
    own = Parts(*scaled_states(weight.A, weight.B, weight.C))
    poles, stable = is_stable(own.a, weight.dt)
    if not np.all(stable):
        raise InputError(f"`weight` must be stable; it has {describe_poles(poles[~stable], weight.dt)}")
    copies = np.eye(1 if weight.ninputs == outputs else outputs)
    a, b, c, d = (np.asarray(np.kron(copies, matrix), dtype=float) for matrix in (*own, weight.D))
    corner = np.zeros((parts.a.shape[0], a.shape[0]))
    both = Parts(
        np.block([[parts.a, corner], [b @ parts.c, a]]),
        np.zeros((corner.shape[0] + a.shape[0], 0)),
        np.hstack([d @ parts.c, c]),
    )
    discrete = model.dt != 0
    plain = gramian_factors(parts, discrete=discrete)
    if parts.a.size == 0:  # a static model has no time base for the weight
        return plain
    seen, _ = gramian_factors(both, discrete=discrete)
    return seen[: parts.a.shape[0]], plain[1]
