"""Numbers in words: frequencies with the prefix that keeps their digits readable, few digits on the safe side; a text in short."""

from __future__ import annotations

import decimal
import math
import re

_MOST_DIGITS = 12
_SENTENCE_END = re.compile(r"(?<=\.) (?=[A-Z])")
_PREFIXES = ((1e9, "GHz"), (1e6, "MHz"), (1e3, "kHz"))


def hz_scale(hz: float, digits: int = 5) -> tuple[float, str]:
    """Unit in which so many digits of a frequency in Hz need no power of ten, and its size in Hz."""
    if "e+" not in f"{hz:.{digits}g}":
        return 1.0, "Hz"
    return next((one for one in _PREFIXES if hz >= one[0]), (1.0, "Hz"))


def hz_words(hz: float, digits: int = 5) -> str:
    """Words for a frequency in Hz: "97.3 Hz", "2.45 GHz"."""
    scale, unit = hz_scale(hz, digits)
    return f"{hz / scale:.{digits}g} {unit}"


def hz_span(low: float, high: float, digits: int = 5) -> str:
    """Words for a range of frequencies in Hz: "1 to 100 Hz", "50 kHz to 3 GHz"; of a narrow one with more digits."""
    digits = telling_digits(low, high, digits)
    scale, unit = next((one for one in _PREFIXES if (low == 0 or low >= one[0]) and high >= 1e3 * one[0]), (1.0, "Hz"))
    words = f"{low / scale:.{digits}g} to {high / scale:.{digits}g} {unit}"
    return f"{hz_words(low, digits)} to {hz_words(high, digits)}" if "e+" in words else words


def telling_digits(low: float, high: float, digits: int) -> int:
    """As many digits, or more, as show the distance of two numbers to one part in ten."""
    if not 0 < high - low < high:
        return digits
    return min(max(digits, math.ceil(math.log10(high / (high - low))) + 2), max(digits, _MOST_DIGITS))


def rounded_up(value: float, digits: int = 4) -> float:
    """Number of so many significant digits that is not below the value."""
    return _rounded(value, decimal.ROUND_CEILING, digits)


def rounded_down(value: float, digits: int = 4) -> float:
    """Number of so many significant digits that is not above the value."""
    return _rounded(value, decimal.ROUND_FLOOR, digits)


def _rounded(value: float, rounding: str, digits: int) -> float:
    if not math.isfinite(value):
        return value
    return float(decimal.Context(prec=digits, rounding=rounding).create_decimal_from_float(value))


def counted(count: int, noun: str) -> str:
    """Count things in words: "1 sample", "2 entries"."""
    ending = "" if count == 1 else "s"
    return f"{count} {noun[:-1]}ies" if ending and noun.endswith("y") else f"{count} {noun}{ending}"


def in_short(words: str) -> tuple[str, str]:
    """Split a text into its first sentence and the rest of it."""
    first, *rest = _SENTENCE_END.split(words, maxsplit=1)
    return first[0].upper() + first[1:], "".join(rest)
