"""loop_from_data(): the loop of a controller with an auxiliary plant that is chosen from what was measured in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, decay_of, one_thread, poles_of, stabilised_by
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputTypeError
from robustid.estimation import response_alone
from robustid.identification import Loop, as_system
from robustid.reduction.controller_model import controller_model
from robustid.reduction.plant import fitted_plant

if TYPE_CHECKING:
    import control

    from robustid.reduction.controller_model import Controller

_GOOD = 2.0  # times its bound that R may miss a point by: the rest is for R
_DECAY = 0.2  # of the middle of the frequencies that a record shows: of a plant that is made for an unstable controller


@one_thread()
def loop_from_data(
    data: TimeRecord | Sequence[TimeRecord] | FrequencyResponse, controller: Controller, *, excitation: str = "input"
) -> Loop:
    """The loop of a controller about an auxiliary plant from the data, so that R is what this plant leaves: small and smooth.

    The response of R is estimated with a plant that the controller stabilises for certain (0, or one that is made for it alone).
    That of the machine follows, and the smallest fit of it, stable or not, that the controller stabilises and that leaves little
    more than the noise becomes the auxiliary plant. Every plant that the controller stabilises has an R with it.

    Parameters
    ----------
    data : TimeRecord, sequence of TimeRecord, or FrequencyResponse
        Records of u and y in the loop; or the response of the closed loop from r, at the input, to y, with a bound.
    controller : control.StateSpace, control.TransferFunction, control.FRD or FrequencyResponse
        As it ran; see `Loop`. Of a frequency response, computed and not measured, the model of fewest states is taken whose
        response it is to one millionth.
    excitation : {"input", "reference", "output"}
        As in `Loop`.

    Returns
    -------
    Loop

    Raises
    ------
    InputError, InputTypeError
        As `Loop` and `estimate_frf`; a response of a controller that no model has.

    References
    ----------
    `tay1989`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> plant, gain = control.ss(1.1, 1.0, 1.0, 0.0, 0.01), control.ss([], [], [], 0.5, 0.01)
    >>> r = np.random.default_rng(0).standard_normal(2000)
    >>> y = control.forced_response(control.feedback(plant, gain), inputs=r).outputs
    >>> y = y + 0.01 * np.random.default_rng(1).standard_normal(2000)
    >>> loop = rid.prepare.loop_from_data(rid.TimeRecord(r - 0.5 * y, y, dt=0.01), gain)
    >>> bool(abs(abs(loop.auxiliary.poles()).max() - 1.1) < 0.02)
    True
    """
    first = any_loop(controller_model(controller), data, excitation)
    return with_auxiliary(first, opened_response(first, data))


def any_loop(
    controller: control.StateSpace | control.TransferFunction,
    data: TimeRecord | Sequence[TimeRecord] | FrequencyResponse,
    excitation: str,
) -> Loop:
    """The loop about 0 where the controller is stable, else about a plant that is made for it."""
    system, dt = as_system("controller", controller)
    if dt is None or decay_of(poles_of(system.A), float(dt)) > 0:
        return Loop(controller, excitation=excitation)
    made = stabilised_by(system, float(dt), _DECAY * _middle(data))
    return Loop(controller, made.model(float(dt)), excitation=excitation)


def _middle(data: TimeRecord | Sequence[TimeRecord] | FrequencyResponse) -> float:
    """Geometric mean of the frequencies that data show, rad/s."""
    if isinstance(data, FrequencyResponse):
        return float(np.exp(np.mean(np.log(data.omega[data.omega > 0]))))
    first = data if isinstance(data, TimeRecord) else data[0]
    return float(np.pi / first.dt * np.sqrt(2 / len(first.u)))


def opened_response(loop: Loop, data: TimeRecord | Sequence[TimeRecord] | FrequencyResponse) -> FrequencyResponse:
    """The response of R, with its bound."""
    if isinstance(data, FrequencyResponse):
        return loop.opened_response(data)
    records = [data] if isinstance(data, TimeRecord) else list(data)
    if not records or not all(isinstance(one, TimeRecord) for one in records):  # type: ignore[redundant-expr]
        raise InputTypeError("`data` must be a TimeRecord, a sequence of them, or a FrequencyResponse")
    return response_alone([loop.opened(one) for one in records])


def with_auxiliary(loop: Loop, frf: FrequencyResponse) -> Loop:
    """The loop about the fit of the plant that follows from a response of its R; as it is where none is stabilised."""

    def margin(residual: control.StateSpace) -> float:
        return float(np.max(np.abs(frf.values - loop.response_of(residual, frf.omega)) / frf.bound.outer_radius))

    found = fitted_plant(loop, frf, margin, _GOOD, Budget())
    return loop if found is None else Loop(loop.controller, found.model, excitation=loop.excitation)
