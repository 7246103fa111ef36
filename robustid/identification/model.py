"""The engineer's model of an interpolant joined with the parametric part."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import scipy.linalg

from robustid.identification.forms import Posed, smallest_bound
from robustid.identification.residuals import largest_ratio
from robustid.interpolation import (
    BalancedContraction,
    ImpulseReduction,
    Interpolants,
    MixedProblem,
    Rows,
    TaylorInterpolants,
    balanced_from_impulse,
    interpolants,
    taylor_interpolants,
    taylor_tail,
)
from robustid.solve import Candidate

_SHARE = 1e-2  # of the smallest bound that the states left out may cost; less where that is too much
_LONGEST = 8000  # samples of the impulse response

Family = Interpolants | TaylorInterpolants
Scaled = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Nominal:
    """The model of a point: of the central interpolant itself, or but for `error` in the H-infinity norm.

    Attributes
    ----------
    model : control.StateSpace
    states : int
        Of the non-parametric part; they come first.
    error : float
        Bound of |model - interpolant| at any frequency; 0 where no state was left out.
    """

    model: Any
    states: int
    error: float


def family_of(posed: Posed, x: np.ndarray) -> Family:
    """All functions of the unit ball with the coefficients x."""
    taylor = posed.sections is not None and posed.sections.is_shift
    return taylor_interpolants(x) if taylor else interpolants(posed.data.sarason, x)


def nominal_model(posed: Posed, point: Candidate, level: float, E: Any = 0.0) -> Nominal:
    """The interpolant with the free parameter E, joined with the parametric part.

    But for the exact form, states are left out as long as every residual stays below level * bound.
    """
    problem, rows = posed.problem, posed.data.rows
    family = family_of(posed, point.x)
    if isinstance(family, Interpolants):
        states = _unscaled(problem, family.realise(E))
        if posed.sections is None:
            return Nominal(join_model(problem, rows, states, point.p), states[0].shape[0], 0.0)
        cut = BalancedContraction(*states).truncate
    else:
        cut = functools.partial(_from_impulse, problem, family, E)
    tolerance = _SHARE * smallest_bound(problem)
    while True:
        small = cut(tolerance)
        nominal = Nominal(join_model(problem, rows, small[:4], point.p), small.A.shape[0], small.bound)
        if tolerance < 1e-10 * problem.prior.gain_bound or largest_ratio(problem, nominal.model) <= level * (1 + 1e-5):
            return nominal
        tolerance /= 10


def _unscaled(problem: MixedProblem, scaled: Scaled) -> Scaled:
    """State space of G(z) = K phi(z/rho) in the engineer's convention, of phi = (alpha, beta, gamma, delta) in z/rho."""
    alpha, beta, gamma, delta = scaled
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    # Half of K on either side keeps the realisation balanced.
    root = np.sqrt(K)
    return alpha / rho, root * beta, root * gamma / rho, K * delta


def _from_impulse(problem: MixedProblem, family: TaylorInterpolants, E: float, tolerance: float) -> ImpulseReduction:
    """Balanced truncation of the interpolant, from its impulse response, within a tolerance in units of the response."""
    prior = problem.prior
    wanted = taylor_tail(prior, 0) / (1e-3 * tolerance)
    count = min(_LONGEST, max(2, math.ceil(math.log(max(wanted, 2.0)) / math.log(prior.decay_rate))))
    g = prior.gain_bound * prior.decay_rate ** -np.arange(count, dtype=float) * family.coefficients(count, E)
    small = balanced_from_impulse(g, tolerance)
    return small._replace(bound=small.bound + taylor_tail(prior, count))


def join_model(problem: MixedProblem, rows: Rows, realised: Scaled, p: np.ndarray) -> Any:
    """State space of F = p'P + G; the parametric states follow those of G."""
    import control

    A, B, C, D = realised
    basis = problem.parametric
    if basis is not None:
        weights = physical_parameters(rows, p)[None, :]
        A, B = scipy.linalg.block_diag(A, basis.A), np.vstack([B, basis.B])
        C, D = np.hstack([C, weights @ basis.C]), D + weights @ basis.D
    output, input_ = problem.channel
    names = {"inputs": [_label(input_.name, "u")], "outputs": [_label(output.name, "y")], "name": "identified"}
    return control.ss(A, B, C, D, problem.dt, **names)


def _label(name: str, default: str) -> str:
    """A signal name as `control` takes it: not empty, and without dots."""
    return name.replace(".", "_") or default


def physical_parameters(rows: Rows, p: np.ndarray) -> np.ndarray:
    """The parameters in the user's units, transients left out."""
    return (p / rows.column_scale)[: rows.parameters] if rows.parameters else np.zeros(0)
