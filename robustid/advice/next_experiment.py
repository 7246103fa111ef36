"""suggest_next(): where one more measurement is guaranteed to pay."""

from __future__ import annotations

import dataclasses
import logging

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Options,
    Progress,
    Real,
    StateSpace,
    as_array,
    as_count,
    as_kind,
    as_positive,
    one_thread,
)
from robustid.data import TimeRecord
from robustid.errors import InputError
from robustid.guarantees import WorstCaseError, bounds_of_entries, output_errors, worst_case_error
from robustid.identification import Identification, MixedProblem, entry_name

_log = logging.getLogger("robustid")

_DIRECTIONS, _RTOL = 12, 0.1
_FREQUENCIES = 24  # of the default candidates, besides those of the parametric poles
_SAMPLES = 4  # of the continued record


@dataclasses.dataclass(frozen=True)
class NextMeasurement:
    """One candidate, and the effect of its measurement on the worst-case error there.

    Errors of a frequency are those of the response; errors of a time sample those of the output, divided by the largest input.
    MIMO: at a frequency the response to one input is measured, at a time sample all outputs are; the numbers are those of the
    entry that gains most.

    Attributes
    ----------
    kind : {"frequency", "time"}
    at : float
        rad/s; or s after the start of the continued record.
    lower, upper : float
        Present worst-case error of the model there: attained, and proved.
    bound : float
        Error bound eps of the measurement.
    entry : (int, int)
        Output and input that the errors are about; of a time sample the input that moves this output most.
    name : str
        The entry in words; empty for SISO.
    """

    kind: str
    at: float
    lower: float
    upper: float
    bound: float
    entry: tuple[int, int] = (0, 0)
    name: str = ""

    @property
    def remaining(self) -> float:
        """Largest worst-case error there afterwards, of any consistent model: 2 eps (of the best nominal value: eps)."""
        return 2 * self.bound

    @property
    def guaranteed(self) -> float:
        """Error that is removed whatever the measurement says: max(0, lower - 2 eps)."""
        return max(0.0, self.lower - self.remaining)

    @property
    def possible(self) -> float:
        """Error that is removed at most: all of it, where the outcome leaves a single value; the proved bound of the error."""
        return self.upper

    def __str__(self) -> str:
        place = f"{self.at / (2 * np.pi):.5g} Hz" if self.kind == "frequency" else f"time samples to {self.at:.5g} s"
        place += f" ({self.name})" if self.name else ""
        return (
            f"{place}: worst-case error now {self.upper:.4g} (attained {self.lower:.4g}); measured to {self.bound:.4g} it loses at"
            f" least {self.guaranteed:.4g}"
        )


@one_thread()
def suggest_next(
    identification: Identification | WorstCaseError,
    *,
    candidates: ArrayLike | None = None,
    bound: ArrayLike | None = None,
    count: int = 5,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> list[NextMeasurement]:
    """Rank candidate measurements by the worst-case error that each is guaranteed to remove.

    Today the worst-case error of the model at a frequency lies between two numbers, lower (a consistent system attains it) and
    upper (proved). Measure there once more, with an error of at most eps: the consistent values that are left lie in a disc of
    radius eps around the measured one. No two of them differ by more than 2 eps, so that the model of a new identification, which
    is one of them, errs there by at most 2 eps, and the best nominal value by at most eps. Whatever the measurement says,

        removed at that frequency >= lower - 2 eps,    and never more than upper.

    What this does not say. The guarantee is for the model that is identified anew: a model that is kept can turn out as wrong as
    today's bound says. It is for the candidate's own frequency; neighbours gain too, by an amount that depends on the outcome. And
    the largest error over all frequencies falls only to that of the worst frequency that is not measured. A guaranteed removal of 0
    means that eps is as large as what is not known: a better sensor or more averaging pays, another frequency point does not.

    Parameters
    ----------
    identification : Identification or WorstCaseError
        A WorstCaseError brings its frequencies and its model; without `candidates` nothing is solved anew for frequencies.
    candidates : (F,) array, rad/s, optional
        Frequencies. Default: those of the WorstCaseError; for an Identification, the middles of the widest gaps between
        frequency points (and below and above them), and the frequencies of the parametric poles. Where there is a record with
        zero initial conditions, "more time samples" is a candidate too, unless `candidates` are given: the longest record
        continued to twice its length, its last input held, at the sample where the prediction is worst.
    bound : float or (ny, nu) array, optional
        eps, of every entry. Default: the median bound of its frequency points; without any the median of the time bounds, each
        divided by the largest input of its record; of an entry that was not measured, that of the others. A time sample
        always takes the median bound of its record.
    count : int
        Length of the list at most.
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, the candidates that are finished are ranked, spread over the range, and a warning says so.
    progress : callable (text, done, count), optional
        Frequencies.

    Returns
    -------
    list of NextMeasurement
        By `guaranteed`, largest first; equal ones by `upper`. MIMO: one for every frequency and input, with the output that gains
        most; entries are compared in units of the prior's scaling.

    Raises
    ------
    InconsistentDataError
        The data fit no system of the class.
    InputError, InputTypeError
        Frequencies outside 0 to pi/dt, a bound that is not positive, another object.

    Notes
    -----
    The guarantee assumes the class and the bounds, new one included. Source: local diameter of information, `inanc2001`
    section II-C.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.advice import suggest_next
    >>> frf = rid.FrequencyResponse([0.5, 2.9], [0.3, 0.1], bound=0.02, dt=1.0)
    >>> result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2)))
    >>> best = suggest_next(result, candidates=[0.5, 1.7, 2.9])[0]
    >>> best.at, best.guaranteed > 0.5
    (1.7, True)
    """
    count = as_count("count", count, least=1)
    kinds = (Identification, WorstCaseError)
    as_kind("identification", identification, kinds, "an Identification or a WorstCaseError")
    given = identification.identification if isinstance(identification, WorstCaseError) else identification
    problem, budget = given.problem, Budget(time_limit)
    eps = _usual_bounds(problem) if bound is None else _stated(bound, problem)
    limits: Options = {"time_limit": time_limit, "progress": progress}
    if not isinstance(identification, WorstCaseError):
        omega = _between(problem) if candidates is None else candidates
        error = worst_case_error(given, omega=omega, directions=_DIRECTIONS, rtol=_RTOL, **limits)
    elif candidates is None:
        error = identification
    else:
        directions, model = identification.directions, identification.model
        error = worst_case_error(given, model=model, omega=candidates, directions=directions, **limits)
    if error.missing.size:
        _log.warning("suggest_next: %s", error.unfinished)
    scales = problem.prior.scales(*problem.entries.shape)

    def rank(item: NextMeasurement) -> tuple[float, float]:
        scale = float(scales[item.entry])
        return -item.guaranteed / scale, -item.upper / scale

    columns = [
        [
            _measured(problem, "frequency", at, error.lower[k, i, j], error.upper[k, i, j], eps[i, j], (i, j))
            for i in range(problem.entries.outputs)
        ]
        for k, at in enumerate(error.omega.tolist())
        for j in range(problem.entries.inputs)
    ]
    found = [min(column, key=rank) for column in columns]
    if candidates is None and not budget.over:
        continued = _continued(given, error.model, scales)
        found += [min(continued, key=rank)] if continued else []
    return sorted(found, key=rank)[:count]


def _measured(
    problem: MixedProblem, kind: str, at: float, lower: float, upper: float, eps: float, entry: tuple[int, int]
) -> NextMeasurement:
    name = entry_name(problem, entry)
    return NextMeasurement(kind, at, float(lower), float(upper), float(eps), entry, name)


def _stated(bound: ArrayLike, problem: MixedProblem) -> Real:
    """The bound of every entry, checked, (ny, nu)."""
    shape = problem.entries.shape
    if np.ndim(bound) == 0:
        return np.full(shape, as_positive("bound", bound))
    eps = as_array("bound", bound)
    if eps.shape != shape or np.any(eps <= 0):
        raise InputError(f"`bound` must be positive, one number or one of every entry, {shape}; got {eps.tolist()}")
    return eps


def _usual_bounds(problem: MixedProblem) -> Real:
    """Median bound of the frequency points of every entry, or of the time samples as a gain, (ny, nu)."""
    lines = [bounds_of_entries(frf, frf.bound.outer_radius) for frf in problem.frequency]
    eps = np.full(problem.entries.shape, np.nan)
    for i, j in np.ndindex(*eps.shape):
        seen = [radius[:, i, j] for radius in lines]
        if not lines:
            seen = [_used_bounds(t, i) / drive for t in problem.time if (drive := _drive(t, j)) > 0]
        known = np.concatenate([np.zeros(0), *seen])
        known = known[np.isfinite(known)]
        eps[i, j] = np.median(known) if known.size else np.nan
    scales = problem.prior.scales(*eps.shape)
    return np.where(np.isnan(eps), scales * np.nanmedian(eps / scales), eps)


def _used_bounds(record: TimeRecord, output: int) -> Real:
    bounds = record.bound.radius[:, output]
    return bounds[np.isfinite(bounds)]


def _drive(record: TimeRecord, input: int) -> float:
    return float(np.abs(record.u[:, input]).max())


def _between(problem: MixedProblem) -> Real:
    """Middles of the widest gaps, relative to their frequency, of the frequency points, 0 and pi/dt; and the parametric poles."""
    plane, basis = problem.plane, problem.parametric
    top = plane.top if plane.dt else float(plane.omega(problem.angles[-1:])[0])
    integrator = basis is not None and basis.has_integrator
    lines = plane.omega(problem.angles) if problem.angles.size else np.linspace(0, top, _FREQUENCIES + 1)
    edges = np.unique(np.concatenate([[lines[0] / 2 if integrator else 0.0], lines, [top]]))
    middles, widths = (edges[:-1] + edges[1:]) / 2, np.diff(edges)
    grid = [middles[np.argsort(-widths / middles)[:_FREQUENCIES]]]
    if basis is not None:
        poles = basis.poles[np.imag(basis.poles) > 0]
        turns = np.round(np.asarray(np.angle(poles), dtype=float), 12)
        grid.append(np.asarray(plane.omega(np.unique(turns).astype(float)), dtype=float))
    return np.concatenate(grid)


def _continued(given: Identification, model: StateSpace, scales: Real) -> list[NextMeasurement]:
    """The sample of the continued record at which the prediction is worst, for every output that it measures."""
    records = [t for t in given.problem.time if t.initial == "rest"]
    if not records:
        return []
    record = max(records, key=lambda t: t.u.shape[0])
    held = record.u.shape[0]
    u = np.concatenate([record.u, np.repeat(record.u[-1:], held, axis=0)])
    samples = (
        np.unique(np.round(np.linspace(float(held), float(2 * held - 1), min(held, _SAMPLES)))).astype(int).tolist()
    )
    lower, upper = output_errors(given, u, model, samples, _RTOL / 5)
    found: list[NextMeasurement] = []
    for i, (low, high) in enumerate(zip(lower.T, upper.T, strict=True)):
        bounds = _used_bounds(record, i)
        if not bounds.size:
            continue
        j = int(np.argmax([scale * _drive(record, k) for k, scale in enumerate(scales[i].tolist())]))
        worst, drive = int(np.argmax(high)), _drive(record, j) or 1.0
        ends = low[worst] / drive, high[worst] / drive, float(np.median(bounds)) / drive
        found.append(_measured(given.problem, "time", samples[worst] * record.dt, *ends, (i, j)))
    return found
