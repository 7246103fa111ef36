"""robustid serve: tools for other programs, by the Model Context Protocol."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from robustid.app.cli import screen
from robustid.errors import InputError


def serve(
    mcp: Annotated[
        bool, typer.Option("--mcp", help="Speak the Model Context Protocol, over stdin and stdout.", show_default=False)
    ] = False,
    folder: Annotated[Path, typer.Option(help="Folder of all files that are read and written.")] = Path(),
    time_limit: Annotated[
        float, typer.Option(min=1.0, metavar="SECONDS", help="Time of one call, after which it is ended.")
    ] = 600.0,
) -> None:
    r"""Offer tools to another program, which starts this one: look, identify, bounds, refute, margin and verify.

    Nothing listens on a port: the program that starts this one speaks to it over stdin and stdout. Answers are those of --json, by
    the same schema. Files lie in one folder, and none is overwritten. Needs robustid\[mcp].

    [bold]Example[/bold]: robustid serve --mcp --folder bench
    """
    from robustid.app.serve.server import serve as served

    if not mcp:
        raise InputError("--mcp is missing: it is the one protocol that is spoken")
    if not folder.is_dir():
        raise InputError(f"--folder {folder} is no folder; give one that exists")
    if sys.stdin.isatty():
        screen.say(screen.console(stderr=True), "waiting for a program that speaks the protocol; Ctrl-C ends it")
    served(folder, time_limit)
