"""suggest_class(): pairs, their multiplicity and the prior, chosen by the guaranteed error that results."""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robustid.advice.class_table import ClassCandidate, ClassSuggestion, choice, rank
from robustid.advice.kautz import KautzSuggestion, suggest_kautz
from robustid.advice.prior import suggest_prior
from robustid.advice.scaling import suggest_scaling
from robustid.advice.sensitivity import default_points
from robustid.bases import kautz
from robustid.core import Budget, Interruptible, Progress, Real, as_array, as_count, one_thread
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, SizeError, SolverError
from robustid.guarantees import PoleCell, box_of
from robustid.identification import MixedProblem, identify, posed_alone

_log = logging.getLogger("robustid")

_REPEATS = (1, 2, 3)  # a third term is the last that the expansion of a cell of poles has
_PREPARING = 0.5  # of a time limit at most, for modes and priors
_PRIORS = 3  # pairs (K, rho) tried with the best parametric part
_LATE = "the time was over"


@one_thread()
def suggest_class(
    *,
    frequency: FrequencyResponse | Sequence[FrequencyResponse] | None = None,
    time: TimeRecord | Sequence[TimeRecord] | None = None,
    modes: ArrayLike | None = None,
    delay: int | None = None,
    scaling: ArrayLike | str | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> ClassSuggestion:
    """Choose the pairs, their multiplicity and (K, rho) by the guaranteed error that results.

    Every candidate parametric part gets the consistent (K, rho) with the smallest slope bound (`suggest_prior`, K twice the
    smallest that the data allow), is identified, and its worst case is bounded at the modes and at 7 frequencies over the
    range of the frequency points; with the best part two further (K, rho) are tried. Seconds to minutes. MIMO: the pairs are common
    to all entries, and the error is the largest singular value.

    Parameters
    ----------
    frequency, time : one experiment or a sequence of them
        At least one of the two, with bounds; of several responses the first proposes the modes.
    modes : (M, 2) array, rad/s and 1, optional
        Natural frequencies and damping ratios that are known: prior knowledge, so the errors are those at these poles. Default:
        from the data (`suggest_kautz`), one mode fewer and one more, and the errors cover the pole-uncertainty box that the data
        leave to them.
    delay : int, samples
        Of the pairs; default what the data suggest, 1 where the modes are given.
    scaling : (ny, nu) array, optional
        MIMO: of every prior, and the units in which entries are compared; default `suggest_scaling`.
    time_limit : float, optional
        Seconds, of which every candidate gets its part; one that needs more has the errors at the frequencies that were finished,
        and stands behind those that have all. On Ctrl-C it stands there too, and no further one is evaluated.
    progress : callable (text, done, count), optional
        Candidates.

    Returns
    -------
    ClassSuggestion

    Raises
    ------
    InputError
        No frequency response to take the modes from; a time record with other than zero initial conditions (the pole-uncertainty
        box does not cover what it does to the initial state); data without bounds; data that do not suggest a scaling.

    Notes
    -----
    Never is a band at poles from the data compared: narrow bands at wrong poles pass every test of the data. Single pairs
    (``repeat = 1``) are covered by `worst_case_over_poles`. A repeated pair at the middle a0 of the pole-uncertainty box covers
    it by the expansion of 1/(1 - a z^-1) about a0: coefficients of the first `repeat` terms free, those up to the third in
    intervals, the remainder added to the bounds (`PoleCell`). Left out without an error: modes that the bounds of the frequency
    points contradict, and further modes whose poles the frequency points do not determine.
    Source: class of `inanc2001` section II.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.advice import suggest_class
    >>> data = rid.datasets.flexible_structure(lines=3, samples=2)
    >>> found = suggest_class(frequency=data.frequency, modes=data.modes)
    >>> found.recommended.repeat, rid.identify(found.problem).consistent
    (1, True)
    """
    data = posed_alone(frequency, time)
    if not data.entries.single:
        scaling = suggest_scaling(data) if scaling is None else scaling
        data = dataclasses.replace(data, prior=dataclasses.replace(data.prior, scaling=scaling))
    wanted, budget = (
        None if delay is None else as_count("delay", delay),
        Budget(time_limit, progress, "comparing classes"),
    )
    preparing = budget.share(_PREPARING)
    if modes is None:
        parts, resonances = _from_data(data, wanted, preparing)
    else:
        parts, resonances = _at_given_poles(data, modes, 1 if wanted is None else wanted, preparing)
    omega = np.unique(np.append(default_points(data), resonances))
    rows = _evaluated(parts, omega, budget)
    best = choice(rows)
    line = None if best is None else float(omega[int(np.nanargmax(best.largest))])
    return ClassSuggestion(omega=omega, candidates=tuple(rows), next_line=line)


class _Part(NamedTuple):
    """A parametric part: its problems with every consistent prior, that with the smallest slope bound first."""

    pairs: int
    repeat: int
    modes: KautzSuggestion | None
    cell: PoleCell | None
    problems: tuple[MixedProblem, ...]
    note: str = ""
    late: bool = False

    def candidate(
        self, problem: MixedProblem | None, omega: Real, budget: Budget, *, late: bool = False
    ) -> ClassCandidate:
        """Evaluated within a budget, unless a note says why not, or it is too late."""
        late = not self.note and (late or self.late)
        unknown = np.full(omega.size, np.nan)
        found = ClassCandidate(
            pairs=self.pairs,
            repeat=self.repeat,
            problem=problem,
            modes=self.modes,
            cell=self.cell,
            margin=np.nan,
            upper=unknown,
            error=unknown,
            note=_LATE if late else self.note,
            late=late,
        )
        if found.note or problem is None:
            return found
        try:
            found = found.evaluated(omega, time_limit=budget.seconds)
        except SolverError as error:
            return dataclasses.replace(found, note=str(error))
        missing = np.isnan(found.error)
        if missing.any() and (budget.over or not missing.all()):
            left = "" if missing.all() else f" after {np.sum(~missing)} of {missing.size} frequencies"
            return dataclasses.replace(found, note=_LATE + left, late=True)
        _log.info("%s: mean guaranteed error %.4g", problem.prior, found.mean)
        return found


def _evaluated(parts: list[_Part], omega: Real, budget: Budget) -> list[ClassCandidate]:
    """Every part with its first prior, the best with further ones, within the budget; smallest error first."""
    rows: list[ClassCandidate] = []
    first = [(part, part.problems[0] if part.problems else None) for part in parts]

    def evaluate(asked: list[tuple[_Part, MixedProblem | None]]) -> bool:
        """Return whether none was interrupted."""
        for k, (part, problem) in enumerate(asked):
            late = bool(rows) and budget.over
            waiting = sum(not (one.note or one.late) for one, _ in asked[k:])
            mine = budget.share(1 / max(waiting, 1))
            with Interruptible(lambda: bool(rows)) as search:
                rows.append(part.candidate(problem, omega, mine, late=late))
            if search.interrupted:
                rows.append(part.candidate(problem, omega, mine, late=True))
                return False
            budget.tell(len(rows), len(parts) + _PRIORS - 1)
            if rows[-1].late and not mine.over:  # Ctrl-C, and the sweep returned what it had
                return False
        return True

    done, best = evaluate(first), choice(rows)
    if done and best is not None and np.all(np.isfinite(best.error)) and not budget.over:
        part = parts[next(k for k, row in enumerate(rows) if row is best)]
        evaluate([(part, problem) for problem in part.problems[1:_PRIORS]])
    return sorted(rows, key=rank)


def _at_given_poles(data: MixedProblem, modes: ArrayLike, delay: int, budget: Budget) -> tuple[list[_Part], Real]:
    modes = as_array("modes", modes, ndim=2)
    if modes.shape[1] != 2:
        raise InputError(f"`modes` must have one row (rad/s, damping ratio) per mode; got shape {modes.shape}")
    omega, damping = modes.T
    parts: list[_Part] = []
    for repeat in _REPEATS:
        basis = kautz(omega, damping, dt=data.dt, repeat=repeat, delay=delay)
        make = functools.partial(dataclasses.replace, data, parametric=basis)
        parts.append(_part(len(modes), repeat, make, budget, first=not parts))
    return parts, omega


def _from_data(data: MixedProblem, delay: int | None, budget: Budget) -> tuple[list[_Part], Real]:
    """The modes that the data show, one fewer and one more."""
    frf = next((one for one in data.frequency if isinstance(one, FrequencyResponse)), None)
    if frf is None:
        raise InputError("`frequency` is needed to take the modes from; or give the `modes` that you know")
    for record in data.time:
        if record.initial != "rest":
            raise InputError(
                f'`time` has a record with initial="{record.initial}": what poles in a pole-uncertainty box do to its initial'
                " state is not bounded; leave it out here, or give the `modes` that you know"
            )
    found = suggest_kautz(frf, delay=delay, time_limit=budget.seconds)
    parts = _box_parts(data, found, "", budget, first=True)
    for count in (found.omega.size - 1, found.omega.size + 1):
        if count < 1:
            continue
        if budget.over:
            parts.append(_Part(count, 1, None, None, (), late=True))
            continue
        try:
            other = suggest_kautz(frf, modes=count, delay=found.delay, time_limit=budget.seconds)
        except SizeError:  # no time
            parts.append(_Part(count, 1, None, None, (), late=True))
            continue
        except InputError:  # more modes than the frequency points can tell
            continue
        parts += _box_parts(data, other, _why_not(other, found), budget)
    return parts, found.omega


def _why_not(other: KautzSuggestion, found: KautzSuggestion) -> str:
    """Reason for leaving out other numbers of modes than those found; empty where they are worth a try."""
    if other.omega.size < found.omega.size and np.any(other.level > 1) and np.all(found.level <= 1):
        return f"the frequency points contradict so few modes: bounds times {other.level.max() / 2:.3g}"
    if other.undetermined.sum() > found.undetermined.sum():
        return "the frequency points do not determine the poles of so many modes"
    return ""


def _box_parts(
    data: MixedProblem, modes: KautzSuggestion, note: str, budget: Budget, *, first: bool = False
) -> list[_Part]:
    """The modes with every multiplicity, each covering the pole-uncertainty box."""
    pairs = modes.omega.size
    if note:
        return [_Part(pairs, 1, modes, None, (), note)]
    make = functools.partial(dataclasses.replace, data, parametric=modes.basis)
    single = _part(pairs, 1, make, budget, modes, first=first)
    if not pairs or not single.problems or budget.over:
        return [single]
    try:
        cell = box_of(identify(single.problems[0]), modes.omega_interval, modes.damping_interval, modes.delay)
        relaxed = cell.relaxed(data)
    except InputError as error:  # too few samples for the terms that cover it
        return [single._replace(note=f"the pole-uncertainty box that the data leave can't be covered: {error}")]
    if relaxed is None:
        return [single]
    ends = np.array(relaxed.parameter_bounds)
    ends = ends.reshape(pairs, -1, 2, *ends.shape[1:])
    parts = [single]
    for repeat in _REPEATS[1:]:
        free = ends.copy()
        free[:, :repeat] = -np.inf, np.inf
        make = functools.partial(dataclasses.replace, relaxed, parameter_bounds=free.reshape(-1, *free.shape[3:]))
        parts.append(_part(pairs, repeat, make, budget, modes, cell))
    return parts


def _part(
    pairs: int,
    repeat: int,
    make: Callable[[], MixedProblem],
    budget: Budget,
    modes: KautzSuggestion | None = None,
    cell: PoleCell | None = None,
    *,
    first: bool = False,
) -> _Part:
    """A part with its priors, unless the budget is over; the first one is made all the same."""
    if budget.over and not first:
        return _Part(pairs, repeat, modes, cell, (), late=True)
    try:
        problem = make()
        found = suggest_prior(problem, time_limit=budget.seconds)
        problems = tuple(dataclasses.replace(problem, prior=prior) for prior in found.by_slope())
    except SizeError:
        raise
    except InputError as error:  # functions that the samples can't tell apart
        return _Part(pairs, repeat, modes, cell, (), str(error))
    return _Part(pairs, repeat, modes, cell, problems, "" if problems else "no gain bound makes the data consistent")
