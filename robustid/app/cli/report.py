"""robustid report: the page of a saved identification; robustid export: a file for another program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import Force, Static
from robustid.app.cli.screen import step
from robustid.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from robustid.advice import Sensitivity
    from robustid.guarantees import ResponseTube
    from robustid.identification import Identification, MixedProblem
    from robustid.report import Parts


def report(
    source: Annotated[Path, typer.Argument(help="A saved identification (NAME, NAME.npz or NAME.json).")],
    bounds: Annotated[
        list[Path] | None,
        typer.Option(help="Add what robustid bounds saved of it: NAME, and NAME-poles. Repeatable."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--step", min=1, help="Add the guaranteed range of the step response over N samples.")
    ] = None,
    sensitivity: Annotated[
        bool,
        typer.Option(
            "--sensitivity", help="Add how the guarantee moves with the assumptions and with the number of points."
        ),
    ] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="The HTML page.")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    reduce: Annotated[bool, typer.Option(help="Show the smallest model inside the bounds too.")] = True,
    static: Static = False,
    force: Force = False,
) -> None:
    """Write the report of a saved identification again; its claims are verified again from the numbers.

    [bold]Example[/bold]: robustid report result --bounds bounds --step 60 -o report.html
    """
    from robustid.advice import diagnose
    from robustid.app.load_save import load_result
    from robustid.errors import Status
    from robustid.reduction import reduce_within_bounds
    from robustid.report import render_summary, write_report

    inputs = [path for name in (source, *(bounds or [])) for path in written_files.sources(name)]
    written_files.check_outputs([output], inputs, force)
    console = screen.console()
    result = load_result(source, "identification")
    shown = _bounds(bounds or [], result)
    if reduce:
        with step(console, "searching for the smallest order"):
            shown["reduction"] = reduce_within_bounds(result)
    if steps is not None:
        shown["tube"] = _tube(console, result, steps)
    if sensitivity:
        shown["sensitivity"] = _sensitivity(console, result.problem)
    if result.status is Status.INCONSISTENT:
        with step(console, "what would help"):
            shown["diagnosis"] = diagnose(result).summary()
    with step(console, "verifying every certificate"):
        write_report(result, output, title=title, static=static, **shown)
    console.print(render_summary(result, shown.get("reduction")))
    screen.say_written(console, output)
    screen.repeat_warnings(console, result)
    raise typer.Exit(screen.EXIT[result.status])


def _bounds(paths: list[Path], result: Identification) -> Parts:
    """The bounds that were saved of the identification, by the argument of `write_report` that takes it."""
    from robustid.app.load_save import load_result
    from robustid.guarantees import WorstCaseOverPoles
    from robustid.report import same

    found: Parts = {}
    for file in paths:
        bound = load_result(file, "worst-case error", "band over poles")
        own: Parts = {"over_poles": bound} if isinstance(bound, WorstCaseOverPoles) else {"worst_case": bound}
        if found.keys() & own.keys():
            raise InputError(f"--bounds {file} is the second of its kind; give NAME once, and NAME-poles once")
        found |= own
        if not same(bound.identification, result):
            raise InputError(f"--bounds {file} is about another identification than the one reported")
    return found


def _tube(console: Console, result: Identification, samples: int) -> ResponseTube:
    from robustid.guarantees import response_tube

    with step(console, "bounding the step response"):
        return response_tube(result, input="step", horizon=samples)


def _sensitivity(console: Console, problem: MixedProblem) -> Sensitivity:
    from robustid.advice import sensitivity

    with step(console, "bounding the error under other assumptions"):
        return sensitivity(problem)


def export(
    source: Annotated[
        Path, typer.Argument(help="A saved result (NAME, NAME.npz or NAME.json), a model or measurements.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Of a model: .m, .mat, .npz, .json, .h (C), .sos, .zpk, or .csv (poles); of a response .csv, .mat, .npz, .uff or"
            " .s2p; of bounds .csv; of an identification its model, or with .csv its verdict.",
        ),
    ],
    force: Force = False,
) -> None:
    """Write a model, a response or a table for another program: MATLAB, C, JSON, filters, universal files, CSV.

    [bold]Example[/bold]: robustid export small.mat -o filter.h
    """
    from robustid.app.load_save import load, save

    written_files.check_outputs([output], written_files.sources(source), force)
    console = screen.console()
    thing = load(source)
    if output.suffix.lower() != ".csv" and type(thing).__name__ in (
        "Identification",
        "MatrixFraction",
        "WorstCaseError",
    ):
        thing = thing.model
    save(output, thing)
    screen.say_written(console, output)
