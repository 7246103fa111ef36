"""Limits that the loop of every consistent plant is to keep."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from robustid.core import as_positive
from robustid.errors import InputError

_PEAKS = ("sensitivity_peak", "complementary_peak", "control_peak", "process_peak")


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
        Factor by which the gain may grow; above 1.
    phase_margin : float or None
        In rad, on both sides.
    delay_margin : float or None
        In s: further delay that leaves every loop stable.
    control_peak : float or None
        Largest |C S|: from noise at the output to the input, which actuators limit.
    process_peak : float or None
        Largest |P S|: from a disturbance at the input to the output.
    attenuation : sequence of (low, high, value)
        |S| at most `value` from `low` to `high`, rad/s.
    roll_off : sequence of (low, high, value)
        |T| at most `value` from `low` to `high`, rad/s.
    bandwidth : float or None
        |P C| at least 1 up to this frequency, rad/s.
    integral_gain : float or None
        Least gain of the integrator, in size.
    """

    sensitivity_peak: float | None = 2.0
    complementary_peak: float | None = None
    gain_margin: float | None = None
    phase_margin: float | None = None
    delay_margin: float | None = None
    control_peak: float | None = None
    process_peak: float | None = None
    attenuation: Sequence[tuple[float, float, float]] = ()
    roll_off: Sequence[tuple[float, float, float]] = ()
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
        if self.phase_margin is not None and not 0 < self.phase_margin < math.pi / 2:
            raise InputError(f"`phase_margin` must be between 0 and pi/2 rad; got {self.phase_margin:g}")
        for name in ("attenuation", "roll_off"):
            for row in getattr(self, name):
                if len(row) != 3 or not 0 <= row[0] < row[1] or not row[2] > 0:
                    raise InputError(
                        f"`{name}` must be rows (low, high, value), with low < high in rad/s and a positive value; got {row}"
                    )

    @property
    def frequencies(self) -> list[float]:
        """Frequencies at which a limit begins or ends, rad/s."""
        ends = [end for low, high, _ in (*self.attenuation, *self.roll_off) for end in (low, high)]
        return [one for one in (*ends, self.bandwidth or 0.0) if one > 0]

    def closer(self, spare: float) -> Limits:
        """Limits of which a share is left: what is found at frequencies is then within the limits between them."""

        def less(value: float | None, factor: float) -> float | None:
            return None if value is None else value * factor

        rows = {
            name: tuple((low, high, value * spare) for low, high, value in getattr(self, name))
            for name in ("attenuation", "roll_off")
        }
        return dataclasses.replace(
            self,
            **{name: less(getattr(self, name), spare) for name in _PEAKS},
            gain_margin=less(self.gain_margin, 1 / spare),
            phase_margin=less(self.phase_margin, 1 / spare),
            delay_margin=less(self.delay_margin, 1 / spare),
            **rows,
        )
