"""robustid loop: controllers with every consistent plant; robustid connect: two measured parts, every pair of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robustid.app.cli import screen, written_files
from robustid.app.cli.command_options import AsJson, Force, Output, Report, Static, Verbose, words_of
from robustid.app.cli.screen import Next, in_words, telling
from robustid.errors import InputError, Status

if TYPE_CHECKING:
    from rich.console import RenderableType

    from robustid.app.cli.terminal import Terminal
    from robustid.core import Progress
    from robustid.guarantees import Band, Interconnection, LoopBounds
    from robustid.identification import Identification, Loop

_KINDS = ("loop bounds", "band", "identification")


def loop(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            help="Folder of a run with \\[loop], the result of `identify --loop`, or a saved loop; of a plant that was measured in"
            " open loop the folder of its run, its band or its identification."
        ),
    ],
    controller: Annotated[
        list[Path] | None,
        typer.Option(
            help="Controller C of u = r - C y with the sample time of the loop: a model in .npz or .mat, or its frequency response."
            " Repeatable. Default: the one that ran."
        ),
    ] = None,
    output: Output = Path("tried"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Try controllers on every plant that the data allow: proved stable with all of them, or refused with one that is not.

    Of each: peaks of S, T, PS and CS, margins and zone that hold for every consistent plant. A plant that refutes it is written as
    NAME-plant.npz. Of several controllers the files are NAME-CONTROLLER.

    [bold]Example[/bold]: robustid loop bench --controller new.npz -o new --report new.html

    Exit codes: 0 every controller is proved stable, 3 one is refuted by a plant (a finding), 4 either, but of data with a fault
    that nothing has undone, 1 undecided, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.app.run.controllers import read_controllers
    from robustid.core import Interruptible
    from robustid.guarantees import LoopBounds, loop_bounds

    console, paths = screen.console(stderr=as_json, verbose=verbose), controller or []
    written_files.check_static(report, static)
    places = {path.stem: written_files.beside(output, f"-{path.stem}" if len(paths) > 1 else "") for path in paths}
    wanted = [file for one in places.values() for file in (*written_files.result_files(one), _plant_file(one))]
    if len(places) < len(paths):
        raise InputError("--controller: two files have the same name; rename one of them")
    written_files.check_outputs([*wanted, report], [*read_files(source), *paths], force)
    words = words_of(
        loop, controller="--controller", band="the band", loop="the loop", identification="the identification"
    )
    with in_words(words), telling(console) as progress:
        progress(f"reading {source}", 0, 0)
        ran = MeasuredPlant.of(source, progress)
        models, found, written = (
            read_controllers(paths, "--controller", ran.loop),
            dict[str, LoopBounds](),
            list[Path](),
        )
        with Interruptible(lambda: bool(found)):
            for name, model in models.items() if paths else [("", None)]:
                progress(f"trying {name or 'the controller that ran'}", 0, 0)
                found[name] = loop_bounds(ran.band, ran.loop, model)
                found[name] = found[name].refuted(ran.identification)
        for name in places:
            written += _keep_tried(places[name], found[name]) if name in found else []
        again = [places[name] for name in list(found)[:1] if name]
        report, steps = screen.drawn(report, lambda: _drawn(found, static, progress), again, None)
    files = [*written, *([report] if report else [])]
    _conclude(console, found, files, steps)
    worst = max((one.status.name for one in found.values()), key=("STABLE", "UNDECIDED", "UNSTABLE").index)
    status = {"STABLE": Status.CONSISTENT, "UNSTABLE": Status.INCONSISTENT, "UNDECIDED": Status.UNDECIDED}[worst]
    code = screen.exit_code(status, bool(ran.band.problem.open_faults))
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.tried(found, files, code), console)
    raise typer.Exit(code)


@dataclasses.dataclass
class MeasuredPlant:
    """A band, the loop that it was measured in (None: none), and the identification where it is at hand."""

    band: Band
    loop: Loop | None
    identification: Identification | None = None

    @classmethod
    def of(cls, source: Path, progress: Progress) -> MeasuredPlant:
        """The contents of a folder or a file."""
        from robustid.app.cli.bounds import suggested_box, suggested_modes
        from robustid.app.load_save import load_result
        from robustid.app.run.modes import held_box
        from robustid.core import paths
        from robustid.guarantees import Band, LoopBounds, band

        identified = None
        if source.is_dir() and paths(source / "identification")[1].is_file():
            identified = load_result(source / "identification", "identification")
        thing = load_result(_place(source, ("loop", "band")), *_KINDS)
        if isinstance(thing, LoopBounds):
            return cls(thing.band, thing.loop, identified)
        if isinstance(thing, Band):
            return cls(thing, None, identified)
        if (loop := written_files.kept_beside(source, "-loop", thing)) is not None:
            return cls(loop.band, loop.loop, thing)
        known = written_files.kept_beside(source, "-band", thing)
        if known is not None and not known.unfinished:
            return cls(known, None, thing)
        progress("proving the error at every frequency", 0, 0)
        box = held_box(suggested_box(suggested_modes(thing.problem)), thing.problem)
        return cls(band(thing.require(), box=box, progress=progress), None, thing)

    @property
    def plants(self) -> Band | LoopBounds:
        """All consistent plants, as a design takes them."""
        from robustid.guarantees import loop_bounds

        return self.band if self.loop is None else loop_bounds(self.band, self.loop)


def _place(source: Path, names: tuple[str, ...]) -> Path:
    """The file of a run folder under the first of the names that is there; any other path as it is."""
    from robustid.core import paths

    if not source.is_dir():
        return source
    for name in names:
        if paths(source / name)[1].is_file():
            return source / name
    held = " and no ".join(f"{name}.npz" for name in names)
    raise InputError(f"the folder {source} holds no {held}: it is not that of a finished run of one plant with a band")


def read_files(source: Path) -> list[Path]:
    """Files that may be read."""
    from robustid.core import paths

    if not source.is_dir():
        kept = [file.with_stem(f"{file.stem}{ending}") for ending in ("-loop", "-band") for file in paths(source)]
        return [*written_files.sources(source), *kept]
    return [file for name in ("loop", "band", "identification") for file in paths(source / name)]


def _conclude(
    console: Terminal, found: dict[str, LoopBounds], written: list[Path], steps: Sequence[Next | str] | None
) -> None:
    """Say the first controller, and the verdicts on the others."""
    from robustid.report import first_screen

    def everything() -> list[RenderableType]:
        return [
            part for name, one in found.items() for part in (f"controller {name}:" * bool(name), one.summary()) if part
        ]

    first = next(iter(found))
    head = first_screen(found[first], candidates=found if len(found) > 1 else None)
    said = head.verdict
    if len(found) > 1 and said is not None:
        named = dataclasses.replace(said, word=f"Controller {first}: {said.word.lower()}")
        head = dataclasses.replace(head, head=[named, *(one for one in head.head if one is not said)])
    good = all(one.status.name == "STABLE" for one in found.values())
    if steps is None and good and written:
        steps = [Next("its proofs, from the numbers", ["verify", written[0].with_suffix("")])]
    screen.conclude(console, head, everything, written=written, steps=steps)


def _plant_file(place: Path) -> Path:
    return written_files.beside(place, "-plant.npz")


def _keep_tried(place: Path, found: LoopBounds) -> list[Path]:
    """Write the bounds, and the plant that refutes the controller; the files."""
    from robustid.app.load_save import save

    found.save(place)
    written = [*written_files.result_files(place)]
    if found.refuted_by is not None:
        written.append(_plant_file(place))
        save(written[-1], found.refuted_by.plant)
    return written


def _drawn(found: dict[str, LoopBounds], static: bool, progress: Progress) -> str:
    """The page: of the first controller, the others beside it."""
    from robustid.report import render_report

    first = next(iter(found))
    title = f"Controller {first}" if first else "The controller that ran"
    others = found if len(found) > 1 else None
    return render_report(found[first], title=title, static=static, progress=progress, candidates=others)


def connect(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            help="A saved band or identification, the folder of a run, or a model, which is known without error."
        ),
    ],
    load: Annotated[
        Path,
        typer.Argument(
            help="The other part, from the outputs of the source to its inputs; beside an impedance an admittance."
        ),
    ],
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Time of the search for an unstable pair where nothing is proved."),
    ] = None,
    keep_out: Annotated[
        str | None,
        typer.Option(
            metavar="DB:DEGREES",
            help="Gain and phase margin of a forbidden region of the eigenvalue loci, drawn in the report.",
        ),
    ] = None,
    output: Output = Path("connection"),
    report: Report = None,
    static: Static = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Decide whether two measured parts make a stable loop, whichever of their consistent systems they are.

    The loop is closed by negative feedback, 1 + source times load: a source impedance and a load admittance, for instance. Systems
    of an unstable pair are written as NAME-source.npz and NAME-load.npz.

    [bold]Example[/bold]: robustid connect source.npz load.npz -o pair --report pair.html

    Exit codes: 0 stable for every pair, proved, 3 unstable, with a pair (a finding), 4 either, but of data with a fault that
    nothing has undone, 1 undecided, 2 misuse, 70 an error of the program, 130 interrupted.
    """
    from robustid.guarantees import interconnection
    from robustid.report import first_screen, write_report

    console, region = screen.console(stderr=as_json, verbose=verbose), _region(keep_out)
    written_files.check_static(report, static)
    files, pair = (
        written_files.result_files(output),
        [written_files.beside(output, f"-{part}.npz") for part in ("source", "load")],
    )
    written_files.check_outputs([*files, *pair, report], [*read_files(source), *read_files(load)], force)
    words = words_of(connect, time_limit="--time-limit") | {"source": str(source), "load": str(load)}
    with in_words(words), telling(console) as progress:
        parts = [_part(path, progress) for path in (source, load)]
        progress("judging every pair", 0, 0)
        found = interconnection(parts[0], parts[1], time_limit=time_limit)
        found.save(output)
        written = _keep_pair(found, pair)
        head, kept = first_screen(found), _kept_out(found, region)
        shown = dataclasses.replace(head.glance, numbers=[*head.glance.numbers, *kept])
        if report is not None:
            title = f"{source.stem} and {load.stem}"
            write_report(found, report, title=title, static=static, progress=progress, forbidden=region)
    steps = [Next("its proofs, from the numbers", ["verify", written_files.stem(output)])] if found.stable else None
    said = [found.summary(), *map(": ".join, kept)]
    head, written = dataclasses.replace(head, glance=shown), [*files, *written, *([report] if report else [])]
    screen.conclude(console, head, lambda: said, written=written, steps=steps)
    status = {"STABLE": Status.CONSISTENT, "UNSTABLE": Status.INCONSISTENT, "UNDECIDED": Status.UNDECIDED}[
        found.status.name
    ]
    code = screen.exit_code(status, any(_faulty(one) for one in parts))
    if as_json:
        from robustid.app.answers import verdicts

        screen.write(verdicts.connected(found, parts, head, code, written), console)
    raise typer.Exit(code)


def _kept_out(found: Interconnection, region: tuple[float, float] | None) -> list[tuple[str, str]]:
    """The region that every pair keeps out of as a number of the first screen; none where none is stated."""
    if region is None:
        return []
    kept = found.keeps_out(*region)
    return [("forbidden region, kept out of by every pair", f"at {int(kept.sum())} of {kept.size} frequencies")]


def _region(text: str | None) -> tuple[float, float] | None:
    """Gain margin in dB and phase margin in degrees of DB:DEGREES."""
    if text is None:
        return None
    try:
        gain, phase = (float(number) for number in text.split(":"))
    except ValueError:
        raise InputError(f"--keep-out must be DB:DEGREES such as 6:45; got {text!r}") from None
    if not (gain > 0 and 0 < phase < 90):
        raise InputError(
            f"--keep-out needs a gain margin above 0 dB and a phase margin between 0 and 90 degrees; got {text!r}"
        )
    return gain, phase


def _part(path: Path, progress: Progress) -> Any:
    """The band, identification or model of a part."""
    from robustid.app.load_save import load, load_result
    from robustid.core import paths, saved_kind

    progress(f"reading {path}", 0, 0)
    if path.is_dir() and paths(path / "loop")[1].is_file():
        raise InputError(
            f"{path} is the run of a plant in a loop, whose band is that of R and not of the plant; give the part measured alone"
        )
    place = _place(path, ("band", "identification"))
    if saved_kind(place) is not None:
        return load_result(place, "band", "identification", "worst-case error", "band over poles", "family")
    if not place.is_file():
        words = "is a folder without a saved result" if path.is_dir() else "there is no such file"
        raise InputError(f"{path}: {words}")
    return load(place, kind="model")


def _faulty(part: Any) -> bool:
    problem = getattr(part, "problem", None)
    return problem is not None and bool(problem.open_faults)


def _keep_pair(found: Interconnection, files: list[Path]) -> list[Path]:
    """Write the systems of an unstable pair, but for those that are known; the files that were written."""
    from robustid.app.load_save import save

    written: list[Path] = []
    for file, model, side in zip(files, found.pair or (), (found.source, found.load), strict=False):
        if model is not side:
            save(file, model)
            written.append(file)
    return written
