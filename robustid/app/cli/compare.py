"""robustid compare: two measurements, or a model and a measurement, from files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Report, Static, Verbose, only, words_of
from robustid.app.cli.screen import in_words, say, step
from robustid.app.run.sources import Estimate, RecordSource, ResponseSource
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from robustid.app.cli.screen import Terminal
    from robustid.identification import Validation

_FILE = "A time record, a frequency response, a model or a saved result."


def compare(
    *,
    first: Annotated[Path, typer.Argument(help=_FILE)],
    second: Annotated[Path, typer.Argument(help=_FILE)],
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

    Records are compared by their frequency responses. A model beside a measurement is held against it.

    [bold]Example[/bold]: robustid compare before.csv after.csv --period 1000 --report compared.html

    Exit codes: 0 noise, or the bound, explains everything; 3 it does not (a finding); 4 either, but of data with a fault that
    nothing has undone; 1 nothing says how large the errors are, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.identification import Comparison
    from robustid.identification import compare as compared
    from robustid.report import first_screen, write_report

    written_files.check_static(report, static)
    files = [] if output is None else list(written_files.result_files(output))
    written_files.check_outputs(
        [*files, report], [*written_files.sources(first), *written_files.sources(second)], force
    )
    console = screen.console(stderr=as_json, verbose=verbose)
    things = [measured(console, path, records, responses) for path in (first, second)]
    words = words_of(compare, a=str(first), b=str(second), first=str(first), second=str(second), data="the measurement")
    with in_words(words), step(console, "comparing"):
        found: Any = compared(*things, probability=how.probability, period=how.period)
    if not isinstance(found, Comparison):
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
        write_report(found, report, title=f"{first.stem} and {second.stem}", static=static)
    head = first_screen(found)
    screen.conclude(console, head, lambda: [found.summary()], written=[*files, report])
    status = Status.INCONSISTENT if found.differ else Status.CONSISTENT
    open_faults = [fault for frf in (found.first, found.second) for fault in frf.faults if not fault.undone]
    code = screen.exit_code(status, bool(open_faults))
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.compared(found, head, code, [*files, report]), console)
    raise typer.Exit(code)


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
        raise InputError(f"{path}: there is no such file")
    kind = kind_of_file(path, records.decimal)
    if kind == "model":
        say(console, f"read {path}: a model")
        return load(path, kind="model", dt=records.dt)
    if kind == "frequency" or (kind is None and responses.fields is not None):
        shared = {name: getattr(records, name) for name in ("dt", "rate", "axes", "decimal")}
        return Files(paths=[path], source=dataclasses.replace(responses, **shared), bounded=True).read(console)[0]
    found = Files(paths=[path], source=records).read(console)
    return found[0] if len(found) == 1 else found
