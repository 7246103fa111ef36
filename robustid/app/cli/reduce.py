"""robustid reduce: a smaller model, inside the bounds of the data or with a known distance to the one given."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Verbose, only, words_of
from robustid.app.cli.screen import Next, in_words, step, telling
from robustid.app.run.checks import low_high
from robustid.app.run.settings import General

if TYPE_CHECKING:
    import control

    from robustid.app.cli.terminal import Terminal
    from robustid.core import Options
    from robustid.identification import Identification
    from robustid.reduction import Reduction


def reduce(
    *,
    source: Annotated[
        Path, typer.Argument(help="A saved identification, or a model: .npz or .mat with A, B, C, D, dt.")
    ],
    order: Annotated[int | None, typer.Option(help="Number of states to keep.")] = None,
    tol: Annotated[
        float | None, typer.Option(help="Error bound, relative to the largest Hankel singular value.")
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(
            help="Only these frequencies count, in Hz; 5:inf from 5 Hz on. Needs --order.", metavar="LOW:HIGH"
        ),
    ] = None,
    horizon: Annotated[
        float | None, typer.Option(help="Only the first part of the response counts. Needs --order.", metavar="SECONDS")
    ] = None,
    weight: Annotated[
        Path | None, typer.Option(help="A model (.npz or .mat) that weights the error at the outputs. Needs --order.")
    ] = None,
    static_gain: Annotated[
        bool, typer.Option("--static-gain", help="Keep the gain at frequency zero exactly.")
    ] = False,
    keep_unstable: Annotated[bool, typer.Option(help="Keep unstable poles and integrators exactly.")] = False,
    general: Annotated[General, only("time_limit")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="The reduced model: .npz, .mat, or .m, .json, .h, .sos, .zpk for other programs."
        ),
    ] = Path("reduced.npz"),
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Reduce a model: to the smallest order that keeps every sample inside its bound, or by balanced truncation.

    A saved identification alone is searched for its smallest order inside the bounds, for --time-limit at most. A model, or an
    identification with any option that says how, is truncated: the a-priori error bound stands beside the true largest error over
    all frequencies.

    [bold]Example[/bold]: robustid reduce plant.mat --order 12 --band 5:200 --static-gain -o small.mat

    Exit codes: 0 reduced, or nothing to reduce; 1 the smaller model is unstable, or the identification is not verified (it is
    written all the same); 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.load_save import load_result, save
    from robustid.core import paths, result_in
    from robustid.formats import load_model
    from robustid.reduction import ReductionStatus

    written_files.check_ending(output, (".npz", ".mat", ".m", ".json", ".h", ".sos", ".zpk"))
    match = "static gain" if static_gain else None
    asked: Options = {"order": order, "tol": tol, "match": match, "horizon": horizon}
    asked["band_hz"] = None if band is None else low_high("--band", band)
    written_files.check_outputs([output], [*written_files.sources(source), *([weight] if weight else [])], force)
    if weight is not None:
        asked["weight"] = load_model(weight)
    console = screen.console(stderr=as_json, verbose=verbose)
    # A file without a result is a plain model.
    identification = load_result(source, "identification") if paths(result_in(source))[1].exists() else None
    with in_words(words_of(reduce, unstable="--keep-unstable", model="the model")):
        if identification is None:
            asked["unstable"] = "keep" if keep_unstable else "refuse"
            reduction = _truncated(console, load_model(source), asked)
        elif all(value is None for value in asked.values()):
            reduction = _within_bounds(console, identification, general.time_limit)
        else:
            reduction = _truncated(console, identification.model, asked | {"unstable": "keep"})
            from robustid.identification import largest_ratio

            margin = largest_ratio(identification.problem, reduction.model)
            verdict = "all samples inside" if margin <= 1 else "outside somewhere"
            screen.say(console, f"largest |residual|/bound {margin:.4g}: {verdict}")
    save(output, reduction.model)
    screen.say(console, screen.written_words([output]))
    unverified = identification is not None and not identification.verification.passed
    if unverified:
        screen.warn(console, "the identification is not verified: robustid verify names what does not hold")
    steps = _next(output, reduction)
    console.next += [one.command for one in steps]
    screen.say(console, *screen.next_lines(None, steps))
    unstable = reduction.status is ReductionStatus.UNSTABLE
    code = 1 if unverified or unstable else 0
    if as_json:
        from robustid.app.answers import verdicts

        status = "unstable" if unstable else "unreduced" if reduction.status.name == "UNREDUCED" else "reduced"
        about = None if identification is None else identification.problem
        screen.write(verdicts.smaller(reduction, status, code, output, about), console)
    raise typer.Exit(code)


def _next(output: Path, reduction: Reduction) -> list[Next]:
    """The model for another program, where it isn't one of such a program yet."""
    from robustid.reduction import ReductionStatus

    if output.suffix not in (".npz", ".mat") or reduction.status is ReductionStatus.UNSTABLE:
        return []
    ending = ".h" if reduction.model.dt else ".m"
    other = written_files.free(output.with_suffix(""), ending)
    what = "as a filter in C" if ending == ".h" else "for MATLAB"
    return [Next(what, ["export", output, "-o", f"{other}{ending}"])]


def _within_bounds(console: Terminal, identification: Identification, time_limit: float) -> Reduction:
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.run_folder import Surroundings
    from robustid.app.run.sequence import reduced
    from robustid.app.run.settings import SmallModel
    from robustid.app.run.work import Work

    with telling(console) as progress:
        asked = RunFile(small_model=SmallModel(time_limit=time_limit))
        work = Work(run=asked, identification=identification, around=Surroundings(progress))
        reduced(work)
    reduction = work.small
    for tried, margin in reduction.tried if console.verbose else ():
        screen.say(console, f"order {tried:3d}: {margin:.4g} of what is allowed")
    screen.say(console, f"order {reduction.order} of {identification.order}: {reduction.status.value}")
    if not console.verbose and len(reduction.tried) > 1:
        screen.say(console, f"{len(reduction.tried)} orders were tried (-v lists them)")
    if reduction.stopped:
        screen.warn(console, reduction.stopped)
    return reduction


def _truncated(console: Terminal, model: control.StateSpace, asked: Options) -> Reduction:
    import numpy as np

    from robustid.reduction import ReductionStatus, balanced_truncation, hinf_error

    with step(console, f"truncating {model.nstates} states"):
        reduction = balanced_truncation(model, **asked)
    screen.say(console, f"order {reduction.order} of {model.nstates}: {reduction.status.value}")
    if np.isfinite(reduction.bound):
        screen.say(console, f"error at most {reduction.bound:.6g}, in units of the response")
    if reduction.status not in (ReductionStatus.UNREDUCED, ReductionStatus.UNSTABLE):
        with step(console, "largest error over all frequencies"):
            error = hinf_error(model, reduction.model)
        # Between the stable parts: the unstable ones are kept as they are.
        from robustid.core import hz_words

        where = "at infinite frequency" if np.isinf(error.omega) else f"at {hz_words(error.omega / (2 * np.pi), 4)}"
        screen.say(console, f"largest error over all frequencies: {error.value:.6g}, {where}")
    return reduction
