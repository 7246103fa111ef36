"""A small model beside least-squares fits of a frequency response: the order that the data carry, what is significantly worse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.special

from robustid.core import Budget, Real, pass_on
from robustid.data import FrequencyResponse, TimeRecord
from robustid.fitting import MatrixFraction, OrderSweep, RigidBody, orders_fitted
from robustid.identification import Identification
from robustid.reduction.balanced import Reduction
from robustid.reduction.drawn_inside import Structure
from robustid.reduction.record_simulations import AS_WELL, with_transients

if TYPE_CHECKING:
    import control

MOST = 12  # order of the fits that are looked at
AT_ONE = 1e-6  # a pole so near z = 1 is an integrator
_SURE = 0.95  # probability of the F-test
# Of the smallest error at withheld points: what the fit of the right order may have, as in suggest_order.
_PREDICTS = 1.25


def why_not_compared(
    identification: Identification,
    smallest: Reduction,
    frf: FrequencyResponse | None,
    records: Sequence[TimeRecord] = (),
) -> str:
    """Why least-squares fits can't be compared with a small model, in a sentence; empty where they can."""
    begin, integrators = (
        "The small model was not compared with least-squares fits: ",
        integrators_of(identification, smallest),
    )
    if integrators and integrators != 2 * _heads(identification):
        return begin + "it has integrators that are no rigid-body modes, which these fits do not keep."
    if frf is None:
        if integrators or not with_transients(records):
            return begin + "there is no frequency response, whose misfit could be compared."
    elif _largest_order(identification, frf) < max(1, integrators):
        return begin + f"{frf.omega.size} frequency points are too few to tell orders apart."
    return ""


def integrators_of(identification: Identification, smallest: Reduction | MatrixFraction) -> int:
    """Number of poles at z = 1."""
    basis = identification.problem.parametric
    held = int(np.sum(np.abs(smallest.model.poles() - 1) < AT_ONE)) if identification.problem.dt else 0
    return max(held, int(basis is not None and basis.has_integrator))


def _heads(identification: Identification) -> int:
    """Signals on the side with fewer of them: so many rigid-body modes are the most."""
    return min(identification.problem.entries.shape)


def response_sweep(
    identification: Identification, smallest: Reduction, frf: FrequencyResponse, budget: Budget
) -> OrderSweep:
    """Least-squares fits of the frequency response, with the rigid-body modes of the model."""
    orders = range(max(1, integrators_of(identification, smallest)), _largest_order(identification, frf) + 1)
    options = {"weight": _weight(frf), **structure_of(identification, smallest)}
    sweep, _ = orders_fitted(frf, options, budget.share(1.0), orders=orders)
    pass_on(sweep.interrupted)
    return sweep


def structure_of(identification: Identification, smallest: Reduction) -> Structure:
    """Structure of the fits: that of the small model."""
    problem = identification.problem
    return {
        "domain": "z" if problem.dt else "s",
        "feedthrough": problem.parametric is not None and bool(np.any(problem.parametric.D)),
        "rigid_body": RigidBody(_heads(identification)) if integrators_of(identification, smallest) else None,
    }


def _largest_order(identification: Identification, frf: FrequencyResponse) -> int:
    entries = identification.problem.entries
    return min(MOST, frf.omega.size * entries.count // (2 * sum(entries.shape)))


def _weight(frf: FrequencyResponse) -> Real | None:
    """One over the bounds, where there is no covariance."""
    if frf.covariance is not None or frf.bound is None:
        return None
    radius = np.where(frf.missing, np.inf, frf.bound.outer_radius)
    return np.where(np.isfinite(radius) & (radius > 0), 1 / np.where(radius > 0, radius, 1.0), 0.0)


class ResponseJudge:
    """The misfit of models at the frequency points, and what is significantly above that of the fit of the order carried."""

    def __init__(self, identification: Identification, sweep: OrderSweep):
        # the smallest order whose error at withheld points is within a quarter of the best; else that of least MDL
        usable = (sweep.parameters <= sweep.equations / 2) & (sweep.unresolved == 0)
        usable = usable if usable.any() else np.ones(usable.size, bool)
        judged = usable & np.isfinite(sweep.withheld)
        self.carried = (
            int(sweep.orders[judged & (sweep.withheld <= _PREDICTS * sweep.withheld[judged].min())][0])
            if judged.any()
            else int(sweep.orders[usable][np.argmin(sweep.mdl[usable])])
        )
        self.fit, self._plane = sweep.fits[self.carried], identification.problem.plane
        place = int(np.flatnonzero(sweep.orders == self.carried)[0])
        self._signals, self._parameters = sum(identification.problem.entries.shape), int(sweep.parameters[place])
        self._count, self._best = sweep.equations, float(sweep.costs[place])

    def cost(self, model: control.StateSpace) -> float:
        """Weighted sum of squares."""
        left = self.fit.problem.values - self._plane.values_at(model, self.fit.problem.omega)
        return float(np.linalg.norm(self.fit.problem.weight.apply(left)) ** 2)

    def worse(self, cost: float, order: int) -> bool:
        """Return whether a misfit is significantly and noticeably above that of the fit of the order carried."""
        if cost <= AS_WELL**2 * self._best:
            return False
        extra = max(self._parameters - order * self._signals, 1)
        free = max(self._count - self._parameters, 1)
        ratio = (cost - self._best) / extra / max(self._best / free, np.finfo(float).tiny)
        return float(scipy.special.fdtr(extra, free, ratio)) > _SURE

    def rms(self, cost: Real | float) -> Real:
        """Root mean square from a sum of squares."""
        return np.sqrt(cost / max(self._count, 1))
