"""robustid frf: from recorded signals to a frequency response with its bound."""

from __future__ import annotations

import pathlib
import re
import shlex
from typing import Annotated, Any

import typer

from robustid.app.cli import terminal
from robustid.app.cli.excite import samples_of
from robustid.app.cli.steps import in_words, say_written
from robustid.app.cli.terminal import plain, step
from robustid.data.io import TIME
from robustid.errors import InputError

Path = pathlib.Path
_OUTPUT = Path("frf.npz")
_OPTIONS = {"record": "RECORD", "path": "--output"} | {
    name: f"--{name}" for name in ("method", "period", "lines", "probability", "dt")
}
_SAME_STEP = 1e-6


def frf(
    record: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD...",
            help="Time records with inputs and outputs: .csv, .npz or .mat, one file an experiment; with nu inputs and periodic"
            " excitation nu experiments, or a multiple of that, in order.",
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(
            help="periodic, local (any excitation) or welch (a first look, smeared). Default: periodic where there is a period,"
            " else local."
        ),
    ] = None,
    period: Annotated[float | None, typer.Option(help="Period of the excitation in s.")] = None,
    lines: Annotated[
        str | None,
        typer.Option(
            help="What robustid excite wrote: its lines and its period. Or numbers such as 11:250, 1:99:2 or 3,5,7: line k turns k"
            " times in a period (local: in the record; welch: in a segment). Default: those that are excited."
        ),
    ] = None,
    probability: Annotated[float, typer.Option(help="Of the bound, for all lines and entries at once.")] = 0.95,
    dt: Annotated[float | None, typer.Option(help="Sample time in s, where the files do not say.")] = None,
    time_field: Annotated[
        list[str] | None,
        typer.Option(
            help="ROLE=NAME in the files, repeated for several channels: u=current, y=angle, y=speed, reference=setpoint (closed"
            f" loop). Recognised without it: {', '.join(TIME['u'])}, u1, u2, ...; {', '.join(TIME['y'])}, y1, y2, ...;"
            f" {', '.join(TIME['reference'])}; {', '.join(TIME['time'])}."
        ),
    ] = None,
    first: Annotated[int | None, typer.Option(help="Use only the first N samples of every record.")] = None,
    initial: Annotated[
        str | None,
        typer.Option(
            help='"periodic": in steady state from the first sample. Default: periods with a transient are left out.'
        ),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The response: .npz, .csv or .mat.")] = _OUTPUT,
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Estimate the frequency response of any number of channels from records, with a bound for all lines at once.

    Periodic excitation gives the most: noise from period to period, and with several realisations what isn't linear.

    [bold]Example[/bold]: robustid frf run1.csv run2.csv --period 1 --time-field u=current --time-field y=angle -o frf.npz
    --report frf.html

    Exit codes: 0 written, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.data import estimate_frf
    from robustid.data.io import WRITERS
    from robustid.report import render_summary

    if output.suffix.lower() not in WRITERS:
        raise InputError(f"--output {output} must end in {', '.join(WRITERS)}")
    terminal.check_outputs([output, *([report] if report else [])], record, force)
    console = terminal.console()
    records = _read(console, record, {"fields": time_field, "dt": dt, "first": first, "initial": initial})
    samples, index = _periods(lines, period, method, records[0])
    words = f"estimating the response: {len(records)} record{'s' * (len(records) > 1)} of {len(records[0].u)} samples"
    with in_words(_OPTIONS), step(console, words):
        try:
            found = estimate_frf(records, method=method, period=samples, lines=index, probability=probability)
        except InputError as error:
            text = str(error).replace("`period` in samples", "`period` in s")
            raise InputError(re.sub(r"cut it to (\d+) samples", r"cut it to \1 samples (--first \1)", text)) from None
    _write(found, records, output, report)
    console.print(render_summary(found))
    say_written(console, output, *([report] if report else []))
    for line in _next(found, output):
        console.print(plain(line), highlight=False, soft_wrap=True)


def _read(console: Any, paths: list[Path], given: dict[str, Any]) -> list[Any]:
    """The records, a line said about each."""
    from robustid.app.cli.data import Options, compare_step, field_pairs, part, reading
    from robustid.data import load
    from robustid.data.io import origin

    options = Options(kind="time", **given)
    options.check(paths)
    records, seen = [], set()
    for path in paths:
        if path.resolve() in seen:
            raise InputError(f"{path} is given twice; every experiment counts once")
        seen.add(path.resolve())
        with reading(path, "time"):
            fields = field_pairs(options)
            found = origin(path, "time", fields)
            if found.kind not in (None, "time"):
                raise InputError(f"{path.name} holds {found.kind} data; a time record is needed")
            record = part(load(path, kind="time", fields=fields, dt=options.dt, initial=options.initial), options)
        console.print(plain(_described(path, record)), highlight=False, soft_wrap=True)
        compare_step(console, path, found, options)
        records.append(record)
    return records


def _described(path: Path, record: Any) -> str:
    samples = len(record.u)
    names = [", ".join(map(str, channels)) for channels in (record.outputs, record.inputs)]
    text = f"read {path}: {samples} samples, {samples * record.dt:.6g} s, dt = {record.dt:g} s; {names[0]} / {names[1]}"
    if record.reference is not None:
        count = record.reference.shape[1]
        text += f"; {count} reference{'s' * (count > 1)}"
    return text + ("; in steady state" if record.initial == "periodic" else "")


def _periods(lines: str | None, period: float | None, method: str | None, record: Any) -> tuple[int | None, Any]:
    """Samples of a period, and numbers of lines."""
    samples = None if period is None else samples_of(period, record.dt)
    if lines is None or re.fullmatch(r"[\d:, ]+", lines):
        return samples, None if lines is None else _numbers(lines, len(record.u))
    from robustid.data import load_excitation

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


def _write(found: Any, records: list[Any], output: Path, report: Path | None) -> None:
    """Everything is computed and drawn before the first file is written."""
    from robustid.core import atomic_write
    from robustid.data import save
    from robustid.report import render_report

    page = "" if report is None else render_report(found, records=records)
    save(output, found)
    if report is not None:
        with atomic_write(report) as file:
            file.write(page)


def _next(found: Any, output: Path) -> list[str]:
    name = shlex.quote(str(output))
    several = found.values[0].size > 1
    what = (
        "a model of all entries (of one: --channel OUTPUT,INPUT), with a proof" if several else "a model with a proof"
    )
    return [
        f"Next, {what}:",
        f"  robustid identify --frequency {name} --report report.html",
        "or a matrix fraction by least squares:",
        f"  robustid fit {name} --order auto --report fit.html",
    ]
