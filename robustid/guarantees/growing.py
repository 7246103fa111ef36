"""growing_error(): the worst-case error of the nominal model at more and more frequencies."""

from __future__ import annotations

from collections.abc import Iterator

from robustid.core import Budget, Progress, Real
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.parameters import parameter_intervals
from robustid.guarantees.polygons import value_set
from robustid.guarantees.sweep import spread_order
from robustid.guarantees.value_set import ValueSet
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification

_NO_TIME = 1e-9  # seconds: the coefficients of the parametric part stay without intervals


def growing_error(
    identification: Identification, omega: Real, *, directions: int, gap: float, progress: Progress | None = None
) -> Iterator[WorstCaseError]:
    """Worst-case errors of the nominal model of a SISO plant at one frequency, at two, ..., for those who watch.

    Every one is guaranteed, as that of `worst_case_error`, which takes finer ones; the coefficients have no intervals. The
    frequencies come in an order of which every beginning is spread over all of them.

    Parameters
    ----------
    identification : Identification
        Consistent, of one input and one output.
    omega : (F,) array, rad/s
    directions : int
        Sides of the polygons.
    gap : float
        Part of the distance from the centre to which every support value is found.
    progress : callable (done, all), optional
        Sides of polygons; an exception that it raises ends the computation.

    Yields
    ------
    WorstCaseError

    Raises
    ------
    InconsistentDataError
        The data fit no system of the class.
    """
    consistent = consistent_set(identification)
    parameters = parameter_intervals(consistent, None, Budget(_NO_TIME))
    found: dict[float, ValueSet] = {}

    def told() -> None:
        nonlocal sides
        sides += 1
        if progress is not None:
            progress(min(sides, count), count)

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
