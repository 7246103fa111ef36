"""robustid export: a model, a response or a result as a file for another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from robustid.app.cli import outputs, terminal
from robustid.app.cli.options import Force


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
    from robustid.app.files import load, save

    outputs.check_outputs([output], outputs.sources(source), force)
    console = terminal.console()
    thing: Any = load(source)
    if output.suffix.lower() != ".csv" and type(thing).__name__ in (
        "Identification",
        "MatrixFraction",
        "WorstCaseError",
    ):
        thing = thing.model
    save(output, thing)
    terminal.say_written(console, output)
