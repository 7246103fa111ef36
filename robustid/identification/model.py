"""The model of an interpolant joined with the parametric part."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.bases import ParametricBasis
from robustid.core import Frozen, Model, Numbers, StateMatrices, exponents_of, freeze, labels_of
from robustid.identification.formulation.base import Formulation, Realisation, States
from robustid.identification.formulation.convex import LEAST_SQUARES, Candidate
from robustid.identification.formulation.rows import Rows
from robustid.identification.formulation.tails import smallest_bound
from robustid.identification.interpolant import FreeParameter
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem
from robustid.identification.residuals import largest_ratio

_SHARE = 1e-2  # of the smallest bound that the states left out may cost; less where that is too much
_SAME_SCALE = 1e-13  # singular values of a scaling below this, relatively, are rounding
_SAME_POLE = 1e-9
_DEFECTIVE = 1e-6  # of the eigenvectors of both sides: rounding splits those of a Jordan block, and leaves them almost orthogonal
_EDGE = 1e-6  # how far outside the smallest margin the model is centred
_EDGE_UNBOUNDED = 1e-5  # of positive-real classes: X is not bounded, and its rounding takes digits at the border


@dataclasses.dataclass(frozen=True)
class Nominal:
    """The model of a point: of the central interpolant itself, or but for `error` in the H-infinity norm."""

    model: Model
    states: int  # number of states of the non-parametric part; they come first
    error: float  # bound of |model - interpolant| at any frequency, over the weight of the class; 0 where no state was left out


def level_of(objective: str, margin: float, accuracy: float, prior: Prior) -> float:
    """The multiple of the bounds that defines the set from which the model is taken."""
    edge = _EDGE_UNBOUNDED if prior.positive_real else _EDGE
    widest = max(1.0, margin * (1 + edge))
    return min(margin * (1 + edge) + accuracy, widest) if objective == "margin" else widest


def nominal_model(formulation: Formulation, point: Candidate, level: float, E: FreeParameter = 0.0) -> Nominal:
    """The interpolant with the free parameter E, joined with the parametric part.

    Where the formulation leaves something out, so may the model: states, as long as every residual stays below level * bound.
    """
    problem, rows = formulation.problem, formulation.rows
    realise = _realisation(formulation, point, E)
    tolerance = _SHARE * smallest_bound(problem)
    while True:
        states, error = realise(tolerance)
        states = _with_scales(problem, states)
        inside = states[0].shape[0]
        if not problem.prior.positive_real:  # whose weight has a pole on the axis
            inside += problem.weighting.order * min(problem.entries.shape)
        nominal = Nominal(join_model(problem, rows, states, point.p), inside, error)
        if not error or tolerance < 1e-10 * problem.prior.gain_bound:
            return nominal
        if largest_ratio(problem, nominal.model) <= level * (1 + 1e-5):
            return nominal
        tolerance /= 10


def _realisation(formulation: Formulation, point: Candidate, E: FreeParameter) -> Realisation:
    """State spaces of the interpolant; without G the central one is zero, whatever the number of coefficients."""
    if point.solver != LEAST_SQUARES or not isinstance(E, float) or E:
        return formulation.realisation(point.x, E)
    p, q = formulation.problem.entries.shape
    nothing = np.zeros((0, 0)), np.zeros((0, q)), np.zeros((p, 0)), np.zeros((p, q))
    return lambda _: (nothing, 0.0)


def _with_scales(problem: MixedProblem, states: States) -> States:
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


def join_model(problem: MixedProblem, rows: Rows, realised: States, p: NDArray[np.float64]) -> Model:
    """State space of F = p'P + G; the parametric states follow those of G.

    With a weight it is joined in the variable of the model: what rolls off has no direct term there at all.
    """
    import control

    plane, weighting, basis = problem.plane, problem.weighting, problem.parametric
    inside, outside = StateMatrices(*realised), None
    if not weighting.trivial:
        inside = plane.from_z(inside)
        if problem.prior.positive_real:  # the constant has the same weight, and no states of its own
            inside, basis = inside._replace(D=inside.D + residue_matrices(problem, rows, p)[0]), None
        inside = weighting.joined(inside, plane)
        basis = None if basis is None else basis.in_s()
    if basis is not None:
        outside = parametric_states(problem, residue_matrices(problem, rows, p), basis)
    states = inside if outside is None else _sum(inside, StateMatrices(*outside))
    states = plane.from_z(states) if weighting.trivial else states
    inputs, outputs = labels_of(problem.inputs, "u"), labels_of(problem.outputs, "y")
    return control.ss(*states, problem.dt, inputs=inputs, outputs=outputs, name="identified")


def _sum(first: StateMatrices, second: StateMatrices) -> StateMatrices:
    (A, B, C, D), (a, b, c, d) = first, second
    return StateMatrices(scipy.linalg.block_diag(A, a), np.vstack([B, b]), np.hstack([C, c]), D + d)


def parametric_states(
    problem: MixedProblem, residues: NDArray[np.float64], written: ParametricBasis | None = None
) -> States:
    """State space of sum_i P_i R_i, residues (m, p, q): n min(p, q) states of functions with n, of the problem or as `written`."""
    basis: ParametricBasis = problem.parametric if written is None else written
    _, p, q = residues.shape
    through = np.tensordot(basis.D[:, 0], residues, 1)
    if p >= q:
        outputs = np.einsum("in,ipq->pnq", basis.C, residues).reshape(p, -1)
        return np.kron(basis.A, np.eye(q)), np.kron(basis.B, np.eye(q)), outputs, through
    inputs = np.einsum("in,ipq->npq", basis.C, residues).reshape(-1, q)
    return np.kron(basis.A.T, np.eye(p)), inputs, np.kron(basis.B.T, np.eye(p)), through


def physical_parameters(rows: Rows, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """The independent parameters in the user's units, transients left out, entry by entry, (count m,)."""
    return (p / rows.column_scale)[: rows.parameters] if rows.parameters else np.zeros(0)


def residue_matrices(problem: MixedProblem, rows: Rows, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """The parameters in the user's units as matrices, one per function, (m, p, q)."""
    return np.moveaxis(problem.entries.expand(physical_parameters(rows, p)), 2, 0)


def parametric_values(
    problem: MixedProblem, rows: Rows, p: NDArray[np.float64], angles: NDArray[np.float64]
) -> Numbers:
    """Values of the parametric part at exp(j angle), (F, p, q); zero where there is none."""
    if problem.parametric is None:
        return np.zeros((angles.size, *problem.entries.shape))
    return np.tensordot(problem.parametric.response(angles), residue_matrices(problem, rows, p), 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Mode(Frozen):
    """One pole pair (or real pole) of the parametric part: R/(z - a) + conj(R)/(z - conj(a)), of a simple pole.

    In continuous time s in the place of z.
    """

    omega: float  # natural frequency, rad/s: |log a|/dt; |a| in continuous time
    damping: float
    residue: NDArray[np.complex128]  # (ny, nu), R
    # Second singular value of R over the first: 0 where R has rank one, as the residue of a single mode of a structure has.
    rank_ratio: float

    def __post_init__(self) -> None:
        self._set(residue=freeze(self.residue))


def modes_of(basis: ParametricBasis, residues: NDArray[np.float64]) -> tuple[Mode, ...]:
    """The modes of sum_i P_i R_i, residues (m, ny, nu), by frequency; those of repeated poles are left out."""
    basis = basis.in_s()
    values, *vectors = scipy.linalg.eig(basis.A, left=True)
    left, right = (np.asarray(side) for side in vectors)
    overlap = np.sum(left.conj() * right, axis=0)
    near = np.abs(values[:, None] - values) <= _SAME_POLE * (1.0 if basis.dt else np.abs(values))
    found: list[Mode] = []
    for k, pole in enumerate(values):
        if np.sum(near[k]) > 1 or np.abs(overlap[k]) < _DEFECTIVE or np.imag(pole) < 0 or pole == 0:
            continue
        weights = (basis.C @ right[:, k]) * (left[:, k].conj() @ basis.B[:, 0]) / overlap[k]
        R = np.tensordot(weights, residues, 1)
        log = complex(exponents_of(pole, basis.dt))
        singular = np.linalg.svd(R, compute_uv=False)
        ratio = float(singular[1] / singular[0]) if singular.size > 1 and singular[0] > 0 else 0.0
        damping = float(-log.real / abs(log)) if log != 0 else 0.0
        found.append(Mode(float(abs(log)), damping, R, ratio))
    return tuple(sorted(found, key=lambda mode: mode.omega))
