"""Structures of controllers: what drives run, with denominators that are given and numerators that are free.

A product of factors is a row of states with fixed poles; with its numerator free it is linear in one number more than it has
states: ``C(z) = sum_k x_k b_k(z)``. A numerator of real numbers splits into those of the factors again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import (
    Complex,
    Real,
    StateMatrices,
    as_flag,
    as_float,
    as_positive,
    bilinear_in_z,
    points_of,
    response_at,
    series,
)
from robustid.errors import InputError, InputTypeError
from robustid.identification import as_system

if TYPE_CHECKING:
    import control

Interval = float | tuple[float, float]
_ROUNDING = 1e-9  # of a pole of an integrator


@dataclasses.dataclass(frozen=True)
class PID:
    r"""Proportional, integral and derivative action, :math:`k_p + k_i/s + k_d s/(1 + s/\omega_f)`, gains free.

    Parameters
    ----------
    filter : float or (float, float), rad/s, optional
        Pole of the derivative, or an interval that it is searched in. Left out, there is no derivative: PI.
    integral : bool
        False: P, or PD.

    Examples
    --------
    >>> from robustid.design import PID
    >>> PID(filter=500.0).count, PID().count, PID(integral=False).count
    (3, 2, 1)
    """

    filter: Interval | None = None
    _: dataclasses.KW_ONLY
    integral: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "integral", as_flag("integral", self.integral))

    @property
    def count(self) -> int:
        """Free numbers."""
        return 1 + self.integral + (self.filter is not None)

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Intervals of what is searched."""
        return () if self.filter is None else (_interval("filter", self.filter),)

    def parts(self, at: Sequence[float]) -> Parts:
        """Poles in s, with what was searched."""
        return Parts(self.integral, [complex(-one) for one in at], [])


@dataclasses.dataclass(frozen=True)
class Notch:
    r"""A notch, skewed or not: two zeros that are free over the poles :math:`s^2 + 2\zeta\omega s + \omega^2`.

    Parameters
    ----------
    omega : float or (float, float), rad/s
        Natural frequency of the poles, or an interval that it is searched in.
    damping : float
        Their damping ratio.
    """

    omega: Interval
    damping: float = 0.7

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Intervals of what is searched."""
        as_positive("damping", self.damping)
        return (_interval("omega", self.omega),)

    def parts(self, at: Sequence[float]) -> Parts:
        """Poles in s, with what was searched."""
        (omega,) = at
        if self.damping >= 1:
            root = math.sqrt(self.damping**2 - 1)
            return Parts(False, [complex(-omega * (self.damping - root)), complex(-omega * (self.damping + root))], [])
        return Parts(False, [omega * complex(-self.damping, math.sqrt(1 - self.damping**2))], [])


@dataclasses.dataclass(frozen=True)
class LeadLag:
    """A pole at -omega with a zero that is free.

    Parameters
    ----------
    omega : float or (float, float), rad/s
        The pole, or an interval that it is searched in.
    """

    omega: Interval

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Intervals of what is searched."""
        return (_interval("omega", self.omega),)

    def parts(self, at: Sequence[float]) -> Parts:
        """Poles in s, with what was searched."""
        return Parts(False, [complex(-at[0])], [])


@dataclasses.dataclass(frozen=True)
class LowPass:
    r"""A fixed low-pass filter of gain 1: :math:`1/(1 + s/\omega)`, or :math:`1/(1 + \sqrt 2 s/\omega + s^2/\omega^2)`.

    Parameters
    ----------
    omega : float or (float, float), rad/s
        Corner, or an interval that it is searched in.
    order : {1, 2}
    """

    omega: Interval
    order: int = 1

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Intervals of what is searched."""
        if self.order not in (1, 2):
            raise InputError(f"`order` of LowPass must be 1 or 2; got {self.order!r}")
        return (_interval("omega", self.omega),)

    def parts(self, at: Sequence[float]) -> Parts:
        """The filter, in s."""
        (w,) = at
        if self.order == 1:
            return Parts(False, [], [StateMatrices(*(np.array([[one]]) for one in (-w, 1.0, w, 0.0)))])
        A = np.array([[0.0, 1.0], [-(w**2), -math.sqrt(2) * w]])
        return Parts(False, [], [StateMatrices(A, np.array([[0.0], [1.0]]), np.array([[w**2, 0.0]]), np.zeros((1, 1)))])


@dataclasses.dataclass(frozen=True, eq=False)
class Fixed:
    """Known part of the loop beside the controller: a filter, a delay of the computer.

    Parameters
    ----------
    model : control.StateSpace or control.TransferFunction
        With the time base of the plant.
    """

    model: Any

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Nothing is searched."""
        return ()

    def parts(self, at: Sequence[float]) -> Parts:
        """The model."""
        del at
        return Parts(False, [], [], [as_system("model", self.model)])


@dataclasses.dataclass(frozen=True)
class FIR:
    """So many past samples of the error, each with a free gain; of sampled controllers.

    Parameters
    ----------
    length : int
    """

    length: int

    @property
    def free(self) -> tuple[tuple[float, float], ...]:
        """Nothing is searched."""
        return ()

    def parts(self, at: Sequence[float]) -> Parts:
        """Poles at z = 0."""
        del at
        return Parts(False, [complex(-math.inf)] * self.length, [])


Factor = PID | Notch | LeadLag | LowPass | Fixed | FIR


class Parts(NamedTuple):
    """Parts that a factor adds: an integrator, poles in s (one of a pair) with free numerators, fixed filters in s and systems."""

    integrator: bool
    poles: list[complex]
    filters: list[StateMatrices]
    systems: list[tuple[StateMatrices, float | None]] = []  # noqa: RUF012


def _interval(name: str, value: Interval) -> tuple[float, float]:
    low, high = value if isinstance(value, tuple) else (value, value)
    low, high = as_positive(name, low), as_positive(name, high)
    if low > high:
        raise InputError(f"`{name}` must be an interval from low to high; got {value}")
    return low, high


@dataclasses.dataclass(frozen=True)
class Basis:
    """Functions that a controller of a structure is a combination of, with real factors."""

    system: StateMatrices  # one input, an output for every function
    integral: Real  # (m,) of each, lim s b(s)
    dt: float

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(self.system.D)

    def response(self, omega: Real) -> Complex:
        """Values at frequencies in rad/s, (F, m)."""
        return response_at(self.system, points_of(omega, self.dt))[:, :, 0]

    def controller(self, factors: Real) -> control.StateSpace:
        """The combination, without states that it does not use."""
        A, B, C, D = self.system
        return StateMatrices(A, B, factors[None] @ C, factors[None] @ D).model(self.dt)


def as_structure(structure: object) -> tuple[Factor, ...]:
    """The factors of a product, checked."""
    found: tuple[Any, ...] = tuple(structure) if isinstance(structure, list | tuple) else (structure,)
    for one in found:
        if not isinstance(one, Factor):
            raise InputTypeError(
                f"`structure` must be factors of robustid.design, such as PID(filter=500.0) or [PID(), Notch(300.0)]; got"
                f" {type(one).__name__}"
            )
    if not found:
        raise InputError("`structure` must hold at least one factor")
    return found


def basis_of(factors: Sequence[Factor], at: Sequence[float], dt: float) -> Basis:
    """Functions of a product of factors, whose searched numbers are `at`, in the order of `free`."""
    integrators, poles, fixed, place = 0, list[complex](), list[StateMatrices](), 0
    for one in factors:
        count = len(one.free)
        found = one.parts(at[place : place + count])
        place += count
        integrators += found.integrator
        poles += found.poles
        fixed += [bilinear_in_z(filter_, dt) if dt else filter_ for filter_ in found.filters]
        for system, base in found.systems:
            if base is not None and not math.isclose(as_float("dt", base), dt, rel_tol=1e-9):
                raise InputError(f"`structure` holds a fixed model with dt = {base:g} s; the plant has dt = {dt:g} s")
            if system.D.shape != (1, 1):
                raise InputError("`structure` holds a fixed model of several inputs or outputs; give one of one each")
            fixed.append(system)
    chain = _chain(poles, integrators, dt)
    for one in fixed:
        chain = series(one, chain)
    return Basis(chain, _residues(chain, dt) if integrators else np.zeros(len(chain.D)), dt)


def _chain(poles: Sequence[complex], integrators: int, dt: float) -> StateMatrices:
    """The constant and the states of a row of sections, each driven by an all-pass of those before: integrators are last."""
    whole = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 0)), np.zeros((0, 1)))
    out = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))  # of the row so far
    for pole in sorted(poles, key=lambda one: one.real):
        section = _section(pole, dt)
        whole, out = _lengthened(whole, out, section)
    for _ in range(integrators):
        step = np.array([[1.0 if dt else 0.0]])
        gain = np.array([[dt or 1.0]])
        whole, out = _lengthened(whole, out, StateMatrices(step, gain, np.eye(1), np.zeros((1, 1))))
    n = len(whole.A)
    return StateMatrices(
        whole.A, whole.B, np.vstack([np.zeros((1, n)), np.eye(n)]), np.vstack([np.ones((1, 1)), np.zeros((n, 1))])
    )


def _section(pole: complex, dt: float) -> StateMatrices:
    """An all-pass with a pole, or with a pair, whose states are of the size of its input."""
    if dt:
        at = np.exp(pole * dt) if np.isfinite(pole.real) else 0.0
        bottom: Real = np.asarray(np.real(np.poly([at, np.conj(at)] if pole.imag else [at])), dtype=float)
        top: Real = bottom[::-1]
    else:
        bottom = np.asarray(np.real(np.poly([pole, np.conj(pole)] if pole.imag else [pole])), dtype=float)
        top = bottom * (-1.0) ** np.arange(len(bottom) - 1, -1, -1)
    A, B, C, D = _canonical(top, bottom)
    if not dt:  # states in the units of the pole
        scale = np.abs(pole) ** np.arange(len(A))
        A, B, C = A * scale / scale[:, None], B / scale[:, None], C * scale
        B, C = B * np.abs(pole), C / np.abs(pole)
    return StateMatrices(A, B, C, D)


def _canonical(top: Real, bottom: Real) -> tuple[Real, Real, Real, Real]:
    import scipy.signal

    A, B, C, D = (np.asarray(one, dtype=float) for one in scipy.signal.tf2ss(top, bottom))
    return A[::-1, ::-1], B[::-1], C[:, ::-1], D


def _lengthened(
    whole: StateMatrices, out: StateMatrices, section: StateMatrices
) -> tuple[StateMatrices, StateMatrices]:
    """The states of a row with those of one more section, and the output of all."""
    E, F, G, H = section
    A = np.block([[whole.A, np.zeros((len(whole.A), len(E)))], [F @ out.C, E]])
    B = np.vstack([whole.B, F @ out.D])
    row = StateMatrices(A, B, np.hstack([H @ out.C, G]), H @ out.D)
    return StateMatrices(A, B, np.zeros((0, len(A))), np.zeros((0, 1))), row


def integral_gain(controller: StateMatrices, dt: float) -> float:
    """Factor of the integrator of a controller of one input and one output; 0 where it has none."""
    A = controller.A
    if not len(A):
        return 0.0
    pole = 1.0 if dt else 0.0
    size = max(1.0, float(np.abs(A).max())) if not dt else 1.0
    if np.min(np.abs(scipy.linalg.eigvals(A) - pole)) > _ROUNDING * size:
        return 0.0
    return float(_residues(controller, dt)[0])


def _residues(system: StateMatrices, dt: float) -> Real:
    """Factors of the integrator, ``lim s b(s)`` or ``lim (z - 1)/dt b(z)``, of every output."""
    A, B, C, _ = system
    pole = 1.0 if dt else 0.0
    values, left, right = scipy.linalg.eig(A, left=True)
    k = int(np.argmin(np.abs(values - pole)))
    size = np.vdot(left[:, k], right[:, k])
    return np.real((C @ right[:, k]) * (left[:, k].conj() @ B)[0] / size) / (dt or 1.0)
