r"""Sections of a controller in the numbers that people turn: gains, frequencies in Hz, damping ratios.

Sampled, a section has its roots where those in s are, at :math:`e^{sT}`, and its gain at frequency 0; a PID is

.. math:: k_p + k_i \frac{T}{z - 1} + k_d\, \frac{1 - a}{T}\, \frac{z - 1}{z - a}, \qquad a = e^{-\omega_f T} .

Roots are counted from z = 1, or from s = 0, here: :math:`w = e^{sT} - 1` keeps its digits however fast the sampling is.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers.factors import LowPass
from robustid.core import Complex, Real, StateMatrices, bilinear_in_z, series
from robustid.errors import InputError

if TYPE_CHECKING:
    import control

HZ = 2 * math.pi


@dataclasses.dataclass(frozen=True)
class Gains:
    """Parallel gains of a PID, and the pole of its derivative."""

    kp: float
    ki: float | None = None
    kd: float | None = None
    filter_hz: float | None = None

    def system(self, dt: float) -> StateMatrices:
        """States of the integrator and of the derivative."""
        one, unit = (1.0, dt) if dt else (0.0, 1.0)
        rows, D = list[tuple[float, float, float]](), self.kp
        if self.ki is not None:
            rows.append((one, unit, self.ki))
        if self.kd is not None and self.filter_hz is not None:
            pole = float(shifted(np.array([-HZ * self.filter_hz]), dt)[0].real)
            slope = self.kd * -pole / unit
            rows.append((one + pole, pole, slope))
            D += slope
        A, B, C = (np.array([row[k] for row in rows]) for k in range(3))
        return StateMatrices(np.diag(A), B[:, None], C[None], np.array([[D]]))


@dataclasses.dataclass(frozen=True)
class TwoRoots:
    """A notch: two zeros over two poles, of gain 1 at frequency 0. Zeros of negative damping are unstable ones."""

    zero_hz: float
    zero_damping: float
    pole_hz: float
    pole_damping: float

    def system(self, dt: float) -> StateMatrices:
        """Two states."""
        zeros = shifted(pair(HZ * self.zero_hz, self.zero_damping), dt)
        poles = shifted(pair(HZ * self.pole_hz, self.pole_damping), dt)
        gain = float(np.real(np.prod(poles) / np.prod(zeros)))
        one, slope = 1.0 if dt else 0.0, float((poles.sum() - zeros.sum()).real)
        if poles[0].imag:
            a, b = poles[0].real, abs(poles[0].imag)
            A = np.array([[one + a, b], [-b, one + a]])
            B, left = np.array([[0.0], [1.0]]), float((a - zeros).prod().real) - b**2
            C = np.array([[left / b, slope]])
        else:
            first, second = poles.real
            left = float((first - zeros).prod().real)
            A = np.array([[one + first, 0.0], [left, one + second]])
            B, C = np.array([[1.0], [slope]]), np.array([[0.0, 1.0]])
        return StateMatrices(A, B, gain * C, np.array([[gain]]))


@dataclasses.dataclass(frozen=True)
class OneRoot:
    """Lead or lag: a zero over a pole, of gain 1 at frequency 0. A zero of negative frequency is an unstable one."""

    zero_hz: float
    pole_hz: float

    def system(self, dt: float) -> StateMatrices:
        """One state."""
        zero, pole = (float(one.real) for one in shifted(-HZ * np.array([self.zero_hz, self.pole_hz]), dt))
        one, gain = 1.0 if dt else 0.0, pole / zero
        return StateMatrices(*(np.array([[part]]) for part in (one + pole, 1.0, gain * (pole - zero), gain)))


@dataclasses.dataclass(frozen=True)
class Corner:
    """A low-pass filter of gain 1 at frequency 0."""

    corner_hz: float
    order: int

    def system(self, dt: float) -> StateMatrices:
        """As many states as its order."""
        omega = HZ * self.corner_hz
        (found,) = LowPass(omega, self.order).parts((omega,)).filters
        return bilinear_in_z(found, dt) if dt else found


@dataclasses.dataclass(frozen=True, eq=False)
class Kept:
    """A part that stays as it was found: it has no such numbers."""

    name: str
    given: StateMatrices

    def system(self, dt: float) -> StateMatrices:
        """The states that were found."""
        del dt
        return self.given


Section = Gains | TwoRoots | OneRoot | Corner | Kept
_SIGNED = ("kp", "ki", "kd", "gain", "zero_damping")  # numbers that may be negative or 0
_NOT_ZERO = ("zero_hz",)


@dataclasses.dataclass(frozen=True, eq=False)
class Sections:
    """A controller as a gain and a row of sections.

    Attributes
    ----------
    dt : float
        Sample time in s; 0 in continuous time.
    gain : float
        Of all of it.
    parts : tuple of sections
    """

    dt: float
    gain: float
    parts: tuple[Section, ...]

    @property
    def system(self) -> StateMatrices:
        """The row."""
        nothing = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
        A, B, C, D = functools.reduce(series, (one.system(self.dt) for one in self.parts), nothing)
        return StateMatrices(A, B, self.gain * C, self.gain * D)

    def controller(self) -> control.StateSpace:
        """The controller C of u = -C y."""
        return self.system.model(self.dt)

    @property
    def numbers(self) -> dict[str, float]:
        """All numbers that can be turned, by names such as "gain", "0-kp" and "1-zero_hz": of the sections in their order."""
        found = {"gain": self.gain}
        for k, part in enumerate(self.parts):
            for field in dataclasses.fields(part):
                value = getattr(part, field.name)
                if isinstance(value, float):
                    found[f"{k}-{field.name}"] = value
        return found

    def turned(self, numbers: Mapping[str, float]) -> Sections:
        """The same with other numbers, some or all of `numbers`.

        Raises
        ------
        InputError
            A number that makes no section: its `argument` is the name.
        """
        known = self.numbers
        for name, value in numbers.items():
            if name not in known:
                raise InputError(f"`numbers` must be some of {', '.join(known)}; got {name}")
            self._check(name, value)
        parts: list[Section] = []
        for k, part in enumerate(self.parts):
            changes = {name.partition("-")[2]: float(v) for name, v in numbers.items() if name.startswith(f"{k}-")}
            parts.append(dataclasses.replace(part, **changes) if changes else part)
        return Sections(self.dt, float(numbers.get("gain", self.gain)), tuple(parts))

    def _check(self, name: str, value: float) -> None:
        own = name.rpartition("-")[2]
        if not math.isfinite(value):
            raise InputError(f"`{name}` must be a finite number; got {value}")
        if own in _NOT_ZERO and value == 0:
            raise InputError(f"`{name}` must not be 0: the gain at frequency 0 is stated apart")
        one_root = own == "zero_hz" and isinstance(self.parts[int(name.partition("-")[0])], OneRoot)
        if own not in _SIGNED and not one_root and value <= 0:
            raise InputError(f"`{name}` must be above 0; got {value:g}")
        top = 0.5 / self.dt if self.dt else math.inf
        if own.endswith("_hz") and not one_root and value >= top:
            raise InputError(f"`{name}` must be below half the sample rate, {top:g} Hz; got {value:g}")

    def frequencies(self) -> Real:
        """Frequencies in rad/s where a resonance or a notch turns the phase, equal steps of phase across each."""
        found = [np.zeros(0)]
        for part in self.parts:
            if isinstance(part, TwoRoots):
                for hz, damping in ((part.zero_hz, part.zero_damping), (part.pole_hz, part.pole_damping)):
                    found.append(HZ * hz * (1 + min(abs(damping), 0.3) * _ACROSS))
        return np.concatenate(found)


_ACROSS = np.tan(np.linspace(-1.2, 1.2, 9))


def pair(omega: float, damping: float) -> Complex:
    """Roots of s^2 + 2 damping omega s + omega^2."""
    if abs(damping) >= 1:
        far = -omega * (damping + math.copysign(math.sqrt(damping**2 - 1), damping))
        return np.array([omega**2 / far, far], dtype=complex)
    root = omega * complex(-damping, math.sqrt(1 - damping**2))
    return np.array([root, root.conjugate()])


def shifted(roots: Complex | Real, dt: float) -> Complex:
    """Roots in s as distances from frequency 0 in the plane of the controller."""
    given = np.asarray(roots, dtype=complex)
    return np.expm1(given * dt) if dt else given
