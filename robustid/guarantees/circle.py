"""From bounds at frequencies to a bound on the whole unit circle."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg

from robustid.core import Frozen, freeze
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.value_set import ValueSet, norm_of_bounds, schur_bound
from robustid.identification import Identification, Prior, parametric_states

StateSpace = tuple[np.ndarray, np.ndarray, np.ndarray]  # A, B, C


@dataclasses.dataclass(frozen=True, eq=False)
class CircleBound(Frozen):
    """|F(exp(j omega T)) - model| <= bound_i for every consistent F and every omega in [edges_i, edges_(i+1)].

    Of several channels the largest singular value is at most bound_i, the norm of the matrix of the bounds of the entries.

    Attributes
    ----------
    edges : (C+1,) array, rad/s
        From 0, or from the first line where the plant has an integrator, to pi/dt.
    bound : (C,) array
    lower : float
        Error of a consistent system at one of the edges, attained.
    converged : bool
        Whether the largest bound is within the tolerance that was asked of the largest one at an edge.
    values : tuple of ValueSet
        At the edges, with their certificates; entry after entry.
    entries : (C, ny, nu) array
        Bounds of the entries of F - model.
    """

    edges: np.ndarray
    bound: np.ndarray
    lower: float
    converged: bool
    values: tuple[ValueSet, ...]
    entries: Any = None

    def __post_init__(self) -> None:
        entries = self.bound[:, None, None] if self.entries is None else self.entries
        self._set(edges=freeze(self.edges), bound=freeze(self.bound), entries=freeze(entries))

    @property
    def largest(self) -> float:
        """The bound of the H-infinity norm of F - model."""
        return float(self.bound.max())

    @property
    def peak(self) -> float:
        """Middle of the cell with the largest bound, rad/s."""
        cell = int(np.argmax(self.bound))
        return float((self.edges[cell] + self.edges[cell + 1]) / 2)


@dataclasses.dataclass(frozen=True)
class Curvature:
    """Bounds of the second derivative of the entries of E = F - model along the circle, for every consistent F.

    E = G + sum (p_i - q_i) P_i + (q'P - model) with q a member's parameters: three parts, bounded apart.

    * |d^2 G/d theta^2| <= K rho/(rho-1)^2: with g(zeta) = G(rho zeta)/K in the unit ball, |g^(n)| <= n! (1 - |g|^2) /
      ((1-|zeta|)^n (1+|zeta|)) [`ruscheweyh1985`] for n = 1, 2 at |zeta| = 1/rho, and d^2/d theta^2 = -(z G' + z^2 G'').
    * the P_i from their state space, times the half-widths of the certified intervals;
      Of several channels this holds for the singular values of G divided by its scaling, hence for their entries;
    * the rest, a known rational function, from its state space; where it is -G_id, with G_id in the same ball (`inside`), the
      bound of G serves for it too.
    """

    prior: Prior
    known: StateSpace
    basis: StateSpace | None
    reach: np.ndarray
    inside: bool

    def largest(self, low: float, high: float) -> np.ndarray:
        """On the arc from the angle `low` to `high`, (ny, nu); inf where the arc is too long for the bound to hold."""
        K, rho = self.prior.gain_bound, self.prior.decay_rate
        known = second_derivative(*self.known, low, high)
        ball = self.prior.scales(*known.shape) * (K * rho / (rho - 1) ** 2 * (1 + 1e-6))
        total = ball + (np.minimum(known, ball) if self.inside else known)
        if self.basis is not None:
            sizes = second_derivative(*self.basis, low, high)[:, 0]
            for size, reach in zip(sizes, self.reach, strict=True):
                total = total + np.where(reach > 0, size, 0.0) * reach
        return total


def second_derivative(A: np.ndarray, B: np.ndarray, C: np.ndarray, low: float, high: float) -> np.ndarray:
    """Largest |d^2/d theta^2 C (zI - A)^-1 B|, z = exp(j theta), on an arc: a bound for every entry, (rows of C, columns of B).

    Its value at the middle, and half the arc times a bound of the third derivative, from ||R(z)|| <= ||R|| / (1 - d ||R||) for
    |z - middle| <= d, R = (zI - A)^-1 at the middle.
    """
    n = A.shape[0]
    if not n:
        return np.zeros((C.shape[0], B.shape[1]))
    z, half = np.exp(1j * (low + high) / 2), (high - low) / 2
    R = np.linalg.inv(z * np.eye(n) - A)
    size = float(np.linalg.norm(R, 2))
    if half * size >= 0.5:
        return np.full((C.shape[0], B.shape[1]), np.inf)
    state = R @ B
    first, second = -(C @ (R @ state)), 2 * (C @ (R @ (R @ state)))
    middle = np.abs(z * first + z**2 * second)
    grown = 1 / (1 - half * size)
    rows, columns = np.linalg.norm(C @ R, axis=1)[:, None], np.linalg.norm(state, axis=0)
    # R(z) = R (I + (z - middle) R)^-1, hence |C R(z)^k B| <= |C R| |R B| |R|^(k-2) grown^k.
    powers = [rows * columns * size ** (k - 2) * grown**k for k in (2, 3, 4)]
    third = powers[0] + 3 * 2 * powers[1] + 6 * powers[2]
    return (middle + half * third) * (1 + 1e-9)


def known_part(model: Any, identification: Identification) -> StateSpace:
    """State space (A, B, C) of q'P - model, each scaled by itself so that norms are not dominated by bad units."""
    A, B, C = _scaled(np.asarray(model.A), np.asarray(model.B), -np.asarray(model.C))
    problem = identification.problem
    if problem.parametric is None or not problem.parametric.states:
        return A, B, C
    residues = identification.parameters.reshape(-1, *model.D.shape)
    a, b, c, _ = parametric_states(problem, residues)
    return np.asarray(scipy.linalg.block_diag(A, a)), np.vstack([B, b]), np.hstack([C, c])


def norms_of_class(
    identification: Identification, parameters: ParameterIntervals, nominal: np.ndarray, omega: np.ndarray
) -> np.ndarray:
    """Bound of the largest singular value of F - nominal from the class and the intervals of the parameters alone, (F,)."""
    problem, (_, p, q) = identification.problem, nominal.shape
    known, loose, rounding = -nominal, np.zeros(nominal.shape), np.linalg.norm(nominal, axis=(1, 2))
    if problem.parametric is not None:
        functions = problem.parametric.response(omega * problem.dt)
        reach = parameters.reach(identification.parameters).reshape(-1, p, q)
        outside = np.tensordot(functions, identification.parameters.reshape(-1, p, q), 1)
        known, loose = known + outside, np.tensordot(np.abs(functions), reach, 1)
        rounding = rounding + np.linalg.norm(outside, axis=(1, 2))
    ball = problem.prior.gain_bound * schur_bound(problem.prior.scales(p, q))
    return (ball + np.linalg.norm(known, 2, axis=(1, 2)) + norm_of_bounds(loose) + 1e-9 * rounding) * (1 + 1e-9)


def interpolant_part(identification: Identification) -> StateSpace:
    """The same of its own model, whose parametric part is q'P exactly, its states the last ones."""
    model, basis = identification.model, identification.problem.parametric
    n = model.nstates - (0 if basis is None else basis.states * min(model.D.shape))
    return _scaled(np.asarray(model.A)[:n, :n], np.asarray(model.B)[:n], -np.asarray(model.C)[:, :n])


def _scaled(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> StateSpace:
    """A similar realisation with diagonal scaling by powers of two."""
    if not A.shape[0]:
        return A, B, C
    balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return np.asarray(balanced), B / scale[:, None], C * scale
