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
) -> int:
    """Run the machines, show what was found of all, and return the exit code."""
    from robustid.app.run.fleet import PAGE, TABLE, items_of, run_fleet
    from robustid.app.run.fleet_table import check_table
    from robustid.report import first_screen

    folder, console = output or Path("fleet"), screen.console(verbose=verbose)
    table = folder / TABLE if table is None else table
    check_table(table)
    items = items_of(paths, folder, force=force, static=static)
    with telling(console) as progress:
        progress(f"running {len(items)} machines", 0, 0)
        workers = min(os.cpu_count() or 1, len(items)) if executor is None else executor
        found = run_fleet(items, folder, workers, table, static=static, progress=progress)
    written = [table, folder / PAGE]
    screen.conclude(console, first_screen(found), lambda: [found.summary()], written=written)
    return _exit_code(found)


def _exit_code(found: Fleet) -> int:
    """1 where a machine has no verdict, else that of the worst finding."""
    from robustid.guarantees import FleetState

    open_states = FleetState.UNDECIDED, FleetState.FAILED, FleetState.WAITING
    if found.open or any(found.states.get(state) for state in open_states):
        return screen.exit_code(Status.UNDECIDED, False)
    return screen.exit_code(Status.INCONSISTENT if found.refuted else Status.CONSISTENT, bool(found.faulty))
