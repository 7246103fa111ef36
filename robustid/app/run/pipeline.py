"""The whole way: measurements to a proposal, a proof, a small model and a report."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import textwrap
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from robustid.app.run.checks import Option, options, refuse_unknown, too_large
from robustid.app.run.class_settings import prior_keys
from robustid.app.run.fetched import fetched, is_url
from robustid.app.run.measurements import Measured, measured
from robustid.app.run.members import run_members
from robustid.app.run.modes import stated_modes
from robustid.app.run.reading import Data
from robustid.app.run.results import FamilyRun, IdentifiedReduced
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.app.run.run_folder import RunFolder, Surroundings
from robustid.app.run.sequence import from_data, from_problem
from robustid.app.run.settings import SECTIONS, General
from robustid.app.run.toml import is_array
from robustid.app.run.undoing import command_line, in_run_file, in_run_file_of_member
from robustid.core import Budget, Options, Progress, Record, as_flag, as_function, one_thread
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from robustid.fitting import MatrixFraction, ModeRow, RecordFit
from robustid.identification import MixedProblem, Prior

F = TypeVar("F", bound=Callable[..., Any])
__all__ = ["IdentifiedReduced", "identify_reduced", "run"]

# The options of a run file that are arguments of `identify_reduced` too: their section, their key there, their description.
_KEYWORDS = {
    option.keyword: (section, field, option)
    for section, kind in {"": General, **SECTIONS}.items()
    for field, option in options(kind)
    if option.keyword
}


def _with_keywords(function: F) -> F:
    """Give signature and docstring of a function the options of the run file that are arguments too."""
    signature = inspect.signature(function)
    *own, _ = signature.parameters.values()
    stated = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=field.type)
        for name, (_, field, _) in _KEYWORDS.items()
    ]
    function.__signature__ = signature.replace(parameters=[*own, *stated])  # type: ignore[attr-defined]
    lines = [_described(name, field.type, field.default, option) for name, (_, field, option) in _KEYWORDS.items()]
    function.__doc__ = (function.__doc__ or "").replace("    {options}\n", "".join(lines))
    return function


def _described(name: str, kind: str | type, default: object, option: Option) -> str:
    """Lines of a numpydoc section."""
    text = option.sentence + (f" In {option.unit}." if option.unit else "")
    return f"    {name} : {kind}, default {default!r}\n{textwrap.indent(textwrap.fill(text, 120), 8 * ' ')}\n"


def _stated(given: Mapping[str, object]) -> Options:
    """Arguments by section and key of the run file, checked under their own name."""
    _, *known = inspect.signature(identify_reduced).parameters
    refuse_unknown(given, known, "identify_reduced", "argument", InputTypeError)
    content: Record = {section: {} for section in SECTIONS}
    for name, value in given.items():
        section, field, option = _KEYWORDS[name]
        if value is not None or field.default is not None:
            place = content[section] if section else content
            place[field.name] = option.check(f"`{name}`", value)
    return content


@_with_keywords
@one_thread()
def identify_reduced(
    data: MixedProblem | Data | Sequence[Data],
    *,
    modes: Sequence[tuple[float, float] | ModeRow] | MatrixFraction | RecordFit | None = None,
    prior: Prior | None = None,
    omega: ArrayLike | None = None,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
    **stated: object,
) -> IdentifiedReduced:
    """From bounded data to the smallest model inside the bounds, with its worst-case error and all choices.

    Modes and prior are taken from the data where they aren't given, the consistency is decided with a proof, the model is reduced
    while every sample stays inside its bound, and the error of the small model over all consistent systems is bounded.

    Parameters
    ----------
    data : MixedProblem, FrequencyResponse, TimeRecord, or a sequence of these two
        A problem states the class: `modes`, `repeat`, `delay` and `prior` are not given then. Else data with bounds.
    modes : sequence of (Hz, damping), MatrixFraction, RecordFit or rows of `mode_table`, optional
        Poles of the parametric part: stated, or those of a fit, its poles at z = 1 as integrators; empty for none; None to
        take them from the first frequency response.
    prior : Prior, optional
        None: twice the smallest gain bound, at the knee of its curve against the decay rate.
    omega, executor : optional
        As in `worst_case_error`.
    progress : callable (text, done, count), optional
        `count` is 0 where nothing is counted.
    {options}

    Returns
    -------
    IdentifiedReduced
        Inconsistent data are a finding with its proof: `findings` says which factor on the bounds, or which other class, would do.

    Raises
    ------
    InputError, InputTypeError
        Data without bounds, of different signals, contradictory or unknown arguments.

    Notes
    -----
    Poles and prior from the data are assumptions that these data don't refute; the error doesn't cover other poles: see
    `worst_case_over_poles`. Source: class and model `inanc2001`.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.datasets.flexible_structure(seed=0, lines=6, samples=6)
    >>> modes, prior = [(9.0, 0.1), (17.67, 0.004)], rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> small = rid.identify_reduced([data.frequency, data.time], modes=modes, prior=prior, omega=[60.0], directions=4)
    >>> small.consistent, small.reduction.order, bool(small.error.upper[0, 0, 0] < 0.3)
    (True, 4, True)
    """
    content = _stated(stated)
    if omega is not None:
        hz = np.atleast_1d(np.asarray(omega, dtype=float)) / (2 * np.pi)
        content["worst_case"]["at_hz"] = hz.tolist()
    if modes is not None:
        content["modes"] |= stated_modes(modes)
    if prior is not None:
        content["prior"] = prior_keys(prior)
    asked = read_run_file(content, "identify_reduced", sources=False)
    told, budget = as_function("progress", progress), Budget(asked.time_limit)
    around = Surroundings(told, executor=executor, budget=budget)
    if not isinstance(data, MixedProblem):
        with around.stops.listening():
            return from_data(asked, _as_measured(data), around)
    own = asked.modes
    given = {
        "modes": modes,
        "prior": prior,
        "delay": own.delay,
        "repeat": own.repeat > 1 or None,
        "integrators": own.integrators or None,
    }
    if named := [name for name, value in given.items() if value is not None]:
        raise InputError(f"`{named[0]}` is part of the problem already; change it there, or give the data alone")
    with around.stops.listening():
        return from_problem(asked, data, around)


def _as_measured(data: object) -> Measured:
    items = data if is_array(data) else [data]
    responses = tuple(one for one in items if isinstance(one, FrequencyResponse))
    records = tuple(one for one in items if isinstance(one, TimeRecord))
    if len(responses) + len(records) < len(items):
        raise InputTypeError(
            "`data` must be a MixedProblem, a FrequencyResponse, a TimeRecord, or a sequence of these two; got"
            f" {type(data).__name__}"
        )
    return Measured(responses, records)


@one_thread()
def run(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    resume: bool = False,
    force: bool = False,
    static: bool = False,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> IdentifiedReduced | FamilyRun:
    r"""Everything that a run file says, from the measured files to the report, kept in a folder.

    Written as soon as it is there: the frequency responses, the run file with every choice made so far, the identification; at
    the end the worst-case error, the small model, the summary, the report. The run file in the folder, run again, gives the same.

    Parameters
    ----------
    path : path
        The run file, TOML: see ``robustid run --help`` for a file with every section. Names in it are seen from its folder. Also
        an address (``s3://...``), which fsspec opens; it and what it names are copied to FOLDER-inputs.
    folder : path
        For the results; new, or empty.
    resume : bool
        Go on in a folder that holds an unfinished run of the same run file.
    force : bool
        Replace what an earlier run wrote there.
    static : bool
        A report with pictures only, without scripts; see `write_report`.
    executor : concurrent.futures.Executor or int, optional
        As in `worst_case_error`.
    progress : callable (text, done, count), optional

    Returns
    -------
    IdentifiedReduced
        A FamilyRun where the run file has [[members]].

    Raises
    ------
    InputError, InputTypeError, FileFormatError
        Unknown keys, wrong types, contradictions, missing files, a folder that holds something: before anything is computed.

    Examples
    --------
    >>> import pathlib, tempfile, robustid as rid
    >>> place = pathlib.Path(tempfile.mkdtemp())
    >>> rid.save(place / "frf.csv", rid.datasets.flexible_structure(lines=3).frequency)
    >>> class_of_it = "[modes]\nhz = [9.0, 17.67]\ndamping = [0.1, 0.004]\n[prior]\ngain_bound = 0.2\ndecay_rate = 1.1\n"
    >>> text = '[[frequency]]\nfile = "frf.csv"\n[worst_case]\ncompute = false\n' + class_of_it
    >>> _ = (place / "ask.toml").write_text(text)
    >>> result = rid.run(place / "ask.toml", place / "first")
    >>> result.consistent, (place / "first" / "report.html").exists()
    (True, True)
    >>> again = rid.run(place / "first" / "run.toml", place / "second")
    >>> again.identification.margin == result.identification.margin
    True
    """
    told, folder = as_function("progress", progress), Path(folder)
    if is_url(os.fspath(path)):
        path = fetched(os.fspath(path), Path(f"{folder}-inputs"), told)
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder, of several runs; on the command line: robustid run {path.name}")
    resume, force, static = (as_flag(*one) for one in (("resume", resume), ("force", force), ("static", static)))
    asked = read_run_file(path)
    if asked.split is not None:
        raise InputError(f"{path.name}: split asks for several runs; on the command line: robustid run {path.name}")
    _check_folder(path, folder, resume, force)
    kept = RunFolder(folder, resume, static)
    budget = Budget(asked.time_limit)
    around = Surroundings(told, kept, executor, budget=budget)
    around.say(f"{asked.time_limit:g} s for all of it (time_limit)")
    with around.stops.listening():
        result = _result(asked, path, folder, kept, around, force)
    around.say("writing the report")
    kept.finish(result, told)
    return result


def _result(
    asked: RunFile, path: Path, folder: Path, kept: RunFolder, around: Surroundings, force: bool
) -> IdentifiedReduced | FamilyRun:
    """The result of a run file, of one plant or of members; its folder is opened once the data are read."""
    moved = asked.moved(path.parent, folder)
    before = kept.asked(moved)
    workers = ["--workers", str(around.executor)] if isinstance(around.executor, int) else []
    again = command_line(["run", str(path), "-o", str(folder), *workers, *["--static"] * kept.static, "--force"])
    if asked.members:
        kept.open(force)
        undo = functools.partial(in_run_file_of_member, asked, str(path), again)
        return run_members(before or moved, folder, around, undo)
    place, stated = (path.parent, asked) if before is None else (folder, before)
    stated, data = measured(stated, place, around)
    kept.open(force)
    with too_large(
        "band_hz = [low, high], or every = 2 or more, in [frequency_points]; start and stop in [[record]]; entry = [output, input],"
        ' or split = "entries" for a run of each'
    ):
        found = from_data(stated.moved(place, folder), data, around)
    undoing = in_run_file(asked, str(path), again, data, found.identification.problem.placed_faults)
    return dataclasses.replace(found, undoing=undoing)


def _check_folder(path: Path, folder: Path, resume: bool, force: bool) -> None:
    """Refuse what would be replaced, or could not be written."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"`folder` = {str(folder)!r} is a file; give the name of a folder")
    if path.resolve().parent == folder.resolve():
        raise InputError(f"`folder` = {str(folder)!r} holds the run file itself; choose another one")
    if resume and force:
        raise InputError("`resume` goes on from what `force` would remove; leave one of them out")
    if folder.is_dir() and any(folder.iterdir()) and not (resume or force):
        raise InputError(
            f"`folder` = {str(folder)!r} is not empty; choose another name, pass `resume` to go on with an unfinished run there, or"
            " `force` to replace it"
        )
