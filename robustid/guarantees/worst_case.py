"""worst_case_error(): the largest distance of all consistent systems from a model, at every frequency."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Budget, Progress, Real, as_count, as_kind, as_positive, one_thread
from robustid.errors import InputError
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.nominal import as_frequencies, as_nominal, default_grid
from robustid.guarantees.parameters import parameter_intervals
from robustid.guarantees.polygons import value_set
from robustid.guarantees.sweep import Folder, Known, Means, Processes, spread_order, value_sets
from robustid.guarantees.value_set import ValueSet, gap_of
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification

if TYPE_CHECKING:
    import control

LEAST, MOST = 3, 360  # directions: a polygon has three; beyond one per degree nothing is gained
_NO_TIME = 1e-9  # seconds: the coefficients of the parametric part stay without intervals


@one_thread()
def worst_case_error(
    identification: Identification,
    *,
    model: control.StateSpace | None = None,
    omega: ArrayLike | None = None,
    directions: int = 16,
    rtol: float = 0.05,
    executor: Processes = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
    time_limit: float | None = None,
    known: Known | None = None,
) -> WorstCaseError:
    """Guaranteed worst-case error of a model over all consistent systems, at every frequency.

    At each frequency the values of all consistent systems form a convex set. Its support function in `directions` equally spaced
    directions gives a polygon around it, each side with a certificate (a dual feasible point, evaluated without the solver), and
    points inside that are attained:

        lower <= max over consistent F of |F(exp(j omega T)) - model(exp(j omega T))| <= upper.

    MIMO: this is done for every entry; the norm of the matrix of the upper bounds is a bound of the largest singular
    value of F - model. Entries that no sample sees together with others are bounded from their own samples, a smaller problem whose
    certificate is one of the whole; systems near to the bounds are looked for in all of it.

    Parameters
    ----------
    identification : Identification
        Consistent.
    model : control.StateSpace, optional
        Any stable nominal with the dt of the data, a reduced one for instance. Default: that of the identification.
    omega : (F,) array, rad/s, optional
        Default: 64 frequencies over the range of the data and below and above it, and the frequencies of the parametric poles.
    directions : int
        Sides of the polygon, 3 to 360: upper bounds exceed the truth by 1/cos(pi/directions) at most. Of matrices the largest
        number of them: each entry gets as many as its farthest corner asks for.
    rtol : float
        Aim for (upper - lower)/upper of the entries; never met below 1 - cos(pi/directions)^2.
    executor : concurrent.futures.Executor or int, optional
        Spreads the frequencies over any executor (`distributed.Client().get_executor()` for a cluster), or so many processes of
        its own, which want ``if __name__ == "__main__":`` in scripts; tries those of dead workers again. Default: this process.
    progress : callable (text, done, count), optional
    resume : path, optional
        Folder to which every frequency is written when it is finished; what is there of the same data and settings isn't computed
        again.
    time_limit : float, optional
        Seconds; then the result has the frequencies that are finished, those where the error may be largest and others spread over
        the range, and names the `missing` ones; parameters may be left without intervals. So it is on Ctrl-C without `resume`.
    known : Band, optional
        Discs that are known already: frequencies where they are estimated to be twice as large as need be come first.

    Returns
    -------
    WorstCaseError

    Raises
    ------
    InconsistentDataError
        The data fit no system of the class.
    InputError
        An unstable model, another dt, frequencies above pi/dt, too few or too many directions; `resume` can't be written to.
    SolverError
        A frequency failed three times, on whatever worker.

    Notes
    -----
    Exact form: the frequency is one more interpolation node. Taylor form: the value is a linear functional of the coefficients, and
    the tail of the series is part of both bounds. Source: `inanc2001` section II-C (diameter and worst-case error); the certificate
    is the dual of the LMI of Theorem 1 with a linear objective.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 2)[0], [0.5, 0.25], dt=1.0, bound=1e-3)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    >>> error = rid.worst_case_error(result, omega=[0.0, 1.0])
    >>> error.upper.shape, bool(np.all(error.lower <= error.upper)), error.certified
    ((2, 1, 1), True, True)
    """
    means = Means(executor, progress, resume, Budget(time_limit))
    return _error(identification, model, omega, (directions, rtol), means, known, least=1)


@one_thread()
def error_in_time(
    identification: Identification,
    *,
    model: control.StateSpace,
    omega: Real,
    directions: int,
    rtol: float,
    executor: Processes = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
    time_limit: float | None = None,
    known: Known | None = None,
) -> WorstCaseError | None:
    """As `worst_case_error`, for a step of many: None where the time is over before a frequency is finished."""
    means = Means(executor, progress, resume, Budget(time_limit))
    found = _error(identification, model, omega, (directions, rtol), means, known, least=0)
    return found if found.values else None


def _error(
    identification: Identification,
    model: control.StateSpace | None,
    omega: ArrayLike | None,
    sides: tuple[int, float],
    means: Means,
    known: Known | None,
    least: int,
) -> WorstCaseError:
    """The error at so many frequencies at `least`, whatever the time is; `sides` are their number, and the part of the gap."""
    as_kind("identification", identification, Identification, "an Identification")
    directions = as_count("directions", sides[0], least=LEAST)
    if directions > MOST:
        raise InputError(f"`directions` must be at most {MOST}, one per degree; got {directions}")
    gap = gap_of(as_positive("rtol", sides[1]), directions, identification.problem.entries.single)
    model = as_nominal(model, identification)
    grid = default_grid(identification.problem) if omega is None else as_frequencies(omega, identification.problem)
    consistent = consistent_set(identification)
    values = value_sets(consistent, grid, directions, gap, means, model, known, least)
    workers = None if identification.problem.entries.single else means.executor
    return WorstCaseError(
        identification=identification,
        model=model,
        values=tuple(values),
        parameters=parameter_intervals(consistent, workers, means.budget),
        directions=directions,
        gap=gap,
        missing=grid[~np.isin(grid, [one.omega for one in values])],
    )


def growing_error(
    identification: Identification, omega: Real, *, directions: int, gap: float, progress: Progress | None = None
) -> Iterator[WorstCaseError]:
    """Worst-case errors of the nominal model of a SISO plant at one frequency, at two, ..., for those who watch.

    Every one is guaranteed, as that of `worst_case_error`, which takes finer ones; the coefficients have no intervals. The
    frequencies come in an order of which every beginning is spread over all of them.

    `directions` are the sides of the polygons, `gap` the part of the distance from the centre to which every support value
    is found; an exception that `progress` raises ends the computation. InconsistentDataError: the data fit no system of the
    class.
    """
    consistent = consistent_set(identification)
    parameters = parameter_intervals(consistent, None, Budget(_NO_TIME))
    found: dict[float, ValueSet] = {}

    def told() -> None:
        nonlocal sides
        sides += 1
        if progress is not None:
            progress("bounding the error at every frequency", min(sides, count), count)

    sides, count = 0, omega.size * directions
    for w in (float(omega[k]) for k in spread_order(omega.size)):
        found[w] = value_set(consistent, w, directions, gap, told)
        sides = len(found) * directions  # a real value has two sides only
        yield WorstCaseError(
            identification=identification,
            model=identification.model,
            values=tuple(found[one] for one in sorted(found)),
            parameters=parameters,
            directions=directions,
            gap=gap,
        )
