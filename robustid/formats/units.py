"""Units of axes, as far as the names of columns say them."""

from __future__ import annotations

import math
import re

FREQUENCY = {
    "Hz": 2 * math.pi, "kHz": 2e3 * math.pi, "MHz": 2e6 * math.pi, "GHz": 2e9 * math.pi, "mHz": 2e-3 * math.pi,
    "rad/s": 1.0, "rad/sec": 1.0, "rad_s": 1.0, "krad/s": 1e3,
}  # fmt: skip
TIME = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "usec": 1e-6,
        "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "minutes": 60.0}  # fmt: skip
PHASE = {"deg": math.pi / 180, "degree": math.pi / 180, "degrees": math.pi / 180, "°": math.pi / 180,
         "rad": 1.0, "radian": 1.0, "radians": 1.0}  # fmt: skip
_BRACKETS = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", re.DOTALL)
_LONGEST_NAME = 500  # characters; what is longer states no unit
_ADDRESS = re.compile(r"\[[^\[\]]*(?::|\.\.\.)[^\[\]]*\]\s*$")  # of a slice: no unit
_SUFFIX = re.compile(r"(?:(.*?)_)?(k?hz|mhz|ghz|rad_s|ms|us|ns|s|deg|degrees|rad|db)", re.IGNORECASE)


def in_brackets(name: str) -> tuple[str, str]:
    """``"current [A]"`` or ``"current (A)"`` to its name and unit; the unit is "" where there is none."""
    if len(name) > _LONGEST_NAME:
        return name.strip(), ""
    match = None if _ADDRESS.search(name) else _BRACKETS.fullmatch(name.strip())
    return (match[1], (match[2] or match[3] or "").strip()) if match else (name.strip(), "")


def axis_label(name: str) -> tuple[str, str]:
    """Base and unit for the name of an axis, whose unit may also be its last word: ``"time_ms"``, ``"freq_hz"``."""
    base, unit = in_brackets(name)
    if not unit and len(base) <= _LONGEST_NAME and (match := _SUFFIX.fullmatch(base)):
        return match[1] or "", match[2]
    return base, unit


def factor(units: dict[str, float], unit: str) -> float | None:
    """SI value of a unit; None where it isn't known, or the case of its letters decides (mHz, MHz) and isn't one of them."""
    found = {value for known, value in units.items() if known.lower() == unit.lower()}
    return units.get(unit, found.pop() if len(found) == 1 else None)
