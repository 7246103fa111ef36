"""Modes of the judge of proofs: c n(x)/(1 - a x) and its conjugate, x the delay, the pole a anywhere in a region."""

from fractions import Fraction
from typing import Any

from support.proof_numbers import Disc, Refused, number, root, rounded_up


class Mode:
    """All a with |t_1(a) ... t_j(a)| <= reach_j, t_j(a) = (a - a_j)/(1 - a_j* a); what a series in the a_j leaves of them."""

    def __init__(self, said: Any) -> None:
        if set(said) != {"numerator", "poles", "reach"} or not len(said["poles"]) == len(said["reach"]) > 0:
            raise Refused("no mode")
        self.numerator = [Disc(number(one)) for one in said["numerator"]]
        poles = [(number(re), number(im)) for re, im in said["poles"]]
        self.poles = [Disc(*one) for one in poles]
        inside = [1 - re**2 - im**2 for re, im in poles]
        reach = [number(one) for one in said["reach"]]
        if min(*inside, *reach, 1 - reach[0]) <= 0:
            raise Refused("a pole that is not inside the circle")
        self.first, self.amplitude = reach[0], Fraction(0)
        scale = inside[0] * (1 - reach[0] ** 2)
        self.sizes = [r * root(one / scale) for r, one in zip(reach[:-1], inside[1:], strict=True)]
        self.rest = reach[-1] / (1 - reach[0])

    def values(self, x: Disc) -> list[Disc]:
        """The functions of the terms, each before its conjugate."""
        n = Disc(0)
        for one in reversed(self.numerator):
            n = n * x + one
        found: list[list[Disc]] = []
        for poles in (self.poles, [one.conj for one in self.poles]):
            own: list[Disc] = []
            for k, a in enumerate(poles):
                value = n * (Disc(1) - a * x).inverse
                for before in poles[:k]:
                    value = value * (x - before.conj) * (Disc(1) - before * x).inverse
                own.append(value)
            found.append(own)
        return [one for both in zip(*found, strict=True) for one in both]

    def bends(self, middle: Disc, reach: Fraction) -> Fraction:
        """Above |d2/dt2| of the mode with all its poles at exp(jt) within a distance of a point.

        With t = (a - a_1)/(1 - a_1* a), C = 1 + a_1* t: 1/(1 - a x) = C/((1 - a_1 x)(1 - t b)) and c' = c C.
        """
        total = Fraction(0)
        for a in (self.poles[0], self.poles[0].conj):
            away = middle - a
            d = away.size - away.error - Fraction(1, 1 << 500) - reach
            if d <= 0:
                raise Refused("an arc that is long beside the distance of a pole")
            pole = (1 + self.first) / (d * (1 - self.first))  # above 1/|1 - a x|
            value = self.amplitude / (d * (1 - self.first))
            for k, n in enumerate(self.numerator):
                # x^k w, w = c/(1 - a x): |w''| <= w (pole + 2 pole^2), |w'| <= w pole.
                total += n.most * value * (k * k + 2 * k * pole + pole + 2 * pole**2)
        return rounded_up(total)
