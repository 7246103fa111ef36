"""Central interpolant in closed form, the set of all interpolants, and their value discs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen, freeze
from robustid.errors import InputError, InputTypeError
from robustid.interpolation.sarason import SarasonMap


@dataclasses.dataclass(frozen=True, eq=False)
class Interpolants(Frozen):
    """Every function of the unit ball with given data x: phi_E(zeta), E any function of the unit ball.

    With M = I - X'X > 0, M = LL', W = M + x'x = A'MA + c'c, D = [L'A; c], R = [L'; x], the matrix V = R W^{-1} D' is a
    partial isometry; with u_d, u_r spanning the null spaces of D' and R',

        V + u_r E u_d' = [alpha beta; gamma delta],   phi_E(zeta) = delta + zeta gamma (I - zeta alpha)^{-1} beta,

    is the complete set, E = 0 the central one. No inverse of M and no cancellations: the central order is exactly n, or
    n - 1 where Taylor coefficients are among the data: A is singular then (A'B = 0) and the state L^{-1}B of the central
    realisation is unobservable, so that it is left out.

    Attributes
    ----------
    V : (n+1, n+1) array
    outer, inner : (n+1, 1) arrays
        u_r and u_d.
    smallest : float
        Smallest eigenvalue of M.
    kept : (n, r) array
        Orthonormal basis of the states of the central interpolant.

    Notes
    -----
    Source: `ball1990` (the set of all solutions); in purpose equation (22) of `inanc2001`, without its inverses.
    """

    V: np.ndarray
    outer: np.ndarray
    inner: np.ndarray
    smallest: float
    kept: np.ndarray

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("V", "outer", "inner", "kept")})

    @property
    def order(self) -> int:
        """Number of states of the central interpolant."""
        return self.kept.shape[1]

    def realise(self, E: Any = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """State space (alpha, beta, gamma, delta) of phi_E, in the scaled variable zeta = z/rho.

        E: a number in [-1, 1], or a stable one-channel `control.StateSpace` (in zeta) with H-infinity norm <= 1.
        """
        n = self.V.shape[0] - 1
        a, b, c, d = _free_parameter(E)
        if not a.size and d[0, 0] == 0:
            alpha, beta, gamma = self.V[:n, :n] @ self.kept, self.V[:n, n:], self.V[n:, :n] @ self.kept
            return self.kept.T @ alpha, self.kept.T @ beta, gamma, self.V[n:, n:]
        full = self.V + self.outer @ d @ self.inner.T
        if not a.size:
            return full[:n, :n], full[:n, n:], full[n:, :n], full[n:, n:]
        alpha = np.block([[full[:n, :n], self.outer[:n] @ c], [b @ self.inner[:n].T, a]])
        beta = np.vstack([full[:n, n:], b @ self.inner[n:].T])
        gamma = np.hstack([full[n:, :n], self.outer[n:] @ c])
        return alpha, beta, gamma, full[n:, n:]

    def evaluate(self, zeta: np.ndarray, E: Any = 0.0) -> np.ndarray:
        """The values phi_E(zeta), |zeta| < 1."""
        return transfer(self.realise(E), zeta)[:, 0, 0]

    def weyl_disc(self, zeta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centre and radius of the disc that the values phi_E(zeta) fill, |zeta| < 1.

        The disc is filled by complex E; models with real coefficients reach a part of it (all its real points at
        real zeta), so it is an outer bound for them.
        """
        zeta = np.atleast_1d(np.asarray(zeta, dtype=complex))
        n = self.V.shape[0] - 1
        inputs = np.hstack([self.V[:n, n:], self.outer[:n]])
        outputs = np.vstack([self.V[n:, :n], self.inner[:n].T])
        through = np.array([[self.V[n, n], self.outer[n, 0]], [self.inner[n, 0], 0.0]])
        P = transfer((self.V[:n, :n], inputs, outputs, through), zeta)
        shrink = 1 - np.abs(P[:, 1, 1]) ** 2
        centre = P[:, 0, 0] + P[:, 0, 1] * P[:, 1, 0] * P[:, 1, 1].conj() / shrink
        return centre, np.abs(P[:, 0, 1] * P[:, 1, 0]) / shrink


def transfer(system: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], zeta: np.ndarray) -> np.ndarray:
    """D + zeta C (I - zeta A)^{-1} B at points, (F, p, q): one Schur form, one substitution for all points of a block."""
    A, B, C, D = system
    n, q = B.shape
    values = np.repeat(np.asarray(D, dtype=complex)[None], zeta.size, axis=0)
    if not n:
        return values
    T, Q = scipy.linalg.schur(A, output="complex")[:2]
    right, left = Q.conj().T @ B, C @ Q
    block = max(1, _BLOCK // q)
    for first in range(0, zeta.size, block):
        points = np.asarray(zeta[first : first + block], dtype=complex)[:, None]
        x = np.empty((n, points.size * q), complex)
        for row in range(n - 1, -1, -1):  # (I - zeta T) x = right, from the last row up
            rest = (T[row, row + 1 :] @ x[row + 1 :]).reshape(points.size, q)
            x[row] = ((right[row] + points * rest) / (1 - points * T[row, row])).ravel()
        outputs = (left @ x).reshape(-1, points.size, q)
        values[first : first + block] += points[..., None] * outputs.transpose(1, 0, 2)
    return values


_BLOCK = 1024  # columns worked on at once: they stay in the cache


def interpolants(sarason: SarasonMap, x: np.ndarray) -> Interpolants:
    """All functions of the unit ball with the data x; needs ||X(x)|| < 1.

    Raises
    ------
    InputError
        Where M = I - X'X is not positive definite: at the edge the interpolant is unique and the form breaks down.
    """
    A, c = sarason.pair.A, sarason.pair.c
    n = sarason.pair.order
    X, x = sarason.matrix(x), np.reshape(x, (1, n))
    # Product form: the eigenvalues of I - X'X near 0 keep their digits.
    _, singular, right = np.linalg.svd(X)
    gaps = (1 - singular) * (1 + singular)
    if n and gaps.min() <= 0:
        raise InputError(f"`x` must lie inside the ball: ||X(x)|| = {singular.max():.12g} is not below 1")
    root: np.ndarray = np.asarray(np.linalg.qr(np.sqrt(gaps)[:, None] * right, mode="r")) if n else np.zeros((0, 0))
    D, R = np.vstack([root @ A, c]), np.vstack([root, x])
    # D'D = R'R = W, so with thin QR factors V = Q_R (R_R R_D^{-1}) Q_D' and the middle factor is orthogonal.
    QD, RD = np.linalg.qr(D, mode="complete")
    QR, RR = np.linalg.qr(R, mode="complete")
    middle = scipy.linalg.solve_triangular(RD[:n].T, RR[:n].T, lower=True).T if n else np.zeros((0, 0))
    left, _, mid_right = np.linalg.svd(middle)
    V = QR[:, :n] @ (left @ mid_right) @ QD[:, :n].T
    kept = np.eye(n)
    if n and sarason.pair.d[0, 0] == 0:
        lost = scipy.linalg.solve_triangular(root.T, sarason.pair.B, lower=True)
        kept = np.linalg.qr(lost, mode="complete")[0][:, 1:]
    return Interpolants(V, QR[:, n:], QD[:, n:], float(gaps.min(initial=1.0)), kept)


def _free_parameter(E: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    empty = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    if isinstance(E, int | float | np.floating | np.integer):
        if not abs(E) <= 1:
            raise InputError(f"`E` must lie in [-1, 1]; got {E:g}")
        return (*empty, np.array([[float(E)]]))
    import control

    if not isinstance(E, control.StateSpace):
        raise InputTypeError(f"`E` must be a number or a control.StateSpace; got {type(E).__name__}")
    if (E.ninputs, E.noutputs) != (1, 1) or E.dt == 0:
        raise InputError("`E` must be a discrete-time system with one input and one output")
    if E.nstates and np.abs(np.linalg.eigvals(E.A)).max() >= 1:
        raise InputError("`E` must be stable")
    poles = np.linalg.eigvals(E.A) if E.nstates else np.zeros(0)
    angles = np.concatenate([np.linspace(0, np.pi, 2049), np.abs(np.angle(poles))])
    peak = float(np.abs(E(np.exp(1j * angles))).max())
    if peak > 1 + 1e-9:
        raise InputError(f"`E` must have H-infinity norm <= 1; got at least {peak:.6g}")
    return np.asarray(E.A), np.asarray(E.B), np.asarray(E.C), np.asarray(E.D)
