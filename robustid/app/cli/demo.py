"""robustid demo: the whole way on a simulated structure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robustid.app.cli import outputs, terminal
from robustid.app.cli.identify import finish, identified
from robustid.app.options import Identify


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the results; if it exists, the next free name.")
    ] = Path("robustid-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Noise of the simulated measurements.")] = 0,
) -> None:
    """Identify a simulated mass-beam structure, from measurements to a report. About ten seconds.

    Frequency points from 1 to 21 Hz and a step response, noise bounded by 0.03; modes at 9 Hz (well damped) and 17.67 Hz
    (damping ratio 0.004). The program finds the modes and the prior by itself.
    """
    import numpy as np

    from robustid.data import flexible_structure, save

    console = terminal.console()
    data = flexible_structure(seed=seed, extra_hz=list(np.linspace(17.2, 18.1, 10)))
    folder = outputs.new_folder(output)
    for name, item in (("frequency.csv", data.frequency), ("step.csv", data.time)):
        save(folder / name, item)
    terminal.say(console, f"measurements written: {folder / 'frequency.csv'}, {folder / 'step.csv'}")
    result = identified(console, Identify(), frequency=[data.frequency], time=[data.time])
    page = folder / "report.html"
    finish(console, result, folder / "result", page, reduce=True, title="robustid demo")
    terminal.say(console, f"\nNext: open {page} in a browser.")
    raise typer.Exit(terminal.EXIT[result.status])
