"""robustid watch: a machine's records, one after the other, against the band that was proved for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Report, Static, Verbose, only, words_of
from robustid.app.cli.compare import measured, response_of
from robustid.app.cli.screen import in_words, step, telling
from robustid.app.run.sources import Estimate, RecordSource, ResponseSource
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from robustid.app.cli.screen import Terminal
    from robustid.data import FrequencyResponse
    from robustid.guarantees import Watch


def watch(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            help="A watch, which goes on; or the identification, band, bounds or family with which one begins."
        ),
    ],
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[RECORD]...", help="New records or responses, in their order.")
    ] = None,
    usual: Annotated[
        list[Path] | None,
        typer.Option("--usual", help="Record from before, of the machine as it should be. Repeatable; of a new watch."),
    ] = None,
    alarm_rate: Annotated[
        float | None,
        typer.Option(
            "--alarm-rate",
            help="False alarms of a drift in a record, at most, on average. Default 0.002; of a new watch.",
        ),
    ] = None,
    controller: Annotated[
        Path | None,
        typer.Option(
            "--controller", help="Model of the controller, u = -C y: is its proved peak of S kept? Of a new watch."
        ),
    ] = None,
    condition: Annotated[
        str | None,
        typer.Option(
            "--condition",
            help="Of a family: the member in whose condition the new records were measured. Default: any member may explain them.",
        ),
    ] = None,
    how: Annotated[Estimate, only("period")],
    records: Annotated[RecordSource, only("fields", "dt", "rate", "axes", "decimal", "initial", "correct")],
    responses: Annotated[ResponseSource, only("fields", "unit", "bound", "correct")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Save the watch as NAME.npz and NAME.json. Default: where it came from."),
    ] = None,
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Watch a machine: hold every new record against its band; alarms are a proof of contradiction, or a drift at a stated rate.

    [bold]Example[/bold]: robustid watch result --usual monday.npz --usual tuesday.npz -o stage

    [bold]Example[/bold]: robustid watch stage wednesday.npz --report stage.html

    Exit codes: 0 no alarm by these records, 3 one of them is refuted or gives the alarm of a drift (a finding), 4 either, but of
    data with a fault that nothing has undone, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.answers import verdicts
    from robustid.estimation import all_faults
    from robustid.guarantees import Watch
    from robustid.report import first_screen, write_report

    written_files.check_static(report, static)
    console, paths = screen.console(stderr=as_json, verbose=verbose), files or []
    known = _known(source)
    begun = not isinstance(known, Watch)
    stated = {"--usual": usual or None, "--alarm-rate": alarm_rate, "--controller": controller}
    _check(
        source,
        begun,
        output,
        [name for name, one in stated.items() if one is not None],
        bool(paths or output or report),
    )
    target = list(written_files.result_files(source if output is None else output))
    taken = [one for path in [source, *paths, *(usual or [])] for one in written_files.sources(path)]
    written_files.check_outputs([*(target if output is not None else []), report], taken, force)
    words = words_of(
        watch, band=str(source), record="the record", usual="--usual", rate="--alarm-rate", condition="--condition"
    )
    new: list[FrequencyResponse] = []
    with in_words(words):
        reading = how, records, responses
        found: Watch = _begun(console, known, usual or [], alarm_rate, controller, reading) if begun else known
        before = len(found.records)
        if begun or output is not None:
            found.save(target[0])
        for path in paths:
            new.append(_response(console, path, *reading))
            with step(console, f"watching {path}"):
                found = found.update(new[-1], str(path), condition=condition)
                found.save(target[0])  # at once: what comes after may be interrupted
    if report is not None:
        title = source.stem if output is None else output.stem
        with telling(console) as progress:
            write_report(found, report, title=title, static=static, progress=progress)
    alarm = any(one.drifted or one.refuted is not None for one in found.history[before:])
    faults = [fault for frf in new for fault in all_faults(frf)]
    code = screen.exit_code(
        Status.INCONSISTENT if alarm else Status.CONSISTENT, any(not fault.undone for fault in faults)
    )
    if as_json:
        screen.write(verdicts.watched(found, faults, [*target, *([] if report is None else [report])], code), console)
    else:
        screen.conclude(console, first_screen(found), lambda: [found.summary()], written=[*target, report])
    raise typer.Exit(code)


def _check(source: Path, begun: bool, output: Path | None, of_new: list[str], asked: bool) -> None:
    """Refuse what a watch that begins lacks, and what one that goes on does not take."""
    if begun and output is None:
        raise InputError(f"{source} is no watch yet: name the one that begins with --output NAME", argument="output")
    if not begun and of_new:
        raise InputError(f"{of_new[0]} is for a new watch; {source} has begun, and its rate would no longer hold")
    if not begun and not asked:
        raise InputError("nothing to do: give new records, or --report FILE.html", argument="files")


def _known(source: Path) -> Any:
    """The watch, or the band that one is to begin with."""
    from robustid.app.load_save import load_result
    from robustid.core import saved_kind

    if saved_kind(source) == "identification":
        known = written_files.kept_beside(source, "-band", load_result(source, "identification"))
        if known is not None:
            return known
        raise InputError(
            f"{source} is an identification, a watch stands on its band: robustid bounds {source} -o {source}-bounds writes it,"
            f" robustid watch {source}-bounds-band begins",
            argument="source",
        )
    return load_result(source, "watch", "band", "worst-case error", "band over poles", "family")


def _begun(
    console: Terminal,
    band: Any,
    usual: list[Path],
    rate: float | None,
    controller: Path | None,
    how: tuple[Estimate, RecordSource, ResponseSource],
) -> Watch:
    from robustid.app.run.controllers import controller_in
    from robustid.guarantees import watch as watched

    before = [_response(console, path, *how) for path in usual]
    model: Any = None if controller is None else controller_in(controller, getattr(band, "dt", None))
    with step(console, "beginning the watch"):
        return watched(band, usual=before, rate=rate, controller=model)


def _response(
    console: Terminal, path: Path, how: Estimate, records: RecordSource, responses: ResponseSource
) -> FrequencyResponse:
    """The response of a file; of one with records the estimate of all of them."""
    return response_of(console, path, measured(console, path, records, responses), how.period)
