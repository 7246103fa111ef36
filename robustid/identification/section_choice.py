"""The repeated section that needs the fewest coefficients for the lines of a problem."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from robustid.bases import Sections
from robustid.data import FrequencyResponse, TimeRecord
from robustid.identification.formulation.functions import taylor_tail
from robustid.identification.problem import MixedProblem, excited_lines

_DEGREES = (2, 4, 6, 8)  # eight zeros need about ten percent fewer coefficients than six; more gain little
_LINES = 200  # that the zeros are chosen for; the number of repetitions is for all


def shortest_sections(problem: MixedProblem, share: float) -> Sections:
    r"""The repeated section of lowest total degree whose tails are below a share of every bound.

    .. math:: n = m \max_k \lceil w_k / g_k \rceil, \quad g_k = -\log|B(\zeta_k)|, \quad
              w_k = \log \frac{(2/\pi) K \mathbf{K}(1/\rho)}{\text{share} \cdot \text{bound}_k}, \quad
              \zeta_k = e^{-j\theta_k}/\rho

    For every degree m the zeros of B maximise min_k g_k/w_k, from a start at the quantiles of the lines: a problem in m variables
    that is solved in hundredths of a second. Any zeros give a valid form. Time samples (but for periodic records) see the
    whole circle, where no B does better than the shift: the mean of log|B| over it is at least -m log(rho).

    Parameters
    ----------
    problem : MixedProblem
    share : float
        Of every bound, that its tail may take.

    Returns
    -------
    Sections

    Notes
    -----
    The zeros are a hyperbolic Chebyshev problem on the arc of the lines; those of the best B lie in its hyperbolic convex
    hull, inside |zeta| <= 1/rho.
    """
    angles, bounds, everywhere = demands(problem)
    rho, size = problem.prior.decay_rate, taylor_tail(problem.prior, 0) / share
    if math.isfinite(everywhere) or not angles.size:
        least = min(everywhere, float(bounds.min(initial=problem.prior.gain_bound)))
        return Sections.shift(max(1, math.ceil(math.log(max(size / least, 1.0)) / math.log(rho))))
    weights = np.log(size / bounds)
    felt = weights > 0
    if not np.any(felt):
        return Sections.shift(1)
    zeta, weights = np.exp(-1j * angles[felt]) / rho, weights[felt]
    some = _representatives(angles[felt], weights)
    found = []
    for degree in _DEGREES:
        zeros = _best_zeros(zeta[some], weights[some], degree // 2)
        found.append(Sections(zeros, math.ceil(float(np.max(weights / _decay(zeta, zeros))))))
    return min(found, key=lambda sections: sections.order)


def demands(problem: MixedProblem) -> tuple[np.ndarray, np.ndarray, float]:
    """How small a function must be for no sample to feel it as more than its bound.

    In the largest singular value, entries divided by the scaling of the prior. At the angles (F,) of lines, those excited by
    periodic records included: (F,); and on the whole circle, for the other records: infinity where there are none.
    """
    scales = problem.prior.scales(problem.entries.outputs, problem.entries.inputs)
    angles = [frf.omega * problem.dt for frf in problem.frequency]
    bounds, everywhere = [_felt(frf, scales) for frf in problem.frequency], np.inf
    for record in problem.time:
        if record.initial == "periodic":
            lines, samples = excited_lines(record), record.u.shape[0]
            # The response is at most the l1 norm of the spectrum times the largest value on its lines.
            least = _least(
                record, lambda u, n=samples: 2 * np.linalg.norm(np.fft.rfft(u, axis=0), axis=1).sum() / n, scales
            )
            angles.append(2 * np.pi * lines / samples)
            bounds.append(np.full(lines.size, least if lines.size else np.inf))
        else:
            # sum over the past of |u| rho^-j <= max|u| / (1 - 1/rho).
            reach = 1 - 1 / problem.prior.decay_rate
            least = _least(record, lambda u, reach=reach: np.linalg.norm(u, axis=1).max() / reach, scales)
            everywhere = min(everywhere, least)
    return np.concatenate([np.zeros(0), *angles]), np.concatenate([np.zeros(0), *bounds]), everywhere


def _felt(frf: Any, scales: np.ndarray) -> np.ndarray:
    """Of the lines of a frequency response, (F,)."""
    if not isinstance(frf, FrequencyResponse):
        nuclear = np.linalg.svd(frf.weights * scales, compute_uv=False).sum(axis=-1)
        return (frf.bound / np.maximum(nuclear, np.finfo(float).tiny)).min(axis=(1, 2))
    if frf.joint == "matrix":
        whiten = np.linalg.inv(np.linalg.cholesky(frf.ellipsoid)) * scales.T.ravel()
        return 1 / (np.linalg.norm(whiten, 2, axis=(1, 2)) * np.sqrt(min(scales.shape)))
    return (frf.inner_radius / scales).min(axis=(1, 2))


def _least(record: TimeRecord, drive: Callable[[np.ndarray], float], scales: np.ndarray) -> float:
    """Smallest bound over drive of the outputs of a record."""
    least = np.inf
    for bound, row in zip(record.bound.T, scales, strict=True):
        size = float(drive(record.u * row))
        if size > 0:
            least = min(least, float(bound.min()) / size)
    return least


def _representatives(angles: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Indices of lines in rising order: of each of many groups of neighbours the one with the largest weight, and both ends."""
    order = np.argsort(angles)
    if order.size <= _LINES:
        return order
    groups = np.array_split(order[1:-1], _LINES - 2)
    return np.array([order[0], *(group[np.argmax(weights[group])] for group in groups), order[-1]])


def _decay(zeta: np.ndarray, zeros: tuple[complex, ...]) -> np.ndarray:
    """-log|B| at points, at least the smallest normal number."""
    with np.errstate(divide="ignore"):
        return np.clip(-np.log(np.abs(Sections(zeros, 1).all_pass(zeta))), np.finfo(float).tiny, _FAR)


_FAR = 700.0  # -log|B| at a zero
_REAL = 1e-15  # sines this small are rounding


def _best_zeros(zeta: np.ndarray, weights: np.ndarray, pairs: int) -> tuple[complex, ...]:
    """Zeros in conjugate pairs that maximise the smallest decay/weight, as nearly as a local search finds them.

    In the variables log(1 - |a|), relative to its value at 1/rho, and angle, relative to the width of the band; the logarithm
    of the smallest ratio is maximised as one more variable (Chebyshev's problem as a smooth program).
    """
    import scipy.optimize

    angles, deepest = np.abs(np.angle(zeta)), math.log(1 - abs(zeta[0]))
    width = max(float(np.ptp(angles)), 0.01)

    def zeros(v: np.ndarray) -> tuple[complex, ...]:
        angle = width * v[pairs : 2 * pairs]
        real = np.abs(np.sin(angle)) < _REAL  # at either end of the circle
        turned = np.where(real, np.sign(np.cos(angle)), np.exp(1j * angle))
        return tuple(a for a in (1 - np.exp(deepest * v[:pairs])) * turned for _ in range(1 if a.imag else 2))

    def spare(v: np.ndarray) -> np.ndarray:
        return np.log(_decay(zeta, zeros(v)) / weights) - v[-1]

    quantiles = np.round((1 - np.cos(np.pi * (np.arange(pairs) + 0.5) / pairs)) / 2 * (zeta.size - 1)).astype(int)
    starts = [np.concatenate([np.full(pairs, d), angles[quantiles] / width, [0.0]]) for d in np.linspace(0.02, 1.0, 25)]
    start = max(starts, key=lambda v: spare(v).min())
    start[-1] = spare(start).min()
    bounds = [(1e-9, 1.0)] * pairs + [(0.0, np.pi / width)] * pairs + [(None, None)]
    found = scipy.optimize.minimize(
        lambda v: -v[-1],
        start,
        jac=lambda v: -np.eye(1, v.size, v.size - 1)[0],
        bounds=bounds,
        constraints=[{"type": "ineq", "fun": spare}],
        method="SLSQP",
        options={"maxiter": 100, "ftol": 1e-5},
    ).x
    return zeros(max((start, found), key=lambda v: spare(v).min() + v[-1]))
