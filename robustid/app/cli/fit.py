"""robustid fit: a matrix fraction from a file with a frequency response, and its stabilisation diagram."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Report, Static, Verbose, only, words_of
from robustid.app.cli.screen import Next, in_words, telling, warn
from robustid.app.run.checks import options
from robustid.app.run.settings import Fit, FrequencyPoints
from robustid.app.run.sources import ResponseSource
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from rich.console import RenderableType

    from robustid.app.cli.terminal import Terminal
    from robustid.core import Options, Real
    from robustid.data import FrequencyResponse
    from robustid.fitting import MatrixFraction, OrderSweep, Weight
    from robustid.report import Parts

_WIDTH = 56  # characters of the frequency axis
_MARKS = {"stable": "o", "frequency": "+", "damping": ".", "new": "."}
_STRONGER = ".+o"  # of two marks in one place the later one stays


def fit(
    *,
    context: typer.Context,
    source: Annotated[Path, typer.Argument(help="Frequency response, SISO or MIMO: .csv, .npz or .mat.")],
    order: Annotated[
        str,
        typer.Option(
            help='McMillan degree, with two states for every rigid-body mode; or "auto". Number of poles for --form shared.'
        ),
    ] = "auto",
    structure: Annotated[Fit, only("rigid_body", "modal", "symmetric", "quantity")],
    form: Annotated[
        str | None, typer.Option(help="right (N/D, default), left (D\\N), or shared: poles that all entries share.")
    ] = None,
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
    limits: Annotated[Fit, only("feedthrough", "time_limit")],
    points: FrequencyPoints,
    method: Annotated[str, typer.Option(help="Iterations after the start: lm, gn, sk, iv, joined by + .")] = "lm",
    response: Annotated[
        ResponseSource, only("dt", "rate", "unit", "fields", "axes", "decimal", "start", "step", "correct")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="NAME for the whole fit (NAME.npz and NAME.json, for robustid report and load), or its model alone: NAME.npz or"
            " NAME.mat.",
        ),
    ] = Path("fit.npz"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    r"""Fit a matrix fraction N/D of given order to a measured frequency response, stable and with condition number one.

    With --order auto a range of orders is fitted, on all cores: the smallest description length (MDL), the stated bounds and the
    error at withheld frequency points decide; with -v the stabilisation diagram grows line by line. Ctrl-C in a fit takes the best
    model so far.

    [bold]Example[/bold]: robustid fit frf.npz --order 20 --rigid-body 3 --band 10:2000 --report fit.html

    Exit codes: 0 converged, verified, and a fit of 50 % or more of every output; 4 that, but of data with a fault that nothing
    has undone; 1 not, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.measured_files import Files
    from robustid.app.run.undoing import again, in_command, placed_faults
    from robustid.fitting import RollOff
    from robustid.formats import save_model
    from robustid.report import first_screen, render_report, verdict

    wanted, model_files = _order(order), _model_files(output)
    asked_files = Files(paths=[source], source=response, band_hz=points.band_hz)
    written_files.check_static(report, static)
    written_files.check_outputs([*model_files, report], [source], force)
    console = screen.console(stderr=as_json, verbose=verbose)
    (frf,) = asked_files.read(console)
    asked: Options = {"form": form, "domain": domain, "method": method} | {
        "constraints": (RollOff(roll_off),) if roll_off else ()
    }
    words = {"degree": "--roll-off", "orders": "--order", "covariance": "the covariance in the file"}
    words |= {"frf": source.name, "values": source.name}
    with in_words(words_of(fit, **words)):
        both = dataclasses.replace(structure, feedthrough=limits.feedthrough, time_limit=limits.time_limit)
        asked |= both.arguments | _weight(source, frf, relative)
        sweep = _swept(console, frf, asked) if wanted is None else None
        result = _fitted(console, frf, int(wanted or 0), asked) if sweep is None else _best(console, frf, sweep, asked)
    faults = placed_faults(frf)
    undoing = in_command(again(screen.called(context)), faults, [source], [])
    good = Status.CONSISTENT if verdict(result, sweep).key == "consistent" else Status.UNDECIDED
    steps = _steps(good, sweep, screen.called(context)) or _next(source, frf, model_files[0], screen.called(context))
    commands = [(one.what, one.command) for one in steps]
    kept = len(model_files) > 1  # a fit that is kept has a page later, too

    def draw() -> str:
        with telling(console) as progress:
            shown: Parts = {"data": frf, "order_sweep": sweep, "undoing": undoing, "steps": commands}
            return render_report(result, static=static, progress=progress, **shown)

    def save() -> None:
        if kept:
            result.save(output)
        else:
            save_model(result.model, output)

    report, after = screen.drawn(report, draw, [written_files.stem(output)] if kept else [], steps, save)
    steps = after or []
    head = first_screen(result, data=frf, order_sweep=sweep)
    written = [*model_files, report]
    screen.conclude(
        console, head, lambda: _everything(result, frf, sweep), written=written, undoing=undoing, steps=steps
    )
    code = screen.exit_code(good, any(not one.fault.undone for one in faults))
    if as_json:
        from robustid.app.answers import verdicts

        status = "fitted" if good is Status.CONSISTENT else "undecided"
        screen.write(verdicts.fitted(result, status, [one.fault for one in faults], head, code, written), console)
    raise typer.Exit(code)


def _everything(result: MatrixFraction, frf: FrequencyResponse, sweep: OrderSweep | None) -> list[RenderableType]:
    from robustid.report import render_summary

    found = render_summary(result, data=frf, order_sweep=sweep)
    return [found] if sweep is None else [sweep.summary(), found]


def _steps(good: Status, sweep: OrderSweep | None, called: list[str]) -> list[Next]:
    """Commands before anything is done with the fit: the orders that Ctrl-C left out, or others than one that misses the data."""
    from robustid.app.run.undoing import again, with_value

    if sweep is not None and sweep.interrupted:
        return [Next("all the orders", again(called))]
    if good is Status.CONSISTENT or sweep is not None:
        return []
    return [Next("a range of orders, compared", again(with_value(called, "--order", "auto")))]


def _next(source: Path, frf: FrequencyResponse, model: Path, called: list[str]) -> list[Next]:
    """A proof from the same file, read in the same way; the model for another program where no bound of errors is known."""
    from robustid.app.run.undoing import options_among
    from robustid.estimation import estimate_bound

    name, flags = model.with_suffix(""), {option.flag for _, option in options(ResponseSource) if option.flag}
    try:
        known = frf.bound is not None or estimate_bound(frf)
    except InputError:
        known = False
    if not known:
        return [Next("the model for MATLAB", ["export", model, "-o", f"{written_files.free(name, '.m')}.m"])]
    read = options_among(called, {*flags, "--band"})
    proved = written_files.free(name.with_name(f"{name.name}-proved"), ".npz", ".json", ".html")
    proof = ["identify", "--frequency", source, *read, "-o", proved, "--report", f"{proved}.html"]
    return [Next("a proof, and a bound of the error, which least squares do not give", proof)]


def _weight(source: Path, frf: FrequencyResponse, relative: bool | None) -> dict[str, Weight]:
    """The weight that is asked for; the default of the fit without."""
    from robustid.fitting import Weight

    if relative is False and frf.covariance is None:
        raise InputError(f"--covariance: {source.name} holds no covariance; leave the option out")
    return {"weight": Weight.relative(frf.values)} if relative else {}


def _order(text: str) -> int | None:
    """None for "auto"."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[1-9]\d*", text):
        raise InputError(f'--order must be a positive whole number or "auto"; got {text!r}')
    return int(text)


def _model_files(output: Path) -> list[Path]:
    """The file of the model, or both files of the whole fit."""
    if output.suffix.lower() in (".npz", ".mat"):
        return [output]
    if output.suffix.lower() in (".csv", ".txt", ".json", ".html"):
        raise InputError(f"--output {output} must end in .npz or .mat, or have no ending for the whole fit")
    return list(written_files.result_files(output))


def _fitted(console: Terminal, frf: FrequencyResponse, order: int, asked: Options) -> MatrixFraction:
    """The fit; at a terminal every iteration is shown."""
    from robustid.core import counted
    from robustid.fitting import fit_mfd

    text = f"fitting order {order}: {counted(frf.omega.size, 'frequency point')}"
    with telling(console) as tell:
        tell(text, 0, 0)

        def progress(line: str, number: int, _: int) -> None:
            if console.is_terminal:
                tell(f"fitting order {order}, iteration {number}: {line}", 0, 0)

        return fit_mfd(frf, order=order, progress=progress, **asked)


def _best(console: Terminal, frf: FrequencyResponse, sweep: OrderSweep, asked: Options) -> MatrixFraction:
    """The fit of the order that a sweep suggests; after Ctrl-C that of the sweep, which says what it has left out."""
    if sweep.interrupted:
        return dataclasses.replace(sweep.fits[sweep.suggested], unfinished=sweep.unfinished)
    return _fitted(console, frf, sweep.suggested, asked)


def _swept(console: Terminal, frf: FrequencyResponse, asked: Options) -> OrderSweep:
    """A sweep over the order on all cores; if everything is asked for, the stabilisation diagram grows with it."""
    from robustid.core import worker_pool
    from robustid.fitting import suggest_order

    diagram = Stabilisation(frf.omega)
    with telling(console) as tell, worker_pool() as pool:
        tell("fitting a range of orders", 0, 0)

        def grown(sweep: OrderSweep) -> None:
            if console.verbose:
                screen.say(console, *diagram.lines(sweep))

        sweep = suggest_order(frf, executor=pool, progress=tell, grown=grown, **asked)
        if sweep.interrupted:
            pool.end()
    if sweep.orders.size > 1 and sweep.suggested == sweep.orders[-1]:
        warn(console, f"order {sweep.suggested} is the largest one tried; give a larger --order by hand to compare")
    return sweep


class Stabilisation:
    """Lines of a stabilisation diagram over a logarithmic frequency axis, each given once; points at 0 rad/s have no place."""

    def __init__(self, omega: Real) -> None:
        known = omega[omega > 0]
        self.low, self.high = float(known.min()), float(known.max())
        self.told: set[int] = set()

    def lines(self, sweep: OrderSweep) -> list[str]:
        """Lines of the orders that are new, below the axis at first, and what the sweep suggests so far."""
        new = [order for order in sweep.fits if order not in self.told]
        out = [] if self.told else self._axis()
        self.told.update(new)
        withheld = dict(zip(sweep.orders.tolist(), sweep.withheld.tolist(), strict=True))
        for order in new:
            error = f"  withheld {100 * withheld[order]:.3g} %" if math.isfinite(withheld[order]) else ""
            out.append(f"{order:5d} |{self._marks(sweep, order)}|{error}")
        return [*out, f"so far order {sweep.suggested} {sweep.reason}"]

    def _axis(self) -> list[str]:
        from robustid.core import hz_words

        ends = [hz_words(omega / (2 * math.pi), 4) for omega in (self.low, self.high)]
        return [
            "poles by order: o as in the order before, + only the frequency, . new",
            f"order  {ends[0]}{ends[1]:>{_WIDTH - len(ends[0])}}",
        ]

    def _marks(self, sweep: OrderSweep, order: int) -> str:
        """The poles of an order, each at its natural frequency; those beside the band at its ends."""
        marks = [" "] * _WIDTH
        span = math.log(self.high / self.low) or 1.0
        for row in sweep.stabilisation:
            if row.order == order and row.frequency > 0:
                part = min(max(math.log(row.frequency / self.low) / span, 0.0), 1.0)
                place = round(part * (_WIDTH - 1))
                mark = _MARKS[row.kind]
                if marks[place] == " " or _STRONGER.index(mark) > _STRONGER.index(marks[place]):
                    marks[place] = mark
        return "".join(marks)
