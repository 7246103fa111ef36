"""robustid bounds: how far every consistent system can be from the identified model, with certificates."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Output, Report, Static, Verbose, words_of
from robustid.app.cli.identify import smallest
from robustid.app.cli.screen import Next, in_words, telling
from robustid.app.run.settings import WorstCase
from robustid.errors import InputError

if TYPE_CHECKING:
    import control
    from rich.console import RenderableType

    from robustid.advice import KautzSuggestion
    from robustid.app.cli.terminal import Terminal
    from robustid.app.run.modes import Box
    from robustid.app.run.work import Work
    from robustid.bases import ParametricBasis
    from robustid.core import Real
    from robustid.guarantees import RobustStabilityMargin, WorstCaseError, WorstCaseOverPoles
    from robustid.identification import Identification, MixedProblem
    from robustid.report import Parts


_WORTH_PROCESSES = 10.0  # seconds of work from which their start is worth while
_GIVEN = (
    "poles      --poles covers the pole-uncertainty box around poles that the frequency response suggests; these poles"
    " were given otherwise: call worst_case_over_poles with the intervals that you know"
)


def bounds(
    *,
    context: typer.Context,
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
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Bound how far every consistent system can be from the identified model, with a certificate for every bound.

    A band over a pole-uncertainty box is narrowed by sums over its cells, where its error is largest first.

    [bold]Example[/bold]: robustid bounds result --circle --resume unfinished -o bounds --report bounds.html

    Exit codes: 0 every certificate holds, 1 not (or the identification is not verified), 2 misuse (inconsistent data too: there is
    nothing to bound), 70 an error of the program, 130 interrupted.
    """
    from robustid.app.load_save import load_result
    from robustid.app.run.controllers import read_controllers
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.sequence import bounded, circled
    from robustid.app.run.undoing import again
    from robustid.app.run.work import Step, Work, carry_out

    if omega and points:
        raise InputError("--omega and --points both say at which frequencies; give one of them")
    if controller and not how.circle:
        raise InputError("--controller needs the bound between the frequencies too: add --circle")
    found = _Bounds(screen.console(stderr=as_json, verbose=verbose), output, report, static, {})
    written_files.check_static(report, static)
    read = [*written_files.sources(source), *(controller or [])]
    written_files.check_outputs([*found.files(how.over_poles), report], read, force)
    found.loops = read_controllers(controller or [], "--controller")
    identification = load_result(source, "identification")
    if not identification.verification.passed:
        identification.require()
    at, suggested = _frequencies(identification, omega, points), suggested_modes(identification.problem)
    executor = _processes(identification, at, how.directions, workers)
    over_box: list[Step] = [lambda work: _over_box(work, suggested), found.keep_over_box]
    words = words_of(bounds, executor="--workers", identification="the identification")
    with in_words(words), telling(found.console) as progress:
        around = Surroundings(progress, executor=executor, resume=resume)
        asked = RunFile(worst_case=how)
        work = Work(run=asked, identification=identification, around=around, box=suggested_box(suggested), omega=at)
        carry_out(work, [lambda one: _proved(one, source), found.keep_proved, bounded, circled, found.keep_bounded])
        carry_out(work, over_box if how.over_poles else [])
        steps = found.draw(work, source)
        if around.stops.interrupted and resume is not None:
            steps = [Next("the rest, from what is finished", again(screen.called(context)))]
    found.conclude(work, steps)
    if not found.certified:
        screen.warn(found.console, "a certificate does not hold: robustid verify names it")
    code = 0 if found.certified else 1
    if as_json:
        from robustid.app.answers import verdicts

        bands = [one for one in (work.band, work.error, work.over_poles) if one is not None]
        screen.write(verdicts.bounded(identification, bands, found.written, found.margins, code), found.console)
    raise typer.Exit(code)


@dataclasses.dataclass
class _Bounds:
    """Files and sentences of the command: every bound is written as soon as it is there."""

    console: Terminal
    output: Path
    report: Path | None
    static: bool
    loops: dict[str, control.StateSpace]
    margins: dict[str, RobustStabilityMargin] = dataclasses.field(default_factory=dict[str, "RobustStabilityMargin"])
    certified: bool = True
    said: list[str] = dataclasses.field(default_factory=list[str])
    written: list[Path] = dataclasses.field(default_factory=list[Path])

    def beside(self, ending: str) -> Path:
        """NAME-poles, for the worst case over poles; NAME-band, for the band that is proved at every frequency."""
        base = written_files.result_files(self.output)[0].with_suffix("")
        return base.with_name(base.name + ending)

    def files(self, over_poles: bool) -> list[Path]:
        """Everything that may be written, but the page."""
        names = [self.output, *([self.beside("-poles")] if over_poles else []), self.beside("-band")]
        return [file for name in names for file in written_files.result_files(name)]

    def keep_proved(self, work: Work) -> None:
        """Keep the words on the band, before it is narrowed."""
        self.said += [] if work.band is None else [work.band.summary()]

    def keep_bounded(self, work: Work) -> None:
        """Keep the bounds at the frequencies, and what they say of the controllers."""
        from robustid.app.answers.parts import circle_words
        from robustid.core import pass_on

        if (error := work.error) is None:  # Ctrl-C came before the first frequency
            pass_on(work.band is None)
            self._keep_band(work)
            self.written += written_files.result_files(self.beside("-band"))
            return
        self._verify(work, error)
        _kept(work, error).save(self.output)
        known = error.known_circle is not None or not work.around.stops.interrupted
        on_circle = [f"circle     {circle_words(error)}"] if work.run.worst_case.circle and known else []
        self.said += [error.summary(), *on_circle]
        loops = self.loops if known else {}
        self.margins = {name: error.robust_stability_margin(loop) for name, loop in loops.items()}
        self.written += written_files.result_files(self.output)
        self._keep_band(work)
        self.written += [] if work.band is None else written_files.result_files(self.beside("-band"))

    def keep_over_box(self, work: Work) -> None:
        """Keep the bounds over the poles."""
        if (found := work.over_poles) is None or work.error is None:
            self.said.append(_GIVEN)
            return
        self._verify(work, found)
        found.save(self.beside("-poles"))
        done, asked = found.omega.size, work.error.omega.size
        late = f"unfinished {done} of {asked} frequencies are bounded in all cells of the box"
        head = "with every pole in the pole-uncertainty box that the data leave:"
        self.said += [head, *([] if done == asked else [late]), found.summary()]
        self._keep_band(work)
        self.written += written_files.result_files(self.beside("-poles"))

    def draw(self, work: Work, source: Path) -> Sequence[Next | str]:
        """Write the page; the next steps."""
        from robustid.report import render_report

        steps = [smallest(source)]
        kept = [file.with_suffix("") for file in self.written if file.suffix == ".npz"]
        again = [source, *(word for one in kept for word in ("--bounds", one))]

        def draw() -> str:
            told, parts = work.around.told, self._parts(work)
            return render_report(work.identification, static=self.static, progress=told, **parts)

        report, said = screen.drawn(self.report, draw, again, steps)
        self.written += [] if report is None else [report]
        return said or []

    def _parts(self, work: Work) -> Parts:
        return {**work.parts, "stability": self.margins or None}

    def conclude(self, work: Work, steps: Sequence[Next | str]) -> None:
        """Say what was found."""
        from robustid.report import first_screen, verdict

        verdicts = {name: verdict(margin) for name, margin in self.margins.items()}
        head = first_screen(work.identification, **self._parts(work))
        said = [dataclasses.replace(one, word=f"Controller {name}: {one.word}") for name, one in verdicts.items()]
        shown = dataclasses.replace(head.glance, numbers=[*head.glance.numbers, *_swept(work.error)])
        head = dataclasses.replace(head, head=[*head.head, *said], glance=shown)
        screen.conclude(self.console, head, self._everything(work), written=self.written, steps=steps)

    def _everything(self, work: Work) -> Callable[[], list[RenderableType]]:
        from robustid.report import render_summary

        def found() -> list[RenderableType]:
            margins = [
                part for name, one in self.margins.items() for part in (f"controller {name}:", render_summary(one))
            ]
            return [*self.said, *margins, *(f"warning: {words}" for words in work.identification.warnings)]

        return found

    def _verify(self, work: Work, found: WorstCaseError | WorstCaseOverPoles) -> None:
        work.around.say("verifying every certificate")
        self.certified &= found.certified

    def _keep_band(self, work: Work) -> None:
        """Keep the band with what polygons add to it, and say that."""
        from robustid.app.run.sequence import narrowed, refined

        over_box = work.band is not None and work.band.box is not None
        (narrowed if over_box and not work.run.worst_case.over_poles else refined)(work)
        if work.band is not None:
            if work.band.narrowing_words:
                self.said.append(f"band       {work.band.narrowing_words}")
            work.band.save(self.beside("-band"))


def _proved(work: Work, source: Path) -> None:
    """The band that stands beside the identification, about its model; where there is none, or an unfinished one, it is proved."""
    from robustid.app.run.sequence import proved

    known = written_files.kept_beside(source, "-band", work.identification)
    if known is None or known.unfinished or known.polygons is not None:
        proved(work)
    else:
        work.band, work.box = known.with_model(work.identification.model), known.box


def _kept(work: Work, error: WorstCaseError) -> WorstCaseError:
    """The bounds as they are saved: where the circle was left out, they say so on every page."""
    from robustid.app.run.results import marked

    if not work.run.worst_case.circle or error.known_circle is not None:
        return error
    return dataclasses.replace(
        error, identification=marked(error.identification, work.around.unfinished, "robustid bounds")
    )


def _over_box(work: Work, suggested: KautzSuggestion | None) -> None:
    """The step over the pole-uncertainty box which the data leave to the poles that they suggest; nothing of other poles."""
    from robustid.app.run.sequence import bounded_over

    if suggested is not None and work.error is not None:
        intervals = suggested.omega_interval, suggested.damping_interval
        bounded_over(work, *intervals, suggested.delay, work.error.omega)


def suggested_modes(problem: MixedProblem) -> KautzSuggestion | None:
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


def suggested_box(found: KautzSuggestion | None) -> Box | None:
    """The pole-uncertainty box of poles that the data suggest; None of others, which were stated."""
    if found is None:
        return None
    light = found.damping < 1
    return found.omega_interval[light], found.damping_interval[light]


def _same_poles(one: ParametricBasis | None, other: ParametricBasis | None) -> bool:
    import numpy as np

    if one is None or other is None or one.poles.shape != other.poles.shape:
        return False
    return np.allclose(one.in_s().poles, other.in_s().poles, atol=1e-6)


def _swept(error: WorstCaseError | None) -> list[tuple[str, str]]:
    """The bounds at single frequencies as a number of the first screen."""
    if error is None or not error.omega.size:
        return []
    from robustid.report import at_least, at_most

    count, upper, lower = error.omega.size, error.sigma_upper.max(), error.sigma_lower.max()
    where = "at 1 frequency" if count == 1 else f"at {count} frequencies"
    return [(f"{where}, poles as they stand", f"≤ {at_most(upper, 3)} (attained: {at_least(lower, 3)})")]


def _frequencies(identification: Identification, omega: list[float] | None, points: int | None) -> Real | None:
    """The frequencies that are asked for, in rad/s; `points` are equally spaced over the range of the usual ones; None: those."""
    import numpy as np

    from robustid.guarantees import default_grid

    if not points:
        return np.array(omega) if omega else None
    grid = default_grid(identification.problem)
    return np.linspace(float(grid[0]), float(grid[-1]), points)


def _processes(identification: Identification, omega: Real | None, directions: int, asked: int | None) -> int | None:
    """Number of processes; None for this one. The work: about 10 ms a side, growing with the third power of the coefficients."""
    if asked is not None:
        return None if asked == 1 else asked
    cores, count = os.cpu_count() or 1, 70 if omega is None else len(omega)
    work = count * directions * (0.01 + 4e-7 * identification.coefficients.size**3)
    return min(cores, count) if cores > 1 and count > 1 and work > _WORTH_PROCESSES else None
