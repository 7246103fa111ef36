"""Planes of frequency responses: the z-plane of a sample time, or the s-plane, both seen on the unit circle."""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import numpy as np

from robustid.core.frozen import Frozen
from robustid.core.state_space import Complex, Real, StateMatrices, StateSpace, points_of, response_at, series_at


class Plane(abc.ABC):
    """Frequencies as angles of the points exp(j angle) of the unit circle, and models as functions of a variable z there.

    Attributes
    ----------
    dt : float, s
        Sample time; 0 in continuous time.
    top : float, rad/s
        The largest frequency: pi/dt, or infinity.
    standstill : str
        Where the poles of integrators are: z = 1, or s = 0.
    """

    dt: float
    top: float
    standstill: ClassVar[str]

    @abc.abstractmethod
    def angles(self, omega: Real) -> Real:
        """The angles of frequencies in rad/s."""

    @abc.abstractmethod
    def omega(self, angles: Real) -> Real:
        """The frequencies in rad/s of angles."""

    @abc.abstractmethod
    def middle(self, low: float, high: float) -> float:
        """The frequency between two others that halves the arc between their angles."""

    @abc.abstractmethod
    def values(self, model: StateSpace, angles: Real) -> Complex:
        """The response of a model of this plane at angles, (F, ny, nu)."""

    @abc.abstractmethod
    def in_z(self, system: StateMatrices) -> StateMatrices:
        """A state space of this plane as one in z."""

    @abc.abstractmethod
    def from_z(self, system: StateMatrices) -> StateMatrices:
        """A state space in z as one of this plane."""

    @abc.abstractmethod
    def exponents(self, poles: Complex) -> Complex:
        """The exponents s of poles in z: the responses of modes are exp(s t)."""

    @abc.abstractmethod
    def modes(self, turns: Real, dampings: Real) -> tuple[Real, Real]:
        """Natural frequencies in rad/s and damping ratios of poles exp((-damping + j sqrt(1 - damping^2)) turn) in z."""

    @abc.abstractmethod
    def turned(self, omega: Real, dampings: Real) -> tuple[Real, Real]:
        """The inverse of `modes`."""

    def values_at(self, model: StateSpace, omega: Real) -> Complex:
        """The response of a model at frequencies in rad/s, (F, ny, nu)."""
        return self.values(model, self.angles(np.asarray(omega, dtype=float)))


@dataclasses.dataclass(frozen=True)
class ZPlane(Frozen, Plane):
    """Discrete time: z = exp(j omega dt)."""

    dt: float
    top: float = dataclasses.field(init=False)
    standstill = "z = 1"

    def __post_init__(self) -> None:
        self._set(top=np.pi / self.dt)

    def angles(self, omega: Real) -> Real:
        """``omega dt``."""
        return omega * self.dt

    def omega(self, angles: Real) -> Real:
        """``angle/dt``."""
        return angles / self.dt

    def middle(self, low: float, high: float) -> float:
        """The mean of both."""
        return float((low + high) / 2)

    def values(self, model: StateSpace, angles: Real) -> Complex:
        """The response at z = exp(j angle)."""
        return series_at(StateMatrices.of(model), np.exp(-1j * np.asarray(angles, dtype=float)))

    def in_z(self, system: StateMatrices) -> StateMatrices:
        """The state space itself."""
        return system

    def from_z(self, system: StateMatrices) -> StateMatrices:
        """The state space itself."""
        return system

    def exponents(self, poles: Complex) -> Complex:
        """``log(z)/dt``."""
        return exponents_of(poles, self.dt)

    def modes(self, turns: Real, dampings: Real) -> tuple[Real, Real]:
        """``turn/dt``, and the dampings."""
        return turns / self.dt, dampings

    def turned(self, omega: Real, dampings: Real) -> tuple[Real, Real]:
        """``omega dt``, and the dampings."""
        return omega * self.dt, dampings


@dataclasses.dataclass(frozen=True)
class SPlane(Frozen, Plane):
    r"""Continuous time: the imaginary axis on the circle of a bilinear variable.

    .. math:: z = \frac{b + s}{b - s}, \qquad \theta = 2 \arctan(\omega/b)

    is exact: no sampling is meant. The corner b only places the points on the circle.

    Attributes
    ----------
    corner : float, rad/s
        b: the frequency that lies a quarter of the circle from zero.
    """

    corner: float

    dt = 0.0
    top = np.inf
    standstill = "s = 0"

    def angles(self, omega: Real) -> Real:
        """``2 arctan(omega/b)``."""
        return np.asarray(2 * np.arctan(omega / self.corner), dtype=float)

    def omega(self, angles: Real) -> Real:
        """``b tan(angle/2)``."""
        return np.asarray(self.corner * np.tan(angles / 2), dtype=float)

    def middle(self, low: float, high: float) -> float:
        """The frequency in the middle of the arc."""
        return float(self.corner * np.tan((np.arctan(low / self.corner) + np.arctan(high / self.corner)) / 2))

    def values(self, model: StateSpace, angles: Real) -> Complex:
        """The response at s = j b tan(angle/2)."""
        return self.values_at(model, self.omega(np.asarray(angles, dtype=float)))

    def values_at(self, model: StateSpace, omega: Real) -> Complex:
        """The response at s = j omega."""
        return response_at(StateMatrices.of(model), points_of(np.asarray(omega, dtype=float), None))

    def in_z(self, system: StateMatrices) -> StateMatrices:
        """The state space in z = (b + s)/(b - s)."""
        return bilinear_in_z(system, 2 / self.corner)

    def from_z(self, system: StateMatrices) -> StateMatrices:
        """The state space in s = b (z - 1)/(z + 1)."""
        return bilinear_in_s(system, 2 / self.corner)

    def exponents(self, poles: Complex) -> Complex:
        """``b (z - 1)/(z + 1)``."""
        return np.asarray(self.corner * (poles - 1) / (poles + 1), dtype=complex)

    def modes(self, turns: Real, dampings: Real) -> tuple[Real, Real]:
        """Sizes and angles of the exponents."""
        return _polar(self.exponents(np.exp(_exponents(turns, dampings))))

    def turned(self, omega: Real, dampings: Real) -> tuple[Real, Real]:
        """Sizes and angles of the logarithms of the poles in z."""
        s = _exponents(omega, dampings)
        return _polar(np.log((self.corner + s) / (self.corner - s)))


def exponents_of(poles: Complex, dt: float | None) -> Complex:
    """Poles in s of poles in z: their logarithms over dt; those of continuous time themselves."""
    return np.asarray(np.log(poles) / dt if dt else poles, dtype=complex)


def time_words(dt: float | None) -> str:
    """A sample time in words."""
    return f"dt = {dt:g} s" if dt else "continuous time"


def _exponents(size: Real, dampings: Real) -> Complex:
    return np.asarray((-dampings + 1j * np.sqrt(1 - dampings**2)) * size, dtype=complex)


def _polar(exponents: Complex) -> tuple[Real, Real]:
    size = np.abs(exponents)
    return size, -exponents.real / size


def plane_of(dt: float | None, omega: Real) -> Plane:
    """The plane of data: that of a sample time, or the s-plane with its corner amid the frequencies."""
    if dt:
        return ZPlane(float(dt))
    inside = omega[omega > 0]
    return SPlane(float(np.sqrt(inside.min() * inside.max())) if inside.size else 1.0)


def bilinear_in_z(system: StateMatrices, dt: float) -> StateMatrices:
    """The state space in z with the same values as one in s = (2/dt)(z - 1)/(z + 1)."""
    a, half, root = system.A, dt / 2, np.sqrt(dt)
    inverse = np.linalg.inv(np.eye(a.shape[0]) - half * a)
    return StateMatrices(
        inverse @ (np.eye(a.shape[0]) + half * a),
        root * inverse @ system.B,
        root * system.C @ inverse,
        system.D + half * system.C @ inverse @ system.B,
    )


def bilinear_in_s(system: StateMatrices, dt: float) -> StateMatrices:
    """The state space in s = (2/dt)(z - 1)/(z + 1) with the same values as one in z; no pole at z = -1."""
    n = system.A.shape[0]
    inverse, root = np.linalg.inv(system.A + np.eye(n)), 2 / np.sqrt(dt)
    return StateMatrices(
        2 / dt * inverse @ (system.A - np.eye(n)),
        root * inverse @ system.B,
        root * system.C @ inverse,
        system.D - system.C @ inverse @ system.B,
    )
