"""robustid look: what is in files; robustid new: a run file made from them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robustid.app.cli import terminal
from robustid.app.cli.terminal import say


def look(files: Annotated[list[Path], typer.Argument(help="Files of any kind that robustid reads.")]) -> None:
    """Show what is in files: names, shapes, ranges, what looks odd, and the lines to go on with.

    [bold]Example[/bold]: robustid look bench.mat
    """
    from robustid.app.look import look as looked

    console = terminal.console()
    for path in files:
        say(console, looked(path).summary())
