r"""Rational magnitudes above a bound: a log-Chebyshev fit on the circle by differential correction.

On the circle the squared magnitude of a model of order r is a ratio of polynomials of degree r in ``x = tan^2(angle/2)``, and
every such ratio without zeros and poles on x >= 0 belongs to a stable minimum-phase model: its roots map to
``s = -sqrt(-x)``, ``z = (1 + s)/(1 - s)``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real

if TYPE_CHECKING:
    from collections.abc import Sequence

# A step aims no farther than this in |W|^2, where linear programs in double precision still tell the ends apart.
_REACH = np.log(1e6)
_STEPS = 40
_CLOSE = 4e-3  # in log |W|^2: bisection ends here
# Below the first frequency point the weight has no bound to follow; it stays within this factor of the first one.
_FREE = 100.0
_ZERO = 1e-9  # what a linear program calls zero
_POINTS = 240
_SPREAD = 4  # rows of each kind that a program begins with, for every coefficient: more cost time, fewer cost rounds
_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
_PIVOTS = 20  # times the rows: of a program that the simplex method goes round in it makes hundreds of times as many
_NOT_ENDED = 1  # status of such a program
_TIGHT = 1e-6  # a row is tight from here on
_NONE = np.zeros(0)
Rows = NDArray[np.intp]


class Magnitude(NamedTuple):
    """Zeros and poles in x, one of each conjugate pair (imaginary part >= 0); the constant factor is left open."""

    zeros: Complex
    poles: Complex


class Near(NamedTuple):
    """Points x at which the last program was tight: from below, from above, and in size."""

    below: Real
    above: Real
    size: Real


class Grid(NamedTuple):
    """Points x of the half circle, and the logarithms of the squared bound: largest and smallest of the cells that meet there."""

    x: Real
    low: Real
    high: Real


def grid_of(angles: Real, bound: Real, magnitude: Magnitude, extra: Real = _NONE) -> Grid:
    """Edges, points within every cell, points at the resonances of a magnitude, and extra points x."""
    inner = max(3, -(-_POINTS // bound.size))
    first = float(angles[0] if angles[0] > 0 else angles[1] / 1e3)
    spread = np.geomspace(first, np.pi, _POINTS)
    parts = np.concatenate([[angles[0]], spread[(spread > angles[0]) & (spread < np.pi)]])
    steps = (np.arange(inner) + 0.5) / inner
    within = (angles[:-1, None] + np.diff(angles)[:, None] * steps).ravel()
    parts = np.concatenate([angles, parts, within])
    if angles[0] > 0:
        lowest = float(angles[0])
        parts = np.concatenate([parts, [0.0], np.geomspace(lowest / _FREE, lowest, 40)[:-1]])
    roots = np.concatenate(magnitude)
    centre, width = np.real(roots)[:, None], np.imag(roots)[:, None]
    x = np.concatenate([(centre + width * np.array([-4, -2, -1, -0.5, 0, 0.5, 1, 2, 4])).ravel(), extra])
    parts = np.concatenate([parts, 2 * np.arctan(np.sqrt(x[x > 0]))])
    theta = np.unique(parts)
    left = np.clip(np.searchsorted(angles, theta, side="left") - 1, 0, bound.size - 1)
    right = np.clip(np.searchsorted(angles, theta, side="right") - 1, 0, bound.size - 1)
    slack = np.where(theta < angles[0], 2 * np.log(_FREE), 0.0)
    low = 2 * np.log(np.maximum(bound[left], bound[right])) - slack
    high = 2 * np.log(np.minimum(bound[left], bound[right])) + slack
    return Grid(np.tan(theta / 2) ** 2, low, high)


def improve(magnitude: Magnitude, angles: Real, bound: Real) -> Magnitude:
    """The magnitude of the same order with the smallest looseness, max |W|/bound where min |W|/bound = 1.

    Is there n'/d' with ``low d' <= n' <= g high d'``? is a linear program: bisection on g finds the global optimum, and a
    last step of differential correction `cheney1962` polishes it.
    """
    # Each program is posed in the partial fractions of the best roots so far, in which n'/n and d'/d are near one however steep
    # the bound is.
    grid, near = grid_of(angles, bound, magnitude), Near(_NONE, _NONE, _NONE)
    least, reached = float((grid.low - grid.high).max()), _looseness(magnitude, grid)
    opened = least
    for _ in range(_STEPS):
        closing = reached - least <= _CLOSE
        aim = reached if closing else (least + reached) / 2
        found, crossings, near = _step(magnitude, grid, aim, near)
        # Points at the resonances that the step has moved: what looked good between the old points is judged there.
        second = grid_of(angles, bound, found or magnitude, crossings)
        x, where = np.unique(np.concatenate([grid.x, second.x]), return_index=True)
        grid = Grid(x, np.concatenate([grid.low, second.low])[where], np.concatenate([grid.high, second.high])[where])
        before = _looseness(magnitude, grid)
        reached = before if found is None else min(before, _looseness(found, grid))
        if found is not None and reached < before:
            magnitude = found
        if found is None:
            if closing:
                break
            least = aim
        elif closing and not crossings.size:
            if before - reached < _CLOSE:
                break
            least = opened
    return magnitude


def to_plane(roots: Complex) -> Complex:
    """Roots in z, inside the unit circle, pairs complete."""
    s: Complex = -np.sqrt(-np.where(np.imag(roots) == 0, np.real(roots), roots).astype(complex))
    z = (1 + s) / (1 - s)
    paired = np.imag(roots) > 0
    return np.concatenate([np.where(paired, z, np.real(z)), z[paired].conj()])


def log_square(magnitude: Magnitude, x: Real) -> Real:
    """Log |W|^2 at x, without the constant factor."""
    return _log_product(magnitude.zeros, x) - _log_product(magnitude.poles, x)


def _log_product(roots: Complex, x: Real) -> Real:
    times = np.where(np.imag(roots) > 0, 2.0, 1.0)
    return np.log(np.abs(x[:, None] - roots)) @ times


def _looseness(magnitude: Magnitude, grid: Grid) -> float:
    """Log of the largest |W|^2/high, with W as small as low allows."""
    values = log_square(magnitude, grid.x)
    return float((values - grid.high).max() - (values - grid.low).min())


def raised(magnitude: Magnitude, angles: Real) -> Magnitude:
    """Return the same magnitude with one more zero and pole, which cancel, where the roots are farthest apart."""
    band = np.array([min(angles[angles > 0][0], 0.3), np.clip(angles[-2], 1.0, 3.0)])
    low, high = (float(end) for end in 2 * np.log(np.tan(band / 2)))
    places = np.linspace(low - 1, high + 1, 61)
    taken = np.log(np.abs(np.concatenate([*magnitude, [1e-300, 1e300]])))
    distance = np.abs(places[:, None] - taken).min(axis=1)
    root = [-np.exp(places[np.argmax(distance)])]
    return Magnitude(*(np.concatenate([roots, root]) for roots in magnitude))


def _step(magnitude: Magnitude, grid: Grid, aim: float, near: Near) -> tuple[Magnitude | None, Real, Near]:
    """A magnitude of looseness exp(aim), None where there is none; points x where it has a zero or pole on the circle; new `near`.

    With such points, what is returned lies on the way there, as far as there are none.
    """
    values = log_square(magnitude, grid.x)
    values = values - (values - grid.low).min()
    looseness = (values - grid.high).max()
    share = min(1.0, _REACH / max(looseness, _REACH))
    low, high = np.exp(share * (values - grid.low)), np.exp(share * (values - grid.high - aim))
    bases = [_fractions(roots, grid.x) for roots in magnitude]
    starts = [np.minimum(np.searchsorted(grid.x, points), grid.x.size - 1) for points in near]
    weights, tight = _program(bases[0], bases[1], low, high, starts)
    near = Near(*(grid.x[rows] for rows in tight))
    if weights is None:
        return None, _NONE, near
    crossings, still = _NONE, np.eye(1, bases[0].shape[1])[0]
    for part in (1.0, 0.5, 0.25, 0.1):
        columns = [part * column + (1 - part) * still for column in weights]
        moved = [_roots(roots, column) for roots, column in zip(magnitude, columns, strict=True)]
        bad = [np.real(roots[(np.imag(roots) == 0) & (np.real(roots) >= 0)]) for roots in moved]
        if not any(points.size for points in bad):
            return Magnitude(*moved), crossings, near
        if part == 1.0:
            crossings = np.concatenate(bad)
    return magnitude, crossings, near


def _fractions(roots: Complex, x: Real) -> Real:
    """Columns 1 and the partial fractions of ``p(x)/prod(x - roots)``, each at most one in size on x >= 0."""
    columns = [np.ones_like(x)]
    for root, size in zip(roots, _sizes(roots), strict=True):
        value = size / (x - root)
        columns += [np.real(value)] + ([np.imag(value)] if np.imag(root) > 0 else [])
    return np.stack(columns, axis=1)


def _sizes(roots: Complex) -> Real:
    """Distance of each root from x >= 0."""
    return np.where(np.real(roots) > 0, np.abs(np.imag(roots)), np.abs(roots))


def _roots(roots: Complex, weights: Real) -> Complex:
    """Zeros of the sum of partial fractions: eigenvalues of ``diag(roots) - b c'/weights[0]``, one of each pair.

    States in the scale of the roots, largest first: eigenvalues of a graded matrix keep their digits.
    """
    n = weights.size - 1
    matrix, drive, row = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    k = 0
    for root, size in zip(roots, _sizes(roots), strict=True):
        scale, matrix[k, k] = np.sqrt(np.abs(root)), np.real(root)
        drive[k], row[k] = scale, weights[k + 1] * size / scale
        if np.imag(root) > 0:
            matrix[k + 1, k + 1] = np.real(root)
            matrix[k, k + 1], matrix[k + 1, k] = np.imag(root), -np.imag(root)
            row[k + 1] = -weights[k + 2] * size / scale
            k += 1
        k += 1
    order = np.argsort(-np.abs(np.diag(matrix)), kind="stable")
    graded: Real = (matrix - np.outer(drive, row) / weights[0])[order][:, order]
    found = np.linalg.eigvals(graded)
    return found[np.imag(found) >= 0].astype(complex)


def _program(
    top: Real, bottom: Real, low: Real, high: Real, starts: Sequence[Rows]
) -> tuple[tuple[Real, Real] | None, list[Rows]]:
    """Weights of n'/n and d'/d: ``min t``, ``d' <= low n'``, ``high n' - d' <= t``, ``d' <= 1``; None where t < 0 is impossible.

    Only the rows that matter are given to the program, first some everywhere and `starts`; those that its solution violates most,
    one of each run of neighbours, are added until none is left. Those that its last solution meets are returned too.
    """
    import scipy.optimize

    m, k = len(top), int(top.shape[1])
    rows = [
        np.hstack([-low[:, None] * top, bottom, np.zeros((m, 1))]),
        np.hstack([high[:, None] * top, -bottom, -np.ones((m, 1))]),
        np.hstack([np.zeros_like(top), bottom, np.zeros((m, 1))]),
    ]
    right = [np.zeros(m), np.zeros(m), np.ones(m)]
    start = np.unique(np.linspace(0, m - 1, min(m, _SPREAD * k)).astype(int))
    chosen = [np.union1d(start, rows) for rows in (starts[0], np.append(starts[1], np.argmax(high)), starts[2])]
    cost = np.eye(1, 2 * k + 1, 2 * k)[0]
    solution = np.zeros(2 * k + 1)
    for _ in range(30):
        found = scipy.optimize.linprog(
            cost,
            np.vstack([r[c] for r, c in zip(rows, chosen, strict=True)]),
            np.concatenate([b[c] for b, c in zip(right, chosen, strict=True)]),
            bounds=[(-1e4, 1e4)] * (2 * k) + [(-1.0, 0.0)],
            method="highs-ds",
            options=_TOLERANCES | {"maxiter": _PIVOTS * sum(c.size for c in chosen)},
        )
        if found.x is None or found.status == _NOT_ENDED:
            break
        solution = found.x
        least = np.clip(-solution[-1] / 10, _ZERO, 1e-8)  # what is small beside the gain of the step
        fresh = [np.setdiff1d(_peaks(r @ solution - b, least), c) for r, b, c in zip(rows, right, chosen, strict=True)]
        if not any(points.size for points in fresh):
            break
        chosen = [np.union1d(c, points) for c, points in zip(chosen, fresh, strict=True)]
    tight = [c[(r[c] @ solution - b[c]) > -_TIGHT] for r, b, c in zip(rows, right, chosen, strict=True)]
    return ((solution[:k], solution[k:-1]) if solution[-1] < -_ZERO else None), tight


def _peaks(excess: Real, least: float) -> Rows:
    """Index of the largest excess of every run of rows that are violated by more than `least`."""
    inner = np.concatenate([[-np.inf], excess, [-np.inf]])
    top = (inner[1:-1] > least) & (inner[1:-1] >= inner[:-2]) & (inner[1:-1] >= inner[2:])
    return np.flatnonzero(top)
