"""Cells of a pole-uncertainty box: split until the relaxation costs little, refuted, bounded at frequencies and on the circle."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, Real, as_count, worker_pool
from robustid.errors import InconsistentDataError, InputError, Status
from robustid.guarantees.circle import CircleBound, union_of_circles
from robustid.guarantees.consistent_set import ConsistentSet, set_of
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.pole_proofs import KeptCell, RefutedCell, posed_relaxation
from robustid.guarantees.sweep import Known, Means, value_sets
from robustid.guarantees.value_set import ValueSet, by_frequency, norm_of_bounds
from robustid.guarantees.widening import bounds_at
from robustid.guarantees.worst_case import worst_case_error
from robustid.identification import MarginCertificate, MixedProblem, decide_margin, identify, prove_margin

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")

Cells = list[tuple[PoleCell, ConsistentSet | None]]

LIMITLESS = 1000  # cells, where time is no matter
_ENOUGH = 24  # frequencies, for which cells are left undivided where the time is short
_MATTERS = 0.25  # part of the bounds beside that the relaxation may cost before a cell is split
_DIRECTIONS, _FIRST = 6, 12  # of the first look at a cell: directions, frequencies
_ACCURACY = 1e-2
_INSIDE, _OUTSIDE = 0.9, 1.01  # margins below and above which more digits of them decide nothing


def default_frequencies(problem: MixedProblem, modes: Real) -> Real:
    """Over the range of the frequency points, and at the modes, whose frequencies lie in intervals (M, 2)."""
    top = problem.plane.top
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = (lines.min(), lines.max()) if lines.size else (top / 200, top)
    return np.unique(np.clip(np.concatenate([np.linspace(low, high, 24), modes.mean(axis=1)]), 0, top))


def looked_at(cell: PoleCell, problem: MixedProblem) -> RefutedCell | ConsistentSet | None:
    """Refutation of a cell, or the set of its relaxed problem; None where no sample says anything."""
    posed = posed_relaxation(cell, problem)
    if posed is None:
        return None
    found = decide_margin(posed.data, _INSIDE, _OUTSIDE)
    if isinstance(found, MarginCertificate):
        return RefutedCell(cell, found)
    if found is not None:
        return set_of(posed, 1.0, [found])
    claim, passed = prove_margin(posed.data, "structured", 1e-3)
    if claim.certificate.value > 1:
        return RefutedCell(cell, claim.certificate)
    return set_of(posed, max(1.0, claim.margin * (1 + 1e-3)), passed)


def searched(
    problem: MixedProblem, whole: PoleCell, grid: Real, limit: int, budget: Budget
) -> tuple[Cells, list[RefutedCell]]:
    """Split cells until their relaxation costs little; leave out what is refuted.

    A cell is split where the time suffices for both halves and all that wait, by the longest that one has taken.
    """
    waiting = [whole]
    kept: Cells = []
    refuted: list[RefutedCell] = []
    omega = np.concatenate([grid, *(f.omega for f in problem.frequency)])
    bounds, longest = bounds_at(problem, omega), 0.0
    while waiting:
        before = time.monotonic()
        # The widest cell first, so that the number of cells that are allowed goes where it matters.
        costs = [c.cost(omega, bounds) for c in waiting]
        widest = int(np.argmax(costs))
        cell = waiting.pop(widest)
        found = looked_at(cell, problem)
        if isinstance(found, RefutedCell):
            refuted.append(found)
            continue
        longest, count = max(longest, time.monotonic() - before), len(waiting) + 2
        worth = costs[widest] > _MATTERS and len(kept) + count <= limit and count * longest < budget.left
        halves = cell.split(problem, cell.widest(problem, grid)) if worth else None
        if halves is None:
            kept.append((cell, found))
        else:
            waiting += halves
        _log.info("%d cells kept, %d refuted, %d waiting", len(kept), len(refuted), len(waiting))
    return kept, refuted


def affordable(sets: Cells, grid: Real, settings: tuple[int, float], budget: Budget, model: control.StateSpace) -> int:
    """So many cells can be bounded at enough frequencies in the time that is left, by the seconds of one of them at one."""
    first = next((consistent for _, consistent in sets if consistent is not None), None)
    if budget.seconds is None or first is None:
        return LIMITLESS
    before = budget.left
    value_sets(first, grid[grid.size // 2 :][:1], *settings, Means(), model)
    each = max(before - budget.left, 1e-9)
    return max(1, int(max(budget.left, 0.0) / each) // min(_ENOUGH, grid.size))


def bounded(
    sets: Cells,
    grid: Real,
    settings: tuple[int, float],
    means: Means,
    model: control.StateSpace,
    known: Known | None = None,
) -> tuple[tuple[KeptCell, ...], Real]:
    """The values of every cell, and the frequencies that are finished in all of them.

    One pool of processes, one count and one folder for all cells, and of the time that is left to each the same part.
    """
    left = sum(consistent is not None for _, consistent in sets)
    done, count = 0, grid.size * left
    found: list[tuple[PoleCell, dict[float, tuple[ValueSet, ...]] | None]] = []

    def counted(_: str, here: int, __: int) -> None:
        if means.progress is not None:
            means.progress("bounding the error over the pole-uncertainty box", done + here, count)

    with contextlib.ExitStack() as stack:
        if isinstance(means.executor, int):
            pool = worker_pool(as_count("executor", means.executor, least=1))
            means = means._replace(executor=stack.enter_context(pool))
        for number, (cell, consistent) in enumerate(sets, start=1):
            if consistent is None:
                found.append((cell, None))
                continue
            mine = means.part(f"cell-{number}", 1 / left, counted)
            values = by_frequency(value_sets(consistent, grid, *settings, mine, model, known))
            # Other frequencies are of no use any more: the union is over all cells.
            done, left, grid = done + grid.size, left - 1, grid[np.isin(grid, list(values))]
            found.append((cell, values))
            if not grid.size:
                break
    found += [(cell, {}) for cell, _ in sets[len(found) :]]
    kept = [KeptCell(() if v is None else tuple(one for w in grid.tolist() for one in v[w]), c) for c, v in found]
    return tuple(kept), grid


def circle_over_poles(
    problem: MixedProblem,
    cells: Sequence[PoleCell],
    model: control.StateSpace,
    omega: Real,
    rtol: float,
    everywhere: bool,
    means: Means,
) -> CircleBound:
    """Bound of |F - model| on every arc over all systems with poles in a cell that may contain them.

    Every system of a cell is one of its relaxed problem and at most the remainder of the expansion away; so on every arc it is
    within the bound of that problem on the circle, and the largest remainder on the arc.
    """
    circles: list[CircleBound] = []
    for number, cell in enumerate(cells, start=1):
        mine = means.part(f"circle-{number}", 1 / (len(cells) - number + 1))
        found = _of_cell(problem, cell, model, omega, rtol, everywhere, mine)
        circles += [] if found is None else [found]
        if means.progress is not None:
            means.progress("bounding the error between the frequencies", number, len(cells))
    if not circles:
        raise InconsistentDataError(
            "no system with poles in the pole-uncertainty box fits the data: every cell of it is refuted"
        )
    return union_of_circles(circles)


def _of_cell(
    problem: MixedProblem,
    cell: PoleCell,
    model: control.StateSpace,
    omega: Real,
    rtol: float,
    everywhere: bool,
    means: Means,
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
    workers, folder = means.executor, means.resume
    error = worst_case_error(
        found, model=model, omega=at, directions=_DIRECTIONS, rtol=rtol, executor=workers, resume=folder
    )
    circle = error.on_circle(rtol, everywhere=everywhere, **means.options)
    slack = cell.slack_on(circle.edges[:-1], circle.edges[1:])
    return CircleBound(
        circle.edges, circle.bound + norm_of_bounds(slack), circle.lower, circle.converged, (), circle.entries + slack
    )
