"""robustid run of several run files: a fleet of machines, its table and its page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.cli import screen
from robustid.app.cli.screen import telling
from robustid.errors import Status

if TYPE_CHECKING:
    from robustid.guarantees import Fleet


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
    from robustid.app.run.split import is_split, time_words
    from robustid.report import first_screen

    folder, console = output or Path("fleet"), screen.console(stderr=as_json, verbose=verbose)
    table = folder / TABLE if table is None else table
    check_table(table)
    items = items_of(paths, folder, force=force, static=static)
    with telling(console) as progress:
        split = [is_split(path) for path in paths]
        thing, things = ("entry", "entries") if all(split) else ("machine", "machines")
        progress(f"running {len(items)} {things}", 0, 0)
        workers = min(os.cpu_count() or 1, len(items)) if executor is None else executor
        forecast = any(split)

        def told(text: str, done: int, count: int) -> None:
            """Tell of a finished one; entries take about equally long, so that the first says how long all will."""
            nonlocal forecast
            if forecast and (words := time_words(items, workers if isinstance(workers, int) else None)):
                screen.say(console, words)
            forecast = False
            progress(text, done, count)

        found = run_fleet(items, folder, workers, table, static=static, progress=told, thing=thing)
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
