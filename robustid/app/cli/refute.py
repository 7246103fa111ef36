"""robustid refute: new measurements against everything that an identification, or a band, leaves possible."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen
from robustid.app.cli.command_options import AsJson, First, only, words_of
from robustid.app.cli.screen import in_words, say, step
from robustid.app.run.settings import FrequencyPoints, General
from robustid.app.run.sources import RecordSource, ResponseSource
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from robustid.data import FrequencyResponse, TimeRecord
    from robustid.guarantees import Band, Coverage

_STATUS = {"inside": Status.CONSISTENT, "refuted": Status.INCONSISTENT, "undecided": Status.UNDECIDED}


def refute(
    *,
    source: Annotated[
        Path,
        typer.Argument(help="A saved identification or band (NAME, NAME.npz or NAME.json) that the data are new to."),
    ],
    frequency: Annotated[
        list[Path] | None, typer.Option("--frequency", help="New frequency response: .csv, .npz or .mat. Repeatable.")
    ] = None,
    time: Annotated[
        list[Path] | None, typer.Option("--time", help="New time record: .csv, .npz or .mat. Repeatable.")
    ] = None,
    responses: ResponseSource,
    records: RecordSource,
    points: FrequencyPoints,
    first: First = None,
    general: Annotated[General, only("entry")],
    as_json: AsJson = False,
) -> None:
    """Decide whether new measurements contradict what was guaranteed, sample by sample, with a proof.

    Of an identification every sample is compared with every consistent system; of a band new responses with its discs.

    [bold]Example[/bold]: robustid refute result --frequency monday.csv --frequency-bound 0.03

    Exit codes: 0 nothing contradicts it, 3 refuted (a finding, with its proof), 4 either, but of data with a fault that nothing has
    undone, 1 undecided, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.answers import verdicts
    from robustid.app.cli.measured_files import Files
    from robustid.app.load_save import load_result
    from robustid.estimation import all_faults
    from robustid.guarantees import refute as refuted
    from robustid.identification import Identification, sample_faults

    if not frequency and not time:
        raise InputError(
            "--frequency and --time are both missing; give at least one file of new data", argument="frequency"
        )
    console = screen.console(stderr=as_json)
    known = load_result(source, "identification", "band", "worst-case error", "band over poles", "family")
    entry = general.entry
    asked = Files(paths=frequency or [], source=responses, entry=entry, band_hz=points.band_hz, bounded=True)
    lines = asked.read(console)
    samples = Files(paths=time or [], source=records, entry=entry, first=first, bounded=True).read(console)
    words = words_of(refute, identification="the identification", new_data="the new data", withheld="--frequency")
    with in_words(words), step(console, "comparing"):
        of_class = isinstance(known, Identification)
        found = refuted(known, [*lines, *samples]) if of_class else _covered(known, lines, samples)
    say(console, found.summary())
    faults = [
        *(fault for one in lines for fault in all_faults(one)),
        *(f for one in samples for f in sample_faults(one)),
    ]
    problem = getattr(known, "problem", None)
    faults += [] if problem is None else problem.data_faults
    status = _STATUS[verdicts.verdict_of(found)[0]]
    code = screen.exit_code(status, any(not fault.undone for fault in faults))
    if as_json:
        screen.write(verdicts.contradicted(found, faults, code), console)
    raise typer.Exit(code)


def _covered(band: Band, lines: list[FrequencyResponse], samples: list[TimeRecord]) -> Coverage:
    """New responses against the discs of a band: of one that holds at every frequency at those of the data."""
    from robustid.guarantees import coverage, on_lines

    if samples:
        raise InputError("--time is for an identification; a band is compared with --frequency", argument="time")
    return coverage(on_lines(band, lines), lines)
