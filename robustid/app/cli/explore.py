"""robustid explore: one live page."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import typer

from robustid.app.cli import outputs, terminal
from robustid.app.cli.options import only
from robustid.app.cli.terminal import in_words, say, shown
from robustid.app.options import General
from robustid.app.sources import RecordSource, ResponseSource
from robustid.errors import InputError


def explore(
    *,
    file: Annotated[
        Path | None, typer.Argument(help="A frequency response, or a run file. Default: the data of the demo.")
    ] = None,
    responses: ResponseSource,
    general: Annotated[General, only("entry")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of this machine. Default: a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    r"""Change modes, gain bound and lines by hand, on a page where margin, band and verdict follow.

    The page is served on this machine, to nobody else, until Ctrl-C; nothing is fetched from a network. Every choice can be written
    as a run file that gives the same again. One input and one output: of a matrix say which --entry. Needs robustid\[explore].

    [bold]Example[/bold]: robustid explore frf.csv --frequency-bound 0.03
    """
    from robustid.app.explore.server import serve
    from robustid.app.explore.session import Session

    console = terminal.console()
    run, folder, title = _asked(console, file, responses, general)
    with in_words({"entry": "--entry", "port": "--port"}):
        with shown(console, "choosing what is not stated") as show:
            session = Session.of(run, folder, lambda text, done=None, count=None: show(text) if done is None else None)
        serve(session, title, port, lambda address: _opened(console, address, browser))
    say(console, "closed")


def _asked(console: Any, file: Path | None, source: ResponseSource, general: General) -> tuple[Any, Path, str]:
    """The run file of a file, the folder that its names are seen from, and the title of the page."""
    from robustid.app.cli.reading import Files
    from robustid.app.options import Withheld
    from robustid.app.run_file import RunFile, read_run_file
    from robustid.formats import origin

    if file is not None and file.suffix == ".toml":
        if source != ResponseSource():
            raise InputError(f"{file} says itself how its data are read: leave the options of frequency responses out")
        run = read_run_file(file)
        run = run if general.entry is None else dataclasses.replace(run, entry=general.entry)
        return run, file.parent, run.title or file.name
    if file is None:
        if source != ResponseSource() or general.entry is not None:
            raise InputError("options of a frequency response are given without a FILE: name it, or leave them out")
        folder = _demo(console)
        frequency, record = ResponseSource(file="frequency.csv"), RecordSource(file="step.csv", use="samples")
        return RunFile(frequency=(frequency,), record=(record,)), folder, "robustid demo"
    if origin(file, "frequency", source.fields, source.decimal).kind == "time":
        raise InputError(
            f"{file} holds time data: make a response of it with robustid frf, or a run file with robustid new, and explore that"
        )
    Files(paths=[file], source=source, entry=general.entry, bounded=True).read(
        console
    )  # says what is wrong, in options
    run = RunFile(
        frequency=(dataclasses.replace(source, file=file.name),),
        entry=general.entry,
        withheld=Withheld(every=0),  # all that is shown is used
    )
    return run, file.parent, file.name


def _demo(console: Any) -> Path:
    """The measurements of the demo, in a new folder."""
    from robustid.app.cli.demo import measurements

    folder = outputs.new_folder(Path("robustid-demo"))
    measurements(console, folder)
    return folder


def _opened(console: Any, address: str, browser: bool) -> None:
    """Say the address, and open it."""
    import webbrowser

    say(console, f"the page: {address}")
    if browser and not webbrowser.open(address):
        say(console, "no browser was found: open that address in one on this machine")
    say(console, "Ctrl-C ends it")
