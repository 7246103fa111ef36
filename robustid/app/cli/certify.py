"""robustid bounds and robustid verify: what is guaranteed, and whether its proofs hold."""

from __future__ import annotations

import contextlib
import os
import pathlib
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer

from robustid.app.cli import terminal
from robustid.app.cli.steps import in_words, repeat_warnings, say_written, shown, sources
from robustid.app.cli.terminal import plain, step
from robustid.errors import InputError

Path = pathlib.Path
_OPTIONS = {name: f"--{name}" for name in ("omega", "directions", "rtol", "resume", "exact")}
_OPTIONS |= {"executor": "--workers", "identification": "the identification"}
_OUTPUT = Path("bounds")
_WORTH_PROCESSES = 10.0  # seconds of work from which their start is worth while


def bounds(
    source: Annotated[Path, typer.Argument(help="A saved identification (NAME, NAME.npz or NAME.json).")],
    omega: Annotated[
        list[float] | None,
        typer.Option(help="Frequency in rad/s. Repeatable. Default: about 70 over the range of the data."),
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(min=2, help="So many frequencies, equally spaced from the lowest to the Nyquist frequency."),
    ] = None,
    directions: Annotated[
        int, typer.Option(help="Sides of the polygon around the values at a frequency, 3 to 360.")
    ] = 16,
    rtol: Annotated[
        float, typer.Option(help="Aim for the distance of the bounds from what is attained, relative.")
    ] = 0.05,
    circle: Annotated[
        bool,
        typer.Option(
            "--circle", help="Bound the error at every frequency, between those evaluated too; may take long."
        ),
    ] = False,
    poles: Annotated[
        bool,
        typer.Option(
            "--poles",
            help="Cover the box that the data leave to the poles too, where they were taken from them: NAME-poles, may take"
            " minutes.",
        ),
    ] = False,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes. Default: all cores where it is worth it.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="Folder for finished frequencies: an interrupted run goes on from there.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Where results go: NAME.npz and NAME.json.")] = _OUTPUT,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Bound how far every consistent system can be from the identified model, with a certificate for every bound.

    [bold]Example[/bold]: robustid bounds result --circle --resume unfinished -o bounds

    Exit codes: 0 every certificate holds, 1 not, 2 misuse (inconsistent data too: there is nothing to bound), 70 an error of the
    program, 130 interrupted.
    """
    from robustid.app.files import load_result

    if omega and points:
        raise InputError("--omega and --points both say at which frequencies; give one of them")
    written, written_poles = terminal.result_files(output), terminal.result_files(_beside(output))
    terminal.check_outputs([*written, *(written_poles if poles else ())], sources(source), force)
    console = terminal.console()
    identification = load_result(source, "identification")
    asked: Any = _spaced(identification, points) if points else omega
    spread = {"executor": _processes(identification, asked, directions, workers), "resume": resume}
    with in_words(_OPTIONS), _resumable(console, resume):
        error = _bounded(console, identification, asked, directions, rtol, circle, spread)
    certified = _certified(console, error)
    error.save(output)
    _say(console, error.summary(), *([_on_circle(error)] if circle else []))
    say_written(console, *written)
    if poles:
        with in_words(_OPTIONS), _resumable(console, resume):
            band = _over_poles(console, error, spread)
        if band is None:
            _say(console, _GIVEN)
        else:
            certified &= _certified(console, band)
            band.save(_beside(output))
            _say(console, "with every pole in the box that the data leave:", band.summary())
            say_written(console, *written_poles)
    repeat_warnings(console, identification)
    if not certified:
        terminal.warn(console, "a certificate does not hold: robustid verify names it")
    raise typer.Exit(0 if certified else 1)


def _beside(output: Path) -> Path:
    """Where the band over poles goes: NAME-poles."""
    base = terminal.result_files(output)[0].with_suffix("")
    return base.with_name(base.name + "-poles")


@contextlib.contextmanager
def _resumable(console: Any, resume: Path | None) -> Iterator[None]:
    """Say on Ctrl-C where what is finished can be found."""
    try:
        yield
    except KeyboardInterrupt:
        if resume is not None:
            terminal.warn(console, f"finished frequencies are in {resume}: the same command goes on from there")
        raise


def _bounded(
    console: Any, identification: Any, omega: Any, directions: int, rtol: float, circle: bool, spread: dict[str, Any]
) -> Any:
    """The bounds at the frequencies, and between them where asked."""
    from robustid.guarantees import worst_case_error

    with shown(console, _BOUNDING) as show:
        progress = _counted(show, _BOUNDING)
        error = worst_case_error(
            identification, omega=omega, directions=directions, rtol=rtol, progress=progress, **spread
        )
    if circle:
        with shown(console, _BETWEEN) as show:
            error.on_circle(rtol, progress=_counted(show, _BETWEEN), **spread)
    return error


def _certified(console: Any, result: Any) -> bool:
    with step(console, "verifying every certificate"):
        return result.certified


def _over_poles(console: Any, error: Any, spread: dict[str, Any]) -> Any:
    """The band that covers the box which the data leave to the poles that they suggest; None for other poles."""
    from robustid.advice import suggest_kautz
    from robustid.guarantees import worst_case_over_poles

    problem = error.identification.problem
    found = suggest_kautz(problem.frequency[0]) if problem.frequency else None
    if found is None or not _same_poles(found.basis, problem.parametric):
        return None
    with shown(console, _BOXES) as show:
        return worst_case_over_poles(
            error.identification,
            found.omega_interval,
            found.damping_interval,
            delay=found.delay,
            omega=error.omega,
            progress=_counted(show, _BOXES),
            **spread,
        )


def _same_poles(one: Any, other: Any) -> bool:
    import numpy as np

    if one is None or other is None or one.poles.shape != other.poles.shape:
        return False
    return np.allclose(one.poles, other.poles, atol=1e-6)


_GIVEN = (
    "poles      --poles covers the box around poles that the frequency response suggests; these poles were given otherwise:"
    " call worst_case_over_poles with the intervals that you know"
)
_BOXES = "bounding the error over the box of the poles"
_BOUNDING, _BETWEEN = "bounding the error at every frequency", "bounding the error between the frequencies"


def verify(
    source: Annotated[
        Path, typer.Argument(help="A saved identification or saved bounds (NAME, NAME.npz or NAME.json).")
    ],
    exact: Annotated[
        bool, typer.Option("--exact", help="In ball arithmetic too, every rounding enclosed: needs robustid[exact].")
    ] = False,
) -> None:
    """Evaluate every proof in a file again, from its numbers and without a solver.

    Exit codes: 0 all hold, 1 one does not, 2 misuse (files that do not belong together too), 70 an error of the program,
    130 interrupted.
    """
    from robustid.app.files import load_result
    from robustid.guarantees import WorstCaseError, WorstCaseOverPoles

    console = terminal.console()
    with in_words(_OPTIONS):
        result = load_result(source)
        failed = _identification_failures(console, getattr(result, "identification", result), exact)
        if isinstance(result, WorstCaseError):
            failed += _bound_failures(console, result, exact)
        elif isinstance(result, WorstCaseOverPoles):
            failed += _band_failures(console, result, exact)
    how = "in double precision with allowances" + (", and in ball arithmetic" if exact else "")
    _say(console, f"evaluated  {how}; the problem's arrays as they are in double precision", _ASSUMED)
    for name in failed:
        console.print(f"[red]FAILED[/red]     {plain(name)}", highlight=False, soft_wrap=True)
    console.print("[red]not verified[/red]" if failed else "[green]verified[/green]", highlight=False)
    raise typer.Exit(1 if failed else 0)


_ASSUMED = "assumed    gain bound, decay rate, poles and bounds of the samples: data can refute them, never prove them"


def _say(console: Any, *texts: str) -> None:
    """Plain text, as it stands."""
    for text in texts:
        console.print(plain(text), highlight=False, soft_wrap=True)


def _identification_failures(console: Any, result: Any, exact: bool) -> list[str]:
    """Print what an identification claims; the names of what does not hold."""
    from robustid.identification import pose, verify_margin_exactly

    _say(console, f"claimed    {result.status.value}", f"           {_margin(result)}")
    failed = []
    for check in result.verification.checks:
        word = "verified" if check.holds else "FAILED"
        _say(console, f"{word:<11}{check.name}: {check.measured:.3g} (limit {check.limit:.8g})")
        failed += [] if check.holds else [check.name]
    if exact:
        rows, sarason = (data := pose(result.problem, result.sections).data).rows, data.sarason
        if not verify_margin_exactly(result.certificate, rows, sarason):
            failed.append("certificate of the margin, in ball arithmetic")
    return failed


def _margin(result: Any) -> str:
    low, high = f"{result.margin_lower:.6g}", f"{result.margin:.6g}"
    if result.certificate.value > 1:
        return f"no system of the class keeps every |residual| below {low} times its bound: the class is refuted"
    return f"margin {high}, reached by a system of the class, and proved not below {low}"


def _bound_failures(console: Any, error: Any, exact: bool) -> list[str]:
    """Print what the bounds claim; the names of what does not hold."""
    upper, count, intervals = error.sigma_upper, error.omega.size, error.parameters.lower.size
    text = f"claimed    every consistent system is within {upper.max():.4g} of the model at {count} frequencies"
    _say(console, text + (f", and {intervals} coefficients are in their intervals" if intervals else ""))
    failed = _claim_failures(console, error, exact)
    if error.known_circle is not None:
        _say(console, _on_circle(error))
        if not error.circle_supported:
            failed.append("bound on the circle, from its ends of arcs")
    _say(console, "recorded   what was attained: as the computation found it, not evaluated again")
    return failed


def _band_failures(console: Any, band: Any, exact: bool) -> list[str]:
    """Print what a band over poles claims; the names of what does not hold."""
    _say(console, "claimed    of all poles in a box:", band.summary())
    if not band.covered:
        return ["cells of poles: they leave out a part of the box"]
    failed = _claim_failures(console, band, exact)
    return failed if band.supported else [*failed, "bounds, from those of the cells"]


def _claim_failures(console: Any, result: Any, exact: bool) -> list[str]:
    """Evaluate every certificate, count those that hold, name the others."""
    total = result.claim_count
    failed, words = [], "evaluating certificates"
    with shown(console, words) as show:
        progress = _counted(show, words)
        for done, claim in enumerate(result.claims(), start=1):
            failed += [] if claim.verify(exact) else [claim.name]
            progress(done, total)
    word = "FAILED" if failed else "verified"
    _say(console, f"{word:<11}{total - len(failed)} of {total} certificates hold")
    return failed


def _on_circle(error: Any) -> str:
    found = error.circle
    text = f"circle     |F - model| <= {found.largest:.4g} at every frequency from {found.edges[0]:.4g} rad/s to pi/dt"
    return text + f" (attained: {found.lower:.4g})" + ("" if found.converged else "; to less accuracy than asked")


def _counted(show: Callable[[str], None], words: str) -> Callable[[int, int], None]:
    """Progress in at most ten steps."""
    last = -1

    def progress(done: int, count: int) -> None:
        nonlocal last
        if 10 * done // count != last:
            last = 10 * done // count
            show(f"{words}: {done} of {count}")

    return progress


def _spaced(identification: Any, points: int) -> Any:
    """Equally spaced frequencies over the range of the default ones."""
    import numpy as np

    from robustid.guarantees import default_grid

    grid = default_grid(identification)
    return np.linspace(grid[0], grid[-1], points)


def _processes(identification: Any, omega: Any, directions: int, asked: int | None) -> int | None:
    """How many processes; None for this one. The work: about 10 ms a side, growing with the third power of the coefficients."""
    if asked is not None:
        return None if asked == 1 else asked
    cores, count = os.cpu_count() or 1, 70 if omega is None else len(omega)
    work = count * directions * (0.01 + 4e-7 * identification.coefficients.size**3)
    return min(cores, count) if cores > 1 and count > 1 and work > _WORTH_PROCESSES else None
