"""The terminal: the console, long steps and their progress, warnings, options named in the sentences of the library."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from weakref import WeakKeyDictionary

from robustid.errors import InputError, InputTypeError, SolverError, Status

if TYPE_CHECKING:
    from rich.console import Console

    from robustid.core import Progress
    from robustid.data import Undoing


class Context(Protocol):
    """Context of a command, as far as it is needed here."""

    @property
    def meta(self) -> dict[str, Any]:
        """Values that commands and their parents share."""
        ...


def called(context: Context) -> list[str]:
    """Command and arguments as they were called."""
    return context.meta.setdefault("robustid.called", [])


class Warned(Protocol):
    """Result with sentences that must not scroll away."""

    @property
    def warnings(self) -> Sequence[str]:
        """The sentences."""
        ...


_WORTH_SAYING = 2.0  # seconds that a step has taken
FAULTY = 4
_WARNED: WeakKeyDictionary[Console, list[str]] = WeakKeyDictionary()  # sentences, by where they were printed
_OTHERS: list[Callable[[str], None]] = []  # programs that are told the steps, in place of the terminal
_EXIT = {Status.CONSISTENT: 0, Status.INCONSISTENT: 3, Status.UNDECIDED: 1, Status.FAILED: 1}


def exit_code(status: Status, faulty: bool) -> int:
    """Exit code of a verdict on the class; of data with a fault that nothing has undone no proof is a success or a finding."""
    return FAULTY if faulty and status in (Status.CONSISTENT, Status.INCONSISTENT) else _EXIT[status]


def console(*, stderr: bool = False) -> Console:
    """A rich console on the present stdout or stderr."""
    from rich.console import Console

    return Console(stderr=stderr)


def plain(text: str) -> str:
    """Text of users and files, with rich's markup neutralised."""
    from rich.markup import escape

    return escape(text)


def say(out: Console, *texts: str) -> None:
    """Print plain text, as it stands."""
    for text in texts:
        out.print(plain(text), highlight=False, soft_wrap=True)


def warn(out: Console, text: str) -> None:
    """Print a yellow sentence."""
    _WARNED.setdefault(out, []).append(text)
    out.print(f"[yellow]warning:[/yellow] {plain(text)}", highlight=False, soft_wrap=not out.is_terminal)


def write(answer: dict[str, Any], out: Console | None = None) -> None:
    """Write an answer as JSON on stdout, with the warnings that were printed."""
    from robustid.app.answers.form import text_of

    warned = [] if out is None else _WARNED.get(out, [])
    sys.stdout.write(text_of(answer | {"warnings": list(dict.fromkeys([*warned, *answer["warnings"]]))}))
    sys.stdout.flush()


def say_written(out: Console, *paths: Path | None) -> None:
    """Print the names of the files, on one line."""
    say(out, "written: " + ", ".join(str(path) for path in paths if path is not None))


def repeat_warnings(out: Console, result: Warned) -> None:
    """Print at the end what must not scroll away."""
    for sentence in result.warnings:
        warn(out, sentence)


def say_next(out: Console, undoing: Undoing | None) -> None:
    """Print at the end what undoes a fault of the data, each line of it as it is pasted."""
    if undoing is None:
        return
    if undoing.place:
        say(out, f"next: undo the fault of the data, in {undoing.place}:", undoing.paste, "then:", undoing.then)
    else:
        say(out, "next: undo the fault of the data:", undoing.paste)


@contextlib.contextmanager
def step(out: Console, text: str) -> Generator[None]:
    """Show a long step: a spinner at a terminal, else one line."""
    with shown(out, text):
        yield


def tell_others(receiver: Callable[[str], None]) -> None:
    """Have another program told the steps of commands, in place of the terminal."""
    _OTHERS.append(receiver)


@contextlib.contextmanager
def shown(out: Console, text: str) -> Generator[Callable[[str], None]]:
    """Show a line that changes at a terminal; elsewhere one line for every change."""
    if _OTHERS:
        _OTHERS[-1](text)
        yield _OTHERS[-1]
    elif out.is_terminal:
        with out.status(plain(text)) as status:
            yield lambda words: status.update(plain(words))
    else:
        say(out, f"{text} …")
        yield lambda words: say(out, words)


@contextlib.contextmanager
def telling(out: Console) -> Generator[Progress]:
    """Show the steps of a command as they begin; receiver of their words and their progress."""
    if _OTHERS:
        yield told(_OTHERS[-1])
        return
    with out.status("") if out.is_terminal else contextlib.nullcontext() as status:
        yield told(
            lambda words: say(out, words) if status is None else status.update(plain(words)), " …" * (status is None)
        )


def told(show: Callable[[str], None], ending: str = "") -> Progress:
    """One line for every step, and at most ten for what is counted."""
    from robustid.core import Pace

    paces: dict[str, Pace] = {}

    def progress(text: str, done: int, count: int) -> None:
        if not count:
            show(text + ending)
            return
        pace = paces.setdefault(text, Pace(done))
        if pace.seconds > _WORTH_SAYING and pace.another_tenth(done, count):
            show(pace.line(text, done, count))

    return progress


@contextlib.contextmanager
def resumable(out: Console, words: str, there: Callable[[], bool]) -> Generator[None]:
    """Say on Ctrl-C how an unfinished computation goes on, where something of it is there."""
    from robustid.core import Interruptible, pass_on

    with Interruptible() as steps:
        yield
    if steps.interrupted and there():
        warn(out, words)
    pass_on(steps.interrupted)


@contextlib.contextmanager
def in_words(words: dict[str, str]) -> Generator[None]:
    """Name options, and files, in place of Python's arguments."""
    try:
        yield
    except (InputError, InputTypeError, SolverError) as error:
        raise error.reworded(words) from None
