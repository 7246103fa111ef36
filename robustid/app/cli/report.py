"""robustid report: the page of a saved identification."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import Force, Static
from robustid.app.cli.control import design_exit
from robustid.app.cli.screen import telling
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.advice import Sensitivity
    from robustid.app.run.work import Work
    from robustid.guarantees import ResponseTube
    from robustid.report import Parts


def report(
    source: Annotated[Path, typer.Argument(help="A saved identification or design (NAME, NAME.npz or NAME.json).")],
    bounds: Annotated[
        list[Path] | None, typer.Option(help="Add what robustid bounds saved of it: NAME, and NAME-poles. Repeatable.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--step", min=1, help="Add the guaranteed range of the step response over N samples.")
    ] = None,
    sensitivity: Annotated[
        bool,
        typer.Option(
            "--sensitivity",
            help="Add how the guarantee moves with the assumptions and with the number of points; of a design what smaller bounds"
            " and wider limits would bring, and where to measure: searches, which take minutes.",
        ),
    ] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="The HTML page.")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    reduce: Annotated[bool, typer.Option(help="Show the smallest model inside the bounds too.")] = True,
    static: Static = False,
    force: Force = False,
) -> None:
    """Write the report of a saved identification or design again; its claims are verified again from the numbers.

    [bold]Example[/bold]: robustid report result --bounds bounds --step 60 -o report.html
    """
    from robustid.app.load_save import load_result
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.sequence import diagnosed, reduced
    from robustid.app.run.work import Work
    from robustid.controllers import ControllerDesign
    from robustid.report import render_summary, write_report

    inputs = [path for name in (source, *(bounds or [])) for path in written_files.sources(name)]
    written_files.check_outputs([output], inputs, force)
    console = screen.console()
    with telling(console) as progress:
        result = load_result(source, "identification", "controller design", progress=progress)
        if isinstance(result, ControllerDesign):
            _of_identifications({"--bounds": bool(bounds), "--step": steps is not None, "--no-reduce": not reduce})
            progress("searching what would help" if sensitivity else "drawing the report", 0, 0)
            helping = result.improvements() if sensitivity else ()
            write_report(result, output, title=title, static=static, sensitivity=helping or None)
            screen.say(console, result.summary(), *(row.sentence for row in helping))
            screen.say_written(console, output)
            raise typer.Exit(design_exit(result))
        work = Work(run=RunFile(), identification=result, around=Surroundings(progress))
        _take_bounds(work, bounds or [])
        if reduce:
            reduced(work)
        shown: Parts = {"tube": None if steps is None else _tube(work, steps)}
        shown["sensitivity"] = _sensitivity(work) if sensitivity else None
        diagnosed(work)
        work.around.say("verifying every certificate")
        write_report(result, output, title=title, static=static, **{**work.parts, **shown})
    console.print(render_summary(result, work.reduction))
    screen.say_written(console, output)
    screen.repeat_warnings(console, result)
    raise typer.Exit(screen.exit_code(result.verified_status, bool(result.problem.open_faults)))


def _of_identifications(given: dict[str, bool]) -> None:
    """Refuse options that the page of a design has no place for."""
    for name, is_there in given.items():
        if is_there:
            raise InputError(f"{name} is about an identification, and this is a design; leave it out")


def _take_bounds(work: Work, paths: list[Path]) -> None:
    """The bounds that were saved of the identification."""
    from robustid.app.load_save import load_result
    from robustid.guarantees import WorstCaseOverPoles
    from robustid.report import same

    for file in paths:
        bound = load_result(file, "worst-case error", "band over poles")
        if (work.over_poles if isinstance(bound, WorstCaseOverPoles) else work.error) is not None:
            raise InputError(f"--bounds {file} is the second of its kind; give NAME once, and NAME-poles once")
        if not same(bound.identification, work.identification):
            raise InputError(f"--bounds {file} is about another identification than the one reported")
        if isinstance(bound, WorstCaseOverPoles):
            work.over_poles = bound
        else:
            work.error = bound


def _tube(work: Work, samples: int) -> ResponseTube:
    from robustid.guarantees import response_tube

    work.around.say("bounding the step response")
    return response_tube(work.identification, input="step", horizon=samples)


def _sensitivity(work: Work) -> Sensitivity:
    from robustid.advice import sensitivity

    work.around.say("bounding the error under other assumptions")
    return sensitivity(work.identification.problem)
