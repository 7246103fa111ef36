"""Uncertainty of fits of modal structure: what the structure leaves free, and standard deviations of the mode shapes."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, StateMatrices, freeze, lengths
from robustid.fitting.fraction.krylov_blocks import stacked
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials
from robustid.fitting.matrix_fraction import MatrixFraction
from robustid.fitting.modal.modal_fit import TiedOutputs, symmetric_matrices
from robustid.fitting.modal.modal_structure import Modal
from robustid.fitting.modal.mode_gains import blocks_in, gain_changes, gains, real_modes_in
from robustid.fitting.state_space.projected_outputs import LocalModel, Outputs
from robustid.fitting.state_space.state_descent import directions_of

_LINES_AT_ONCE = 256
_UNSEEN = 1e-12  # directions that the response sees less than this are not determined


@dataclasses.dataclass(frozen=True, eq=False)
class ModeShapes(Frozen):
    """Shapes of the modes of a fit: ``shape drive'`` stands over ``s^2 + 2 zeta omega s + omega^2`` (times s^q)."""

    poles: Complex  # (m,) in s (rad/s) or z, those above the real axis; nan of overdamped modes with general damping
    shape: NDArray[np.generic]  # (m, ny), the largest entry is 1; complex with general damping
    drive: NDArray[np.generic]  # (m, nu), unit of the response times s^-2 (rad/s)
    shape_std: Real  # standard deviations sqrt(E|d|^2), as `drive_std`; nan without a covariance
    drive_std: Real

    def __post_init__(self) -> None:
        self._set(**{f.name: freeze(getattr(self, f.name)) for f in dataclasses.fields(self)})


def mode_shapes(fit: MatrixFraction, covariance: ModalCovariance | None = None) -> ModeShapes:
    """Shapes of the modes of a fit of modal structure, with their deviations where a covariance is given."""
    structure = _Structure(fit)
    model, C, problem = structure.model, structure.fitted.C, fit.problem
    terms, changes = gains(model, C, structure.modal.power), structure.gain_changes()
    left = fit.fraction.form == "left"
    M = terms.transpose(0, 2, 1) if left else terms
    changes = changes.transpose(0, 2, 1, 3) if left else changes
    ny, nu = M.shape[1:]
    shape, drive = np.full((len(M), ny), np.nan, dtype=complex), np.full((len(M), nu), np.nan, dtype=complex)
    shape_std, drive_std = np.full(shape.shape, np.nan), np.full(drive.shape, np.nan)
    for k in np.flatnonzero(np.isfinite(M[:, 0, 0])):
        i, j = np.unravel_index(np.argmax(np.abs(M[k])), (ny, nu))
        drive[k], shape[k] = M[k, i], M[k, :, j] / M[k, i, j]
        if covariance is not None:
            change = changes[k, :, j] - shape[k][:, None] * changes[k, i, j]
            shape_std[k] = covariance.deviation(change / M[k, i, j])
            drive_std[k] = covariance.deviation(changes[k, i])
    unit = problem.scale if problem.dt is None else 1 / problem.dt
    poles = np.where(np.isfinite(M[:, 0, 0]), problem.scale * model.poles[: 2 * len(M) : 2], np.nan)
    if structure.modal.real:
        shape, drive = np.real(shape), np.real(drive)
    size = unit ** (2 - structure.modal.power)
    return ModeShapes(poles, shape, size * drive, shape_std, size * drive_std)


def modal_covariance(fit: MatrixFraction, basis: VectorPolynomials) -> ModalCovariance:
    """Covariance of the coordinates of the structure, and of those of the fraction in a basis of polynomials."""
    structure = _Structure(fit)
    problem, rows, seen = fit.problem, np.zeros((0, structure.size)), 0.0
    values = basis.values.reshape(2, problem.omega.size, -1, basis.size)
    for first in range(0, problem.omega.size, _LINES_AT_ONCE):
        part = slice(first, first + _LINES_AT_ONCE)
        changes = stacked(structure.changes(part))
        seen = seen + values[:, part].reshape(len(changes), -1).T @ changes
        rows = np.asarray(np.linalg.qr(np.concatenate([rows, changes]), mode="r"))
    size = lengths(rows)
    _, sizes, Vt = np.linalg.svd(rows / size)
    kept = sizes > _UNSEEN * sizes[:1]
    factor = (Vt[kept].T / sizes[kept]) / size[:, None]
    turned = np.asarray(seen) @ factor  # orthonormal, as the structure's tangent space is part of the fraction's
    return ModalCovariance(factor, scipy.linalg.null_space(turned.T, rcond=0.5).T)


@dataclasses.dataclass(frozen=True, eq=False)
class ModalCovariance(Frozen):
    """First-order uncertainty in the coordinates of a modal structure, per unit variance of the residual."""

    factor: Real  # (P, r): factor factor' is the covariance of the P coordinates
    forbidden: Real  # (m, n), orthonormal rows: directions of the fraction's coordinates that the structure forbids
    variance: float = 1.0

    def deviation(self, changes: Complex) -> Real:
        """Standard deviations ``sqrt(E|d|^2)`` of numbers whose derivatives (..., P) by the coordinates are given."""
        return np.sqrt(self.variance) * np.linalg.norm(changes @ self.factor, axis=-1)


class _Structure:
    """A fit in the coordinates of its structure: those of the model, then those of its outputs and direct terms."""

    def __init__(self, fit: MatrixFraction) -> None:
        modal = Modal() if fit.modal is None else fit.modal
        self.modal, self.problem = modal, fit.problem
        A, B, C, D = fit.fraction.matrices
        exact = StateMatrices(A / fit.problem.scale, B / fit.problem.scale, C, D)
        directions, free = directions_of(fit.problem)
        discrete = fit.problem.dt is not None
        self.model: LocalModel = (
            real_modes_in(exact, directions, free, discrete=discrete, power=modal.power)
            if modal.real
            else blocks_in(exact, directions, free, discrete=discrete)
        )
        outputs = TiedOutputs(fit.problem) if modal.symmetric else Outputs(fit.problem)
        self.fitted = outputs.fitted(self.model)
        ny, nu = fit.problem.values.shape[1:]
        count = ny * self.model.order
        self.ties = self.model.tied_outputs() if modal.symmetric else np.eye(count).reshape(count, ny, -1)
        self.through = np.zeros((0, ny, nu))
        if fit.problem.feedthrough:
            self.through = symmetric_matrices(ny) if modal.symmetric else np.eye(ny * nu).reshape(-1, ny, nu)
        self.size = len(self.model.reach(fit.problem.xi)) + len(self.ties) + len(self.through)

    def changes(self, part: slice) -> Complex:
        """Weighted derivatives (F, ny*nu, P) of the response at some of the points."""
        xi, states, C = self.problem.xi[part], self.fitted.states[part], self.fitted.C
        tangent = self.model.tangent(xi, states, C)
        if self.modal.symmetric:
            tangent = self.model.tied_changes(states, C, tangent)
        outputs: NDArray[np.complex128] = np.einsum("tok,fku->fout", self.ties, states, optimize=True)
        through = np.broadcast_to(self.through.transpose(1, 2, 0), (*tangent.shape[:3], len(self.through)))
        whole = np.concatenate([tangent, outputs, through], axis=3)
        return self.problem.weight.select(part).apply_all(whole)

    def gain_changes(self) -> Complex:
        """Derivatives (m, ny, nu, P) of the gains of the modes."""
        power, C = self.modal.power, self.fitted.C
        inner = gain_changes(self.model, C, power, tied=self.modal.symmetric)
        outer = np.stack([gains(self.model, tie, power) for tie in self.ties], axis=3)
        none = np.zeros((*inner.shape[:3], len(self.through)), dtype=np.complex128)
        return np.concatenate([inner, outer, none], axis=3)
