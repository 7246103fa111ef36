"""One attempt at a fit: a first model, brought into fraction form, refined, kept stable."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import StateMatrices, response_at
from robustid.errors import InputError
from robustid.mfd.chains import input_priority
from robustid.mfd.iteration import FitStep, FractionFit, fit_fraction
from robustid.mfd.model import FractionModel, realise
from robustid.mfd.node_fraction import NodeFraction
from robustid.mfd.problem import FractionProblem
from robustid.mfd.rigid_body import RigidBody, rigid_modes, rigid_start
from robustid.mfd.state_fit import Samples, diagonal_blocks, fit_outputs, reflected
from robustid.mfd.steps import into_form

_HELD = 1e-6  # part of the smallest response, or of the gain asked for, that may be left of a condition
_PULLS = 4  # attempts to keep a reflected pole inside after the way back into fraction form


class Attempt(NamedTuple):
    """End of an attempt."""

    fit: FractionFit
    found: FractionModel
    start_cost: float
    reflected: int
    unstable_cost: float


@dataclasses.dataclass(frozen=True)
class Settings:
    """Choices of an attempt; see `fit_mfd`."""

    phases: list[str]
    body: RigidBody | None
    form: str
    stable: bool
    progress: Callable[[FitStep], None] | None


def attempt(problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings) -> Attempt:
    """Fit from a first model.

    Parameters
    ----------
    problem : FractionProblem
        Of a right fraction, without its rigid-body modes.
    data : Samples
        The same data for linear least squares.
    model : StateMatrices
        Of any order; only A and C matter with rigid-body modes.
    """
    if settings.body is not None:
        model, directions = rigid_start(data, model.A, model.C, settings.body, feedthrough=problem.feedthrough)
        problem = rigid_modes(problem, data, model, directions, settings.body)
    problem, first = _best_form(problem, model, data, "iv" not in settings.phases)
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
    return Attempt(fit, found, problem.cost(first), count if settings.stable else 0, cost)


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


def _best_form(
    problem: FractionProblem, model: StateMatrices, data: Samples, may_pair: bool
) -> tuple[FractionProblem, NodeFraction]:
    """Degrees by ones or by twos, whichever reproduces the first model better."""
    states = response_at((model.A, model.B, np.eye(len(model.A)), np.zeros(model.B.shape)), data.points)
    values = model.C @ states + model.D
    states = states / np.linalg.norm(values, axis=(1, 2), keepdims=True)
    forms: list[tuple[FractionProblem, NodeFraction]] = []
    for pairs in (False, True)[: 1 + may_pair]:
        priority = input_priority(model, states, 2 if pairs else 1)
        form = dataclasses.replace(problem, pairs=pairs, priority=priority)
        if not forms or not np.array_equal(form.degrees, forms[0][0].degrees):
            forms.append((form, into_form(form, values)))
    return min(forms, key=lambda form: _error(*form, values))


def _error(problem: FractionProblem, fraction: NodeFraction, values: np.ndarray) -> float:
    return dataclasses.replace(problem, values=values).cost(fraction)


def _stabilised(
    problem: FractionProblem,
    fit: FractionFit,
    found: FractionModel,
    first: NodeFraction,
    data: Samples,
    settings: Settings,
) -> FractionFit:
    """Descend among the stable models, from the fit with its poles reflected or from where it began."""

    def admit(fraction: NodeFraction) -> NodeFraction | None:
        model = realise(problem, fraction)
        return _reflection(problem, fraction, model, data, pulls=1) if np.any(unstable_poles(model)) else fraction

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
    A, B = found.matrices[:2]
    flexible = len(A) - 2 * found.rigid_count
    T, Z = scipy.linalg.schur(A[:flexible, :flexible])[:2]
    B = np.vstack([Z.T @ B[:flexible], B[flexible:]])
    T = reflected(T, data.points, data.domain)
    for pull in range(pulls):
        A = diagonal_blocks(T, A[flexible:, flexible:])
        model = StateMatrices(A, B, *fit_outputs(data, A, B, problem.feedthrough))
        start = into_form(problem, response_at(model, data.points), fraction.held)
        if not np.any(unstable_poles(realise(problem, start))):
            return start
        # The way into fraction form may move a pole by more than its distance from the boundary.
        shift = 10.0 ** (pull - 4)
        if problem.dt is None:
            T = T - shift * np.abs(scipy.linalg.eigvals(T)).min() * np.eye(flexible)
        else:
            T = T * (1 - shift)
    return None
