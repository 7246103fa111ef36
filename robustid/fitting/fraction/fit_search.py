"""A fit from one start: a first model, refined as a state space or as a fraction, brought into fraction form, kept stable."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Complex, StateMatrices, response_at
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_iteration import FractionFit, fit_fraction
from robustid.fitting.fraction.fraction_model import FractionModel, realise
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.fraction_steps import formed_further, into_form
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.state_space.given_poles import Samples, diagonal_blocks, fit_outputs, reflected
from robustid.fitting.state_space.state_descent import Settings, best_form, descended, refinable, with_rigid_modes

_HELD = 1e-6  # part of the smallest response, or of the gain asked for, that may be left of a condition
FORMED = 1e-6  # part of the cost that forming the fraction may add
_PULLS = 4  # tries to keep a reflected pole inside after the way back into fraction form


class FitEnd(NamedTuple):
    """End of a fit from one start."""

    fit: FractionFit
    found: FractionModel
    start: Complex  # response of the start
    reflected: int
    unstable_cost: float
    refined: bool = False  # in state-space coordinates
    early: bool = False  # ended by `Settings.enough`

    @property
    def start_cost(self) -> float:
        """Cost of the start, in the weight of the end."""
        cost = float(np.linalg.norm(self.fit.problem.residual(self.start))) ** 2
        return cost if math.isfinite(cost) else math.inf


def fit_from(problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings) -> FitEnd:
    """Fit a right fraction, posed without its rigid-body modes, from a first model of any order; only its A and C matter with
    rigid-body modes. `data` are the same for linear least squares.
    """
    problem, model = with_rigid_modes(problem, data, model, settings.body)
    if settings.phases == ["lm"] and refinable(problem):
        return _refined(problem, data, model, settings)
    problem, first = best_form(problem, model, data, "iv" not in settings.phases)
    fit = fit_fraction(problem, start=first, method="+".join(settings.phases), report=settings.progress)
    if not fit.status.converged and "lm" in settings.phases:
        again = fit_fraction(problem, start=fit.fraction, method="sk-relaxed+lm", report=settings.progress)
        fit = dataclasses.replace(again, history=fit.history + again.history)
    found = realise(problem, fit.fraction, form=settings.form)
    count = int(np.sum(unstable_poles(found)))
    cost = np.nan
    if settings.stable and count:
        cost = fit.cost
        fit = _stabilised(problem, fit, found, first, data, settings)
        found = realise(problem, fit.fraction, form=settings.form)
    _check_conditions(problem, found)
    return FitEnd(fit, found, first.response, count if settings.stable else 0, cost)


def formed(
    problem: FractionProblem, data: Samples, model: StateMatrices, enough: float
) -> tuple[FractionProblem, NodeFraction]:
    """The fraction of a state space, by as many steps as it takes to have this cost."""
    problem, nodes = best_form(problem, model, data, True, full=False)
    if problem.cost(nodes) > enough:
        nodes = formed_further(problem, nodes, response_at(model, data.points))
    return problem, nodes


def _refined(problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings) -> FitEnd:
    """The fit in state-space coordinates; the fraction is formed of its end."""
    problem, end, refined, start, count, free_cost, early = descended(problem, data, model, settings)
    enough = max((1 + FORMED) * refined.fitted.cost, problem.rounding)
    problem, nodes = formed(problem, data, end, enough)
    fit = FractionFit(problem, nodes, problem.cost(nodes), refined.status, refined.history)
    if fit.cost > enough:
        # Not a generic system: its degrees aren't those of the staircase.
        admit = functools.partial(_admitted, problem, data) if settings.stable else None
        fit = fit_fraction(problem, start=nodes, method="lm", admit=admit, report=settings.progress)
        fit = dataclasses.replace(fit, history=refined.history + fit.history)
    found = realise(problem, fit.fraction, form=settings.form)
    if settings.stable and np.any(unstable_poles(found)):  # forming the fraction moved a pole by more than its damping
        inside = _reflection(problem, fit.fraction, found, data)
        if inside is not None:
            fit = dataclasses.replace(fit, fraction=inside, cost=problem.cost(inside))
            found = realise(problem, inside, form=settings.form)
    _check_conditions(problem, found)
    return FitEnd(fit, found, start, count, free_cost, True, early)


def _admitted(problem: FractionProblem, data: Samples, fraction: NodeFraction) -> NodeFraction | None:
    """The fraction, or one with its unstable poles reflected."""
    model = realise(problem, fraction)
    return _reflection(problem, fraction, model, data, pulls=1) if np.any(unstable_poles(model)) else fraction


def _check_conditions(problem: FractionProblem, found: FractionModel) -> None:
    """Conditions that contradict each other are met by N = D = 0, a pole and zero that cancel, and not by the response."""
    nu = problem.values.shape[2]
    for condition in problem.conditions:
        point = problem.scale * condition.point
        for left, _ in condition.terms:
            values = response_at(found.matrices, point)[0]
            with np.errstate(invalid="ignore"):  # inf on a pole
                remainder = left[:, :nu] + left[:, nu:] @ values
            size = max(float(np.abs(left[:, :nu]).max()), float(np.abs(problem.values).min()))
            if not np.all(np.abs(remainder) <= _HELD * size):
                raise InputError(
                    "`constraints` contradict each other or the data at"
                    f" {'s' if problem.dt is None else 'z'} = {point:g}: the fit meets them only with a pole and a zero"
                    " that cancel there; take one away"
                )


def unstable_poles(fraction: FractionModel) -> np.ndarray:
    """Mask of the poles outside the stability region, those of rigid-body modes left aside."""
    poles = fraction.poles[: len(fraction.poles) - 2 * fraction.rigid_count]
    return np.real(poles) >= 0 if fraction.dt is None else np.abs(poles) >= 1


def _stabilised(
    problem: FractionProblem,
    fit: FractionFit,
    found: FractionModel,
    first: NodeFraction,
    data: Samples,
    settings: Settings,
) -> FractionFit:
    """Descend among the stable models, from the fit with its poles reflected or from where it began."""
    admit = functools.partial(_admitted, problem, data)
    starts = [_reflection(problem, fit.fraction, found, data), first if admit(first) is first else None]
    begin = min((start for start in starts if start is not None), key=problem.cost, default=None)
    if begin is None:
        return fit
    end = fit_fraction(problem, start=begin, method="lm", admit=admit, report=settings.progress)
    return dataclasses.replace(end, history=fit.history + end.history)


def _reflection(
    problem: FractionProblem, fraction: NodeFraction, found: FractionModel, data: Samples, *, pulls: int = _PULLS
) -> NodeFraction | None:
    """The fraction with its unstable poles reflected and the outputs fitted anew."""
    before = found.matrices
    flexible = len(before.A) - 2 * found.rigid_count
    T, Z = scipy.linalg.schur(before.A[:flexible, :flexible])[:2]
    B = np.vstack([Z.T @ before.B[:flexible], before.B[flexible:]])
    inside = reflected(T, data.points, data.domain)
    for pull in range(pulls):
        A = diagonal_blocks(inside, before.A[flexible:, flexible:])
        model = StateMatrices(A, B, *fit_outputs(data, A, B, problem.feedthrough))
        start = into_form(problem, response_at(model, data.points), fraction.held)
        if not np.any(unstable_poles(realise(problem, start))):
            return start
        # The way into fraction form may move a pole by more than its distance from the boundary.
        shift = 10.0 ** (pull - 4)
        if problem.dt is None:
            inside = inside - shift * np.abs(scipy.linalg.eigvals(inside)).min() * np.eye(flexible)
        else:
            inside = inside * (1 - shift)
    return None
