"""Factors of controllers: what drives run, with denominators that are given and numerators that are free."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import StateMatrices, as_flag, as_positive
from robustid.errors import InputError
from robustid.identification import as_system

if TYPE_CHECKING:
    import control

Interval = float | tuple[float, float]


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

    Several of one pair of poles are Kautz functions with free factors.

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
    """A pole at -omega with a zero that is free; several of one pole are Laguerre functions with free factors.

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
        A = w * np.array([[0.0, 1.0], [-1.0, -math.sqrt(2)]])
        return Parts(False, [], [StateMatrices(A, np.array([[0.0], [w]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))])


@dataclasses.dataclass(frozen=True, eq=False)
class Fixed:
    """Known part of the loop beside the controller: a filter, a delay of the computer.

    Parameters
    ----------
    model : control.StateSpace or control.TransferFunction
        With the time base of the plant.
    """

    model: control.StateSpace | control.TransferFunction

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
