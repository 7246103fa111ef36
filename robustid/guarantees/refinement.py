"""Adaptive refinement: from value sets at frequencies to a bound of the error on the whole circle."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from robustid.guarantees.circle import CircleBound, Curvature, interpolant_part, known_part
from robustid.guarantees.sweep import Folder, Progress, Spread, value_sets
from robustid.guarantees.value_set import ValueSet, by_frequency, norm_of_bounds

if TYPE_CHECKING:
    from robustid.guarantees.worst_case import WorstCaseError

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
    known = by_frequency(before.values if before is not None else ())
    known |= {w: sets for w, sets in by_frequency(error.values).items() if bottom <= w <= top}
    fine = {w for w, sets in known.items() if sets[0].directions.size in (2, error.directions)}
    limits: dict[tuple[float, float], np.ndarray] = {}
    coarse, sharp = [w for w in (bottom, top) if w not in known], []
    for _ in range(_ROUNDS):
        for wanted, settings in ((coarse, _COARSE), (sharp, (error.directions, error.gap))):
            found = value_sets(consistent, np.array(wanted), *settings, executor, progress, resume)
            known |= by_frequency(found)
        fine |= set(sharp)
        edges = np.array(sorted(known))
        entries, upper, lower = _errors(error, {w: known[w] for w in edges.tolist()})
        sure = np.where([w in fine for w in edges], upper, lower)  # errors known to be about that large
        ends = np.maximum(sure[:-1], sure[1:])
        peak = ends if everywhere else np.full(ends.size, sure.max())
        arcs = list(itertools.pairwise(edges.tolist()))
        limits |= {arc: curvature.largest(arc[0] * dt, arc[1] * dt) for arc in arcs if arc not in limits}
        bends = np.array([limits[arc] * ((arc[1] - arc[0]) * dt) ** 2 / 8 for arc in arcs])
        bounds = np.maximum(entries[:-1], entries[1:]) + bends
        bend, bound = norm_of_bounds(bends), _norms(bounds, upper, bends)
        open_arcs = np.flatnonzero(bound > (1 + rtol) * peak)
        values = tuple(one for w in edges.tolist() for one in known[w])
        result = CircleBound(edges, bound, float(lower.max()), open_arcs.size == 0, values, bounds)
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
    sets = by_frequency(circle.values)
    omega = np.array(list(sets))
    if not np.array_equal(omega, circle.edges) or _range(error) != (omega[0], omega[-1]):
        return False
    dt, curvature = error.identification.problem.dt, _curvature(error)
    entries, upper, _ = _errors(error, sets)
    arcs = itertools.pairwise(circle.edges.tolist())
    bends = np.array([curvature.largest(a * dt, b * dt) * ((b - a) * dt) ** 2 / 8 for a, b in arcs])
    bounds = np.maximum(entries[:-1], entries[1:]) + bends
    norms = _norms(bounds, upper, bends)
    return all(bool(np.all(a <= b * (1 + 1e-9))) for a, b in ((bounds, circle.entries), (norms, circle.bound)))


def _norms(bounds: np.ndarray, upper: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Of the largest singular value on every arc, (C,): from the bounds of the entries, or from those of itself at the ends."""
    return np.minimum(norm_of_bounds(bounds), np.maximum(upper[:-1], upper[1:]) + norm_of_bounds(bends))


def _errors(
    error: WorstCaseError, sets: dict[float, tuple[ValueSet, ...]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds of the entries of F - model, (F, ny, nu), and the bound and an attained one of its largest singular value, (F,)."""
    found = error.errors_at(sets)
    sigma = np.array([(e.sigma_upper, e.sigma_lower) for e in found])
    return np.array([e.upper for e in found]), sigma[:, 0], sigma[:, 1]


def _range(error: WorstCaseError) -> tuple[float, float]:
    """Of the circle, rad/s: from 0, or from the first line where the plant has an integrator."""
    problem = error.identification.problem
    top, basis = np.pi / problem.dt, problem.parametric
    if basis is None or not basis.has_integrator:
        return 0.0, top
    lines = [f.omega.min() for f in problem.frequency]
    return float(min(lines, default=error.omega.min())), top


def _curvature(error: WorstCaseError) -> Curvature:
    identification, own = error.identification, error.is_own
    basis = identification.problem.parametric
    parts = interpolant_part(identification) if own else known_part(error.model, identification)
    reach = error.parameters.reach(identification.parameters)
    functions = None if basis is None or not basis.states else (basis.A, basis.B, basis.C)
    # A reduced interpolant is near the ball, not in it.
    inside = own and identification.sections is None
    shape = len(identification.problem.outputs), len(identification.problem.inputs)
    return Curvature(identification.problem.prior, parts, functions, reach.reshape(-1, *shape), inside)
