"""robustid report: the page of a saved identification, or of whatever else was saved and has one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import Force, Static, Verbose, only
from robustid.app.cli.control import design_exit
from robustid.app.cli.identify import everything, next_of, smallest
from robustid.app.cli.screen import in_words, say, telling
from robustid.app.run.settings import General
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.advice import Sensitivity
    from robustid.app.cli.terminal import Terminal
    from robustid.app.run.work import Work
    from robustid.controllers import ControllerDesign
    from robustid.core import Budget, Progress
    from robustid.guarantees import Band, ResponseTube, WorstCaseError, WorstCaseOverPoles
    from robustid.identification import Identification
    from robustid.report import Document, Parts


def report(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            help="A saved identification or design (NAME, NAME.npz or NAME.json); without further options also a fit, a"
            " comparison, a loop, a connection, a watch or a response."
        ),
    ],
    bounds: Annotated[
        list[Path] | None,
        typer.Option(help="Add what robustid bounds saved of it: NAME, NAME-poles and NAME-band. Repeatable."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--step", min=1, help="Add the guaranteed range of the step response over N samples.")
    ] = None,
    sensitivity: Annotated[
        bool,
        typer.Option(
            "--sensitivity",
            help="Add how the guarantee moves with the assumptions and with the number of points; of a design what smaller bounds"
            " and wider limits would bring, and where to measure: searches, which take minutes.",
        ),
    ] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="The HTML page.")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    independent: Annotated[
        bool,
        typer.Option(
            "--independent",
            help="Say whether the checker in C proves it too (robustid-proof): an identification, its bounds, a loop or a design.",
        ),
    ] = False,
    reduce: Annotated[bool, typer.Option(help="Show the smallest model inside the bounds too.")] = True,
    general: Annotated[General, only("time_limit")],
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
) -> None:
    """Write the report of a saved result again; its claims are verified again from the numbers.

    [bold]Example[/bold]: robustid report result --bounds bounds --step 60 -o report.html
    """
    from robustid.app.independent import checker
    from robustid.controllers import ControllerDesign
    from robustid.core import Budget
    from robustid.identification import Identification

    budget = Budget(general.time_limit)
    inputs = [path for name in (source, *(bounds or [])) for path in written_files.sources(name)]
    written_files.check_outputs([output], inputs, force)
    console = screen.console(verbose=verbose)
    if independent:
        checker()
    with telling(console) as progress:
        from robustid.app.load_save import load, load_result
        from robustid.core import saved_kind

        result = (
            load(source) if saved_kind(source) is None and source.is_file() else load_result(source, progress=progress)
        )
        page = _Page(console, progress, source, output, title, static, independent)
        if isinstance(result, ControllerDesign):
            _of_identifications({"--bounds": bool(bounds), "--step": steps is not None, "--no-reduce": not reduce})
            code = page.of_design(result, sensitivity)
        elif isinstance(result, Identification):
            code = page.of_identification(
                result, bounds or [], budget, steps=steps, sensitivity=sensitivity, reduce=reduce
            )
        else:
            _other(result, source, {"--bounds": bounds, "--step": steps, "--sensitivity": sensitivity or None})
            code = page.of_another(result)
    raise typer.Exit(code)


class _Page(NamedTuple):
    """The page that is asked for, whatever it is about; each kind of result is drawn and concluded, and gives the exit code."""

    console: Terminal
    progress: Progress
    source: Path
    output: Path
    title: str | None
    static: bool
    independent: bool

    def of_design(self, result: ControllerDesign, sensitivity: bool) -> int:
        """The page of a controller."""
        self.progress("searching what would help" if sensitivity else "drawing the report", 0, 0)
        helping = result.improvements() if sensitivity else ()
        asked = _asked(self.console, self.independent, {"the controller": result})
        said = [row.sentence for row in helping]
        self._written(result, {"sensitivity": helping or None, "independent": asked})
        head = self._head(result, {"sensitivity": helping or None, "independent": asked})
        screen.conclude(self.console, head, lambda: [result.summary(), *said], written=[self.output])
        return _with(asked, design_exit(result))

    def of_another(self, result: Any) -> int:
        """The page of a fit, a comparison, a loop, a connection, a watch or a response."""
        from robustid.app.cli.experiment import then_model
        from robustid.data import FrequencyResponse
        from robustid.guarantees import LoopBounds

        if self.independent and not isinstance(result, LoopBounds):
            raise InputError(f"--independent needs proofs, and a {type(result).__name__} has none that a file can hold")
        asked = _asked(self.console, self.independent, {"the loop": result})
        said = result.summary() if hasattr(result, "summary") else repr(result)
        steps = then_model(result, self.source) if isinstance(result, FrequencyResponse) else []
        parts: Parts = {"independent": asked}
        if steps:
            parts["steps"] = [(one.what, one.command) for one in steps]
        self._written(result, parts)
        head = self._head(result, parts)
        screen.conclude(self.console, head, lambda: [said], written=[self.output], steps=steps or None)
        return _with(asked, 0)

    def of_identification(
        self,
        result: Identification,
        bounds: list[Path],
        budget: Budget,
        *,
        steps: int | None,
        sensitivity: bool,
        reduce: bool,
    ) -> int:
        """The page of an identification, with its bounds and what else is asked for, each search in its share of the time."""
        from robustid.app.run.run_file import RunFile
        from robustid.app.run.run_folder import Surroundings
        from robustid.app.run.sequence import diagnosed, reduced
        from robustid.app.run.work import Work

        work = Work(run=RunFile(), identification=result, around=Surroundings(self.progress, budget=budget))
        _take_bounds(work, bounds)
        if work.band is None:
            work.band = written_files.kept_beside(self.source, "-band", result)
        if reduce:
            reduced(work)
        shown: Parts = {"tube": None if steps is None else _tube(work, steps)}
        shown["sensitivity"] = _sensitivity(work) if sensitivity else None
        shown["independent"] = asked = _asked(self.console, self.independent, _proofs(work))
        diagnosed(work)
        work.around.say("verifying every certificate")
        self._written(result, {**work.parts, **shown})
        head = self._head(result, {**work.parts, "independent": asked})
        after = [smallest(self.source)] if bounds else next_of(work, self.source, [])
        screen.conclude(self.console, head, lambda: everything(work), written=[self.output], steps=after)
        return _with(asked, screen.exit_code(result.verified_status, bool(result.problem.open_faults)))

    def _written(self, result: Any, parts: Parts) -> None:
        from robustid.report import write_report

        write_report(result, self.output, title=self.title, static=self.static, progress=self.progress, **parts)

    def _head(self, result: Any, parts: Parts) -> Document:
        from robustid.report import first_screen

        return first_screen(result, **parts)


def _asked(console: Terminal, independent: bool, named: Mapping[str, object]) -> dict[str, bool] | None:
    """Answers of the checker in C on the results, printed, if it is asked for."""
    from robustid.app.independent import proved_independently

    if not independent:
        return None
    with in_words({"independent": "--independent", "result": "--independent"}):
        found = proved_independently(named)
    say(console, *(f"{'' if holds else 'NOT '}proved by robustid-proof: {name}" for name, holds in found.items()))
    return found


def _proofs(work: Work) -> dict[str, object]:
    """Results of which the page states proofs, by their names."""
    named = (
        ("identification", work.identification),
        ("bounds", work.error),
        ("band", work.band),
        ("box", work.over_poles),
    )
    return {f"the {name}": one for name, one in named if one is not None}


def _with(asked: Mapping[str, bool] | None, code: int) -> int:
    """Exit code of a report: 1 where another program proves less."""
    return code if all((asked or {}).values()) else 1


def _other(result: object, source: Path, options: dict[str, object]) -> None:
    """Refuse what has no page, and options that belong to an identification."""
    from robustid.report import has_page

    if not has_page(result):
        kind = type(result).__name__
        raise InputError(
            f"{source} holds a {kind}, which has no page of its own; bounds are shown with --bounds beside NAME"
        )
    if given := [flag for flag, value in options.items() if value is not None]:
        raise InputError(f"{given[0]} belongs to an identification; {source} holds a {type(result).__name__}")


def _of_identifications(given: dict[str, bool]) -> None:
    """Refuse options that the page of a design has no place for."""
    for name, is_there in given.items():
        if is_there:
            raise InputError(f"{name} is about an identification, and this is a design; leave it out")


def _take_bounds(work: Work, paths: list[Path]) -> None:
    """The bounds that were saved of the identification."""
    from robustid.core import fingerprint
    from robustid.guarantees import Band, WorstCaseOverPoles
    from robustid.report import same

    for file in paths:
        bound = _bounds_in(file)
        kind = "over_poles" if isinstance(bound, WorstCaseOverPoles) else "band" if isinstance(bound, Band) else "error"
        if getattr(work, kind) is not None:
            raise InputError(
                f"--bounds {file} is the second of its kind; give NAME, NAME-poles and NAME-band once each"
            )
        if isinstance(bound, Band):
            alike = fingerprint(bound.problem) == fingerprint(work.identification.problem)
        else:
            alike = same(bound.identification, work.identification)
        if not alike:
            raise InputError(f"--bounds {file} is about another identification than the one reported")
        setattr(work, kind, bound)


def _bounds_in(file: Path) -> WorstCaseError | WorstCaseOverPoles | Band:
    """The bounds that a file of --bounds holds."""
    from robustid.app.load_save import load_result
    from robustid.core import saved_kind

    kinds = "worst-case error", "band over poles", "band"
    if saved_kind(file) not in (None, "result", *kinds):
        raise InputError(
            f"--bounds {file} holds no bounds, but a saved {saved_kind(file)}: robustid bounds RESULT -o NAME writes NAME and"
            " NAME-band, which it takes"
        )
    return load_result(file, *kinds)


def _tube(work: Work, samples: int) -> ResponseTube:
    from robustid.guarantees import response_tube

    work.around.say("bounding the step response")
    return response_tube(work.identification, input="step", horizon=samples)


def _sensitivity(work: Work) -> Sensitivity:
    from robustid.advice import sensitivity

    work.around.say("bounding the error under other assumptions")
    return sensitivity(work.identification.problem)
