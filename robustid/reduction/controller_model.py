"""controller_model(): the model of a controller that is given by its frequency response, exact but for rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Real, points_of
from robustid.data import FrequencyResponse, as_frequency_response
from robustid.errors import InputError, RobustIdError
from robustid.fitting import fit_mfd

if TYPE_CHECKING:
    import control

    Controller = control.StateSpace | control.TransferFunction | control.FRD | FrequencyResponse

_EXACT = 1e-6  # of its size at a frequency: what a model may miss the response of a controller by; 6 digits in a file
_FLOOR = 1e-3  # of the largest entry at a frequency: smaller ones count as much
_LARGEST = 20  # states, and one for three frequencies


def controller_model(controller: Controller, *, name: str = "controller") -> control.StateSpace:
    """A controller as a model: as it is, or the one of fewest states whose response it is.

    Of a response the class is known: what a computer or a circuit with few states does, without noise. A model that misses one
    millionth of it anywhere is refused, as is one that needs more states than its frequencies tell.

    Parameters
    ----------
    controller : control.StateSpace, control.TransferFunction, control.FRD or FrequencyResponse
        A response with the `dt` of the controller; computed, not measured.
    name : str
        What messages call it.

    Returns
    -------
    control.StateSpace
        What was given, where it is a model.

    Raises
    ------
    InputError
        A response that no model has.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> lead = control.tf([5.61, -5.39], [1, -0.6], 0.001)
    >>> found = rid.prepare.controller_model(control.frd(lead, np.geomspace(1, 3000, 30)))
    >>> found.nstates, float(abs(found(1j) - lead(1j)).round(9))
    (1, 0.0)
    """
    import control

    if not isinstance(controller, control.FRD | FrequencyResponse):
        return controller  # a transfer function as well: who takes it checks it
    frf = as_frequency_response(name, controller)
    size = np.abs(frf.values)
    floor = np.maximum(_FLOOR * size.max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    weight = 1 / np.maximum(size, floor)
    least = np.inf
    most = min(_LARGEST, frf.omega.size // 3)
    for order in range(most + 1):
        model = _static(frf) if order == 0 else _fitted(frf, order, weight)
        if model is None:
            continue
        values = np.array([np.atleast_2d(model(point)) for point in points_of(frf.omega, frf.dt or 0.0).tolist()])
        missed = float(
            np.max(np.linalg.norm(values - frf.values, axis=(1, 2)) / np.linalg.norm(frf.values, axis=(1, 2)))
        )
        if missed <= _EXACT:
            return model
        least = min(least, missed)
    raise InputError(
        f"`{name}` must be the controller as it ran, without noise: no model of up to {most} states has its response, the best"
        f" one misses {least:.2g} of it. Give its coefficients, as a control.TransferFunction or control.StateSpace, or its"
        " response to six digits"
    )


def _static(frf: FrequencyResponse) -> control.StateSpace:
    import control

    return control.ss([], [], [], np.real(frf.values).mean(axis=0), frf.dt or 0)


def _fitted(frf: FrequencyResponse, order: int, weight: Real) -> control.StateSpace | None:
    try:
        return fit_mfd(frf, order=order, stable=False, feedthrough=True, restart=False, weight=weight).model
    except (RobustIdError, np.linalg.LinAlgError):  # too few frequencies for so many states
        return None
