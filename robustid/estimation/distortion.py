"""Nonlinear distortion from one periodic excitation: what the output holds at spectral lines that were not excited."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.core import Complex, Real
from robustid.estimation.pooling import exceeds

# Levels at excited lines over those of unexcited ones, where several realisations show both: in the band 0.5 to 1 in the median
# over the lines (simulated hardening spring, dry friction, backlash; tests/estimation/test_distortion.py), beside it 1 on the
# mirror, 1.5 to 2 for spring and friction, 6 for backlash, which no factor for all would cover.
INSIDE, BESIDE = 1.5, 2.0
_SILENT = 0.1  # of the excited lines: what a line may hold and count as unexcited
_SIGNIFICANT = 4.0  # standard deviations
_LEAST = 4  # unexcited lines
_POOL = 21  # unexcited lines whose mean is taken for an excited one
_REACH, _REACH_LINES = 0.1, 16  # beyond the band: part of the frequency, or lines
_ROUNDS = 8  # of weighted least squares
_EDGE = 5  # excited lines from which the response is continued beyond the band


class Distortion(NamedTuple):
    """Variance of what a nonlinear plant adds at the excited lines, in one realisation."""

    variance: Real  # (F, ny, nu) of the response; what could not be seen, where none was
    seen: bool
    dof: float
    words: str


class _Lines(NamedTuple):
    """Unexcited lines: what is left there after the linear response, and how large the response would be."""

    index: np.ndarray  # type: ignore[assignment] # (D,)
    power: Real  # (D, ny) mean over the experiments
    noise: Real  # (D, ny) of it, what varies from period to period
    size: Real  # (D, ny) of the linear response to an input as at the excited lines


def detected(
    drive: np.ndarray, u: np.ndarray, y: np.ndarray, index: np.ndarray, values: np.ndarray, inverse: np.ndarray
) -> Distortion | None:
    """Distortion at unexcited lines in the band, or beside it, interpolated to the excited ones of `index`, times a factor.

    From below: the excited lines may hold more (`pintelon2012`, chapter 4). None without periods to tell noise by, or with fewer
    than four unexcited lines. The spectra `drive`, u and y, (K, P, n, nu), are at all lines of a period; `inverse` is U^-1.
    """
    # At an unexcited line D = Y - G U, G interpolated, is distortion and noise, whose variance over the periods is subtracted. Its
    # variance, a part of one size and a part relative to the linear response, is fitted to the unexcited lines nearest to each
    # excited one. Of excited lines that are all odd, the unexcited odd ones are taken where there are enough: even distortion stays
    # on even lines.
    if u.shape[1] < 2:
        return None
    lines = _unexcited(drive, index)
    same = lines % 2 == 1
    odd = bool(np.all(index % 2 == 1))
    chosen = lines[same] if odd and same.sum() >= _LEAST else lines
    if chosen.size < _LEAST:
        return None
    inputs = u[index].mean(axis=1)
    found = _left(chosen, u, y, index, values, inputs)
    experiments, periods = u.shape[3], u.shape[1]
    rounding = 16 * np.finfo(float).eps * np.abs(y).max(axis=(0, 1, 3))
    seen = exceeds(found.power + rounding**2, found.noise + rounding**2, experiments, experiments * (periods - 1))
    if not seen:
        # What could not be told from the noise of so many lines.
        share = _SIGNIFICANT * np.sqrt((1 + 1 / (periods - 1)) / (chosen.size * experiments))
        found = found._replace(power=share * found.noise, noise=0 * found.noise)
    output = np.sqrt(np.mean(np.abs(values @ inputs) ** 2, axis=2))
    level = _at(index, output, found)
    each = np.sum(np.abs(inverse) ** 2, axis=1)  # (F, nu): every experiment adds its own
    inside = int(np.sum((chosen > index.min()) & (chosen < index.max())))
    used, factor = (min(_POOL, inside), INSIDE) if inside >= _LEAST else (chosen.size, BESIDE)
    place = (
        "" if inside == chosen.size else ", all beside the band" if inside == 0 else f", {inside} of them in the band"
    )
    lines_words = f"{chosen.size} unexcited {'odd ' if chosen.size < lines.size else ''}spectral lines{place}"
    share = np.sqrt(np.median(level / np.where(output > 0, output, 1) ** 2))
    words = (
        f"distortion ({100 * share:.2g} % of the response) on {lines_words}, times {factor:g}: an estimate from below"
        if seen
        else f"no distortion above the noise on {lines_words}"
    )
    return Distortion(factor**2 * level[:, :, None] * each[:, None, :], seen, max(used - 2.0, 1.0) * experiments, words)


def _unexcited(drive: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Lines in and next to the band that hold next to nothing of the excitation."""
    size = np.sqrt(np.mean(np.abs(drive.mean(axis=1)) ** 2, axis=2))  # (K, n)
    level = np.sqrt(np.mean(size[index] ** 2, axis=0))
    first, last = int(index.min()), int(index.max())
    low = max(1, first - max(_REACH_LINES, int(_REACH * first)))
    high = min(last + max(_REACH_LINES, int(_REACH * last)), len(size) - 2)
    lines = np.arange(low, high + 1)
    lines = lines[np.all(size[lines] < _SILENT * level, axis=1)]
    return lines[~np.isin(lines, index)]


def _left(
    lines: np.ndarray, u: np.ndarray, y: np.ndarray, index: np.ndarray, values: np.ndarray, inputs: np.ndarray
) -> _Lines:
    """Output on unexcited lines beyond the linear response to what the inputs hold there."""
    response = _continued(lines, index, values)
    left = y[lines] - response[:, None] @ u[lines]
    mean = left.mean(axis=1)
    noise = left.var(axis=1, ddof=1) / left.shape[1]
    near = inputs[np.abs(lines[:, None] - index).argmin(axis=1)]
    size = np.sqrt(np.mean(np.abs(response @ near) ** 2, axis=2))
    return _Lines(lines, np.mean(np.abs(mean) ** 2, axis=2), np.mean(noise, axis=2), size)


def _continued(lines: np.ndarray, index: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The response between the excited lines, interpolated, and beyond them, by powers of the frequency."""
    flat: Complex = values.reshape(len(index), -1)
    columns: list[Complex] = [
        np.asarray(np.interp(lines, index, part.real) + 1j * np.interp(lines, index, part.imag), dtype=complex)
        for part in flat.T
    ]
    found = np.stack(columns, 1)
    known = np.flatnonzero(index > 0)
    for ends, there in ((known[:_EDGE], lines < index[0]), (known[-_EDGE:], lines > index[-1])):
        if ends.size < 2 or not np.any(there):
            continue
        # Relative to the largest: the continuation does not depend on units, not even by rounding.
        scale = np.abs(flat[ends]).max(axis=0)
        part = flat[ends] / np.where(scale > 0, scale, 1)
        size = np.abs(part)
        log = np.log(np.where(size > 0, size, 1)) + 1j * np.unwrap(np.angle(part), axis=0)
        design, wanted = (np.stack([np.ones(k.size), np.log(k)], axis=1) for k in (index[ends], lines[there]))
        found[there] = scale * np.exp(wanted @ np.asarray(np.linalg.lstsq(design, log)[0], dtype=complex))
    return found.reshape(len(lines), *values.shape[1:])


def _at(index: np.ndarray, output: Real, found: _Lines) -> Real:
    """Variance of the distortion of an output in one experiment at the excited lines, (F, ny).

    ``a + b size^2`` fitted to the unexcited lines nearest to each: to all of them where these lie beside the band.
    """
    inside = (found.index > index.min()) & (found.index < index.max())
    lines = np.flatnonzero(inside) if inside.sum() >= _LEAST else np.arange(found.index.size)
    count = min(_POOL, lines.size) if inside.sum() >= _LEAST else lines.size
    nearest = lines[np.argsort(np.abs(index[:, None] - found.index[lines]), axis=1, kind="stable")[:, :count]]
    level = np.zeros(output.shape)
    for i in range(output.shape[1]):
        scale = np.maximum(found.size[:, i].max(), np.finfo(float).tiny)
        size, noise = (found.size[:, i] / scale) ** 2, found.noise[:, i] / scale**2
        power = found.power[:, i] / scale**2
        a, b = _two_levels(power[nearest], noise[nearest], size[nearest])
        level[:, i] = (a + b * (output[:, i] / scale) ** 2) * scale**2
    return level


def _two_levels(power: Real, noise: Real, size: Real) -> tuple[Real, Real]:
    """a, b >= 0 of ``E power = noise + a + b size``, each power exponentially distributed, (F, n) -> (F,) each.

    Weighted least squares, the weights from the fit before; at least what could not be told from noise.
    """
    floor = power.mean(axis=1) / np.sqrt(power.shape[1])
    a, b = np.maximum(power.mean(axis=1) / 2, floor), np.mean(power / np.maximum(size, size.mean()), axis=1) / 2
    left = power - noise
    for _ in range(_ROUNDS):
        expected = noise + a[:, None] + b[:, None] * size
        w = 1 / np.maximum(expected, 1e-60) ** 2
        s0, s1, s2 = w.sum(axis=1), (w * size).sum(axis=1), (w * size**2).sum(axis=1)
        r0, r1 = (w * left).sum(axis=1), (w * size * left).sum(axis=1)
        both = np.maximum(s0 * s2 - s1**2, 1e-12 * s0 * s2)
        pairs = [((s2 * r0 - s1 * r1) / both, (s0 * r1 - s1 * r0) / both)]
        pairs += [(np.maximum(r0 / s0, 0), 0 * r0), (0 * r0, np.maximum(r1 / s2, 0))]
        costs = [
            np.where((p >= 0) & (q >= 0), p**2 * s0 + q**2 * s2 + 2 * p * q * s1 - 2 * (p * r0 + q * r1), np.inf)
            for p, q in pairs
        ]
        best = np.argmin(costs, axis=0)[None]
        a, b = (np.take_along_axis(np.array(part), best, axis=0)[0] for part in zip(*pairs, strict=True))
    return a, b
