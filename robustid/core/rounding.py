"""Numbers of few digits on the safe side of a value."""

from __future__ import annotations

import decimal
import math


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
