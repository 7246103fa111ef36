"""What commands share: the long part of `robustid identify` and `demo`, progress, the files of a result, words of options."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from robustid.app.cli import terminal
from robustid.app.cli.terminal import plain, step
from robustid.errors import InputError, InputTypeError, SizeError, SolverError, Status

EXIT = {Status.CONSISTENT: 0, Status.INCONSISTENT: 3, Status.UNDECIDED: 1, Status.FAILED: 1}


def identified(
    console: Any,
    proposal: Any,
    objective: str = "center",
    solver: str = "auto",
    accuracy: float = 1e-4,
    form: str = "auto",
) -> Any:
    """The identification, with the choices of the proposal as its notes."""
    from robustid.identification import identify as solve

    problem = proposal.problem
    with step(console, f"margin and model: {problem.coefficients} coefficients, {problem.samples} samples"):
        result = solve(problem, objective=objective, solver=solver, accuracy=accuracy, form=form)
    return dataclasses.replace(result, notes=proposal.choices)


def finish(
    console: Any, result: Any, output: Path, report: Path | None, *, reduce: bool, title: str | None = None
) -> None:
    """Compute and render the rest; only then write, and show what was found."""
    from robustid.advice import diagnose
    from robustid.core import atomic_write
    from robustid.reduction import reduce_within_bounds
    from robustid.report import render_report, render_summary

    reduction, diagnosis, page = None, "", ""
    if reduce:
        with step(console, "searching for the smallest order"):
            reduction = reduce_within_bounds(result)
    if not result.consistent:
        with step(console, "what would help: other modes, other priors"):
            diagnosis = diagnose(result).summary()
    if report is not None:
        page = render_report(result, reduction=reduction, title=title)
    summary, written = render_summary(result, reduction), list(terminal.result_files(output))
    result.save(output)
    if report is not None:
        with atomic_write(report) as file:
            file.write(page)
        written.append(report)
    console.print(summary)
    if diagnosis:
        console.print("\n" + plain(diagnosis), highlight=False)
    say_written(console, *written)
    repeat_warnings(console, result)


def say_written(console: Any, *paths: Path) -> None:
    """The names of the files, on one line."""
    console.print(plain("written: " + ", ".join(str(path) for path in paths)), highlight=False, soft_wrap=True)


def repeat_warnings(console: Any, result: Any) -> None:
    """What must not scroll away."""
    for sentence in result.warnings:
        terminal.warn(console, sentence)


@contextlib.contextmanager
def size_in_options() -> Iterator[None]:
    """Name the options that take a part of the data, where they are too many."""
    try:
        yield
    except SizeError as error:
        count = str(error).split(". ")[0].replace("`problem` has", "the data make")
        raise SizeError(
            f"{count}. Use a part of them: --band LOW:HIGH keeps the lines between two frequencies in Hz, --first N the"
            " first N time samples"
        ) from None


@contextlib.contextmanager
def shown(console: Any, text: str) -> Iterator[Callable[[str], None]]:
    """A line that changes at a terminal; elsewhere one line for every change."""
    if console.is_terminal:
        with console.status(plain(text)) as status:
            yield lambda words: status.update(plain(words))
    else:
        console.print(f"{plain(text)} …", highlight=False, soft_wrap=True)
        yield lambda words: console.print(plain(words), highlight=False, soft_wrap=True)


@contextlib.contextmanager
def in_words(words: dict[str, str]) -> Iterator[None]:
    """Name options, and files, in place of Python's arguments."""
    try:
        yield
    except (InputError, InputTypeError, SolverError) as error:
        text = re.sub(r"`(\w+)`", lambda found: words.get(found[1], found[0]), str(error))
        raise type(error)(text) from None


def sources(path: Path) -> list[Path]:
    """The files that may be read for `path`."""
    from robustid.core import paths

    return [path, *paths(path)]
