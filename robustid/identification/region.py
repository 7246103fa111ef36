"""Regions in which the non-parametric part is analytic, beyond the circle of the frequencies, mapped on the unit disc."""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import numpy as np

from robustid.bases import InputNormalPair, input_normal_pair, line_section, nodes_pair
from robustid.core import Complex, Frozen, Plane, Real, SPlane, StateMatrices
from robustid.errors import InputError
from robustid.identification.prior import Prior


class Region(abc.ABC):
    """A disc around the circle of the delay q = 1/z = exp(-j angle), mapped on the unit disc of zeta, q = 0 on 0.

    G/K is a function g of the unit ball of H-infinity, of zeta: its values at the frequencies are those at points inside.
    """

    depth_name: ClassVar[str]

    @abc.abstractmethod
    def points(self, angles: Real) -> Complex:
        """Zeta of exp(j angle)."""

    @abc.abstractmethod
    def inside(self, angles: Real) -> Real:
        """``1 - |zeta|^2``, without cancellation."""

    @abc.abstractmethod
    def pair(self, angles: Real, delays: int, first: tuple[float, ...]) -> InputNormalPair:
        """The pair with nodes at the points of angles, those of `first` at the head, and a zero of multiplicity `delays`."""

    @abc.abstractmethod
    def in_z(self, series: StateMatrices) -> StateMatrices:
        """The state space in z = 1/q of one in the series variable zeta."""

    @abc.abstractmethod
    def series(self, states: StateMatrices) -> StateMatrices:
        """The inverse of `in_z`."""

    @abc.abstractmethod
    def poles_in_z(self, poles: Complex) -> Complex:
        """Poles in z of poles of the series variable, the eigenvalues of A."""

    @abc.abstractmethod
    def depth(self, poles: Complex) -> float:
        """Largest 1/|zeta| of poles in z: at most 1 where a function with these poles is analytic in the region."""

    @abc.abstractmethod
    def slope(self, gain: Real, low: Real, high: Real) -> Real:
        r"""Bound of |d G/d angle| on each arc for every G of size K: |g'| <= (1 - |g|^2)/(1 - |zeta|^2), Schwarz and Pick."""

    @abc.abstractmethod
    def bend(self, gain: Real, low: Real, high: Real) -> Real:
        r"""Bound of |d^2 G/d angle^2| on each arc for every G of size K.

        |g^(n)| <= n! (1 - |g|^2)/((1 - |zeta|)^n (1 + |zeta|)) [`ruscheweyh1985`], n = 1 and 2.
        """

    def reach(self, gain: float, angles: Real) -> Real:
        """K (2/pi) K(|zeta|), K(.) the complete elliptic integral: bound of the analytic part of a function of size K, (F,)."""
        import scipy.special

        return np.asarray(gain * 2 / np.pi * scipy.special.ellipkm1(self.inside(angles)), dtype=float)


@dataclasses.dataclass(frozen=True)
class Disc(Frozen, Region):
    """|q| < rho: zeta = q/rho."""

    rate: float

    depth_name = "largest |pole| of the non-parametric part times rho"

    def points(self, angles: Real) -> Complex:
        """``exp(-j angle)/rho``."""
        return np.asarray(np.exp(-1j * angles) / self.rate, dtype=complex)

    def inside(self, angles: Real) -> Real:
        """``1 - rho^-2``."""
        return np.full(np.shape(angles), (1 - 1 / self.rate) * (1 + 1 / self.rate))

    def reach(self, gain: float, angles: Real) -> Real:
        """K (2/pi) K(1/rho)."""
        import scipy.special

        return np.full(np.shape(angles), gain * 2 / np.pi * float(scipy.special.ellipk(self.rate**-2)))

    def pair(self, angles: Real, delays: int, first: tuple[float, ...]) -> InputNormalPair:
        """The pair with all nodes at the radius 1/rho."""
        return input_normal_pair(angles, 1 / self.rate, delays, first=first)

    def in_z(self, series: StateMatrices) -> StateMatrices:
        """``(A/rho, B, C/rho, D)``."""
        A, B, C, D = series
        return StateMatrices(A / self.rate, B, C / self.rate, D)

    def series(self, states: StateMatrices) -> StateMatrices:
        """``(rho A, B, rho C, D)``."""
        A, B, C, D = states
        return StateMatrices(A * self.rate, B, C * self.rate, D)

    def poles_in_z(self, poles: Complex) -> Complex:
        """``pole/rho``."""
        return poles / self.rate

    def depth(self, poles: Complex) -> float:
        """Largest |pole| times rho."""
        return float(np.abs(poles).max(initial=0.0)) * self.rate

    def slope(self, gain: Real, low: Real, high: Real) -> Real:
        """``K rho/(rho^2 - 1)``."""
        return gain * self.rate / ((self.rate - 1) * (self.rate + 1))

    def bend(self, gain: Real, low: Real, high: Real) -> Real:
        """``K rho/(rho - 1)^2``."""
        return gain * self.rate / (self.rate - 1) ** 2


@dataclasses.dataclass(frozen=True)
class HalfPlane(Frozen, Region):
    r"""Re s > -alpha, seen from q = (b - s)/(b + s): a disc that touches the circle of the frequencies at s = infinity.

    .. math:: \zeta = \frac{q}{1 + \kappa + \kappa q}, \qquad \kappa = \alpha/b
    """

    ratio: float  # kappa > 0

    depth_name = "largest pole of the non-parametric part, in the variable in which Re s = -alpha is the unit circle"

    def points(self, angles: Real) -> Complex:
        """``q/(1 + kappa + kappa q)``."""
        q = np.exp(-1j * np.asarray(angles, dtype=float))
        return np.asarray(q / (1 + self.ratio + self.ratio * q), dtype=complex)

    def inside(self, angles: Real) -> Real:
        """``t/(1 + t)``, t = 4 kappa (1 + kappa) cos^2(angle/2)."""
        t = 4 * self.ratio * (1 + self.ratio) * np.cos(np.asarray(angles, dtype=float) / 2) ** 2
        return np.asarray(t / (1 + t), dtype=float)

    def pair(self, angles: Real, delays: int, first: tuple[float, ...]) -> InputNormalPair:
        """The pair of the points, each at its own radius."""
        lines, head = self._nodes(np.sort(angles)), self._nodes(np.array(first))
        return nodes_pair(lines, delays, head)

    def _nodes(self, angles: Real) -> list[Real]:
        radii = 1 / np.sqrt(1 + 4 * self.ratio * (1 + self.ratio) * np.cos(angles / 2) ** 2)
        turns = np.where(angles == 0, 0.0, np.abs(np.angle(self.points(angles))))
        return [line_section(float(turn), float(radius)) for turn, radius in zip(turns, radii, strict=True)]

    def in_z(self, series: StateMatrices) -> StateMatrices:
        """``zeta (I - zeta A)^-1 = q ((1 + kappa) I - q (A - kappa I))^-1``."""
        (A, B, C, D), kappa = series, self.ratio
        root = np.sqrt(1 + kappa)
        return StateMatrices((A - kappa * np.eye(A.shape[0])) / (1 + kappa), B / root, C / root, D)

    def series(self, states: StateMatrices) -> StateMatrices:
        """``A = (1 + kappa) A_z + kappa I``."""
        (A, B, C, D), kappa = states, self.ratio
        root = np.sqrt(1 + kappa)
        return StateMatrices((1 + kappa) * A + kappa * np.eye(A.shape[0]), B * root, C * root, D)

    def poles_in_z(self, poles: Complex) -> Complex:
        """``(pole - kappa)/(1 + kappa)``."""
        return np.asarray((poles - self.ratio) / (1 + self.ratio), dtype=complex)

    def depth(self, poles: Complex) -> float:
        """Largest ``|(1 + kappa) p + kappa|``."""
        return float(np.abs((1 + self.ratio) * poles + self.ratio).max(initial=0.0))

    def slope(self, gain: Real, low: Real, high: Real) -> Real:
        """``K (1 + kappa)/t``, t as in `inside`, at the end that is nearer to infinity."""
        inside = self.inside(high)
        return gain * (1 + self.ratio) * (1 - inside) / inside

    def bend(self, gain: Real, low: Real, high: Real) -> Real:
        """Its value at the end of the arc that is nearer to infinity, where every factor is largest."""
        kappa, inside = self.ratio, self.inside(high)
        near = inside / (1 + np.sqrt(1 - inside))  # 1 - |zeta|
        size = 1 / np.sqrt(1 - inside)  # |1 + kappa + kappa q|
        turned = np.sqrt(1 + 4 * kappa * (1 + kappa) * np.sin(high / 2) ** 2)  # |1 + kappa - kappa q|
        slope = (1 + kappa) / size**2
        return gain * (2 * slope**2 / (near * inside) + slope * turned / size / inside)


def region_of(prior: Prior, plane: Plane) -> Region:
    """The region in which G of a class is analytic; refuses a decay rate per sample for data of continuous time."""
    if isinstance(plane, SPlane):
        if prior.decay is None:
            raise InputError(
                f"`prior` has decay_rate = {prior.decay_rate:g} per sample, the data are of continuous time (no sample time `dt`):"
                " give the prior its `decay` in 1/s in its place, or the data their `dt`"
            )
        return HalfPlane(prior.decay / plane.corner)
    return Disc(prior.decay_rate)
