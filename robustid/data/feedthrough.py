"""Responses that do not vanish at infinite frequency, by what they are of: accelerations under forces, scattering parameters."""

from __future__ import annotations

import enum
import re

from robustid.data.frequency_response import FrequencyResponse

_ACCELERATION = re.compile(r"(k|m|µ|u)?(m|rad)/s(\^2|\*\*2|2|²)|in/s(\^2|2|²)|g|g_n|deg/s(\^2|2|²)")
_FORCE = re.compile(r"(k|m|M|µ|u)?N([ ·*]?m+)?|lbf")
_WAVES = {"out": re.compile(r"b\d+"), "in": re.compile(r"a\d+")}


class FeedThrough(enum.Enum):
    """Reason to expect a gain at infinite frequency; the value is the words."""

    ACCELERATION = "accelerations under forces have one"
    SCATTERING = "scattering parameters have one"


def expected_feedthrough(frf: FrequencyResponse) -> FeedThrough | None:
    """Return why the response of every entry is expected to differ from 0 at infinity; None where nothing says so.

    From the units of the signals (m/s^2 or g per N), or their names as those of waves (b1, b2 / a1, a2, as Touchstone has them).
    """
    outputs, inputs = frf.outputs, frf.inputs
    if all(_ACCELERATION.fullmatch(one.unit) for one in outputs) and all(_FORCE.fullmatch(one.unit) for one in inputs):
        return FeedThrough.ACCELERATION
    waves = all(_WAVES["out"].fullmatch(one.name) for one in outputs) and all(
        _WAVES["in"].fullmatch(one.name) for one in inputs
    )
    units = any(one.unit for one in (*outputs, *inputs))
    return FeedThrough.SCATTERING if waves and not units and frf.dt is None else None
