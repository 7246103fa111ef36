"""Variances that are shared by neighbouring spectral lines: over how many lines, how smooth, and what their number is worth.

A variance from few residuals makes a bound many times as wide as a known one. Neighbouring lines have almost the same variance,
in absolute terms (noise behind the dynamics), relative to the response (distortion in front of them), or relative to its square
(a resonance that moves): which of these, the lines around each one say.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robustid.core import Real

_ENOUGH = 10  # degrees of freedom from which on a line stands for itself
_WANTED = 60  # degrees of freedom that are pooled where it doesn't
_MOST = 21  # lines of a pool: a mode of 1 % damping is that wide where lines are 0.1 % of the frequency apart
_NEAR = 0.1  # neighbours lie within this part of the frequency, or
_NEAR_LINES = 16  # within so many lines of the transform
_FREE = (0.25, 1.0)  # 1/variance of b about 2 and of c about 0, known beforehand: see _Smooth
_ROUNDS, _LARGEST = 12, 20.0  # of Fisher's scoring, and of a residual in it
_TOGETHER = 5  # neighbouring pairs of lines over which the phase of a correlation is taken as constant
_DISTORTED = 4.0  # standard deviations by which a variance must exceed noise
_GROUPS = 16  # of lines, in each of which distortion is looked for
_NONE = 1e-9  # degrees of freedom of what nothing is known of
_UNLIKE = 0.01  # probability with which any line of equal variance is taken for one of its own


class Pool(NamedTuple):
    """Variance of every line and signal, from the lines around it."""

    matrix: np.ndarray  # (F, q, q)
    dof: Real  # (F,)
    lines: int  # most lines that were pooled; 1: none
    together: float = 1.0  # lines that vary as one, in the mean


class Neighbours(NamedTuple):
    """The lines around every line."""

    index: np.ndarray  # type: ignore[assignment] # (F, n)
    near: np.ndarray  # (F, n) bool: near enough to count

    @property
    def others(self) -> Neighbours:
        """The lines around every one but itself, unless it is alone."""
        other = self.near & (self.index != np.arange(len(self.index))[:, None])
        return self._replace(near=np.where(other.any(axis=1, keepdims=True), other, self.near))

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over the near neighbours of values (F, ...)."""
        share = self.near / self.near.sum(axis=1, keepdims=True)
        return np.einsum("fn,fn...->f...", share, values[self.index])


def neighbours(index: np.ndarray, count: int) -> Neighbours:
    """The `count` lines around every spectral line, as far as they are near it in frequency."""
    lines = index.size
    count = min(count, lines)
    around = np.clip(np.arange(lines) - count // 2, 0, lines - count)[:, None] + np.arange(count)
    away = np.abs(index[around] - index[:, None])
    return Neighbours(around, away <= np.maximum(_NEAR * index[:, None], _NEAR_LINES))


def pool(matrix: np.ndarray, dof: float, size: np.ndarray, index: np.ndarray, residuals: np.ndarray | None) -> Pool:
    """Variances of q signals shared by neighbouring spectral lines where few residuals (`dof`) would leave them hardly known.

    From the lines around each one, itself left out, the logarithm of its variance is predicted as linear in that of the response,
    `size` (F, q), and in the frequency (`_Smooth`). The variance is the mean of its own and the predicted one, by their degrees of
    freedom; those of the prediction are what the fit leaves, and what lines scatter about theirs beyond chance (`smyth2004`).
    """
    # Lines that vary together, as the residuals (F, c, q) show, are worth fewer: n of them n/(1 + 2 sum_l (1 - l/n) r_l^2), r_l the
    # correlation of lines l apart.
    own = np.maximum(np.einsum("fii->fi", matrix).real, 0)
    count = min(index.size, _MOST, math.ceil(_WANTED / dof)) if dof < _ENOUGH else 1
    around = neighbours(index, count)
    used = around.near.sum(axis=1)
    if used.max() == 1:
        return Pool(matrix, np.full(index.size, float(dof)), 1)
    fit = _Smooth(own, size, index, around.others, dof)
    predicted, known = fit.variance, np.where(used[:, None] > 1, fit.degrees(own), 0.0)
    known = np.where(_unlike(own, predicted, dof, known), 0.0, known)
    variance = (dof * own + known * predicted) / (dof + known)
    worth = np.ones(index.size) if residuals is None else _together(residuals, variance, dof, count)
    together = np.minimum(worth, used)
    degrees = np.maximum((dof + known).mean(axis=1) / together, dof)
    return Pool(_shaped(matrix, variance, around), degrees, int(used.max()), float(together.mean()))


class _Smooth:
    """Variance as a smooth function of size and frequency around every line, by the likelihood of a chi-square.

    ``log variance = a + b log size + c (k - k0)``, with b = 2 (relative to the response) and c = 0 unless the lines near by say
    otherwise: b = 0 is noise of one size, b = 4 a resonance that moves.
    """

    def __init__(self, own: Real, size: Real, index: np.ndarray, around: Neighbours, dof: float) -> None:
        # Parts of the largest: nothing depends on units, not even by rounding.
        top, scale = (np.max(values, axis=0, initial=0) for values in (own, size))
        self.top = np.where(top > 0, top, 1)
        least = np.finfo(float).eps ** 2
        own_ = np.maximum(own / self.top, least)
        log = np.log(np.maximum(size / np.where(scale > 0, scale, 1), least))
        away = index[around.index] - index[:, None]
        reach = np.maximum(np.abs(np.where(around.near, away, 0)).max(axis=1), 1)
        shape = (*around.index.shape, own.shape[1])
        self.x = np.stack(
            [
                np.ones(shape),
                log[around.index] - log[:, None],
                np.broadcast_to((away / reach[:, None])[..., None], shape),
            ],
            axis=-1,
        )
        self.weight, self.dof = around.near * float(dof), dof
        self.gram = np.einsum("fn,fnqa,fnqb->fqab", self.weight, self.x, self.x)
        self.log = self._fitted(own_[around.index])

    def _fitted(self, own: Real) -> Real:
        """Coefficients (F, q, 3): Fisher's scoring from a constant level relative to the response."""
        middle, penalty = np.array([0.0, 2.0, 0.0]), np.diag([0.0, *_FREE])
        share = self.weight / self.weight.sum(axis=1, keepdims=True)
        found: Real = np.broadcast_to(middle, (*self.gram.shape[:2], 3)).copy()
        found[..., 0] = np.log(np.einsum("fn,fnq->fq", share, own * np.exp(-self.x @ middle)))
        for _ in range(_ROUNDS):
            expected = np.einsum("fnqa,fqa->fnq", self.x, found)
            ratio = np.minimum(own * np.exp(-expected), _LARGEST) - 1
            score = np.einsum("fn,fnqa,fnq->fqa", self.weight, self.x, ratio) - (found - middle) @ penalty
            found += np.asarray(np.linalg.solve(self.gram + penalty, score[..., None]), dtype=float)[..., 0]
        return found

    @property
    def variance(self) -> Real:
        """At every line, (F, q)."""
        return np.exp(self.log[..., 0]) * self.top

    def degrees(self, own: Real) -> Real:
        """Degrees of freedom of the predicted variance of every line, (F, q), itself left out, from how lines scatter about theirs.

        With v the variance of the fitted logarithm, t that of the lines about a smooth one, and psi' the trigamma function, the
        square of ``log(own/predicted)`` is ``psi'(dof) + v + t (1 + dof v)`` in the mean; ``psi'(degrees) = v + t (1 + dof v)``.
        """
        from scipy.special import polygamma, psi

        fitted = np.asarray(np.linalg.inv(self.gram + np.diag([_NONE, *_FREE])), dtype=float)[..., 0, 0]
        least = np.finfo(float).eps ** 2
        away = np.log(np.maximum(own / self.top, least)) - self.log[..., 0] - psi(self.dof) + np.log(self.dof)
        share = 1 + self.dof * fitted
        beyond: Real = (away**2 - polygamma(1, self.dof) - fitted) / share
        rough = max(float(beyond.mean()), 0.0)
        spread = fitted + rough * share
        # psi'(n) = 1/n + 1/(2 n^2) to a tenth for n above .7, and below that less is claimed.
        return (1 + np.sqrt(1 + 2 * spread)) / (2 * spread)


def _together(residuals: np.ndarray, variance: Real, dof: float, count: int) -> Real:
    """Number of lines of a pool that are worth one, (F,): 1 where they vary independently."""
    white = residuals / np.sqrt(np.where(variance > 0, variance, 1))[:, None]
    power = np.sum(np.abs(white) ** 2, axis=1)  # (F, q)
    least, wide = _TOGETHER * dof, 2 * count + 1
    total = np.zeros(len(power))
    for lag in range(1, min(count, len(power) - _TOGETHER)):
        product = np.sum(white[lag:] * white[:-lag].conj(), axis=1)
        both = _running(power[lag:], _TOGETHER) * _running(power[:-lag], _TOGETHER)
        seen = np.abs(_running(product, _TOGETHER)) ** 2 / np.where(both > 0, both, 1)
        squared = ((np.where(both > 0, seen, 0) - 1 / least) / (1 - 1 / least)).mean(axis=1)
        found = np.zeros(len(power))
        found[: squared.size] = squared
        there = (np.arange(len(power)) < squared.size).astype(float)
        smooth = _running(found, wide) / np.maximum(_running(there, wide), 1)
        total += (1 - lag / count) * np.clip(smooth, -1, 1)
    return 1 + 2 * np.maximum(total, 0)


def _running(values: np.ndarray, width: int) -> np.ndarray:
    """Sum over the `width` values around each, of the first axis; fewer at the ends."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    low = np.clip(np.arange(len(values)) - width // 2, 0, None)
    high = np.clip(np.arange(len(values)) - width // 2 + width, None, len(values))
    return total[high] - total[low]


def _unlike(own: Real, predicted: Real, dof: float, known: Real) -> np.ndarray:
    """Lines whose own variance is larger than the predicted one by more than chance allows on any line."""
    from scipy.special import fdtri

    return own > fdtri(2 * dof, 2 * np.maximum(known, _NONE), 1 - _UNLIKE / own.size) * predicted


def _shaped(matrix: np.ndarray, variance: Real, around: Neighbours) -> np.ndarray:
    """The covariance with these variances and the correlations of the neighbourhood."""
    deviation = np.sqrt(np.maximum(np.einsum("fii->fi", matrix).real, 0))
    safe = np.where(deviation > 0, deviation, 1)
    mean = around.mean(matrix / (safe[:, :, None] * safe[:, None, :]))
    diagonal = np.sqrt(np.maximum(np.einsum("fii->fi", mean).real, 0))
    diagonal = np.where(diagonal > 0, diagonal, 1)
    wanted = np.sqrt(variance) / diagonal
    shaped = mean * (wanted[:, :, None] * wanted[:, None, :])
    q = np.arange(int(variance.shape[1]))
    shaped[:, q, q] = variance
    return shaped


def pooled_words(lines: int) -> str:
    """Say over how many lines variances were pooled; empty where they weren't."""
    return "" if lines == 1 else f", pooled over up to {lines} neighbouring spectral lines"


def exceeds(total: Real, noise: Real, d1: float, d2: float) -> bool:
    """Test of whether variances (F, ...) are more than noise: mean of the logarithm of the ratio, in groups of lines.

    From d1 and d2 residuals at every line; by four standard deviations in one of the groups.
    """
    from scipy.special import polygamma, psi

    log = np.log(total / noise).reshape(len(total), -1)
    mean = psi(d1) - np.log(d1) - psi(d2) + np.log(d2)
    deviation = np.sqrt(polygamma(1, d1) + polygamma(1, d2))
    groups = np.array_split(log, min(_GROUPS, -(-len(log) // 16)))
    return any(float(np.max((g.mean(axis=0) - mean) / deviation * np.sqrt(len(g)))) > _DISTORTED for g in groups)
