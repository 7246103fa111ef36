"""A command in a process of its own, which can be ended at any time; it tells its steps, and then its answer."""

from __future__ import annotations

import io
import multiprocessing
import os
import sys
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkServerContext, SpawnContext

# What the commands need, imported once where processes can be forked.
_NEEDED = [
    "robustid.app.answers.verdicts",
    "robustid.app.cli.measured_files",
    "robustid.app.cli.main",
    "robustid.report",
    "cvxpy",
]


def warm() -> ForkServerContext | SpawnContext:
    """The way in which processes are started: from one that has imported everything already, where the system can do that."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_NEEDED)
    forkserver.ensure_running()
    return context


def started(
    context: ForkServerContext | SpawnContext, words: Sequence[str], folder: str
) -> tuple[BaseProcess, Connection[Any, Any]]:
    """A process that carries a command out, and what it tells: (step, words) until (answer, JSON)."""
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_carry_out, args=(list(words), folder, sender), daemon=True)
    process.start()
    sender.close()
    return process, receiver


def _carry_out(words: list[str], folder: str, sender: Connection[Any, Any]) -> None:
    from robustid.app.cli import screen
    from robustid.app.cli.main import main

    os.chdir(folder)
    sys.argv, sys.stdout, sys.stderr = ["robustid", *words], io.StringIO(), io.StringIO()
    screen.tell_others(lambda text: sender.send(("step", text)))
    try:
        main()
    except SystemExit:  # its answer says the same
        pass
    finally:
        sender.send(("answer", sys.stdout.getvalue()))
