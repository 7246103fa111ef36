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
OHM = {"Ohm": 1.0, "Ohms": 1.0, "Ω": 1.0, "mOhm": 1e-3, "mΩ": 1e-3, "uOhm": 1e-6, "µOhm": 1e-6, "µΩ": 1e-6,
       "kOhm": 1e3, "kOhms": 1e3, "kΩ": 1e3, "MOhm": 1e6, "MΩ": 1e6, "V/A": 1.0}  # fmt: skip
SIEMENS = {"S": 1.0, "mS": 1e-3, "µS": 1e-6, "uS": 1e-6, "Ohm-1": 1.0, "Ohm^-1": 1.0, "1/Ohm": 1.0, "1/Ω": 1.0, "Ω-1": 1.0,
           "mho": 1.0, "A/V": 1.0}  # fmt: skip
# Of signals, in lower case: what stands in a line of units.
USUAL = {"", "-", "1", "%", "v", "mv", "kv", "a", "ma", "n", "kn", "mn", "nm", "m", "mm", "um", "µm", "m/s", "m/s^2", "m/s2",
         "m/s²", "mm/s", "g", "rad/s", "rad/s^2", "pa", "kpa", "bar", "db", "k", "°c", "w", "n/v", "m/n", "m/v", "#", "bits",
         "deg c", "degc", "volt", "volts", "amp", "ampere", "newton",
         "v vs. ref.", "g/n", "(m/s²)/n", "(m/s^2)/n", *(unit.lower() for unit in (*OHM, *SIEMENS))}  # fmt: skip
# And of no axis; "m" may be minutes, too.
OF_SIGNALS = USUAL - {"", "-", "1", "%", "#", "m", *(unit.lower() for unit in (*FREQUENCY, *TIME))}
_BRACKETS = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\))", re.DOTALL)
_LONGEST_NAME = 500  # characters; what is longer states no unit
_ADDRESS = re.compile(r"\[[^\[\]]*(?::|\.\.\.)[^\[\]]*\]\s*$")  # of a slice: no unit
# Behind a stroke, as "freq/Hz"; of a time only where the name is one, since "m/s" is a unit itself.
_QUOTIENT = re.compile(r"(.*[^\s/])\s*/\s*([^\s/]+|1/[^\s/]+)")
_BEHIND = {"db", "v", "mv", "a", "ma", "ua", "µa", "f", "µf", "uf"} | {
    unit.lower() for known in (FREQUENCY, PHASE, OHM, SIEMENS) for unit in known if "/" not in unit
}
_TIMES = ("time", "t", "times", "elapsed time", "zeit")
_SUFFIX = re.compile(r"(?:(.*?)_)?(k?hz|mhz|ghz|rad_s|ms|us|ns|s|deg|degrees|rad|db)", re.IGNORECASE)


def in_brackets(name: str) -> tuple[str, str]:
    """``"current [A]"``, ``"current (A)"`` or ``"current/A"`` to its name and unit; the unit is "" where there is none."""
    name = name.strip()
    if len(name) > _LONGEST_NAME or _ADDRESS.search(name):
        return name, ""
    if match := _BRACKETS.fullmatch(name):
        return match[1], (match[2] or match[3] or "").strip()
    if (
        (match := _QUOTIENT.fullmatch(name))
        and match[1].lower() not in USUAL
        and (match[2].lower() in _BEHIND or (match[1].lower() in _TIMES and factor(TIME, match[2]) is not None))
    ):
        return match[1], match[2]
    return name, ""


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
