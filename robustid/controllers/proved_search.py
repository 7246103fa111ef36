"""Search of a controller that can end at any time: the best one proved so far, with a share of the time for the last proof."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from typing import NamedTuple

from robustid.controllers.designing import At, Found, Task, TimeIsOver
from robustid.controllers.proving import Proof
from robustid.core import Budget, Interruptible, Progress, Unfinished

_CUTS = 6  # rounds of frequencies at which a proof failed
_MUCH, _AGAIN = 1.2, 1.5  # shares up to which more is asked for, and how much more than is missing
_RESERVE = 1.5  # of the time that a proof took, for the next one


class Outcome(NamedTuple):
    """A controller and its proof, None where there is none; `unfinished`: what ended the search before its end."""

    found: Found | None
    proof: Proof | None
    unfinished: Unfinished | None


def searched_with_proof(task: Task, budget: Budget, progress: Progress | None = None) -> Outcome:
    """The best controller of a task that keeps the limits, with its proof: of all that are proved, else of the last one."""
    return _Search(task, budget, progress).outcome()


def ended_early(search: Interruptible) -> Unfinished:
    """Words on a search whose time was over, or that Ctrl-C ended."""
    name = "the search of a controller"
    return Unfinished(() if search.interrupted else (name,), search.interrupted, run=name)


class _Search:
    """The search, what it has proved and what it has found since."""

    def __init__(self, task: Task, budget: Budget, progress: Progress | None) -> None:
        self.task, self.budget, self.progress = task, budget, progress
        task.heard = self.hear
        self.found: Found | None = None  # with the frequencies that are asked about now
        self.judged: tuple[Found, Proof] | None = None  # the last one that was judged, or the best that is proved
        self.seconds = 0.0  # of the last proof

    def outcome(self) -> Outcome:
        """The best so far at the end, or when the time is over or Ctrl-C comes."""
        finished, search = False, Interruptible(lambda: self.found is not None)
        with search, contextlib.suppress(TimeIsOver):
            self.run()
            finished = True
        unfinished = None if finished else ended_early(search)
        best, proved = self.found, self.judged
        worth = best is not None and (proved is None or not proved[1].kept or best.level > proved[0].level)
        if not finished and best is not None and worth and self.budget.left > self.seconds:
            self.prove(best)
        if self.judged is None:
            return Outcome(self.found, None, unfinished)
        return Outcome(*self.judged, unfinished)

    def hear(self, found: Found) -> None:
        """Keep a controller that is found, where it is better."""
        if self.found is None or found.level > self.found.level:
            self.found = found
            self.tell(f"searching a controller: {self.task.goal.name} {self.task.goal.told(found.level)}")

    def tell(self, text: str) -> None:
        """Tell what is done."""
        if self.progress is not None:
            self.progress(text, 0, 0)

    def run(self) -> None:
        """All stages; with a time limit each ends with a proof, since frequencies at which one fails take time to keep."""
        task = self.task
        self.allow()
        first = at = None
        for start in task.starts:
            at = At(task, start)
            if (first := at.first()) is not None:
                break
        if first is None or at is None:
            return
        if math.isinf(self.budget.left):
            self.cut(task.searched(at.raised(first)))
            return
        best, done = self.stage(lambda best: At(task, best.at).raised(best), self.cut(first))
        done = done and all(low == high for low, high in task.intervals)
        while not done:
            best, done = self.stage(task.searched, best)

    def stage(self, search: Callable[[Found], Found], best: Found) -> tuple[Found, bool]:
        """A search for at most half of the time that is left, and the proof of what it finds; and whether it came to its end."""
        self.allow()
        self.task.go_on()
        self.task.budget = self.task.budget.share(0.5)
        try:
            found, done = search(best), True
        except TimeIsOver:
            found, done = best, False
            if self.found is not None and self.found.level > best.level:
                found = self.found
        self.allow()
        return (best if found is best else self.cut(found)), done

    def cut(self, best: Found) -> Found:
        """Prove the best controller, and ask about frequencies where that fails; the best that is proved, else the last one."""
        best = self.kept_between(best)
        kept = self.prove(best)
        for _ in range(_CUTS):
            over = [(share, omega) for share, omega in kept.shares.values() if share > 1]
            where = [omega for _, omega in over if math.isfinite(omega) and omega > 0]
            much = max((share for share, omega in over if math.isnan(omega)), default=1.0)
            if kept.kept or not (where or 1 < much < _MUCH):
                break
            if much < _MUCH:  # margins tell no frequency: a little more is asked for everywhere
                self.task.spare /= 1 + _AGAIN * (much - 1)
            again = self.again(best, where)
            if again is None:
                break
            best = self.kept_between(again)
            kept = self.prove(best)
        return self.judged[0] if self.judged is not None and self.judged[1].kept else best

    def kept_between(self, best: Found) -> Found:
        """A controller that breaks no limit between the frequencies either, as far as a closer look tells: sooner than a proof."""
        for _ in range(_CUTS):
            where = self.task.broken(best)
            again = self.again(best, where) if where else None
            if again is None:
                break
            best = again
        return best

    def again(self, best: Found, where: list[float]) -> Found | None:
        """The best controller with further frequencies that are asked about."""
        self.task.with_frequencies(where)
        self.found = None  # those before don't know of them
        here = At(self.task, best.at)
        found = here.near(best)
        if found is None:
            found = here.first()
            found = None if found is None else here.raised(found)
        return found

    def prove(self, found: Found) -> Proof:
        """Judge a controller; one that is proved stays until a better one is."""
        if self.budget.left < self.seconds:
            raise TimeIsOver
        began = time.monotonic()
        proof = self.task.proof(found, self.progress)
        self.seconds = time.monotonic() - began
        before = self.judged
        if before is None or not before[1].kept or (proof.kept and found.level >= before[0].level):
            self.judged = found, proof
        self.allow()
        return proof

    def allow(self) -> None:
        """Let the search go on until the time of one more proof is left."""
        left = self.budget.left
        self.task.budget = Budget(None if math.isinf(left) else max(left - _RESERVE * self.seconds, 1e-9))
