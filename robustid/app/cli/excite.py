"""robustid excite: what to play next, as a file for a player."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from robustid.app.checks import low_high
from robustid.app.cli import outputs, terminal
from robustid.app.cli.options import Force, words_of
from robustid.app.cli.terminal import in_words, step


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

    outputs.check_ending(output, (".csv", ".npz"))
    outputs.check_outputs([output], [], force)
    console = terminal.console()
    with in_words(words_of(excite, band_hz="--band", path="--output")):
        asked: dict[str, Any] = {
            "band_hz": low_high("--band", band),
            "period": period,
            "spacing": spacing,
        }
        asked |= {"lines_per_decade": lines_per_decade, "inputs": inputs, "realisations": realisations}
        asked |= {"periods": periods, "amplitude": _one_or_all(amplitude), "rms": _one_or_all(rms)}
        with step(console, "choosing phases" + " for a small crest factor" * minimise_crest):
            play = multisine(dt=dt, minimise_crest=minimise_crest, seed=seed, **asked)
        play.save(output)
    terminal.say(console, *_described(play, realisations), "")
    terminal.say_written(console, output)
    terminal.say(console, *_next(play, output))


def _one_or_all(values: list[float] | None) -> Any:
    return values[0] if values is not None and len(values) == 1 else values


def _described(play: Any, realisations: int) -> list[str]:
    experiments, period, inputs = play.u.shape
    seconds = period * play.dt
    lines = [
        f"{play.lines.size} line{'s' * (play.lines.size > 1)}, {play.freq_hz[0]:.5g} to {play.freq_hz[-1]:.5g} Hz; period"
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


def _next(play: Any, output: Path) -> list[str]:
    loop = " in a loop" if play.periods == 1 or output.suffix.lower() == ".npz" else ""
    return [
        f"Next: play every experiment{loop}, record all inputs and outputs, and drop whole periods until the response repeats."
        " Then, with the records in order:",
        f"  robustid frf RECORD ... --lines {shlex.quote(str(output))} -o frf.npz",
        "or in Python:",
        f"  play = rid.load({str(output)!r})",
        "  frf = rid.estimate_frf(records, period=play.period, lines=play.lines)",
    ]
