"""The bound on the whole circle where the poles lie anywhere in a pole-uncertainty box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.core import Budget, Real
from robustid.errors import InconsistentDataError, InputError, Status
from robustid.guarantees.circle import CircleBound, union_of_circles
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.pole_proofs import KeptCell
from robustid.guarantees.spread import Spread
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.worst_case import worst_case_error
from robustid.identification import MixedProblem, identify

_DIRECTIONS, _FIRST = 6, 12  # of the first look at a cell: directions, frequencies
_ACCURACY = 1e-2


def circle_over_poles(
    problem: MixedProblem,
    kept: Sequence[KeptCell],
    model: Any,
    omega: Real,
    rtol: float,
    *,
    everywhere: bool,
    executor: Spread,
    budget: Budget,
) -> CircleBound:
    """Bound of |F - model| on every arc over all systems with poles in a cell that may contain them.

    Every system of a cell is one of its relaxed problem and at most the remainder of the expansion away; so on every arc it is
    within the bound of that problem on the circle, and the largest remainder on the arc.
    """
    circles: list[CircleBound] = []
    for number, item in enumerate(kept, start=1):
        found = _of_cell(
            problem, item.cell, model, omega, rtol, everywhere, executor, budget.share(1 / (len(kept) - number + 1))
        )
        circles += [] if found is None else [found]
        budget.tell(number, len(kept))
    if not circles:
        raise InconsistentDataError(
            "no system with poles in the pole-uncertainty box fits the data: every cell of it is refuted"
        )
    return union_of_circles(circles)


def _of_cell(
    problem: MixedProblem,
    cell: PoleCell,
    model: Any,
    omega: Real,
    rtol: float,
    everywhere: bool,
    executor: Spread,
    budget: Budget,
) -> CircleBound | None:
    """The bound over the systems of a cell; None where it is proved to have none."""
    relaxed = cell.relaxed(problem)
    found = None if relaxed is None else identify(relaxed, accuracy=_ACCURACY)
    if found is not None and found.status is Status.INCONSISTENT:
        return None
    if found is None or not found.consistent:
        raise InputError(
            "a cell of the pole-uncertainty box is too wide for a bound on the circle: no sample says anything of all its poles"
            " at once; bound it with more `cells`, or state a smaller box"
        )
    at = omega[np.unique(np.linspace(0, omega.size - 1, _FIRST).round().astype(int))]
    error = worst_case_error(found, model=model, omega=at, directions=_DIRECTIONS, rtol=rtol, executor=executor)
    circle = error.on_circle(rtol, everywhere=everywhere, executor=executor, time_limit=budget.seconds)
    slack = cell.slack_on(circle.edges[:-1], circle.edges[1:])
    return CircleBound(
        circle.edges,
        circle.bound + norm_of_bounds(slack),
        circle.lower,
        circle.converged,
        (),
        circle.entries + slack,
    )
