"""Matrix fractions fitted to the frequency responses of a problem: where the search for small models of matrices starts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from robustid.core import Budget, Real
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import FitStatus, Weight, fit_mfd
from robustid.identification import MixedProblem


class ResponseFits:
    """Fits of a problem's responses, all points of all experiments, each weighted by the inverse of its bound.

    Integrators are taken from the data first: ``integrals`` (count, ny, nu) are the coefficients of 1/(z - 1), 1/(z - 1)^2, ...
    of a model of them.

    No model with the largest ratio s has a weighted root mean square above s: a fit that misses the bounds by much leaves no hope
    for its order, as far as it is the best one.
    """

    def __init__(self, problem: MixedProblem, integrals: Real):
        self._responses = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
        self._dt, self._integrals = problem.dt, integrals
        self.alone = not problem.time and len(self._responses) == len(problem.frequency)
        self._stated = self._statement() if self._responses else None

    def _statement(self) -> tuple[FrequencyResponse, Weight]:
        """All points in the order of frequency, those that several experiments have once; missing entries have no weight."""
        omega, first = np.unique(np.concatenate([f.omega for f in self._responses]), return_index=True)
        used = np.concatenate([np.isfinite(f.bound.radius) for f in self._responses])[first]
        values = np.where(used, np.concatenate([f.values for f in self._responses])[first], 0.0)
        step = np.exp(1j * omega * self._dt) - 1
        for power, gains in enumerate(self._integrals, 1):
            values = values - used * gains / step[:, None, None] ** power
        frf = FrequencyResponse(omega, values, dt=self._dt)
        if all(f.bound.ellipsoid is not None for f in self._responses):
            white = np.concatenate([f.bound.whitening for f in self._responses])[first]
            return frf, Weight(np.ones(values.shape), matrix=white)
        radius = np.concatenate([f.bound.outer_radius for f in self._responses])[first]
        return frf, Weight(np.where(used, 1 / np.where(used, radius, 1.0), 0.0))

    def model(self, order: int, budget: Budget) -> Any | None:
        """The stable fit of an order; None where there is none: no response, too few points, no time."""
        if self._stated is None or order < 1 or budget.over:
            return None
        frf, weight = self._stated
        limit = None if math.isinf(budget.left) else max(budget.left, 1e-3)
        try:
            fit = fit_mfd(frf, order=order, weight=weight, domain="z", feedthrough=True, time_limit=limit)
        except (InputError, np.linalg.LinAlgError):
            return None
        if fit.status is FitStatus.INTERRUPTED:  # a fit ends at Ctrl-C, and so does the search
            raise KeyboardInterrupt
        return fit.model if fit.model.nstates == order and fit.stable else None
