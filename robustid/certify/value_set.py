"""What values all consistent systems can take at one frequency: an outer polygon and attained points."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid._arrays import Frozen, freeze
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


def value_set(consistent: ConsistentSet, omega: float, directions: int, gap: float) -> ValueSet:
    """Support function and attained points at one frequency."""
    problem = consistent.posed.problem
    if omega == 0 or omega * problem.dt >= np.pi * (1 - 1e-12):
        angles = np.array([0.0, np.pi])
    else:
        angles = 2 * np.pi * np.arange(directions) / directions
    here = consistent.with_node(omega)
    x, p, tail = here.value_weights(omega)
    support, points, certificates = np.zeros(angles.size), np.full(angles.size, np.nan, complex), []
    for k, angle in enumerate(angles):
        turn = np.exp(-1j * angle)
        found = here.extreme(Functional(np.real(turn * x), np.real(turn * p), tail), gap)
        support[k] = found.upper
        if np.isfinite(found.attained):
            points[k] = x @ found.x + p @ found.p
        certificates.append(found.certificate)
    return ValueSet(omega, angles, support, points, tail, tuple(certificates))


def verify_value_set(consistent: ConsistentSet, found: ValueSet) -> bool:
    """Whether every certificate supports its value, and no value is stated below its certificate."""
    here = consistent.with_node(found.omega)
    x, p, tail = here.value_weights(found.omega)
    rows, sarason = here.data.rows, here.data.sarason
    for angle, support, certificate in zip(found.directions, found.support, found.certificates, strict=True):
        turn = np.exp(-1j * angle)
        functional = Functional(np.real(turn * x), np.real(turn * p), tail)
        if not (certificate.value <= support and certificate.verify(functional, rows, sarason)):
            return False
    return True
