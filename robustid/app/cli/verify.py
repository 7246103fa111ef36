"""robustid verify: whether the proofs in a file hold."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robustid.app.cli import screen
from robustid.app.cli.command_options import AsJson, Force
from robustid.app.cli.screen import in_words, say, step, telling
from robustid.app.cli.written_files import check_outputs

if TYPE_CHECKING:
    from robustid.app.cli.terminal import Terminal
    from robustid.controllers import ControllerDesign
    from robustid.guarantees import Band, Interconnection, LoopBounds, WorstCaseError, WorstCaseOverPoles
    from robustid.identification import Identification

_KINDS = (
    "identification",
    "worst-case error",
    "band over poles",
    "band",
    "family",
    "loop bounds",
    "interconnection",
    "controller design",
)
_BOTH = "this package, and by robustid-proof (independent)"
_ASSUMED = "assumed    gain bound, decay rate, poles and bounds of the samples: data can refute them, never prove them"


def verify(
    source: Annotated[
        Path,
        typer.Argument(
            help="A saved identification, saved bounds, a loop, a connection or a design (NAME, NAME.npz or NAME.json),"
            " or the folder of a run."
        ),
    ],
    exact: Annotated[
        bool, typer.Option("--exact", help="In ball arithmetic too, every rounding enclosed: needs robustid\\[exact].")
    ] = False,
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            help="Write the proof here, as JSON that other programs can check (of a band, an identification or a controller).",
        ),
    ] = None,
    independent: Annotated[
        bool,
        typer.Option(
            "--independent", help="By the checker in C too, exact integers only: robustid-proof, which you build once."
        ),
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Evaluate every proof in a file again, from its numbers and without a solver.

    Exit codes: 0 all hold, 1 one does not, 2 misuse (files that do not belong together too), 70 an error of the program,
    130 interrupted.
    """
    from robustid.app.independent import checker
    from robustid.app.load_save import load_result
    from robustid.controllers import ControllerDesign
    from robustid.core import atomic_write
    from robustid.guarantees import Band, Interconnection, LoopBounds, proof_texts

    console, of_loops = screen.console(stderr=as_json), (LoopBounds, Interconnection, ControllerDesign)
    with in_words({"exact": "--exact", "independent": "--independent", "result": str(source)}):
        check_outputs([export], [source], force)
        if independent:
            checker()
        with telling(console) as progress:
            result = load_result(source, *_KINDS, progress=progress)
        proofs = proof_texts(result) if export is not None or independent else []
        files = _numbered(export, len(proofs))
        check_outputs(files, [source], force)
        if isinstance(result, of_loops):
            failed = _loop_failures(console, result, exact)
        else:
            failed = _failures(console, result, exact)
        if independent:
            failed += [name for proof in proofs for name in _independent_failures(console, proof)]
    for path, proof in zip(files, proofs, strict=False):
        with atomic_write(path) as file:
            file.write(proof)
        say(console, f"proof      {path}, for any checker of the format")
    how = "in double precision with allowances" + (", and in ball arithmetic" if exact else "")
    assumed = [] if isinstance(result, (Band, *of_loops)) else [_ASSUMED]  # these say their own
    say(console, f"evaluated  {how}; the problem's arrays as they are in double precision", *assumed)
    if independent:
        say(console, f"checked by {_BOTH}")
    for name in failed:
        console.print(f"[red]FAILED[/red]     {screen.plain(name)}", highlight=False, soft_wrap=True)
    console.print("[red]not verified[/red]" if failed else "[green]verified[/green]", highlight=False)
    code = 1 if failed else 0
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.verified(result, failed, code, _BOTH if independent else "this package"), console)
    raise typer.Exit(code)


def _numbered(export: Path | None, count: int) -> list[Path]:
    """The file of a proof; of several, NAME-1.json, NAME-2.json and so on."""
    if export is None or count == 1:
        return [] if export is None else [export]
    return [export.with_stem(f"{export.stem}-{k}") for k in range(1, count + 1)]


def _independent_failures(console: Terminal, proof: str) -> list[str]:
    """Print what the checker in C says of a proof; the lines of what it does not prove."""
    from robustid.app.independent import check_independently

    with step(console, "checking in exact integers"):
        found = check_independently(proof)
    word = "verified" if found.proved else "FAILED"
    say(console, f"{word:<11}independently, in exact integers: {found.lines[0]}")
    if not found.proved:
        say(console, *found.lines[1:])
    return [] if found.proved else ["proof, in exact integers"]


def _failures(console: Terminal, result: Any, exact: bool) -> list[str]:
    """Print what an identification, or bounds, claim; the names of what does not hold."""
    from robustid.guarantees import Band, Family, WorstCaseError, WorstCaseOverPoles

    if isinstance(result, Band):
        return _sum_failures(console, result, exact)
    if isinstance(result, Family):
        failed: list[str] = []
        for member in result.members:
            say(console, f"member     {screen.plain(member.name)}")
            failed += _failures(console, member.result, exact)
        return failed
    failed = _identification_failures(console, getattr(result, "identification", result), exact)
    if isinstance(result, WorstCaseError):
        failed += _bound_failures(console, result, exact)
    elif isinstance(result, WorstCaseOverPoles):
        failed += _band_failures(console, result, exact)
    return failed


def _loop_failures(
    console: Terminal, result: LoopBounds | Interconnection | ControllerDesign, exact: bool
) -> list[str]:
    """Print the verdict on a loop, which loading evaluated anew, and the proofs of its bands; the names of what fails."""
    from robustid.controllers import ControllerDesign
    from robustid.guarantees import Family, LoopBounds

    say(console, result.summary())
    if isinstance(result, ControllerDesign) and not result.proofs:
        say(console, "recorded   what a search found: it has no proof")
        return []
    say(console, "verified   the verdict, from the bands, the models and what refutes it")
    if isinstance(result, ControllerDesign):
        sides = [one.band for one in result.proofs]
    else:
        sides = [result.band] if isinstance(result, LoopBounds) else [result.source, result.load]
    failed: list[str] = []
    for side in sides:
        members = [one.result for one in side.members] if isinstance(side, Family) else [side]
        for one in members:
            if hasattr(one, "problem"):  # no known system
                failed += _failures(console, one, exact)
    return failed


def _identification_failures(console: Terminal, result: Identification, exact: bool) -> list[str]:
    """Print what an identification claims; the names of what does not hold."""
    from robustid.identification import verify_margin_exactly

    say(console, f"claimed    {result.status.value}", f"           {_margin(result)}")
    failed: list[str] = []
    for check in result.verification.checks:
        word = "verified" if check.holds else "FAILED"
        say(console, f"{word:<11}{check.name}: {check.measured:.3g} (limit {check.limit:.8g})")
        failed += [] if check.holds else [check.name]
    if exact:
        rows, sarason = (data := result.formulation.data).rows, data.sarason
        if not verify_margin_exactly(result.certificate, rows, sarason):
            failed.append("certificate of the margin, in ball arithmetic")
    return failed


def _margin(result: Identification) -> str:
    low, high = f"{result.margin_lower:.6g}", f"{result.margin:.6g}"
    if result.certificate.value > 1:
        return f"no system of the class keeps every |residual| below {low} times its bound: the class is refuted"
    return f"margin {high}, reached by a system of the class, and proved not below {low}"


def _bound_failures(console: Terminal, error: WorstCaseError, exact: bool) -> list[str]:
    """Print what the bounds claim; the names of what does not hold."""
    from robustid.app.answers.parts import circle_words
    from robustid.core import counted, rounded_up

    upper, count = error.sigma_upper, error.omega.size
    intervals = sum(map(math.isfinite, error.parameters.lower.ravel().tolist()))
    text = (
        f"claimed    every consistent system is within {rounded_up(upper.max()):.4g} of the model at"
        f" {counted(count, 'frequency')}"
    )
    say(console, text + (f", and {intervals} coefficients are in their intervals" if intervals else ""))
    failed = _claim_failures(console, error, exact)
    if error.known_circle is not None:
        say(console, f"circle     {circle_words(error)}")
        if not error.circle_supported:
            failed.append("bound on the circle, from its ends of arcs")
    say(console, "recorded   what was attained: as the computation found it, not evaluated again")
    return failed


def _band_failures(console: Terminal, band: WorstCaseOverPoles, exact: bool) -> list[str]:
    """Print what a band over poles claims; the names of what does not hold."""
    say(console, "claimed    of all poles in a pole-uncertainty box:", band.summary())
    if not band.covered:
        return ["cells of poles: they leave out a part of the pole-uncertainty box"]
    failed = _claim_failures(console, band, exact)
    if exact:
        wrong, count = band.not_relaxed_enough(), len(band.kept) + len(band.refuted)
        word = "FAILED" if wrong else "verified"
        say(console, f"{word:<11}{count - len(wrong)} of {count} cells cover all their poles, in ball arithmetic")
        failed += wrong
    return failed if band.supported else [*failed, "bounds, from those of the cells"]


def _sum_failures(console: Terminal, band: Band, exact: bool) -> list[str]:
    """Print what a band of linear certificates claims, from its multipliers; the names of what does not hold."""
    say(console, f"claimed    {band.claim}")
    with step(console, "evaluating the sums"):
        holds = band.verify(exact)
    count, polygons = sum(one.angles.size for one in band.bands), band.polygons
    further = "" if polygons is None else f"; {polygons.claim_count} certificates of polygons"
    word = "verified" if holds else "FAILED"
    say(
        console,
        f"{word:<11}{count} discs, each from the sums of its multipliers; radii are not stored, but follow from them{further}",
    )
    return [] if holds else ["discs, from the sums of their multipliers, or polygons, from their certificates"]


def _claim_failures(console: Terminal, result: WorstCaseError | WorstCaseOverPoles, exact: bool) -> list[str]:
    """Evaluate every certificate, count those that hold, name the others."""
    total = result.claim_count
    failed: list[str] = []
    words = "evaluating certificates"
    with telling(console) as progress:
        progress(words, 0, 0)
        for done, claim in enumerate(result.claims(), start=1):
            failed += [] if claim.verify(exact) else [claim.name]
            progress(words, done, total)
    word = "FAILED" if failed else "verified"
    say(console, f"{word:<11}{total - len(failed)} of {total} certificates hold")
    return failed
