"""fit_mfd(): from a frequency response to a matrix fraction at the maximum-likelihood optimum, from a cold start."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid._arrays import Frozen, as_count
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.mfd.criterion import Weight
from robustid.mfd.iteration import FitStatus, FitStep, fit_fraction, retract
from robustid.mfd.model import FractionModel, realise
from robustid.mfd.problem import FractionProblem, NodeFraction
from robustid.mfd.subspace import subspace_estimate

_RETRACTIONS = 8  # SK steps on a noise-free response; two suffice up to order 40


@dataclasses.dataclass(frozen=True, eq=False)
class MatrixFraction(Frozen):
    """A fitted model P = N D^{-1} (or D^{-1} N), and how it was found.

    Attributes
    ----------
    fraction : FractionModel
        Polynomials and realisation.
    cost : float
        ``sum_k |W(k) vec(P_k - model)|^2`` over the lines.
    start_cost : float
        The same of the start; the fit is never worse.
    status : FitStatus
    history : tuple of FitStep
        Cost, condition number and step of every iteration.
    """

    fraction: FractionModel
    cost: float
    start_cost: float
    status: FitStatus
    history: tuple[FitStep, ...]

    @property
    def model(self) -> Any:
        """The `control.StateSpace`, of order = McMillan degree."""
        return self.fraction.model

    @property
    def condition_numbers(self) -> np.ndarray:
        """Condition number of the normal matrix, one per iteration."""
        return np.array([step.condition for step in self.history])

    @property
    def stable(self) -> bool:
        """Whether every pole lies inside the stability region. The fit does not enforce it."""
        poles = self.fraction.poles
        return bool(np.all(np.real(poles) < 0 if self.fraction.dt is None else np.abs(poles) < 1))


def fit_mfd(
    frf: FrequencyResponse,
    *,
    order: int,
    domain: str | None = None,
    form: str = "right",
    weight: Weight | None = None,
    feedthrough: bool = False,
    start: Any = None,
) -> MatrixFraction:
    """Fit a matrix fraction of a given McMillan degree by least squares on the weighted residuals.

    Subspace estimate, brought into fraction form by Sanathanan-Koerner steps on its noise-free response, then
    Levenberg-Marquardt, all in polynomials that these data make orthonormal: every normal matrix has condition number one.

    Parameters
    ----------
    frf : FrequencyResponse
    order : int
        McMillan degree.
    domain : {"s", "z"}, optional
        Default "z" where the data have a sample time, else "s".
    form : {"right", "left"}
        N D^{-1} or D^{-1} N.
    weight : Weight, optional
        Of the residual (not its square). Default: the covariance of the data where they have one (maximum likelihood),
        else relative, 1/|P| per entry.
    feedthrough : bool
        Whether P(infinity) may differ from 0.
    start : control.StateSpace, optional
        A model to start from in place of the subspace estimate; any order.

    Returns
    -------
    MatrixFraction

    Raises
    ------
    InputError, InputTypeError
        Wrong arguments; an order larger than the data allow; a singular covariance.

    Notes
    -----
    Source: `voorhoeve2016`, `mckelvey1996`. Stability is not enforced: see `MatrixFraction.stable`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.mfd import fit_mfd
    >>> omega = np.linspace(1, 9, 60)
    >>> frf = rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16))
    >>> fit = fit_mfd(frf, order=2)
    >>> fit.model.nstates, fit.stable, fit.status.converged
    (2, True, True)
    """
    if not isinstance(frf, FrequencyResponse):
        raise InputTypeError(f"`frf` must be a FrequencyResponse; got {type(frf).__name__}")
    if form not in ("right", "left"):
        raise InputError(f'`form` must be "right" or "left"; got {form!r}')
    domain = ("s" if frf.dt is None else "z") if domain is None else domain
    if domain not in ("s", "z") or (domain == "z" and frf.dt is None):
        raise InputError(
            f'`domain` must be "s", or "z" for data with a sample time `dt`; got {domain!r}, dt = {frf.dt}'
        )
    order, dt = as_count("order", order, least=1), frf.dt if domain == "z" else None
    weight = _default_weight(frf) if weight is None else weight
    problem = FractionProblem(frf.omega, frf.values, order, weight, dt=dt, feedthrough=feedthrough)
    points = 1j * frf.omega if dt is None else np.exp(1j * frf.omega * dt)
    if start is None:
        entries = _entry_weight(frf, weight)
        found = subspace_estimate(frf.values, points, order, weight=entries, feedthrough=feedthrough, domain=domain)
        response = found.response(points)
    else:
        response = _response(start, frf, points)
    if form == "left":
        problem, response = problem.transposed(), response.transpose(0, 2, 1)
    first = _into_form(problem, response)
    fit = fit_fraction(problem, start=first, sk=0)
    return MatrixFraction(
        realise(problem, fit.fraction, form=form), fit.cost, problem.cost(first), fit.status, fit.history
    )


def _into_form(problem: FractionProblem, response: np.ndarray) -> NodeFraction:
    """The fraction of the problem's form that is nearest to a response, as far as a few SK steps find it."""
    lines, nu = problem.omega.size, problem.values.shape[2]
    identity = np.broadcast_to(np.eye(nu), (lines, nu, nu))
    return retract(problem, response, identity, steps=_RETRACTIONS)


def _default_weight(frf: FrequencyResponse) -> Weight:
    ny, nu = frf.values.shape[1:]
    return Weight.relative(frf.values) if frf.covariance is None else Weight.from_covariance(frf.covariance, ny, nu)


def _entry_weight(frf: FrequencyResponse, weight: Weight) -> np.ndarray:
    """What the subspace estimate can use of a weight: one number per entry."""
    ny, nu = frf.values.shape[1:]
    if frf.covariance is None:
        return weight.entries
    variance = np.real(np.diagonal(frf.covariance, axis1=1, axis2=2)).reshape(-1, nu, ny).transpose(0, 2, 1)
    return weight.entries / np.sqrt(variance)


def _response(start: Any, frf: FrequencyResponse, points: np.ndarray) -> np.ndarray:
    import control

    if not isinstance(start, control.StateSpace):
        raise InputTypeError(f"`start` must be a control.StateSpace; got {type(start).__name__}")
    if (start.noutputs, start.ninputs) != frf.values.shape[1:]:
        raise InputError(
            f"`start` must have {frf.values.shape[1]} outputs and {frf.values.shape[2]} inputs as `frf`;"
            f" got {start.noutputs} and {start.ninputs}"
        )
    return np.moveaxis(np.asarray(start(points, squeeze=False)), -1, 0)
