"""Values of all consistent systems at one frequency: an outer polygon, attained points, and the claims with their certificates."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from robustid.core import Complex, Frozen, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, which
from robustid.identification import (
    Functional,
    MarginCertificate,
    SupportCertificate,
    verify_margin_exactly,
    verify_support_exactly,
)
from robustid.identification.formulation import Rows, SarasonMap

SUMS = 1 + 2.0**-51  # most that a bound can be above a sum of two doubles that stands for it
FINE = 4  # times as many directions are taken, where the largest singular value of a matrix asks for them


@dataclasses.dataclass(frozen=True, eq=False)
class SupportClaim(Frozen):
    """`functional` is at most `stated` for every consistent system, by a certificate."""

    name: str  # where in the result this is said
    functional: Functional
    stated: float
    certificate: SupportCertificate
    rows: Rows
    sarason: SarasonMap  # the problem in the form in which the certificate is about it

    def verify(self, exact: bool = False) -> bool:
        """Return whether the certificate is about all consistent systems, proves what is stated, and holds when evaluated anew.

        `exact` evaluates it in ball arithmetic too, which needs the extra `robustid[exact]`.
        """
        proof = self.certificate
        if not (self._fits and proof.level >= 1 and proof.value <= self.stated):
            return False
        arguments = self.functional, self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_support_exactly(proof, *arguments))

    @property
    def _fits(self) -> bool:
        """Return whether the multipliers are numbers, as many as the problem asks for."""
        proof, (high, wide) = self.certificate, self.sarason.shape
        rank = proof.left.shape[1:]
        shapes = (proof.samples.shape, proof.left.shape, proof.right.shape) == (
            self.rows.y.shape,
            (high, *rank),
            (wide, *rank),
        )
        return shapes and all(np.all(np.isfinite(a)) for a in (proof.samples, proof.left, proof.right))


class RelaxedClaim(SupportClaim):
    """A `SupportClaim` about a relaxed problem, whose bounds are sums that may be too small by one rounding."""

    def verify(self, exact: bool = False) -> bool:
        """As of any claim; in ball arithmetic for bounds that are larger by so much."""
        if not super().verify():
            return False
        proof = dataclasses.replace(self.certificate, level=self.certificate.level * SUMS)
        return not exact or verify_support_exactly(proof, self.functional, self.rows, self.sarason)


@dataclasses.dataclass(frozen=True, eq=False)
class RefutationClaim(Frozen):
    """The margin of a relaxed problem exceeds 1, by a certificate."""

    name: str  # where in the result this is said
    certificate: MarginCertificate
    rows: Rows
    sarason: SarasonMap  # the problem in the form in which the certificate is about it

    def verify(self, exact: bool = False) -> bool:
        """Return whether the certificate is about the problem, says more than 1, and holds evaluated anew; see `SupportClaim`."""
        proof = self.certificate
        fits = proof.samples.shape == self.rows.y.shape and proof.ball.shape == self.sarason.shape
        numbers = all(np.all(np.isfinite(a)) for a in (proof.samples, proof.ball, proof.upper))
        if not (fits and numbers and proof.value > SUMS):
            return False
        arguments = self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_margin_exactly(proof, *arguments))


@dataclasses.dataclass(frozen=True, eq=False)
class ValueSet(Frozen):
    """The values of an entry of F(exp(j omega T)), of all consistent systems: convex, in a polygon, around attained points.

    Re(exp(-j theta_i) F) <= support_i for every consistent F, with a certificate each; points_i is the value of a consistent
    system that comes near to it.

    Attributes
    ----------
    omega : float, rad/s
    directions : (m,) array, rad
        theta_i, rising, less than pi apart; equally spaced for SISO. 0 and pi where the response is real (omega = 0 and pi/dt).
    support : (m,) array
    points : (m,) complex array
        NaN where no member was verified.
    slack : float
        Each value of `points` is the attained one but for this much (Taylor form; 0 in the exact form).
    certificates : tuple of SupportCertificate
    entry : (int, int)
        Output and input.
    matrices : (m, ny, nu) complex array; MIMO: (m + 2, ny, nu)
        The whole values of the systems of `points`, of one that is far from the centre in this entry, and of one far in the largest
        singular value.
    """

    omega: float
    directions: Real
    support: Real
    points: Complex
    slack: float
    certificates: tuple[SupportCertificate, ...]
    entry: Entry = (0, 0)
    matrices: Any = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("directions", "support", "points")})
        self._set(matrices=freeze(self.points[:, None, None] if self.matrices is None else self.matrices))

    @property
    def vertices(self) -> Complex:
        """Corners of the outer polygon, between neighbouring directions; the ends of the interval of a real response."""
        if self.directions.size == 2:
            return np.array([self.support[0], -self.support[1]], complex)
        return corners(self.directions, self.support)

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
        """Lower bound of the distance of a value from every consistent one; 0 inside."""
        return max(0.0, float((np.real(np.exp(-1j * self.directions) * value) - self.support).max()))


def corners(directions: Real, support: Real) -> Complex:
    """Points where neighbouring sides Re(exp(-j theta) v) = support of a closed polygon meet."""
    there, turn = np.roll(support, -1), turns(directions)
    with np.errstate(invalid="ignore"):  # of sides without a bound
        found = np.exp(1j * directions) * (support + 1j * (there - support * np.cos(turn)) / np.sin(turn))
    return np.where(np.isfinite(found), found, np.inf)


def turns(directions: Real) -> Real:
    """Angles from each direction to the next, around the circle."""
    return np.diff(np.append(directions, directions[:1] + 2 * np.pi))


def closes(directions: Real, omega: float, dt: float) -> bool:
    """Say whether these directions bound the values at a frequency from all sides; both ends of the interval of a real response."""
    if directions_at(omega, dt, 3).size == 2:
        return np.array_equal(directions, [0.0, np.pi])
    return directions.size >= 3 and bool(np.all((turns(directions) > 0) & (turns(directions) < np.pi)))


def directions_at(omega: float, dt: float, count: int) -> Real:
    """The directions of a polygon with `count` sides, rad; 0 and pi where the response is real."""
    if omega == 0 or omega * dt >= np.pi * (1 - 1e-12):
        return np.array([0.0, np.pi])
    return 2 * np.pi * np.arange(count) / count


def gap_of(rtol: float, directions: int, single: bool) -> float:
    """Part of the distance from the centre to which sides are found; of matrices they follow it, of one entry they are given.

    What the corners of a polygon with so many sides leave of the tolerance, as far as it is more than a fifth of it.
    """
    if not single:
        return rtol / 5
    corner = float(np.cos(np.pi / directions))
    room = corner / (1 - rtol) - 1 if rtol < 1 else np.inf
    return min(float(np.clip(0.8 * room, rtol / 5, rtol / 2)), 1.5 * (1 / corner - 1))


def value_set_claims(consistent: ConsistentSet, *found: ValueSet) -> Iterator[SupportClaim]:
    """Claims of the polygons of one frequency, side by side; without a solver."""
    problem, omega = consistent.posed.problem, found[0].omega
    here = dataclasses.replace(consistent, posed=consistent.posed_at(omega))
    for one in found:
        x, p, tail = here.value_weights(omega, one.entry)
        # Else there are no corners of a polygon around all values.
        closed = one.omega == omega and closes(one.directions, omega, problem.dt)
        for k, (angle, support, proof) in enumerate(zip(one.directions, one.support, one.certificates, strict=closed)):
            name = f"{omega:.6g} rad/s{which(problem, one.entry)}, direction {k + 1} of {one.directions.size}"
            stated = float(support) if closed else -np.inf
            yield SupportClaim(name, along(angle, x, p, tail), stated, proof, here.data.rows, here.data.sarason)


def by_frequency(values: Iterable[ValueSet]) -> dict[float, tuple[ValueSet, ...]]:
    """The sets of the entries at each frequency, in their order."""
    return {omega: tuple(sets) for omega, sets in itertools.groupby(values, key=lambda one: one.omega)}


class Errors(NamedTuple):
    """Bounds of F - model at one frequency: of the entries (ny, nu), and of the largest singular value; attained ones."""

    upper: Real
    lower: Real
    sigma_upper: float
    sigma_lower: float


def largest_errors(found: Sequence[ValueSet], nominal: Complex, limit: float) -> Errors:
    """Errors of all entries at one frequency, around a nominal value (ny, nu); `limit` bounds the largest singular value."""
    sets = {one.entry: one for one in found}
    upper, lower, slack = (np.zeros(nominal.shape) for _ in range(3))
    for entry in np.ndindex(*nominal.shape):
        one = sets[entry] if entry in sets else sets[entry[::-1]]
        upper[entry], lower[entry] = one.farthest(complex(nominal[entry]))
        slack[entry] = one.slack
    if upper.size == 1:
        return Errors(upper, lower, float(upper[0, 0]), float(lower[0, 0]))
    sigma = min(float(norm_of_bounds(upper)), limit)
    matrices = np.concatenate([one.matrices for one in found])
    matrices = matrices[~np.isnan(matrices).any(axis=(1, 2))]
    # A system that is far in one entry may be far in another.
    lower = np.clip(np.abs(matrices - nominal).max(axis=0, initial=0.0) - slack, lower, upper)
    reached = np.linalg.norm(matrices - nominal, 2, axis=(1, 2))
    attained = max(float(reached.max(initial=0.0)) - schur_bound(slack), float(lower.max()))
    return Errors(upper, lower, sigma, min(attained, sigma))


def norm_of_bounds(bounds: Real) -> Real:
    """Upper bound of the largest singular value of every matrix whose entries are at most so large: (..., ny, nu) to (...).

    sigma_max(E) <= sigma_max([|E_ij|]) <= sigma_max(bounds), since the norm of a non-negative matrix grows with its entries.
    """
    if bounds.shape[-2:] == (1, 1):
        return bounds[..., 0, 0]
    infinite = np.max(bounds, axis=(-2, -1)) == np.inf
    norm = np.linalg.norm(np.where(bounds == np.inf, 0.0, bounds), 2, axis=(-2, -1)) * (1 + 1e-12)
    return np.where(infinite, np.inf, norm)


def schur_bound(scales: Real) -> float:
    """Upper bound of the largest singular value of all entrywise products of the scales and a matrix of norm 1.

    sum_k s_k max|u_k| max|v_k| over singular values and vectors: each term is diag(u_k) M diag(v_k). Exact of rank one.
    """
    left, size, right = np.linalg.svd(scales)
    largest = np.abs(left).max(axis=0)[: size.size] * np.abs(right).max(axis=1)[: size.size]
    return float(size @ largest) * (1 + 1e-12)


def along(angle: float, x: Complex, p: Complex, tail: float) -> Functional:
    """Re(exp(-j angle) F)."""
    turn = np.exp(-1j * angle)
    return Functional(np.real(turn * x), np.real(turn * p), tail)
