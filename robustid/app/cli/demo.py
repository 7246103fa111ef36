"""robustid demo: the whole way on a simulated structure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from robustid.app.cli import outputs, terminal
from robustid.app.cli.identify import finish, identified
from robustid.app.cli.options import Static
from robustid.app.cli.terminal import step

_SIDES = 6  # of the polygons around the errors at each frequency


def measurements(console: Any, folder: Path, seed: int = 0) -> Any:
    """Write the measurements of the demo into a folder; what they are of."""
    import numpy as np

    from robustid.data import flexible_structure, save

    data = flexible_structure(seed=seed, extra_hz=list(np.linspace(17.2, 18.1, 10)))
    for name, item in (("frequency.csv", data.frequency), ("step.csv", data.time)):
        save(folder / name, item)
    terminal.say(console, f"measurements written: {folder / 'frequency.csv'}, {folder / 'step.csv'}")
    return data


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the results; if it exists, the next free name.")
    ] = Path("robustid-demo"),
    static: Static = False,
    seed: Annotated[int, typer.Option(min=0, help="Noise of the simulated measurements.")] = 0,
) -> None:
    """Identify a simulated mass-beam structure, from measurements to a report. About ten seconds.

    Frequency points from 1 to 21 Hz and a step response, noise bounded by 0.03; modes at 9 Hz (well damped) and 17.67 Hz
    (damping ratio 0.004). The program finds the modes and the prior by itself.
    """
    import numpy as np

    from robustid.guarantees import worst_case_error

    console = terminal.console()
    folder = outputs.new_folder(output)
    data = measurements(console, folder, seed)
    result, box = identified(console, [data.frequency], [data.time])
    page = folder / "report.html"
    hz = [0.5, 3, 6, 8, 9, 10, 12, 14, 15.5, 16.3, 17, 17.4, 17.6, 17.67, 17.74, 18, 19, 21, 25, 32, 40, 50]
    with step(console, "bounding the error of the model"):
        error = worst_case_error(result, omega=2 * np.pi * np.array(hz), directions=_SIDES)
    error.save(folder / "bounds")
    finish(
        console,
        result,
        folder / "result",
        page,
        reduce=True,
        static=static,
        box=box,
        title="robustid demo",
        worst_case=error,
    )
    terminal.say(console, f"\nNext: open {page} in a browser.")
    raise typer.Exit(terminal.EXIT[result.status])
