"""robustid bounds: how far every consistent system can be from the identified model, with certificates."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import Force, Output, Report, Static, words_of
from robustid.app.cli.screen import counting, in_words, resumable, say, step
from robustid.app.run.settings import WorstCase
from robustid.errors import InputError

if TYPE_CHECKING:
    import control
    from rich.console import Console

    from robustid.advice import KautzSuggestion
    from robustid.bases import ParametricBasis
    from robustid.core import Real
    from robustid.guarantees import Band, WorstCaseError, WorstCaseOverPoles
    from robustid.identification import Identification, MixedProblem
    from robustid.report import Parts


class Spread(TypedDict):
    """Spread of work over frequencies: over so many processes, its finished part in a folder."""

    executor: int | None
    resume: Path | None


_WORTH_PROCESSES = 10.0  # seconds of work from which their start is worth while
_GIVEN = (
    "poles      --poles covers the pole-uncertainty box around poles that the frequency response suggests; these poles"
    " were given otherwise: call worst_case_over_poles with the intervals that you know"
)
_BOXES = "bounding the error over the pole-uncertainty box"
_BOUNDING, _BETWEEN = "bounding the error at every frequency", "bounding the error between the frequencies"


def bounds(
    *,
    source: Annotated[Path, typer.Argument(help="A saved identification (NAME, NAME.npz or NAME.json).")],
    omega: Annotated[
        list[float] | None,
        typer.Option(help="Frequency in rad/s. Repeatable. Default: about 70 over the range of the data."),
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(min=2, help="So many frequencies, equally spaced from the lowest to the Nyquist frequency."),
    ] = None,
    how: WorstCase,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes. Default: all cores where it is worth it.")
    ] = None,
    controller: Annotated[
        list[Path] | None,
        typer.Option(
            help="Controller K of u = -K y, a model in .npz or .mat with the sample time of the data: its stability margin against"
            " every consistent system, which needs --circle. Repeatable."
        ),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="Folder for finished frequencies: an interrupted run goes on from there.")
    ] = None,
    output: Output = Path("bounds"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
) -> None:
    """Bound how far every consistent system can be from the identified model, with a certificate for every bound.

    [bold]Example[/bold]: robustid bounds result --circle --resume unfinished -o bounds --report bounds.html

    Exit codes: 0 every certificate holds, 1 not, 2 misuse (inconsistent data too: there is nothing to bound), 70 an error of the
    program, 130 interrupted.
    """
    from robustid.app.load_save import load_result
    from robustid.app.run.proved_band import proved_band, refined_band
    from robustid.report import render_summary, write_report

    if omega and points:
        raise InputError("--omega and --points both say at which frequencies; give one of them")
    if controller and not how.circle:
        raise InputError("--controller needs the bound between the frequencies too: add --circle")
    written, written_poles = written_files.result_files(output), written_files.result_files(_beside(output))
    written_files.check_static(report, static)
    both = [*written, *(written_poles if how.over_poles else ()), *written_files.result_files(_beside(output, "-band"))]
    written_files.check_outputs([*both, report], [*written_files.sources(source), *(controller or [])], force)
    console = screen.console()
    loops = {path.stem: _controller(path) for path in controller or []}
    identification = load_result(source, "identification")
    asked = _spaced(identification, points) if points else omega
    spread: Spread = {"executor": _processes(identification, asked, how.directions, workers), "resume": resume}
    words = words_of(bounds, executor="--workers", identification="the identification")
    found_again = f"finished frequencies are in {resume}: the same command goes on from there"
    with step(console, "proving the error at every frequency"):
        proved = proved_band(identification, _box(identification.problem), identification.model)
    if proved is not None:
        say(console, proved.summary())
    with in_words(words), resumable(console, found_again, lambda: resume is not None):
        error = _bounded(console, identification, asked, how, spread, proved)
    certified, band = _certified(console, error), None
    error.save(output)
    say(console, error.summary(), *([circle_words(error)] if how.circle else []))
    margins = {name: error.robust_stability_margin(loop) for name, loop in loops.items()}
    for name, margin in margins.items():
        say(console, f"controller {name}:")
        console.print(render_summary(margin))
    proved = refined_band(proved, error)
    if proved is not None:
        _say_refined(console, proved)
        proved.save(_beside(output, "-band"))
        written = [*written, *written_files.result_files(_beside(output, "-band"))]
    screen.say_written(console, *written)
    if how.over_poles:
        with in_words(words), resumable(console, found_again, lambda: resume is not None):
            band = _over_poles(console, error, how, spread, proved)
        if band is None:
            say(console, _GIVEN)
        else:
            certified &= _certified(console, band)
            band.save(_beside(output))
            say(console, "with every pole in the pole-uncertainty box that the data leave:", *_unfinished(error, band))
            say(console, band.summary())
            proved = refined_band(proved, error, band)
            if proved is not None:
                _say_refined(console, proved)
                proved.save(_beside(output, "-band"))
            screen.say_written(console, *written_poles)
    if report is not None:
        with step(console, "drawing the report"):
            found: Parts = {"worst_case": error, "over_poles": band, "band": proved, "stability": margins or None}
            write_report(identification, report, static=static, **found)
        screen.say_written(console, report)
    screen.repeat_warnings(console, identification)
    if not certified:
        screen.warn(console, "a certificate does not hold: robustid verify names it")
    raise typer.Exit(0 if certified else 1)


def _controller(path: Path) -> control.StateSpace:
    """The controller that a file holds."""
    from robustid.app.load_save import load

    if not path.is_file():
        raise InputError(f"--controller {path}: there is no such file")
    return load(path, kind="model")


def _beside(output: Path, ending: str = "-poles") -> Path:
    """NAME-poles, for the worst case over poles; NAME-band, for the band that is proved at every frequency."""
    base = written_files.result_files(output)[0].with_suffix("")
    return base.with_name(base.name + ending)


def _say_refined(console: Console, band: Band) -> None:
    """Say what semidefinite programs add to the band that was shown before."""
    if band.polygons is not None:
        say(console, f"band       {band.polygon_words}")


def _bounded(
    console: Console,
    identification: Identification,
    omega: Real | list[float] | None,
    how: WorstCase,
    spread: Spread,
    known: Band | None,
) -> WorstCaseError:
    """The bounds at the frequencies, and between them where asked."""
    from robustid.guarantees import worst_case_error

    with counting(console, _BOUNDING) as progress:
        error = worst_case_error(identification, omega=omega, known=known, progress=progress, **how.arguments, **spread)
    if how.circle:
        with counting(console, _BETWEEN) as progress:
            error = error.completed(executor=spread["executor"])
            error.on_circle(how.rtol, progress=progress, **spread)
    return error


def _certified(console: Console, result: WorstCaseError | WorstCaseOverPoles) -> bool:
    with step(console, "verifying every certificate"):
        return result.certified


def _over_poles(
    console: Console, error: WorstCaseError, how: WorstCase, spread: Spread, known: Band | None
) -> WorstCaseOverPoles | None:
    """The band that covers the pole-uncertainty box which the data leave to the poles that they suggest; None for other poles."""
    from robustid.guarantees import worst_case_over_poles

    found = _suggested(error.identification.problem)
    if found is None:
        return None
    with counting(console, _BOXES) as progress:
        return worst_case_over_poles(
            error.identification,
            found.omega_interval,
            found.damping_interval,
            delay=found.delay,
            omega=error.omega,
            progress=progress,
            time_limit=how.time_limit,
            known=known,
            **spread,
        )


def _suggested(problem: MixedProblem) -> KautzSuggestion | None:
    """The modes that the first frequency response suggests; None where those of the problem are others."""
    from robustid.advice import suggest_kautz
    from robustid.data import FrequencyResponse

    first = next((one for one in problem.frequency if isinstance(one, FrequencyResponse)), None)
    if first is None or problem.parametric is None:
        return None
    try:
        found = suggest_kautz(first)
    except InputError:  # too few frequency points for any
        return None
    return found if _same_poles(found.basis, problem.parametric) else None


def _box(problem: MixedProblem) -> tuple[Real, Real] | None:
    """The pole-uncertainty box of poles that the data suggest; None of others, which were stated."""
    found = _suggested(problem)
    if found is None:
        return None
    light = found.damping < 1
    return found.omega_interval[light], found.damping_interval[light]


def _unfinished(error: WorstCaseError, band: WorstCaseOverPoles) -> list[str]:
    """Words for what the time limit left out; none where nothing is missing."""
    done, asked = band.omega.size, error.omega.size
    return [] if done == asked else [f"unfinished {done} of {asked} frequencies are bounded in all cells of the box"]


def _same_poles(one: ParametricBasis | None, other: ParametricBasis | None) -> bool:
    import numpy as np

    if one is None or other is None or one.poles.shape != other.poles.shape:
        return False
    return np.allclose(one.in_s().poles, other.in_s().poles, atol=1e-6)


def circle_words(error: WorstCaseError) -> str:
    """The bound on the whole circle in words."""
    found, end = error.circle, "pi/dt" if error.identification.problem.dt else "infinity"
    text = f"circle     |F - model| <= {found.largest:.4g} at every frequency from {found.edges[0]:.4g} rad/s to {end}"
    return text + f" (attained: {found.lower:.4g})" + ("" if found.converged else "; to less accuracy than asked")


def _spaced(identification: Identification, points: int) -> Real:
    """Equally spaced frequencies over the range of the default ones."""
    import numpy as np

    from robustid.guarantees import default_grid

    grid = default_grid(identification.problem)
    return np.linspace(float(grid[0]), float(grid[-1]), points)


def _processes(
    identification: Identification, omega: Real | list[float] | None, directions: int, asked: int | None
) -> int | None:
    """Number of processes; None for this one. The work: about 10 ms a side, growing with the third power of the coefficients."""
    if asked is not None:
        return None if asked == 1 else asked
    cores, count = os.cpu_count() or 1, 70 if omega is None else len(omega)
    work = count * directions * (0.01 + 4e-7 * identification.coefficients.size**3)
    return min(cores, count) if cores > 1 and count > 1 and work > _WORTH_PROCESSES else None
