"""Samples of the response to an input, of every consistent system; and what a step leaves after them."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Real, StateMatrices, simulate
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.certificate import Targets, choose, discs
from robustid.guarantees.linear.functions import Functions
from robustid.guarantees.linear.samples import Samples
from robustid.guarantees.linear.search import POINTS, reweighted

_STACK = 4e5  # complex numbers in the matrices of a stack: what a cache holds
_RING = 4096  # samples over which the functions are followed; beyond them their energy is a bound
_ONE = 1 + 1e-9


def sample_targets(samples: Samples, u: Real) -> Targets:
    r"""The samples of the response of the entry to an input (T,) from zero initial conditions.

    y_t = sum_n u_(t-n) f_n, and f_n = K s rho^-n g_n, seen from zeta = 0: the mean square over the circle bounds sum |g_n|^2.
    """
    count = u.size
    filtered = samples.problem.weighting.filtered(u)
    decay = samples.problem.prior.decay_rate ** -np.arange(count, dtype=float)
    taylor: Real = samples.gains[samples.target] * scipy.linalg.toeplitz(filtered, np.zeros(count)) * decay
    return Targets(
        np.zeros(count, complex),
        taylor[:, 0].astype(complex),
        samples.of_target(samples.functions.responses(u), samples.amplitude_of.size),
        samples.of_target(samples.functions.left_out_in_time(u), samples.amplitudes).real,
        taylor[:, 1:],
    )


def spread_points(samples: Samples) -> NDArray[np.intp]:
    """Lines all over the frequency axis that see the entry, with their conjugates, (n,)."""
    half = samples.angles.size // 2
    lines = np.flatnonzero(np.abs(samples.v[:half, samples.target]) > 0)
    lines = lines[np.argsort(samples.angles[lines])]
    if lines.size > POINTS:
        lines = lines[np.linspace(0, lines.size - 1, POINTS).round().astype(int)]
    return np.concatenate([lines, lines + half])


def response_discs(extraction: Extraction, u: Real) -> tuple[Real, Real]:
    """Centres and radii of the samples of the response to an input, (T,) each.

    Never wider than what the class and the amplitudes of the parametric part say without the samples.
    """
    samples, known = extraction.samples, extraction.known
    targets, points = sample_targets(samples, u), spread_points(samples)
    size = points.size + samples.rows
    stack = max(int(_STACK / (size * (3 * size + 2 * samples.amplitude_of.size + 1) + 1)), 1)
    found = np.empty(u.size), np.empty(u.size)
    for first in range(0, u.size, stack):
        part = slice(first, first + stack)
        own = targets[part]
        chosen = choose(samples, own, np.broadcast_to(points, (own.base.size, points.size)))
        nothing = np.zeros((own.base.size, size), complex)
        tried = [nothing, reweighted(samples, chosen, own, known)] if size else [nothing]
        ways = [discs(samples, chosen, own, d, known) for d in tried]
        best = np.argmin([radius for _, radius in ways], axis=0)
        found[0][part] = np.choose(best, [centre.real for centre, _ in ways])
        found[1][part] = np.choose(best, [radius for _, radius in ways])
    return found


def step_tails(extraction: Extraction, count: int) -> Real:
    """Bound of |y_n - static gain| for every n >= t and the entry's step response y, t = 0, ..., count: (count + 1,).

    What the class leaves is sum_(m > t) K s peak rho^-m; what a function leaves, its amplitude times the largest of its tail.
    """
    samples = extraction.samples
    prior, functions = samples.problem.prior, samples.functions
    t, rho = np.arange(count + 1.0), prior.decay_rate
    gain = samples.gains[samples.target] / samples.reach * samples.problem.weighting.peak(rho)
    first = samples.target * functions.amplitudes
    largest = extraction.known.largest[first : first + functions.amplitudes]
    ends = np.concatenate([_tails_of_fixed(functions, count), tails_of_modes(functions, count)], axis=1)
    return (gain * rho**-t / (rho - 1) + ends @ largest) * _ONE


def _tails_of_fixed(functions: Functions, count: int) -> Real:
    """Largest |C A^n (I - A)^-1 B| of every function over n >= t, (count + 1, fixed)."""
    if functions.fixed is None:
        return np.zeros((count + 1, 0))
    A, B, C, _ = functions.fixed.matrices
    start = np.linalg.solve(np.eye(len(A)) - A, B)[:, 0]
    length = count + 1 + _RING
    free = StateMatrices(A, B, C, np.zeros((len(C), B.shape[1])))
    values, last = simulate(free, np.zeros((length, B.shape[1])), start)  # type: ignore[arg-type]
    energy: list[float] = []
    for row in C:
        P = np.asarray(scipy.linalg.solve_discrete_lyapunov(A.T, np.outer(row, row)), dtype=float)
        energy.append(float(np.sqrt(max(last @ P @ last, 0.0))))
    every = np.concatenate([np.abs(values), np.array(energy).reshape(1, -1)])
    return np.maximum.accumulate(every[::-1], axis=0)[::-1][: count + 1] * _ONE


def tails_of_modes(functions: Functions, count: int) -> Real:
    r"""Bound of 2 |c a^(n + 1 - delay)/(1 - a)| over n >= t for an amplitude of 1, poles anywhere in their disc, (count + 1, M).

    a = (tau + a_1)/(1 + a_1* tau), |tau| <= T, is a disc; |c/c'| = 1/|C_1| = 1/|1 + a_1* tau|. Of amplitude l in a group,
    sum_n |g_n R_nl|, g_n the coefficients of that function of tau: |g_n| <= max/r^n for its largest on a circle T < r < 1 (Cauchy).
    """
    modes = functions.modes
    if modes is None:
        return np.zeros((count + 1, 0))
    (T, share), middle = modes.on_wider_circle, modes.middle
    size = np.abs(middle)
    centre, radius = middle * (1 - T**2) / (1 - (T * size) ** 2), T * (1 - size**2) / (1 - (T * size) ** 2)
    room = np.maximum(np.abs(1 - centre) - radius * _ONE, 0.0)
    pole = (size + T) / (1 + size * T)
    powers = np.maximum(np.arange(count + 1) + 1 - modes.delay, 0)[:, None]
    with np.errstate(divide="ignore"):
        found = share * 2 * pole**powers / (room * (1 - size * T))
    return np.where(modes.reach > 0, np.inf, found) * _ONE
