"""Controllers where the limits can't be kept: the one that is closest, and what smaller bounds would change."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from robustid.controllers.designing import SPARE, At, Found, Task, TimeIsOver, unheard
from robustid.controllers.proved_search import ended_early
from robustid.controllers.proving import Proof
from robustid.core import Budget, Interruptible, Progress, Real, Unfinished

_THEMSELVES = 1 / SPARE  # limits that are relaxed by it are those that were asked for
_RATIO = 1.01  # of two factors that limits are relaxed by, which are as good as equal
_FIRST, _MOST = 1.05, 1e4  # factors that are tried
_PROOFS, _WIDER = (
    4,
    1.05,
)  # of controllers that are found but not proved to stabilise; what the limits are relaxed by then
_SMALLER = (0.5, 0.0)  # factors of the bounds


class Closest(NamedTuple):
    """The controller that keeps limits relaxed by the least factor, its proof, and what smaller bounds would change.

    `bounds` is the largest factor of the bounds, of 0.5 and 0, with which a controller that keeps the limits was found; None
    where none was.
    """

    found: Found
    proof: Proof
    bounds: float | None
    unfinished: Unfinished | None


def closest(task: Task, budget: Budget, progress: Progress | None = None) -> Closest | None:
    """The closest controller of a structure where none keeps the limits; None where no limits could be kept."""
    task = dataclasses.replace(task, budget=budget, heard=unheard)
    best: tuple[float, Found] | None = None
    bounds, finished, search = None, False, Interruptible(lambda: best is not None)

    def tell(text: str) -> None:
        if progress is not None:
            progress(text, 0, 0)

    with search, contextlib.suppress(TimeIsOver):
        tell("no controller keeps the limits; searching the closest one")
        for at in task.starts:
            for found in _relaxed(task, at, _MOST if best is None else best[0] / _RATIO):
                best = found
        tell("trying smaller bounds")
        bounds = _with_smaller_bounds(task, None if best is None else best[1])
        finished = True
    if best is None:
        return None
    tell("proving the closest controller on the whole axis")
    found, proof = _judged(task, *best)
    return Closest(found, proof, bounds, None if finished else ended_early(search))


def _relaxed(task: Task, at: list[float], most: float) -> Iterator[tuple[float, Found]]:
    """Ever closer controllers, with the factors that the limits are relaxed by: from above 1, then by halves.

    The first asks for the limits themselves, of which a search leaves what a proof takes.
    """
    low, high, near = 1.0, None, None
    factor = min(_THEMSELVES, most)
    while low < most and high is None:
        here = At(dataclasses.replace(task, relaxed=factor), at)
        if (near := here.found(here.ends[0])) is not None:
            high = factor
            yield factor, near
        else:
            low, factor = factor, min(max(factor**2, _FIRST), most)
    while high is not None and high > low * _RATIO:
        middle = math.sqrt(low * high)
        here = At(dataclasses.replace(task, relaxed=middle), at)
        if (found := here.found(here.ends[0], near)) is not None:
            high, near = middle, found
            yield middle, found
        else:
            low = middle


def _uniform(factor: float, omega: Real) -> Real:
    return 0 * omega + factor


def _with_smaller_bounds(task: Task, near: Found | None) -> float | None:
    for factor in _SMALLER:
        smaller = dataclasses.replace(task, smaller=partial(_uniform, factor))
        for at in task.starts if near is None else [near.at, *task.starts]:
            here = At(smaller, at)
            if here.found(here.ends[0]) is not None or (near and here.found(here.ends[0], near) is not None):
                return factor
    return None


def _judged(task: Task, factor: float, found: Found) -> tuple[Found, Proof]:
    """The controller with its proof; once more with frequencies between which more is taken, or with limits relaxed further."""
    proof = task.proof(found)
    with contextlib.suppress(TimeIsOver):
        for _ in range(_PROOFS):
            stable = all(one.guaranteed for one in proof.proofs)
            where = [omega for share, omega in proof.shares.values() if share > factor * _RATIO and omega > 0]
            if stable and not where:
                break
            task.with_frequencies([one for one in where if math.isfinite(one)])
            factor *= _RATIO if stable else _WIDER
            here = At(dataclasses.replace(task, relaxed=factor), found.at)
            level = here.ends[0]
            again = here.found(level, found) or here.found(level)
            if again is None:
                break
            found, proof = again, task.proof(again)
    return found, proof
