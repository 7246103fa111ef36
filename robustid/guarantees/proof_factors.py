"""Multipliers of the matrix inequality as pairs of functions in kernels of the nodes, to more digits than doubles have."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from robustid.core import Real
from robustid.identification import ball_arithmetic

_BITS = 640  # of the arithmetic: coefficients along kernels of close nodes are large, and cancel
_LEFT = 110  # bits after the point that are written
_Number = Any  # of the library of balls


class Kernels:
    r"""Coefficients along the kernels 1/(1 - zeta w*) of the functions c (I - zeta A)^-1 v of a cascade with the nodes w.

    Every section of the cascade is the all-pass function of a node and its conjugate, or of a real node; `turns` are angles
    omega T, exact doubles and their products, in the order of the cascade.
    """

    def __init__(self, turns: Sequence[tuple[float, float]], rate: float) -> None:
        with ball_arithmetic(_BITS) as flint:
            radius = 1 / flint.arb(rate)
            self._sections = [_Section(flint, omega, dt, radius) for omega, dt in turns]
            self._rows = [list(self._row(flint, number)) for number in range(len(self._sections))]

    def _row(self, flint: Any, number: int) -> Iterator[list[_Number]]:
        """Of each node of a section, what the functions of the unit vectors before and in it have along its kernel."""
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

    def of(self, vector: Real) -> list[list[str]]:
        """Real and imaginary part of every coefficient of a vector, as dyadic numbers, a row for each node, in their order."""
        numbers = vector.tolist()
        with ball_arithmetic(_BITS) as flint:
            found: list[list[str]] = []
            for row in itertools.chain.from_iterable(self._rows):
                total = flint.acb(0)
                for value, one in zip(row, numbers[: len(row)], strict=True):
                    total += value * one
                found.append([_dyadic(flint, total.real), _dyadic(flint, total.imag)])
            return found


def real_node(turn: float) -> bool:
    """Say whether the node of an angle is a real number, to double precision."""
    return turn == 0 or turn >= np.pi * (1 - 1e-15)


class _Section:
    """The all-pass function with the zeros radius exp(-+j turn), one where they are real, in the coordinates of `line_section`."""

    def __init__(self, flint: Any, omega: float, dt: float, radius: _Number) -> None:
        turn = flint.arb(omega) * flint.arb(dt)
        if real_node(omega * dt):
            node = radius if omega == 0 else -radius
            root = (1 - radius * radius).sqrt()
            self.nodes = [flint.acb(node)]
            self._a, self._b, self._c, self._d = [[node]], [root], [root], -node
            return
        self.nodes = [radius * flint.acb(turn.cos(), sign * turn.sin()) for sign in (-1, 1)]
        k = -2 * radius * turn.cos() / (1 + radius * radius), radius * radius
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

    def all_pass(self, zeta: _Number) -> _Number:
        """Return d + c zeta (I - zeta a)^-1 b."""
        return self._d + zeta * sum(one * b for one, b in zip(self.states(zeta), self._b, strict=True))


def _dyadic(flint: Any, value: _Number) -> str:
    """The middle of a ball, rounded to so many bits after the point."""
    scaled = (value.mid() * flint.arb(2) ** _LEFT + flint.arb("0.5")).floor()
    return f"{int(scaled.unique_fmpz())}p-{_LEFT}"
