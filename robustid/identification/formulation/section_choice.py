"""The repeated section that needs the fewest coefficients for the frequency points of a problem."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robustid.bases import Sections
from robustid.core import Complex, Real
from robustid.identification.formulation.tails import demands, taylor_tail
from robustid.identification.problem import MixedProblem

_DEGREES = (2, 4, 6, 8)  # eight zeros need about ten percent fewer coefficients than six; more gain little
_POINTS = 200  # that the zeros are chosen for; the number of repetitions is for all


def shortest_sections(problem: MixedProblem, share: float) -> Sections:
    """The repeated section of lowest total degree whose tails are below a share of every bound."""
    # With zeta_k = exp(-j theta_k)/rho, g_k = -log|B(zeta_k)| and w_k = log((2/pi) K K(|zeta_k|) / (share bound_k)), K(.) the
    # elliptic integral, the degree is n = m max_k ceil(w_k/g_k). For every degree m the zeros of B maximise min_k g_k/w_k, from
    # a start at the quantiles of the points: a problem in m variables that is solved in hundredths of a second, a hyperbolic
    # Chebyshev problem on the arc of the points; the zeros of the best B lie in its hyperbolic convex hull, inside |zeta| <=
    # 1/rho. Any zeros give a valid form. Time samples (but for periodic records) see the whole circle, where no B does better
    # than the shift: the mean of log|B| over it is at least -m log(rho).
    angles, bounds, everywhere = demands(problem)
    if math.isfinite(everywhere) or not angles.size:
        least = min(everywhere, float(bounds.min(initial=problem.prior.gain_bound)))
        size = taylor_tail(problem.prior, 0) / share
        length = math.ceil(math.log(max(size / least, 1.0)) / math.log(problem.prior.decay_rate))
        return Sections.shift(max(1, length))
    weights = np.log(problem.region.reach(problem.prior.gain_bound, angles) / share / bounds)
    felt = weights > 0
    if not np.any(felt):
        return Sections.shift(1)
    zeta, weights = problem.region.points(angles[felt]), weights[felt]
    some = _representatives(angles[felt], weights)
    found: list[Sections] = []
    for degree in _DEGREES:
        zeros = _best_zeros(zeta[some], weights[some], degree // 2)
        found.append(Sections(zeros, math.ceil(float(np.max(weights / _decay(zeta, zeros))))))
    return min(found, key=lambda sections: sections.order)


def _representatives(angles: Real, weights: Real) -> NDArray[np.intp]:
    """Indices of points in rising order: of each of many groups of neighbours the one with the largest weight, and both ends."""
    order = np.argsort(angles)
    if order.size <= _POINTS:
        return order
    groups = np.array_split(order[1:-1], _POINTS - 2)
    return np.array([order[0], *(group[np.argmax(weights[group])] for group in groups), order[-1]])


def _decay(zeta: Complex, zeros: tuple[complex, ...]) -> Real:
    """-log|B| at points, at least the smallest normal number."""
    with np.errstate(divide="ignore"):
        return np.clip(-np.log(np.abs(Sections(zeros, 1).all_pass(zeta))), np.finfo(float).tiny, _FAR)


_FAR = 700.0  # -log|B| at a zero
_REAL = 1e-15  # sines this small are rounding


def _best_zeros(zeta: Complex, weights: Real, pairs: int) -> tuple[complex, ...]:
    """Zeros in conjugate pairs that maximise the smallest decay/weight, as far as a local search finds them."""
    # In the variables log(1 - |a|), relative to its value at the point nearest to the circle, and angle, relative to the width
    # of the band; the logarithm of the smallest ratio is maximised as one more variable (Chebyshev's problem as a smooth
    # program).
    import scipy.optimize

    nearest = zeta[np.argmax(np.round(np.abs(zeta), 12))]  # the first of those that differ by rounding only
    angles, deepest = np.abs(np.angle(zeta)), math.log(1 - abs(nearest))
    width = max(float(np.ptp(angles)), 0.01)

    def zeros(v: Real) -> tuple[complex, ...]:
        angle = width * v[pairs : 2 * pairs]
        real = np.abs(np.sin(angle)) < _REAL  # at either end of the circle
        turned = np.where(real, np.sign(np.cos(angle)), np.exp(1j * angle))
        return tuple(a for a in (1 - np.exp(deepest * v[:pairs])) * turned for _ in range(1 if a.imag else 2))

    def spare(v: Real) -> Real:
        return np.log(_decay(zeta, zeros(v)) / weights) - v[-1]

    quantiles = np.round((1 - np.cos(np.pi * (np.arange(pairs) + 0.5) / pairs)) / 2 * (zeta.size - 1)).astype(int)
    starts = [np.concatenate([np.full(pairs, d), angles[quantiles] / width, [0.0]]) for d in np.linspace(0.02, 1.0, 25)]

    def reached(v: Real) -> float:
        return -v[-1]

    def slope(v: Real) -> Real:
        return -np.eye(1, v.size, v.size - 1)[0]

    start = max(starts, key=lambda v: spare(v).min())
    start[-1] = spare(start).min()
    bounds = [(1e-9, 1.0)] * pairs + [(0.0, np.pi / width)] * pairs + [(None, None)]
    found = scipy.optimize.minimize(
        reached,
        start,
        jac=slope,
        bounds=bounds,
        constraints=[{"type": "ineq", "fun": spare}],
        method="SLSQP",
        options={"maxiter": 100, "ftol": 1e-5},
    ).x
    ends: list[Real] = [start, found]
    return zeros(max(ends, key=lambda v: spare(v).min() + v[-1]))
