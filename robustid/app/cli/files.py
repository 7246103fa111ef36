"""robustid look: what is in files; robustid new: a commented run file made from such looks; robustid export: files for others."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Verbose
from robustid.app.cli.screen import Next, say
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from robustid.app.cli.terminal import Terminal
    from robustid.app.look import Look

_MOST_SAID = 5  # sentences on a file


def look(
    files: Annotated[list[Path], typer.Argument(help="Files of any kind that robustid reads.")],
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Show what is in files: names, shapes, ranges, what looks odd, and the lines to go on with.

    [bold]Example[/bold]: robustid look bench.mat

    Exit codes: 0 nothing wrong is seen, 4 data with a fault, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.look import look as looked

    console = screen.console(stderr=as_json, verbose=verbose)
    found = [looked(path).for_terminal() for path in files]
    if verbose:
        say(console, *(one.summary() for one in found))
    else:
        _on_screen(console, found)
    code = screen.FAULTY if any(one.faulty for one in found) else 0
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.looked(found, code), console)
    raise typer.Exit(code)


def _on_screen(console: Terminal, looks: list[Look]) -> None:
    """Print several looks on one screen: first sentences, the command to go on with, and contents where there is a line left."""
    from robustid.core import in_short

    def short(words: str) -> str:
        return words[0] + in_short(words)[0][1:]

    heads = [f"{one.path}: {one.how}" for one in looks]
    tails = [[short(words) for words in one.sentences[:_MOST_SAID]] for one in looks]
    for tail, one in zip(tails, looks, strict=True):
        if (more := len(one.sentences) - len(tail)) > 0:
            tail.append(f"and {more} more (-v)")
        tail += _next(one)
    left = console.left([*heads, *(line for tail in tails for line in tail)]) // len(looks)
    for head, one, tail in zip(heads, looks, tails, strict=True):
        rows = one.contents(left if left >= len(one.rows) else max(left - 1, 0)) if left > 1 else []
        say(
            console,
            head,
            *(row if len(row) <= console.width else f"{row[: console.width - 1]}…" for row in rows),
            *tail,
        )


def _next(found: Look) -> list[str]:
    """The command to go on with, to files that are not there yet."""
    (what, called), name = found.step, Path(found.path).stem
    if not called or (found.found is None and not found.arguments):
        return []
    if called[0] in ("new", "export"):
        ending = ".toml" if called[0] == "new" else ".m"
        written = ["-o", f"{written_files.free(Path(name), ending)}{ending}"]
    else:
        ending = {"identify": "model", "fit": "fit", "frf": "response"}[called[0]]
        new = written_files.free(Path(f"{name}-{ending}"), ".npz", ".json", ".html")
        written = ["-o", f"{new}.npz", "--report", f"{new}.html"]
    return Next(what, [*called, *written]).lines


def new(
    files: Annotated[list[Path], typer.Argument(help="Measurements: records or frequency responses.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The run file, which must not exist.")] = Path(
        "run.toml"
    ),
) -> None:
    """Write a commented run file for measurements, ready to edit; robustid run takes it.

    [bold]Example[/bold]: robustid new bench.mat -o bench.toml
    """
    from robustid.app.draft import drafted_run_file
    from robustid.app.look import look
    from robustid.core import atomic_write

    written_files.check_outputs([output], files, None)
    console = screen.console()
    draft = drafted_run_file([look(path) for path in files], output.parent)
    with atomic_write(output) as file:
        file.write(draft.text)
    screen.say_written(console, output)
    say(console, *(f"edit first: {line}" for line in draft.edits))
    say(
        console,
        *Next("everything, in a folder", ["run", output, "-o", written_files.free(Path(output.stem), "")]).lines,
    )


def export(
    source: Annotated[
        Path, typer.Argument(help="A saved result (NAME, NAME.npz or NAME.json), a model or measurements.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Of a model: .m, .mat, .npz, .json, .h (C), .sos, .zpk, or .csv (poles); of a controller .c or .h (C with limits"
            " and anti-windup); of a response .csv, .mat, .npz, .uff or .s2p; of bounds .csv; of an identification its model, or"
            " with .csv its verdict.",
        ),
    ],
    controller: Annotated[
        bool,
        typer.Option(
            "--controller", help="Of a model in .h: it is a controller, with limits and anti-windup, as in .c always."
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Write a model, a controller, a response or a table for another program: MATLAB, C, JSON, filters, universal files, CSV.

    A controller as .c has its declarations in the .h of the same name.

    [bold]Example[/bold]: robustid export small.mat -o filter.h
    [bold]Example[/bold]: robustid export controller.npz -o controller.c
    """
    from robustid.app.load_save import save

    ending = output.suffix.lower()
    if controller and ending not in (".c", ".h"):
        raise InputError(f"--controller is for C, with -o NAME.c or NAME.h; got {output.name}")
    outputs = [output, output.with_suffix(".h")] if ending == ".c" else [output]
    written_files.check_outputs(outputs, written_files.sources(source), force)
    console = screen.console()
    thing = _loaded(source)
    if controller or ending == ".c":
        from robustid.app.exports import write_controller_c

        write_controller_c(output, thing)
        screen.say_written(console, *outputs)
        return
    if output.suffix.lower() != ".csv" and type(thing).__name__ in (
        "Identification",
        "MatrixFraction",
        "WorstCaseError",
    ):
        thing = thing.model
    save(output, thing)
    screen.say_written(console, output)


def _loaded(source: Path) -> Any:
    """Load a file that says itself what it holds."""
    from robustid.app.load_save import load

    try:
        return load(source)
    except (InputError, InputTypeError) as error:
        if error.remedy or error.argument in ("fields", "frequency_unit", "axes"):
            line = f"robustid look {shlex.quote(str(source))}"
            raise InputError(f"{source} can't be read as it is: {line} says what is missing") from None
        raise
