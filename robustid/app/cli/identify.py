"""robustid identify: from files to a verdict with its proof, and a model."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict, Unpack

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, First, Force, Output, Report, Static, Verbose
from robustid.app.cli.screen import Next, say, telling
from robustid.app.run.checks import too_large
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.loop_settings import LoopChoice
from robustid.app.run.settings import FrequencyPoints, General, Identify, Modes, Withheld
from robustid.app.run.sources import RecordSource, ResponseSource
from robustid.errors import InputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from robustid.app.cli.terminal import Terminal
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.work import Step, Work
    from robustid.data import FrequencyResponse, TimeRecord
    from robustid.guarantees import Band, LoopBounds
    from robustid.identification import Loop


class Stated(TypedDict, total=False):
    """Sections of a run file that state the class."""

    modes: Modes
    prior: PriorChoice
    identify: Identify


def identify(
    *,
    context: typer.Context,
    frequency: Annotated[
        list[Path] | None, typer.Option("--frequency", help="Frequency response: .csv, .npz or .mat. Repeatable.")
    ] = None,
    time: Annotated[
        list[Path] | None, typer.Option("--time", help="Time record: .csv, .npz or .mat. Repeatable.")
    ] = None,
    responses: ResponseSource,
    records: RecordSource,
    points: FrequencyPoints,
    first: First = None,
    general: General,
    mode: Annotated[
        list[str] | None,
        typer.Option(
            help='Parametric pair, e.g. 17.67:0.004; "none" for none; default: from the data. Repeatable.',
            metavar="HZ:DAMPING",
        ),
    ] = None,
    modes: Modes,
    prior: PriorChoice,
    how: Identify,
    loop: LoopChoice,
    output: Output = Path("result"),
    report: Report = None,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Where the data contradict the class: make the change of the most likely cause."),
    ] = False,
    static: Static = False,
    reduce: Annotated[bool, typer.Option(help="Look for the smallest model inside the bounds.")] = True,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Decide whether measurements fit a class of systems, with a proof, and build a model.

    Without --mode, --gain and --decay-rate the program chooses them from the data and says how.
    Files are written at the end, all together; the band that is proved at every frequency beside the result, as NAME-band, which
    report, bounds, loop, control and watch take from there.

    [bold]Example[/bold]: robustid identify --frequency frf.csv --time step.csv --dt 0.01 --frequency-bound 0.03
    --time-bound 0.03 --mode 9:0.1 --mode 17.67:0.004 --gain 0.2 --decay-rate 1.1 --report report.html

    Exit codes: 0 consistent, 3 inconsistent (a finding, with its proof), 4 either, but of data with a fault that nothing has
    undone, 1 undecided or not solved, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.measured_files import Files
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.sequence import diagnosed, in_loop, proved, reduced, refined, sharpened
    from robustid.app.run.undoing import again, in_command
    from robustid.app.run.work import carry_out
    from robustid.core import Budget

    paths = [*(frequency or []), *(time or [])]
    if not paths:
        raise InputError("--frequency and --time are both missing; give at least one file", argument="frequency")
    flags = {"gain_bound": "--gain", "decay_rate": "--decay-rate", "decay": "--decay", "passive": "--passive"}
    prior.check(flags | {"roll_off": "--roll-off", "corner_hz": "--corner", "weight": "--weight"})
    written_files.check_static(report, static)
    names = [output, written_files.beside(output, "-band"), *([written_files.beside(output, "-loop")] * loop.is_stated)]
    written_files.check_outputs(
        [*(file for one in names for file in written_files.result_files(one)), report], paths, force
    )
    console, entry = screen.console(stderr=as_json, verbose=verbose), general.entry
    asked_lines = Files(paths=frequency or [], source=responses, entry=entry, band_hz=points.band_hz, bounded=True)
    asked_samples = Files(paths=time or [], source=records, entry=entry, first=first, bounded=True)
    lines, samples = asked_lines.read(console), asked_samples.read(console)
    _warn_of_faults(console, lines, samples)
    running, lines = _opened(loop, lines, samples)
    modes = _with_pairs(modes, mode, (*lines, *samples)[0].dt)
    changed: list[Step] = [lambda work: _apply(console, work)] if apply else []
    smaller: list[Step] = [reduced] if reduce else []
    with telling(console) as progress:
        around = Surroundings(progress, budget=Budget(general.time_limit))
        with around.stops.listening():
            work = work_on(lines, samples, around, modes=modes, prior=prior, identify=how)
            work.loop = running
            carry_out(work, [*changed, proved, *smaller, diagnosed, refined, sharpened, in_loop])
    origins = asked_lines.origins, asked_samples.origins
    work.undoing = in_command(again(screen.called(context)), work.identification.problem.placed_faults, *origins)
    steps = next_of(work, output, screen.called(context))
    page = conclude(console, work, output, report, steps=steps, static=static)
    found = work.identification
    code = screen.exit_code(found.verified_status, bool(found.problem.open_faults))
    if as_json:
        from robustid.app.answers import verdicts

        files = [*files_of(work, output), *([page] if page else [])]
        screen.write(verdicts.identified(work, files, code), console)
    raise typer.Exit(code)


def _opened(
    choice: LoopChoice, lines: list[FrequencyResponse], samples: list[TimeRecord]
) -> tuple[Loop | None, list[FrequencyResponse]]:
    """The loop that responses from r to y were measured in, and those of its R; without one as they are."""
    choice.check("--loop:")
    if not choice.is_stated:
        return None, lines
    if samples or not lines:
        raise InputError(
            "--loop takes the response of the closed loop, --frequency; of records `robustid run` with [loop] estimates that of R"
        )
    from robustid.app.run.looped import loop_of

    running = loop_of(choice, Path(), [], lines, {})
    return running, [running.opened_response(one) for one in lines]


def _warn_of_faults(console: Terminal, lines: list[FrequencyResponse], samples: list[TimeRecord]) -> None:
    """Warn of records that the responses beside them do not explain."""
    from robustid.estimation import experiment_faults

    for response in lines:
        same = [one for one in samples if (len(one.outputs), len(one.inputs)) == response.values.shape[1:]]
        for fault in experiment_faults(response, same) if same else ():
            screen.warn(console, str(fault))


def _apply(console: Terminal, work: Work) -> None:
    """The change of the most likely cause, where that makes the data consistent; one of the choices."""
    from robustid.app.run.sequence import diagnosed
    from robustid.core import Choice, Source
    from robustid.identification import identify as solve

    diagnosed(work)
    if work.diagnosis is None:
        return
    cause = next(iter(work.diagnosis.causes), None)
    if cause is None or not cause.solves:
        say(console, "nothing is applied: no change that was tried makes the data consistent")
        return
    words = f"Applied: {cause.option or cause.change}, because {cause.cause} ({cause.evidence})."
    say(console, words)
    changed = solve(cause.problem, **work.run.identify.arguments)
    applied = {"applied": Choice(cause.change, Source.PROGRAM, words)}
    work.identification = dataclasses.replace(changed, choices=applied | work.identification.choices | changed.choices)
    work.diagnosis = None


def _with_pairs(modes: Modes, texts: list[str] | None, dt: float | None) -> Modes:
    """Modes with the pairs of --mode HZ:DAMPING, checked in Hz; none for "none"."""
    if not texts:
        return modes
    pairs = [] if texts == ["none"] else [_pair(text, dt) for text in texts]
    return dataclasses.replace(modes, hz=tuple(hz for hz, _ in pairs), damping=tuple(d for _, d in pairs))


def _pair(text: str, dt: float | None) -> tuple[float, float]:
    try:
        hz, damping = (float(number) for number in text.split(":"))
    except ValueError:
        raise InputError(f'--mode must be HZ:DAMPING such as 17.67:0.004, or "none"; got {text!r}') from None
    if not 0 < damping <= 1:
        raise InputError(
            f"--mode {text}: the damping is a ratio between 0 and 1 (1 for a real pole), not percent (10 % is 0.1); got {damping:g}"
        )
    nyquist = 0.5 / dt if dt else math.inf
    if not (hz > 0 and hz * math.sqrt(1 - damping**2) < nyquist):
        raise InputError(
            f"--mode {text}: the frequency must lie between 0 and the Nyquist frequency, {nyquist:g} Hz at dt = {dt:g} s;"
            f" got {hz:g} Hz"
        )
    return hz, damping


def work_on(
    frequency: Sequence[FrequencyResponse], time: Sequence[TimeRecord], around: Surroundings, **stated: Unpack[Stated]
) -> Work:
    """The identification of data as the sections of a run file state it, with all choices; nothing is kept out."""
    from robustid.app.run.measurements import Measured
    from robustid.app.run.modes import box_of_modes
    from robustid.app.run.posing import posed
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.sequence import identified
    from robustid.app.run.work import Work

    asked = RunFile(withheld=Withheld(every=0), **stated)
    with too_large(
        "--band LOW:HIGH keeps the frequency points between two frequencies in Hz, --first N the first N time samples, --entry"
        ' OUTPUT,INPUT one entry (split = "entries" in a run file: each)'
    ):
        around.say("choosing modes and prior from the data")
        run, problem, _ = posed(asked, Measured(tuple(frequency), tuple(time)), around, reference=False)
        result = identified(run, problem, around)
    return Work(run=run, identification=result, around=around, box=box_of_modes(run.modes))


def next_of(work: Work, output: Path, called: Sequence[str]) -> list[Next | str] | None:
    """Steps to go on with an identification; None for those of its page."""
    from robustid.app.run.undoing import again
    from robustid.errors import Status

    found, name = work.identification, written_files.stem(output)
    if found.verified_status is Status.CONSISTENT:
        bounds = written_files.free(name.with_name(f"{name.name}-bounds"), ".npz", ".json", "-band.npz", ".html")
        words = "the error at single frequencies"
        if work.band is not None and work.band.box is not None:
            words = f"a narrower band, and {words}"
        return [Next(words, ["bounds", name, "-o", bounds, "--report", f"{bounds}.html"])]
    if (diagnosis := work.diagnosis) is None or not called or not any(one.solves for one in diagnosis.causes[:1]):
        return None
    return [*diagnosis.next_steps[:1], Next("with that change", [*again(called), "--apply"])]


def smallest(source: Path) -> Next:
    """The step to the smallest model inside the bounds."""
    name = written_files.stem(source)
    small = written_files.free(name.with_name(f"{name.name}-small"), ".npz")
    return Next("the smallest model inside the bounds", ["reduce", source, "-o", f"{small}.npz"])


def conclude(
    console: Terminal,
    work: Work,
    output: Path,
    report: Path | None,
    *,
    steps: Sequence[Next | str] | None,
    static: bool = False,
    title: str | None = None,
) -> Path | None:
    """Write everything, the page last, and show what was found; the page, None where Ctrl-C has left it out."""
    from robustid.app.run.results import marked
    from robustid.report import first_screen, render_report

    result, undoing = work.identification, work.undoing

    def draw() -> str:
        with telling(console) as progress:
            return render_report(result, title=title, static=static, progress=progress, **work.parts)

    def save() -> None:
        marked(result, work.around.unfinished, "the identification").save(output)
        for name, one in beside_it(work, output):
            one.save(name)

    report, shown = screen.drawn(report, draw, [written_files.stem(output)], steps, save)
    if shown is not steps:  # the page first: it says what else is to be done
        steps, undoing = shown, None
    head = first_screen(result, **work.parts)
    written = (*files_of(work, output), report)
    screen.conclude(console, head, lambda: everything(work), written=written, undoing=undoing, steps=steps)
    return report


def beside_it(work: Work, output: Path) -> list[tuple[Path, Band | LoopBounds]]:
    """The band of an identification, and what is known of its loop, with the names under which they stand beside it."""
    both = ("-band", work.band), ("-loop", work.looped)
    return [(written_files.beside(output, ending), one) for ending, one in both if one is not None]


def files_of(work: Work, output: Path) -> list[Path]:
    """All files of an identification."""
    return [
        file
        for name in (output, *(name for name, _ in beside_it(work, output)))
        for file in written_files.result_files(name)
    ]


def everything(work: Work) -> list[RenderableType]:
    """All that is found of an identification, as rich shows it."""
    from robustid.report import render_summary

    found: list[RenderableType] = [
        render_summary(work.identification, work.reduction, unfinished=work.around.unfinished)
    ]
    found += [] if work.band is None else [work.band.summary()]
    found += [] if work.diagnosis is None else ["\n" + work.diagnosis.summary()]
    return [*found, *(f"warning: {sentence}" for sentence in work.identification.warnings)]
