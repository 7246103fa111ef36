"""Certificates of directions in ball arithmetic: all rounding of the sums enclosed, with the library FLINT (`robustid[exact]`).

Nodes, weights, values of the functions, samples, bounds and corners are taken as they are in double precision.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Complex
from robustid.guarantees.linear.certificate import Targets, targets_at
from robustid.guarantees.linear.directed import DirectedBand
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.verification import Sums
from robustid.guarantees.linear.verification import holds_exactly as discs_hold_exactly
from robustid.identification import ball_arithmetic

if TYPE_CHECKING:
    from flint import acb, arb


def holds_exactly(band: EntryBand | DirectedBand) -> bool:
    """Say whether what a band says at its knots is proved, all rounding enclosed."""
    return sides_hold_exactly(band) if isinstance(band, DirectedBand) else discs_hold_exactly(band)


def sides_hold_exactly(band: DirectedBand) -> bool:
    """Say whether the discs of the amplitudes are proved, and every side at a knot, all rounding enclosed."""
    samples, extraction = band.samples, band.extraction
    with ball_arithmetic() as flint:
        sums = Sums(flint, samples)
        if samples.amplitudes and not sums.amplitudes_proved(extraction, extraction.known):
            return False
        targets, stated = targets_at(samples, band.angles), band.knot_supports
        for k in range(band.angles.size):
            finite = np.flatnonzero(np.isfinite(stated[k])).tolist()
            proved = _Knot(sums, band, targets[k : k + 1], k)
            if not all(proved.side(one) <= float(stated[k, one]) for one in finite):
                return False
    return True


class _Knot:
    """The sides of one knot as balls."""

    def __init__(self, sums: Sums, band: DirectedBand, target: Targets, k: int) -> None:
        self.sums, self.band, self.target, flint = sums, band, target, sums.flint
        number, samples = sums.number, band.samples
        self.numbers, self.c = band.points[k], band.multipliers[k].astype(complex)
        points = self.numbers[self.numbers >= 0]
        n, self.base, base = points.size, number(complex(target.base[0])), number(complex(target.base[0]))
        a, one = (base * base.conjugate()).real, flint.arb(1)
        root = ((one - a) ** 2 + 4 * base.imag**2).sqrt() / (one + a)
        zero = 2 * base.real / (one + a) / (one + root)
        level = ((one - a) * (one + a) / (one + zero**2)).sqrt()
        self.filter = (1 / level, -2 * base.real / level, a / level), zero

        def outer(x: acb) -> acb:
            return (1 - base * x) * (1 - base.conjugate() * x) / ((1 - zero * x) * level)

        self.z = z = [sums.nodes[p] for p in points.tolist()]
        self.w = w = [[number(v) for v in row] for row in samples.weights[points].tolist()]
        self.h, self.at = [outer(x) for x in z], outer(base) * number(complex(target.weight[0]))

        def gram(twice: bool) -> list[acb]:
            pairs = ((i, j) for i in range(n) for j in range(n))
            other = [x if twice else x.conjugate() for x in z]
            weights = [row if twice else [v.conjugate() for v in row] for row in w]
            return [
                sum((v * u for v, u in zip(w[i], weights[j], strict=True)), flint.acb(0)) / (1 - z[i] * other[j])
                for i, j in pairs
            ]

        self.grams = flint.acb_mat(n, n, gram(False)), flint.acb_mat(n, n, gram(True))
        own = [row[samples.target] for row in w]
        self.onto = [v.conjugate() / (1 - base * x.conjugate()) for v, x in zip(own, z, strict=True)]
        self.other = [v / (1 - base * x) for v, x in zip(own, z, strict=True)]
        self.norm, self.twice = 1 / (1 - a), 1 / (1 - base * base)

    def side(self, k: int) -> arb:
        """The bound in direction k."""
        flint, number, turn = self.sums.flint, self.sums.number, self.sums.number(complex(self.band.turns[k]))
        c = [number(one) for one in self.c[k].tolist()]
        of_points = [one for one, point in zip(c, self.numbers.tolist(), strict=True) if point >= 0]
        of_rows = {point: one.real for one, point in zip(c, self.numbers.tolist(), strict=True) if point < 0}
        return self._class(turn, of_points, of_rows) + self._functions(turn, c) + self._samples(c) + flint.arb(0)

    def _class(self, turn: acb, c: list[acb], of_rows: dict[int, arb]) -> arb:
        flint, n = self.sums.flint, len(c)
        u, tau = [one * h for one, h in zip(c, self.h, strict=True)], turn * self.at
        plain, twice = (flint.acb_mat(1, n, u) * gram for gram in self.grams)
        own = [(plain[0, j] * v.conjugate() + twice[0, j] * v).real for j, v in enumerate(u)]
        crossed = [(tau * (v.conjugate() * a + v * b)).real for v, a, b in zip(u, self.onto, self.other, strict=True)]
        square = sum(own, flint.arb(0)) - 2 * sum(crossed, flint.arb(0))
        square += (tau * tau.conjugate()).real * self.norm + (tau * tau * self.twice).real
        if of_rows:
            square += self._with_rows(tau, u, of_rows)
        top = (square / 2).upper()
        return top.sqrt() if top > 0 else flint.arb(0)

    def _with_rows(self, tau: acb, u: list[acb], of_rows: dict[int, arb]) -> arb:
        """The part of the square that samples of records add: their sum is a polynomial in every component."""
        flint, samples, ((b0, b1, b2), zero) = self.sums.flint, self.band.samples, self.filter
        found = flint.arb(0)
        for component, U in enumerate(samples.blocks):
            total = [sum((c * float(U[row, k]) for row, c in of_rows.items()), flint.arb(0)) for k in range(U.shape[1])]
            total += [flint.arb(0), flint.arb(0)]
            last, seen = flint.arb(0), list["arb"]()
            for k in reversed(range(U.shape[1])):
                last = b0 * total[k] + b1 * total[k + 1] + b2 * total[k + 2] + zero * last
                seen.append(last)
            polynomial = flint.acb_poly([flint.acb(one) for one in reversed(seen)])
            found += 2 * sum((one * one for one in seen), flint.arb(0))
            at_points = (v * w[component] * polynomial(z) for v, w, z in zip(u, self.w, self.z, strict=True))
            found += 4 * sum(at_points, flint.acb(0)).real
            if component == samples.target:
                found -= 4 * (tau * polynomial(self.base)).real
        return found

    def _functions(self, turn: acb, c: list[acb]) -> arb:
        flint, sums, sides, samples = self.sums.flint, self.sums, self.band.sides, self.band.samples
        known = self.band.extraction.known
        missed: list[acb] = []
        for column, wanted in zip(sides.values[self.numbers].T.tolist(), self.target.values[0].tolist(), strict=True):
            each = (one * sums.number(v) for one, v in zip(c, column, strict=True))
            missed.append(turn * sums.number(wanted) - sum(each, flint.acb(0)))
        largest = [abs(sums.number(q)) + r for q, r in zip(known.centre.tolist(), known.radius.tolist(), strict=True)]
        total, (own, twin) = flint.arb(0), sides.twins
        twins: dict[int, int] = dict(zip(own.tolist(), twin.tolist(), strict=True))
        for i, one in enumerate(missed):
            g = int(samples.amplitude_of[i])
            if i in twins.values():
                continue
            both: acb = one + missed[twins[i]].conjugate() if i in twins else one
            if samples.first[i]:
                off = abs(both) if i in twins else abs(both.real)
                total += (both * sums.number(complex(known.centre[g]))).real + off * float(known.radius[g])
            else:
                total += abs(both) * largest[g] * float(samples.powers[i])
        for g, most in enumerate(largest):
            total += most * float(self.target.left_out[0, g])
            column = sides.left_out_each[self.numbers, g]
            total += most * sum((abs(c[j]) * float(column[j]) for j in np.flatnonzero(column).tolist()), flint.arb(0))
        return total

    def _samples(self, c: list[acb]) -> arb:
        flint, number, sides = self.sums.flint, self.sums.number, self.band.sides
        total = flint.arb(0)
        for point, one in zip(self.numbers.tolist(), c, strict=True):
            if point < sides.first_node:
                total += (one * number(complex(sides.y[point]))).real + abs(one) * float(sides.bound[point])
            else:
                corners: Complex = np.unique(sides.corners[point - sides.first_node])
                total += max((one * number(v)).real.upper() for v in corners.tolist())
        return total
