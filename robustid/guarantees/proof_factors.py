"""Multipliers of the matrix inequality as pairs of functions in kernels of the nodes, to more digits than doubles have."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np

from robustid.bases import InputNormalPair
from robustid.core import Real, SPlane
from robustid.guarantees.proof_question import lines_of
from robustid.identification import MixedProblem, ball_arithmetic
from robustid.identification.formulation import ExactFormulation, Formulation

_BITS = 640  # of the arithmetic: coefficients along kernels of close nodes are large, and cancel
_LEFT = 52  # bits after the point that are written: kernels are of size (1 - rho^-2)^(-1/2), however large their coefficients
MOST_POWERS = 4096  # Taylor coefficients that a file may use
_NOTHING = 1e-17
_Number = Any  # of the library of balls
InKernels = Callable[[Real], list[list[_Number]]]


def in_kernels(posed: Formulation, further: tuple[float, ...]) -> InKernels:
    """Return what writes functions of the coordinates of a form as terms [k, re, im] of a proof file, its nodes at 0 to 2N + 1.

    `further`: frequencies at which the form has nodes of its own, if no line is there.
    """
    problem = posed.problem
    omega = [float(row[0]) for row in lines_of(problem)]
    count = len(omega)
    if not isinstance(posed, ExactFormulation):
        return _Powers(posed.sarason.pair, 2 * count + 2)
    order = [int(np.argmin(np.abs(problem.plane.angles(np.array(omega)) - angle))) for angle in problem.angles]
    # A node at the frequency of the statement stands at the head of the cascade where no line is there.
    turns = [(one, 2 * count, 2 * count + 1) for one in further[: len(posed.first)]]
    lines = [(omega[k], k, count + k) for k in order]
    delays, half = [None] * posed.determined, posed.determined // 2
    cascade = [*turns, *lines[0::2], *delays[:half], *lines[1::2], *delays[half:]]
    return _Kernels(cascade, _Placing(problem), 2 * count + 2)


class _Powers:
    """Functions by their Taylor coefficients: those of a shift exactly, others until their poles leave nothing."""

    def __init__(self, pair: InputNormalPair, first: int) -> None:
        depth = float(np.abs(np.linalg.eigvals(pair.A)).max(initial=0.0)) if np.any(np.tril(pair.A)) else 0.0
        count = pair.order if depth == 0 else pair.order + int(np.log(_NOTHING) / np.log(depth))
        self._rows, self._first = pair.taylor(min(count, MOST_POWERS + 1)), first

    def __call__(self, vector: Real) -> list[list[_Number]]:
        rounded = np.rint(self._rows @ vector * 2.0**_LEFT).tolist()
        return [[self._first + s, _written(int(one)), "0"] for s, one in enumerate(rounded) if one]


class _Kernels:
    r"""Coefficients of the functions c (I - zeta A)^-1 v of a cascade along the kernels 1/(1 - zeta w*) of its nodes, and powers.

    Every section is the all-pass function of a node and its conjugate, of a real node, or a delay (None).
    """

    def __init__(self, cascade: list[tuple[float, int, int] | None], placing: _Placing, first: int) -> None:
        with ball_arithmetic(_BITS) as flint:
            self._sections = [_Section(flint, None if one is None else placing(flint, one[0])) for one in cascade]
            self._places: list[tuple[int, ...]] = []
            self._rows: list[list[_Number]] = []
            for number, one in enumerate(cascade):
                if one is None:
                    continue
                omega, node, conjugate = one
                # Half the sample rate is real in double precision only: the mean of both nodes is nearer to it than either.
                self._places += [(node, conjugate)] if placing.real(omega) else [(conjugate,), (node,)]
                self._rows += list(self._row(flint, number))
            self._count, self._first = sum(one is None for one in cascade), first
            self._powers = self._polynomials(flint) if self._count else []

    def _row(self, flint: ModuleType, number: int) -> Iterator[list[_Number]]:
        """Return for each node of a section what the functions of the unit vectors up to it have along its kernel."""
        own = self._sections[number]
        for which, pole in enumerate(own.nodes):
            at = 1 / pole
            after = flint.acb(1)
            for later in self._sections[number + 1 :]:
                after *= later.all_pass(at)
            row = [after * one for one in own.along(which)]
            through = after * own.residue(which)
            for earlier in reversed(self._sections[:number]):
                row = [through * one for one in earlier.states(at)] + row
                through *= earlier.all_pass(at)
            yield row

    def _polynomials(self, flint: ModuleType) -> list[list[_Number]]:
        """Coefficients 0 to T - 1 of every unit vector's function, less those of what it has along the kernels."""
        sections = self._sections
        size = sum(len(one.nodes) for one in sections)
        found: list[list[_Number]] = [[flint.acb(0)] * size for _ in range(self._count)]
        start = 0
        for number, own in enumerate(sections):
            for k in range(len(own.nodes)):
                state = [[flint.arb(0)] * len(one.nodes) for one in sections]
                state[number][k] = flint.arb(1)
                for s in range(self._count):
                    push = flint.arb(0)
                    for at in range(number, len(sections)):
                        state[at], push = sections[at].step(state[at], push)
                    found[s][start + k] = flint.acb(push)
            start += len(own.nodes)
        poles = [pole for one in sections for pole in one.nodes if pole != 0]
        for row, pole in zip(self._rows, poles, strict=True):
            power = flint.acb(1)
            for s in range(self._count):
                found[s] = [
                    one - power * value for one, value in zip(found[s], row + [0] * (size - len(row)), strict=True)
                ]
                power *= pole
        return found

    def __call__(self, vector: Real) -> list[list[_Number]]:
        numbers = vector.tolist()
        with ball_arithmetic(_BITS) as flint:
            found: list[list[_Number]] = []
            places = [*self._places, *((self._first + s,) for s in range(self._count))]
            for several, row in zip(places, [*self._rows, *self._powers], strict=True):
                total = flint.acb(0)
                for value, one in zip(row, numbers[: len(row)], strict=True):
                    total += value * one
                total /= len(several)
                found += [[place, _rounded(flint, total.real), _rounded(flint, total.imag)] for place in several]
            return found


def real_node(turn: float) -> bool:
    """Say whether the node of an angle is a real number, to double precision."""
    return turn == 0 or turn >= np.pi * (1 - 1e-15)


class _Placing:
    """Zeta of the frequencies of a problem, as numbers in a file say them."""

    def __init__(self, problem: MixedProblem) -> None:
        self._dt, self._prior, self._plane = problem.dt, problem.prior, problem.plane

    def real(self, omega: float) -> bool:
        """Say whether it is real."""
        return real_node(omega * self._dt) if self._dt else omega == 0

    def __call__(self, flint: ModuleType, omega: float) -> _Number:
        """A ball around it, real or complex."""
        w, real = _stated(flint, omega), self.real(omega)
        if isinstance(self._plane, SPlane):
            s = flint.arb(0) if real else flint.acb(0, w)
            corner, alpha = _stated(flint, self._plane.corner), _stated(flint, float(self._prior.decay or 0))
            return (corner - s) / (corner + 2 * alpha + s)
        radius, turn = 1 / _stated(flint, self._prior.decay_rate), w * _stated(flint, self._dt)
        if real:
            return radius if omega == 0 else -radius
        return radius * flint.acb(turn.cos(), -turn.sin())


class _Section:
    """The all-pass function with the zeros w* and w, one where they are real or 0, as `line_section` has it."""

    def __init__(self, flint: ModuleType, zeta: _Number) -> None:
        if not isinstance(zeta, flint.acb):
            node = flint.arb(0) if zeta is None else zeta
            root = (1 - node * node).sqrt()
            self.nodes = [flint.acb(node)]
            self._a, self._b, self._c, self._d = [[node]], [root], [root], -node
            return
        self.nodes = [zeta, zeta.conjugate()]
        square = zeta.real * zeta.real + zeta.imag * zeta.imag
        k = -2 * zeta.real / (1 + square), square
        s = [((1 - one) * (1 + one)).sqrt() for one in k]
        # The product of both reflections.
        self._a, self._b = [[-k[0], -s[0] * k[1]], [s[0], -k[0] * k[1]]], [s[0] * s[1], k[0] * s[1]]
        self._c, self._d = [flint.arb(0), s[1]], k[1]

    def states(self, zeta: _Number) -> list[_Number]:
        """Return c (I - zeta a)^-1."""
        if len(self._a) == 1:
            return [self._c[0] / (1 - zeta * self._a[0][0])]
        return [one / self._determinant(zeta) for one in self._over(zeta)]

    def _over(self, zeta: _Number) -> list[_Number]:
        (a, b), (c, d) = self._a
        return [
            self._c[0] * (1 - zeta * d) + self._c[1] * zeta * c,
            self._c[0] * zeta * b + self._c[1] * (1 - zeta * a),
        ]

    def _determinant(self, zeta: _Number) -> _Number:
        (a, b), (c, d) = self._a
        return (1 - zeta * a) * (1 - zeta * d) - zeta * zeta * b * c

    def along(self, which: int) -> list[_Number]:
        """Return what c (I - zeta a)^-1 has along the kernel 1/(1 - zeta pole)."""
        if len(self._a) == 1:
            return [self._c[0]]
        pole, other = self.nodes[which], self.nodes[1 - which]
        return [one / (1 - other / pole) for one in self._over(1 / pole)]

    def residue(self, which: int) -> _Number:
        """Return what the all-pass function has along it."""
        at = 1 / self.nodes[which]
        return at * sum(one * b for one, b in zip(self.along(which), self._b, strict=True))

    def step(self, state: list[_Number], push: _Number) -> tuple[list[_Number], _Number]:
        """The next state, and the output now."""

        def inner(row: list[_Number]) -> _Number:
            return sum(a * x for a, x in zip(row, state, strict=True))

        after = [inner(row) + b * push for row, b in zip(self._a, self._b, strict=True)]
        return after, inner(self._c) + self._d * push

    def all_pass(self, zeta: _Number) -> _Number:
        """Return d + c zeta (I - zeta a)^-1 b."""
        return self._d + zeta * sum(one * b for one, b in zip(self.states(zeta), self._b, strict=True))


def _stated(flint: ModuleType, value: float) -> _Number:
    """The number that a file says, its fewest decimal digits: coefficients of close nodes feel what the double is off."""
    return flint.arb(repr(float(value)))


def _rounded(flint: ModuleType, value: _Number) -> str:
    """The middle of a ball, rounded to so many bits after the point."""
    return _written(int((value.mid() * flint.arb(2) ** _LEFT + flint.arb("0.5")).floor().unique_fmpz()))


def _written(scaled: int) -> str:
    return f"{scaled}p-{_LEFT}"
