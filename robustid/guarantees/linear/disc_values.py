"""Discs of multipliers at many angles, as `certificate.discs` has them, without the matrices that only a search needs."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.guarantees.linear.certificate import Amplitudes, Radii, Sizes, Targets, blocks_of_rows, targets_at
from robustid.guarantees.linear.samples import Samples

_STACK = 4e5  # numbers of a stack of evaluations: many more leave the cache
_BLOCK = 32  # stacks whose targets are made at once


class DiscValues:
    """Centres and radii of any multipliers of some samples: what depends on the samples alone is computed once."""

    def __init__(self, samples: Samples, known: Amplitudes) -> None:
        self.samples, self.known = samples, known
        self._coefficient, radius = known.coefficients(samples)
        self._values: Complex = np.concatenate([samples.values, samples.record_functions])
        self._y: Complex = np.concatenate([samples.y, samples.record_y.astype(complex)])
        left_out: Real = np.concatenate([samples.left_out, samples.record_left_out])
        self._finite = bool(np.all(np.isfinite(known.radius)))
        if self._finite:
            self._bound: Real = np.concatenate([samples.bound, samples.record_bound]) + left_out @ known.largest
            self._functions: Real = np.abs(self._values) @ radius

    def at(self, angles: Real, points: NDArray[np.intp], d: Complex) -> tuple[Complex, Real]:
        """Centres and radii at angles, of points (B, n) and multipliers (B, n + T)."""
        found = np.empty(angles.size, complex), np.empty(angles.size)
        size = d.shape[1]
        stack = max(int(_STACK / (size * (size + self.samples.amplitude_of.size) + 1)), 1)
        for start in range(0, angles.size, _BLOCK * stack):
            block = slice(start, start + _BLOCK * stack)
            targets = targets_at(self.samples, angles[block])
            for first in range(0, targets.base.size, stack):
                own, part = slice(first, first + stack), slice(start + first, min(start + first + stack, block.stop))
                found[0][part], found[1][part] = self._of(targets[own], points[part], d[part].astype(complex))
        return found

    def _of(self, targets: Targets, points: NDArray[np.intp], d: Complex) -> tuple[Complex, Real]:
        """Centres and radii of a stack of targets."""
        samples, (count, n) = self.samples, points.shape
        rows = np.broadcast_to(np.arange(samples.rows) + samples.angles.size, (count, samples.rows))
        fewer, summed = _each_once(points, d[:, :n])
        used, every = np.concatenate([fewer, rows], axis=1), np.concatenate([summed, d[:, n:]], axis=1)
        missed: Complex = (every[:, None, :] @ self._values[used])[:, 0] - targets.values
        centre: Complex = (every * self._y[used]).sum(axis=1) - missed @ self._coefficient
        if not self._finite:
            return centre, np.full(centre.size, np.inf)
        of_rows = blocks_of_rows(samples, targets.base, fewer) if samples.rows else None
        # Sums of moduli are those of all points: one that stands twice counts twice.
        where = np.concatenate([points, rows], axis=1)
        norms = self._norms(targets, points, of_rows)
        sizes = Sizes(self._bound[where], self._functions[where], np.abs(self._y[where]), norms)
        square = self._class_square(targets, fewer, every, of_rows)
        return centre, Radii(samples, targets, self.known, sizes)(d, square, missed)

    def _norms(self, targets: Targets, points: NDArray[np.intp], of_rows: tuple[Complex, Complex] | None) -> Real:
        """Norms of the functionals, (B, n + T)."""
        samples, base = self.samples, targets.base[:, None]
        z, sizes = samples.nodes[points], np.linalg.norm(samples.weights, axis=1)
        found = np.abs(1 - base.conj() * z) * sizes[points] / np.sqrt((1 - np.abs(base) ** 2) * (1 - np.abs(z) ** 2))
        if of_rows is None:
            return found
        return np.concatenate([found, np.sqrt(np.einsum("btt->bt", of_rows[1]).real)], axis=1)

    def _class_square(
        self, targets: Targets, points: NDArray[np.intp], d: Complex, of_rows: tuple[Complex, Complex] | None
    ) -> Real:
        """As `certificate.class_square` without its matrices, whose products with the multipliers are made in real numbers."""
        samples, base, n = self.samples, targets.base[:, None], points.shape[1]
        z, of_points, target = samples.nodes[points], d[:, :n], targets.weight.conj()[:, None]
        weights = samples.weights[points]
        square = targets.square - 2 * (of_points * weights[:, :, samples.target] * target).sum(axis=1).real
        turned = ((1 - base.conj() * z) * of_points)[:, :, None] * weights
        square += _cauchy(turned, z) / (1 - np.abs(targets.base) ** 2)
        if of_rows is not None:
            rows, (mixed, inner) = d[:, n:, None], of_rows
            square -= 2 * (d[:, n:] * samples.blocks[samples.target][:, 0] * target).sum(axis=1).real
            seen = inner @ rows.conj() + 2 * (mixed @ of_points.conj()[:, :, None])
            square += (rows * seen).sum(axis=(1, 2)).real
        return square


def _cauchy(a: Complex, z: Complex) -> Real:
    """Sums of a_k a_l* / (1 - z_k z_l*), a (B, n, C), which are real: (B,)."""
    first, turned = np.concatenate([a.real, a.imag], axis=2), np.concatenate([a.imag, -a.real], axis=2)
    nodes, crossed = np.stack([z.real, z.imag], axis=2), np.stack([z.imag, -z.real], axis=2)
    real, imag = (one @ first.swapaxes(1, 2) for one in (first, turned))  # of a_k a_l*
    u, v = (one @ nodes.swapaxes(1, 2) for one in (nodes, crossed))  # of z_k z_l*
    np.subtract(1, u, out=u)
    real *= u
    imag *= v
    real -= imag
    u *= u
    v *= v
    u += v
    real /= u
    return real.sum(axis=(1, 2))


def _each_once(points: NDArray[np.intp], d: Complex) -> tuple[NDArray[np.intp], Complex]:
    """Points (B, n) and multipliers, those of points that stand twice summed; filled up with zeros."""
    order = np.argsort(points, axis=1, kind="stable")
    ascending = np.take_along_axis(points, order, axis=1)
    new = np.diff(ascending, axis=1, prepend=-1) != 0
    if new.all():
        return points, d
    place = np.cumsum(new, axis=1) - 1
    shape = len(points), int(place[:, -1].max()) + 1
    flat, sorted_d = (place + shape[1] * np.arange(shape[0])[:, None]).ravel(), np.take_along_axis(d, order, axis=1)
    summed = np.empty(shape, complex)
    summed.real, summed.imag = (
        np.bincount(flat, part.ravel(), shape[0] * shape[1]).reshape(shape) for part in (sorted_d.real, sorted_d.imag)
    )
    fewer = np.zeros(shape, np.intp)
    np.put_along_axis(fewer, place, ascending, axis=1)
    return fewer, summed
