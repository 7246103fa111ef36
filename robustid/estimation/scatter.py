"""Covariance of a response from the scatter of periodic experiments: between their blocks, and from period to period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.core import Real, counted
from robustid.data import joint_radius, stacked, variances
from robustid.estimation.distortion import Distortion
from robustid.estimation.pooling import Pool, exceeds, pool, pooled_words

# Variance of the strength of the distortion known beforehand, and for how many records that counts.
_COMMON, _BEFORE = 0.2, 2.0
_USUAL = 0.95  # probability for which the surer of two bounds is chosen
_ALIKE = 1.5  # ratio of the sizes of one input in two experiments up to which their outputs scatter alike


class Changing(NamedTuple):
    """Variance of what changes from one block of experiments to the next, and how well the sum with that of the mean is known."""

    variance: Real  # (F, ny, nu)
    dof: Real  # (F,)


class Scatter(NamedTuple):
    """Covariance of the mean response, and what changes from one block of experiments to the next."""

    covariance: np.ndarray  # (F, ny nu, ny nu)
    dof: Real  # (F,)
    words: str
    changing: Changing | None
    noise: np.ndarray | None  # (F, ny, nu) standard deviations
    distortion: np.ndarray | None

    def with_distortion(self, found: Distortion | None) -> Scatter:
        """The scatter of one block with the distortion that its unexcited lines show."""
        if found is None:
            return self
        words = f"{self.words}; {found.words}"
        if not found.seen:
            return self._replace(words=words, changing=Changing(found.variance, self.dof))
        noise = np.einsum("fii->fi", self.covariance).real
        added: Real = stacked(found.variance)
        # Satterthwaite: two variances of their own degrees of freedom are worth this many together.
        share = (added / np.maximum(noise + added, np.finfo(float).tiny)).mean(axis=1)
        dof = 1 / (share**2 / found.dof + (1 - share) ** 2 / self.dof)
        diagonal = np.eye(added.shape[1]) * added[:, None, :]
        return self._replace(
            covariance=self.covariance + diagonal,
            dof=dof,
            words=words,
            changing=Changing(found.variance, dof),
            distortion=np.sqrt(found.variance),
        )


class _Residuals(NamedTuple):
    """Residuals of the experiments, in signals whose scatter is the same in all blocks, and smooth over the lines: the outputs.

    Where every experiment drives the inputs alike, the outputs scatter alike in all nu experiments of a block, with nu times the
    degrees of freedom; else the outputs of every experiment of a block are signals of their own. The response is no such signal:
    at lines where the inputs of the experiments are almost dependent it scatters much more than beside them.
    """

    each: np.ndarray  # (F, c, P, q) of c experiments or blocks, and every period
    dof: float  # of the means over the periods
    turned: np.ndarray  # (F, B, nu, nu): U^-T / B of every block
    size: np.ndarray  # (F, q) of the response in the signals
    apart: bool  # outputs of every experiment are signals of their own, experiment by experiment

    def covariance(self, of_signals: np.ndarray) -> np.ndarray:
        """Covariance of the mean response, (F, ny nu, ny nu), from that of the signals of one experiment or block."""
        lines, _, nu, experiments = self.turned.shape
        own = of_signals[:, None]
        if self.apart:  # experiments are independent of each other
            cut = of_signals.reshape(lines, experiments, -1, experiments, of_signals.shape[1] // experiments)
            own = np.einsum("feiej->feij", cut)
        own = np.broadcast_to(own, (lines, experiments, *own.shape[2:]))
        # vec(E U^-1) = (U^-T (x) I) vec(E), and the columns of E are independent.
        parts = np.einsum("fbae,fbce,feij->faicj", self.turned, self.turned.conj(), own, optimize=True)
        return parts.reshape(lines, nu * own.shape[2], -1)


def scattered(
    left: np.ndarray, inverse: np.ndarray, values: np.ndarray, u: np.ndarray, index: np.ndarray, rounding: Real
) -> Scatter:
    """Covariance of the mean response of periodic experiments, from ``left = Y - G U`` (F, B, P, ny, nu) of B blocks and P periods.

    One block: from period to period, noise alone. Several: between the blocks, S with what changes from one to the next; where that
    is no more than noise N explains, both together. What changes has the variance ``S - N``, at least ``S/sqrt(dof)``.
    """
    # S/sqrt(dof) could not be told from 0. `inverse` is U^-1 (F, B, nu, nu); `rounding` are errors that are no distortion.
    blocks, periods = left.shape[1:3]
    found = _residuals(left, inverse, values, u)
    count = found.each.shape[1]
    between = found.each.mean(axis=2)
    of_noise = float(count * (periods - 1))
    noise = _second_moments(found.each - between[:, :, None]) / max(of_noise * periods, 1)
    by_noise = variances(found.covariance(noise), values.shape)
    if blocks == 1:
        shared = pool(noise, of_noise, found.size, index, None)
        words = f"{periods} periods{pooled_words(shared.lines)}"
        return Scatter(found.covariance(shared.matrix), shared.dof, words, None, np.sqrt(by_noise), None)
    total = _second_moments(between[:, :, None]) / found.dof
    shared = pool(total, found.dof, found.size, index, between)
    shared = shared._replace(dof=1 / (1 / shared.dof + _common(between, shared, found.dof) / found.dof))
    single = found._replace(turned=np.sqrt(blocks) * found.turned)
    words = f"{counted(blocks, 'block')} of experiments ({counted(periods, 'period')} each){pooled_words(shared.lines)}"
    if periods == 1:
        changing = _changing(shared, None, blocks, single, values.shape)
        return Scatter(found.covariance(shared.matrix), shared.dof, words, changing, None, None)
    quiet = pool(noise, of_noise, found.size, index, None)
    distortion = np.sqrt(np.maximum(variances(single.covariance(shared.matrix - noise), values.shape), 0))
    spread = variances(found.covariance(total), values.shape)
    if exceeds(spread + rounding**2, by_noise + rounding**2, found.dof, of_noise):
        changing = _changing(shared, quiet, blocks, single, values.shape)
    else:
        changing = _unseen(shared, quiet, single, values.shape)
        both = (found.dof * total + of_noise * noise) / (found.dof + of_noise)
        shared = pool(both, found.dof + of_noise, found.size, index, None)
        words = f"{blocks} blocks and {periods} periods: no distortion seen between blocks{pooled_words(shared.lines)}"
    return Scatter(found.covariance(shared.matrix), shared.dof, words, changing, np.sqrt(by_noise), distortion)


def _changing(shared: Pool, noise: Pool | None, blocks: int, single: _Residuals, shape: tuple[int, ...]) -> Changing:
    """Variance of what changes: that between blocks less that of the noise, or all of it where that makes the surer bound."""
    own = np.einsum("fii->fi", shared.matrix).real
    dof = shared.dof
    if noise is not None:
        quiet = np.einsum("fii->fi", noise.matrix).real
        less = np.maximum(own - quiet, own / np.sqrt(dof)[:, None])
        # Satterthwaite: a difference of two estimates is known less well than either.
        spread = ((1 + 1 / blocks) * own) ** 2 / dof[:, None] + quiet**2 / noise.dof[:, None]
        wanted = np.maximum(less + own / blocks, np.finfo(float).tiny)
        known = np.clip(1 / np.maximum((spread / wanted**2).mean(axis=1), np.finfo(float).tiny), 1, dof)
        radius = [joint_radius(_USUAL, own.size, part) ** 2 for part in (known, dof)]
        better = radius[0] * wanted.mean(axis=1) < radius[1] * ((1 + 1 / blocks) * own).mean(axis=1)
        own = np.asarray(np.where(better[:, None], less, own), dtype=float)
        dof = np.asarray(np.where(better, known, dof), dtype=float)
    return Changing(_diagonal(single, own, shape), dof)


def _unseen(shared: Pool, noise: Pool, single: _Residuals, shape: tuple[int, ...]) -> Changing:
    """Variance of what may change although the scatter between blocks is no more than noise explains."""
    own, quiet = (np.einsum("fii->fi", part.matrix).real for part in (shared, noise))
    return Changing(_diagonal(single, np.maximum(own - quiet, own / np.sqrt(shared.dof)[:, None]), shape), shared.dof)


def _diagonal(single: _Residuals, variance: Real, shape: tuple[int, ...]) -> Real:
    """Variances (F, ny, nu) of the response of one block, from those of its signals (F, q)."""
    return variances(single.covariance(np.eye(variance.shape[1]) * variance[:, None, :]), shape)


def _common(residuals: np.ndarray, shared: Pool, dof: float) -> float:
    """Variance of the strength of the distortion from record to record, common to all lines, relative to its mean.

    What pooling over lines doesn't average out. Of the power of every record's residuals, less what independent lines would
    scatter; two residuals of one difference show nothing, and with few records a level known beforehand counts.
    """
    variance = np.einsum("fii->fi", shared.matrix).real
    white = np.abs(residuals) ** 2 / np.where(variance > 0, variance, 1)[:, None]
    power = white.mean(axis=(0, 2))
    power = power / power.mean() if power.mean() > 0 else np.ones(power.size)
    spare = dof - 1
    chance = min(shared.together, len(white)) / (len(white) * residuals.shape[2])
    seen = max(power.var(ddof=1) - chance, 0) * (dof / spare) ** 2 if spare > 0 else 0.0
    return (_BEFORE * _COMMON + spare * seen) / (_BEFORE + spare)


def alike(u: np.ndarray) -> bool:
    """Return whether every input has about the same size in all experiments; (F, B, P, nu, nu), the experiments last."""
    size = np.sqrt(np.mean(np.abs(u.mean(axis=2)) ** 2, axis=0))  # (B, nu, nu)
    return bool(np.all(size.max(axis=(0, 2)) <= _ALIKE * size.min(axis=(0, 2))))


def _residuals(left: np.ndarray, inverse: np.ndarray, values: np.ndarray, u: np.ndarray) -> _Residuals:
    lines, blocks, periods, ny, nu = left.shape
    turned, together = inverse.swapaxes(-1, -2) / blocks, alike(u)
    output = np.abs(values[:, None] @ u.mean(axis=2)) ** 2  # (F, B, ny, nu)
    if together:
        each = left.transpose(0, 1, 4, 2, 3).reshape(lines, blocks * nu, periods, ny)
        return _Residuals(each, float((blocks - 1) * nu), turned, np.sqrt(np.mean(output, axis=(1, 3))), False)
    each = left.swapaxes(-1, -2).reshape(lines, blocks, periods, ny * nu)
    size = np.sqrt(output.mean(axis=1).swapaxes(-1, -2)).reshape(lines, ny * nu)
    return _Residuals(each, float(blocks - 1), turned, size, True)


def _second_moments(errors: np.ndarray) -> np.ndarray:
    """Sum of e e^H over experiments and periods, (F, c, P, q) -> (F, q, q)."""
    flat = errors.reshape(errors.shape[0], -1, errors.shape[-1])
    return flat.swapaxes(1, 2) @ flat.conj()
