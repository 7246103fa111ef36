"""family(): from members with their proofs to one nominal and one band."""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Budget, Progress, Real, Record, as_array, as_count, one_thread
from robustid.errors import InputError
from robustid.guarantees.common_nominal import centres_of, fitted_nominal
from robustid.guarantees.family_result import Family
from robustid.guarantees.member import CONDITIONS, Member, Members, as_members
from robustid.guarantees.nominal import as_frequencies, as_nominal, default_grid
from robustid.guarantees.over_poles import Bounded, worst_case_over_poles
from robustid.guarantees.pole_sweep import default_frequencies
from robustid.guarantees.stated_box import checked_box
from robustid.guarantees.sweep import Folder, Means, Processes
from robustid.guarantees.worst_case import worst_case_error
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")


@one_thread()
def family(
    members: Members,
    *,
    model: control.StateSpace | None = None,
    order: int | None = None,
    omega: ArrayLike | None = None,
    schedule: str | None = None,
    interval: tuple[float, float] | None = None,
    directions: int = 16,
    rtol: float = 0.05,
    executor: Processes = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
    time_limit: float | None = None,
) -> Family:
    r"""Plants that differ by amplitude, position, load or date as one family: a nominal model, and a band that holds them all.

    Every member has its own data and its own proof, all in one class; the values of its consistent systems at every frequency are
    in polygons (`worst_case_error`). The band of the family is the largest distance of any polygon from a common nominal,
    which is fitted to the centres of the smallest discs around the polygons of all members: no nominal has a band smaller
    than their radii. Support functions do not depend on the nominal, so that nothing is solved again for it.

    Parameters
    ----------
    members : sequence of Member or Identification, or mapping of names to them
        Two at least, of the same signals, sample time and class (prior and number of parametric functions); poles may differ.
        Results of `worst_case_error` and `worst_case_over_poles` at the same frequencies are taken as they are.
    model : control.StateSpace, optional
        The nominal. Default: the smallest stable model, fitted to the centres with weight 1/radius, whose band exceeds no radius
        by more than 20 %; the best one of those tried where none does.
    order : int, optional
        Of the fitted nominal.
    omega : (F,) array, rad/s, optional
        Default: the frequencies that `worst_case_error` would take, of all members.
    schedule : {"amplitude", "position", "load"}, optional
        The condition by which members are told apart. Default: the only one that has a number for every member, and differs.
    interval : (float, float), optional
        Range of it that you ask about; default from the smallest to the largest of the members.
    directions, rtol, executor, progress, resume : optional
        As in `worst_case_error`; progress counts the frequencies of all members.
    time_limit : float, optional
        Seconds, shared by the members: the family then has the frequencies that were finished for all of them; a warning says so.

    Returns
    -------
    Family

    Raises
    ------
    InputError, InputTypeError
        One member, members with unlike signals, sample times or classes, identical data, an unknown condition.
    InconsistentDataError
        The data of a member refute the class; all such members are named.

    Notes
    -----
    Of the members alone: nothing is proved between them (`not_known`).

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, prior = np.array([0.5, 1.5, 2.5]), rid.Prior(gain_bound=2.0, decay_rate=1.5)
    >>> def plant(gain):
    ...     frf = rid.FrequencyResponse(omega, gain * (1 + 0.3 * np.exp(-1j * omega)), bound=0.05, dt=1.0)
    ...     return rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
    >>> two = rid.family([rid.guarantee.Member(plant(g), amplitude=g) for g in (0.8, 1.0)], omega=omega, directions=8)
    >>> two.names, two.upper.shape, two.certified
    (('amplitude 0.8', 'amplitude 1'), (3, 1, 1), True)
    >>> bool(np.all(two.upper >= two.centres.radius * (1 - 1e-9)))
    True
    """
    found = as_members(members)
    schedule, span = _scheduled(found, schedule, interval)
    order = None if order is None else as_count("order", order, least=1)
    if model is not None and order is not None:
        raise InputError("`order` is that of the nominal that is fitted, and `model` states one; leave one of them out")
    means, grid = Means(executor, progress, resume, Budget(time_limit)), _frequencies(found, omega)
    bounded = _bounded(found, grid, directions, rtol, means)
    results = [result for _, result in bounded]
    first, tried = results[0].identification, ()
    if model is not None:
        model = as_nominal(model, first)
    else:

        def band(nominal: control.StateSpace) -> Real:
            return np.max([result.with_model(nominal).upper for result in results], axis=0)

        identifications = [result.identification for result in results]
        model, tried = fitted_nominal(identifications, results[0].omega, centres_of(results), order, band)
    return Family(members=tuple(m for m, _ in bounded), model=model, tried=tried, schedule=schedule, interval=span)


def _frequencies(members: Sequence[Member], omega: ArrayLike | None) -> Real:
    """Frequencies that were asked for, those at which members are bounded already, or the default ones."""
    problem = members[0].identification.problem
    known = [m.result.omega for m in members if not isinstance(m.result, Identification)]
    if omega is not None:
        grid = as_frequencies(omega, problem)
    elif known:
        grid = known[0]
    else:
        grid = frequencies_of(members)
    for m in members:
        if not isinstance(m.result, Identification) and not np.array_equal(m.result.omega, grid):
            raise InputError(
                f"`members`: {m.name!r} is bounded at other frequencies than the family; bound all at the same `omega`, or give"
                " the identifications"
            )
    return grid


def frequencies_of(members: Sequence[Member]) -> Real:
    """Default frequencies of members: those of `worst_case_error`, fewer where a pole-uncertainty box is to be covered."""
    found: list[Real] = []
    for m in members:
        problem = m.identification.problem
        if m.poles is None:
            found.append(default_grid(m.identification.problem))
        else:
            omega, damping = m.poles
            omega, _, _ = checked_box(m.identification, omega, damping, m.delay)
            found.append(default_frequencies(problem, omega))
    return np.unique(np.concatenate(found))


def _bounded(
    members: Sequence[Member], grid: Real, directions: int, rtol: float, means: Means
) -> list[tuple[Member, Bounded]]:
    """The members with the bounds of their values at the same frequencies, computed where they aren't there.

    Where the time ends, at those that were finished for all: each member is asked about what the ones before it have.
    """
    asked, count = grid.size, sum(isinstance(m.result, Identification) for m in members)
    results: list[Bounded] = []
    done = 0
    for m in members:
        error = m.result
        if isinstance(error, Identification):
            told = None if means.progress is None else functools.partial(_counted, means.progress, done, count)
            options = means.part(f"member-{done + 1}", 1 / (count - done), told).options
            how: Record = {"omega": grid, "directions": directions, "rtol": rtol, **options}
            if m.poles is None:
                error = worst_case_error(error, **how)
            else:
                error = worst_case_over_poles(error, *m.poles, delay=m.delay, **how)
            done += 1
        grid = error.omega
        results.append(error)
    if grid.size < asked:
        _log.warning(
            "the time limit ended the sweep: %d of %d frequencies are bounded for all members", grid.size, asked
        )
    results = [_at(error, grid) for error in results]
    return [(m if error is m.result else m.bounded(error), error) for m, error in zip(members, results, strict=True)]


def _counted(progress: Progress, number: int, count: int, text: str, done: int, each: int) -> None:
    """Tell how much is done of all members."""
    progress(text, number * each + done, count * each)


def _at(error: Bounded, grid: Real) -> Bounded:
    """The bounds at those of the frequencies that all members have."""
    used = np.isin(error.omega, grid)
    if used.all():
        return error
    kept = tuple(item.at(grid) for item in error.kept if not item.values or np.isin(item.omega, grid).any())
    if isinstance(error, WorstCaseError):
        missing = np.union1d(error.missing, error.omega[~used])
        return dataclasses.replace(error, values=kept[0].values, missing=missing)
    return dataclasses.replace(error, kept=kept, omega=error.omega[used])


def _scheduled(
    members: Sequence[Member], schedule: str | None, interval: tuple[float, float] | None
) -> tuple[str | None, tuple[float, float] | None]:
    """The condition by which the members are told apart, and its range."""
    numeric = CONDITIONS[:-1]
    if schedule is not None and schedule not in numeric:
        raise InputError(f"`schedule` must be one of {numeric}; got {schedule!r}")
    given = {what: [getattr(m, what) for m in members] for what in numeric}
    usable = [what for what, values in given.items() if None not in values and len(set(values)) > 1]
    if schedule is None:
        if len(usable) != 1:
            if interval is not None:
                raise InputError(
                    f"`interval` belongs to a condition that has a number for every member, and differs: {usable or 'none'} do;"
                    " give `schedule`"
                )
            return None, None
        schedule = usable[0]
    if schedule not in usable:
        raise InputError(f"`schedule` = {schedule!r}: every member must state its {schedule}, not all the same one")
    values = [float(value) for value in given[schedule]]
    if interval is None:
        return schedule, (min(values), max(values))
    ends = as_array("interval", interval, ndim=1)
    if ends.size != 2 or not ends[0] < ends[1]:
        raise InputError(f"`interval` must be two numbers, the lower one first; got {interval!r}")
    return schedule, (float(ends[0]), float(ends[1]))
