"""Discrete models in continuous time and back, by the transformation that keeps largest gains."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Frozen, Real, SPlane, StateMatrices, as_array, bilinear_in_s, bilinear_in_z
from robustid.errors import InputError
from robustid.identification import check_model, from_image, in_image

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
        """The discrete controller of a continuous one that was synthesised for this pair; itself where the plant is continuous."""
        return discrete(continuous, self.dt) if self.dt else continuous


def discrete(continuous: control.StateSpace, dt: float) -> control.StateSpace:
    """The discrete model with the same values as a continuous one at s = (2/dt)(z - 1)/(z + 1)."""
    import control

    system = check_model("continuous", continuous)
    if system.nstates and system.dt != 0:
        raise InputError(f"`continuous` must be in continuous time; got dt = {system.dt}")
    found = bilinear_in_z(StateMatrices.of(system), dt)
    return control.StateSpace(*found, dt, remove_useless_states=False)


def bilinear(model: control.StateSpace) -> control.StateSpace:
    """The continuous model with the same values, at s = (2/dt)(z - 1)/(z + 1)."""
    import control

    system = StateMatrices.of(model)
    n = system.A.shape[0]
    if n and np.linalg.cond(system.A + np.eye(n)) > 1e12:
        raise InputError(
            "`nominal` has a pole at z = -1 (half the sampling rate), which has no place in continuous time"
        )
    return control.StateSpace(*bilinear_in_s(system, model.dt), 0.0, remove_useless_states=False)


@dataclasses.dataclass(frozen=True)
class Image(Frozen):
    """A continuous model and cells of frequencies up to infinity in the variable z = (b + s)/(b - s), of sample time 1 s.

    Gains, norms and closed loops are the same on both sides.
    """

    plane: SPlane
    edges: Real  # (C + 1,), angles

    @classmethod
    def of(cls, nominal: control.StateSpace, edges: ArrayLike) -> Image | None:
        """The image where the nominal model is continuous; None where it is not."""
        if getattr(nominal, "dt", None) != 0:
            return None
        edges = as_array("edges", edges, ndim=1, finite=False)
        inside = edges[(edges > 0) & np.isfinite(edges)]
        if np.isnan(edges).any() or not edges.size or edges[-1] != np.inf:
            raise InputError(
                "`edges` of a continuous `nominal` must end at infinity (numpy.inf), so that no frequency is left out; a discrete"
                " one needs its sample time"
            )
        plane = SPlane(float(np.sqrt(inside.min() * inside.max())) if inside.size else 1.0)
        return cls(plane, plane.angles(edges))

    def model(self, name: str, continuous: control.StateSpace) -> control.StateSpace:
        """A continuous model in z."""
        system = check_model(name, continuous)
        if system.nstates and system.dt != 0:
            raise InputError(f"`{name}` must be continuous, as `nominal` is; got dt = {system.dt}")
        return in_image(system, self.plane)

    def continuous(self, model: control.StateSpace) -> control.StateSpace:
        """A model in z as a continuous one."""
        return from_image(model, self.plane)

    def omega(self, angle: float) -> float:
        """The frequency of an angle, rad/s."""
        return float(self.plane.omega(np.array(angle))) if angle < np.pi else np.inf
