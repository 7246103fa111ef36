"""The command line: robustid identify, reduce, report, demo."""

from __future__ import annotations

import pathlib
import sys
from typing import Annotated, Any

import typer

from robustid.errors import InputError, RobustIdError, Status

EXIT = {Status.CONSISTENT: 0, Status.INCONSISTENT: 3, Status.UNDECIDED: 1, Status.FAILED: 1}

app = typer.Typer(
    name="robustid",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="""Models with a proof, for lightly damped machines.

    Start with [bold]robustid demo[/bold]. With your own data: [bold]robustid identify --frequency frf.csv --time step.csv
    --dt 0.01 --frequency-bound 0.03 --time-bound 0.03[/bold].

    Exit codes: 0 consistent, 3 inconsistent (a finding, with its proof), 2 misuse, 1 undecided.""",
)

Path = pathlib.Path
Output = Annotated[Path, typer.Option("--output", "-o", help="Where results go: NAME.npz and NAME.json.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]


def main() -> None:
    """Entry point: misuse ends with one sentence and exit code 2."""
    try:
        app()
    except RobustIdError as error:
        _console(stderr=True).print(f"[bold red]error:[/bold red] {_plain(str(error))}", highlight=False)
        sys.exit(2)
    except KeyboardInterrupt:
        _console(stderr=True).print("interrupted: nothing was written after the last message above")
        sys.exit(130)


@app.command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("robustid-demo"),
    seed: Annotated[int, typer.Option(help="Noise of the simulated measurements.")] = 0,
) -> None:
    """Identify a simulated mass-beam structure, from measurements to a report. About ten seconds.

    Frequency lines from 1 to 21 Hz and a step response, noise bounded by 0.03; modes at 9 Hz (well damped) and 17.67 Hz
    (damping ratio 0.004). The program finds the modes and the prior by itself.
    """
    import numpy as np

    from robustid.data import flexible_structure, save

    data = flexible_structure(seed=seed, extra_hz=list(np.linspace(17.2, 18.1, 10)))
    output.mkdir(parents=True, exist_ok=True)
    for name, item in (("frequency.csv", data.frequency), ("step.csv", data.time)):
        save(output / name, item)
    console = _console()
    console.print(f"measurements written to {output / 'frequency.csv'} and {output / 'step.csv'}")
    result = _run([data.frequency], [data.time], None, None, 1, None, "center", "auto", 1e-4, output / "result",
                  output / "report.html", True, True)  # fmt: skip
    console.print(f"\nNext: open {output / 'report.html'} in a browser.")
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
    frequency_unit: Annotated[str, typer.Option(help='Unit of an omega column: "rad/s" or "Hz".')] = "rad/s",
    frequency_field: Annotated[
        list[str] | None,
        typer.Option(help="ROLE=NAME in the file: omega=w, real=Re, imag=Im, values=G.data, bound=eps."),
    ] = None,
    time_field: Annotated[
        list[str] | None, typer.Option(help="ROLE=NAME in the file: time=t, u=current, y=angle, bound=eps.")
    ] = None,
    initial: Annotated[
        str | None, typer.Option(help='State before a time record: "rest" (default), "free" or "periodic".')
    ] = None,
    channel: Annotated[str, typer.Option(help="OUTPUT,INPUT (from 0) where files hold several channels.")] = "0,0",
    mode: Annotated[
        list[str] | None,
        typer.Option(help='Parametric pair HZ:DAMPING, e.g. 17.67:0.004; "none" for none; default: from the data.'),
    ] = None,
    repeat: Annotated[int, typer.Option(help="Multiplicity of each pair; 2 absorbs small errors of the poles.")] = 1,
    delay: Annotated[int | None, typer.Option(help="Delay of the pairs in samples; default: from the data.")] = None,
    gain: Annotated[float | None, typer.Option(help="Prior: gain bound K of the non-parametric part.")] = None,
    decay: Annotated[float | None, typer.Option(help="Prior: decay rate rho > 1 per sample.")] = None,
    objective: Annotated[str, typer.Option(help="center, margin, gain or order.")] = "center",
    solver: Annotated[str, typer.Option(help='"auto", "cvxpy", or an installed cvxpy solver.')] = "auto",
    accuracy: Annotated[float, typer.Option(help="Width of the proven interval of the margin.")] = 1e-4,
    output: Output = Path("result"),
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    reduce: Annotated[bool, typer.Option(help="Look for the smallest model inside the bounds.")] = True,
    force: Force = False,
) -> None:
    """Decide whether measurements fit a class of systems, with a proof, and build a model.

    Without --mode, --gain and --decay the program chooses them from the data and says how.

    [bold]Example[/bold]: robustid identify --frequency frf.csv --time step.csv --dt 0.01 --frequency-bound 0.03
    --time-bound 0.03 --mode 9:0.1 --mode 17.67:0.004 --gain 0.2 --decay 1.1 --report report.html
    """
    from robustid.interpolation import Prior

    if not frequency and not time:
        raise InputError("`--frequency` and `--time` are both missing; give at least one file")
    if (gain is None) != (decay is None):
        raise InputError("`--gain` and `--decay` make one prior; give both, or neither to have it suggested")
    outputs = [_with_suffix(output, ".npz"), _with_suffix(output, ".json"), *([report] if report else [])]
    _refuse_existing(outputs, force)
    prior = None if gain is None or decay is None else Prior(gain_bound=gain, decay_rate=decay)
    lines = [_load(path, "frequency", frequency_field, dt, frequency_bound, frequency_unit, None, channel)
             for path in frequency or []]  # fmt: skip
    records = [_load(path, "time", time_field, dt, time_bound, frequency_unit, initial, channel) for path in time or []]
    result = _run(lines, records, _modes(mode), prior, repeat, delay, objective, solver, accuracy, output, report,
                  reduce, False)  # fmt: skip
    raise typer.Exit(EXIT[result.status])


@app.command()
def reduce(
    source: Annotated[
        Path, typer.Argument(help="A saved identification, or a model: .npz or .mat with A, B, C, D, dt.")
    ],
    order: Annotated[int | None, typer.Option(help="Number of states to keep.")] = None,
    tol: Annotated[
        float | None, typer.Option(help="Error bound, relative to the largest Hankel singular value.")
    ] = None,
    keep_unstable: Annotated[bool, typer.Option(help="Keep unstable poles and integrators exactly.")] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="The reduced model, .npz or .mat.")] = Path(
        "reduced.npz"
    ),
    force: Force = False,
) -> None:
    """Reduce a model: to the smallest order that keeps every sample inside its bound, or by balanced truncation.

    A saved identification without --order and --tol is searched for its smallest order inside the bounds; anything else
    is truncated, with the a-priori error bound.
    """
    from robustid.reduction import balanced_truncation
    from robustid.reduction.model_files import load_model, save_model

    _refuse_existing([output], force)
    console = _console()
    identification = _load_identification(source)
    if identification is not None and order is None and tol is None:
        with console.status("searching for the smallest order"):
            reduction = _smallest(identification, console)[1]
        for tried, margin in reduction.tried:
            console.print(f"order {tried:3d}: largest |residual|/bound {margin:.4g}", highlight=False)
        console.print(f"order {reduction.order}: {reduction.status.value}", highlight=False)
    else:
        model = load_model(source) if identification is None else identification.model
        unstable = "keep" if keep_unstable or identification is not None else "refuse"
        reduction = balanced_truncation(model, order=order, tol=tol, unstable=unstable)
        console.print(f"order {reduction.order} of {model.nstates}: {reduction.status.value}", highlight=False)
        console.print(f"error at most {reduction.bound:.6g}, in units of the response", highlight=False)
    save_model(reduction.model, output)
    console.print(f"written: {output}")


@app.command()
def report(
    source: Annotated[Path, typer.Argument(help="A saved identification (NAME, NAME.npz or NAME.json).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The HTML page.")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    reduce: Annotated[bool, typer.Option(help="Show the smallest model inside the bounds too.")] = True,
    force: Force = False,
) -> None:
    """Write the report of a saved identification again; its claims are verified again from the numbers."""
    from robustid.identification import load_identification
    from robustid.report import render_summary, write_report

    _refuse_existing([output], force)
    console = _console()
    result = load_identification(source)
    with console.status("searching for the smallest order"):
        reduction = _smallest(result, console)[1] if reduce else None
    write_report(result, output, reduction=reduction, title=title)
    console.print(render_summary(result, reduction))
    console.print(f"written: {output}")
    raise typer.Exit(EXIT[result.status])


def _run(
    lines: list, records: list, modes: Any, prior: Any, repeat: int, delay: int | None, objective: str, solver: str,
    accuracy: float, output: Path, report: Path | None, reduce: bool, titled: bool,
) -> Any:  # fmt: skip
    from robustid.identification import identify as solve
    from robustid.pipeline import propose
    from robustid.report import render_summary, write_report

    console = _console()
    with console.status("choosing modes and prior from the data"):
        proposal = propose(frequency=lines, time=records, modes=modes, prior=prior, repeat=repeat, delay=delay)
    for choice in proposal.choices:
        console.print(_plain(choice) + "\n", highlight=False)
    problem = proposal.problem
    with console.status(f"margin and model: {problem.coefficients} coefficients, {problem.samples} samples"):
        result = solve(problem, objective=objective, solver=solver, accuracy=accuracy)
    result.save(output)
    reduction = None
    if reduce:
        with console.status("searching for the smallest order"):
            _, reduction = _smallest(result, console)
    console.print(render_summary(result, reduction))
    if not result.consistent:
        from robustid.advice import diagnose

        with console.status("what would help: other modes, other priors"):
            console.print("\n" + _plain(diagnose(result).summary()), highlight=False)
    written = [_with_suffix(output, ".npz"), _with_suffix(output, ".json")]
    if report is not None:
        write_report(result, report, reduction=reduction, title="robustid demo" if titled else None)
        written.append(report)
    console.print("written: " + ", ".join(str(path) for path in written))
    return result


def _smallest(result: Any, console: Any) -> tuple[Any, Any]:
    from robustid.pipeline import smallest_model

    return smallest_model(result)


def _load(
    path: Path, kind: str, fields: list[str] | None, dt: float | None, bound: float | None, unit: str,
    initial: str | None, channel: str,
) -> Any:  # fmt: skip
    from robustid.data import load

    data = load(path, kind=kind, fields=_pairs(fields), dt=dt, bound=bound, frequency_unit=unit, initial=initial)
    try:
        row, column = (int(part) for part in channel.split(","))
    except ValueError:
        raise InputError(f"`--channel` must be OUTPUT,INPUT such as 0,0; got {channel!r}") from None
    return data.channel(row, column) if (len(data.outputs), len(data.inputs)) != (1, 1) else data


def _pairs(fields: list[str] | None) -> dict[str, str] | None:
    for field in fields or []:
        if "=" not in field:
            raise InputError(f"a field must be ROLE=NAME, such as u=current; got {field!r}")
    return dict(field.split("=", 1) for field in fields) if fields else None


def _modes(texts: list[str] | None) -> list[tuple[float, float]] | None:
    if texts is None:
        return None
    if texts == ["none"]:
        return []
    modes = []
    for text in texts:
        try:
            hz, damping = (float(part) for part in text.split(":"))
        except ValueError:
            raise InputError(f'`--mode` must be HZ:DAMPING such as 17.67:0.004, or "none"; got {text!r}') from None
        modes.append((hz, damping))
    return modes


def _load_identification(path: Path) -> Any:
    """The saved identification at `path`; None where the file is a plain model."""
    from robustid.identification import load_identification

    base = path.with_suffix("") if path.suffix in (".npz", ".json") else path
    return load_identification(base) if base.with_name(base.name + ".json").exists() else None


def _with_suffix(path: Path, suffix: str) -> Path:
    base = path.with_suffix("") if path.suffix in (".npz", ".json") else path
    return base.with_name(base.name + suffix)


def _refuse_existing(paths: list[Path], force: bool) -> None:
    for path in paths:
        if path.exists() and not force:
            raise InputError(f"{path} exists; choose another name, or pass --force to replace it")
        if not path.parent.is_dir():
            raise InputError(f"the folder {path.parent} does not exist; create it first")


def _console(**options: Any) -> Any:
    from rich.console import Console

    return Console(**options)


def _plain(text: str) -> str:
    """Text of users and files, with rich's markup neutralised."""
    from rich.markup import escape

    return escape(text)
