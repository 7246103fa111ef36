"""Fitting a matrix fraction: SK, IV, Gauss-Newton and Levenberg-Marquardt on one loop that keeps the best."""

from __future__ import annotations

import dataclasses
import enum
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robustid.core import Frozen, Progress, as_function, one_thread
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.fraction_steps import (
    Direction,
    gauss_newton_direction,
    minimum_norm_step,
    relaxed_step,
    retract,
    sk_step,
)
from robustid.fitting.fraction.instrumental import iv_step
from robustid.fitting.fraction.node_fraction import Held, NodeFraction, right_divide

_SK = {"sk": sk_step, "sk-relaxed": relaxed_step, "sk-minimum-norm": minimum_norm_step}
METHODS = (*_SK, "iv", "gn", "lm")
_HALVINGS = 8
# Length of a Gauss-Newton step in standard deviations of the parameters, all together: slope^2 = length^2/equations.
_TINY = 1e-2
_RTOL = 1e-10
_SMALL = 0.3
# SK, IV and Gauss-Newton aren't descent methods: they may rise before they fall, but not for ever.
_PATIENCE = 4
# They have done their work when they move the criterion by less; a fixed point of SK isn't a minimum of the criterion.
_CHANGE = {"iv": 1e-10, "gn": 1e-10} | dict.fromkeys(_SK, 1e-2)
_LIMIT = {"iv": 30, "gn": 30, "lm": 30} | dict.fromkeys(_SK, 20)


class FitStatus(enum.Enum):
    """Status of a fit; the value is the user's sentence."""

    STATIONARY = "converged", "the gradient of the criterion vanishes at the model, within 1 % of what noise does to it"
    FLAT = (
        "converged",
        "a full step no longer lowers the criterion, but for rounding or a part of what noise does to it",
    )
    EXACT = "exact", "the model passes through the data to 1e-10"
    SLOW = "almost converged", "the last steps lowered the criterion by less than 0.1 % together"
    BOUNDARY = "at the stability boundary", "the criterion falls further only through unstable poles"
    LIMIT = (
        "not converged",
        "the iteration limit was reached; fit again with `start` = the model found, to go on from there",
    )
    STALLED = "not converged", "no step along the Gauss-Newton direction lowers the criterion; give another `start`"
    TIME = (
        "stopped at the time limit",
        "the best model so far; give a larger `time_limit`, or `start` = the model found",
    )
    INTERRUPTED = "interrupted", "the best model so far; fit again with `start` = the model found, to go on from there"

    head: str
    reason: str

    def __new__(cls, head: str, reason: str) -> FitStatus:
        """Make the sentence of its head and its reason."""
        one = object.__new__(cls)
        one._value_, one.head, one.reason = f"{head}: {reason}", head, reason
        return one

    @property
    def converged(self) -> bool:
        """True if the criterion is at a local minimum as far as double precision tells."""
        return self in (FitStatus.STATIONARY, FitStatus.FLAT, FitStatus.EXACT)


class FitStep(NamedTuple):
    """One line of the history: what was done and what it gave."""

    method: str  # as in `fit_fraction`
    cost: float  # criterion after the step, sum |W vec(P_o - P)|^2
    condition: float  # of the normal matrix that the step solved for coefficients
    step: float  # 1 for a full step, less when damped
    slope: float  # before the step: part of the residual in the tangent space (gn, lm); nan (sk, iv)
    former: str = ""  # in words, where the cost is that of a former criterion: in another weight, or without structure

    @property
    def words(self) -> str:
        """The method, and which former criterion it lowered."""
        return f"{self.method} {self.former}".rstrip()


def counted_steps(progress: Progress | None) -> Callable[[FitStep], None] | None:
    """Receiver of the steps of a fit, who tells how many there were and what the last one gave."""
    if (tell := as_function("progress", progress)) is None:
        return None
    numbers = itertools.count(1)

    def told(step: FitStep) -> None:
        tell(f"{step.method}, cost {step.cost:.6g}, kappa - 1 = {step.condition - 1:.1e}", next(numbers), 0)

    return told


def former_weight(number: int) -> str:
    """The words for the steps in a weight that was changed, the first of them 1."""
    return f"in weight {number}"


def former(history: tuple[FitStep, ...], words: str) -> tuple[FitStep, ...]:
    """Steps whose cost is that of a former criterion, which the words tell."""
    return tuple(step._replace(former=words) for step in history)


@dataclasses.dataclass(frozen=True, eq=False)
class FractionFit(Frozen):
    """The best fraction that an iteration met, and how it got there."""

    problem: FractionProblem
    fraction: NodeFraction
    cost: float
    status: FitStatus
    history: tuple[FitStep, ...]


def phases_of(method: object) -> list[str]:
    """The phases of a method such as "sk+lm"."""
    phases = method.split("+") if isinstance(method, str) else []
    if not phases or not all(phase in METHODS for phase in phases):
        known = ", ".join(f'"{name}"' for name in METHODS)
        raise InputError(f'`method` must be one of {known}, or several of them joined by "+"; got {method!r}')
    return phases


@one_thread()
def fit_fraction(
    problem: FractionProblem,
    *,
    denominators: np.ndarray | None = None,
    start: NodeFraction | None = None,
    method: str = "sk+lm",
    steps: int | None = None,
    rtol: float | None = None,
    admit: Callable[[NodeFraction], NodeFraction | None] | None = None,
    report: Callable[[FitStep], None] | None = None,
) -> FractionFit:
    """Run the phases of a method one after the other, each from the best fraction of the ones before.

    SK starts at `denominators`, (F, nu, nu), else at those of `start`, a fraction in the form of the problem than which the
    result is never worse, else at the identity. `method` is "sk", "sk-relaxed", "sk-minimum-norm" (one input), "iv", "gn",
    "lm" or several, "sk+lm"; each phase takes `steps` at most, by default 20 (SK) or 30. It has converged when a
    Gauss-Newton step promises, or a full step brings, a relative fall of the criterion below `rtol`: 1e-10, or what a step
    of 0.01 standard deviations of the parameters, all together, would bring. `admit` gives a fraction back, or an
    admissible one in its place (its poles reflected), or None.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.fitting import Weight
    >>> omega = np.linspace(1, 9, 40)
    >>> values = (1 / ((1j * omega) ** 2 + 0.2j * omega + 16))[:, None, None]
    >>> fit = fit_fraction(FractionProblem(omega, values, 2, Weight.relative(values)))
    >>> fit.status.name
    'EXACT'
    """
    phases = phases_of(method)
    if "iv" in phases and (problem.conditions or problem.rigid is not None):
        raise InputError('`method` "iv" takes no constraints and no rigid body; use "lm"')
    if start is None and phases[0] not in _SK:
        raise InputError(f"`start` is needed for method {method!r}: only SK begins without a fraction")
    run = _Run(problem, start, rtol, admit, report)
    for phase in phases:
        limit = _LIMIT[phase] if steps is None else steps
        if run.cost <= run.exact:
            break
        if phase == "lm":
            run.descend(limit)
        else:
            run.wander(phase, limit, denominators)
            denominators = None
    if run.best is None or not np.isfinite(run.cost):
        raise InputError("`denominators` (or `start`) must be nonsingular at every frequency point; give another start")
    status = FitStatus.EXACT if run.cost <= run.exact else run.status
    return FractionFit(problem, run.best, run.cost, status, tuple(run.history))


class _Run:
    """State of a fit: the best so far and the history."""

    def __init__(
        self,
        problem: FractionProblem,
        start: NodeFraction | None,
        rtol: float | None,
        admit: Callable[[NodeFraction], NodeFraction | None] | None,
        report: Callable[[FitStep], None] | None,
    ) -> None:
        self.problem, self.admit, self.report = problem, admit, report
        self.best, self.cost = start, np.inf if start is None else problem.cost(start)
        self.exact = problem.rounding
        self.rtol = max(_RTOL, _TINY**2 / problem.equations) if rtol is None else rtol
        # What is left then lies within the noise: worth a step, but no search.
        self.enough = _SMALL**2 / problem.equations if rtol is None else 0.0
        self.status = FitStatus.LIMIT
        self.history: list[FitStep] = []

    def record(self, step: FitStep) -> None:
        """Add to the history."""
        self.history.append(step)
        if self.report is not None:
            self.report(step)

    def wander(self, phase: str, limit: int, denominators: np.ndarray | None) -> None:
        """SK, IV or full Gauss-Newton steps: they go on from the last fraction, not from the best."""
        problem, current = self.problem, self.best
        if denominators is None and current is not None:
            denominators = current.denominators
        if denominators is None:
            count = problem.values.shape[2]
            denominators = np.broadcast_to(np.eye(count), (problem.omega.size, count, count))
        last, worse = np.inf, 0
        self.status = FitStatus.LIMIT
        for _ in range(limit):
            slope = np.nan
            try:
                if phase in _SK or current is None:
                    held = Held() if current is None else current.held
                    current, condition = _SK[phase](problem, denominators, held)
                elif phase == "iv":
                    current, condition = iv_step(problem, current)
                else:
                    direction = gauss_newton_direction(problem, current)
                    slope, condition = direction.slope, direction.condition
                    if slope**2 <= self.rtol:
                        self.status = FitStatus.STATIONARY
                        return
                    current = _along(problem, current, direction.fraction, 1.0)
            except np.linalg.LinAlgError:  # singular at a point: no way on from there
                self.status = FitStatus.STALLED
                return
            denominators, reached = current.denominators, problem.cost(current)
            self.record(FitStep(phase, reached, condition, 1.0, slope))
            worse = worse + 1 if reached >= self.cost else 0
            if reached < self.cost and (self.admit is None or self.admit(current) is current):
                self.best, self.cost = current, reached
            if self.cost <= self.exact:
                return
            if abs(last - reached) <= _CHANGE[phase] * reached:
                self.status = FitStatus.LIMIT if phase in _SK else FitStatus.FLAT
                return
            if worse >= _PATIENCE:
                self.status = FitStatus.STALLED
                return
            last = reached

    def descend(self, limit: int) -> None:
        """Levenberg-Marquardt: every accepted step is the best so far."""
        self.status = FitStatus.LIMIT
        for _ in range(limit):
            if self.best is None or self.cost <= self.exact:
                return
            direction = gauss_newton_direction(self.problem, self.best)
            if direction.slope**2 <= self.rtol:
                self.status = FitStatus.STATIONARY
                return
            enough = direction.slope**2 <= self.enough
            trial, reached, step, barred = self.search(self.best, direction, 1 if enough else _HALVINGS)
            if trial is None:
                self.status = FitStatus.FLAT if enough else FitStatus.BOUNDARY if barred else FitStatus.STALLED
                return
            fall = (self.cost - reached) / self.cost
            self.best, self.cost = trial, reached
            self.record(FitStep("lm", reached, direction.condition, step, direction.slope))
            if fall <= self.rtol and step == 1.0:
                self.status = FitStatus.FLAT
                return

    def search(
        self, best: NodeFraction, direction: Direction, halvings: int
    ) -> tuple[NodeFraction | None, float, float, bool]:
        """The longest of the steps 1, 1/2, 1/4, ... that lowers the criterion: (fraction, cost, step, barred)."""
        step, barred = 1.0, False
        for _ in range(halvings):
            promised = step * (2 - step) * direction.slope**2 * self.cost
            trial, reached = _cheapest(self.problem, best, direction.fraction, step, self.cost - 0.5 * promised)
            if reached < self.cost:
                other = trial if self.admit is None else self.admit(trial)
                reached = reached if other is trial else np.inf if other is None else self.problem.cost(other)
                if reached < self.cost:
                    return other, reached, step, False
                barred = True
            step /= 2
        return None, self.cost, 0.0, barred


def _cheapest(
    problem: FractionProblem, best: NodeFraction, direction: NodeFraction, step: float, enough: float
) -> tuple[NodeFraction, float]:
    """The moved fraction; where it doesn't keep what the linear model promises, the fraction nearest to that model. Moving D
    and N moves a lightly damped pole only as long as the move is small against its damping; moving the response, of which the
    Jacobian speaks, and coming back has no such limit. Constraints that aren't linear allow nothing else.
    """
    trial, reached = best.moved(step, direction), np.inf
    if direction.held.directions is None and direction.held.highest is None:
        reached = problem.cost(trial)
    for columnwise, steps in ((2, 0), (0, 2), (0, 4)):
        if reached <= enough:
            break
        try:
            other = _along(problem, best, direction, step, columnwise=columnwise, steps=steps)
        except np.linalg.LinAlgError:
            continue
        cost = problem.cost(other)
        if cost < reached:
            trial, reached = other, cost
    return trial, reached


def _along(
    problem: FractionProblem,
    best: NodeFraction,
    direction: NodeFraction,
    step: float,
    *,
    columnwise: int = 1,
    steps: int = 1,
) -> NodeFraction:
    """The fraction nearest to the response plus a step in the tangent space."""
    response = best.response
    change = right_divide(direction.numerators - response @ direction.denominators, best.denominators)
    held = best.moved(step, direction).held
    return retract(problem, response + step * change, best.denominators, held, columnwise=columnwise, steps=steps)
