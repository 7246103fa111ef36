"""The whole way: measurements to a proposal, a proof, a small model and a report."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robustid.advice import response_sizes, suggest_kautz, suggest_prior
from robustid.app.run_file import MODES_NOTE, PRIOR_NOTE, read_run_file
from robustid.app.run_result import IdentifiedReduced, Store
from robustid.app.run_steps import Say, default_prior
from robustid.app.sources import Measured, measured
from robustid.app.steps_of_data import from_data, from_problem
from robustid.bases import kautz
from robustid.core import Frozen
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError, SizeError
from robustid.identification import MixedProblem, Prior, prior_fields

__all__ = ["IdentifiedReduced", "Proposal", "identify_reduced", "propose", "run"]


@dataclasses.dataclass(frozen=True)
class Proposal(Frozen):
    """A problem with everything that it needs, and how each part was chosen.

    Attributes
    ----------
    problem : MixedProblem
    choices : tuple of str
        One paragraph per choice that the program made.
    """

    problem: MixedProblem
    choices: tuple[str, ...]


def propose(
    *,
    frequency: Sequence[FrequencyResponse] = (),
    time: Sequence[TimeRecord] = (),
    modes: Sequence[tuple[float, float]] | None = None,
    prior: Prior | None = None,
    repeat: int = 1,
    delay: int | None = None,
) -> Proposal:
    """A `MixedProblem` from data alone: modes and prior are suggested where they are not given.

    Parameters
    ----------
    frequency, time : sequences of experiments
    modes : sequence of (Hz, damping), optional
        Poles of the parametric part; empty for none; None to take them from the first frequency response.
    prior : Prior, optional
        None to take it from the curve of the smallest gain bound.
    repeat : int
        Multiplicity of each pole.
    delay : int, samples, optional
        Of the pairs; default what the data suggest, 1 where nothing does.

    Raises
    ------
    InputError, InputTypeError
        Data without sample time or bound, with different channels or sample times.
    """
    choices = []
    placeholder = prior or default_prior((*frequency, *time))
    # Refuses what lacks a sample time or a bound, before anything is computed from it.
    step, basis = MixedProblem(frequency=frequency, time=time, prior=placeholder).dt, None
    if modes:
        hz, damping = np.array(modes, dtype=float).T
        basis = kautz(2 * np.pi * hz, damping, dt=step, repeat=repeat, delay=1 if delay is None else delay)
    elif modes is None and frequency:
        suggestion = suggest_kautz(frequency[0], repeat=repeat, delay=delay)
        basis = suggestion.basis
        choices.append(MODES_NOTE + suggestion.summary())
    problem = MixedProblem(frequency=frequency, time=time, prior=placeholder, parametric=basis)
    if prior is None:
        found = suggest_prior(problem)
        choices.append(PRIOR_NOTE + found.summary())
        chosen = found.prior
        if chosen is None:  # nothing fits: a class large enough to show the contradiction of the data themselves
            size = 100 * response_sizes(problem)[0]
            chosen = dataclasses.replace(placeholder, gain_bound=size or 1.0, decay_rate=float(found.decay_rates[0]))
        problem = dataclasses.replace(problem, prior=chosen)
    return Proposal(problem, tuple(choices))


def identify_reduced(
    data: Any,
    *,
    modes: Sequence[tuple[float, float]] | None = None,
    repeat: int = 1,
    delay: int | None = None,
    prior: Prior | None = None,
    inflate: float | str = 1.0,
    objective: str = "center",
    solver: str = "auto",
    accuracy: float = 1e-4,
    form: str = "auto",
    rigid_body: int | None = None,
    worst_case: bool = True,
    omega: Any = None,
    directions: int = 16,
    rtol: float = 0.05,
    executor: Any = None,
    progress: Say | None = None,
) -> IdentifiedReduced:
    """From bounded data to the smallest model inside the bounds, with its worst-case error and all choices.

    Modes and prior are taken from the data where they aren't given, the consistency is decided with a proof, the model is reduced
    while every sample stays inside its bound, and the error of the small model over all consistent systems is bounded.

    Parameters
    ----------
    data : MixedProblem, FrequencyResponse, TimeRecord, or a sequence of these two
        A problem states the class: `modes`, `repeat`, `delay` and `prior` are not given then. Else data with bounds.
    modes : sequence of (Hz, damping), optional
        Poles of the parametric part; empty for none; None to take them from the first frequency response.
    repeat, delay : int
        Multiplicity of each pole; delay of the pairs in samples.
    prior : Prior, optional
        None: twice the smallest gain bound, at the knee of its curve against the decay rate.
    inflate : float or "auto"
        Factor on all bounds, said in every result. "auto": the smallest with which the class (without `prior`: the modes beside a
        rest as large as the median response, at the middle decay rate) is consistent, and 10 % more; 1 where it is without.
    objective, solver, accuracy, form : optional
        As in `identify`.
    rigid_body : int, optional
        Rigid-body modes of the small model, as in `reduce_within_bounds`.
    worst_case : bool
        Whether the worst-case error is bounded, the longest part.
    omega, directions, rtol, executor : optional
        As in `worst_case_error`.
    progress : callable (text, done, all), optional
        `done` and `all` are None where nothing is counted.

    Returns
    -------
    IdentifiedReduced
        Inconsistent data are a finding with its proof: `findings` says which factor on the bounds, or which other class, would do.

    Raises
    ------
    InputError, InputTypeError
        Data without bounds, of different channels, contradictory arguments.

    Notes
    -----
    Poles and prior from the data are assumptions that these data don't refute; the error doesn't cover other poles: see
    `worst_case_over_poles`. Source: class and model `inanc2001`.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.flexible_structure(seed=0)
    >>> modes, prior = [(9.0, 0.1), (17.67, 0.004)], rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> small = rid.identify_reduced([data.frequency, data.time], modes=modes, prior=prior, omega=[60.0], directions=4)
    >>> small.consistent, small.reduction.order, bool(small.error.upper[0, 0, 0] < 0.3)
    (True, 4, True)
    """
    say = progress or _silent
    hz = None if omega is None else [float(w) / (2 * np.pi) for w in np.atleast_1d(np.asarray(omega, dtype=float))]
    content: dict[str, Any] = {
        "modes": {"repeat": repeat} | ({} if delay is None else {"delay": delay}),
        "identify": {"objective": objective, "solver": solver, "accuracy": accuracy, "form": form, "inflate": inflate},
        "small_model": {} if rigid_body is None else {"rigid_body": rigid_body},
        "worst_case": {"compute": worst_case, "directions": directions, "rtol": rtol}
        | ({} if hz is None else {"at_hz": hz}),
    }
    if modes is not None:
        content["modes"] |= {"hz": [float(m[0]) for m in modes], "damping": [float(m[1]) for m in modes]}
    if prior is not None:
        content["prior"] = {name: value for name, value in prior_fields(prior).items() if value is not None}
    asked = read_run_file(content, "identify_reduced", sources=False)
    if isinstance(data, MixedProblem):
        given = [("modes", modes), ("prior", prior), ("delay", delay), ("repeat", None if repeat == 1 else repeat)]
        if stated := [name for name, value in given if value is not None]:
            raise InputError(f"`{stated[0]}` is part of the problem already; change it there, or give the data alone")
        return from_problem(asked, data, say, executor)
    return from_data(asked, _as_measured(data), say, Store(), executor)


def _silent(text: str, done: int | None = None, count: int | None = None) -> None:
    """No progress."""


def _as_measured(data: Any) -> Measured:
    items = [data] if isinstance(data, FrequencyResponse | TimeRecord) else data
    if not isinstance(items, Sequence) or not all(isinstance(x, FrequencyResponse | TimeRecord) for x in items):
        raise InputTypeError(
            "`data` must be a MixedProblem, a FrequencyResponse, a TimeRecord, or a sequence of these two; got"
            f" {type(data).__name__}"
        )
    return Measured(
        tuple(x for x in items if isinstance(x, FrequencyResponse)),
        tuple(x for x in items if isinstance(x, TimeRecord)),
    )


def run(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    resume: bool = False,
    force: bool = False,
    executor: Any = None,
    progress: Say | None = None,
) -> IdentifiedReduced:
    r"""Everything that a run file says, from the measured files to the report, kept in a folder.

    Written as soon as it is there: the frequency responses, the run file with every choice made so far, the identification; at
    the end the worst-case error, the small model, the summary, the report. The run file in the folder, run again, gives the same.

    Parameters
    ----------
    path : path
        The run file, TOML: see ``robustid run --help`` for a file with every section. Names in it are seen from its folder.
    folder : path
        For the results; new, or empty.
    resume : bool
        Go on in a folder that holds an unfinished run of the same run file.
    force : bool
        Replace what an earlier run wrote there.
    executor : concurrent.futures.Executor or int, optional
        As in `worst_case_error`.
    progress : callable (text, done, all), optional

    Returns
    -------
    IdentifiedReduced

    Raises
    ------
    InputError, InputTypeError, FileFormatError
        Unknown keys, wrong types, contradictions, missing files, a folder that holds something: before anything is computed.

    Examples
    --------
    >>> import pathlib, tempfile, robustid as rid
    >>> place = pathlib.Path(tempfile.mkdtemp())
    >>> rid.save(place / "frf.csv", rid.flexible_structure(lines=5).frequency)
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
    path, folder, say = Path(path), Path(folder), progress or _silent
    asked = read_run_file(path)
    _check_folder(path, folder, resume, force)
    store = Store(folder, resume)
    if (before := store.asked(asked.moved(path.parent, folder))) is not None:
        stated, data = measured(before, folder, say)
    else:
        stated, data = measured(asked, path.parent, say)
        stated = stated.moved(path.parent, folder)
    store.open(force)
    try:
        result = from_data(stated, data, say, store, executor)
    except SizeError as error:
        count = str(error).split(". ")[0].replace("`problem` has", "the data make")
        raise SizeError(
            f"{count}. Use a part of them: in [lines] band_hz = [low, high], or every = 2 or more; in [[record]] start and stop"
        ) from None
    say("writing the report")
    store.finish(result)
    return result


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
