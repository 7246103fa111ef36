"""Coordinates of small changes of a fraction in which noise of the data has covariance one: all together, or entry by entry."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, freeze
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.fraction.krylov_blocks import NULL, raised
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials, orthonormal_polynomials
from robustid.fitting.matrix_fraction import MatrixFraction

# A pole that moves by this part of the largest motion along directions which the data don't see isn't determined.
_FREE = 1e-6


class Coordinates(Protocol):
    """Changes of a fraction as combinations of independent numbers of variance one."""

    @property
    def parameters(self) -> int:
        """Number of free coefficients."""
        ...

    def pole_changes(self, fit: MatrixFraction) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Poles (n,) in s or z, their derivatives (n, coordinates), and which of them the data don't determine."""
        ...

    def response_std(self, xi: Complex, D: Complex, P: Complex) -> Real:
        """Standard deviations (m, ny, nu) of the response at points in the unit of the nodes."""
        ...


@dataclasses.dataclass(frozen=True, eq=False)
class JointCoordinates(Frozen):
    """Coordinates of ``vec [dD; dN]`` in polynomials that the data make orthonormal: the covariance is ``I - R^T R``."""

    basis: VectorPolynomials  # without its values at the frequency points
    forbidden: Real  # R (m, parameters + m): directions that constraints, and modal structure, forbid

    def __post_init__(self) -> None:
        self._set(basis=_without_values(self.basis), forbidden=freeze(self.forbidden))

    @property
    def parameters(self) -> int:
        """Number of free coefficients."""
        return self.basis.size - len(self.forbidden)

    def pole_changes(self, fit: MatrixFraction) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Poles, derivatives and which of them the data don't determine, as `Coordinates` says."""
        poles, changes = pole_changes(fit, self.basis)
        return poles, self._admissible(changes), _undetermined(changes[:, self.basis.null])

    def response_std(self, xi: Complex, D: Complex, P: Complex) -> Real:
        """Standard deviations (m, ny, nu), as `Coordinates` says."""
        changes = self._admissible(response_changes(self.basis, xi, D, P))
        return np.linalg.norm(changes, axis=-1).reshape(-1, *P.shape[:0:-1]).transpose(0, 2, 1)

    def _admissible(self, changes: Complex) -> Complex:
        """Derivatives in the last axis, freed of the directions that constraints forbid and that the data don't see."""
        changes = changes - (changes @ self.forbidden.T) @ self.forbidden
        changes[..., self.basis.null] = 0.0
        return changes


@dataclasses.dataclass(frozen=True, eq=False)
class EntryCoordinates(Frozen):
    """Coordinates of a scalar denominator that many entries share, and of the numerator of every entry: ``Q_i c_i - E_i d`` is
    the weighted change of entry i, ``Cov(d) = S S^T = (sum_i E_i^T (I - Q_i Q_i^T) E_i)^{-1}`` and ``c_i = h_i + T_i d``,
    ``T_i = Q_i^T E_i``, with h_i independent of d, of covariance one (variable projection, `golub1973`).
    """

    # The result is that of `JointCoordinates` with one factorisation an entry. The polynomials psi (for dD) are orthonormal for
    # the whole weighted response, phi_i (for dN_i) for the entry i alone; both are without their values on the data.
    denominator: VectorPolynomials  # psi, n of them
    numerators: tuple[VectorPolynomials, ...]  # phi_i, m of them for each of ny entries
    taken: Real  # T_i (ny, m, n)
    root: Real  # S (n, k)
    unseen: Real  # (n, n - k), directions of d that the data don't see

    def __post_init__(self) -> None:
        self._set(
            denominator=_without_values(self.denominator),
            numerators=tuple(_without_values(basis) for basis in self.numerators),
            taken=freeze(self.taken),
            root=freeze(self.root),
            unseen=freeze(self.unseen),
        )

    @classmethod
    def of(cls, fit: MatrixFraction) -> EntryCoordinates:
        """Return the coordinates at a fit without modal structure whose `FractionProblem.entries_apart` is true."""
        problem, nodes = fit.problem, fit.nodes
        points, ny, _ = problem.values.shape
        seen = problem.weight.entries[..., 0] / nodes.denominators[:, :, 0]
        limits = problem.limits
        psi = orthonormal_polynomials((seen * nodes.response[..., 0])[..., None], problem.xi, limits[:1])
        columns = psi.values.reshape(2, points, ny, psi.size)
        numerators: list[VectorPolynomials] = []
        taken: list[Real] = []
        left: list[Real] = []
        for i in range(ny):
            phi = orthonormal_polynomials(seen[:, i, None, None], problem.xi, limits[1 + i : 2 + i])
            E = columns[:, :, i].reshape(2 * points, -1)
            T = phi.values.T @ E
            rest = E - phi.values @ T
            again = phi.values.T @ rest
            numerators.append(_without_values(phi))
            taken.append(T + again)
            left.append(triangle(rest - phi.values @ again))
        _, sizes, Vt = np.linalg.svd(triangle(np.concatenate(left)))
        known = sizes > NULL
        return cls(psi, tuple(numerators), np.array(taken), Vt[known].T / sizes[known], Vt[~known].T)

    @property
    def parameters(self) -> int:
        """Number of free coefficients."""
        return self.denominator.size + sum(basis.size for basis in self.numerators)

    def pole_changes(self, fit: MatrixFraction) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Poles, derivatives and which of them the data don't determine, as `Coordinates` says."""
        poles, rows = _pole_rows(fit)
        changes = fit.fraction.scale * _carried(self.denominator, poles, rows)[:, 0]
        return fit.fraction.scale * poles, changes @ self.root, _undetermined(changes @ self.unseen)

    def response_std(self, xi: Complex, D: Complex, P: Complex) -> Real:
        """Standard deviations (m, ny, 1), as `Coordinates` says."""
        out = np.empty(P.shape)
        inverse = 1 / D
        common = _carried(self.denominator, xi, inverse)[:, 0]
        for i, (basis, taken) in enumerate(zip(self.numerators, self.taken, strict=True)):
            own = _carried(basis, xi, inverse)[:, 0]
            own[:, basis.null] = 0.0
            both = (own @ taken - P[:, i] * common) @ self.root
            out[:, i, 0] = np.hypot(np.linalg.norm(own, axis=1), np.linalg.norm(both, axis=1))
        return out


def pole_changes(fit: MatrixFraction, basis: VectorPolynomials) -> tuple[Complex, Complex]:
    """Poles (n,) in s or z, and their derivatives (n, coefficients) with respect to the coordinates in the basis."""
    ny = fit.problem.values.shape[1]
    poles, rows = _pole_rows(fit)
    rows = np.concatenate([rows, np.zeros((*rows.shape[:2], ny), dtype=complex)], axis=2)
    changes = _carried(basis, poles, rows.reshape(poles.size, 1, -1))[:, 0]
    return fit.fraction.scale * poles, fit.fraction.scale * changes


def _pole_rows(fit: MatrixFraction) -> tuple[Complex, Complex]:
    """Poles (n,) in the unit of the nodes, and what their derivatives see of vec dD, (n, nu, nu)."""
    model = fit.fraction
    poles, left, right = scipy.linalg.eig(model.A, left=True, right=True)  # type: ignore[misc]
    w = left.conj().T @ model.B / -np.sum(left.conj() * right, axis=0)[:, None]
    # Components that Pi lacks have v = 0, which the pseudo-inverse gives.
    v = (np.linalg.pinv(model.states(poles).transpose(0, 2, 1)) @ right.T[..., None])[..., 0]
    return poles, v[:, :, None] * w[:, None, :]


def response_changes(basis: VectorPolynomials, xi: Complex, D: Complex, P: Complex) -> Complex:
    """Derivatives (m, nu*ny, coefficients) of vec of the response: ``(D^{-T} kron [-P I]) Phi``."""
    lines, ny, _ = P.shape
    left = np.concatenate([-P, np.broadcast_to(np.eye(ny), (lines, ny, ny))], axis=2)
    rows = Weight(np.ones(P.shape)).linearised(np.linalg.inv(D).transpose(0, 2, 1), left)
    return _carried(basis, xi, rows)


def _carried(basis: VectorPolynomials, xi: Complex, rows: Complex) -> Complex:
    """``rows Phi`` (m, r, n) at points xi (m,), by the recursion from the rows (m, r, b): D^{-1} is large where Phi is large,
    and only their product is known well.
    """
    out = np.empty((2 * xi.size * rows.shape[1], basis.size), order="F")
    for G, (before, here, fresh) in zip(basis.recursion, basis.blocks, strict=True):
        block = raised(xi, out[:, before], rows[..., fresh]) - out[:, : here.start] @ G[: here.start]
        out[:, here] = block @ np.linalg.inv(G[here])
    half = len(out) // 2
    return (out[:half] + 1j * out[half:]).reshape(xi.size, -1, basis.size)


def _undetermined(motion: Complex) -> NDArray[np.bool_]:
    """Mask of poles whose motion (n, directions) along what the data don't see is not rounding."""
    size = np.linalg.norm(motion, axis=1)
    return size > _FREE * size.max(initial=0.0)


def _without_values(basis: VectorPolynomials) -> VectorPolynomials:
    """The polynomials without what the data see of them, the largest part."""
    empty = basis.columns.shape[1:]
    return dataclasses.replace(basis, values=np.empty((0, basis.size)), columns=np.empty((0, *empty)))
