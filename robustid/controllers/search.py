r"""Controllers that keep conditions at frequencies: a second-order cone program for given directions, which the controller turns.

For one direction, ``|a + b C| >= q |C| + w`` follows from

.. math:: \operatorname{Re} \bar\varphi (a + b C) - q |C| \ge w, \qquad |\varphi| = 1,

a cone in the factors of C; with the best direction it is the same. Of matrices directions are unitary, and the Hermitian part of
:math:`U^*(a + b C)` is at least the rest. Directions are those of the last controller, and at the start of one that stabilises,
or of a loop that is wanted. The least slack, in units of each condition, is made as large as possible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.controllers.conditions import Conditions
from robustid.controllers.program import Functions, Program
from robustid.core import Complex, Real

_ROUNDS = 25  # of new directions
_LITTLE = 0.03  # of slack: what a round must gain
_UNIT = 0.05  # least unit of a slack: that of conditions that are about zero
_MOST = 1.0  # slack, beyond which nothing is asked for
_SPARE = 1e-6  # of slack: what rounding of the solver takes
_NEAR = 3e-3  # of slack: how far below a program's the other conditions may be, a tenth of what a round must gain
_EVERY = 5  # conditions, one of which a program begins with

Directions = list[Complex]
Asked = NDArray[np.bool_]  # (N, V): conditions with a corner


class Question(NamedTuple):
    """Conditions on values of C, with an orthonormal basis; linear ones on its factors, ``G x >= h``."""

    basis: Functions
    conditions: Sequence[Conditions]
    linear: tuple[Real, Real] | None = None

    def directions(self, values: Complex) -> Directions:
        """Directions of a controller, by its values."""
        return [one.directions(values) for one in self.conditions]

    def values(self, factors: Real) -> Complex:
        """Values of C, (F, nu, ny)."""
        return np.einsum("fmij,m->fij", self.basis.whole, factors)

    def with_units(self) -> Iterator[tuple[Conditions, Real]]:
        """The conditions, each with the units of its slack."""
        for one in self.conditions:
            yield one, _units(one)

    def judged(self, factors: Real) -> tuple[float, Directions]:
        """The least slack of all conditions, each in its unit, not negative where all are kept; and the directions there."""
        values, least, directions = self.values(factors), math.inf, Directions()
        for one, unit in self.with_units():
            excess, turn = one.judged(values)
            least = min(least, float(np.min(excess / unit, initial=math.inf)))
            directions.append(turn)
        if self.linear is not None:
            G, h = self.linear
            least = min(least, float(np.min((G @ factors - h) / np.maximum(np.abs(h), _UNIT))))
        return min(least, 1.0) if math.isinf(least) else least, directions


def _units(one: Conditions) -> Real:
    return np.maximum(np.abs(one.w), _UNIT)


def found_for(
    question: Question,
    start: Complex,
    accepted: Callable[[Real], bool],
    *,
    centred: bool = False,
    go_on: Callable[[], None] = lambda: None,
) -> Real | None:
    """Factors that keep all conditions and are accepted, from values of C to begin with; None where the rounds end before.

    `centred`: not the first ones, but those of the largest slack that directions turn to. `go_on`: is called in every round.
    """
    before, best, directions = -math.inf, None, question.directions(start)
    asked = _spread(question, start, directions)
    for _ in range(_ROUNDS):
        go_on()
        factors = _solved(question, directions, asked)
        if factors is None:
            break
        slack, turned = question.judged(factors)
        if slack >= -_SPARE and accepted(factors):
            best = factors
            if not centred:
                break
        if slack < before + _LITTLE * abs(before):
            break
        before, directions = slack, turned
    return best


def _spread(question: Question, values: Complex, directions: Directions) -> list[Asked]:
    """Conditions that a program begins with: every so manieth, and the last, at the corner that limits there."""
    found = list[Asked]()
    for one, turn in zip(question.conditions, directions, strict=True):
        left = one.at_corners(values, turn)
        some = np.arange(len(left)) % _EVERY == 0
        some[-1:] = True
        own: Asked = some[:, None] & (np.arange(int(left.shape[1])) == left.argmin(axis=1)[:, None])
        found.append(own)
    return found


def _solved(question: Question, directions: Directions, asked: list[Asked]) -> Real | None:
    """The factors of the largest least slack for given directions, by the conditions and corners that limit it.

    Those `asked`, and with them those that are least where a solution leaves others with less slack than its own.
    """
    while True:
        found = _solved_some(question, directions, asked)
        if found is None:
            return None
        factors, slack = found
        values, more = question.values(factors), False
        least = slack - _NEAR * abs(slack) - _SPARE
        for (one, unit), turn, own in zip(question.with_units(), directions, asked, strict=True):
            every = one.at_corners(values, turn) / unit[:, None]
            left, corner = every.min(axis=1), every.argmin(axis=1)
            low = left < least
            low[1:] &= left[1:] <= left[:-1]
            low[:-1] &= left[:-1] <= left[1:]
            new = np.flatnonzero(low)
            new = new[~own[new, corner[new]]]
            own[new, corner[new]] = True
            more = more or new.size > 0
        if not more:
            return factors


def _solved_some(question: Question, directions: Directions, asked: list[Asked]) -> tuple[Real, float] | None:
    m = question.basis.axes.shape[1]
    program = Program(m)
    program.not_negative(np.zeros((1, m)), np.array([-1.0]), np.array([_MOST]))
    if question.linear is not None:
        G, h = question.linear
        program.not_negative(G, -np.maximum(np.abs(h), _UNIT), -h)
    for one, turn, own in zip(question.conditions, directions, asked, strict=True):
        row, corner = np.nonzero(own)
        if row.size:
            some = one.with_corner(row, corner)
            _ask(program, some, turn[row], question.basis.at(some.place))
    return program.solved()


def _ask(program: Program, one: Conditions, turn: Complex, functions: Functions) -> None:
    """Add conditions with one corner each, for given directions."""
    basis, unit = functions.whole, _units(one)
    if one.inside:  # |a + b C| <= w - unit t - sum |Q C|
        values = np.einsum("npj,nmjq->nmpq", one.b, basis)
        program.norm(values, one.a, -unit, one.w, program.norms(one.place, one.q, one.shift, functions))
        return
    turned = turn.conj().swapaxes(1, 2)
    if one.a.shape[1:] == (1, 1) and basis.shape[2] > 1:  # one output of several inputs
        ahead = np.einsum("np,npj,nmjq->nm", turned[:, 0], one.b, basis).real
        fixed = np.real(turned[:, 0, 0] * one.a[:, 0, 0]) - np.real(turned[:, 0] * one.corners).max(axis=1) - one.w
        program.not_negative(ahead, -unit, fixed, program.norms(one.place, one.q, one.shift, functions))
        return
    if one.a.shape[1:] == (1, 1):
        turned, values = turned[:, 0], basis[:, :, 0, 0]
        if one.outside:  # Re turned q C - w - unit t >= |a + b C|
            ahead = np.real(turned * one.q[:, 0, 0] * values)
            program.hold(ahead, -unit, -one.w, one.b[:, 0] * values, one.a[:, 0, 0])
            return
        fixed = np.real(turned[:, 0] * one.a[:, 0, 0]) - np.real(turned * one.corners).max(axis=1) - one.w
        ahead, small = np.real(turned * one.b[:, 0] * values), one.q[:, 0, 0] * values
        program.hold(ahead, -unit, fixed, small, np.zeros(one.w.shape, complex))
        return
    ahead = np.einsum("nrp,npj,nmjq->nmrq", turned, one.b, basis, optimize=True)
    fixed = turned @ one.a - one.w[:, None, None] * np.eye(one.a.shape[2])
    program.semidefinite(ahead, fixed, -unit, program.norms(one.place, one.q, one.shift, functions))
