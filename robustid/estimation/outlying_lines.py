"""Frequency points that contradict what their neighbours say, or another value at the same frequency."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse
from robustid.estimation.local_models import FEWEST, ORDERS, Said, neighbours, said_at_zero, unlikely

_CHANCE = 1e-3  # of a false alarm, over all values of a response
_ALIKE = (
    5.0  # in nats: a mode that explains a line so much worse than an error of this line alone does, doesn't explain it
)
NARROW = 0.25  # of the line spacing: half-width below which a mode shows on one line only
# Poles in line spacings from the line (frequency, half-width), of modes that neighbours may see, and of narrower ones.
_WIDE: Complex = np.asarray(
    (NARROW * 1j * np.geomspace(1, 20, 7)[:, None] + np.linspace(-1, 1, 17)).ravel(), dtype=complex
)
_NEEDLES: Complex = np.asarray(
    np.outer([0.003, 0.01, 0.03, 0.1, 0.2], np.exp(1j * np.pi * np.linspace(0.1, 0.9, 5))).ravel(), dtype=complex
)
_SURE = 2.0  # standard deviations of what the neighbours say, beyond the bound
_ROUNDS = 6
_APART = 4  # lines: of several so near, which disturb each other's neighbourhood, the oddest is taken out first
_MOST = 0.1  # of all lines: where more are odd, the neighbourhoods say nothing
_DIP = 5  # neighbours whose median a response is at least
_TURNS = 8  # of a fit that has to find a pole
_ZERO = 1e-9  # of a denominator
_RELATED = 0.6  # of the deviation that a covariance states: errors of neighbours that scatter less are alike
_LEAST = 1e-3  # of the response nearby: scatter that is counted at least where no bound is stated


class Odd(NamedTuple):
    """A value that is off: its line and entry, how far in units of its bound (nan: none), of the scatter, and of itself."""

    line: int
    entry: int
    bounds: float
    scatter: float
    part: float


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry over the lines where it was measured: deviations have the shape of its noise, `bound` is 0 where none is stated."""

    omega: Real
    values: Complex
    deviation: Real
    bound: Real
    lines: NDArray[np.intp]

    @property
    def near(self) -> Real:
        """Size of the response nearby: the median of the neighbours, or more."""
        size = np.abs(self.values)
        near: Real = np.median(sliding_window_view(np.pad(size, _DIP // 2, mode="reflect"), _DIP), axis=1)
        return np.maximum(np.maximum(near, size), np.finfo(float).tiny)


def entries_of(frf: FrequencyResponse) -> list[Entry]:
    """The entries that have enough lines and are not 0."""
    flat = frf.values.reshape(frf.omega.size, -1)
    measured = ~frf.missing.reshape(flat.shape)
    bounds = np.zeros(flat.shape) if frf.bound is None else frf.bound.outer_radius.reshape(flat.shape)
    noise = None if frf.bound is not None or frf.covariance is None else np.einsum("fii->fi", frf.covariance).real
    if noise is not None:  # vec: columns stacked
        noise = noise.reshape(-1, frf.values.shape[2], frf.values.shape[1]).swapaxes(1, 2).reshape(flat.shape)
    found: list[Entry] = []
    for k in range(flat.shape[1]):
        at = np.flatnonzero(measured[:, k])
        if at.size < FEWEST or not np.any(flat[at, k]):
            at = at[:0]
        one = Entry(frf.omega[at], flat[at, k], np.ones(at.size), bounds[at, k], at)
        if at.size:
            shape = bounds[at, k] if noise is None else np.sqrt(np.maximum(noise[at, k], 0))
            floor = 1e-9 * float(np.max(one.near))
            one = dataclasses.replace(one, deviation=np.maximum(shape, floor) if np.any(shape) else one.near)
        found.append(one)
    return found


def odd_values(frf: FrequencyResponse) -> list[Odd]:
    """Values that their neighbours contradict, by line; none where so many do that they have no neighbours."""
    entries = entries_of(frf)
    limit = float(np.log(max(sum(one.omega.size for one in entries), 1) / _CHANCE))
    found = [odd for k, one in enumerate(entries) for odd in (_odd_of(one, k, limit) if one.omega.size else [])]
    if len({odd.line for odd in found}) > max(1, _MOST * frf.omega.size):
        return []
    return contradicting(frf, sorted(found))


def contradicting(frf: FrequencyResponse, odd: Sequence[Odd]) -> list[Odd]:
    """Odd values that are off by more than the bounds beside them take too, where lines beside each other err alike."""
    if not odd or frf.bound is None or not related(frf):
        return list(odd)
    radius: Real = frf.bound.outer_radius.reshape(frf.omega.size, -1)
    kept: list[Odd] = []
    for one in odd:
        reach, own = _DIP // 2, radius[:, one.entry]
        around = np.concatenate([own[max(one.line - reach, 0) : one.line], own[one.line + 1 :][:reach]])
        if one.bounds * radius[one.line, one.entry] > radius[one.line, one.entry] + float(np.median(around)):
            kept.append(one)
    return kept


def _odd_of(one: Entry, entry: int, limit: float) -> list[Odd]:
    """Odd values of an entry: found, taken out of the neighbourhoods of the others, and judged again without each other."""
    every, out = np.arange(one.omega.size), np.zeros(one.omega.size, bool)
    for _ in range(_ROUNDS):
        usable = np.flatnonzero(~out)
        if usable.size < FEWEST:
            return []
        again = every if not out.any() else _beside(out)
        lines, weight = _judged(one, again[~out[again]], usable, limit)
        lines = _oddest(lines, weight)
        if not lines.size:
            break
        out[lines] = True
    taken = np.flatnonzero(out)
    usable = np.flatnonzero(~out)
    lines, _ = _judged(one, taken, usable, limit) if taken.size else (taken, None)
    return [odd for line in lines.tolist() if (odd := _confirmed(one, entry, line, usable, limit)) is not None]


def _beside(out: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Lines whose neighbourhoods have changed since these were taken out."""
    reach = ORDERS[-1][-1]
    return np.flatnonzero(np.convolve(out, np.ones(2 * reach + 1))[reach : reach + out.size] > 0.5)


def _oddest(lines: NDArray[np.intp], weight: Real) -> NDArray[np.intp]:
    """Oddest one of lines near each other."""
    kept: list[int] = []
    for k in np.argsort(-weight).tolist():
        if all(abs(lines[k] - other) >= _APART for other in kept):
            kept.append(int(lines[k]))
    return np.array(sorted(kept), dtype=np.intp)


def _judged(
    one: Entry, lines: NDArray[np.intp], usable: NDArray[np.intp], limit: float, deviation: Real | None = None
) -> tuple[NDArray[np.intp], Real]:
    """Lines that all local models call odd, and how far they are in units of what the last one knows."""
    weight: Real = np.zeros(lines.size)
    deviation = one.deviation if deviation is None else deviation
    least = np.where(one.bound > 0, 0.0, _LEAST * one.near / deviation)
    for poles, power, points in ORDERS:
        if not lines.size:
            break
        at = neighbours(points, lines, usable)
        x = one.omega[at] - one.omega[lines, None]
        x = x / np.maximum(np.abs(x).max(axis=1, keepdims=True), np.finfo(float).tiny)
        said = said_at_zero(x, one.values[at], deviation[at], poles, power)
        scatter = np.maximum(said.scatter, least[lines] ** 2)
        distance = np.abs(one.values[lines] - said.value)
        ratio = distance**2 / (scatter * (deviation[lines] ** 2 + said.variance))
        far = distance > one.bound[lines] + _SURE * np.sqrt(scatter * said.variance)
        odd = far & (unlikely(ratio, said.dof) > limit)
        lines, weight = lines[odd], np.sqrt(ratio[odd])
    return lines, weight


def _confirmed(one: Entry, entry: int, line: int, usable: NDArray[np.intp], limit: float) -> Odd | None:
    """The line with its sizes, if it is odd whichever shape the noise has, and no mode that its neighbours see explains it."""
    alone, near = np.array([line]), one.near
    for shape in (near, np.ones(near.size)):
        if not _judged(one, alone, usable, limit, shape)[0].size:
            return None
    spacing = np.abs(one.omega[usable] - one.omega[line])
    spacing = float(spacing[spacing > 1e-9 * one.omega[-1]].min(initial=np.inf))
    distance, scatter = np.inf, 0.0
    for poles, power, points in ORDERS:
        at = neighbours(points, alone, usable)[0]
        x = one.omega[at] - one.omega[line]
        unit = float(np.abs(x).max())
        said = said_at_zero(x / unit, one.values[at], one.deviation[at], poles, power)
        if _mode_explains(one, line, at, said.denominator, power, spacing / unit):
            return None
        if _model_explains(one, line, at, said, (poles + 1, power), spacing / unit):
            return None
        if (left := float(np.abs(one.values[line] - said.value))) < distance:
            distance, scatter = left, float(np.sqrt(said.scatter * (one.deviation[line] ** 2 + said.variance)))
    bound = distance / one.bound[line] if one.bound[line] > 0 else np.nan
    return Odd(int(one.lines[line]), entry, bound, distance / max(scatter, 1e-300), distance / float(near[line]))


def _mode_explains(one: Entry, line: int, at: NDArray[np.intp], a: Complex, power: int, spacing: float) -> bool:
    """Return whether one more mode, not much narrower than the line spacing, explains the line as well as an error of it does.

    Or any mode explains the neighbours better: they show its flanks.
    """
    rows = np.append(at, line)
    x = one.omega[rows] - one.omega[line]
    x = x / np.abs(x).max()
    below = np.asarray(np.polyval(np.append(a, 1), x), dtype=complex)
    smooth = x[:, None] ** np.arange(power + 1) / np.where(np.abs(below) < _ZERO, _ZERO, below)[:, None]
    weight = 1 / one.deviation[rows]
    q, _ = np.linalg.qr(smooth * weight[:, None])
    places = spacing * np.concatenate([_WIDE, _NEEDLES])
    columns = np.concatenate([np.eye(x.size)[:, -1:], 1 / (x[:, None] - places)], axis=1)
    columns = columns * weight[:, None]
    columns = columns - q @ (q.conj().T @ columns)
    left: Complex = one.values[rows] * weight
    left = left - q @ (q.conj().T @ left)
    size = np.sum(np.abs(columns) ** 2, axis=0)
    gain = np.abs(columns.conj().T @ left) ** 2 / np.where(size > 0, size, np.inf)
    dof = x.size - 1 - q.shape[1] - a.size
    whole, alone, wide = (float(part) for part in (np.sum(np.abs(left) ** 2), gain[0], gain[1 : 1 + _WIDE.size].max()))
    best, least = float(gain[1:].max()), 1e-24 * float(np.sum(np.abs(left) ** 2)) + np.finfo(float).tiny
    as_well = unlikely(max(alone - wide, 0.0) * dof / max(whole - alone, least), dof) < _ALIKE
    better = unlikely(max(best - alone, 0.0) * dof / max(whole - best, least), dof) > _ALIKE
    return bool(as_well or better)


def _model_explains(
    one: Entry, line: int, at: NDArray[np.intp], said: Said, order: tuple[int, int], spacing: float
) -> bool:
    """Return whether a model with one more pole explains the line and its neighbours, and none of its poles is a needle there."""
    rows = np.append(at, line)
    x = one.omega[rows] - one.omega[line]
    x = x / np.abs(x).max()
    larger = said_at_zero(x, one.values[rows], one.deviation[rows], *order, turns=_TURNS)
    roots = np.roots(np.append(larger.denominator, 1))
    if larger.dof < 1 or np.any((np.abs(roots.real) < spacing) & (np.abs(roots.imag) < NARROW * spacing)):
        return False
    worse = float(larger.scatter) * larger.dof - float(said.scatter) * said.dof
    return bool(unlikely(max(worse, 0.0) / max(float(said.scatter), np.finfo(float).tiny), said.dof) < _ALIKE)


def noise_in_bounds(frf: FrequencyResponse) -> float:
    """Scatter around local models of an entry with a bound, rms in units of it, by the models that find it the smallest."""
    return min((float(np.sqrt(np.mean(square))) for one in entries_of(frf) for square in _squares(one)), default=np.inf)


def related(frf: FrequencyResponse) -> bool:
    """Return whether lines beside each other err alike: they scatter less than their covariance says, in the median.

    Estimates whose windows overlap do, by a third of it; those of a line alone as much as it says.
    """
    return frf.covariance is not None and any(
        float(np.median(np.sqrt(square))) < _RELATED
        for one in entries_of(dataclasses.replace(frf, bound=None))
        for square in _squares(one)
    )


def _squares(one: Entry) -> Iterator[Real]:
    """Mean squares of what local models of each order leave around every line, in units of the bound, or of the deviation."""
    every = np.arange(one.omega.size)
    if not every.size:
        return
    unit = np.maximum(one.bound, 1e-12 * float(one.near.max())) if np.any(one.bound) else one.deviation
    for poles, power, points in ORDERS:
        at = neighbours(points, every, every)
        x = one.omega[at] - one.omega[:, None]
        x = x / np.maximum(np.abs(x).max(axis=1, keepdims=True), np.finfo(float).tiny)
        yield said_at_zero(x, one.values[at], unit[at], poles, power).scatter
