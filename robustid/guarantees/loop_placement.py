"""Frequencies of polygons of R in a loop: those at which its discs limit a peak or a margin, and no others."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Progress, Real, StateMatrices
from robustid.guarantees.band_result import Band
from robustid.guarantees.loop_axis import LoopAxis
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.parameters import parameter_intervals
from robustid.guarantees.placement import OfExactPoles
from robustid.guarantees.sweep import Folder, Means, Processes
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, Loop

_MOST, _EACH = 24, 2  # frequencies, and of these so many at first for each peak and margin, then twice as many


def limiting_polygons(
    band: Band,
    loop: Loop,
    identification: Identification,
    omega: Real,
    *,
    directions: int,
    rtol: float,
    executor: Processes = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
    time_limit: float | None = None,
) -> WorstCaseError | None:
    """Polygons at those of some frequencies that limit a peak or a margin of the loop that ran, as of `worst_case_error`.

    A few at a time: the largest sizes of each that are above all that have a polygon, until there are none. Of exact poles. None
    where the time is over before there is one.
    """
    budget, model = Budget(time_limit), as_nominal(band.model, identification)
    low, high = band.range
    omega = omega[(omega >= low) & (omega <= high)]
    around, found = loop.about(StateMatrices.of(model), None), band.with_model(model)
    programs = OfExactPoles(identification, model, (directions, rtol), least=0)
    means = Means(executor, progress, resume, budget)
    solved = np.zeros(omega.size, dtype=bool)
    each = _EACH
    while (room := _MOST - int(solved.sum())) > 0 and not budget.over:
        if solved.any():
            found = band.with_model(model).between(programs.polygons(), None)
        chosen = _binding(LoopAxis(found, loop.shape, around).sizes_at(omega), solved, each)[:room]
        if not chosen.size:
            break
        seen = programs.solve(omega[np.sort(chosen)], band, means)[0]
        solved |= np.isin(omega, seen)
        if seen.size < chosen.size:  # the time is over, or Ctrl-C
            break
        each *= 2
    if not solved.any():
        return None
    workers = None if identification.problem.entries.single else executor
    intervals = parameter_intervals(programs.consistent, workers, budget)
    return dataclasses.replace(programs.polygons(), parameters=intervals)


def _binding(sizes: Real, solved: NDArray[np.bool_], each: int) -> NDArray[np.intp]:
    """The numbers of frequencies without a polygon whose sizes (F, names) are above all of those with one, so many of each."""
    found: list[int] = []
    for size in sizes.T:
        left = np.flatnonzero(~solved & (size > size[solved].max(initial=0.0)))
        found += left[np.argsort(-size[left], kind="stable")[:each]].tolist()
    return np.array(list(dict.fromkeys(found)), dtype=np.intp)
