"""The judge of proofs on arcs of the frequency axis: bounds around a model, and the worst sensitivity of a controller."""

from __future__ import annotations

import dataclasses
import itertools
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from support.proof_numbers import GRID, Disc, Refused, number, root, rounded_up, solve

if TYPE_CHECKING:
    from support.proof_judge import Judge

Matrix = list[list[Disc]]
_TERMS = (
    4  # of the power series of a function around the middle of an arc, one by one; the others by their geometric sum
)


def _matrix(rows: Any, height: int, width: int) -> Matrix:
    found = [[Disc(number(one)) for one in row] for row in rows]
    if len(found) != height or any(len(row) != width for row in found):
        raise Refused("a matrix of another shape")
    return found


def _times(x: Matrix, y: Matrix) -> Matrix:
    return [[_sum([a * b for a, b in zip(row, column, strict=True)]) for column in zip(*y, strict=True)] for row in x]


def _sum(values: list[Disc]) -> Disc:
    total = Disc(0)
    for one in values:
        total += one
    return total


def _norm(values: list[Disc]) -> Fraction:
    return root(sum((one.most**2 for one in values), Fraction(0)))


def _floor(value: Fraction) -> int:
    return value.numerator // value.denominator


@dataclasses.dataclass
class Known:
    """Functions C (z - A)^-1 B + D of one input."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: list[Disc]

    @classmethod
    def of(cls, said: Any, functions: int | None = None) -> Known:
        """The functions in a file."""
        states, rows = len(said["B"]), len(said["D"]) if functions is None else functions
        if set(said) != set("ABCD"):
            raise Refused("other keys")
        D = _matrix([said["D"]], 1, rows)[0]
        return cls(
            _matrix(said["A"], states, states),
            [[one] for one in _matrix([said["B"]], 1, states)[0]],
            _matrix(said["C"], rows, states),
            D,
        )

    def resolvent(self, z: Disc) -> Matrix:
        size = len(self.A)
        columns: list[list[Disc]] = []
        for k in range(size):
            rows = [
                [(z if a == b else Disc(0)) - self.A[a][b] for b in range(size)] + [Disc(int(a == k))]
                for a in range(size)
            ]
            columns.append(solve(rows))
        return [list(row) for row in zip(*columns, strict=True)]

    def at(self, z: Disc) -> list[Disc]:
        """Values."""
        if not self.A:
            return list(self.D)
        states = _times(self.resolvent(z), self.B)
        return [one[0] + d for one, d in zip(_times(self.C, states), self.D, strict=True)]

    def bends(self, middle: Disc, reach: Fraction) -> list[Fraction]:
        """Above |f'(z)| + |f''(z)| within `reach` of the middle: f = sum c_k (z - middle)^k, c_k = (-1)^k C R^(k+1) B."""
        if not self.A:
            return [Fraction(0)] * len(self.D)
        R = self.resolvent(middle)
        size, states = _norm([one for row in R for one in row]), _times(R, self.B)
        if reach * size >= 1:
            raise Refused("an arc that is long beside the distance of a pole")
        found: list[Fraction] = []
        for row in _times(self.C, R):
            # |c_k| <= |C R| |R|^(k-1) |R B|: the two series are at most these times 1/(1 - r)^2 and 2 |R|/(1 - r)^3.
            scale = rounded_up(_norm(row) * _norm([one[0] for one in states]))
            r, total = rounded_up(reach * size), Fraction(0)
            room = GRID / Fraction(_floor((1 - r) * GRID))
            rest = scale * rounded_up(rounded_up(room**2) + 2 * size * rounded_up(room**3))
            state = states
            for k in range(1, _TERMS):
                state = _times(R, state) if k > 1 else state
                exact = _sum([a * b[0] for a, b in zip(row, state, strict=True)]).most
                term = rounded_up(k * reach ** (k - 1) + (k * (k - 1) * reach ** (k - 2) if k > 1 else 0))
                total += exact * term
                rest -= scale * size ** (k - 1) * term
            found.append(rounded_up(total + max(rest, Fraction(0))))
        return found

    @property
    def stable(self) -> bool:
        """Whether a power of A is a contraction."""
        power = self.A
        for _ in range(40):
            size = _norm([one for row in power for one in row])
            if size < 1 or size > 1 << 200:
                return size < 1
            power = _times(power, power)
        return False


@dataclasses.dataclass
class Knot:
    """z, the functions a, b and perhaps c, the discs of F and of a + b F."""

    z: Disc
    known: list[Disc]
    value: Disc
    reach: Fraction
    real: bool

    @property
    def centre(self) -> Disc:
        found = self.known[0] + self.known[1] * self.value
        return Disc.of(found.a, 0, found.e) if self.real else found

    @property
    def radius(self) -> Fraction:
        return self.known[1].most * self.reach


def on_arcs(judge: Judge, said: Any, evidence: Any, *, loop: bool) -> bool:
    """Bounds of a + b F, or (a + b F)/c, on arcs; or of c/(a + b F), where a + b F has no zero outside of the circle nor on it."""
    if set(said) != {"kind", "functions", "edges", "bounds"} or set(evidence) != {"knots"} or judge.continuous:
        raise Refused("other keys")
    edges, bounds, known = said["edges"], [number(one) for one in said["bounds"]], Known.of(said["functions"])
    if len(known.D) not in ((3,) if loop else (2, 3)):
        raise Refused("other functions")
    if len(edges) < 2 or not len(edges) == len(evidence["knots"]) == len(bounds) + 1:
        raise Refused("not a bound for every arc")
    functions = Known.of(judge.question["class"]["functions"])
    if loop and not ((edges[0], edges[-1]) == ("0", "half") and known.stable and functions.stable):
        return False
    knots: list[Knot] = []
    for edge, sums in zip(edges, evidence["knots"], strict=True):
        z, place = judge.turned(edge).conj, judge.place(edge)
        centre, radius, _ = judge.sums(sums, {2 * judge.N: Disc(1)}, place)
        knots.append(Knot(z, known.at(z), centre, radius, edge in ("0", "half")))
    for one, two, bound in zip(knots[:-1], knots[1:], bounds, strict=True):
        off, away = _bend(judge, known, functions, one, two)
        if not (_apart(one, two, off[-1], away, bound) if loop else _near(one, two, off, away, bound)):
            return False
    return not loop or _winding(list(itertools.pairwise(knots))) == 0


def _bend(judge: Judge, known: Known, functions: Known, one: Knot, two: Knot) -> tuple[list[Fraction], Fraction]:
    """How far known functions, and a + b F, may be from their chords."""
    chord = (two.z - one.z).most
    if chord > 1 + Fraction(1, GRID):
        raise Refused("an arc that is too long")
    eighth = rounded_up(chord**2 / (8 - 2 * chord**2))  # not below the square of the arc over 8
    middle, half = (one.z + two.z) * Disc(Fraction(1, 2)), chord / 2
    off = [rounded_up(eighth * size) for size in known.bends(middle, half)]
    of_class = judge.K * judge.rho / (judge.rho - 1) ** 2
    sizes = functions.bends(middle, half)
    if sizes and not judge.within:
        raise Refused("nothing is said of the parameters")
    if judge.modes and not judge.within:
        raise Refused("nothing is said of the amplitudes")
    for q, u, size in zip(judge.about, judge.within, sizes, strict=False):
        of_class += (q.most + u) * size
    for mode in judge.modes:
        of_class += mode.bends(middle, half)
    f, (b, d) = rounded_up(eighth * of_class), (one.known[1], two.known[1])
    product = (d - b).most * ((two.value - one.value).most + one.reach + two.reach) / 4
    value = max(one.value.most + one.reach, two.value.most + two.reach)
    return off, off[0] + (max(b.most, d.most) + off[1]) * f + off[1] * value + product


def _near(one: Knot, two: Knot, off: list[Fraction], away: Fraction, bound: Fraction) -> bool:
    largest = [knot.centre.most + knot.radius + away for knot in (one, two)]
    if len(off) < 3:
        return all(size <= bound for size in largest)
    # Along the chord of c its part in the direction of the middle is linear, and |c| is at least that.
    p, q = one.known[2], two.known[2]
    u = p + q
    for c, size in zip((p, q), largest, strict=True):
        part = u.conj * c
        least = part.re - part.error - u.most * off[2]
        if least <= 0 or size * u.most > bound * least:
            return False
    return True


def _apart(one: Knot, two: Knot, off: Fraction, away: Fraction, bound: Fraction) -> bool:
    u = one.centre + two.centre
    for knot in (one, two):
        inner = u.conj * knot.centre
        least = inner.re - inner.error - u.most * (knot.radius + away)
        if least <= 0 or bound * least < u.most * (knot.known[2].most + off):
            return False
    return True


def _winding(pairs: list[tuple[Knot, Knot]]) -> int:
    """Half turns of a + b F from z = 1 to z = -1: those of the polygon of the centres."""
    first, last = pairs[0][0].centre, pairs[-1][1].centre
    turns = int((first.a < 0) != (last.a < 0))
    for one, two in pairs:
        p, q = one.centre, two.centre
        cross = p.a * q.b - p.b * q.a
        if (p.b < 0) != (q.b < 0):
            turns += 2 if cross > 0 else -2
    return turns
