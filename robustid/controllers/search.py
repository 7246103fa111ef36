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
from robustid.controllers.program import Functions, Indices, Program
from robustid.core import Complex, Real

_ROUNDS = 25  # of new directions
_LITTLE = 0.03  # of slack: what a round must gain
_UNIT = 0.05  # least unit of a slack: that of conditions that are about zero
_MOST = 1.0  # slack, beyond which nothing is asked for
_SPARE = 1e-6  # of slack: what rounding of the solver takes
_NEAR = 3e-3  # of slack: how far below a program's the other conditions may be, a tenth of what a round must gain
_EVERY = 5  # conditions, one of which a program begins with

Directions = list[Complex]


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

    def slack(self, factors: Real) -> float:
        """The least slack of all conditions, each in its unit: not negative where all are kept, whatever the directions."""
        values = self.values(factors)
        least = min(
            (float(np.min(one.excess(values) / _units(one))) for one in self.conditions if one.place.size), default=1
        )
        if self.linear is not None:
            G, h = self.linear
            least = min(least, float(np.min((G @ factors - h) / np.maximum(np.abs(h), _UNIT))))
        return least


def _units(one: Conditions) -> Real:
    return np.maximum(np.abs(one.w), _UNIT)


def found_for(
    question: Question,
    start: Directions,
    accepted: Callable[[Real], bool],
    *,
    centred: bool = False,
    go_on: Callable[[], None] = lambda: None,
) -> Real | None:
    """Factors that keep all conditions and are accepted, from directions to begin with; None where the rounds end before.

    `centred`: not the first ones, but those of the largest slack that directions turn to. `go_on`: is called in every round.
    """
    directions, before, best, asked = start, -math.inf, None, _spread(question)
    for _ in range(_ROUNDS):
        go_on()
        factors = _solved(question, directions, asked)
        if factors is None:
            break
        slack = question.slack(factors)
        if slack >= -_SPARE and accepted(factors):
            best = factors
            if not centred:
                break
        if slack < before + _LITTLE * abs(before):
            break
        before, directions = slack, question.directions(question.values(factors))
    return best


def _spread(question: Question) -> list[NDArray[np.bool_]]:
    """Conditions that a program begins with: every so manieth, and the last."""
    found = [np.arange(one.place.size) % _EVERY == 0 for one in question.conditions]
    for one in found:
        one[-1:] = True
    return found


def _solved(question: Question, directions: Directions, asked: list[NDArray[np.bool_]]) -> Real | None:
    """The factors of the largest least slack for given directions, by the conditions that limit it.

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
            left = one.ahead(values, turn) / unit
            around = np.pad(left, 1, constant_values=np.inf)
            new = (left < least) & (left <= around[:-2]) & (left <= around[2:]) & ~own
            own |= new
            more = more or bool(new.any())
        if not more:
            return factors


def _solved_some(
    question: Question, directions: Directions, asked: list[NDArray[np.bool_]]
) -> tuple[Real, float] | None:
    m = question.basis.axes.shape[1]
    program = Program(m)
    program.not_negative(np.zeros((1, m)), np.array([-1.0]), np.array([_MOST]))
    if question.linear is not None:
        G, h = question.linear
        program.not_negative(G, -np.maximum(np.abs(h), _UNIT), -h)
    for one, turn, own in zip(question.conditions, directions, asked, strict=True):
        if own.any():
            some = one.of(own)
            _ask(program, some, turn[own], question.basis.at(some.place))
    return program.solved()


def _ask(program: Program, one: Conditions, turn: Complex, functions: Functions) -> None:
    """Add conditions for given directions."""
    basis = functions.whole
    unit, single = _units(one), one.a.shape[1:] == (1, 1)
    if one.inside:  # |a + b C| <= w - unit t - sum |Q C|
        helpers = program.norms(one.place, one.q, functions)
        for some, moved in _corners(one):
            values = np.einsum("npj,nmjq->nmpq", one.b[some] + moved, basis[some])
            own = [(index[some], factor[some]) for index, factor in helpers]
            program.norm(values, one.a[some], -unit[some], one.w[some], own)
        return
    turned = turn.conj().swapaxes(1, 2)
    if single:
        turned, values = turned[:, 0], basis[:, :, 0, 0]
        fixed = np.real(turned[:, 0] * one.a[:, 0, 0]) - np.real(turned * one.corners).max(axis=1) - one.w
        for some, moved in _corners(one):
            ahead = np.real((turned[some] * (one.b[some] + moved)[:, 0]) * values[some])
            program.hold(ahead, -unit[some], fixed[some], one.q[some, 0, 0, None] * values[some])
        return
    ahead = np.einsum("nrp,npj,nmjq->nmrq", turned, one.b, basis, optimize=True)
    fixed = turned @ one.a - one.w[:, None, None] * np.eye(one.a.shape[1])
    program.semidefinite(ahead, fixed, -unit, program.norms(one.place, one.q, functions))


def _corners(one: Conditions) -> Iterator[tuple[Indices, Complex]]:
    """Conditions with a further corner of what b may be, and the corners (N, 1, 1): none of a point twice."""
    moved = np.broadcast_to(one.moved, (one.place.size, one.moved.shape[1]))
    for k in range(moved.shape[1]):
        some = np.flatnonzero(np.all(moved[:, :k] != moved[:, k : k + 1], axis=1))
        if some.size:
            yield some, moved[some, k, None, None]
