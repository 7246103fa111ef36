"""Discrete models in continuous time and back, by the transformation that keeps largest gains."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Frozen, StateMatrices, bilinear_in_s, bilinear_in_z
from robustid.errors import InputError
from robustid.identification import check_model

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False)
class ControlPair(Frozen):
    r"""A nominal model and its weight for continuous-time synthesis, and the way back.

    .. math:: s = \frac{2}{T}\,\frac{z - 1}{z + 1}

    maps the unit circle onto the imaginary axis: the value at ω is found at :math:`(2/T)\tan(\omega T/2)`.

    Attributes
    ----------
    nominal, weight : control.StateSpace
        Continuous; as many states as in discrete time.
    dt : float
        Sample time in s of the discrete models.

    Examples
    --------
    >>> import control, numpy as np
    >>> from robustid.guarantees import uncertainty_weight
    >>> weight = uncertainty_weight(control.ss(0.5, 1.0, 1.0, 0.0, 0.1), [0.0, np.pi / 0.1], [0.1])
    >>> pair = weight.to_control()
    >>> bool(np.isclose(abs(pair.nominal(20j * np.tan(0.05))), abs(weight.nominal(np.exp(0.1j)))))
    True
    """

    nominal: control.StateSpace
    weight: control.StateSpace
    dt: float

    def controller(self, continuous: control.StateSpace) -> control.StateSpace:
        """The discrete controller of a continuous one that was synthesised for this pair."""
        return discrete(continuous, self.dt)


def discrete(continuous: Any, dt: float) -> Any:
    """The discrete model with the same values as a continuous one at s = (2/dt)(z - 1)/(z + 1)."""
    import control

    system = check_model("continuous", continuous)
    if system.nstates and system.dt != 0:
        raise InputError(f"`continuous` must be in continuous time; got dt = {system.dt}")
    found = bilinear_in_z(StateMatrices.of(system), dt)
    return control.StateSpace(*found, dt, remove_useless_states=False)


def bilinear(model: Any) -> Any:
    """The continuous model with the same values, at s = (2/dt)(z - 1)/(z + 1)."""
    import control

    system = StateMatrices.of(model)
    n = system.A.shape[0]
    if n and np.linalg.cond(system.A + np.eye(n)) > 1e12:
        raise InputError(
            "`nominal` has a pole at z = -1 (half the sampling rate), which has no place in continuous time"
        )
    return control.StateSpace(*bilinear_in_s(system, model.dt), 0.0, remove_useless_states=False)
