"""Further points for certificates of directions: samples that the farthest systems of those so far contradict."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.guarantees.linear.certificate import Targets
from robustid.guarantees.linear.directed import Measure, Sides, class_bound, kernels, missed_of, seen_rows, sizes_of

_LEVEL = 0.02  # of the mean term of a bound: below, what a term says of the farthest system is not decided
_NEW = 8  # points at once


def further_points(
    sides: Sides, target: Targets, points: NDArray[np.intp], c: Complex, turns: Complex, size: int
) -> NDArray[np.intp]:
    """So many lines, rising: the heaviest of those that there are, and those that are contradicted most, for some directions.

    Multipliers c (M, n) of points (n,). Where lines beside each other are contradicted, the one that is contradicted most. Of
    samples of records as many as there are among the points.
    """
    weight = (np.abs(c) * (sides.bound[points] + sides.left_out[points])).max(axis=0)
    at_lines, in_rows = (one.max(axis=0) for one in contradicted(sides, target, points, c, turns))
    at_lines[sides.samples.v[: sides.first_node, sides.samples.target] == 0] = -np.inf
    rows, lines = points < 0, (points >= 0) & (points < sides.first_node)
    nearer = _further(at_lines, points[lines], weight[lines], min(size, at_lines.size))
    further = _further(in_rows, points[rows] + in_rows.size, weight[rows], int(rows.sum()))
    return np.concatenate([further - in_rows.size, nearer])


def _further(away: Real, points: NDArray[np.intp], weight: Real, size: int) -> NDArray[np.intp]:
    """So many numbers, rising: the heaviest of `points`, and those beside them that are farthest away."""
    away[points] = -np.inf
    peaks = (away >= np.append(-np.inf, away[:-1])) & (away >= np.append(away[1:], -np.inf)) & (away > 0)
    new = np.flatnonzero(peaks)
    new = new[np.argsort(-away[new], kind="stable")[:_NEW]]
    kept = points[np.argsort(-weight, kind="stable")[: size - new.size]]
    rest = np.setdiff1d(np.argsort(-away, kind="stable"), np.concatenate([kept, new]), assume_unique=True)
    return np.sort(np.concatenate([kept, new, rest[: size - kept.size - new.size]]))


def contradicted(
    sides: Sides, target: Targets, points: NDArray[np.intp], c: Complex, turns: Complex
) -> tuple[Real, Real]:
    """Distances of the lines, and of samples of records, outside their bounds around the values of the farthest system of every
    direction, (M, lines) and (M, T).

    The bound is B(c) = max Re(turn F(z_0)) over what the chosen samples leave; its slope along c_k, without the term of the bound
    of sample k, is y_k - f_k of the system that attains it.
    """
    samples, lines = sides.samples, sides.first_node
    missed = missed_of(sides, target, points, c[None], turns)[0]
    centre, radius = sides.extraction.known.coefficients(samples)
    own, twin = sides.twins
    joint = missed[0].copy()
    joint[:, own] += missed[0][:, twin].conj()
    joint[:, sides.reals] = joint[:, sides.reals].real
    of_class = class_bound(sides, target, points, c[None], turns)[0]
    terms = sizes_of(sides, missed)[0] * radius
    total = terms.sum(axis=1) + of_class + np.abs(c) @ sides.bound[points]
    level = (_LEVEL * total / (points.size + own.size + 1))[:, None]
    p = centre + radius * joint.conj() * radius / np.sqrt((np.abs(joint) * radius) ** 2 + level**2)
    p[:, twin] = p[:, own].conj()
    away: list[Real] = []
    every = np.arange(lines), np.arange(-samples.rows, 0)
    for own, extreme in zip(every, _extreme(sides, target, points, c, turns), strict=True):
        found = p @ sides.values[own].T - extreme / of_class[:, None]
        away.append(np.abs(sides.y[own] - found) - (sides.bound[own] + sides.left_out[own]))
    return away[0], away[1]


def _extreme(
    sides: Sides, target: Targets, points: NDArray[np.intp], c: Complex, turns: Complex
) -> tuple[Complex, Complex]:
    """Values at the lines, weights included, and in the rows of records, of what the functional r of every direction takes its norm
    at, times the norm.
    """
    samples, lines = sides.samples, sides.first_node
    base, measure = complex(target.base[0]), Measure(complex(target.base[0]))
    rows, of_rows = samples.rows + points[points < 0], c[:, points < 0].real
    points, c = points[points >= 0], c[:, points >= 0]
    z, w, Z, W = samples.nodes[points], samples.weights[points], samples.nodes[:lines], samples.weights[:lines]
    u, tau = c * measure.outer(z), (target.weight[0] * complex(measure.outer(np.array(base))) * turns)[:, None]
    plain, twice = kernels(Z, W, z, w)
    onto = W[:, samples.target]
    found = u.conj() @ plain.T + u @ twice.T
    found -= tau.conj() * (onto / (1 - Z * base.conjugate())) + tau * (onto / (1 - Z * base))
    found *= measure.outer(Z) / 2
    if not samples.rows:
        return found, np.zeros((turns.size, 0), complex)
    seen = seen_rows(samples, np.arange(samples.rows), measure)
    found += of_rows @ (seen.at(Z, W)[rows] * measure.outer(Z))
    in_rows = (u @ seen.at(z, w).T - tau * seen.of_entry(base, samples.target)).real
    return found, (in_rows + of_rows @ seen.gram[rows]).astype(complex)
