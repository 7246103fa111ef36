"""Goals of a design: each makes a level into limits, so that what is asked for and what is proved are the same."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar, get_args

from robustid.controllers.discs import Discs
from robustid.controllers.limits import Limits
from robustid.core import as_float, as_kind, hz_words
from robustid.errors import InputError

_FAST = 10.0  # gain of an integrator, times that of a loop with the bandwidth of the axis: a zero may stand before it
_REACH = 1e6  # between levels of a goal that are tried and one that is usual


@dataclasses.dataclass(frozen=True)
class Bandwidth:
    """Frequency up to which ``|P C| >= 1`` for every consistent plant, as high as it can be.

    Of matrices it is the smallest singular value, with fewer inputs than outputs that of C P.

    Examples
    --------
    >>> from robustid.design import Bandwidth, Limits
    >>> Bandwidth().asked(Limits(), 30.0).bandwidth
    30.0
    """

    name: ClassVar[str] = "bandwidth"

    def asked(self, limits: Limits, level: float) -> Limits:
        """The limits, and that the goal reaches a level."""
        return dataclasses.replace(limits, bandwidth=max(level, limits.bandwidth or 0.0))

    def ends(self, discs: Discs) -> tuple[float, float]:
        """Levels between which it is searched."""
        return float(discs.omega.min()), float(discs.omega.max())

    def told(self, level: float) -> str:
        """A level in plain text."""
        return hz_words(level / (2 * math.pi))


@dataclasses.dataclass(frozen=True)
class IntegralGain:
    """Gain of the integrator as high as it can be: the error after a step load then integrates to the least.

    Examples
    --------
    >>> from robustid.design import IntegralGain, Limits
    >>> IntegralGain().asked(Limits(), 4.0).integral_gain
    4.0
    """

    name: ClassVar[str] = "integral gain"

    def asked(self, limits: Limits, level: float) -> Limits:
        """The limits, and that the goal reaches a level."""
        return dataclasses.replace(limits, integral_gain=max(level, limits.integral_gain or 0.0))

    def ends(self, discs: Discs) -> tuple[float, float]:
        """Levels between which it is searched."""
        return discs.typical * float(discs.omega.min()) / _REACH, _FAST * discs.typical * float(discs.omega.max())

    def told(self, level: float) -> str:
        """A level in plain text."""
        return f"{level:.5g}"


@dataclasses.dataclass(frozen=True)
class Attenuation:
    """Factor by which every loop attenuates disturbances of a range of frequencies, 1/|S|, as high as it can be.

    Parameters
    ----------
    low, high : float, rad/s

    Examples
    --------
    >>> from robustid.design import Attenuation, Limits
    >>> Attenuation(1.0, 20.0).asked(Limits(), 10.0).attenuation
    ((1.0, 20.0, 0.1),)
    """

    low: float
    high: float
    name: ClassVar[str] = "attenuation"

    def __post_init__(self) -> None:
        if not 0 <= as_float("low", self.low) < as_float("high", self.high):
            raise InputError(
                f"`low` must be below `high` in rad/s, and not negative; got {self.low:g} and {self.high:g}"
            )

    def asked(self, limits: Limits, level: float) -> Limits:
        """The limits, and that the goal reaches a level."""
        return dataclasses.replace(limits, attenuation=(*limits.attenuation, (self.low, self.high, 1 / level)))

    def ends(self, discs: Discs) -> tuple[float, float]:
        """Levels between which it is searched."""
        return 0.5, 0.5 * _REACH

    def told(self, level: float) -> str:
        """A level in plain text."""
        return f"by {level:.5g}"


@dataclasses.dataclass(frozen=True)
class LeastControl:
    """Peak of |C S| as low as it can be: the least action of the actuators; 1/peak is the level.

    It needs a limit that asks for action, such as a bandwidth or an attenuation.

    Examples
    --------
    >>> from robustid.design import LeastControl, Limits
    >>> LeastControl().asked(Limits(bandwidth=30.0), 0.5).control_peak
    2.0
    """

    name: ClassVar[str] = "least control"

    def asked(self, limits: Limits, level: float) -> Limits:
        """The limits, and that the goal reaches a level."""
        return dataclasses.replace(limits, control_peak=min(1 / level, limits.control_peak or math.inf))

    def ends(self, discs: Discs) -> tuple[float, float]:
        """Levels between which it is searched."""
        middle = 1 / discs.typical
        return middle / _REACH, middle * _REACH

    def told(self, level: float) -> str:
        """A level in plain text."""
        return f"peak of C S {1 / level:.5g}"


Goal = Bandwidth | IntegralGain | Attenuation | LeastControl
GOALS = {one.name: one for one in (Bandwidth(), IntegralGain(), LeastControl())}


def as_goal(value: object) -> Goal:
    """A goal, or the one of a name."""
    if isinstance(value, str):
        if value not in GOALS:
            raise InputError(f"`maximise` must be one of {tuple(GOALS)} or Attenuation(low, high); got {value!r}")
        return GOALS[value]
    return as_kind("maximise", value, get_args(Goal), "a name or a goal of robustid.design")
