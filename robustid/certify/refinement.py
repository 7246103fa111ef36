"""Adaptive refinement: from value sets at frequencies to a bound of the error on the whole circle."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.certify.circle import CircleBound, Curvature, known_part
from robustid.certify.sweep import Folder, Progress, Spread, value_sets
from robustid.certify.value_set import ValueSet
from robustid.identification.simulation import response

if TYPE_CHECKING:
    from robustid.certify.worst_case import WorstCaseError

_COARSE = 6, 0.05  # directions and gap of a first look at a frequency between others
_ROUNDS, _LARGEST = 40, 4000  # refinements of the circle, and frequencies in all


def refine(
    error: WorstCaseError,
    rtol: float,
    everywhere: bool,
    executor: Spread,
    progress: Progress | None,
    resume: Folder | None,
) -> CircleBound:
    """Halve the arcs whose bound exceeds the largest error (or that at its own ends) by more than rtol.

    New ends of arcs get a coarse value set, which does for most of them, and a fine one where the arc is short enough for it to
    matter.
    """
    dt, consistent, curvature = error.identification.problem.dt, error._consistent, _curvature(error)
    bottom, top = _range(error)
    before = error.__dict__.get("circle")
    known = {v.omega: v for v in (before.values if before is not None else ())}
    known |= {v.omega: v for v in error.values if bottom <= v.omega <= top}
    fine = {w for w, v in known.items() if v.directions.size in (2, error.directions)}
    limits: dict[tuple[float, float], float] = {}
    coarse, sharp = [w for w in (bottom, top) if w not in known], []
    for _ in range(_ROUNDS):
        for wanted, settings in ((coarse, _COARSE), (sharp, (error.directions, error.gap))):
            found = value_sets(consistent, np.array(wanted), *settings, executor, progress, resume)
            known |= {v.omega: v for v in found}
        fine |= set(sharp)
        edges = np.array(sorted(known))
        upper, lower = _errors(error, [known[w] for w in edges])
        sure = np.where([w in fine for w in edges], upper, lower)  # errors known to be about that large
        ends = np.maximum(sure[:-1], sure[1:])
        peak = ends if everywhere else np.full(ends.size, sure.max())
        arcs = list(itertools.pairwise(edges))
        limits |= {arc: curvature.largest(arc[0] * dt, arc[1] * dt) for arc in arcs if arc not in limits}
        bend = np.array([limits[arc] * ((arc[1] - arc[0]) * dt) ** 2 / 8 for arc in arcs])
        bound = np.maximum(upper[:-1], upper[1:]) + bend
        open_arcs = np.flatnonzero(bound > (1 + rtol) * peak)
        result = CircleBound(edges, bound, float(lower.max()), open_arcs.size == 0, tuple(known[w] for w in edges))
        coarse, sharp = [], []
        for k in open_arcs:
            rough = [
                w for w, u in zip(arcs[k], upper[k : k + 2], strict=True) if w not in fine and u + bend[k] > peak[k]
            ]
            if bend[k] <= 0.5 * rtol * peak[k] and rough:
                sharp += rough
            else:
                coarse.append(float(sum(arcs[k]) / 2))
        sharp = sorted(set(sharp))
        if result.converged or edges.size + len(coarse) > _LARGEST:
            break
    return result


def supported(error: WorstCaseError, circle: CircleBound) -> bool:
    """Whether the value sets at its edges, whose certificates are claims of their own, give the bounds that it states."""
    omega = np.array([v.omega for v in circle.values])
    if not np.array_equal(omega, circle.edges) or _range(error) != (omega[0], omega[-1]):
        return False
    dt, curvature = error.identification.problem.dt, _curvature(error)
    upper, _ = _errors(error, circle.values)
    for k, (a, b) in enumerate(itertools.pairwise(circle.edges)):
        bend = curvature.largest(a * dt, b * dt) * ((b - a) * dt) ** 2 / 8
        if not max(upper[k], upper[k + 1]) + bend <= circle.bound[k] * (1 + 1e-9):
            return False
    return True


def _errors(error: WorstCaseError, values: Sequence[ValueSet]) -> np.ndarray:
    """Upper and lower bounds of |F - model|, (2, F)."""
    nominal = response(error.model, np.array([v.omega for v in values]) * error.identification.problem.dt)
    return np.array([v.farthest(m) for v, m in zip(values, nominal, strict=True)]).T


def _range(error: WorstCaseError) -> tuple[float, float]:
    """Of the circle, rad/s: from 0, or from the first line where the plant has an integrator."""
    problem = error.identification.problem
    top, basis = np.pi / problem.dt, problem.parametric
    if basis is None or not basis.has_integrator:
        return 0.0, top
    lines = [f.omega.min() for f in problem.frequency]
    return float(min(lines, default=error.omega.min())), top


def _curvature(error: WorstCaseError) -> Curvature:
    identification = error.identification
    problem, basis = identification.problem, identification.problem.parametric
    q = identification.parameters
    own, mine = error.is_own, error.model
    if own and basis is not None:
        # The parametric part of its own model is q'P exactly, its states the last ones.
        n = mine.nstates - basis.states
        parts = known_part(_Part(mine.A[:n, :n], mine.B[:n], mine.C[:, :n]), None, q)
    else:
        parts = known_part(mine, basis, q)
    reach = np.maximum(np.abs(error.parameters.lower - q), np.abs(error.parameters.upper - q))
    functions = None if basis is None or not basis.states else (basis.A, basis.B, basis.C)
    # A reduced interpolant is near the ball, not in it.
    return Curvature(problem.prior, parts, functions, reach, own and identification.sections is None)


@dataclasses.dataclass(frozen=True)
class _Part:
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
