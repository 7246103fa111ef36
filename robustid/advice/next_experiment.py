"""suggest_next(): where one more measurement is guaranteed to pay."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import Real, as_count, as_kind, as_positive, one_thread
from robustid.data import TimeRecord
from robustid.guarantees import WorstCaseError, check_siso, response_tube, worst_case_error
from robustid.identification import Identification, MixedProblem

_DIRECTIONS, _RTOL = 12, 0.1
_FREQUENCIES = 24  # of the default candidates, besides those of the parametric poles
_SAMPLES = 4  # of the continued record


@dataclasses.dataclass(frozen=True)
class NextMeasurement:
    """One candidate, and the effect of its measurement on the worst-case error there.

    Errors of a frequency are those of the response; errors of a time sample those of the output, divided by the largest input.

    Attributes
    ----------
    kind : {"frequency", "time"}
    at : float
        rad/s; or s after the start of the continued record.
    lower, upper : float
        Present worst-case error of the model there: attained, and proved.
    bound : float
        Error bound eps of the measurement.
    """

    kind: str
    at: float
    lower: float
    upper: float
    bound: float

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
        return (
            f"{place}: worst-case error now {self.upper:.4g} (attained {self.lower:.4g}); measured to {self.bound:.4g} it loses at"
            f" least {self.guaranteed:.4g}"
        )


@one_thread()
def suggest_next(
    identification: Identification | WorstCaseError, *, candidates: Any = None, bound: Any = None, count: int = 5
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
    bound : float, optional
        eps. Default: the median bound of the frequency points; without any the median of the time bounds, each
        divided by the largest input of its record. A time sample always takes the median bound of its record.
    count : int
        Length of the list at most.

    Returns
    -------
    list of NextMeasurement
        By `guaranteed`, largest first; equal ones by `upper`.

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
    eps = None if bound is None else as_positive("bound", bound)
    kinds = (Identification, WorstCaseError)
    as_kind("identification", identification, kinds, "an Identification or a WorstCaseError")
    given = identification.identification if isinstance(identification, WorstCaseError) else identification
    check_siso(given.problem, "suggest_next")
    if not isinstance(identification, WorstCaseError):
        omega = _between(given.problem) if candidates is None else candidates
        error = worst_case_error(given, omega=omega, directions=_DIRECTIONS, rtol=_RTOL)
    elif candidates is None:
        error = identification
    else:
        directions, model = identification.directions, identification.model
        error = worst_case_error(given, model=model, omega=candidates, directions=directions)
    eps = _usual_bound(given.problem) if eps is None else eps
    ends = zip(error.omega.tolist(), error.lower.ravel().tolist(), error.upper.ravel().tolist(), strict=True)
    found = [NextMeasurement("frequency", at, low, high, eps) for at, low, high in ends]
    if candidates is None:
        found += _continued(given, error.model)
    return sorted(found, key=lambda item: (-item.guaranteed, -item.upper))[:count]


def _usual_bound(problem: MixedProblem) -> float:
    """Median bound of the frequency points, or of the time samples as a gain."""
    lines = [frf.bound.outer_radius[:, 0, 0] for frf in problem.frequency]
    if lines:
        return float(np.median(np.concatenate(lines)))
    return float(np.median(np.concatenate([_used_bounds(t) / _drive(t) for t in problem.time])))


def _used_bounds(record: TimeRecord) -> Real:
    return record.bound.radius[record.bound.used]


def _drive(record: TimeRecord) -> float:
    return float(np.abs(record.u).max()) or 1.0


def _between(problem: MixedProblem) -> Real:
    """Middles of the widest gaps, relative to their frequency, of the frequency points, 0 and pi/dt; and the parametric poles."""
    top, basis = np.pi / problem.dt, problem.parametric
    integrator = basis is not None and basis.has_integrator
    lines = problem.angles / problem.dt if problem.angles.size else np.linspace(0, top, _FREQUENCIES + 1)
    edges = np.unique(np.concatenate([[lines[0] / 2 if integrator else 0.0], lines, [top]]))
    middles, widths = (edges[:-1] + edges[1:]) / 2, np.diff(edges)
    grid = [middles[np.argsort(-widths / middles)[:_FREQUENCIES]]]
    if basis is not None:
        poles = basis.poles[np.imag(basis.poles) > 0]
        turns = np.round(np.asarray(np.angle(poles), dtype=float), 12)
        grid.append(np.asarray(np.unique(turns) / problem.dt, dtype=float))
    return np.concatenate(grid)


def _continued(given: Identification, model: Any) -> list[NextMeasurement]:
    """The sample of the continued record at which the prediction is worst."""
    records = [t for t in given.problem.time if t.initial == "rest"]
    if not records:
        return []
    record = max(records, key=lambda t: t.u.shape[0])
    held = record.u.shape[0]
    u = np.concatenate([record.u[:, 0], np.full(held, record.u[-1, 0])])
    samples = np.round(np.linspace(float(held), float(2 * held - 1), min(held, _SAMPLES)))
    tube = response_tube(given, input=u, model=model, times=np.unique(samples) * record.dt, gap=_RTOL / 5)
    worst, drive = int(np.argmax(tube.error_upper)), _drive(record)
    ends = float(tube.error_lower[worst]) / drive, float(tube.error_upper[worst]) / drive
    return [NextMeasurement("time", float(tube.times[worst]), *ends, float(np.median(_used_bounds(record))) / drive)]
