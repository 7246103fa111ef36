"""What every command shares: the console, long steps, how a run ends, and the files that it may write."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from robustid.errors import InputError, RobustIdError, SolverError

MISUSE, UNSOLVED, BUG, INTERRUPTED = 2, 1, 70, 130
# Arguments of the library that have an option of another name, or of the same.
_OPTIONS = {"gain_bound": "--gain", "decay_rate": "--decay", "unstable": "--keep-unstable"}
_OPTIONS |= {name: f"--{name}" for name in ("dt", "accuracy", "solver", "order", "tol", "repeat", "delay")}
_INTERRUPTED = "interrupted before the results were written"


def run(app: Callable[[], Any]) -> None:
    """Run the application; whatever happens ends with one sentence and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a pipe that can't take every letter gets a question mark
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    try:
        app()
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer's way to say Ctrl-C
            _end(_INTERRUPTED, INTERRUPTED)
        raise
    except KeyboardInterrupt:
        _end(_INTERRUPTED, INTERRUPTED)
    except SolverError as error:
        _end(f"[bold red]error:[/bold red] {plain(_spoken(str(error)))}", UNSOLVED)
    except RobustIdError as error:
        _end(f"[bold red]error:[/bold red] {plain(_spoken(str(error)))}", MISUSE)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        _end(f"[bold red]error:[/bold red] {plain(place + (error.strerror or str(error)))}", MISUSE)
    except Exception:
        # Not caught to hide it: the user is to know whose fault it is, and scripts to tell it from a finding.
        _end(f"[bold red]internal error, please report:[/bold red]\n{plain(traceback.format_exc())}", BUG)


def _end(sentence: str, code: int) -> None:
    out = console(stderr=True)
    out.print(sentence, highlight=False, soft_wrap=not out.is_terminal)
    sys.exit(code)


def _spoken(text: str) -> str:
    """A sentence of the library, with options in place of Python's arguments, and names of files as they stand."""
    text = re.sub(r"`path` = (['\"])(.*?)\1", r"\2", text).replace("`path`: ", "")
    return re.sub(r"`([^`]*)`", lambda found: _OPTIONS.get(found[1], found[1]), text)


def console(**options: Any) -> Any:
    """A rich console on the present stdout or stderr."""
    from rich.console import Console

    return Console(**options)


def plain(text: str) -> str:
    """Text of users and files, with rich's markup neutralised."""
    from rich.markup import escape

    return escape(text)


def warn(out: Any, text: str) -> None:
    """A yellow sentence."""
    out.print(f"[yellow]warning:[/yellow] {plain(text)}", highlight=False, soft_wrap=not out.is_terminal)


@contextlib.contextmanager
def step(out: Any, text: str) -> Iterator[None]:
    """A long step: a spinner at a terminal, else one line."""
    if out.is_terminal:
        with out.status(plain(text)):
            yield
    else:
        out.print(f"{plain(text)} …", highlight=False)
        yield


def result_files(output: Path) -> tuple[Path, Path]:
    """NAME.npz and NAME.json, which hold an identification."""
    if output.suffix.lower() in (".mat", ".csv", ".tsv", ".txt", ".html"):
        raise InputError(
            f"--output {output}: an identification is written as NAME.npz and NAME.json; leave {output.suffix} out"
        )
    if output.is_dir():
        raise InputError(f"--output {output} is a folder; give a name in it, such as {output / 'result'}")
    base = output.with_suffix("") if output.suffix in (".npz", ".json") else output
    return base.with_name(base.name + ".npz"), base.with_name(base.name + ".json")


def check_outputs(paths: Sequence[Path], inputs: Sequence[Path], force: bool) -> None:
    """Refuse, before anything is computed, what could not be written or would destroy something."""
    read = {path.resolve() for path in inputs}
    for path in paths:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give the name of a file in it")
        if path.resolve() in read:
            raise InputError(f"{path} is one of the files to be read; choose another name for the output")
        if [other.resolve() for other in paths].count(path.resolve()) > 1:
            raise InputError(f"{path} would be written twice; choose different names")
        if path.exists() and not force:
            raise InputError(f"{path} exists; choose another name, or pass --force to replace it")
        if not path.parent.is_dir():
            raise InputError(f"the folder {path.parent} does not exist; create it first")
        if not os.access(path.parent, os.W_OK):
            raise InputError(f"the folder {path.parent} can't be written to; choose another one")


def new_folder(wanted: Path) -> Path:
    """Create the folder, or the next free of its name with -2, -3, …"""
    folder, k = wanted, 1
    while True:
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            k += 1
            folder = wanted.with_name(f"{wanted.name}-{k}")
        except OSError as error:
            raise InputError(f"the folder {folder} can't be created: {error.strerror}; give another --output") from None
