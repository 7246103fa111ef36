"""robustid fit: a matrix fraction from a file with a frequency response."""

from __future__ import annotations

import pathlib
import re
from collections.abc import Callable
from typing import Annotated, Any

import typer

from robustid.app.cli import terminal
from robustid.app.cli.steps import in_words, shown
from robustid.app.cli.terminal import plain, step, warn
from robustid.errors import InputError

Path = pathlib.Path
_OUTPUT = Path("fit.npz")
_OPTIONS = {
    "rigid_body": "--rigid-body",
    "degree": "--roll-off",
    "feedthrough": "--feedthrough",
    "form": "--form",
    "domain": "--domain",
}
_OPTIONS |= {"order": "--order", "orders": "--order", "method": "--method", "covariance": "the covariance in the file"}


def fit(
    source: Annotated[Path, typer.Argument(help="Frequency response, any number of channels: .csv, .npz or .mat.")],
    order: Annotated[str, typer.Option(help='McMillan degree, with two states for every rigid-body mode; or "auto".')],
    rigid_body: Annotated[
        int, typer.Option(min=0, help="Number of rigid-body modes: undamped, poles at zero exactly.")
    ] = 0,
    form: Annotated[str | None, typer.Option(help="right (N/D, default) or left (D\\N).")] = None,
    domain: Annotated[str | None, typer.Option(help="s or z; default: z where the file has a sample time.")] = None,
    relative: Annotated[
        bool | None,
        typer.Option(
            "--relative/--covariance",
            help="Weight of the residuals: relative, or the covariance in the file (default where there is one).",
        ),
    ] = None,
    roll_off: Annotated[
        int | None, typer.Option(min=1, help="The response falls at least with this power of frequency; in z: delay.")
    ] = None,
    feedthrough: Annotated[
        bool,
        typer.Option("--feedthrough", help="The response may differ from 0 at infinity: accelerometers, no delay."),
    ] = False,
    band: Annotated[str | None, typer.Option(help="LOW:HIGH in Hz: use only the lines between.")] = None,
    method: Annotated[str, typer.Option(help="Iterations after the start: lm, gn, sk, iv, joined by + .")] = "lm",
    dt: Annotated[float | None, typer.Option(help="Sample time in s, where the file doesn't say.")] = None,
    frequency_unit: Annotated[
        str | None, typer.Option(help='Unit of an omega column: "rad/s" (default) or "Hz".')
    ] = None,
    frequency_field: Annotated[
        list[str] | None, typer.Option(help="ROLE=NAME in the file, as in robustid identify: values=G.data, omega=w.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The model: NAME.npz, or .mat.")] = _OUTPUT,
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    r"""Fit a matrix fraction N/D of given order to a measured frequency response, stable and with condition number one.

    With --order auto a range of orders is fitted, on all cores, and the smallest description length (MDL) decides.

    [bold]Example[/bold]: robustid fit frf.npz --order 20 --rigid-body 3 --band 10:2000 --report fit.html

    Exit codes: 0 converged and verified, 1 not, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.data import Options
    from robustid.mfd import RigidBody, RollOff, Weight
    from robustid.report import FitView, mfd_facts, render_report, render_summary

    wanted, model_file = _order(order), _model_file(output)
    options = Options(kind="frequency", fields=frequency_field, dt=dt, unit=frequency_unit, band=band)
    options.check([source])
    terminal.check_outputs([model_file, *([report] if report else [])], [source], force)
    console = terminal.console()
    frf = _read(console, source, options)
    asked: dict[str, Any] = {"form": form, "domain": domain, "method": method, "feedthrough": feedthrough}
    asked["rigid_body"] = RigidBody(rigid_body) if rigid_body else None
    asked["constraints"] = (RollOff(roll_off),) if roll_off else ()
    sweep = None
    with in_words(_OPTIONS | {"frf": source.name, "values": source.name}):
        if relative is False and frf.covariance is None:
            raise InputError(f"--covariance: {source.name} holds no covariance; leave the option out")
        if relative:
            asked["weight"] = Weight.relative(frf.values)
        if wanted is None:
            sweep = _swept(console, frf, asked)
            wanted = sweep.suggested
        result = _fitted(console, frf, wanted, asked)
    page = "" if report is None else _drawn(console, render_report, result, frf, sweep)
    _write(result, model_file, report, page)
    if sweep is not None:
        console.print(plain(sweep.summary()), highlight=False)
    console.print(render_summary(result, data=frf))
    written = [model_file, *([report] if report else [])]
    console.print(plain("written: " + ", ".join(map(str, written))), highlight=False, soft_wrap=True)
    raise typer.Exit(0 if mfd_facts.verdict(FitView(result)).key == "consistent" else 1)


def _order(text: str) -> int | None:
    """None for "auto"."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[1-9]\d*", text):
        raise InputError(f'--order must be a positive whole number or "auto"; got {text!r}')
    return int(text)


def _model_file(output: Path) -> Path:
    if output.suffix.lower() in (".npz", ".mat"):
        return output
    if output.suffix.lower() in (".csv", ".txt", ".json", ".html"):
        raise InputError(f"--output {output} must end in .npz or .mat")
    return output.with_name(output.name + ".npz")


def _read(console: Any, source: Path, options: Any) -> Any:
    """All channels of the file, and a line that says what was read."""
    from robustid.app.cli.data import field_pairs, part, reading
    from robustid.data import load
    from robustid.data.io import origin

    fields = field_pairs(options)
    with reading(source, "frequency"):
        found = origin(source, "frequency", fields)
        if found.kind not in (None, "frequency"):
            raise InputError(f"{source.name} holds {found.kind} data; a frequency response is needed")
        unit = options.unit or "rad/s"
        frf: Any = load(source, kind="frequency", fields=fields, dt=options.dt, frequency_unit=options.unit)
        frf = part(frf, options)
    size = f"{len(frf.outputs)} x {len(frf.inputs)} (outputs x inputs)"
    text = f"read {source}: {frf.omega.size} lines, {frf.freq_hz[0]:.5g} to {frf.freq_hz[-1]:.5g} Hz, {size}"
    text += ", continuous time" if frf.dt is None else f", dt = {frf.dt:g} s"
    text += ", with covariance" if frf.covariance is not None else ""
    if not found.unit_known:
        other = "" if unit.lower() == "hz" else " (--frequency-unit Hz if the file has Hz)"
        text += f"; omega read as {unit}{other}"
    console.print(plain(text), highlight=False, soft_wrap=True)
    if found.unit_known and options.unit is not None:
        warn(console, f"--frequency-unit is ignored: {source.name} says the unit of its frequencies")
    return frf


def _fitted(console: Any, frf: Any, order: int, asked: dict[str, Any]) -> Any:
    """The fit, every iteration shown."""
    from robustid.mfd import fit_mfd

    text = f"fitting order {order}: {frf.omega.size} lines"
    with shown(console, text) as show:
        count = 0

        def progress(line: Any) -> None:
            nonlocal count
            count += 1
            show(
                f"{text}; iteration {count}, {line.method}, cost {line.cost:.6g}, kappa - 1 = {line.condition - 1:.1e}"
            )

        return fit_mfd(frf, order=order, progress=progress, **asked)


def _swept(console: Any, frf: Any, asked: dict[str, Any]) -> Any:
    """A sweep over the order on all cores; the criteria are those of plain least squares, stable or not."""
    from robustid.core import worker_pool
    from robustid.mfd import suggest_order

    with shown(console, "fitting a range of orders") as show, worker_pool() as pool:

        def progress(done: int, count: int) -> None:
            show(f"fitting a range of orders: {done} of {count}")

        sweep = suggest_order(frf, executor=pool, progress=progress, stable=False, **asked)
    if sweep.orders.size > 1 and sweep.suggested == sweep.orders[-1]:
        warn(console, f"order {sweep.suggested} is the largest one tried; give a larger --order by hand to compare")
    return sweep


def _drawn(console: Any, render: Callable[..., str], result: Any, frf: Any, sweep: Any) -> str:
    with step(console, "drawing the report"):
        return render(result, data=frf, order_sweep=sweep)


def _write(result: Any, model_file: Path, report: Path | None, page: str) -> None:
    """Everything is computed by now."""
    from robustid.core import atomic_write
    from robustid.data.io import save_model

    save_model(result.model, model_file)
    if report is not None:
        with atomic_write(report) as file:
            file.write(page)
