"""Numbers of the judge of proofs: fractions, and complex discs with rational middles."""

from __future__ import annotations

import functools
import math
import re
from fractions import Fraction
from typing import Any

BITS = 512
GRID = 1 << BITS
_NUMBER = re.compile(r"(-?\d+)(?:\.(\d+))?(?:e([+-]?\d{1,3}))?|(-?\d+)p([+-]?\d{1,4})")


class Refused(Exception):
    """The file is no proof: it says why."""


@functools.lru_cache(4096)
def number(text: Any) -> Fraction:
    """The number in a string."""
    found = _NUMBER.fullmatch(text) if isinstance(text, str) else None
    if found is None:
        raise Refused(f"no number: {text!r}")
    whole, part, exponent, mantissa, power = found.groups()
    if mantissa is not None:
        return Fraction(int(mantissa)) * Fraction(2) ** int(power)
    part = part or ""
    return Fraction(int(whole + part)) * Fraction(10) ** (int(exponent or 0) - len(part))


def _up(value: Fraction) -> int:
    return -(-value.numerator * GRID // value.denominator)


def rounded_up(value: Fraction) -> Fraction:
    """The next number of the grid above."""
    return Fraction(_up(value), GRID)


class Disc:
    """All complex numbers within `error` of re + j im: integers, in units of the grid."""

    def __init__(self, re: Fraction | int, im: Fraction | int = 0) -> None:
        (self.a, one), (self.b, two) = (divmod(part.numerator << BITS, part.denominator) for part in (re, im))
        self.e = 2 if one or two else 0

    @classmethod
    def of(cls, a: int, b: int, e: int) -> Disc:
        found = cls.__new__(cls)
        found.a, found.b, found.e = a, b, e
        return found

    def __add__(self, other: Disc) -> Disc:
        return Disc.of(self.a + other.a, self.b + other.b, self.e + other.e)

    def __neg__(self) -> Disc:
        return Disc.of(-self.a, -self.b, self.e)

    def __sub__(self, other: Disc) -> Disc:
        return self + -other

    def __mul__(self, other: Disc) -> Disc:
        # The moduli, and not the sums of both parts: a thousand products with a number inside the circle shrink.
        one, two = (math.isqrt(x.a**2 + x.b**2) + 1 if y.e else 0 for x, y in ((self, other), (other, self)))
        error = one * other.e + two * self.e + self.e * other.e
        a, b = self.a * other.a - self.b * other.b, self.a * other.b + self.b * other.a
        return Disc.of(a >> BITS, b >> BITS, (error >> BITS) + 3)

    @property
    def re(self) -> Fraction:
        return Fraction(self.a, GRID)

    @property
    def im(self) -> Fraction:
        return Fraction(self.b, GRID)

    @property
    def error(self) -> Fraction:
        return Fraction(self.e, GRID)

    @property
    def conj(self) -> Disc:
        return Disc.of(self.a, -self.b, self.e)

    @property
    def size(self) -> Fraction:
        """Above the modulus of the middle, by less than two units."""
        return Fraction(math.isqrt(self.a**2 + self.b**2) + 1, GRID) if self.b else abs(self.re)

    @property
    def most(self) -> Fraction:
        """Above the modulus of all of its numbers."""
        return self.size + self.error

    @property
    def inverse(self) -> Disc:
        square = self.a**2 + self.b**2
        least = math.isqrt(square) - self.e
        if least <= 0:
            raise Refused("a division by what may be 0")
        scale = GRID**2
        return Disc.of(self.a * scale // square, -self.b * scale // square, self.e * scale // (least * least) + 3)


def root(square: Fraction) -> Fraction:
    """Above the root."""
    return Fraction(math.isqrt(math.ceil(square * GRID**2)) + 1, GRID)


@functools.lru_cache(1024)
def turn(x: Fraction) -> Disc:
    """exp(-j x) by the series of x/1024, squared ten times."""
    small, total, term = x / 1024, Disc(0), Disc(1)
    for k in range(1, 140):
        total += term
        term = term * Disc(0, -small / k)
    value = Disc.of(total.a + term.a, total.b + term.b, total.e + _up(2 * term.most))
    for _ in range(10):
        value = value * value
    return value


def solve(rows: list[list[Disc]]) -> list[Disc]:
    """The solution of the system [A b]."""
    size = len(rows)
    for p in range(size):
        best = max(range(p, size), key=lambda a: rows[a][p].size)
        rows[p], rows[best] = rows[best], rows[p]
        inverse = rows[p][p].inverse
        rows[p] = [one * inverse for one in rows[p]]
        for a in range(size):
            if a != p:
                rows[a] = [one - rows[a][p] * pivot for one, pivot in zip(rows[a], rows[p], strict=True)]
    return [row[-1] for row in rows]
