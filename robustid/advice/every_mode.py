"""All modes of a response at their best places, those too that its bounds leave no place to."""

from __future__ import annotations

import numpy as np

from robustid.advice.pole_fit import checked_lines, find_poles, ratios, residual_rows
from robustid.advice.real_poles import HEAVY
from robustid.advice.step_clock import StepClock
from robustid.core import Real
from robustid.data import FrequencyResponse


def every_mode(frf: FrequencyResponse, time_limit: float | None) -> Real:
    """Natural frequencies in rad/s, rising, and damping ratios, (M, 2), with which all points are inside their bounds.

    Heavily damped ones and those outside the points are left out; none where no fit is inside, or the time is over.
    """
    fit = checked_lines(frf, None)
    clock = StepClock(*fit.size, time_limit)
    poles, _ = find_poles(fit, None, clock)
    if not len(poles) or clock.ended or ratios(residual_rows(poles, fit)).max() > 1:
        return np.zeros((0, 2))
    omega, damping = fit.plane.modes(*np.exp(poles[np.argsort(poles[:, 0])]).T)
    kept = (damping <= HEAVY) & (omega >= frf.omega[0]) & (omega <= frf.omega[-1])
    return np.stack([omega[kept], damping[kept]], axis=1)
