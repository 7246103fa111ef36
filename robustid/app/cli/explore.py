"""robustid explore: one live page of data, or of a controller; robustid demo: the whole way on a simulated structure."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import Static, Verbose, only, words_of
from robustid.app.cli.experiment import frf
from robustid.app.cli.identify import conclude, work_on
from robustid.app.cli.screen import Next, in_words, say, shown, telling, told
from robustid.app.cli.steps import Step, tell
from robustid.app.run.settings import FrequencyPoints, General
from robustid.app.run.sources import Estimate, RecordSource, ResponseSource
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.app.cli.terminal import Terminal
    from robustid.app.explore.tuning import Tuning
    from robustid.app.run.reading import Tables
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.work import Work
    from robustid.core import Options, Progress
    from robustid.data import SimulatedExperiment

_SIDES = 6  # of the polygons around the errors of the demo at each frequency


def explore(
    *,
    file: Annotated[
        list[Path] | None,
        typer.Argument(
            help="A frequency response, time records of one plant, a run file, or a saved controller design. Default: the data of"
            " the demo."
        ),
    ] = None,
    responses: ResponseSource,
    records: Annotated[RecordSource, only("fields", "dt", "rate", "axes", "decimal", "initial", "correct")],
    estimate: Estimate,
    points: FrequencyPoints,
    general: Annotated[General, only("entry")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of this machine. Default: a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    r"""Change modes, gain bound and lines by hand, on a page where margin, band and verdict follow.

    The page is served on this machine, to nobody else, until Ctrl-C; nothing is fetched from a network. Every choice can be written
    as a run file that gives the same again. Of a matrix every entry has a page, and of a family, which a run file states,
    every member. Needs robustid\[explore].

    Of a controller design: tune it by hand; worst cases over all plants follow, the proof comes when asked, and it is written as a
    model.

    [bold]Example[/bold]: robustid explore frf.csv --frequency-bound 0.03
    """
    from robustid.app.explore.server import serve
    from robustid.app.explore.views import views
    from robustid.app.run.reading import Tables
    from robustid.core import pass_on, saved_kind, was_interrupted

    console, stated = screen.console(), _Stated(responses, records, estimate, points, general)
    files = file or []
    if len(files) == 1 and saved_kind(files[0]) is not None:
        with in_words({"port": "--port"}):
            with telling(console) as progress:
                tuning = _tuned(files[0], stated, progress)
            pass_on(was_interrupted())  # a loop has kept Ctrl-C back: nobody waits for a page
            serve(tuning, f"Tuning of {files[0].name}", port, lambda address: _opened(console, address, browser))
        say(console, "closed")
        return
    tables = Tables()
    run, folder, title = _asked(console, files, stated, tables)
    with in_words(words_of(frf, record="FILE") | {"entry": "--entry", "port": "--port"}):
        with shown(console, "choosing what is not stated") as show:
            every = views(run, folder, told(show), tables)
            session = every[0].open(told(show))
        pass_on(was_interrupted())
        serve(session, title, port, lambda address: _opened(console, address, browser), every)
    say(console, "closed")


class _Stated(NamedTuple):
    """Options about data."""

    response: ResponseSource
    record: RecordSource
    estimate: Estimate
    points: FrequencyPoints
    general: General

    @property
    def is_empty(self) -> bool:
        """True if none is given."""
        return self == (ResponseSource(), RecordSource(), Estimate(), FrequencyPoints(), General())


def _asked(console: Terminal, files: list[Path], stated: _Stated, tables: Tables) -> tuple[RunFile, Path, str]:
    """The run file of files, the folder that its names are seen from, and the title of the page."""
    from robustid.app.cli.measured_files import Files
    from robustid.app.run.run_file import RunFile, read_run_file
    from robustid.app.run.settings import Withheld
    from robustid.formats import origin

    entry = stated.general.entry
    if not files:
        if not stated.is_empty:
            raise InputError("options of data are given without a FILE: name it, or leave them out")
        folder = written_files.new_folder(Path("robustid-demo"))
        _measurements(console, folder)
        frequency, record = ResponseSource(file="frequency.csv"), RecordSource(file="step.csv", use="samples")
        return RunFile(frequency=(frequency,), record=(record,)), folder, "robustid demo"
    if runs := [one for one in files if one.suffix == ".toml"]:
        if len(files) > 1:
            raise InputError(f"{runs[0]} names its data itself: give it alone")
        if not stated._replace(general=General()).is_empty:
            raise InputError(f"{runs[0]} says itself how its data are read: leave the options of data out")
        run = read_run_file(runs[0])
        return (
            run if entry is None else dataclasses.replace(run, entry=entry),
            runs[0].parent,
            run.title or runs[0].name,
        )
    fields, decimal = stated.record.fields, stated.record.decimal
    kinds = [origin(tables.of(one, decimal), "frequency", stated.response.fields).kind for one in files]
    named = [os.path.relpath(one, files[0].parent) for one in files]
    title = ", ".join(one.name for one in files)
    # All that is shown is used.
    how: Options = {"entry": entry, "frequency_points": stated.points, "withheld": Withheld(every=0)}
    if set(kinds) == {"time"} or fields is not None:
        asked = Files(paths=files, source=stated.record, entry=entry, tables=tables)
        sources = tuple(dataclasses.replace(stated.record, file=name, use="response") for name in named)
        run = RunFile(record=sources, estimate=stated.estimate, **how)
    else:
        if len(files) > 1:
            raise InputError(
                "several files are time records of one plant; several responses stand in a run file, [[frequency]]"
            )
        asked = Files(
            paths=files, source=stated.response, entry=entry, band_hz=stated.points.band_hz, bounded=True, tables=tables
        )
        run = RunFile(frequency=(dataclasses.replace(stated.response, file=named[0]),), **how)
    asked.read(console)  # says what is wrong, in options
    return run, files[0].parent, title


def _tuned(file: Path, stated: _Stated, progress: Progress) -> Tuning:
    """The design of a file, to be tuned."""
    from robustid.app.explore.tuning import Tuning
    from robustid.app.load_save import load_result
    from robustid.core import saved_kind

    if not stated.is_empty:
        raise InputError(f"{file} is a saved result: leave the options of data out")
    if (kind := saved_kind(file)) not in (None, "controller design"):
        raise InputError(
            f"{file} is a saved {kind}: the live page takes measurements, a run file or a saved controller design;"
            f" robustid report {file} shows it"
        )
    return Tuning.of(load_result(file, "controller design", progress=progress))


def _opened(console: Terminal, address: str, browser: bool) -> None:
    """Say the address, and open it."""
    import webbrowser

    say(console, f"the page: {address}")
    if browser and not webbrowser.open(address):
        say(console, "no browser was found: open that address in one on this machine")
    say(console, "Ctrl-C ends it")
    Step.usual = ""
    tell("", shown=False)  # from here on it is silent


def _measurements(console: Terminal, folder: Path, seed: int = 0) -> SimulatedExperiment:
    """Write the measurements of the demo into a folder; what they are of."""
    import numpy as np

    from robustid.data import flexible_structure, save

    data = flexible_structure(seed=seed, extra_hz=list(np.linspace(17.2, 18.1, 10)))
    for name, item in (("frequency.csv", data.frequency), ("step.csv", data.time)):
        save(folder / name, item)
    screen.say(console, f"measurements written: {folder / 'frequency.csv'}, {folder / 'step.csv'}")
    return data


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the results; if it exists, the next free name.")
    ] = Path("robustid-demo"),
    static: Static = False,
    seed: Annotated[int, typer.Option(min=0, help="Noise of the simulated measurements.")] = 0,
    verbose: Verbose = False,
) -> None:
    """Identify a simulated mass-beam structure, from measurements to a report. About ten seconds.

    Frequency points from 1 to 21 Hz and a step response, noise bounded by 0.03; modes at 9 Hz (well damped) and 17.67 Hz
    (damping ratio 0.004). The program finds the modes and the prior by itself.
    """
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.sequence import bounded, diagnosed, gridded, proved, reduced, refined
    from robustid.app.run.work import carry_out

    console = screen.console(verbose=verbose)
    folder = written_files.new_folder(output)
    data = _measurements(console, folder, seed)
    page = folder / "report.html"
    hz = (0.5, 3, 6, 8, 9, 10, 12, 14, 15.5, 16.3, 17, 17.4, 17.6, 17.67, 17.74, 18, 19, 21, 25, 32, 40, 50)
    with telling(console) as progress:
        around = Surroundings(progress)
        with around.stops.listening():
            work = work_on([data.frequency], [data.time], around)
        work.run = work.run.changed("worst_case", at_hz=hz, directions=_SIDES)
        carry_out(work, [gridded, bounded, lambda work: _keep(work, folder), proved, reduced, diagnosed, refined])
    look = Next("the same by hand, from the file on", ["look", str(folder / "frequency.csv")])
    steps = [f"open {page} in a browser", look]
    conclude(console, work, folder / "result", page, steps=steps, static=static, title="robustid demo")
    found = work.identification
    raise typer.Exit(screen.exit_code(found.verified_status, bool(found.problem.open_faults)))


def _keep(work: Work, folder: Path) -> None:
    """Save the bounds."""
    if work.error is not None:
        work.error.save(folder / "bounds")
