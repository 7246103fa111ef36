"""The command line: robustid run, excite, frf, identify, fit, bounds, verify, reduce, report, demo."""

from __future__ import annotations

import pathlib
from typing import Annotated, Any

import typer

from robustid._version import __version__
from robustid.app.cli import terminal
from robustid.app.cli.certify import bounds, verify
from robustid.app.cli.excite import excite
from robustid.app.cli.fit import fit
from robustid.app.cli.frf import frf
from robustid.app.cli.reduce import reduce
from robustid.app.cli.report import report
from robustid.app.cli.run import run
from robustid.app.cli.steps import EXIT, finish, identified, size_in_options
from robustid.app.cli.terminal import plain, step
from robustid.data.io import FREQUENCY, TIME
from robustid.errors import InputError

_CODES = """Exit codes: 0 consistent, 3 inconsistent (a finding, with its proof), 1 undecided or not solved, 2 misuse,
    70 an error of the program, 130 interrupted."""

app = typer.Typer(
    name="robustid",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help=f"""Models with a proof, for lightly damped machines.

    Start with [bold]robustid demo[/bold]. With your own data: [bold]robustid identify --frequency frf.csv --time step.csv
    --dt 0.01 --frequency-bound 0.03 --time-bound 0.03[/bold]. From recorded signals: [bold]robustid frf[/bold] makes the
    frequency response and its bound; [bold]robustid excite[/bold] designs what to play.

    {_CODES}""",
)

Path = pathlib.Path
Output = Annotated[Path, typer.Option("--output", "-o", help="Where results go: NAME.npz and NAME.json.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]


def main() -> None:
    """Entry point: every run ends with an exit code, and misuse with one sentence."""
    terminal.run(app)


def _names(roles: dict[str, tuple[str, ...]]) -> str:
    return "; ".join(f"{role}: {', '.join(names)}" for role, names in roles.items())


def _show_version(wanted: bool) -> None:
    if wanted:
        terminal.console().print(f"robustid {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Options of the program itself."""


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the results; if it exists, the next free name.")
    ] = Path("robustid-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Noise of the simulated measurements.")] = 0,
) -> None:
    """Identify a simulated mass-beam structure, from measurements to a report. About ten seconds.

    Frequency lines from 1 to 21 Hz and a step response, noise bounded by 0.03; modes at 9 Hz (well damped) and 17.67 Hz
    (damping ratio 0.004). The program finds the modes and the prior by itself.
    """
    import numpy as np

    from robustid.app.pipeline import propose
    from robustid.data import flexible_structure, save

    console = terminal.console()
    data = flexible_structure(seed=seed, extra_hz=list(np.linspace(17.2, 18.1, 10)))
    folder = terminal.new_folder(output)
    for name, item in (("frequency.csv", data.frequency), ("step.csv", data.time)):
        save(folder / name, item)
    console.print(
        plain(f"measurements written: {folder / 'frequency.csv'}, {folder / 'step.csv'}"),
        highlight=False,
        soft_wrap=True,
    )
    with step(console, "choosing modes and prior from the data"):
        proposal = propose(frequency=[data.frequency], time=[data.time])
    result = identified(console, proposal)
    page = folder / "report.html"
    finish(console, result, folder / "result", page, reduce=True, title="robustid demo")
    console.print(plain(f"\nNext: open {page} in a browser."), highlight=False)
    raise typer.Exit(EXIT[result.status])


@app.command()
def identify(
    frequency: Annotated[
        list[Path] | None, typer.Option("--frequency", help="Frequency response: .csv, .npz or .mat. Repeatable.")
    ] = None,
    time: Annotated[
        list[Path] | None, typer.Option("--time", help="Time record: .csv, .npz or .mat. Repeatable.")
    ] = None,
    dt: Annotated[float | None, typer.Option(help="Sample time in s, where the files do not say.")] = None,
    frequency_bound: Annotated[
        float | None, typer.Option(help="Radius of the error disc of every line, in units of the response.")
    ] = None,
    time_bound: Annotated[
        float | None, typer.Option(help="Half-width of the error interval of every sample, in units of y.")
    ] = None,
    frequency_unit: Annotated[
        str | None, typer.Option(help='Unit of an omega column: "rad/s" (default) or "Hz".')
    ] = None,
    frequency_field: Annotated[
        list[str] | None,
        typer.Option(
            help="ROLE=NAME in the file: omega=w, real=Re, imag=Im, values=G.data, bound=eps. Recognised without it,"
            f" upper or lower case: {_names(FREQUENCY)}; in .npz and .mat the sample time as dt, Ts or T."
        ),
    ] = None,
    time_field: Annotated[
        list[str] | None,
        typer.Option(
            help=f"ROLE=NAME in the file: time=t, u=current, y=angle, bound=eps. Recognised without it: {_names(TIME)}."
        ),
    ] = None,
    band: Annotated[str | None, typer.Option(help="LOW:HIGH in Hz: use only the lines between.")] = None,
    first: Annotated[int | None, typer.Option(help="Use only the first N samples of the time records.")] = None,
    initial: Annotated[
        str | None, typer.Option(help='State before a time record: "rest" (default), "free" or "periodic".')
    ] = None,
    channel: Annotated[
        str | None, typer.Option(help="OUTPUT,INPUT (from 0): one entry of files with several channels; default all.")
    ] = None,
    mode: Annotated[
        list[str] | None,
        typer.Option(help='Parametric pair HZ:DAMPING, e.g. 17.67:0.004; "none" for none; default: from the data.'),
    ] = None,
    repeat: Annotated[
        int, typer.Option(min=1, help="Multiplicity of each pair; 2 absorbs small errors of the poles.")
    ] = 1,
    delay: Annotated[
        int | None, typer.Option(min=0, help="Delay of the pairs in samples; default: from the data.")
    ] = None,
    gain: Annotated[float | None, typer.Option(help="Prior: gain bound K of the non-parametric part.")] = None,
    decay: Annotated[float | None, typer.Option(help="Prior: decay rate rho > 1 per sample.")] = None,
    objective: Annotated[
        str,
        typer.Option(
            help="Which of the systems becomes the model: center (the middle of all that are consistent), margin (the one"
            " that fits best), gain (smallest K) or order (smallest Hankel nuclear norm, the easiest to reduce)."
        ),
    ] = "center",
    solver: Annotated[str, typer.Option(help='"auto", "structured", "cvxpy", or an installed cvxpy solver.')] = "auto",
    accuracy: Annotated[float, typer.Option(help="Width of the proven interval of the margin.")] = 1e-4,
    form: Annotated[
        str,
        typer.Option(
            help="The finite problem: orthonormal (exact, up to 200 coefficients), classical (the same as published, for small"
            " data), taylor (any number of samples), sections (fewer coefficients where the lines fill a part of the circle only,"
            " as in oversampled data), or auto."
        ),
    ] = "auto",
    output: Output = Path("result"),
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    reduce: Annotated[bool, typer.Option(help="Look for the smallest model inside the bounds.")] = True,
    force: Force = False,
) -> None:
    """Decide whether measurements fit a class of systems, with a proof, and build a model.

    Without --mode, --gain and --decay the program chooses them from the data and says how.
    Files are written at the end, all together.

    [bold]Example[/bold]: robustid identify --frequency frf.csv --time step.csv --dt 0.01 --frequency-bound 0.03
    --time-bound 0.03 --mode 9:0.1 --mode 17.67:0.004 --gain 0.2 --decay 1.1 --report report.html

    Exit codes: 0 consistent, 3 inconsistent (a finding, with its proof), 1 undecided or not solved, 2 misuse,
    70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.data import Options, measurements, parse_modes
    from robustid.app.pipeline import propose
    from robustid.identification import FORMS, OBJECTIVES, Prior

    if objective not in OBJECTIVES:
        raise InputError(f"--objective must be one of {', '.join(OBJECTIVES)}; got {objective!r}")
    if form not in FORMS:
        raise InputError(f"--form must be one of {', '.join(FORMS)}; got {form!r}")
    if not frequency and not time:
        raise InputError("--frequency and --time are both missing; give at least one file")
    if (gain is None) != (decay is None):
        raise InputError("--gain and --decay make one prior; give both, or neither to have it suggested")
    prior = None if gain is None or decay is None else Prior(gain_bound=gain, decay_rate=decay)
    outputs = [*terminal.result_files(output), *([report] if report else [])]
    terminal.check_outputs(outputs, [*(frequency or []), *(time or [])], force)
    console = terminal.console()
    common: dict[str, Any] = {"dt": dt, "channel": channel}
    of_lines = Options(
        kind="frequency", fields=frequency_field, bound=frequency_bound, unit=frequency_unit, band=band, **common
    )
    of_records = Options(kind="time", fields=time_field, bound=time_bound, initial=initial, first=first, **common)
    of_records.check(time)
    lines, records = measurements(console, frequency, of_lines), measurements(console, time, of_records)
    modes = parse_modes(mode, (*lines, *records)[0].dt)
    with size_in_options(), step(console, "choosing modes and prior from the data"):
        proposal = propose(frequency=lines, time=records, modes=modes, prior=prior, repeat=repeat, delay=delay)
    with size_in_options():
        result = identified(console, proposal, objective, solver, accuracy, form)
    finish(console, result, output, report, reduce=reduce)
    raise typer.Exit(EXIT[result.status])


app.command()(run)
app.command()(excite)
app.command()(frf)
app.command()(fit)
app.command()(bounds)
app.command()(verify)
app.command()(reduce)
app.command()(report)
