"""Poles of a response over decades: real ones too, where modes beside a smooth remainder leave more than the bounds."""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np

from robustid.core import Real
from robustid.data import FrequencyResponse
from robustid.estimation import PoleFit

_log = logging.getLogger("robustid")

_POINTS_A_POLE = 3
_MOST = 24  # poles
_STEP = 2
_WORTH, _WORTH_LEFT = (
    1e-4,
    0.75,
)  # parts of the sum of squares, at the start or of what is left, that two further poles must remove


class Relaxations(NamedTuple):
    """Natural frequencies in rad/s and damping ratios (1 of a real pole), and what they leave, in units of the bounds."""

    omega: Real
    damping: Real
    left: float  # sum of squares
    largest: float


def over_decades(frf: FrequencyResponse) -> Relaxations | None:
    """Poles of partial fractions that keep a continuous response inside its bounds, or of the order beyond which little is won.

    None for less than two decades, or without a real pole among them. A battery, a cable, a viscoelastic mount has no few poles:
    real ones over the decades follow it all the same, and their places are a choice.
    """
    fit = PoleFit(frf, feedthrough=True)
    if frf.dt or frf.omega.size < 2 * _POINTS_A_POLE or not fit.wide:
        return None
    size = np.abs(np.where(frf.missing, 0, frf.values))
    radius = 0.05 * np.maximum(size, 1e-6 * size.max(axis=0)) if frf.bound is None else frf.bound.outer_radius
    fit.weight = 1 / np.where(frf.missing, np.inf, radius).swapaxes(1, 2).reshape(frf.omega.size, -1)
    fit.values = np.where(fit.weight > 0, fit.values, 0)
    best = _left(fit, np.zeros(0, complex))
    whole = best.left
    for order in range(_STEP, min(_MOST, frf.omega.size // _POINTS_A_POLE) + 1, _STEP):
        _, (poles,) = fit.search(order, np.zeros(1))
        found = _left(fit, poles)
        gain = best.left - found.left
        _log.debug("%d poles over decades: largest |residual|/bound %.3g", order, found.largest)
        if gain <= 0 or (gain < _WORTH * whole and gain < _WORTH_LEFT * best.left):
            break
        best = found
        if best.largest <= 1:
            break
    return best if np.any(best.damping == 1) else None


def _left(fit: PoleFit, poles: np.ndarray) -> Relaxations:
    left = np.abs(fit.residuals(poles))
    s = poles * fit.omega[-1]
    return Relaxations(
        np.abs(s), np.where(s.imag == 0, 1.0, -s.real / np.abs(s)), float(np.sum(left**2)), float(left.max())
    )
