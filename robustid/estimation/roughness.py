"""Noise of a dense response from its roughness: what smooth models of rising order leave, unrelated from point to point."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse
from robustid.estimation.pole_fit import PoleFit

_ORDERS = (4, 8, 12, 20, 30, 40, 60)
_POINTS_A_POLE = 6
# The same of responses over decades, whose poles are mostly real.
_ORDERS_OF_DECADES, _POINTS_OF_DECADES = (4, 8, 12, 16, 20, 30), 3
_POOL = 21  # neighbouring frequency points whose residuals say how large the noise is
_REWEIGHTED = 3
_SEARCHED = 2  # of these with all starts of refined poles, then from the best
_DIP = 5  # neighbours whose median a response is at least, where noise is proportional to it
_RISES = 2  # of the criterion before no higher order is tried: one may be a poor start of the poles
_NOISY = 0.05  # noise in parts of the response from which on relocated poles are refined,
_REFINED = 20  # up to this order
_WHITE = 0.3  # correlation of neighbours below which residuals are noise
_SMALLEST = 1e-9  # part of the largest |G|
FEWEST = _ORDERS[0] * _POINTS_A_POLE


class Roughness(NamedTuple):
    """Residuals (F,) of a smooth model of one entry, their deviation nearby (F,) with its degrees of freedom, and its poles.

    White where neighbouring residuals are unrelated: else they are more than noise, and the deviation is too large. Falling where
    the criterion still fell at the highest order: there may be more modes than that, and what they leave is no noise either.
    """

    residual: Complex
    deviation: Real
    dof: float
    poles: int
    white: bool
    falling: bool = False


def roughness(frf: FrequencyResponse) -> Roughness:
    """Noise of one entry with at least `FEWEST` points, of the order with the smallest Bayesian information criterion.

    ``BIC = 2 sum_k (log s_k^2 + |r_k|^2/s_k^2) + 2 n log 2F`` for n poles with residues. Residuals r are weighted by the
    deviation s of their neighbours: noise that is even nearby, or proportional to the response nearby, whichever is likelier.
    """
    # Where noise is a large part of the response, relocated poles go astray: the least squares are then sought from broad poles and
    # from those of the order before, too.
    plain = dataclasses.replace(frf, covariance=None, bound=None)
    values: Complex = plain.values.reshape(-1)
    size, least = values.size, _SMALLEST * float(np.abs(values).max())
    # A value that is small by chance isn't known better than its neighbours.
    near: Real = np.median(sliding_window_view(np.pad(np.abs(values), _DIP // 2, mode="edge"), _DIP), axis=1)
    sizes: Real = np.maximum(np.maximum(np.abs(values), near), least)
    # A peak of one point is no error of its own size: beside its neighbours it must be followed.
    level: Real = np.maximum(near, least)
    noisy = _bent(values, level) > _NOISY
    made: list[tuple[float, Roughness]] = []
    fit = PoleFit(plain, feedthrough=True)
    orders, points = (_ORDERS_OF_DECADES, _POINTS_OF_DECADES) if fit.wide else (_ORDERS, _POINTS_A_POLE)
    places: np.ndarray = np.zeros(0, complex)
    for poles in orders:
        worse = len(made) - 1 - _best(made) if made else 0
        if poles * points > size or worse == _RISES:
            break
        deviation, lower, refined = level, places, noisy and poles <= _REFINED
        residual: Complex = values
        left, unlikely = 1 - (2 * poles + 1) / (2 * size), np.inf
        for again in range(_REWEIGHTED):
            fit.weight = (1 / deviation)[:, None]
            if refined:
                starts: list[np.ndarray] = [places] if again else []
                if again < _SEARCHED:
                    starts += [fit.search(poles, np.zeros(1))[1][0], fit.broad(poles), fit.grown(lower, poles)]
                places = min((fit.refine(0.0, start, held=True) for start in starts), key=lambda one: one.cost).poles
            else:
                places = fit.search(poles, np.zeros(1))[1][0]
            residual = np.asarray(fit.residuals(places)[:, 0] * deviation, dtype=complex)
            shapes = (np.ones(size), sizes)
            unlikely, deviation = min((_nearby(residual, shape, least) for shape in shapes), key=lambda one: one[0])
            deviation = deviation / np.sqrt(left)
        z = residual / deviation
        power = max(float(np.sum(np.abs(z) ** 2)), np.finfo(float).tiny)
        white = bool(np.abs(np.sum(z[1:] * z[:-1].conj())) < _WHITE * power)
        criterion = 2 * unlikely + 2 * poles * float(np.log(2 * size))
        made.append((criterion, Roughness(residual, deviation, min(_POOL, size) * left, poles, white)))
    best = _best(made)
    return made[best][1]._replace(falling=best == len(made) - 1)


def _bent(values: Complex, level: Real) -> float:
    """Median deviation of a value from the middle of its neighbours, as that of noise, in parts of the response."""
    bent = np.abs(values[1:-1] - (values[2:] + values[:-2]) / 2) / level[1:-1]
    return float(np.median(bent) / np.sqrt(1.5 * np.log(2)))


def _best(made: list[tuple[float, Roughness]]) -> int:
    return min(range(len(made)), key=lambda k: made[k][0])


def _nearby(residual: Complex, shape: Real, least: float) -> tuple[float, Real]:
    """Deviation of noise of this shape, from the residuals nearby; and how unlikely those are, each judged by the others."""
    power: Real = (np.abs(residual) / shape) ** 2
    width = min(_POOL, power.size)
    total = np.concatenate([[0.0], np.cumsum(power)])
    start = np.clip(np.arange(power.size) - width // 2, 0, power.size - width)
    sums: Real = np.maximum(total[start + width] - total[start], power)
    others = np.maximum((sums - power) / (width - 1), (least / shape) ** 2)
    unlikely = float(np.sum(np.log(others * shape**2) + power / others))
    deviation: Real = np.maximum(shape * np.sqrt(sums / width), least)
    return unlikely, deviation
