"""robustid run: from a run file to a folder with the report and everything in it, or from several to the table of a fleet."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import FLAGS, AsJson, Static, Verbose
from robustid.app.cli.screen import Next, in_words, resumable, telling
from robustid.app.run.checks import options
from robustid.app.run.settings import PARTS
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from rich.console import RenderableType

    from robustid.app.cli.terminal import Terminal
    from robustid.app.run.results import FamilyRun, IdentifiedReduced
    from robustid.guarantees import Fleet

# Not as arguments of Python, nor as options of other commands: keys of the run file.
_WORDS = {name: name for name in (*FLAGS, "order", "scaling")} | {
    "folder": "--output",
    "resume": "--resume",
    "force": "--force",
    "executor": "--workers",
    "cluster": "--cluster",
    "passive": "[prior] passive",
    "frequency_unit": "unit",
    "period": "period in [estimate]",
    "omega": "at_hz in [worst_case]",
}


def _show_keys(wanted: bool) -> None:
    """Print the keys of a run file, from their descriptions."""
    if not wanted:
        return
    from rich.table import Table

    console = screen.console()
    for place, kind in PARTS.items():
        screen.say(console, f"\n{place}  # {(kind.__doc__ or '').splitlines()[0]}".replace("\n  #", "#"))
        table = Table.grid(padding=(0, 2))
        for field, option in options(kind):
            unit = f" In {option.unit}." if option.unit else ""
            default = "" if field.default is None else f" Default {json.dumps(field.default)}."
            table.add_row(f"  {field.name}", screen.plain(option.sentence + unit + default))
        console.print(table, highlight=False)
    raise typer.Exit


def run(
    config: Annotated[
        list[str],
        typer.Argument(
            help="The run file, TOML; of several, or of a folder with run files, each is the run of one machine. Also an address"
            " (s3://FOLDER), which fsspec opens: pip install 'robustid\\[remote]'."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for the results. Default: the name of the run file; of several: fleet."
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with an unfinished run in that folder. With several the same command does."
        ),
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of processes: for the worst-case error, default one; with several run files for the machines, default one"
            " for every core.",
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            "--cluster",
            metavar="ADDRESS",
            help="Scheduler of Dask, or its file, whose workers take the place of processes.",
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            "--table",
            metavar="FILE",
            help="Table of the machines, .csv or .parquet. Default: table.csv beside their page.",
        ),
    ] = None,
    static: Static = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            help="Replace what an earlier run wrote there; with several run files that of machines that failed, or were asked"
            " something else.",
        ),
    ] = False,
    verbose: Verbose = False,
    keys: Annotated[
        bool, typer.Option("--keys", callback=_show_keys, is_eager=True, help="List every key of a run file, and exit.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    r"""Everything that a run file says: records, response, bounds, class, proof, small model, its error, report.

    What the file does not say, the program chooses; FOLDER/run.toml then says everything, with reasons, and gives the same again.
    A run file names data and, where you want it otherwise, choices:

        title = "Motor bench"
        entry = ["angle", "current"]     # \[output, input]; else the matrix

        [\[record]]                       # once for each: a file, or a dataset
        file = "bench.csv"
        use = "response"                 # or "samples", or "noise_floor"
        start = 1.0                      # s

        [\[frequency]]                    # a response measured elsewhere
        file = "frf.csv"
        bound = 0.01

        \[estimate]                       # records to a response
        period = 2500
        \[frequency_points]
        band_hz = [5.0, 200.0]
        every = 2                        # the others test the result
        \[modes]                          # or of a fit: \[fit] order = "auto"
        hz = [17.67]
        damping = [0.004]
        \[prior]
        gain_bound = 0.2
        decay_rate = 1.1
        \[identify]
        inflate = "auto"                 # or a number; 1 without it
        \[worst_case]
        over_poles = true

    Plants that differ by amplitude, position, load or date make a family: [\[members]] with name = ... and the condition, and
    member = ... in every [\[record]] and [\[frequency]].

    [bold]Example[/bold]: robustid run machines/*.toml -o fleet --workers 8

    Exit codes: 0 consistent, 3 inconsistent (a finding, with its proof) or contradicted by withheld data, 4 either, but of data
    with a fault that nothing has undone, 1 undecided or not solved, 2 misuse, 70 an error of the program, 130 interrupted. Of
    several machines: 1 where one has no verdict, else 3 or 4 where one would end so.
    """
    with in_words(_WORDS), contextlib.ExitStack() as stack:
        executor: Executor | int | None = _executor(stack, workers, cluster)
        from robustid.app.run.split import split_of

        files = _here(config, output, screen.console(stderr=as_json, verbose=verbose))
        if len(files) > 1 or files[0].is_dir() or split_of(files[0]):
            how: dict[str, bool] = {"static": static, "force": force, "verbose": verbose, "as_json": as_json}
            raise typer.Exit(fleet(files, output, executor, table, **how))
        if table is not None:
            raise InputError("--table is of several machines; give several run files, or a folder of them")
        how = {"resume": resume, "static": static, "force": force, "verbose": verbose, "as_json": as_json}
        _run(files[0], output, executor, **how)


def _here(config: Sequence[str], output: Path | None, console: Terminal) -> list[Path]:
    """The run files and folders, those of an address as copies in a folder beside the results."""
    from robustid.app.run.fetched import fetched, is_url

    def copied(address: str) -> Path:
        name = output or Path(address.partition("::")[0]).stem.strip(":")
        return fetched(address, Path(f"{name}-inputs"), progress)

    with telling(console) as progress:
        return [copied(one) if is_url(one) else Path(one) for one in config]


def _executor(stack: contextlib.ExitStack, workers: int | None, address: str | None) -> Executor | int | None:
    """The workers that were asked for; None where none were."""
    if address is None:
        return workers
    if workers is not None:
        raise InputError("--workers are processes of this machine, --cluster has its own; give one of them")
    from robustid.app.run.fleet import cluster

    return stack.enter_context(cluster(address))


def _run(
    config: Path,
    output: Path | None,
    executor: Executor | int | None,
    *,
    resume: bool,
    static: bool,
    force: bool,
    verbose: bool,
    as_json: bool,
) -> None:
    """One run, and what was found."""
    from robustid.app.run import pipeline
    from robustid.app.run.results import IdentifiedReduced
    from robustid.app.run.run_folder import RUN_FILE
    from robustid.errors import Status

    folder = output or Path(config.stem)
    console = screen.console(stderr=as_json, verbose=verbose)
    found_again = f"what is finished is in {folder}: the same command with --resume goes on from there"
    interrupted = resumable(console, found_again, (folder / RUN_FILE).exists)
    with interrupted, telling(console) as progress:
        progress(f"reading {config}", 0, 0)
        result = pipeline.run(
            config,
            folder,
            resume=resume,
            force=force,
            static=static,
            executor=None if executor == 1 else executor,
            progress=progress,
        )
    if isinstance(result, IdentifiedReduced):
        status, identifications = result.identification.verified_status, [result.identification]
    else:
        status, identifications = result.status, list(result.identifications.values())
    good = status is Status.CONSISTENT and not result.contradicted
    stopped = result.unfinished is not None and result.unfinished.interrupted
    written = sorted(path for path in folder.iterdir() if path.is_file())
    screen.conclude(
        console,
        result.first_screen(),
        lambda: _everything(result),
        written=written,
        undoing=result.undoing,
        steps=_after_ctrl_c(config, folder) if stopped else _next(folder) if good else None,
    )
    faulty = any(one.problem.open_faults for one in identifications)
    code = screen.exit_code(Status.INCONSISTENT if result.contradicted else status, faulty)
    if as_json:
        from robustid.app.answers import verdicts

        said = "refuted" if result.contradicted else status.name.lower()
        screen.write(verdicts.ran(result, said, code, written), console)
    raise typer.Exit(code)


def _after_ctrl_c(config: Path, folder: Path) -> list[Next | str]:
    """The rest of a run that Ctrl-C ended."""
    return [Next("the rest, from what is finished", ["run", config, "-o", folder, "--resume"])]


def _next(folder: Path) -> list[Next | str] | None:
    """The small model for another program; for a plant in a loop its own."""
    model = next((path for name in ("plant", "small_model") if (path := folder / f"{name}.npz").is_file()), None)
    if model is None:
        return None
    name = written_files.free(Path(f"{folder.name}-model"), ".m")
    return [Next("the small model for MATLAB (.h: C, .json, .sos)", ["export", model, "-o", f"{name}.m"])]


def _everything(result: IdentifiedReduced | FamilyRun) -> list[RenderableType]:
    """All that was found, as rich shows it."""
    from robustid.app.run.results import FamilyRun, unfinished_words
    from robustid.report import render_summary

    found: list[RenderableType] = []
    if isinstance(result, FamilyRun):
        identifications = list(result.identifications.values())
        found += [f"warning: {line}" for line in unfinished_words(result.unfinished)]
        if result.family is not None:
            contradicted = "withheld data contradict what follows, which is no guarantee for the machines\n"
            found.append(contradicted * result.contradicted + result.family.summary())
    else:
        identifications = [result.identification]
        found.append(render_summary(result.identification, result.reduction, unfinished=result.unfinished))
        found += [] if result.diagnosis is None else ["\n" + result.diagnosis.summary()]
    found += [f"\n{finding}" for finding in result.findings]
    return [*found, *(f"warning: {words}" for one in identifications for words in one.warnings)]


def fleet(
    paths: Sequence[Path],
    output: Path | None,
    executor: Executor | int | None,
    table: Path | None,
    *,
    static: bool,
    force: bool,
    verbose: bool,
    as_json: bool,
) -> int:
    """Run the machines, show what was found of all, and return the exit code."""
    from robustid.app.run.fleet import PAGE, TABLE, items_of, run_fleet
    from robustid.app.run.fleet_table import check_table
    from robustid.app.run.split import THINGS, split_of, time_words
    from robustid.report import first_screen

    folder, console = output or Path("fleet"), screen.console(stderr=as_json, verbose=verbose)
    table = folder / TABLE if table is None else table
    check_table(table)
    items = items_of(paths, folder, force=force, static=static)
    with telling(console) as progress:
        kinds = {split_of(path) for path in paths}
        kind = kinds.pop() if len(kinds) == 1 else None
        workers = min(os.cpu_count() or 1, len(items)) if executor is None else executor

        def forecast() -> None:
            """Say how long parts of a matrix take, which take about equally long: before them, and again after the first."""
            if kind and (words := time_words(items, workers if isinstance(workers, int) else None)):
                screen.say(console, words)

        forecast()
        progress(f"running {len(items)} {kind or 'machines'}", 0, 0)
        told_again = False

        def told(text: str, done: int, count: int) -> None:
            nonlocal told_again
            if not told_again:
                forecast()
            told_again = True
            progress(text, done, count)

        found = run_fleet(
            items, folder, workers, table, static=static, progress=told, thing=THINGS.get(kind or "", "machine")
        )
    written = [table, folder / PAGE]
    head, status = first_screen(found), _status(found)
    screen.conclude(console, head, lambda: [found.summary()], written=written)
    code = screen.exit_code(status, bool(found.faulty))
    if as_json:
        from robustid.app.answers import verdicts

        answer = verdicts.concluded("run", status.name.lower(), head, code, written, summary=found.summary())
        screen.write(answer, console)
    return code


def _status(found: Fleet) -> Status:
    """Undecided where a machine has no verdict, else that of the worst finding."""
    from robustid.guarantees import FleetState

    open_states = FleetState.UNDECIDED, FleetState.FAILED, FleetState.WAITING
    if found.open or any(found.states.get(state) for state in open_states):
        return Status.UNDECIDED
    return Status.INCONSISTENT if found.refuted else Status.CONSISTENT
