"""Numbers, names and units as they are written in every report.

Guaranteed ends are rounded away from what they bound, so that the printed numbers hold too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robustid.core import Signal, counted, hz_scale, hz_span, rounded_down, rounded_up

HZ = 2 * np.pi  # rad/s
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LONG = 100  # letters of a heading


def number(value: float, digits: int = 4) -> str:
    """Write a number for people: significant digits, powers of ten as such, 5.2×10⁻⁷."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}×10{str(int(exponent)).translate(SUPERSCRIPT)}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def at_most(value: float, digits: int = 4) -> str:
    """Write a number that is not below the value."""
    return number(rounded_up(value, digits), digits)


def at_least(value: float, digits: int = 4) -> str:
    """Write a number that is not above the value."""
    return number(rounded_down(value, digits), digits)


def percent(share: float, digits: int = 2) -> str:
    """Write a share in percent; a dash where there is none."""
    return f"{number(100 * float(share), digits)} %" if np.isfinite(share) else "–"


def plural(count: float) -> str:
    """Ending of a noun that is counted."""
    return "" if count == 1 else "s"


def in_hz(hz: float, digits: int = 5) -> str:
    """Write a frequency in Hz with its unit, "2.45 GHz"."""
    scale, unit = hz_scale(hz, digits)
    return f"{number(hz / scale, digits)} {unit}"


def in_hz_span(low: float, high: float, digits: int = 5) -> str:
    """Write a range of frequencies in Hz with its unit, "2200 to 2700 MHz"."""
    words = hz_span(low, high, digits)
    return words if "e" not in words else f"{number(low, digits)} to {number(high, digits)} Hz"


def at_frequencies(omega: np.ndarray) -> str:
    """Say where a claim holds, "at 4 frequencies from 4 to 30 Hz"; `omega` in rad/s, ascending."""
    hz = omega / HZ
    if hz.size == 1:
        return f"at {in_hz(hz[0], 4)}"
    return f"at {hz.size} frequencies from {in_hz_span(hz[0], hz[-1], 4)}"


def at_hz(hz: np.ndarray, said: str, *values: np.ndarray) -> tuple[str, ...]:
    """Words for the points of a curve: the frequency of each, and its values in the places of `said`."""
    rows = zip(hz, *values, strict=True)
    return tuple(f"{in_hz(at, 6)}: {said.format(*map(number, row))}" for at, *row in rows)


def quotient(above: str, below: str) -> str:
    """Unit of a quotient, "mm/N", of voltage and current "Ω"; empty where neither has one."""
    known = {("V", "A"): "Ω", ("A", "V"): "S"}.get((above, below))
    return known or (f"{above or '1'}/{below}" if below else above)


def unit_label(above: str, below: str) -> str:
    """Unit of a quotient in brackets, after a space; empty where neither has one."""
    return _bracketed(quotient(above, below))


def _bracketed(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def units(outputs: Sequence[Signal], inputs: Sequence[Signal]) -> set[str]:
    """Units of the entries of a response matrix."""
    return {quotient(y.unit, u.unit) for y in outputs for u in inputs}


def matrix_unit_label(outputs: Sequence[Signal], inputs: Sequence[Signal]) -> str:
    """Unit of the singular values of a response matrix, in brackets after a space."""
    found = units(outputs, inputs)
    return _bracketed(found.pop()) if len(found) == 1 else " [mixed units]"


def title(kind: str, outputs: Sequence[Signal], inputs: Sequence[Signal]) -> str:
    """Heading of a page: what it is about, and of which signals, "Fit of x [m] / u [N]"."""
    if len(outputs) == len(inputs) == 1:
        return f"{kind} of {outputs[0]} / {inputs[0]}"
    names = [", ".join(signal.name for signal in group) for group in (inputs, outputs)]
    if sum(map(len, names)) > _LONG:
        names = [counted(len(inputs), "input"), counted(len(outputs), "output")]
    return f"{kind} from {names[0]} to {names[1]}"


def drawn_words(points: int, drawn: int, extremes: str) -> str:
    """Say how many frequency points of an entry are drawn, where these are not all."""
    if drawn >= points:
        return ""
    return (
        f" Of the {points} frequency points of an entry at most {drawn} are drawn: of short intervals the smallest and the"
        f" largest magnitude, and the largest {extremes}."
    )
