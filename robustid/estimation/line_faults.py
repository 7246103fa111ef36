"""Faults of single lines and of parts of the axis of a response, in words, and the response without them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real, counted, hz_words
from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.estimation.axis_parts import Jump, jump, unexcited
from robustid.estimation.corrections import leaving_out, written_hz
from robustid.estimation.local_models import FEWEST
from robustid.estimation.outlying_lines import NARROW, Odd, contradicting, odd_values
from robustid.estimation.whole_model import WINDOW, WholeModel, beyond_bounds, jump_of_models, odd_lines, whole_models

_TWICE = 1.5  # times the sum of their bounds, by which values at the same frequency contradict each other,
_PART = 0.1  # or so much of their size where no bound is stated
_SAME = 1e-12  # of a frequency
_PAIRS = 16  # repeated frequencies
_ALIKE = 0.35  # squared steps from one of their differences to the next, of what noise has
_EDGE = 4  # lines beside those that nothing excited, which may be of them
_NAMED = 8  # lines whose place is said
_MAINS_HZ = (50.0, 60.0, 400.0, 16.0 + 2 / 3)


class Cleaned(NamedTuple):
    """Faults of lines, the most telling first, the response without those lines, and without their jumps too.

    `beyond` is by how many bounds several lines are off a model of them all, if they are.
    """

    faults: list[Fault]
    rest: FrequencyResponse
    joined: FrequencyResponse
    beyond: float = 0.0


def line_faults(frf: FrequencyResponse) -> Cleaned:
    """Faults of lines against their neighbours: none of them needs a model of the whole."""
    if frf.omega.size < FEWEST:
        return Cleaned([], frf, frf)
    low, high = _excited(frf)
    if (low, high) != (0, frf.omega.size):
        inner = line_faults(frf.select(slice(low, high)))
        return inner._replace(faults=[*_noise_words(frf, low, high), *inner.faults])
    out, found = _contradicting(frf)
    if int(np.sum(~out)) < FEWEST:  # too few to be judged
        return Cleaned(found, frf, frf)
    rest = frf.select(~out)
    odd = odd_values(rest)
    wrong = _mask(rest, odd)
    joined, beyond = rest, 0.0
    if (step := jump(rest, wrong)) is None:
        odd, step, beyond = _of_whole(rest, odd, wrong)
        wrong = _mask(rest, odd)
    if step is not None:
        values = rest.values.copy()
        values[step.upper :] /= step.factors.reshape(values.shape[1:])
        joined = dataclasses.replace(rest, values=values)
        odd = odd_values(joined)
        wrong = _mask(joined, odd)
        found.append(_jump_words(rest, step))
    if odd:
        found.append(_odd_words(rest, odd, np.flatnonzero(wrong).tolist()))
    return Cleaned(found, rest.select(~wrong), joined.select(~wrong), beyond)


def _of_whole(frf: FrequencyResponse, odd: list[Odd], wrong: NDArray[np.bool_]) -> tuple[list[Odd], Jump | None, float]:
    """The lines that are off, with those that only models of whole entries show; or a jump that these show, or small bounds."""
    part = frf.select(~wrong)
    models, lines = whole_models(part), np.flatnonzero(~wrong)
    step = jump_of_models(models, part)
    if step is not None:
        return odd, step._replace(upper=int(lines[step.upper])), 0.0
    more = [one._replace(line=int(lines[one.line])) for one in contradicting(part, odd_lines(models))]
    if more:
        return sorted([*odd, *more]), None, 0.0
    return odd, None, _beyond(part, models)


def _beyond(frf: FrequencyResponse, models: dict[int, WholeModel]) -> float:
    """Largest residual of a model in bounds, where several lines are left beyond theirs; or 0.

    One model of a long response lacks modes, and follows no line closely: then windows of it have a model each.
    """
    if beyond_bounds(models):
        return beyond_bounds(whole_models(frf, refined=True))
    last, largest = frf.omega.size - WINDOW, 0.0
    if last <= 0 or not beyond_bounds(models, poor=True):
        return 0.0
    for first in [*range(0, last, WINDOW), last]:
        part = frf.select(slice(first, first + WINDOW))
        if beyond_bounds(whole_models(part), poor=True):
            largest = max(largest, beyond_bounds(whole_models(part, refined=True)))
    return largest


def _excited(frf: FrequencyResponse) -> tuple[int, int]:
    """First line that something excited, and line after the last one; lines at their edges that are off are noise too."""
    low, high = unexcited(frf)
    if (low, high) == (0, frf.omega.size):
        return low, high
    part = frf.select(slice(low, high))
    odd = sorted({one.line for one in [*odd_values(part), *odd_lines(whole_models(part))]})
    first = max([line + 1 for line in odd if low > 0 and line < _EDGE], default=0)
    last = min([line for line in odd if high < frf.omega.size and line >= high - low - _EDGE], default=high - low)
    return low + first, low + last


def _mask(frf: FrequencyResponse, odd: Sequence[Odd]) -> NDArray[np.bool_]:
    """The lines that are off; where they are 0, all that are: none was measured."""
    out = np.zeros(frf.omega.size, bool)
    out[[one.line for one in odd]] = True
    empty = ~np.any(frf.values, axis=(1, 2)) & ~frf.missing.all(axis=(1, 2))
    return out | empty if np.any(out & empty) else out


# --- repeated frequencies -------------------------------------------------------------------------------------------------------


def _contradicting(frf: FrequencyResponse) -> tuple[NDArray[np.bool_], list[Fault]]:
    """Lines at the same frequency whose values no single one explains, and the sentence on them."""
    out = np.zeros(frf.omega.size, bool)
    groups = _repeated(frf)
    sizes = [_disagreement(frf, group) for group in groups]
    worst, places = max(sizes, default=0.0), [one.start for one, size in zip(groups, sizes, strict=True) if size > 1]
    unit = "times the sum of their bounds" if frf.bound is not None else f"times {100 * _PART:g} % of their size"
    size = worst * (_TWICE if frf.bound is not None else 1)
    evidence = f"values at the same frequency differ by {size:.3g} {unit}"
    if not places and (share := _apart(frf, groups)):
        size, places = share, [one.start for one in groups]
        evidence = f"values at the same frequency differ by {100 * share:.2g} % in the median, alike from one to the next: no noise"
    if not places:
        return out, []
    for group in groups:
        out[group] = group.start in places
    if 2 * len(places) > len(np.unique(frf.omega)):
        every = "every frequency point stands" if out.all() else f"{len(places)} frequency points stand"
        words = f"{every} there again with other values: several responses in one file"
        evidence += "; give each response in a file of its own: robustid compare says where they differ"
        return out, [Fault(FaultKind.OUTLIER, words, evidence, size=size)]
    words = f"repeated frequency points contradict each other: {_places(frf, places)}"
    return out, [Fault(FaultKind.OUTLIER, words, evidence, leaving_out(frf, places), size=size)]


def _repeated(frf: FrequencyResponse) -> list[slice]:
    """Points of every frequency that stands there more than once."""
    start = np.flatnonzero(np.diff(frf.omega, prepend=-1.0) > _SAME * frf.omega[-1]).tolist()
    ends = [*start[1:], frf.omega.size]
    return [slice(first, end) for first, end in zip(start, ends, strict=True) if end - first > 1]


def _apart(frf: FrequencyResponse, groups: Sequence[slice]) -> float:
    """Median relative difference of two responses in one, whose scatter made the bound; 0 where it may be noise."""
    if frf.bound is None or frf.bound.kind == "hard" or len(groups) < _PAIRS or np.any(frf.missing):
        return 0.0
    one, other = (frf.values[[group.start + k for group in groups]] for k in (0, 1))
    apart = 2 * (one - other) / np.maximum(np.abs(one) + np.abs(other), np.finfo(float).tiny)
    size, steps = (np.sum(np.abs(part) ** 2, axis=0) for part in (apart, np.diff(apart, axis=0)))
    alike = (size > 0) & (steps < 2 * _ALIKE * size)
    return float(np.median(np.abs(apart[:, alike]))) if np.any(alike) else 0.0


def _disagreement(frf: FrequencyResponse, points: slice) -> float:
    """Largest difference of values at the same frequency, in units of what is allowed."""
    values, missing = frf.values[points], frf.missing[points]
    apart = np.abs(values[:, None] - values[None])
    size = np.abs(values)
    allowed = size[:, None] + size[None]
    if frf.bound is not None:
        radius = frf.bound.outer_radius[points]
        allowed = _TWICE * (radius[:, None] + radius[None])
    else:
        allowed = _PART * allowed / 2
    usable = ~(missing[:, None] | missing[None]) & (allowed > 0)
    return float(np.max(np.where(usable, apart, 0) / np.where(usable, allowed, 1)))


# --- sentences ------------------------------------------------------------------------------------------------------------------


def _odd_words(frf: FrequencyResponse, odd: Sequence[Odd], lines: Sequence[int]) -> Fault:
    """The sentence on lines that are off."""
    worst = max(odd, key=lambda one: one.scatter)
    bounded = [one.bounds for one in odd if np.isfinite(one.bounds)]
    count = len(lines)
    by_bound = f"{max(bounded):.3g} times the bound and " if bounded else ""
    off = f"by {'up to ' * (len(odd) > 1)}{by_bound}{worst.scatter:.3g} times the scatter of the neighbours"
    size = float(max(bounded) if bounded else worst.scatter)
    if {line for group in _repeated(frf) for line in range(group.start, group.stop)}.issuperset(lines):
        words = f"repeated frequency points contradict each other: {_places(frf, lines)}"
        evidence = f"of the values at the same frequency one is off what its neighbours say, {off}"
        return Fault(FaultKind.OUTLIER, words, evidence, leaving_out(frf, lines), _where(frf, odd), size=size)
    words = f"{count} frequency point{'s' * (count > 1)} ({_places(frf, lines)}{_entry_words(frf, odd)})"
    words += " are off what their neighbours say" if count > 1 else " is off what its neighbours say"
    at = f" at {hz_words(frf.freq_hz[worst.line])}" if count > 1 else ""
    each, them = ("each", "them") if count > 1 else ("it", "it")
    evidence = f"{off}{at}{_cause(frf, lines)}. Suspect: a mode would explain {each} only with a half-width below"
    evidence += f" {hz_words(NARROW * _spacing(frf, lines), 3)}, a quarter of the line spacing; measure between the lines, or leave"
    evidence += f" {them} out"
    return Fault(FaultKind.OUTLIER, words, evidence, leaving_out(frf, lines), _where(frf, odd), size=size)


def _cause(frf: FrequencyResponse, lines: Sequence[int]) -> str:
    """Words on what such lines have in common: zeros, or a frequency and its odd multiples."""
    if not np.any(frf.values[list(lines)]):
        return "; the values are 0, as of lines that were not measured"
    hz, spacing = np.asarray(frf.freq_hz[list(lines)], dtype=float), _spacing(frf, lines)
    times: Real = np.asarray(np.rint(hz / hz[0]), dtype=float)
    if len(lines) > 1 and np.all(times % 2 == 1) and np.all(np.abs(hz - times * hz[0]) <= spacing * (times + 1) / 2):
        said = ", ".join(f"{n:g}" for n in times.tolist())
        return f"; they are {said} times {hz_words(hz[0])}: a disturbance and its odd multiples{_mains(hz[0], spacing)}"
    return _mains(hz[0], spacing) if len(lines) == 1 else ""


def _mains(hz: float, spacing: float) -> str:
    """The mains, where the line nearest to their frequency is this one."""
    near = [mains for mains in _MAINS_HZ if abs(hz - mains) <= spacing / 2]
    return f"; the mains have {hz_words(near[0], 4)}" if near else ""


def _jump_words(frf: FrequencyResponse, step: Jump) -> Fault:
    below, above = frf.freq_hz[step.upper - 1], frf.freq_hz[step.upper]
    seen = step.factors[np.abs(step.factors - 1) > 0]
    factor = seen[int(np.argmax(np.abs(seen - 1)))]
    turn = float(np.degrees(np.angle(factor)))
    words = f"between {hz_words(below)} and {hz_words(above)} the response jumps by a factor of {abs(factor):.3g} and {turn:.3g}"
    words += " degrees"
    bounds = f", {step.size:.3g} times the bound there," if np.isfinite(step.size) else ""
    evidence = (
        f"no model of lines on both sides follows it{bounds} and it goes on beyond: two measurements that were joined. Bring both"
        " parts to the same gain, unit and delay, or use one of them (--band)"
    )
    return Fault(FaultKind.SEAM, words, evidence, where=_entries(frf, step.factors != 1), size=float(abs(factor - 1)))


def _noise_words(frf: FrequencyResponse, low: int, high: int) -> list[Fault]:
    """Sentences on lines that nothing excited, beyond and below the others."""
    found: list[Fault] = []
    for side, part, edge in (("above", slice(high, None), high - 1), ("below", slice(0, low), low)):
        size = np.abs(frf.values[part])
        if not size.size:
            continue
        hz = float(f"{frf.freq_hz[edge]:.6g}")
        hz = hz if (hz >= frf.freq_hz[edge]) == (side == "above") else float(frf.freq_hz[edge])
        bound = ""
        if frf.bound is not None:
            share = float(np.median(frf.bound.outer_radius[part] / np.maximum(size, np.finfo(float).tiny)))
            bound = f", while their bounds are {100 * share:.2g} % of their size"
        words = f"nothing excited the {counted(len(size), 'frequency point')} {side} {hz_words(hz, 6)}"
        evidence = f"their values are unrelated from one to the next, as noise is{bound}"
        found.append(Fault(FaultKind.NOISE_ONLY, words, evidence, f"leave out {side} {hz:.10g}", size=float(len(size))))
    return found


def _places(frf: FrequencyResponse, lines: Sequence[int]) -> str:
    said = ", ".join(written_hz(frf, line) for line in lines[:_NAMED])
    return f"{said} Hz" + (f" and {len(lines) - _NAMED} more" if len(lines) > _NAMED else "")


def _spacing(frf: FrequencyResponse, lines: Sequence[int]) -> float:
    """Smallest distance of these lines from a neighbour, in Hz."""
    steps = np.diff(np.unique(frf.freq_hz))
    at = np.searchsorted(np.unique(frf.freq_hz), frf.freq_hz[list(lines)])
    return float(min(steps[max(k - 1, 0) : k + 1].min() for k in at.tolist()))


def _where(frf: FrequencyResponse, odd: Sequence[Odd]) -> str:
    entries = np.arange(len(frf.outputs) * len(frf.inputs))
    return _entries(frf, np.isin(entries, [one.entry for one in odd]))


def _entries(frf: FrequencyResponse, part: NDArray[np.bool_]) -> str:
    """The entries, where they aren't all."""
    nu = len(frf.inputs)
    if part.all() or part.size == 1:
        return ""
    return ", ".join(
        f"{frf.outputs[i].name} / {frf.inputs[j].name}" for i, j in (divmod(int(k), nu) for k in np.flatnonzero(part))
    )


def _entry_words(frf: FrequencyResponse, odd: Sequence[Odd]) -> str:
    of = _where(frf, odd)
    return f", {of}" if of else ""
