"""Linear certificates: the value of a functional of every consistent system, within two sums."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real
from robustid.guarantees.linear.samples import Samples

_EPS = float(np.finfo(float).eps)


@dataclasses.dataclass(frozen=True, eq=False)
class Amplitudes(Frozen):
    """Knowledge of the amplitudes of the parametric part: each within `radius` of `centre`."""

    centre: Complex  # (g,)
    radius: Real  # (g,)

    @property
    def largest(self) -> Real:
        """Largest modulus, (g,)."""
        return (np.abs(self.centre) + self.radius) * (1 + 4 * _EPS)

    def coefficients(self, samples: Samples) -> tuple[Complex, Real]:
        """Centres and radii of all coefficients, (m,) each: the amplitude or its conjugate, or c' tau^j."""
        at, first = samples.amplitude_of, samples.first
        centre = np.where(first, np.where(samples.conjugate, self.centre[at].conj(), self.centre[at]), 0)
        return centre, np.where(first, self.radius[at], self.largest[at] * samples.powers)


@dataclasses.dataclass(frozen=True, eq=False)
class Targets(Frozen):
    """Functionals that are to be bounded: values of the entry at angles, or coefficients, or samples of a response."""

    base: Complex  # (B,), zeta from which the harmonic measure is seen
    weight: Complex  # (B,), K s W at the angle, whose zeta is `base`; 0 of coefficients
    values: Complex  # (B, m), the functional of every function
    left_out: Real  # (B, g)
    # (B, N), what it is on the Taylor coefficients from number 1 on; `base` is 0 then, and `weight` what it is on number 0.
    later: Real = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        if not self.later.size:
            self._set(later=np.zeros((self.base.size, 0)))

    @property
    def square(self) -> Real:
        """Squared norms, (B,)."""
        return np.abs(self.weight) ** 2 + (self.later**2).sum(axis=1)

    def __getitem__(self, index: slice) -> Targets:
        return Targets(*(getattr(self, field.name)[index] for field in dataclasses.fields(self)))


def targets_at(samples: Samples, angles: Real) -> Targets:
    """The values of the entry at angles."""
    return Targets(
        samples.problem.region.points(angles),
        samples.target_weight(angles),
        samples.target_values(angles),
        samples.target_left_out(angles),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Chosen(Frozen):
    """The arrays of some points, a choice for every target, and of all rows of records."""

    points: NDArray[np.intp]  # (B, n)
    gram: Complex  # (B, S, S), inner products of the functionals in H2 of the harmonic measure, S = n + T
    cross: Complex  # (B, S), with the target
    values: Complex  # (B, S, m)
    y: Complex  # (B, S)
    bound: Real  # (B, S), without what the series leave out
    left_out: Real  # (B, S, g)


def choose(samples: Samples, targets: Targets, points: NDArray[np.intp]) -> Chosen:
    r"""The arrays for the points of every target.

    The kernel of H2 of the harmonic measure seen from zeta_0 is k(zeta, w) = (1 - zeta_0* zeta)(1 - zeta_0 w*)/((1 - |zeta_0|^2)
    (1 - zeta w*)), k(zeta, zeta_0) = 1; its Taylor coefficients in zeta and w* are tridiagonal.
    """
    rows = samples.rows
    z, base = samples.nodes[points], targets.base[:, None]
    scale = (1 - np.abs(base) ** 2)[:, :, None]
    weights = samples.weights[points]  # (B, n, C)
    turned = (1 - base.conj() * z)[:, :, None] * weights
    gram = turned @ turned.conj().swapaxes(1, 2)
    # The largest arrays of all: written over, and not made anew at every step.
    kernel = z[:, :, None] * z.conj()[:, None, :]
    np.subtract(1, kernel, out=kernel)
    kernel *= scale
    gram /= kernel
    later, own = targets.later, samples.weights[:, samples.target]
    powers = samples.nodes[:, None] ** np.arange(1, int(later.shape[1]) + 1)
    cross = weights[:, :, samples.target] * targets.weight.conj()[:, None]
    cross = cross + np.take_along_axis(later @ (own[:, None] * powers).T, points, axis=1)
    if rows:
        mixed, inner = blocks_of_rows(samples, targets.base, points)
        gram = np.block([[gram, mixed.conj().swapaxes(1, 2)], [mixed, inner]])
        U = samples.blocks[samples.target]
        common = min(U.shape[1] - 1, later.shape[1])
        onto = U[:, 0] * targets.weight.conj()[:, None] + later[:, :common] @ U[:, 1 : common + 1].T
        cross = np.concatenate([cross, onto], axis=1)

    def joined(at_points: NDArray[np.generic], of_rows: NDArray[np.generic]) -> NDArray[np.generic]:
        below = np.broadcast_to(of_rows, (len(points), *of_rows.shape))
        return np.concatenate([at_points[points], below], axis=1)

    return Chosen(
        points,
        gram,
        cross,
        joined(samples.values, samples.record_functions),  # type: ignore[arg-type]
        joined(samples.y, samples.record_y.astype(complex)),  # type: ignore[arg-type]
        joined(samples.bound, samples.record_bound),  # type: ignore[arg-type]
        joined(samples.left_out, samples.record_left_out),  # type: ignore[arg-type]
    )


def blocks_of_rows(samples: Samples, base: Complex, points: NDArray[np.intp]) -> tuple[Complex, Complex]:
    """Inner products of the rows of records with the points of every target, (B, T, n), and with each other, (B, T, T)."""
    (plain, shift, lower), zeta = samples.shifted, base[:, None, None]
    inner = plain + np.abs(zeta) ** 2 * lower - zeta.conj() * shift - zeta * shift.T
    first, second = (part.T[points].swapaxes(1, 2) for part in samples.mixed)  # (B, T, n)
    scale = 1 - np.abs(zeta) ** 2
    mixed = (first - zeta.conj() * second) * (1 - zeta * samples.nodes[points].conj()[:, None, :]) / scale
    return mixed, inner / scale


def mismatch(chosen: Chosen, targets: Targets, d: Complex) -> Complex:
    """Differences of the functional of every function from the combination of the samples, (B, m)."""
    return np.einsum("bsm,bs->bm", chosen.values, d) - targets.values


def class_square(chosen: Chosen, targets: Targets, d: Complex) -> Real:
    """Squared norms of the target less the combination, times K^2, up to rounding, (B,)."""
    square = targets.square - 2 * (d * chosen.cross).sum(axis=1).real
    square += np.einsum("bs,bs->b", d, (chosen.gram @ d.conj()[:, :, None])[:, :, 0]).real
    return square


def class_radius(samples: Samples, chosen: Chosen, targets: Targets, d: Complex) -> Real:
    """Norm of the target less the combination, times K: the largest value over the class, rounding included, (B,)."""
    square = class_square(chosen, targets, d)
    # |<f, g>| <= ||f|| ||g||: no term of the sums is larger than those of the square of this one.
    sizes = np.sqrt(targets.square) + (np.abs(d) * np.sqrt(np.einsum("bss->bs", chosen.gram).real)).sum(axis=1)
    return np.sqrt(np.maximum(square, 0.0) + rounding(samples, d.shape[1]) * sizes**2)


def rounding(samples: Samples, terms: int) -> float:
    """Relative error of a sum of so many products with the kernel, whose denominators cancel near the border of the class."""
    inside = float(samples.problem.region.inside(np.append(np.abs(samples.angles), 0.0)).min())
    return (4 * terms + 64 + 16 / inside) * _EPS


def discs(samples: Samples, chosen: Chosen, targets: Targets, d: Complex, known: Amplitudes) -> tuple[Complex, Real]:
    r"""Centres and radii (B,) of the discs that hold the target of every consistent system.

    Centres: the combination of the samples, and what of the functions it misses, at their centres. Radii:

    .. math:: \sum_k |d_k| (\varepsilon_k + A' R_k) + K |r_d| + \sum_i \Delta_i |(\sum_k d_k P_i(z_k)) - P_i(z_0)| + A' R_0

    with A the largest amplitudes, R what the series leave out, Delta_i the radii of the coefficients.
    """
    missed, (coefficient, _) = mismatch(chosen, targets, d), known.coefficients(samples)
    centre = (d * chosen.y).sum(axis=1) - missed @ coefficient
    if not np.all(np.isfinite(known.radius)):
        return centre, np.full(len(d), np.inf)
    radii = Radii(samples, targets, known, sizes_of(samples, chosen, known))
    return centre, radii(d, class_square(chosen, targets, d), missed)


class Sizes(NamedTuple):
    """Sizes of the samples of every target, (B, S) each."""

    bound: Real  # with what the series leave out at most
    functions: Real  # of all functions, times the radii of their coefficients
    y: Real
    norm: Real  # of their functionals


def sizes_of(samples: Samples, chosen: Chosen, known: Amplitudes) -> Sizes:
    """The sizes of samples whose matrices are known."""
    return Sizes(
        chosen.bound + chosen.left_out @ known.largest,
        np.abs(chosen.values) @ known.coefficients(samples)[1],
        np.abs(chosen.y),
        np.sqrt(np.einsum("bss->bs", chosen.gram).real),
    )


class Radii:
    """The radii of any multipliers of the same points and targets: what does not depend on them is computed once."""

    def __init__(self, samples: Samples, targets: Targets, known: Amplitudes, sizes: Sizes) -> None:
        _, self._radius = known.coefficients(samples)
        self._sizes = sizes
        self._target: Real = np.abs(targets.values) @ self._radius
        self._norm = np.sqrt(targets.square)
        self._rounding = rounding(samples, sizes.y.shape[1])
        with np.errstate(invalid="ignore"):
            beyond = targets.left_out @ known.largest
        self._beyond: Real = np.where(np.isinf(targets.left_out).any(axis=1), np.inf, beyond)

    def __call__(self, d: Complex, square: Real, missed: Complex) -> Real:
        """The radii (B,) of multipliers, of which `class_square` and `mismatch` are known."""
        size, terms, of = np.abs(d), d.shape[1], self._sizes
        leak = np.abs(missed) @ self._radius
        leak += 8 * (terms + 8) * _EPS * ((of.functions * size).sum(axis=1) + self._target)
        # |<f, g>| <= ||f|| ||g||: no term of the sums is larger than those of the square of this one.
        sizes = self._norm + (size * of.norm).sum(axis=1)
        of_class = np.sqrt(np.maximum(square, 0.0) + self._rounding * sizes**2)
        total = (size * of.bound).sum(axis=1) + leak + self._beyond + of_class
        return total * (1 + 1e-12) + 8 * terms * _EPS * (size * of.y).sum(axis=1)
