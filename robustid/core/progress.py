"""Budgets of time, whom they tell how far a computation is, and progress for people: one line that is rewritten."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextvars import ContextVar
from types import TracebackType

from robustid.core.choice import Choice, Source
from robustid.core.validation import as_function, as_positive

Progress = Callable[
    [str, int, int], None
]  # (text, done, count): what is done, how much of how much; count 0: not counted

_LEFT_OUT = "unfinished"  # name among the choices
_OFTEN = 0.1  # seconds between two writings of the line
_WORTH_SAYING = 2.0  # seconds that are left


class Budget:
    """Seconds of wall clock that a computation may take from now on, and the receiver of its progress.

    Parameters
    ----------
    time_limit : float or None
        None: no limit.
    progress : callable (text, done, count), optional
    text : str
        The computation in words, which the receiver is told.
    """

    def __init__(self, time_limit: float | None = None, progress: Progress | None = None, text: str = "") -> None:
        limit = math.inf if time_limit is None else as_positive("time_limit", time_limit)
        self._deadline, self._progress = time.monotonic() + limit, as_function("progress", progress)
        self._text = text

    @property
    def left(self) -> float:
        """Seconds that are left; inf without a limit."""
        return self._deadline - time.monotonic()

    @property
    def seconds(self) -> float | None:
        """Seconds that are left, as the `time_limit` of another call, positive; None without a limit."""
        return None if math.isinf(self.left) else max(self.left, 1e-9)

    @property
    def over(self) -> bool:
        """True if the time is up."""
        return self.left <= 0

    def share(self, part: float) -> Budget:
        """The budget of a first stage: a part of what is left, and the same receiver."""
        limit = None if math.isinf(self.left) else max(part * self.left, 1e-9)
        return Budget(limit, self._progress, self._text)

    def tell(self, done: int, count: int) -> None:
        """Tell how far it is."""
        if self._progress is not None:
            self._progress(self._text, done, count)

    def receive(self, text: str, done: int, count: int) -> None:
        """Receive the progress of a stage, which is told as that of the whole."""
        self.tell(done, count)


class Pieces:
    """Pieces of work that take about equally long: none begins that takes longer than the time that is left.

    Parameters
    ----------
    budget : Budget or None
        None: all of them begin.
    """

    def __init__(self, budget: Budget | None) -> None:
        self._budget = budget
        self._longest, self._last = 0.0, 0.0 if budget is None else time.monotonic()

    def begins(self) -> bool:
        """Tell whether the next one may begin; what was done since this was asked last is the one before."""
        if self._budget is None:
            return True
        now = time.monotonic()
        self._longest, self._last = max(self._longest, now - self._last), now
        return self._budget.left > self._longest


class Interruptible:
    """Ctrl-C in a loop that returns the best so far: kept back where something is there, else raised.

    Used in a `with` block around the loop; `interrupted` tells of it afterwards, and `Stops` that listen do. A loop over loops
    that keep it back passes it on.

    Parameters
    ----------
    there : callable () -> bool
        True if there is something to return.
    """

    def __init__(self, there: Callable[[], bool] = lambda: True) -> None:
        self.interrupted, self._there = False, there

    @property
    def keeps(self) -> bool:
        """True if there is something to return."""
        return self._there()

    def __enter__(self) -> Interruptible:
        _OPEN.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> bool:
        _OPEN.remove(self)
        self.interrupted = kind is not None and issubclass(kind, KeyboardInterrupt) and self.keeps
        for one in _LISTENING.get() if self.interrupted else ():
            one.interrupted = True
        return self.interrupted


_OPEN: list[Interruptible] = []


def something_is_kept() -> bool:
    """Return whether a Ctrl-C now would be kept back by a loop that has something to return."""
    return any(one.keeps for one in list(_OPEN))


@dataclasses.dataclass(frozen=True)
class Unfinished:
    """Parts that a run has left out: steps whose time was over, which end with their best so far, or that Ctrl-C ended.

    `resumable` says whether what is finished is kept where the same run finds it again, `run` in words what ended.
    """

    steps: tuple[str, ...]
    interrupted: bool
    resumable: bool = False
    run: str = "it"

    @staticmethod
    def of(choices: Mapping[str, Choice]) -> Unfinished | None:
        """Return what a result keeps of the run that found it; None of a run that came to its end."""
        found = choices.get(_LEFT_OUT)
        return None if found is None else found.value

    def kept(self, run: str) -> dict[str, Choice]:
        """Return what a result keeps among its choices, for pages that are drawn from its file."""
        left_out = dataclasses.replace(self, run=run)
        return {_LEFT_OUT: Choice(left_out, Source.STOPPED, left_out.sentence)}

    @staticmethod
    def without(choices: Mapping[str, Choice]) -> dict[str, Choice]:
        """Return the choices of a result without what it keeps of the run that found it."""
        return {name: one for name, one in choices.items() if name != _LEFT_OUT}

    @property
    def word(self) -> str:
        """The reason in one word."""
        return "Interrupted" if self.interrupted else "Unfinished"

    @property
    def sentence(self) -> str:
        """The reason, and the way on."""
        late = "; ".join(self.steps)
        if self.interrupted:
            start = (
                f"Ctrl-C ended {self.run} before its end: what stands here was found by then, and holds"
                + f"; not finished: {late}" * bool(late)
            )
            again = (
                "The same run with resume goes on from what is finished."
                if self.resumable
                else "Run it again for the rest."
            )
            return f"{start}. {again}"
        further = "A larger time limit goes further" + ", with resume from what is finished" * self.resumable
        return f"What stands here holds, but the time was over in: {late}; each kept the best so far. {further}."


@dataclasses.dataclass(eq=False)
class Stops:
    """Record of what ended before its end: steps whose time was over, and whether a Ctrl-C was kept back while it listened."""

    late: list[str] = dataclasses.field(default_factory=list[str])
    interrupted: bool = False

    @property
    def unfinished(self) -> Unfinished | None:
        """The steps that ended before their end; None where nothing did."""
        return Unfinished(tuple(self.late), self.interrupted) if self.late or self.interrupted else None

    @contextlib.contextmanager
    def listening(self) -> Generator[None]:
        """Listen to loops that keep Ctrl-C back."""
        before = _LISTENING.set((*_LISTENING.get(), self))
        try:
            yield
        finally:
            _LISTENING.reset(before)


_LISTENING: ContextVar[tuple[Stops, ...]] = ContextVar("listening", default=())


def pass_on(interrupted: bool) -> None:
    """Raise the Ctrl-C again that an inner loop has kept back: the outer one ends too."""
    if interrupted:
        raise KeyboardInterrupt


def was_interrupted() -> bool:
    """Return whether a loop has kept a Ctrl-C back while somebody listens: whatever comes now is waited for."""
    return any(one.interrupted for one in _LISTENING.get())


class Pace:
    """The pace of something that is counted, from the first time that it is told."""

    def __init__(self, done: int) -> None:
        self._began, self._first, self._tenth = time.monotonic(), done, -1

    @property
    def seconds(self) -> float:
        """Seconds so far."""
        return time.monotonic() - self._began

    def another_tenth(self, done: int, count: int) -> bool:
        """Tell whether another tenth is done than when this was asked last."""
        before, self._tenth = self._tenth, 10 * done // count
        return self._tenth != before

    def line(self, text: str, done: int, count: int) -> str:
        """The text, how much of how much, and the seconds that are left where they are worth saying."""
        share = f"{text + ': ' if text else ''}{done} of {count}"
        left = self.seconds * (count - done) / max(done - self._first, 1)  # the first one doesn't tell of the others
        return share + (f", about {left:.0f} s left" if done > self._first and left >= _WORTH_SAYING else "")


class ShowProgress:
    """Receiver of progress, with the line that it wrote last; see `show_progress`."""

    def __init__(self) -> None:
        self._pace, self._last, self._wrote, self._width = Pace(0), ("", 0, 0), 0.0, 0

    def __call__(self, text: str, done: int = 0, count: int = 0) -> None:
        """Write the line, seldom enough."""
        new = (text, count) != (self._last[0], self._last[2]) or done < self._last[1]
        if new:
            self._end()
            self._pace, self._wrote = Pace(done), 0.0
        self._last = text, done, count
        line = self._pace.line(text, done, count) if count else text
        # A line can be written over at a terminal, and in a notebook.
        if not (sys.stdout.isatty() or type(sys.stdout).__module__.startswith("ipykernel")):
            if self._pace.another_tenth(done, count) if count else new:
                _write(line + "\n")
            return
        now, finished = time.monotonic(), bool(count) and done >= count
        if finished or now - self._wrote >= _OFTEN:
            _write("\r" + line.ljust(self._width) + "\n" * finished)
            self._wrote, self._width = now, 0 if finished else len(line)

    def _end(self) -> None:
        if self._width:
            _write("\n")
            self._width = 0


_SHOWN = ShowProgress()


def show_progress(text: str, done: int = 0, count: int = 0) -> None:
    """Show how far a long computation is, in one line that is written over: the argument `progress` of every function.

    In notebooks and at terminals; in a file at most a line for every tenth.

    Parameters
    ----------
    text : str
        The computation in words.
    done, count : int
        How much of how much; `count` is 0 where nothing is counted.

    Examples
    --------
    >>> import robustid as rid
    >>> for k in range(3):
    ...     rid.show_progress("counting", k + 1, 3)
    counting: 1 of 3
    counting: 2 of 3
    counting: 3 of 3
    """
    _SHOWN(text, done, count)


def _write(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()
