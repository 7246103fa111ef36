"""Values of all consistent systems at one frequency: an outer polygon and attained points."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, Extreme, SupportClaim, independent_entries, which
from robustid.identification import Functional, SupportCertificate


@dataclasses.dataclass(frozen=True, eq=False)
class ValueSet(Frozen):
    """The values of an entry of F(exp(j omega T)), of all consistent systems: convex, in a polygon, around attained points.

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
    entry : (int, int)
        Output and input.
    matrices : (m, ny, nu) complex array; MIMO: (m + 1, ny, nu)
        The whole values of the systems of `points`, and of one more that is far from the centre in the largest singular value.
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
        """Lower bound of the distance of a value from every consistent one; 0 inside."""
        return max(0.0, float((np.real(np.exp(-1j * self.directions) * value) - self.support).max()))


def directions_at(omega: float, dt: float, count: int) -> Real:
    """The directions of a polygon with `count` sides, rad; 0 and pi where the response is real."""
    if omega == 0 or omega * dt >= np.pi * (1 - 1e-12):
        return np.array([0.0, np.pi])
    return 2 * np.pi * np.arange(count) / count


def value_sets_at(consistent: ConsistentSet, omega: float, directions: int, gap: float) -> tuple[ValueSet, ...]:
    """Support function and attained points at one frequency, of every independent entry.

    MIMO: each entry is followed by a step towards the largest singular value of F - C, C the value of the centre:
    with the singular vectors of the farthest value so far, the largest Re u'(F - C)v over the set is no smaller.
    """
    angles = directions_at(omega, consistent.posed.problem.dt, directions)
    here, entries = consistent.with_node(omega), consistent.posed.problem.entries
    shape = entries.outputs, entries.inputs
    parts = [here.value_weights(omega, entry) for entry in np.ndindex(*shape)]
    x, p, tail = (np.stack(part) for part in zip(*parts, strict=True))

    def value(found: Extreme) -> NDArray[Any]:
        return (x @ found.x + p @ found.p if np.isfinite(found.attained) else np.full(tail.size, np.nan)).reshape(shape)

    sets: list[ValueSet] = []
    nothing = np.full(shape, np.nan)
    centre, farthest = (x @ here.center.x + p @ here.center.p).reshape(shape), nothing
    for entry in independent_entries(entries):
        k = int(np.ravel_multi_index(entry, shape))
        found = [here.extreme(_along(angle, x[k], p[k], tail[k]), gap) for angle in angles]
        matrices = [value(one) for one in found]
        if not entries.single:
            farthest = max([farthest, *matrices], key=lambda one: np.nan_to_num(np.linalg.norm(one - centre)))
            farthest = (
                nothing
                if np.isnan(farthest).any()
                else value(here.extreme(_outwards(farthest - centre, x, p, tail), gap))
            )
            matrices.append(farthest)
        matrices = np.array(matrices)
        support, proofs = np.array([one.upper for one in found]), tuple(one.certificate for one in found)
        points = matrices[: angles.size, *entry]
        sets.append(ValueSet(omega, angles, support, points, float(tail[k]), proofs, entry, matrices))
    return tuple(sets)


def value_set(consistent: ConsistentSet, omega: float, directions: int, gap: float) -> ValueSet:
    """Support function and attained points at one frequency, of the first entry, the only one of a SISO plant."""
    return value_sets_at(consistent, omega, directions, gap)[0]


def value_set_claims(consistent: ConsistentSet, *found: ValueSet) -> Iterator[SupportClaim]:
    """Claims of the polygons of one frequency, side by side; without a solver."""
    problem, omega = consistent.posed.problem, found[0].omega
    here = dataclasses.replace(consistent, posed=consistent.posed_at(omega))
    for one in found:
        x, p, tail = here.value_weights(omega, one.entry)
        # Two sides close no polygon in the plane.
        angles = directions_at(omega, problem.dt, max(one.directions.size, 3))
        # Else the corners of the polygon are not where they are said to be.
        even = one.omega == omega and np.array_equal(angles, one.directions)
        for k, (angle, support, proof) in enumerate(zip(angles, one.support, one.certificates, strict=even)):
            name = f"{omega:.6g} rad/s{which(problem, one.entry)}, direction {k + 1} of {angles.size}"
            stated = float(support) if even else -np.inf
            yield SupportClaim(name, _along(angle, x, p, tail), stated, proof, here.data.rows, here.data.sarason)


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
    reached = np.linalg.norm(matrices[~np.isnan(matrices).any(axis=(1, 2))] - nominal, 2, axis=(1, 2))
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


def _along(angle: float, x: Complex, p: Complex, tail: float) -> Functional:
    """Re(exp(-j angle) F)."""
    turn = np.exp(-1j * angle)
    return Functional(np.real(turn * x), np.real(turn * p), tail)


def _outwards(error: NDArray[Any], x: Complex, p: Complex, tail: Real) -> Functional:
    """Re u'Fv with the first singular vectors of an error."""
    left, _, right = np.linalg.svd(error)
    weights = np.outer(left[:, 0].conj(), right[0].conj()).ravel()
    return Functional(np.real(weights @ x), np.real(weights @ p), float(np.abs(weights) @ tail))
