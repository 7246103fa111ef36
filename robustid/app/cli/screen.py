"""The terminal: the console, long steps and their progress, warnings, options named in the sentences of the library."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from robustid.app.cli.steps import tell
from robustid.errors import InputError, InputTypeError, SolverError, Status

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.status import Status as RichStatus

    from robustid.app.cli.terminal import Terminal
    from robustid.core import Progress, Record
    from robustid.data import Undoing
    from robustid.report import Document


class Context(Protocol):
    """Context of a command, as far as it is needed here."""

    @property
    def meta(self) -> Record:
        """Values that commands and their parents share."""
        ...


def called(context: Context) -> list[str]:
    """Command and arguments as they were called."""
    return context.meta.setdefault("robustid.called", [])


_OTHERS: list[Callable[[str], None]] = []  # programs that are told the steps, in place of the terminal
_MOST_FILES = 6  # that are named
_WORTH_SAYING = 2.0  # seconds that a step has taken
FAULTY = 4
_EXIT = {Status.CONSISTENT: 0, Status.INCONSISTENT: 3, Status.UNDECIDED: 1, Status.FAILED: 1}


def exit_code(status: Status, faulty: bool) -> int:
    """Exit code of a verdict on the class; of data with a fault that nothing has undone no proof is a success or a finding."""
    return FAULTY if faulty and status in (Status.CONSISTENT, Status.INCONSISTENT) else _EXIT[status]


def console(*, stderr: bool = False, verbose: bool = False) -> Terminal:
    """A console on the present stdout or stderr."""
    from robustid.app.cli.terminal import Terminal

    return Terminal(stderr=stderr, verbose=verbose)


def plain(text: str) -> str:
    """Text of users and files, with rich's markup neutralised."""
    from rich.markup import escape

    return escape(text)


def say(out: Terminal, *texts: str) -> None:
    """Print plain text, as it stands."""
    for text in texts:
        out.say(text)


def warn(out: Terminal, text: str) -> None:
    """Print a yellow sentence."""
    out.warned.append(text)
    out.say(text, "warning: ", "yellow")


def write(answer: Record, out: Terminal | None = None) -> None:
    """Write an answer as JSON on stdout, with the warnings that were printed and the commands to go on with."""
    from robustid.app.answers.form import text_of

    if out is not None:
        warnings = list(dict.fromkeys([*out.warned, *answer["warnings"]]))
        answer = answer | {"warnings": warnings, "next": answer["next"] or out.next}
    sys.stdout.write(text_of(answer))
    sys.stdout.flush()


def say_written(out: Terminal, *paths: Path | None) -> None:
    """Print the names of the files, on one line."""
    say(out, written_words([path for path in paths if path is not None]))


def written_words(files: Sequence[Path], most: int = _MOST_FILES) -> str:
    """The names of the files; of more in one folder, which has a page, the folder."""
    if len(files) > most and len({path.parent for path in files}) == 1:
        page = next((f"{path.name} and " for path in files if path.suffix == ".html"), "")
        from robustid.core import counted

        count = len(files) - bool(page)
        return f"written: {files[0].parent}{os.sep} with {page}{counted(count, 'more file')}"
    return "written: " + (", ".join(map(str, files)) or "nothing")


class Next(NamedTuple):
    """A command to go on with, as it is pasted, and what it is for."""

    what: str
    arguments: Sequence[str | Path]

    @property
    def command(self) -> str:
        """The line that is pasted."""
        from robustid.app.run.undoing import command_line

        return command_line([str(one) for one in self.arguments])

    @property
    def lines(self) -> list[str]:
        """Two lines."""
        return [f"next, {self.what}:", f"  {self.command}"]


def drawn(
    report: Path | None,
    draw: Callable[[], str],
    again: Sequence[str | Path],
    steps: Sequence[Next | str] | None,
    save: Callable[[], object] = lambda: None,
) -> tuple[Path | None, Sequence[Next | str] | None]:
    """Save what was found, the page last; the page, and the next steps.

    Nothing is written before the page is drawn, but after Ctrl-C, as a second one ends the program at once. A Ctrl-C while it is
    drawn loses the page alone: the next step is the command that draws it from the files, where there are some.
    """
    from robustid.app.cli.written_files import write_page
    from robustid.core import Interruptible, was_interrupted

    page, saved = None, report is None or was_interrupted()
    if saved:
        save()
    with Interruptible() as drawing:
        page = None if report is None else draw()
    if not saved:
        save()
    write_page(report, page)
    if not drawing.interrupted:
        return report, steps
    return None, [
        Next("the page, which Ctrl-C has left out", ["report", *again, "-o", str(report)])
    ] if again else steps


def next_lines(undoing: Undoing | None, steps: Sequence[Next | str]) -> list[str]:
    """Lines that undo a fault of the data, as they are pasted; else those of the steps."""
    if undoing is None:
        return [line for one in steps for line in (one.lines if isinstance(one, Next) else [f"next: {one}"])]
    step = undoing.fault.step
    what = f"next: {step[0].lower()}{step[1:]}"
    if undoing.place:
        head = f"{what}, in {undoing.place}:"
        return [head, f"  {undoing.paste}", "then:", f"  {undoing.then}"]
    return [f"{what}:", f"  {undoing.paste}"]


def conclude(
    out: Terminal,
    document: Document,
    everything: Callable[[], Iterable[RenderableType]],
    *,
    written: Iterable[Path | None] = (),
    undoing: Undoing | None = None,
    steps: Sequence[Next | str] | None = None,
) -> None:
    """Show what was found on one screen: the head of its page, the files, what to do next; or everything.

    `steps`: None for those of the page, which name no files.
    """
    from robustid.report import head_at_terminal

    own = [step.text for step in document.glance.next] if steps is None else steps
    files = [path for path in written if path is not None]
    out.next += [one.command if isinstance(one, Next) else one for one in own]
    tail = [written_words(files, _MOST_FILES if not out.verbose else len(files)), *next_lines(undoing, own)]
    if out.verbose:
        for one in everything():
            say(out, one) if isinstance(one, str) else out.print(one, highlight=False)
    else:
        tail[0] += " (-v prints all numbers)"
        out.print(head_at_terminal(document, out.width, out.left(tail)), highlight=False)
    say(out, *tail)


def tell_others(receiver: Callable[[str], None]) -> None:
    """Have another program told the steps of commands, in place of the terminal."""
    _OTHERS.append(receiver)


def _log(out: Terminal, words: str) -> None:
    """A line for a step where there is no terminal: it takes no place on a screen."""
    out.print(plain(words), highlight=False, soft_wrap=True)


class _Line(NamedTuple):
    """A place for words: whether they replace those before."""

    show: Callable[[str], None]
    changes: bool

    def __call__(self, words: str) -> None:
        self.show(words)


def _replace(status: RichStatus, words: str) -> None:
    from robustid.app.cli.terminal import Lasting

    status.update(Lasting(words))


@contextlib.contextmanager
def _line(out: Terminal) -> Generator[_Line]:
    """A line that changes at a terminal, with the seconds of its step; elsewhere one line for every change."""
    try:
        if _OTHERS:
            yield _Line(_OTHERS[-1], True)
        elif out.is_terminal:
            with out.status("") as status:
                yield _Line(functools.partial(_replace, status), True)
        else:
            yield _Line(functools.partial(_log, out), False)
    finally:
        tell("", shown=False)


@contextlib.contextmanager
def step(out: Terminal, text: str) -> Generator[None]:
    """Show a long step: a spinner at a terminal, else one line."""
    with shown(out, text):
        yield


@contextlib.contextmanager
def shown(out: Terminal, text: str) -> Generator[Callable[[str], None]]:
    """Show a line that changes at a terminal; elsewhere one line for every change."""
    with _line(out) as show:
        show(text if show.changes else f"{text} …")
        tell(text)
        yield show


@contextlib.contextmanager
def telling(out: Terminal) -> Generator[Progress]:
    """Show the steps of a command as they begin; receiver of their words and their progress."""
    with _line(out) as show:
        yield told(show, "" if show.changes else " …")


def told(show: Callable[[str], None], ending: str = "") -> Progress:
    """One line for every step, and at most ten for what is counted."""
    from robustid.core import Pace

    paces: dict[str, Pace] = {}

    def progress(text: str, done: int, count: int) -> None:
        if not count:
            show(text + ending)
            tell(text)
            return
        pace = paces.setdefault(text, Pace(done))
        if shown := pace.seconds > _WORTH_SAYING and pace.another_tenth(done, count):
            show(pace.line(text, done, count))
        tell(text, done, count, shown=shown)

    return progress


@contextlib.contextmanager
def resumable(out: Terminal, words: str, there: Callable[[], bool]) -> Generator[None]:
    """Say on Ctrl-C how an unfinished computation goes on, where something of it is there."""
    try:
        yield
    except KeyboardInterrupt:
        if there():
            warn(out, words)
        raise


@contextlib.contextmanager
def in_words(words: dict[str, str]) -> Generator[None]:
    """Name options, and files, in place of Python's arguments."""
    try:
        yield
    except (InputError, InputTypeError, SolverError) as error:
        raise error.reworded(words) from None
