"""Limits that the loop of every consistent plant is to keep."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from robustid.core import Options, Real, Record, as_float, as_positive
from robustid.errors import InputError
from robustid.guarantees import Balls

_PEAKS = ("sensitivity_peak", "complementary_peak", "control_peak", "process_peak")
_LOWER = ("phase_margin", "delay_margin", "bandwidth", "integral_gain")
_HALF = 0.5  # |T| is at least where |P C| is at least 1
Rows = Sequence[tuple[float, float, float]]


class Template(NamedTuple):
    """A map of the loop that rows (low, high, value) bound over frequency, from above or from below; `name` as users see it."""

    name: str
    map: str
    least: bool = False

    def share(self, values: Balls, value: float) -> Real:
        """Share of a row's value that is taken at most, with the values of the map in balls."""
        if not self.least:
            return values.largest / value
        with np.errstate(divide="ignore"):
            return np.where(values.least > 0, value / np.maximum(values.least, 0.0), np.inf)


TEMPLATES = {
    "attenuation": Template("attenuation", "sensitivity"),
    "tracking": Template("tracking", "complementary_sensitivity", least=True),
    "roll_off": Template("roll-off", "complementary_sensitivity"),
    "disturbance": Template("disturbance", "process_sensitivity"),
    "action": Template("action", "control_sensitivity"),
}  # by the names of the limits


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits that the loop of every consistent plant is to keep.

    Attributes
    ----------
    sensitivity_peak : float or None
        Largest |S|, S = 1/(1 + P C), at any frequency; its reciprocal is the modulus margin.
    complementary_peak : float or None
        Largest |T|, T = 1 - S; above 1.
    gain_margin : float or None
        Factor by which the gain may grow; above 1. Of matrices margins are those of changes in all loops at once.
    phase_margin : float or None
        In rad, on both sides.
    delay_margin : float or None
        In s: further delay that leaves every loop stable.
    control_peak : float or None
        Largest |C S|: from noise at the output to the input, which actuators limit.
    process_peak : float or None
        Largest |P S|: from a disturbance at the input to the output.
    attenuation : sequence of (low, high, value)
        |S| at most `value` from `low` to `high`, rad/s: the error of tracking, and a disturbance at the output.
    tracking : sequence of (low, high, value)
        |T| at least `value`, below 1.
    roll_off : sequence of (low, high, value)
        |T| at most `value`.
    disturbance : sequence of (low, high, value)
        |P S| at most `value`: a disturbance at the input.
    action : sequence of (low, high, value)
        |C S| at most `value`: noise that reaches the input.
    bandwidth : float or None
        |P C| at least 1 up to this frequency, rad/s; of matrices its smallest singular value, with fewer inputs than outputs
        that of C P.
    integral_gain : float or None
        Least gain of the integrator, in size; of matrices the smallest singular value of the gains of all integrators, as
        many as outputs or, where these are fewer, inputs.
    """

    sensitivity_peak: float | None = 2.0
    complementary_peak: float | None = None
    gain_margin: float | None = None
    phase_margin: float | None = None
    delay_margin: float | None = None
    control_peak: float | None = None
    process_peak: float | None = None
    attenuation: Rows = ()
    tracking: Rows = ()
    roll_off: Rows = ()
    disturbance: Rows = ()
    action: Rows = ()
    bandwidth: float | None = None
    integral_gain: float | None = None

    def __post_init__(self) -> None:
        for name in (*_PEAKS, "gain_margin", "delay_margin", "bandwidth", "integral_gain"):
            value = getattr(self, name)
            if value is None:
                continue
            as_positive(name, value)
            if name in ("sensitivity_peak", "complementary_peak", "gain_margin") and value <= 1:
                why = {
                    "sensitivity_peak": "the mean of log |S| over frequency is 0, so that S is above 1 somewhere",
                    "complementary_peak": "with integral action T is 1 at frequency 0",
                    "gain_margin": "it is a factor of the gain",
                }
                raise InputError(f"`{name}` must be above 1; got {value:g}: {why[name]}")
        if self.phase_margin is not None and not 0 < as_float("phase_margin", self.phase_margin) < math.pi / 2:
            raise InputError(f"`phase_margin` must be between 0 and pi/2 rad; got {self.phase_margin:g}")
        for name, template in TEMPLATES.items():
            most, kind = (1.0, "value between 0 and 1") if template.least else (math.inf, "positive value")
            for row in getattr(self, name):
                if len(row) != 3 or not 0 <= row[0] < row[1] or not 0 < row[2] < most:
                    raise InputError(
                        f"`{name}` must be rows (low, high, value), with low < high in rad/s and a {kind}; got {tuple(row)}"
                    )

    @property
    def rows(self) -> Iterator[tuple[Template, float, float, float]]:
        """Every row of every template."""
        return ((template, *row) for name, template in TEMPLATES.items() for row in getattr(self, name))

    @property
    def frequencies(self) -> list[float]:
        """Frequencies at which a limit begins or ends, rad/s."""
        ends = [end for _, low, high, _ in self.rows for end in (low, high)]
        return [one for one in (*ends, self.bandwidth or 0.0) if one > 0]

    def closer(self, spare: float) -> Limits:
        """Limits of which a share is left: what is found at frequencies is then within the limits between them."""
        own: Options = self._scaled(spare) | {"bandwidth": self.bandwidth, "integral_gain": self.integral_gain}
        if self.gain_margin is not None:
            own["gain_margin"] = self.gain_margin / spare
        if self.phase_margin is not None:
            own["phase_margin"] = min(self.phase_margin / spare, (self.phase_margin + math.pi / 2) / 2)
        for name in ("sensitivity_peak", "complementary_peak"):
            value = getattr(self, name)
            if value is not None:
                own[name] = max(value * spare, math.sqrt(value))  # above 1
        own["tracking"] = tuple((*ends, min(value / spare, math.sqrt(value))) for *ends, value in self.tracking)
        return dataclasses.replace(self, **own)

    def relaxed(self, factor: float, name: str | None = None) -> Limits:
        """Limits of which every share, or that of one of them, is smaller by a factor above 1."""
        found = self._scaled(factor)
        return dataclasses.replace(self, **(found if name is None else {name: found[name]}))

    @property
    def stated(self) -> list[str]:
        """Names of the limits that are stated."""
        values = {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}
        return [name for name, value in values.items() if value not in (None, (), [])]

    def _scaled(self, factor: float) -> Record:
        """Upper limits times a factor, lower ones divided by it: of a gain margin what is above 1."""
        found: Record = {name: getattr(self, name) for name in (*_PEAKS, *_LOWER, "gain_margin")}
        for name, value in found.items():
            if value is not None:
                found[name] = value * factor if name in _PEAKS else value / factor
        if self.gain_margin is not None:
            found["gain_margin"] = 1 + (self.gain_margin - 1) / factor
        for name, template in TEMPLATES.items():
            by = 1 / factor if template.least else factor
            found[name] = tuple((low, high, value * by) for low, high, value in getattr(self, name))
        return found

    def check(self) -> None:
        """Raise InputError where two of the limits contradict each other at a frequency, whatever the loop."""
        for low, high, value in self.roll_off:
            for start, end, least in self.tracking:
                if max(low, start) < min(high, end) and value < least:
                    raise InputError(
                        f"`tracking` must be below `roll_off` where they meet: both are about |T|; got at least {least:g} and"
                        f" at most {value:g} at {max(low, start):.5g} rad/s"
                    )
            for start, end, most in self.attenuation:
                at = max(low, start)
                if at < min(high, end) and value + most < 1:
                    raise InputError(
                        f"`attenuation` and `roll_off` must have a sum of at least 1 where they meet, since S + T = 1; got"
                        f" {most:g} + {value:g} = {most + value:g} at {at:.5g} rad/s"
                    )
            if self.bandwidth is not None and value < _HALF and low < self.bandwidth:
                raise InputError(
                    f"`bandwidth` must be below the roll-off: |P C| at least 1 up to {self.bandwidth:.5g} rad/s leaves |T|"
                    f" at least 0.5 there; got a `roll_off` of {value:g} from {low:.5g} rad/s"
                )
