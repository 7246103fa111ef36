"""robustid frf: from recorded signals to a frequency response with its bound."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from robustid.app.cli import outputs, terminal
from robustid.app.cli.options import First, Force, Report, Static, only, words_of
from robustid.app.cli.terminal import in_words, step
from robustid.app.sources import Estimate, RecordSource
from robustid.errors import InputError

_SAME_STEP = 1e-6


def frf(
    *,
    record: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD...",
            help="Time records with inputs and outputs: .csv, .npz or .mat, one file an experiment; with nu inputs and periodic"
            " excitation nu experiments, or a multiple of that, in order.",
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
    source: Annotated[RecordSource, only("fields", "dt", "rate", "axes", "decimal", "initial")],
    first: First = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The response: .npz, .csv or .mat.")] = Path("frf.npz"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
) -> None:
    """Estimate the frequency response of a SISO or MIMO plant from records, with a bound for all spectral lines at once.

    Periodic excitation gives the most: noise from period to period, and with several realisations what isn't linear.
    Periods with a transient are left out, unless --initial periodic says that there is none.

    [bold]Example[/bold]: robustid frf run1.csv run2.csv --period 1000 --time-field u=current --time-field y=angle -o frf.npz
    --report frf.html

    Exit codes: 0 written, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.cli.reading import Files
    from robustid.estimation import estimate_frf
    from robustid.formats import WRITERS
    from robustid.report import render_summary

    outputs.check_ending(output, tuple(WRITERS))
    outputs.check_static(report, static)
    outputs.check_outputs([output, report], record, force)
    for k, path in enumerate(record):
        if path.resolve() in [other.resolve() for other in record[:k]]:
            raise InputError(f"{path} is given twice; every experiment counts once")
    console = terminal.console()
    records = Files(paths=record, source=source, first=first).read(console)
    samples, index = _periods(lines, how.period, how.method, records[0])
    words = f"estimating the response: {len(records)} record{'s' * (len(records) > 1)} of {len(records[0].u)} samples"
    with in_words(words_of(frf, record="RECORD", path="--output")), step(console, words):
        try:
            asked = {"method": how.method, "probability": how.probability, "about": how.about}
            found = estimate_frf(records, period=samples, lines=index, **asked)
        except InputError as error:
            if "samples" not in error.remedy:
                raise
            raise error.reworded({}, lambda cut: f"{cut} (--first {cut.arguments['samples']})") from None
    _write(found, records, output, report, static)
    console.print(render_summary(found))
    terminal.say_written(console, output, report)
    terminal.say(console, *_next(found, output))


def _periods(lines: str | None, period: int | None, method: str | None, record: Any) -> tuple[int | None, Any]:
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


def _write(found: Any, records: list[Any], output: Path, report: Path | None, static: bool) -> None:
    """Everything is computed and drawn before the first file is written."""
    from robustid.core import atomic_write
    from robustid.data import save
    from robustid.report import render_report

    page = "" if report is None else render_report(found, static=static, records=records)
    save(output, found)
    if report is not None:
        with atomic_write(report) as file:
            file.write(page)


def _next(found: Any, output: Path) -> list[str]:
    name = shlex.quote(str(output))
    several = found.values[0].size > 1
    what = "a model of all entries (of one: --entry OUTPUT,INPUT), with a proof" if several else "a model with a proof"
    return [
        f"Next, {what}:",
        f"  robustid identify --frequency {name} --report report.html",
        "or a matrix fraction by least squares:",
        f"  robustid fit {name} --order auto --report fit.html",
    ]
