"""The engineer's model of an interpolant joined with the parametric part."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import scipy.linalg

from robustid.identification.contraction import BalancedContraction
from robustid.identification.forms import Posed, smallest_bound
from robustid.identification.formulation.functions import taylor_tail
from robustid.identification.formulation.rows import Rows
from robustid.identification.hankel import ImpulseReduction, balanced_from_impulse
from robustid.identification.interpolant import Interpolants, interpolants
from robustid.identification.problem import MixedProblem
from robustid.identification.residuals import largest_ratio
from robustid.identification.schur import TaylorInterpolants, taylor_interpolants
from robustid.identification.solver.conic import Candidate

_SHARE = 1e-2  # of the smallest bound that the states left out may cost; less where that is too much
_SAME_SCALE = 1e-13  # singular values of a scaling below this, relatively, are rounding
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
    taylor = posed.sections is not None and posed.sections.is_shift and posed.problem.entries.single
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
            states = _with_scales(problem, states)
            return Nominal(join_model(problem, rows, states, point.p), states[0].shape[0], 0.0)
        cut = BalancedContraction(*states).truncate
    else:
        cut = functools.partial(_from_impulse, problem, family, E)
    tolerance = _SHARE * smallest_bound(problem)
    while True:
        small = cut(tolerance)
        states = _with_scales(problem, small[:4])
        nominal = Nominal(join_model(problem, rows, states, point.p), states[0].shape[0], small.bound)
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


def _with_scales(problem: MixedProblem, states: Scaled) -> Scaled:
    """The entries times the scaling of the prior: a copy of the states for every unit of its rank."""
    if problem.prior.scaling is None:
        return states
    A, B, C, D = states
    scales = problem.prior.scales(*D.shape)
    left, size, right = np.linalg.svd(scales)
    rank = int(np.sum(size > _SAME_SCALE * size[0]))
    root = np.sqrt(size[:rank])
    outputs, inputs = left[:, :rank].T * root[:, None], right[:rank] * root[:, None]
    B = np.vstack([B * one for one in inputs])
    C = np.hstack([one[:, None] * C for one in outputs])
    return np.kron(np.eye(rank), A), B, C, scales * D


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
    if problem.parametric is not None:
        a, b, c, d = parametric_states(problem, residue_matrices(problem, rows, p))
        A, B = scipy.linalg.block_diag(A, a), np.vstack([B, b])
        C, D = np.hstack([C, c]), D + d
    return control.ss(A, B, C, D, problem.dt, **signal_names(problem))


def parametric_states(problem: MixedProblem, residues: np.ndarray) -> Scaled:
    """State space of sum_i P_i R_i, residues (m, p, q): n min(p, q) states of functions with n."""
    basis, (_, p, q) = problem.parametric, residues.shape
    through = np.tensordot(basis.D[:, 0], residues, 1)
    if p >= q:
        outputs = np.einsum("in,ipq->pnq", basis.C, residues).reshape(p, -1)
        return np.kron(basis.A, np.eye(q)), np.kron(basis.B, np.eye(q)), outputs, through
    inputs = np.einsum("in,ipq->npq", basis.C, residues).reshape(-1, q)
    return np.kron(basis.A.T, np.eye(p)), inputs, np.kron(basis.B.T, np.eye(p)), through


def signal_names(problem: MixedProblem) -> dict[str, Any]:
    """Names of the model and its channels for `control`."""
    outputs, inputs = ([_label(c.name, d) for c in side] for side, d in ((problem.outputs, "y"), (problem.inputs, "u")))
    return {"inputs": inputs, "outputs": outputs, "name": "identified"}


def _label(name: str, default: str) -> str:
    """A signal name as `control` takes it: not empty, and without dots."""
    return name.replace(".", "_") or default


def physical_parameters(rows: Rows, p: np.ndarray) -> np.ndarray:
    """The independent parameters in the user's units, transients left out, entry by entry, (count m,)."""
    return (p / rows.column_scale)[: rows.parameters] if rows.parameters else np.zeros(0)


def residue_matrices(problem: MixedProblem, rows: Rows, p: np.ndarray) -> np.ndarray:
    """The parameters in the user's units as matrices, one per function, (m, p, q)."""
    return np.moveaxis(problem.entries.expand(physical_parameters(rows, p)), 2, 0)


def parametric_values(problem: MixedProblem, rows: Rows, p: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Of the parametric part at exp(j angle), (F, p, q); zero where there is none."""
    if problem.parametric is None:
        return np.zeros((angles.size, problem.entries.outputs, problem.entries.inputs))
    return np.tensordot(problem.parametric.response(angles), residue_matrices(problem, rows, p), 1)
