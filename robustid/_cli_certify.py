"""robustid bounds and robustid verify: what is guaranteed, and whether its proofs hold."""

from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Callable
from typing import Annotated, Any

import typer

from robustid import _terminal as terminal
from robustid._cli_steps import in_words, repeat_warnings, say_written, shown, sources
from robustid._terminal import plain, step
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
            help="Cover the box that the data leave to the poles too, where they were taken from them: printed, may take minutes.",
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
    from robustid.certify import worst_case_error
    from robustid.identification import load_identification

    if omega and points:
        raise InputError("--omega and --points both say at which frequencies; give one of them")
    terminal.check_outputs(terminal.result_files(output), sources(source), force)
    console = terminal.console()
    identification = load_identification(source)
    with in_words(_OPTIONS):
        asked: Any = _spaced(identification, points) if points else omega
        spread = {"executor": _processes(identification, asked, directions, workers), "resume": resume}
        try:
            with shown(console, _BOUNDING) as show:
                error = worst_case_error(
                    identification,
                    omega=asked,
                    directions=directions,
                    rtol=rtol,
                    progress=_counted(show, _BOUNDING),
                    **spread,
                )
            if circle:
                with shown(console, _BETWEEN) as show:
                    error.on_circle(rtol, progress=_counted(show, _BETWEEN), **spread)
        except KeyboardInterrupt:
            if resume is not None:
                terminal.warn(console, f"finished frequencies are in {resume}: the same command goes on from there")
            raise
    with step(console, "verifying every certificate"):
        certified = error.certified
    error.save(output)
    console.print(plain(error.summary()), highlight=False, soft_wrap=True)
    if circle:
        console.print(plain(_on_circle(error)), highlight=False, soft_wrap=True)
    say_written(console, *terminal.result_files(output))
    if poles:
        console.print(plain(_over_poles(console, error)), highlight=False, soft_wrap=True)
    repeat_warnings(console, identification)
    if not certified:
        terminal.warn(console, "a certificate does not hold: robustid verify names it")
    raise typer.Exit(0 if certified else 1)


def _over_poles(console: Any, error: Any) -> str:
    """The band that covers the box which the data leave to the poles that they suggest, in words."""
    import numpy as np

    from robustid.advice import suggest_kautz
    from robustid.certify import worst_case_over_poles

    problem = error.identification.problem
    found = suggest_kautz(problem.frequency[0]) if problem.frequency else None
    mine = problem.parametric.poles if problem.parametric is not None else np.zeros(0)
    theirs = found.basis.poles if found is not None and found.basis is not None else np.zeros(0)
    if (
        found is None
        or not mine.size
        or mine.shape != theirs.shape
        or not np.allclose(np.sort(mine), np.sort(theirs), atol=1e-6)
    ):
        return (
            "poles      --poles covers the box around poles that the frequency response suggests; these poles were given otherwise:"
            " call worst_case_over_poles with the intervals that you know"
        )
    with shown(console, _BOXES) as show:
        band = worst_case_over_poles(
            error.identification,
            found.omega_interval,
            found.damping_interval,
            delay=found.delay,
            omega=error.omega,
            progress=_counted(show, _BOXES),
        )
    return "with every pole in the box that the data leave:\n" + band.summary()


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
    from robustid.certify import load_worst_case_error
    from robustid.certify.storage import FORMAT
    from robustid.identification import load_identification

    console = terminal.console()
    with in_words(_OPTIONS):
        if _format(source) == FORMAT:
            error = load_worst_case_error(source)
            failed = _identification_failures(console, error.identification, exact)
            failed += _bound_failures(console, error, exact)
        else:
            failed = _identification_failures(console, load_identification(source), exact)
    how = (
        "in double precision with allowances, and in ball arithmetic"
        if exact
        else "in double precision with allowances"
    )
    console.print(
        f"evaluated  {how}; the problem's arrays as they are in double precision", highlight=False, soft_wrap=True
    )
    console.print(
        "assumed    gain bound, decay rate, poles and bounds of the samples: data can refute them, never prove them",
        highlight=False,
        soft_wrap=True,
    )
    for name in failed:
        console.print(f"[red]FAILED[/red]     {plain(name)}", highlight=False, soft_wrap=True)
    console.print("[red]not verified[/red]" if failed else "[green]verified[/green]", highlight=False)
    raise typer.Exit(1 if failed else 0)


def _format(source: Path) -> str | None:
    """What the text beside the numbers says it is; None where it can't be read."""
    from robustid.identification.storage import paths

    try:
        return json.loads(paths(source)[1].read_text(encoding="utf-8"))["format"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _identification_failures(console: Any, result: Any, exact: bool) -> list[str]:
    """Print what an identification claims; the names of what does not hold."""
    from robustid.identification.forms import pose
    from robustid.interpolation import verify_margin_exactly

    console.print(plain(f"claimed    {result.status.value}"), highlight=False, soft_wrap=True)
    console.print(plain(f"           {_margin(result)}"), highlight=False, soft_wrap=True)
    failed = []
    for check in result.verification.checks:
        word = "verified" if check.holds else "FAILED"
        text = f"{word:<11}{check.name}: {check.measured:.3g} (limit {check.limit:.8g})"
        console.print(plain(text), highlight=False, soft_wrap=True)
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
    upper, count, intervals = error.upper, len(error.values), error.parameters.lower.size
    text = f"claimed    every consistent system is within {upper.max():.4g} of the model at {count} frequencies"
    text += f", and {intervals} coefficients are in their intervals" if intervals else ""
    console.print(text, highlight=False, soft_wrap=True)
    total = error.claim_count
    failed, words = [], "evaluating certificates"
    with shown(console, words) as show:
        progress = _counted(show, words)
        for done, claim in enumerate(error.claims(), start=1):
            failed += [] if claim.verify(exact) else [claim.name]
            progress(done, total)
    word = "FAILED" if failed else "verified"
    console.print(f"{word:<11}{total - len(failed)} of {total} certificates hold", highlight=False)
    if "circle" in error.__dict__:
        console.print(plain(_on_circle(error)), highlight=False, soft_wrap=True)
        if not error.circle_supported:
            failed.append("bound on the circle, from its ends of arcs")
    console.print("recorded   what was attained: as the computation found it, not evaluated again", highlight=False)
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

    from robustid.certify.worst_case import default_grid

    grid = default_grid(identification)
    return np.linspace(grid[0], grid[-1], points)


def _processes(identification: Any, omega: Any, directions: int, asked: int | None) -> int | None:
    """How many processes; None for this one. The work: about 10 ms a side, growing with the third power of the coefficients."""
    if asked is not None:
        return None if asked == 1 else asked
    cores, count = os.cpu_count() or 1, 70 if omega is None else len(omega)
    work = count * directions * (0.01 + 4e-7 * identification.coefficients.size**3)
    return min(cores, count) if cores > 1 and count > 1 and work > _WORTH_PROCESSES else None
