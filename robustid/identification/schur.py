"""All interpolants of many Taylor coefficients by the Schur algorithm: O(L^2) work, O(L) memory, no matrices."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import math

import numpy as np

from robustid.core import Complex, Frozen, Numbers, Real, as_array, as_count, as_float, freeze
from robustid.errors import InputError

# Points handled together: their vectors stay in the cache while all L sections pass over them.
_CHUNK = 4096

# exp(j angle) has modulus 1 only to rounding.
_ON_CIRCLE = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class TaylorInterpolants(Frozen):
    """Every function of the unit ball with L given Taylor coefficients: phi_E = phi_0, phi_L = E, E in the unit ball, and phi_k
    = (gamma_k + zeta phi_(k+1)) / (1 + gamma_k zeta phi_(k+1)). Source: Schur 1917; `ball1990` for the set of all solutions.
    """

    # E = 0 is the central one, a ratio of polynomials of degree L - 1 at most. Same set as `Interpolants` of a pair without
    # frequency points, for any L: that one needs matrices of size L. Values come from these maps, which contract the hyperbolic
    # metric of the disc; the polynomials of `central` lose one digit or two against them as |E| and the gain tend to 1.

    gamma: Real  # (L,), Schur parameters, all inside (-1, 1)

    def __post_init__(self) -> None:
        self._set(gamma=freeze(self.gamma))

    def central(self) -> tuple[Real, Real]:
        """Coefficients of P and Q, natural order, each (L,): phi_0 = P/Q, |Q|^2 - |P|^2 = 1 on the circle, Q without zeros
        inside it. With p, q their reversals, zeta^(L-1) P(1/zeta) and zeta^(L-1) Q(1/zeta), phi_E = (P + zeta q E)/(Q + zeta
        p E).
        """
        P, Q = np.zeros((2, self.gamma.size))
        Q[0] = 1.0
        for gamma in self.gamma[::-1]:
            s = _complement(gamma)
            P[1:], P[0] = P[:-1], 0.0
            Q = (Q + gamma * P) / s
            P = s * P + gamma * Q
        return P, Q

    def coefficients(self, count: int, E: object = 0.0) -> Real:
        """The first `count` Taylor coefficients of phi_E, E a number in [-1, 1]."""
        import scipy.signal

        pulse, E = np.zeros(as_count("count", count)), _constant(E)
        pulse[:1] = 1.0
        P, Q = self.central()
        above, below = np.append(P, 0.0), np.append(Q, 0.0)
        return np.asarray(scipy.signal.lfilter(above + E * below[::-1], below + E * above[::-1], pulse))

    def evaluate(self, zeta: Numbers, E: object = 0.0) -> Complex:
        """The values phi_E(zeta), |zeta| <= 1, E a number in [-1, 1]; O(L) per point."""
        return self._pull_back(zeta, _constant(E), 0.0)[0]

    def weyl_disc(self, zeta: Numbers) -> tuple[Complex, Real]:
        """Centre and radius of the disc that the values phi_E(zeta) fill, |zeta| <= 1, as in `Interpolants`."""
        return self._pull_back(zeta, 0.0, 1.0)

    def weyl_ball(self, zeta: Numbers) -> tuple[Complex, Real, Real]:
        """`weyl_disc` as a matrix ball: centre, left and right radius, each (F, 1, 1)."""
        centre, radius = self.weyl_disc(zeta)
        return centre[:, None, None], radius[:, None, None], np.ones((radius.size, 1, 1))

    def _pull_back(self, zeta: Numbers, centre: float, radius: float) -> tuple[Complex, Real]:
        """The disc of the values phi_E(zeta) for E in a disc: one Mobius map a section."""
        zeta = np.atleast_1d(as_array("zeta", zeta, dtype=complex))
        if np.abs(zeta).max(initial=0.0) > 1 + _ON_CIRCLE:
            raise InputError(f"`zeta` must lie in the closed unit disc; got a modulus of {np.abs(zeta).max():.12g}")
        centres, radii = np.full(zeta.shape, centre, dtype=complex), np.full(zeta.shape, radius)
        for start in range(0, zeta.shape[0], _CHUNK):
            part = slice(start, start + _CHUNK)
            point, c, r = zeta[part], centres[part], radii[part]
            modulus = np.abs(point)
            for gamma in self.gamma[::-1]:
                w, r = point * c, modulus * r
                below = 1 + gamma * w
                size = below.real**2 + below.imag**2 - (gamma * r) ** 2
                c = ((gamma + w) * below.conj() - gamma * r**2) / size
                r = (1 - gamma) * (1 + gamma) * r / size
            centres[part], radii[part] = c, r
        return centres, radii


def taylor_interpolants(x: Real) -> TaylorInterpolants:
    """All functions of the unit ball with the Taylor coefficients x (L,), of G = K phi(z/rho) x_k = g_k rho^k/K; needs ||X(x)||
    < 1. Source: Schur 1917; the mixed form of the hyperbolic rotation of Bojanczyk, Brent, Van Dooren and de Hoog 1987.
    """
    # gamma_k = phi_k(0) and zeta phi_(k+1) = (phi_k - gamma_k)/(1 - gamma_k phi_k). With phi_k = b/f, one section turns (f, b)
    # into ((f - gamma b)/s, (b - gamma f)/s), s = sqrt(1 - gamma^2). The second is computed from the new f as s b - gamma f: an
    # orthogonal relation, which rounding errors of earlier steps pass through without growing. The coefficients of the result
    # agree with x to 1e-12, also at ||X(x)|| = 1 - 1e-10 and L = 2000.
    x = as_array("x", x, ndim=1)
    if not x.size:
        raise InputError("`x` must hold at least one Taylor coefficient; got none")
    forward, back, gamma = np.zeros(x.size), x, np.empty(x.size)
    forward[0] = 1.0
    for k in range(x.size):
        gamma[k] = back[0] / forward[0]
        if not abs(gamma[k]) < 1:
            raise InputError(
                f"`x` must lie inside the ball: the Schur parameter of coefficient {k} is {gamma[k]:.12g}, so that"
                " ||X(x)|| is not below 1"
            )
        s = _complement(gamma[k])
        forward = (forward - gamma[k] * back) / s
        back = (s * back - gamma[k] * forward)[1:]
        forward = forward[:-1]
    return TaylorInterpolants(gamma)


def _complement(gamma: float) -> float:
    """sqrt(1 - gamma^2), with the digits of 1 - |gamma|."""
    return math.sqrt((1 - gamma) * (1 + gamma))


def _constant(E: object) -> float:
    number = as_float("E", E)
    if not abs(number) <= 1:
        raise InputError(f"`E` must lie in [-1, 1]; got {number:g}")
    return number
