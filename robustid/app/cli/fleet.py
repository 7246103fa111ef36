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
