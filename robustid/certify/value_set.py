"""What values all consistent systems can take at one frequency: an outer polygon and attained points."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.certify.claims import SupportClaim
from robustid.certify.consistent_set import ConsistentSet
from robustid.interpolation import Functional, SupportCertificate


@dataclasses.dataclass(frozen=True, eq=False)
class ValueSet(Frozen):
    """The values F(exp(j omega T)) of all consistent systems: convex, inside a polygon, around points that are attained.

    Re(exp(-j theta_i) F) <= support_i for every consistent F, with a certificate each; points_i is the value of a consistent
    system that comes near to it.

    Attributes
    ----------
    omega : float, rad/s
    directions : (m,) array, rad
        theta_i, equally spaced; 0 and pi where the response is real (omega = 0 and pi/dt).
    support : (m,) array
    points : (m,) complex array
        NaN where no member was verified.
    slack : float
        Each value of `points` is the attained one but for this much (Taylor form; 0 in the exact form).
    certificates : tuple of SupportCertificate
    """

    omega: float
    directions: np.ndarray
    support: np.ndarray
    points: np.ndarray
    slack: float
    certificates: tuple[SupportCertificate, ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("directions", "support", "points")})

    @property
    def vertices(self) -> np.ndarray:
        """Corners of the outer polygon, between neighbouring directions; the ends of the interval of a real response."""
        if self.directions.size == 2:
            return np.array([self.support[0], -self.support[1]], complex)
        here, there = self.support, np.roll(self.support, -1)
        turn = 2 * np.pi / self.directions.size
        # Where Re(exp(-j theta) v) = here and Re(exp(-j (theta + turn)) v) = there.
        return np.exp(1j * self.directions) * (here + 1j * (there - here * np.cos(turn)) / np.sin(turn))

    def farthest(self, nominal: complex) -> tuple[float, float]:
        """Largest |F - nominal|: an upper bound, from the polygon, and a lower one, attained."""
        upper = float(np.abs(self.vertices - nominal).max())
        reached = np.abs(self.points - nominal)
        lower = float(np.nanmax(reached)) - self.slack if np.any(np.isfinite(reached)) else 0.0
        return upper, min(max(lower, 0.0), upper)

    @property
    def magnitude(self) -> tuple[float, float]:
        """Guaranteed range of |F|."""
        return max(0.0, float((-self.support).max())), float(np.abs(self.vertices).max())

    @property
    def phase(self) -> tuple[float, float]:
        """Guaranteed range of the phase, rad: from lowest to highest, less than 2 pi wide; (-pi, pi) where F may be 0."""
        if not self.magnitude[0] > 0:
            return -np.pi, np.pi
        middle = np.angle(np.mean(self.vertices))
        offsets = np.angle(self.vertices * np.exp(-1j * middle))
        return float(middle + offsets.min()), float(middle + offsets.max())

    def excludes(self, value: complex) -> float:
        """How far a value lies outside of every consistent one, at least; 0 inside."""
        return max(0.0, float((np.real(np.exp(-1j * self.directions) * value) - self.support).max()))


def directions_at(omega: float, dt: float, count: int) -> np.ndarray:
    """The directions of a polygon with `count` sides, rad; 0 and pi where the response is real."""
    if omega == 0 or omega * dt >= np.pi * (1 - 1e-12):
        return np.array([0.0, np.pi])
    return 2 * np.pi * np.arange(count) / count


def value_set(consistent: ConsistentSet, omega: float, directions: int, gap: float) -> ValueSet:
    """Support function and attained points at one frequency."""
    angles = directions_at(omega, consistent.posed.problem.dt, directions)
    here = consistent.with_node(omega)
    x, p, tail = here.value_weights(omega)
    support, points, certificates = np.zeros(angles.size), np.full(angles.size, np.nan, complex), []
    for k, angle in enumerate(angles):
        found = here.extreme(_along(angle, x, p, tail), gap)
        support[k] = found.upper
        if np.isfinite(found.attained):
            points[k] = x @ found.x + p @ found.p
        certificates.append(found.certificate)
    return ValueSet(omega, angles, support, points, tail, tuple(certificates))


def value_set_claims(consistent: ConsistentSet, found: ValueSet) -> Iterator[SupportClaim]:
    """What the polygon says, side by side; without a solver."""
    here = dataclasses.replace(consistent, posed=consistent.posed_at(found.omega))
    x, p, tail = here.value_weights(found.omega)
    # Two sides close no polygon in the plane.
    angles = directions_at(found.omega, consistent.posed.problem.dt, max(found.directions.size, 3))
    even = np.array_equal(angles, found.directions)  # else the corners of the polygon are not where they are said to be
    for k, (angle, support, proof) in enumerate(zip(angles, found.support, found.certificates, strict=even)):
        name = f"{found.omega:.6g} rad/s, direction {k + 1} of {angles.size}"
        stated = float(support) if even else -np.inf
        yield SupportClaim(name, _along(angle, x, p, tail), stated, proof, here.data.rows, here.data.sarason)


def _along(angle: float, x: np.ndarray, p: np.ndarray, tail: float) -> Functional:
    """Re(exp(-j angle) F)."""
    turn = np.exp(-1j * angle)
    return Functional(np.real(turn * x), np.real(turn * p), tail)
