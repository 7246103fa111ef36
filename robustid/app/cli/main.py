"""The command line: `robustid run`, `explore`, `excite`, `frf`, `identify`, `fit`, `bounds`, `verify`, `reduce`, ..."""

from __future__ import annotations

import importlib
import inspect
import sys
import traceback
from collections.abc import Callable
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from robustid._version import __version__
from robustid.app.cli import screen
from robustid.app.cli.command_options import FLAGS, EndedEarly, opened
from robustid.app.cli.help_page import Explained, parameters, show_help
from robustid.app.cli.screen import console
from robustid.app.cli.steps import BEFORE_RESULTS, INTERRUPTED, Step, tell
from robustid.errors import RobustIdError, SolverError
from robustid.spellings import command_meant

_START, _MEASURE, _MODEL, _LOOP = "Start", "Measure", "Model and proof", "Controllers and loops"
COMMANDS = {  # in the order of the list, with the file of each
    "demo": "explore",
    "look": "files",
    "identify": "identify",
    "new": "files",
    "run": "run",
    "excite": "experiment",
    "frf": "experiment",
    "fit": "fit",
    "bounds": "bounds",
    "reduce": "reduce",
    "compare": "compare",
    "verify": "verify",
    "refute": "refute",
    "watch": "watch",
    "report": "report",
    "export": "files",
    "explore": "explore",
    "loop": "loops",
    "connect": "loops",
    "control": "control",
    "serve": "serve",
}
_HEADINGS: dict[str, str] = {
    **dict.fromkeys(("demo", "look", "identify", "new", "run"), _START),
    **dict.fromkeys(("excite", "frf"), _MEASURE),
    **dict.fromkeys(("loop", "connect", "control"), _LOOP),
}
MISUSE, UNSOLVED, BUG = 2, 1, 70
# Arguments of the library that have an option of another name, or of the same.
_OPTIONS = {**FLAGS, "unstable": "--keep-unstable", "order": "--order", "tol": "--tol"}
_EARLY = "interrupted: what was found by then is written"


def _first_sentence(text: str) -> str:
    return text.split("\n\n", maxsplit=1)[0].replace("\n", " ")


def _command(name: str) -> Callable[..., None]:
    return getattr(importlib.import_module(f"robustid.app.cli.{COMMANDS[name]}"), name)


def _help(name: str) -> str:
    return inspect.cleandoc(_command(name).__doc__ or "")


class Commands(TyperGroup):
    """Commands whose options are read when one is called, not when all are listed: this keeps the start quick."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is called, with its options."""
        screen.called(ctx).extend(args)
        if args[0] not in COMMANDS and (found := command_meant(args[0])) is not None:
            ctx.fail(
                f"No such command {args[0]!r}; robustid {found} is what you look for: {_first_sentence(_help(found))}"
            )
        name, command, rest = super().resolve_command(ctx, args)
        if name is None or command is None:
            return name, command, rest
        if name != "serve":  # which speaks to another program until it is ended
            Step.usual, Step.stderr = f"robustid {name}", "--json" in rest
            tell("", shown=False)
        alone = typer.Typer(add_completion=False, rich_markup_mode="rich")
        alone.command(name, cls=Explained)(opened(_command(name)))
        return name, typer.main.get_command(alone), rest

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help: the commands by what they are for, then the options."""
        del formatter
        commands = [self.get_command(ctx, name) for name in self.list_commands(ctx)]
        rows = [(one, str(one.name), _first_sentence(one.help or "")) for one in commands if one is not None]
        show_help(self, ctx, [*rows, *parameters(self, ctx)], 12)


app = typer.Typer(
    name="robustid",
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="""Models with a proof, for lightly damped machines.

    Start with [bold]robustid demo[/bold]. With your own data: [bold]robustid identify --frequency frf.csv --time step.csv
    --dt 0.01 --frequency-bound 0.03 --time-bound 0.03[/bold]. From recorded signals: [bold]robustid frf[/bold] makes the
    frequency response and its bound; [bold]robustid excite[/bold] designs what to play.

    Exit codes: 0 consistent or proved, 3 inconsistent or refuted (a finding, with its proof), 4 either, but of data with a fault
    that nothing has undone, 1 undecided or not solved, 2 misuse, 70 an error of the program, 130 interrupted.""",
)


def _listed(name: str) -> Callable[[], None]:
    """A command without options, for the list."""

    def command() -> None:
        raise NotImplementedError(name)  # called with its options: see Commands

    command.__doc__ = _command(name).__doc__
    return command


for _name in COMMANDS:
    app.command(_name, rich_help_panel=_HEADINGS.get(_name, _MODEL))(_listed(_name))


def _show_version(wanted: bool) -> None:
    if wanted:
        console().print(f"robustid {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Options of the program itself."""


def main() -> None:
    """Carry a command out: every run ends with an exit code, and misuse with one sentence."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a pipe that can't take every letter gets a question mark
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    try:
        app(prog_name="robustid")
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer's way to say Ctrl-C
            end(BEFORE_RESULTS, INTERRUPTED, "stopped")
        if stop.code == MISUSE:  # said by typer
            _answer("the options can't be read; stderr says which", MISUSE, "refused")
        raise
    except EndedEarly:
        _say(_EARLY, INTERRUPTED)  # its answer says so too
    except KeyboardInterrupt:
        end(BEFORE_RESULTS, INTERRUPTED, "stopped")
    except RobustIdError as error:
        code, status = (UNSOLVED, "failed") if isinstance(error, SolverError) else (MISUSE, "refused")
        end(error.said(_OPTIONS, unknown=str), code, status, "error: ", error)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        end(place + (error.strerror or str(error)), MISUSE, "refused", "error: ")
    except Exception as error:
        if _of_ctrl_c(error):
            end(BEFORE_RESULTS, INTERRUPTED, "stopped")
        # Not caught to hide it: the user is to know whose fault it is, and scripts to tell it from a finding.
        end(traceback.format_exc(), BUG, "broken", "internal error, please report:\n")


def _of_ctrl_c(error: BaseException | None) -> bool:
    """Return whether a library has made this error of a Ctrl-C."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def end(sentence: str, code: int, status: str, head: str = "", error: RobustIdError | None = None) -> NoReturn:
    """End the program with a sentence, and with its answer where one is asked for."""
    _answer(sentence, code, status, error)
    _say(sentence, code, head)


def _say(sentence: str, code: int, head: str = "") -> NoReturn:
    console(stderr=True).say(sentence, head, "bold red")
    sys.exit(code)


def _answer(sentence: str, code: int, status: str, error: RobustIdError | None = None) -> None:
    """Write the answer where one is asked for and nothing was found."""
    if "--json" in sys.argv[1:]:
        from robustid.app.answers.form import ended

        command = next((word for word in sys.argv[1:] if word in COMMANDS), "")
        screen.write(ended(command, status, sentence, code, error))
