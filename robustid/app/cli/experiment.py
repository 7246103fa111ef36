"""robustid excite and robustid frf: what to play, and the response from what was recorded."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, First, Force, Report, Static, Verbose, only, words_of
from robustid.app.cli.screen import Next, in_words, step, telling
from robustid.app.run.checks import low_high
from robustid.app.run.sources import Estimate, RecordSource
from robustid.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robustid.core import Options
    from robustid.data import Excitation, FrequencyResponse, TimeRecord, Undoing
    from robustid.report import Parts

_SAME_STEP = 1e-6  # part of a sample time


def excite(
    band: Annotated[
        str, typer.Option(help="The spectral lines between two frequencies in Hz, edges included.", metavar="LOW:HIGH")
    ],
    dt: Annotated[float, typer.Option(help="Sample time.", metavar="SECONDS")],
    period: Annotated[
        int, typer.Option(help="Samples of one period; the lines are 1/(period dt) apart, in Hz.", metavar="SAMPLES")
    ],
    spacing: Annotated[
        str,
        typer.Option(
            help="Lines in the band: all, odd (even distortion falls between them), random-odd (one in four left out at random,"
            " for odd distortion) or log."
        ),
    ] = "all",
    lines_per_decade: Annotated[int, typer.Option(help="For --spacing log.")] = 20,
    inputs: Annotated[int, typer.Option(help="Number of inputs; every realisation has as many experiments.")] = 1,
    realisations: Annotated[
        int, typer.Option(help="Sets of experiments with other random phases, to see nonlinear distortion.")
    ] = 1,
    periods: Annotated[int, typer.Option(help="Periods of every experiment in a .csv file.")] = 1,
    amplitude: Annotated[
        list[float] | None, typer.Option(help="Largest |u|; default 1. Repeatable: one for every input.")
    ] = None,
    rms: Annotated[
        list[float] | None, typer.Option(help="Root mean square, instead. Repeatable: one for every input.")
    ] = None,
    minimise_crest: Annotated[
        bool, typer.Option(help="Choose phases for a small crest factor, or leave them purely random.")
    ] = True,
    seed: Annotated[int, typer.Option(help="Of the random phases and lines.")] = 0,
    output: Annotated[Path, typer.Option("--output", "-o", help="The signals, .csv or .npz.")] = Path("play.csv"),
    force: Force = False,
) -> None:
    """Design what to play next: multisines on chosen spectral lines with small crest factor, orthogonal over the inputs.

    A .csv file has columns time, u1_exp1, u2_exp1, ...: input 1 and 2 of experiment 1, and so on.

    [bold]Example[/bold]: robustid excite --band 1:500 --dt 1e-4 --period 10000 --inputs 2 --realisations 4 --periods 8
    --amplitude 0.5 -o play.csv

    Exit codes: 0 written, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.data import multisine

    written_files.check_ending(output, (".csv", ".npz"))
    written_files.check_outputs([output], [], force)
    console = screen.console()
    with in_words(words_of(excite, band_hz="--band", path="--output")):
        asked: Options = {"band_hz": low_high("--band", band), "period": period, "spacing": spacing}
        asked |= {"lines_per_decade": lines_per_decade, "inputs": inputs, "realisations": realisations}
        asked |= {"periods": periods, "amplitude": _one_or_all(amplitude), "rms": _one_or_all(rms)}
        with telling(console) as tell:
            play = multisine(dt=dt, minimise_crest=minimise_crest, seed=seed, progress=tell, **asked)
        play.save(output)
    screen.say(console, *_described(play, realisations), "")
    screen.say_written(console, output)
    screen.say(console, *_then_record(play, output))


def _one_or_all(values: list[float] | None) -> list[float] | float | None:
    return values[0] if values is not None and len(values) == 1 else values


def _described(play: Excitation, realisations: int) -> list[str]:
    from robustid.core import hz_span

    experiments, period, inputs = play.u.shape
    seconds = period * play.dt
    lines = [
        f"{play.lines.size} line{'s' * (play.lines.size > 1)}, {hz_span(play.freq_hz[0], play.freq_hz[-1])}; period"
        f" {period} samples, {seconds:.6g} s",
        f"{inputs} input{'s' * (inputs > 1)}, {realisations} realisation{'s' * (realisations > 1)}: {experiments}"
        f" experiment{'s' * (experiments > 1)} of {play.periods} period{'s' * (play.periods > 1)},"
        f" {experiments * play.periods * seconds:.6g} s in all",
    ]
    for i in range(inputs):
        largest, crest = abs(play.u[:, :, i]).max(), play.crest_factors[:, i]
        text = f"u{i + 1}: largest |u| {largest:.5g}, rms {play.rms[0, i]:.5g}, crest factor {crest.min():.3f}"
        lines.append(text + f" to {crest.max():.3f}" * (experiments > 1))
    return lines


def _then_record(play: Excitation, output: Path) -> list[str]:
    loop = " in a loop" if play.periods == 1 or output.suffix.lower() == ".npz" else ""
    return [
        f"Next: play every experiment{loop}, record all inputs and outputs, and drop whole periods until the response repeats."
        " Then, with the records in order:",
        f"  robustid frf RECORD ... --lines {shlex.quote(str(output))} -o frf.npz",
        "or in Python:",
        f"  play = rid.load({str(output)!r})",
        "  frf = rid.estimate_frf(records, period=play.period, lines=play.lines)",
    ]


def frf(
    *,
    context: typer.Context,
    record: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD...",
            help="Time records with inputs and outputs: .csv, .npz or .mat, one file an experiment; with nu inputs and periodic"
            " excitation nu experiments, or a multiple of that, in order; one where the inputs have lines in turn or"
            " random phases.",
        ),
    ],
    how: Estimate,
    lines: Annotated[
        str | None,
        typer.Option(
            help="What robustid excite wrote: its lines and its period. Or numbers such as 11:250, 1:99:2 or 3,5,7: line k turns k"
            " times in a period (local: in the record; welch: in a segment). Default: those that are excited."
        ),
    ] = None,
    source: Annotated[RecordSource, only("fields", "dt", "rate", "axes", "decimal", "initial", "correct")],
    first: First = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The response: .npz, .csv or .mat.")] = Path("frf.npz"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Estimate the frequency response of a SISO or MIMO plant from records, with a bound for all spectral lines at once.

    Periodic excitation gives the most: noise from period to period, and with several realisations what isn't linear.
    Periods with a transient are left out, unless --initial periodic says that there is none.

    [bold]Example[/bold]: robustid frf run1.csv run2.csv --period 1000 --time-field u=current --time-field y=angle -o frf.npz
    --report frf.html

    Exit codes: 0 written, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.measured_files import Files
    from robustid.data import save
    from robustid.estimation import estimate_frf
    from robustid.formats import WRITERS
    from robustid.report import first_screen, render_report, render_summary

    written_files.check_ending(output, tuple(WRITERS))
    written_files.check_static(report, static)
    written_files.check_outputs([output, report], record, force)
    for k, path in enumerate(record):
        if path.resolve() in [other.resolve() for other in record[:k]]:
            raise InputError(f"{path} is given twice; every experiment counts once")
    console = screen.console(stderr=as_json, verbose=verbose)
    files = Files(paths=record, source=source, first=first)
    records = files.read(console)
    samples, index = _periods(lines, how.period, how.method, records[0])
    words = f"estimating the response: {len(records)} record{'s' * (len(records) > 1)} of {len(records[0].u)} samples"
    with in_words(words_of(frf, record="RECORD", path="--output")), step(console, words):
        try:
            found = estimate_frf(
                records, period=samples, lines=index, method=how.method, probability=how.probability, about=how.about
            )
        except InputError as error:
            if "samples" not in error.remedy:
                raise
            raise error.reworded({}, lambda cut: f"{cut} (--first {cut.arguments['samples']})") from None
    called = screen.called(context)
    undoing = _undoing(called, found, output, files.origins)
    if undoing is None and samples is None and how.method in (None, "periodic"):
        undoing = _with_period(called, found, min(len(one.u) for one in records))
    written, steps = [output, report], then_model(found, output)
    page = None
    if report is not None:
        commands = [(one.what, one.command) for one in steps]
        shown: Parts = {"records": records, "undoing": undoing, "steps": commands}
        with telling(console) as progress:
            page = render_report(found, static=static, progress=progress, **shown)
    save(output, found)
    written_files.write_page(report, page)
    head = first_screen(found)
    screen.conclude(console, head, lambda: [render_summary(found)], written=written, undoing=undoing, steps=steps)
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.estimated(found, head, written), console)


def _periods(
    lines: str | None, period: int | None, method: str | None, record: TimeRecord
) -> tuple[int | None, list[int] | NDArray[np.int_] | None]:
    """Samples of a period, and numbers of lines."""
    if lines is None or re.fullmatch(r"[\d:, ]+", lines):
        return period, None if lines is None else _numbers(lines, len(record.u))
    from robustid.formats import load_excitation

    if not Path(lines).exists():
        raise InputError(
            f"--lines must be numbers such as 11:250 or 3,5,7, or a file of robustid excite; got {lines!r}"
        )
    if period is not None or method not in (None, "periodic"):
        other = "--period" if period is not None else f"--method {method}"
        raise InputError(f"--lines {lines} gives period and lines of a periodic excitation; leave {other} out")
    play = load_excitation(lines)
    if abs(play.dt - record.dt) > _SAME_STEP * record.dt:
        raise InputError(f"--lines {lines} was designed for dt = {play.dt:g} s; the records have {record.dt:g} s")
    return play.period, play.lines


def _numbers(text: str, samples: int) -> list[int]:
    found: list[int] = []
    for part in text.split(","):
        ends = [int(end) if end.strip().isdigit() else -1 for end in part.split(":")]
        first, last, each = (ends + ends * (len(ends) == 1) + [1])[:3]
        if len(ends) > 3 or min(ends) < 0 or each == 0:
            raise InputError(f"--lines must be numbers such as 11:250, 1:99:2 or 3,5,7; got {text!r}")
        if last > samples:
            raise InputError(f"--lines {text} goes to line {last}, beyond half of the {samples} samples")
        found += range(first, last + 1, each)
    return found


def _undoing(called: list[str], found: FrequencyResponse, output: Path, records: list[Path]) -> Undoing | None:
    """The command again, with what undoes a fault of the records; else the next one, with what undoes one of the response."""
    from robustid.app.run.undoing import again, in_command, placed_faults

    faults = placed_faults(found, len(records))
    of_records, of_response = ([one for one in faults if one.kind == kind] for kind in ("time", "frequency"))
    further = ["identify", "--frequency", str(output), "--report", "report.html"]
    return in_command(again(called), of_records, [], records) or in_command(further, of_response, [output], [])


def _with_period(called: list[str], found: FrequencyResponse, samples: int) -> Undoing | None:
    """The command again with the period that every input shows, of whole periods; None where they show none, or several."""
    from robustid.app.run.undoing import again, command_line, options_among, with_value
    from robustid.data import FaultKind, Undoing

    shown = [fault for fault in found.faults if fault.kind is FaultKind.UNSTATED_PERIOD]
    periods = {int(fault.size or 0) for fault in shown}
    if len(periods) != 1 or not all(periods) or "--lines" in " ".join(called):
        return None
    (period,) = periods
    arguments, whole = again(called), str(samples // period * period)
    if samples % period:
        first = "--first"
        cut = options_among(arguments, {first})
        arguments = with_value(arguments, first, whole) if cut else [*arguments, first, whole]
    return Undoing(shown[0], command_line([*arguments, "--period", str(period)]))


def then_model(found: FrequencyResponse, output: Path) -> list[Next]:
    """The step from a response in a file to a model: with a proof where errors are bounded."""
    name = output.with_suffix("")
    if found.bound is None:
        fit = written_files.free(name.with_name(f"{name.name}-fit"), ".npz", ".html")
        words = "a matrix fraction by least squares"
        return [Next(words, ["fit", output, "--order", "auto", "-o", f"{fit}.npz", "--report", f"{fit}.html"])]
    model = written_files.free(name.with_name(f"{name.name}-model"), ".npz", ".json", ".html")
    several = " of all entries (of one: --entry OUTPUT,INPUT)" if found.values[0].size > 1 else ""
    proof = ["identify", "--frequency", output, "-o", model, "--report", f"{model}.html"]
    return [Next(f"a model{several} with a proof", proof)]
