"""robustid control: a controller of fixed structure for every plant that the data allow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Output, Report, Static, Verbose, words_of
from robustid.app.cli.loops import MeasuredPlant, read_files
from robustid.app.cli.screen import Next, in_words, telling
from robustid.app.run.checks import options
from robustid.app.run.controller_settings import ControllerChoice
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from robustid.controllers import ControllerDesign
    from robustid.core import Options
    from robustid.guarantees import Band

_NAMED = 3  # sources of several that limit most


def control(
    *,
    source: Annotated[
        list[Path],
        typer.Argument(
            help="Folder of a run, a saved band, a saved loop or an identification; of several (amplitudes, positions, loads) one"
            " controller is designed for all."
        ),
    ],
    asked: ControllerChoice,
    time_limit: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Time after which the best controller so far is taken.")
    ] = None,
    output: Output = Path("controller"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Design a controller of a structure that keeps its limits with every plant that the data allow, and prove it.

    Frequencies are in Hz. The design is written with its proof, which [bold]robustid verify[/bold] makes again, the controller as
    a model NAME-controller.npz.

    [bold]Example[/bold]: robustid control bench --structure "PID(80), Notch(30..40)" --peak 2 --gain-margin 2 --report new.html

    Exit codes: 0 proved, 3 none was found for this structure (a finding), 4 either, but of data with a fault that nothing has
    undone, 1 found but not proved, or not found in time, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.load_save import save
    from robustid.controllers import design_controller
    from robustid.core import Interruptible
    from robustid.report import first_screen, render_report

    console = screen.console(stderr=as_json, verbose=verbose)
    written_files.check_static(report, static)
    flags = {field.name: str(option.flag) for field, option in options(ControllerChoice)}
    if not asked.is_stated:
        raise InputError('--structure is missing: what the drive runs, such as --structure "PID(80)"')
    files, model = written_files.result_files(output), written_files.beside(output, "-controller.npz")
    read = [file for one in source for file in read_files(one)]
    written_files.check_outputs([*files, model, report], [*read, *map(Path, asked.files)], force)
    words = words_of(control, time_limit="--time-limit", bands="the source", band="the band", loop="the loop")
    words |= asked.words(flags.__getitem__) | {"identification": "the identification"}
    with in_words(words), telling(console) as progress:
        limits, structure = asked.limits, asked.read(flags.__getitem__)
        plants: list[MeasuredPlant] = []
        for one in source:
            progress(f"reading {one}", 0, 0)
            plants.append(MeasuredPlant.of(one, progress))
        how: Options = {"limits": limits, "maximise": asked.goal, "time_limit": time_limit, "progress": progress}
        found = design_controller([one.plants for one in plants], structure, **how)
        usable = found.status.name in (
            "PROVED",
            "FOUND",
        )  # the closest one of a design that found none is in its file alone

        def keep() -> None:
            found.save(output)
            if usable:
                save(model, found.controller)
            else:
                model.unlink(missing_ok=True)  # that of an earlier design, which --force replaces

        with Interruptible() as saving:
            keep()
        if saving.interrupted:  # once more; a second Ctrl-C ends the program at once
            keep()
        steps = _next(found, model) if found.status.name == "PROVED" else None
        title = f"Controller for {source[0].stem}" if len(source) == 1 else None

        def draw() -> str:
            return render_report(found, title=title, static=static, progress=progress)

        report, steps = screen.drawn(report, draw, [written_files.stem(output)], steps)
    written = [*files, model if usable else None, report]
    head, code = first_screen(found), design_exit(found, [one.band for one in plants])
    screen.conclude(console, head, lambda: [found.summary()], written=written, steps=steps)
    if len(source) > 1:
        dear = [f"{source[k]} ({name}, {100 * share:.4g} %)" for k, name, share in found.limiting_bands[:_NAMED]]
        screen.say(console, *([f"most of a limit is taken by the plants of {', '.join(dear)}"] if dear else []))
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.designed(found, head, code, written), console)
    raise typer.Exit(code)


def design_exit(found: ControllerDesign, bands: Sequence[Band] = ()) -> int:
    """Exit code of a design for the plants of bands; default: of those that its proofs are about."""
    status = {"PROVED": Status.CONSISTENT, "NONE": Status.INCONSISTENT}.get(found.status.name, Status.UNDECIDED)
    about = bands or [one.band for one in found.proofs]
    return screen.exit_code(status, any(one.problem.open_faults for one in about))


def _next(found: ControllerDesign, model: Path) -> list[Next | str]:
    """The controller for a drive; of a continuous one as a script."""
    name, ending = model.with_suffix(""), ".c" if found.controller is not None and found.controller.dt else ".m"
    endings = (ending, ".h") if ending == ".c" else (ending,)
    what = "the controller as C" if ending == ".c" else "the controller for MATLAB"
    return [Next(what, ["export", model, "-o", f"{written_files.free(name, *endings)}{ending}"])]
