"""Search of a controller that can end at any time: the best one proved so far, with a share of the time for the last proof."""

from __future__ import annotations

import contextlib
import math
import time
from typing import NamedTuple

from robustid.controllers.designing import At, Found, Task, TimeIsOver
from robustid.controllers.proving import Proof
from robustid.core import Budget, Interruptible, Progress

_CUTS = 6  # rounds of frequencies at which a proof failed
_RESERVE = 1.5  # of the time that a proof took, for the next one


class Outcome(NamedTuple):
    """A controller and its proof, None where there is none; `finished`: whether the search came to its end."""

    found: Found | None
    proof: Proof | None
    finished: bool


def searched_with_proof(task: Task, budget: Budget, progress: Progress | None = None) -> Outcome:
    """The best controller of a task that keeps the limits, with its proof: of all that are proved, else of the last one."""
    return _Search(task, budget, progress).outcome()


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
        finished = False
        with Interruptible(lambda: self.found is not None), contextlib.suppress(TimeIsOver):
            self.run()
            finished = True
        best, proved = self.found, self.judged
        worth = best is not None and (proved is None or not proved[1].kept or best.level > proved[0].level)
        if not finished and best is not None and worth and self.budget.left > self.seconds:
            self.prove(best)
        if self.judged is None:
            return Outcome(self.found, None, finished)
        return Outcome(*self.judged, finished)

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
        """All stages; without a time limit nothing is proved before the search has ended."""
        task = self.task
        self.allow()
        first = at = None
        for start in task.starts:
            at = At(task, start)
            if (first := at.first()) is not None:
                break
        if first is None or at is None:
            return
        timed = not math.isinf(self.budget.left)
        if timed:
            self.prove(first)
        best = at.raised(first)
        if timed and task.intervals:
            self.prove(best)
        best = task.searched(best)
        self.cut(best)

    def cut(self, best: Found) -> None:
        """Prove the best controller; where that fails, ask about those frequencies too."""
        kept = self.prove(best)
        for _ in range(_CUTS):
            shares = kept.shares.values()
            where = [omega for share, omega in shares if share > 1 and math.isfinite(omega) and omega > 0]
            if kept.kept or not where:
                return
            self.task.with_frequencies(where)
            self.found = None  # those before don't know of them
            here = At(self.task, best.at)
            again = here.near(best)
            if again is None:
                again = here.first()
                again = None if again is None else here.raised(again)
            if again is None:
                return
            best, kept = again, self.prove(again)

    def prove(self, found: Found) -> Proof:
        """Judge a controller; one that is proved stays until a better one is."""
        self.tell("proving the controller on the whole axis")
        began = time.monotonic()
        proof = self.task.proof(found)
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
