"""From bounds at frequencies to a bound on the whole unit circle."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen, freeze
from robustid.certify.value_set import ValueSet
from robustid.interpolation import Prior


@dataclasses.dataclass(frozen=True, eq=False)
class CircleBound(Frozen):
    """|F(exp(j omega T)) - model| <= bound_i for every consistent F and every omega in [edges_i, edges_(i+1)].

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
        At the edges, with their certificates.
    """

    edges: np.ndarray
    bound: np.ndarray
    lower: float
    converged: bool
    values: tuple[ValueSet, ...]

    def __post_init__(self) -> None:
        self._set(edges=freeze(self.edges), bound=freeze(self.bound))

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
    """Bounds of the second derivative of E = F - model along the circle, for every consistent F.

    E = G + sum (p_i - q_i) P_i + (q'P - model) with q a member's parameters: three parts, bounded apart.

    * |d^2 G/d theta^2| <= K rho/(rho-1)^2: with g(zeta) = G(rho zeta)/K in the unit ball, |g^(n)| <= n! (1 - |g|^2) /
      ((1-|zeta|)^n (1+|zeta|)) [`ruscheweyh1985`] for n = 1, 2 at |zeta| = 1/rho, and d^2/d theta^2 = -(z G' + z^2 G'').
    * the P_i from their state space, times the half-widths of the certified intervals;
    * the rest, a known rational function, from its state space; where it is -G_id, with G_id in the same ball (`inside`), the
      bound of G serves for it too.
    """

    prior: Prior
    known: tuple[np.ndarray, np.ndarray, np.ndarray]
    basis: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    reach: np.ndarray
    inside: bool

    def largest(self, low: float, high: float) -> float:
        """On the arc from the angle `low` to `high`; inf where the arc is too long for the bound to hold."""
        K, rho = self.prior.gain_bound, self.prior.decay_rate
        ball = K * rho / (rho - 1) ** 2 * (1 + 1e-6)
        known = float(second_derivative(*self.known, low, high)[0])
        total = ball + (min(known, ball) if self.inside else known)
        if self.basis is not None and self.reach.size:
            total += float(self.reach @ second_derivative(*self.basis, low, high))
        return total


def second_derivative(A: np.ndarray, B: np.ndarray, C: np.ndarray, low: float, high: float) -> np.ndarray:
    """Largest |d^2/d theta^2 C (zI - A)^-1 B|, z = exp(j theta), on an arc: one bound for every row of C.

    Its value at the middle, and half the arc times a bound of the third derivative, from ||R(z)|| <= ||R|| / (1 - d ||R||) for
    |z - middle| <= d, R = (zI - A)^-1 at the middle.
    """
    n = A.shape[0]
    if not n:
        return np.zeros(C.shape[0])
    z, half = np.exp(1j * (low + high) / 2), (high - low) / 2
    R = np.linalg.inv(z * np.eye(n) - A)
    size = float(np.linalg.norm(R, 2))
    if half * size >= 0.5:
        return np.full(C.shape[0], np.inf)
    state = R @ B[:, 0]
    first, second = -(C @ (R @ state)), 2 * (C @ (R @ (R @ state)))
    middle = np.abs(z * first + z**2 * second)
    grown = 1 / (1 - half * size)
    rows, column = np.linalg.norm(C @ R, axis=1), float(np.linalg.norm(state))
    # R(z) = R (I + (z - middle) R)^-1, hence |C R(z)^k B| <= |C R| |R B| |R|^(k-2) grown^k.
    powers = [rows * column * size ** (k - 2) * grown**k for k in (2, 3, 4)]
    third = powers[0] + 3 * 2 * powers[1] + 6 * powers[2]
    return (middle + half * third) * (1 + 1e-9)


def known_part(model: Any, basis: Any, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State space (A, B, C) of q'P - model, each scaled by itself so that norms are not dominated by bad units."""
    A, B, C = _scaled(np.asarray(model.A), np.asarray(model.B), -np.asarray(model.C))
    if basis is None or not basis.states:
        return A, B, C
    joined = scipy.linalg.block_diag(A, basis.A)
    return np.asarray(joined), np.vstack([B, basis.B]), np.hstack([C, parameters[None, :] @ basis.C])


def _scaled(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A similar realisation with diagonal scaling by powers of two."""
    if not A.shape[0]:
        return A, B, C
    balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return np.asarray(balanced), B / scale[:, None], C * scale
