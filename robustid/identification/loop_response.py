"""loop_response(): from records of a loop to the response of its stable system R, with its bound."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Complex, Real, StateMatrices, one_thread, response_at
from robustid.data import Fault, FaultKind, FrequencyResponse, TimeRecord
from robustid.estimation import record_faults, response_alone
from robustid.identification.loop import Loop

_OF_A_LOOP = (FaultKind.FEEDBACK, FaultKind.EXCHANGED, FaultKind.LATE)

_log = logging.getLogger("robustid")


@one_thread()
def loop_response(
    record: TimeRecord | Sequence[TimeRecord],
    loop: Loop,
    *,
    period: int | None = None,
    method: str | None = None,
    lines: ArrayLike | None = None,
    probability: float = 0.95,
    about: str = "mean",
) -> FrequencyResponse:
    """Estimate the response of R from records of its loop, with a bound: `estimate_frf` of ``loop.opened(record)``.

    The input x of R does not depend on the noise, so that nothing biases the response, as the loop does that from u to y. Faults
    are looked for in the records as they were measured.

    Parameters
    ----------
    record : TimeRecord or sequence of TimeRecord
        u and y of the plant.
    loop : Loop
        The controller that ran.
    period, method, lines, probability, about : optional
        As in `estimate_frf`.

    Returns
    -------
    FrequencyResponse
        Of R, outputs by inputs of the plant.

    Raises
    ------
    InputError, InputTypeError
        As `estimate_frf` and `Loop.opened`.

    References
    ----------
    `tay1989`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> plant, gain = control.ss(1.1, 1.0, 1.0, 0.0, 0.01), control.ss([], [], [], 0.5, 0.01)
    >>> r, v = np.random.default_rng(0).standard_normal((2, 2000))
    >>> closed, seen = control.feedback(plant, gain), control.feedback(1, plant * gain)
    >>> y = control.forced_response(closed, inputs=r).outputs + control.forced_response(seen, inputs=0.05 * v).outputs
    >>> loop = rid.Loop(gain)
    >>> frf = rid.prepare.loop_response(rid.TimeRecord(r - 0.5 * y, y, dt=0.01), loop)
    >>> R = loop.response_of(loop.residual_of(plant), frf.omega)
    >>> bool((abs(frf.values - R) <= frf.bound.outer_radius).all())
    True
    """
    records = [record] if isinstance(record, TimeRecord) else list(record)
    opened = [loop.opened(one, period=period if method in (None, "periodic") else None) for one in records]
    found = response_alone(opened, period=period, method=method, lines=lines, probability=probability, about=about)
    faults = measured_faults(records, period)
    for fault in faults:
        _log.warning("%s", fault)
    return dataclasses.replace(found, faults=faults)


def measured_faults(records: Sequence[TimeRecord], period: int | None) -> tuple[Fault, ...]:
    """Faults of the records of a loop as they were measured, but for those of its being one: the input answers the output, and
    a plant that is not stable makes an output that no stable model has from its input; what comes late `Loop.faults` tells.
    """
    return tuple(one for one in record_faults(records, period=period) if one.kind not in _OF_A_LOOP)


def loop_noise(loop: Loop, residual: StateMatrices, angles: Real) -> Complex:
    r"""Filter ``D~_x - R N~_c`` from noise v at the output of a plant to the output z of its R, (F, ny, ny)."""
    nu, _ = loop.shape
    points = np.exp(1j * angles)
    back = response_at(loop.back, points)[:, :, nu:]
    return back[:, nu:] - response_at(residual, points) @ back[:, :nu]
