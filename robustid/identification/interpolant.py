"""Central interpolant in closed form, the set of all interpolants, and their value discs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from robustid.bases import InputNormalPair
from robustid.core import Complex, Frozen, Model, Numbers, Real, as_array, as_kind, freeze, series_at
from robustid.errors import InputError

# A number in [-1, 1], a real matrix of norm at most 1, or a stable system of H-infinity norm at most 1.
FreeParameter = ArrayLike | Model


@dataclasses.dataclass(frozen=True, eq=False)
class Interpolants(Frozen):
    """Every function of the unit ball with given data x: phi_E(zeta), E any function of the unit ball, E = 0 the central one.

    Source: `ball1990` (the set of all solutions); in purpose equation (22) of `inanc2001`, without its inverses.
    """

    # With M = I - X'X > 0, M = LL', W = M + x'x = A'MA + c'c, D = [L'A; c], R = [L'; x], the matrix V = R W^{-1} D' is a
    # partial isometry; with u_d, u_r spanning the null spaces of D' and R',
    #     V + u_r E u_d' = [alpha beta; gamma delta],   phi_E(zeta) = delta + zeta gamma (I - zeta alpha)^{-1} beta,
    # is the complete set. No inverse of M and no cancellations: the central order is exactly n, or n - 1 where Taylor
    # coefficients are among the data: A is singular then (A'B = 0) and the state L^{-1}B of the central realisation is
    # unobservable, so that it is left out. Of p x q functions A, c stand for A (x) I, c (x) I, and the order is n q (or (n - 1)
    # q); with fewer outputs than inputs all is done with the transposed function, of order n p.

    V: Real  # (n+1, n+1); of matrices (nq+p, nq+q), of transposed ones with p and q exchanged
    outer: Real  # (n+1, 1), of matrices (nq+p, p): u_r
    inner: Real  # (n+1, 1), of matrices (nq+q, q): u_d
    smallest: float  # smallest eigenvalue of M
    kept: Real  # (n, r), orthonormal basis of the states of the central interpolant
    transposed: bool = False  # whether the function is the transpose of that of these arrays

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("V", "outer", "inner", "kept")})

    @property
    def order(self) -> int:
        """Number of states of the central interpolant."""
        return self.kept.shape[1]

    def realise(self, E: FreeParameter = 0.0) -> tuple[Real, Real, Real, Real]:
        """State space (alpha, beta, gamma, delta) of phi_E, in the scaled variable zeta = z/rho; E a number in [-1, 1], for MIMO
        a real matrix (p, q) of norm at most 1 (0: all entries 0), or a stable `control.StateSpace` (in zeta) of H-infinity
        norm <= 1.
        """
        n = self.kept.shape[0]
        p, q = self.outer.shape[1], self.inner.shape[1]
        a, b, c, d = _free_parameter(E, (q, p) if self.transposed else (p, q))
        if self.transposed:
            a, b, c, d = a.T, c.T, b.T, d.T
        if not a.size and not d.any():
            alpha, beta, gamma = self.V[:n, :n] @ self.kept, self.V[:n, n:], self.V[n:, :n] @ self.kept
            return self._as_asked(self.kept.T @ alpha, self.kept.T @ beta, gamma, self.V[n:, n:])
        full = self.V + self.outer @ d @ self.inner.T
        if not a.size:
            return self._as_asked(full[:n, :n], full[:n, n:], full[n:, :n], full[n:, n:])
        alpha = np.block([[full[:n, :n], self.outer[:n] @ c], [b @ self.inner[:n].T, a]])
        beta = np.vstack([full[:n, n:], b @ self.inner[n:].T])
        gamma = np.hstack([full[n:, :n], self.outer[n:] @ c])
        return self._as_asked(alpha, beta, gamma, full[n:, n:])

    def _as_asked(self, alpha: Real, beta: Real, gamma: Real, delta: Real) -> tuple[Real, Real, Real, Real]:
        """The realisation of the function itself."""
        return (alpha.T, gamma.T, beta.T, delta.T) if self.transposed else (alpha, beta, gamma, delta)

    def evaluate(self, zeta: Numbers, E: FreeParameter = 0.0) -> Complex:
        """The values phi_E(zeta), |zeta| < 1, (F,); for MIMO (F, p, q)."""
        values = series_at(self.realise(E), zeta)
        return values[:, 0, 0] if values.shape[1:] == (1, 1) else values

    def weyl_disc(self, zeta: Numbers) -> tuple[Complex, Real]:
        """Centre and radius of the disc that the values phi_E(zeta) fill, |zeta| < 1. SISO; `weyl_ball` for MIMO. Complex E fill
        it: of models with real coefficients, which reach a part of it (all its real points at real zeta), it is an outer
        bound.
        """
        centre, left, right = self.weyl_ball(zeta)
        return centre[:, 0, 0], np.abs(left * right)[:, 0, 0]

    def weyl_ball(self, zeta: Numbers) -> tuple[Complex, Complex, Complex]:
        """Centre (F, p, q), left radius (F, p, p) and right radius (F, q, q) of the matrix ball of values, |zeta| < 1.

        phi_E(zeta) = centre + left U right with any complex matrix U of norm at most 1, as E runs through the unit ball.
        """
        zeta = np.atleast_1d(np.asarray(zeta, dtype=complex))
        n, p, q = self.kept.shape[0], self.outer.shape[1], self.inner.shape[1]
        inputs = np.hstack([self.V[:n, n:], self.outer[:n]])
        outputs = np.vstack([self.V[n:, :n], self.inner[:n].T])
        through = np.block([[self.V[n:, n:], self.outer[n:]], [self.inner[n:].T, np.zeros((q, p))]])
        P = series_at((self.V[:n, :n], inputs, outputs, through), zeta)
        inner, before, after = P[:, p:, q:], P[:, :p, q:], P[:, p:, :q]
        # phi = P11 + P12 E (I - P22 E)^{-1} P21: the maximum principle of matrix Moebius maps.
        adjoint = inner.conj().transpose(0, 2, 1)
        first = _inverse_root(np.eye(p) - adjoint @ inner)
        second = _inverse_root(np.eye(q) - inner @ adjoint)
        centre = P[:, :p, :q] + before @ adjoint @ second @ second @ after
        left, right = before @ first, second @ after
        if self.transposed:
            return centre.transpose(0, 2, 1), right.transpose(0, 2, 1), left.transpose(0, 2, 1)
        return centre, left, right


def _inverse_root(matrices: Complex) -> Complex:
    """H^{-1/2} of Hermitian positive definite matrices."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors / np.sqrt(values)[:, None, :]) @ vectors.conj().transpose(0, 2, 1), dtype=complex)


_ROUNDED = 1e-14  # what rounding adds to the norm of an orthogonal matrix


def interpolants(pair: InputNormalPair, parts: NDArray[np.float64], full: NDArray[np.float64]) -> Interpolants:
    """All functions of the unit ball with the data X(x) and x entry by entry, (p, q, n, n) and (p, q, n); needs ||X(x)|| < 1: at
    the edge the interpolant is unique and the form breaks down.
    """
    n, (p, q) = pair.order, full.shape[:2]
    transposed = p < q
    if transposed:
        p, q, parts, full = q, p, parts.transpose(1, 0, 2, 3), full.transpose(1, 0, 2)
    X, x = parts.transpose(2, 0, 3, 1).reshape(n * p, n * q), full.transpose(0, 2, 1).reshape(p, n * q)
    # Product form: the eigenvalues of I - X'X near 0 keep their digits.
    _, singular, right = np.linalg.svd(X, full_matrices=False)
    gaps = (1 - singular) * (1 + singular)
    if n and gaps.min() <= 0:
        raise InputError(f"`x` must lie inside the ball: ||X(x)|| = {singular.max():.12g} is not below 1")
    root: Real = np.asarray(np.linalg.qr(np.sqrt(gaps)[:, None] * right, mode="r")) if n else np.zeros((0, 0))
    return from_factors(
        pair, root, np.asarray(np.kron(pair.c, np.eye(q)), dtype=float), x, float(gaps.min(initial=1.0)), transposed
    )


def from_factors(
    pair: InputNormalPair, root: Real, inputs: Real, outputs: Real, smallest: float, transposed: bool = False
) -> Interpolants:
    """The functions phi with V = R W^-1 D', D = [root A; inputs], R = [root; outputs], W = D'D = R'R; root'root = M, `inputs` c
    and `outputs` x those of `interpolants`: a common factor on the right of all three changes nothing.
    """
    n, q, size = pair.order, inputs.shape[0], inputs.shape[1]
    A, B = (np.kron(part, np.eye(q)) for part in (pair.A, pair.B))
    D, R = np.vstack([root @ A, inputs]), np.vstack([root, outputs])
    # D'D = R'R = W, so with thin QR factors V = Q_R (R_R R_D^{-1}) Q_D' and the middle factor is orthogonal.
    QD, RD = np.linalg.qr(D, mode="complete")
    QR, RR = np.linalg.qr(R, mode="complete")
    middle = scipy.linalg.solve_triangular(RD[:size].T, RR[:size].T, lower=True).T if n else np.zeros((0, 0))
    left, _, mid_right = np.linalg.svd(middle)
    V = QR[:, :size] @ (left @ mid_right) @ QD[:, :size].T
    kept = np.eye(size)
    if n and pair.d[0, 0] == 0:
        lost = scipy.linalg.solve_triangular(root.T, B, lower=True)
        kept = np.linalg.qr(lost, mode="complete")[0][:, q:]
    return Interpolants(V, QR[:, size:], QD[:, size:], smallest, kept, transposed)


def _free_parameter(E: Any, shape: tuple[int, int]) -> tuple[Real, Real, Real, Real]:
    """State space of the free parameter, checked."""
    p, q = shape
    if not hasattr(E, "ninputs"):
        d = as_array("E", E)
        if d.ndim == 0 and (not d or shape == (1, 1)):
            d = np.full(shape, float(d))
        if d.shape != shape:
            raise InputError(f"`E` must have shape (ny, nu) = {shape}; got {d.shape}")
        if not np.linalg.norm(d, 2) <= 1 + (d.size > 1) * _ROUNDED:
            end = "lie in [-1, 1]" if shape == (1, 1) else "have norm at most 1"
            raise InputError(f"`E` must {end}; got {d.item() if d.size == 1 else np.linalg.norm(d, 2):g}")
        return np.zeros((0, 0)), np.zeros((0, q)), np.zeros((p, 0)), d
    import control

    as_kind("E", E, control.StateSpace, "a number, a matrix or a control.StateSpace")
    if (E.noutputs, E.ninputs) != shape or E.dt == 0:
        raise InputError(
            f"`E` must be a discrete-time system with {q} input{'s' * (q != 1)} and {p} output{'s' * (p != 1)}"
        )
    A: Numbers = E.A
    if E.nstates and np.abs(np.linalg.eigvals(A)).max() >= 1:
        raise InputError("`E` must be stable")
    poles = np.linalg.eigvals(A) if E.nstates else np.zeros(0)
    angles = np.concatenate([np.linspace(0, np.pi, 2049), np.abs(np.angle(poles))])
    a, b, c, d = (np.asarray(part) for part in (E.A, E.B, E.C, E.D))
    values = series_at((a, b, c, d), np.exp(-1j * angles))
    peak = float(np.linalg.norm(values, 2, axis=(1, 2)).max())
    if peak > 1 + 1e-9:
        raise InputError(f"`E` must have H-infinity norm <= 1; got at least {peak:.6g}")
    return a, b, c, d
