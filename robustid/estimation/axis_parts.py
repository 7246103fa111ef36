"""Parts of a frequency axis that don't go together: a jump between two of them, and lines that nothing excited."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse
from robustid.estimation.local_models import Said, neighbours, said_at_zero, unlikely
from robustid.estimation.outlying_lines import Entry, entries_of, related

_CHANCE = 1e-3  # of a false alarm, over all places of all entries
_SIDES = ((1, 1, 8), (2, 1, 10), (1, 2, 10), (2, 2, 12))  # poles, degree and lines on either side of a jump
_WHOLE = ((2, 2, 8), (3, 3, 10), (4, 4, 12))  # of models over it, with lines on either side
_PART = 0.5  # of the bound, that a jump takes away at least: all lines beyond it are off to one side
_NOISE = 0.5  # error of a local model in parts of the value from which on it may be noise,
_QUIET, _SMOOTH = 0.4, 0.2  # part of the lines of noise that may have less, and of the others that may have more
_LINES = 8  # at least, that nothing excited
_LEAST_STEP = 0.1
_TURNED = 0.1  # of a factor that is -1
_SMALL_BOUNDS = 3.0  # times their bound, that such values are in the median
_RELATED, _ALIKE = 3.0, 0.25  # in nats, and in parts of the number of lines: neighbours that turn alike are no noise


class Jump(NamedTuple):
    """The place between two lines (that of the upper one), the factor there of every entry, and its size in units of the bounds."""

    upper: int
    factors: Complex  # (entries,); 1 where none is seen
    size: float


def unexcited(frf: FrequencyResponse) -> tuple[int, int]:
    """First line and line after the last one between which the response is no noise; beyond them it is, and the bounds deny it."""
    lines = frf.omega.size
    inside = (0, lines)
    entries = [one for one in entries_of(frf) if one.omega.size == lines and np.all(one.near > 0)]
    if not entries or frf.bound is None:  # a bound that is taken from the scatter says it
        return inside
    size = np.array([np.linalg.norm(one.values / one.near.max()) for one in entries])
    one = entries[int(np.argmax(size))]
    wrong = _errors(one) > _NOISE
    top = _beyond(one, wrong)
    flipped = Entry(
        one.omega[:top][::-1], one.values[:top][::-1], one.deviation[:top][::-1], one.bound[:top][::-1], one.lines
    )
    return (top - _beyond(flipped, wrong[:top][::-1]), top)


def _errors(one: Entry) -> Real:
    """Errors of what the neighbours say of each line, in parts of its value."""
    every = np.arange(one.omega.size)
    at = neighbours(12, every, every)
    x = one.omega[at] - one.omega[:, None]
    x = x / np.maximum(np.abs(x).max(axis=1, keepdims=True), np.finfo(float).tiny)
    said = said_at_zero(x, one.values[at], one.near[at], 2, 2)
    return np.abs(one.values - said.value) / one.near


def _beyond(one: Entry, wrong: NDArray[np.bool_]) -> int:
    """The line from which on all is noise, with the fewest lines on the wrong side; the number of lines where there is none."""
    count = wrong.size
    if count < 2 * _LINES:
        return count
    misplaced = np.concatenate([[0], np.cumsum(wrong)]) + np.concatenate([np.cumsum(~wrong[::-1])[::-1], [0]])
    place = int(np.argmin(misplaced))
    if count - place < _LINES or place < _LINES:
        return count
    values, bound = one.values[place:], one.bound[place:]
    denied = np.median(np.abs(values) / np.maximum(bound, np.finfo(float).tiny)) > _SMALL_BOUNDS
    turns = values[1:] * values[:-1].conj()
    turns = turns / np.maximum(np.abs(turns), np.finfo(float).tiny)
    related = float(np.abs(turns.sum()) ** 2 / turns.size)
    clear = (~wrong[place:]).mean() <= _QUIET and wrong[:place].mean() <= _SMOOTH
    return _kept(one, place) if denied and related < max(_RELATED, _ALIKE * turns.size) and clear else count


def _kept(one: Entry, place: int) -> int:
    """The first line of noise: those before it that the lines below say are none."""
    points = 12
    for line in range(place, min(place + points, one.omega.size)):
        if line < points:
            break
        at = np.arange(line - points, line)
        x = (one.omega[at] - one.omega[line]) / np.abs(one.omega[at[0]] - one.omega[line])
        said = said_at_zero(x[None], one.values[at][None], one.near[at][None], 2, 2)
        if np.abs(one.values[line] - said.value[0]) > _SMOOTH * one.near[line]:
            return line
    return place


# --- jumps ----------------------------------------------------------------------------------------------------------------------


def jump(frf: FrequencyResponse, out: NDArray[np.bool_]) -> Jump | None:
    """The clearest jump between two lines, without those that are `out`; None where there is none."""
    entries = [one for one in entries_of(frf) if one.omega.size == frf.omega.size]
    usable = np.flatnonzero(~out)
    most = max(lines for _, _, lines in _SIDES)
    if not entries or usable.size < 2 * most + 2:
        return None
    gaps = np.arange(most + 1, usable.size - most)
    limit = float(np.log(gaps.size * len(entries) / _CHANCE))
    seen = [_jumps(one, usable, gaps, limit) for one in entries]
    evidence = np.sum([np.where(odd > limit, odd, 0) for odd in seen], axis=0)
    for k in np.argsort(-evidence)[:_LINES].tolist():
        if evidence[k] <= 0:
            return None
        gap, factors, size = int(gaps[k]), np.ones(len(entries), complex), 0.0
        for number, (one, odd) in enumerate(zip(entries, seen, strict=True)):
            if odd[k] > limit and (factor := _confirmed(one, usable, gap, limit)) is not None:
                factors[number] = factor
                beside = usable[gap - 1 : gap + 1]
                there = float(np.abs(factor - 1) * np.abs(one.values[beside]).mean())
                size = max(size, there / float(one.bound[beside].mean()) if one.bound[beside].any() else np.inf)
        if size > 0 and size >= least_step(frf):
            return Jump(int(usable[gap]), factors, size)
    return None


def least_step(frf: FrequencyResponse) -> float:
    """Mean bounds of both sides that a step takes at least: where a response is far smaller than they are, none is seen.

    Errors that lines beside each other share step too, from one window to the next, by what both bounds allow.
    """
    return 2.0 if related(frf) else _LEAST_STEP


def _jumps(one: Entry, usable: NDArray[np.intp], gaps: NDArray[np.intp], limit: float) -> Real:
    """In nats, how unlikely it is that both sides of each gap say the same there, by the models that find it the least so."""
    least = np.full(gaps.size, np.inf)
    for poles, power, lines in _SIDES:
        for skipped in (0, 1, 2):  # a single line beside the gap makes no jump: without the one, without the other
            todo = np.flatnonzero(least > limit)
            if not todo.size:
                return least
            below, above, ratio, dof = _both(one, usable, gaps[todo], (poles, power, lines), skipped)
            least[todo] = np.minimum(least[todo], unlikely(ratio, dof))
            bound = _PART * np.maximum(one.bound[usable[gaps[todo]]], one.bound[usable[gaps[todo] - 1]])
            least[todo] = np.where(np.abs(above - below) > bound, least[todo], 0)
    return least


def _both(
    one: Entry, usable: NDArray[np.intp], gaps: NDArray[np.intp], order: tuple[int, int, int], skipped: int
) -> tuple[Complex, Complex, Real, int]:
    """Values that the lines below and those above give to the middle of each gap; the square of their difference over its own."""
    poles, power, lines = order
    middle = (one.omega[usable[gaps]] + one.omega[usable[gaps - 1]]) / 2
    sides: list[np.ndarray] = []
    for first in (gaps - lines - (skipped == 1), gaps + (skipped == 2)):
        sides.append(usable[first[:, None] + np.arange(lines)])
    found: list[Said] = []
    for at in sides:
        x = one.omega[at] - middle[:, None]
        x = x / np.abs(x).max(axis=1, keepdims=True)
        found.append(said_at_zero(x, one.values[at], one.deviation[at], poles, power))
    low, high = found
    scatter = (low.scatter + high.scatter) / 2
    if not one.bound.any():
        scatter = np.maximum(scatter, (1e-3 * (one.near / one.deviation)[usable[gaps]]) ** 2)
    ratio = np.abs(high.value - low.value) ** 2 / np.maximum(
        scatter * (low.variance + high.variance), np.finfo(float).tiny
    )
    return low.value, high.value, ratio, low.dof + high.dof


def of_resonance(factor: complex) -> bool:
    """Return whether a factor turns the response and changes its size, as a resonance between two lines does; a sign turns it."""
    return factor.real < 0 and abs(abs(factor) - 1) > _TURNED


def _confirmed(one: Entry, usable: NDArray[np.intp], gap: int, limit: float) -> complex | None:
    """The factor of the upper part, where no model over both sides explains them without it."""
    below, above, _, _ = _both(one, usable, np.array([gap]), _SIDES[2], 0)
    if min(abs(below[0]), abs(above[0])) <= float(one.bound[usable[gap - 1 : gap + 1]].max()):
        return None  # of what may as well be zero nothing follows
    factor = complex(above[0] / below[0])
    if of_resonance(factor):
        return None
    for poles, power, lines in _WHOLE:
        at = usable[max(gap - lines, 0) : gap + lines]
        upper = at >= usable[gap]
        x = one.omega[at] - (one.omega[usable[gap]] + one.omega[usable[gap - 1]]) / 2
        x = (x / np.abs(x).max())[None]
        with_, without = (
            said_at_zero(x, (one.values[at] / np.where(upper, by, 1))[None], one.deviation[at][None], poles, power)
            for by in (factor, 1.0)
        )
        gained = (without.scatter[0] - with_.scatter[0]) * with_.dof / max(with_.scatter[0], np.finfo(float).tiny)
        if unlikely(max(gained, 0.0), with_.dof) < limit:
            return None
    return factor
