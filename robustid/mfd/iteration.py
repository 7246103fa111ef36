"""Fitting a matrix fraction: Sanathanan-Koerner and Levenberg-Marquardt on one loop, condition number one."""

from __future__ import annotations

import dataclasses
import enum
from typing import NamedTuple

import numpy as np

from robustid._arrays import Frozen
from robustid.errors import InputError
from robustid.mfd.problem import FractionProblem, NodeFraction, right_divide

# A residual of this part of the weighted data is rounding: D is ill-conditioned on the lines near lightly damped poles.
_EXACT = 1e-10
_HALVINGS = 8
# SK isn't a descent method: it may rise before it falls, but not for ever.
_PATIENCE = 4
# SK has done its work when it moves the criterion by less; its fixed points aren't the minima of the criterion.
_SK_CHANGE = 1e-2
_RETRACTIONS = 2


class FitStatus(enum.Enum):
    """How a fit ended; the value is the user's sentence."""

    STATIONARY = "converged: the gradient of the criterion vanishes at the model"
    FLAT = "converged: a full step no longer lowers the criterion by the relative amount asked"
    EXACT = "exact: the model passes through the data to 1e-10"
    LIMIT = "not converged: the iteration limit was reached; allow more steps"
    STALLED = "not converged: no step along the Gauss-Newton direction lowers the criterion; try another start"

    @property
    def converged(self) -> bool:
        """Whether the criterion is at a local minimum as far as double precision tells."""
        return self in (FitStatus.STATIONARY, FitStatus.FLAT, FitStatus.EXACT)


class FitStep(NamedTuple):
    """One line of the history: what was done and what it gave."""

    method: str  # "sk" or "lm"
    cost: float  # criterion after the step, sum |W vec(P_o - P)|^2
    condition: float  # of the normal matrix of the step
    step: float  # 1 for a full step, less when damped
    slope: float  # before the step: part of the residual in the tangent space (lm); nan (sk)


@dataclasses.dataclass(frozen=True, eq=False)
class FractionFit(Frozen):
    """The best fraction that an iteration met, and how it got there.

    Attributes
    ----------
    problem : FractionProblem
    fraction : NodeFraction
    cost : float
    status : FitStatus
    history : tuple of FitStep
    """

    problem: FractionProblem
    fraction: NodeFraction
    cost: float
    status: FitStatus
    history: tuple[FitStep, ...]


def sk_step(problem: FractionProblem, denominators: np.ndarray) -> tuple[NodeFraction, float]:
    """One Sanathanan-Koerner step: minimise ``sum |W (D_old^{-T} kron [P_o -I]) vec([D; N])|^2``.

    In the basis that these data make orthonormal the solution is the leading term made orthogonal to the free ones.

    Parameters
    ----------
    denominators : (F, nu, nu) complex array
        D_old at the lines; any function that is nonsingular there will do.

    Returns
    -------
    fraction : NodeFraction
    condition : float
        Of the normal matrix.
    """
    basis = problem.basis(denominators, problem.values)
    solution = basis.monic(problem.leading)
    return problem.split(basis.evaluate(basis.xi, *solution[:3])), basis.condition


def gauss_newton_direction(problem: FractionProblem, fraction: NodeFraction) -> tuple[NodeFraction, float, float]:
    """Gauss-Newton direction of the true criterion, from ``d vec(P) = -(D^{-T} kron [P -I]) vec(d[D; N])``.

    The Jacobian's columns are orthonormal, so that the direction is minus the projection of the residual, and
    Levenberg-Marquardt's damping in these coordinates is a shorter step along it.

    Returns
    -------
    direction : NodeFraction
    slope : float
        Part of the residual that lies in the tangent space: 0 at a stationary point, at most 1.
    condition : float
        Of the normal matrix.
    """
    response = fraction.response
    basis = problem.basis(fraction.denominators, response)
    residual = problem.residual(response)
    coordinates = -basis.project(residual)
    size = float(np.linalg.norm(residual))
    slope = float(np.linalg.norm(coordinates)) / size if size > 0 else 0.0
    return problem.split(basis.evaluate(basis.xi, coordinates)), slope, basis.condition


def retract(
    problem: FractionProblem, response: np.ndarray, denominators: np.ndarray, *, steps: int = _RETRACTIONS
) -> NodeFraction:
    """A fraction of the problem's form close to a response that nearly has one.

    SK with the response in place of the data: exact data are reproduced in about two steps from any start, and what is
    off by e comes back with an error of the order of e.

    Parameters
    ----------
    response : (F, ny, nu) complex array
    denominators : (F, nu, nu) complex array
        Start.
    """
    target = dataclasses.replace(problem, values=response)
    best, error = None, np.inf
    for _ in range(steps):
        fraction, _ = sk_step(target, denominators)
        reached = target.cost(fraction)
        if best is None or reached < error:
            best, error = fraction, reached
        denominators = fraction.denominators
    if best is None:
        raise InputError("`steps` must be at least 1")
    return best


def fit_fraction(
    problem: FractionProblem,
    *,
    denominators: np.ndarray | None = None,
    start: NodeFraction | None = None,
    sk: int = 20,
    lm: int = 30,
    rtol: float = 1e-10,
) -> FractionFit:
    """Sanathanan-Koerner steps from a denominator, then Levenberg-Marquardt from the best of them.

    Parameters
    ----------
    denominators : (F, nu, nu) complex array, optional
        Where SK starts; default the identity, or those of `start`.
    start : NodeFraction, optional
        A fraction in the form of the problem (from an earlier fit, or `retract`); the result is never worse.
    sk, lm : int
        Largest number of steps of each kind.
    rtol : float
        Converged when a Gauss-Newton step promises, or a full step brings, a relative fall of the criterion below this.

    Returns
    -------
    FractionFit

    Raises
    ------
    InputError
        When a start is singular on a line.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.mfd.criterion import Weight
    >>> omega = np.linspace(1, 9, 40)
    >>> values = (1 / ((1j * omega) ** 2 + 0.2j * omega + 16))[:, None, None]
    >>> fit = fit_fraction(FractionProblem(omega, values, 2, Weight.relative(values)))
    >>> fit.status.name
    'EXACT'
    """
    count = problem.values.shape[2]
    exact = (_EXACT * float(np.linalg.norm(problem.weight.apply(problem.values)))) ** 2
    best, cost = start, np.inf if start is None else problem.cost(start)
    history: list[FitStep] = []
    if denominators is None:
        denominators = np.broadcast_to(np.eye(count), (problem.omega.size, count, count))
        denominators = denominators if start is None else start.denominators
    last, worse = np.inf, 0
    for _ in range(sk):
        try:
            fraction, condition = sk_step(problem, denominators)
        except np.linalg.LinAlgError:  # singular on a line: SK can't go on from there
            break
        reached = problem.cost(fraction)
        history.append(FitStep("sk", reached, condition, 1.0, np.nan))
        worse = worse + 1 if reached >= cost else 0
        if reached < cost:
            best, cost = fraction, reached
        if cost <= exact or worse >= _PATIENCE or abs(last - reached) <= _SK_CHANGE * reached:
            break
        last, denominators = reached, fraction.denominators
    if best is None or not np.isfinite(cost):
        raise InputError("`denominators` (or `start`) must be nonsingular on every line; give another start")
    return _levenberg_marquardt(problem, best, cost, history, lm, rtol, exact)


def _levenberg_marquardt(
    problem: FractionProblem,
    best: NodeFraction,
    cost: float,
    history: list[FitStep],
    steps: int,
    rtol: float,
    exact: float,
) -> FractionFit:
    status = FitStatus.LIMIT
    for _ in range(steps):
        if cost <= exact:
            break
        direction, slope, condition = gauss_newton_direction(problem, best)
        if slope**2 <= rtol:
            status = FitStatus.STATIONARY
            break
        trial, reached, step = _search(problem, best, cost, direction, slope)
        if trial is None:
            status = FitStatus.STALLED
            break
        fall, best, cost = (cost - reached) / cost, trial, reached
        history.append(FitStep("lm", cost, condition, step, slope))
        if fall <= rtol and step == 1.0:
            status = FitStatus.FLAT
            break
    if cost <= exact:
        status = FitStatus.EXACT
    return FractionFit(problem, best, cost, status, tuple(history))


def _search(
    problem: FractionProblem, best: NodeFraction, cost: float, direction: NodeFraction, slope: float
) -> tuple[NodeFraction | None, float, float]:
    """The first step along the direction that lowers the criterion: (fraction or None, cost, step).

    The coefficients are strongly curved coordinates: a change of the response by 0.4 % may multiply D by a thousand,
    and a step along them may fail at 1/64 of its length. So where the straight step brings less than half of what it
    promises, the response ``P + step dP`` is taken as it stands and brought back to a fraction by SK.
    """
    response = best.response
    change = right_divide(direction.numerators - response @ direction.denominators, best.denominators)
    step = 1.0
    for _ in range(_HALVINGS):
        trial = best.moved(step, direction)
        reached = problem.cost(trial)
        promised = step * (2 - step) * slope**2 * cost
        if cost - reached < 0.5 * promised:
            try:
                other = retract(problem, response + step * change, best.denominators)
            except np.linalg.LinAlgError:
                other = trial
            if problem.cost(other) < reached:
                trial, reached = other, problem.cost(other)
        if reached < cost:
            return trial, reached, step
        step /= 2
    return None, cost, 0.0
