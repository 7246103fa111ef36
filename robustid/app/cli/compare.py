"""robustid compare: two measurements, a model and a measurement, or the modes of several setups, from files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Report, Static, Verbose, only, words_of
from robustid.app.cli.screen import in_words, say, step, telling
from robustid.app.run.sources import Estimate, RecordSource, ResponseSource
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from robustid.advice import CommonModes
    from robustid.app.cli.screen import Terminal
    from robustid.core import Record
    from robustid.data import FrequencyResponse
    from robustid.identification import Comparison, Validation

    Found = Comparison | Validation | CommonModes

_FILE = "A time record, a frequency response, a model or a saved result."


def compare(
    *,
    first: Annotated[Path, typer.Argument(help=_FILE)],
    second: Annotated[Path, typer.Argument(help=_FILE)],
    further: Annotated[
        list[Path] | None, typer.Argument(metavar="[FURTHER]...", help="Further setups, of --modes.")
    ] = None,
    modes: Annotated[
        bool,
        typer.Option(
            "--modes",
            help="Compare modes: setups of one machine, each with inputs and outputs of its own; what all leave, or which"
            " contradict each other.",
        ),
    ] = False,
    how: Annotated[Estimate, only("period", "probability")],
    records: Annotated[RecordSource, only("fields", "dt", "rate", "axes", "decimal", "initial", "correct")],
    responses: Annotated[ResponseSource, only("fields", "unit", "bound", "correct")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Save the comparison as NAME.npz and NAME.json.")
    ] = None,
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Compare two measurements: where they differ by more than their noise, and how probable that is by chance.

    Records are compared by their frequency responses. A model beside a measurement is held against it. With --modes the modes of
    several setups of one machine are compared: what all leave, or the proof that two contradict each other.

    [bold]Example[/bold]: robustid compare before.csv after.csv --period 1000 --report compared.html

    [bold]Example[/bold]: robustid compare point1.npz point2.npz point3.npz --modes --report modes.html

    Exit codes: 0 noise, or the bound, explains everything, or the setups agree; 3 it does not, or they don't (a finding); 4 either,
    but of data with a fault that nothing has undone; 1 nothing says how large the errors are, or no mode is shown by two setups, 2
    misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.advice import CommonModes
    from robustid.identification import Comparison
    from robustid.report import first_screen, write_report

    written_files.check_static(report, static)
    paths = [first, second, *(further or [])]
    if further and not modes:
        raise InputError(f"{len(paths)} files are compared by their modes: give --modes, or two files")
    files = [] if output is None else list(written_files.result_files(output))
    written_files.check_outputs([*files, report], [one for path in paths for one in written_files.sources(path)], force)
    console = screen.console(stderr=as_json, verbose=verbose)
    words = words_of(compare, a=str(first), b=str(second), first=str(first), second=str(second), data="the measurement")
    with in_words(words):
        things = [measured(console, path, records, responses) for path in paths]
        found = _compared(console, paths, things, how, modes)
    if not isinstance(found, Comparison | CommonModes):
        say(console, found.summary())
        if output is not None or report is not None:
            flag = "--output" if output is not None else "--report"
            raise InputError(f"{flag} is for two measurements; of a model robustid report and robustid verify say more")
        if as_json:
            from robustid.app.answers import verdicts

            screen.write(verdicts.held_against(found, _of_model(found)), console)
        raise typer.Exit(_of_model(found))
    if output is not None:
        found.save(output)
    if report is not None:
        title = " and ".join(path.stem for path in paths)
        with telling(console) as progress:
            write_report(found, report, title=title, static=static, progress=progress)
    head = first_screen(found)
    screen.conclude(console, head, lambda: [found.summary()], written=[*files, report])
    if isinstance(found, CommonModes):
        status, sides = _of_modes(found), things
    else:
        status, sides = Status.INCONSISTENT if found.differ else Status.CONSISTENT, [found.first, found.second]
    faults = [fault for one in sides for fault in one.faults]
    code = screen.exit_code(status, any(not fault.undone for fault in faults))
    if as_json:
        from robustid.app.answers import verdicts

        if isinstance(found, CommonModes):
            screen.write(verdicts.setups_compared(found, faults, head, code, [*files, report]), console)
        else:
            screen.write(verdicts.compared(found, head, code, [*files, report]), console)
    raise typer.Exit(code)


def _compared(console: Terminal, paths: Sequence[Path], things: list[object], how: Estimate, modes: bool) -> Found:
    """Comparison of two things or more; responses take the place of records where modes are compared."""
    from robustid.advice import common_modes
    from robustid.identification import compare as compared

    if not modes:
        with step(console, "comparing"):
            return compared(*things, probability=how.probability, period=how.period)
    things[:] = [response_of(console, path, one, how.period) for path, one in zip(paths, things, strict=True)]
    with step(console, "finding the modes of every setup"):
        names = [path.stem for path in paths]
        if len(set(names)) < len(names):
            names = [str(path) for path in paths]
        if len(set(names)) < len(names):
            raise InputError("a file is named twice: a setup agrees with itself whatever it measured")
        named: Record = dict(zip(names, things, strict=True))
        return common_modes(named, probability=how.probability)


def response_of(console: Terminal, path: Path, found: object, period: int | None) -> FrequencyResponse:
    """The response of what was read; of records the estimate of all of them."""
    from robustid.data import FrequencyResponse, TimeRecord
    from robustid.estimation import estimate_frf

    if isinstance(found, FrequencyResponse):
        return found
    if not isinstance(found, TimeRecord | list):
        raise InputError(f"{path} holds a {type(found).__name__}: of it no response is estimated; give a measurement")
    with step(console, f"estimating the response of {path}"):
        return estimate_frf(cast("TimeRecord | list[TimeRecord]", found), period=period)


def _of_modes(found: CommonModes) -> Status:
    if not found.compared:
        return Status.UNDECIDED
    return Status.INCONSISTENT if found.disagreements else Status.CONSISTENT


def _of_model(found: Validation) -> int:
    if found.outside is None:
        return screen.exit_code(Status.UNDECIDED, False)
    return screen.exit_code(Status.INCONSISTENT if found.outside else Status.CONSISTENT, False)


def measured(console: Terminal, path: Path, records: RecordSource, responses: ResponseSource) -> Any:
    """The saved result, model, response or records of a file, as what it looks like."""
    from robustid.app.cli.measured_files import Files
    from robustid.app.load_save import load, load_result
    from robustid.core import saved_kind
    from robustid.formats import kind_of_file

    if saved_kind(path) is not None:
        return load_result(path)
    if not path.is_file():
        words = "is a folder without a saved result" if path.is_dir() else "there is no such file"
        raise InputError(f"{path}: {words}")
    kind = kind_of_file(path, records.decimal)
    if kind == "model":
        say(console, f"read {path}: a model")
        return load(path, kind="model", dt=records.dt)
    if kind == "frequency" or (kind is None and responses.fields is not None):
        shared = {name: getattr(records, name) for name in ("dt", "rate", "axes", "decimal")}
        return Files(paths=[path], source=dataclasses.replace(responses, **shared), bounded=True).read(console)[0]
    found = Files(paths=[path], source=records).read(console)
    return found[0] if len(found) == 1 else found
