"""compare(): two records, two responses, or a model against either."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from robustid.core import counted, hz_span, one_thread
from robustid.data import (
    SAME_FREQUENCY,
    FrequencyResponse,
    TangentialResponse,
    TimeRecord,
    as_frequency_response,
    as_records,
)
from robustid.errors import InputError, InputTypeError
from robustid.estimation import estimate_frf
from robustid.identification.comparison import Comparison
from robustid.identification.validation import Validation, validate

_SAME_DT = 1e-6


@one_thread()
def compare(a: Any, b: Any, *, probability: float = 0.95, period: int | None = None) -> Comparison | Validation:
    """Compare two measurements of one plant, or a model with a measurement.

    Two responses, or records whose responses are estimated first, differ by chance as their noise says: where they differ by more,
    the plant, or the way it was measured, has changed. A model beside a measurement is held against it by `validate`.

    Parameters
    ----------
    a, b : FrequencyResponse, control.FRD, TimeRecord, sequence of TimeRecord, or a model
        Responses are compared at the frequencies that both have, records after `estimate_frf`, the longer one cut to the length of
        the other. One of the two may be a model: a control.StateSpace, or a result that has one.
    probability : float
        Two measurements of one plant are called different with probability 1 - `probability` at most.
    period : int, optional
        Of records with a periodic excitation: the period in samples, see `estimate_frf`.

    Returns
    -------
    Comparison or Validation
        Comparison: ``.differ``, ``.by_chance``, ``.where`` (frequencies), ``.summary()``, ``.plot()``; Validation of a model.

    Raises
    ------
    InputError, InputTypeError
        Two models, no common frequency, other numbers of signals, other units, other sample times, a response of which nothing says
        what its noise is.

    Notes
    -----
    Of every place the probability of a difference as large by chance; the largest one counts with Bonferroni's factor, all of them
    together by their sum (see `Comparison.together`), and the smaller of both twice. Assumed are independent normal errors of a
    known or estimated variance. That nothing stands out is no proof that nothing has changed.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.linspace(1, 9, 60), np.random.default_rng(1)
    >>> def measured(stiffness):
    ...     noise = 0.005 * (rng.standard_normal(60) + 1j * rng.standard_normal(60))
    ...     values = 1 / (stiffness - omega**2 + 0.2j * omega) + noise
    ...     return rid.FrequencyResponse(omega, values, covariance=np.full((60, 1, 1), 5e-5))
    >>> rid.compare(measured(16.0), measured(16.0)).differ
    False
    >>> found = rid.compare(measured(16.0), measured(16.4))
    >>> found.differ, round(found.hz, 2)
    (True, 0.63)
    """
    measured = [_is_measured(name, one) for name, one in (("a", a), ("b", b))]
    if not any(measured):
        raise InputTypeError(
            f"`a` or `b` must be a measurement, a FrequencyResponse or a TimeRecord; got {type(a).__name__} and"
            f" {type(b).__name__}. Of two models rid.guarantee.nu_gap(a, b) is the distance in a loop, and rid.plot.bode draws them"
        )
    if not all(measured):
        if period is not None:
            raise InputError(
                "`period` is for two measurements; of a model leave it out, or compare it with the response"
            )
        model, data = (b, a) if measured[0] else (a, b)
        data = as_frequency_response("data", data) if hasattr(data, "frdata") else data
        return validate(model, data)
    first, second = _responses(a, b, period)
    return Comparison(*_in_common(first, second), probability=probability)


def _is_measured(name: str, one: Any) -> bool:
    if isinstance(one, TangentialResponse):
        raise InputTypeError(
            f"`{name}` must be a FrequencyResponse; a response in directions has no entries to compare"
        )
    if isinstance(one, FrequencyResponse | TimeRecord) or hasattr(one, "frdata"):
        return True
    several = isinstance(one, Sequence) and not isinstance(one, str)
    return several and any(isinstance(part, TimeRecord) for part in cast("Sequence[object]", one))


def _responses(a: Any, b: Any, period: int | None) -> list[FrequencyResponse]:
    """Response of each; records that aren't periodic are cut to one length, so that their spectral lines agree."""
    given = [("a", a), ("b", b)]
    found: list[Any] = [None if _is_response(one) else as_records(name, one) for name, one in given]
    if all(found):
        length = min(len(record.u) for records in found for record in records)
        whole = period is not None or all(record.initial == "periodic" for records in found for record in records)
        found = found if whole else [[record[:length] for record in records] for records in found]
    return [
        as_frequency_response(name, one) if records is None else estimate_frf(records, period=period)
        for (name, one), records in zip(given, found, strict=True)
    ]


def _is_response(one: object) -> bool:
    return isinstance(one, FrequencyResponse) or hasattr(one, "frdata")


def _in_common(first: FrequencyResponse, second: FrequencyResponse) -> list[FrequencyResponse]:
    """Both at the frequencies that both have, once each."""
    if first.values.shape[1:] != second.values.shape[1:]:
        sizes = [
            f"{counted(len(one.outputs), 'output')} and {counted(len(one.inputs), 'input')}" for one in (first, second)
        ]
        raise InputError(f"`a` and `b` must have the same signals; got {sizes[0]}, and {sizes[1]}")
    for one, other in zip((*first.outputs, *first.inputs), (*second.outputs, *second.inputs), strict=True):
        if one.unit and other.unit and one.unit != other.unit:
            raise InputError(f"`a` and `b` must have the same units; got {one} and {other}: convert one of them first")
    if first.dt and second.dt and abs(first.dt - second.dt) > _SAME_DT * first.dt:
        raise InputError(
            f"`a` and `b` must have the same sample time; got {first.dt:g} s and {second.dt:g} s. Between their samples inputs"
            " are held differently: decimate the faster one (rid.prepare.decimate)"
        )
    nearest: NDArray[np.intp] = np.abs(first.omega[:, None] - second.omega).argmin(axis=1)
    close = np.abs(first.omega - second.omega[nearest]) <= SAME_FREQUENCY * np.abs(first.omega)
    theirs: list[int] = np.unique(nearest[close]).tolist()
    if not theirs:
        ranges = [f"{one.freq_hz.size} from {hz_span(one.freq_hz[0], one.freq_hz[-1])}" for one in (first, second)]
        raise InputError(
            f"`a` and `b` have no frequency point in common; got {ranges[0]}, and {ranges[1]}. Estimate both from records of one"
            " length and period, or compare each with a model"
        )
    mine = [int(np.flatnonzero(close & (nearest == at))[0]) for at in theirs]
    return [first.select(mine), second.select(theirs)]
