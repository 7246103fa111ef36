r"""Controllers that keep conditions at frequencies: a second-order cone program for given directions, which the controller turns.

For one direction, ``|a + b C| >= q |C| + w`` follows from

.. math:: \operatorname{Re} \bar\varphi (a + b C) - q |C| \ge w, \qquad |\varphi| = 1,

a cone in the factors of C; with the best direction it is the same. Directions are those of the last controller, and at the start of
one that stabilises, or of a loop that is wanted. The least slack, in units of each condition, is made as large as possible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import clarabel
import numpy as np
import scipy.sparse

from robustid.controllers.conditions import Conditions
from robustid.core import Complex, Real

_ROUNDS = 25  # of new directions
_LITTLE = 0.03  # of slack: what a round must gain
_UNIT = 0.05  # least unit of a slack: that of conditions that are about zero
_MOST = 1.0  # slack, beyond which nothing is asked for
_SMALL = 1e-10  # weight of the size of the factors, which makes them unique
_SPARE = 1e-6  # of slack: what rounding of the solver takes

Directions = list[Complex]


class Question(NamedTuple):
    """Conditions on values of C, at the values B (F, m) of an orthonormal basis; linear ones on the factors, ``G x >= h``."""

    basis: Complex
    conditions: Sequence[Conditions]
    linear: tuple[Real, Real] | None = None

    def directions(self, values: Complex) -> Directions:
        """Directions of a controller, by its values."""
        return [one.directions(values) for one in self.conditions]

    def slack(self, factors: Real) -> float:
        """The least slack of all conditions, each in its unit: not negative where all are kept, whatever the directions."""
        values = self.basis @ factors
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
    question: Question, start: Directions, accepted: Callable[[Real], bool], *, centred: bool = False
) -> Real | None:
    """Factors that keep all conditions and are accepted, from directions to begin with; None where the rounds end before.

    `centred`: not the first ones, but those of the largest slack that directions turn to.
    """
    directions, before, best = start, -math.inf, None
    for _ in range(_ROUNDS):
        factors = _solved(question, directions)
        if factors is None:
            break
        slack = question.slack(factors)
        if slack >= -_SPARE and accepted(factors):
            best = factors
            if not centred:
                break
        if slack < before + _LITTLE * abs(before):
            break
        before, directions = slack, question.directions(question.basis @ factors)
    return best


def _solved(question: Question, directions: Directions) -> Real | None:
    """The factors of the largest least slack for given directions."""
    m = question.basis.shape[1]
    near = [one for one in question.conditions if one.inside]
    extra = sum(one.place.size for one in near)
    rows = _Rows(m + 1 + extra)
    rows.add(np.zeros(m), -1.0, _MOST)
    if question.linear is not None:
        G, h = question.linear
        for row, least in zip(G, h, strict=True):
            rows.add(row, -max(abs(least), _UNIT), -least)
    helper = m + 1
    for one, turn in zip(question.conditions, directions, strict=True):
        B, unit = question.basis[one.place], _units(one)
        if one.inside:
            helper = rows.near(one, B, unit, helper)
            continue
        ahead = np.real(turn.conj()[:, None] * one.b[:, None] * B)
        for corner in one.corners:
            fixed = np.real(turn.conj() * (one.a - corner)) - one.w
            rows.hold(ahead, unit, fixed, one.q[:, None] * B)
    return rows.solved(m)


class _Rows:
    """Rows ``b - A x`` of a cone program in x = (factors, slack, helpers): first those that are not negative, then cones."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.linear: list[Real] = []
        self.constant: list[float] = []
        self.cones: list[tuple[Real, Real]] = []  # (N, 3, size), (N, 3): what is in the cone, affine in x

    def add(self, factors: Real, slack: float, constant: float) -> None:
        """``factors x + slack t + constant >= 0``."""
        row = np.zeros(self.size)
        row[: factors.size], row[factors.size] = factors, slack
        self.linear.append(row)
        self.constant.append(constant)

    def hold(self, ahead: Real, unit: Real, fixed: Real, small: Complex) -> None:
        """``ahead x - unit t + fixed >= |small x|``."""
        m = ahead.shape[1]
        parts = np.zeros((len(ahead), 3, self.size))
        parts[:, 0, :m], parts[:, 0, m] = ahead, -unit
        parts[:, 1, :m], parts[:, 2, :m] = small.real, small.imag
        constant = np.zeros((len(ahead), 3))
        constant[:, 0] = fixed
        self.cones.append((parts, constant))

    def near(self, one: Conditions, B: Complex, unit: Real, helper: int) -> int:
        """``|a + b C| + q |C| <= w - unit t``, by a helper of each for the first part; the number of the next helper."""
        count, m = B.shape
        far, small = np.zeros((count, 3, self.size)), np.zeros((count, 3, self.size))
        constant = np.zeros((count, 3))
        own = helper + np.arange(count)
        rows = np.arange(count)
        far[rows, 0, own] = 1.0
        whole = one.b[:, None] * B
        far[:, 1, :m], far[:, 2, :m] = whole.real, whole.imag
        constant[:, 1], constant[:, 2] = one.a.real, one.a.imag
        self.cones.append((far, constant))
        left = np.zeros((count, 3))
        left[:, 0] = one.w
        small[rows, 0, own] = -1.0
        small[:, 0, m] = -unit
        turned = one.q[:, None] * B
        small[:, 1, :m], small[:, 2, :m] = turned.real, turned.imag
        self.cones.append((small, left))
        return helper + count

    def solved(self, m: int) -> Real | None:
        """The factors where the slack is largest."""
        parts = [np.array(self.linear), *(one.reshape(-1, self.size) for one, _ in self.cones)]
        constants = [np.array(self.constant), *(one.ravel() for _, one in self.cones)]
        count = sum(len(one) for one, _ in self.cones)
        cones = [clarabel.NonnegativeConeT(len(self.linear)), *[clarabel.SecondOrderConeT(3)] * count]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        weight = scipy.sparse.csc_matrix(scipy.sparse.diags([_SMALL] * m + [0.0] * (self.size - m)))
        goal = np.zeros(self.size)
        goal[m] = -1.0
        matrix = scipy.sparse.csc_matrix(-np.vstack(parts))
        solver = clarabel.DefaultSolver(weight, goal, matrix, np.concatenate(constants), cones, settings)
        found = np.asarray(solver.solve().x, dtype=float)[:m]
        return found if np.all(np.isfinite(found)) else None
