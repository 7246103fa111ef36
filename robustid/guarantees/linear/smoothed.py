"""The bound of a direction as a smooth function of its multipliers, and steps of Newton that lower it, all directions at once."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Complex, Real

_LENGTHS = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.6])[:, None, None]  # of a step
# Of what a term's curvature is below that of its majorant, x^2/(2 t) + t/2: with all of it steps overshoot.
_BEND = 0.85

Norms = tuple[Real, Real, Real]  # square - 2 cross x + x'Qx, squared, of all directions: Q, cross, square


class _Terms(NamedTuple):
    """Squares of the terms at x (M, 2n): of the points, of the functions and of the norms; and what their slopes are made of."""

    turned: tuple[Real, Real]  # E g of the points, (M, n) each
    own: Real  # (M, n)
    missed: tuple[Real, Real]  # of the functions, real and imaginary, (M, k) each
    sizes: Real  # (M, k)
    pulls: list[Real]  # half of the gradient of the norms, (M, 2n) each
    rest: Real  # (M, norms)


class Smoothed:
    """The bound of a target as a function of x = (Re c, Im c), of all directions, each |term| as sqrt(term^2 + delta^2)."""

    def __init__(self, norms: Sequence[Norms], rows: tuple[Real, Real], centre: Complex, E: Real) -> None:
        self.norms, (J, wanted) = norms, rows
        half = len(J) // 2
        self.J, self.wanted = (J[:half], J[half:]), (wanted[:, :half], wanted[:, half:])
        self.linear, self.E, self.count = np.concatenate([centre.real, -centre.imag]), E, centre.size
        self.unit = np.sqrt(norms[0][2].max())

    def step(self, x: Real, level: float) -> Real:
        """A step of Newton with the smoothing `level`, as a part of the mean term, and the best of some lengths of it."""
        a, b, E = x[:, : self.count], x[:, self.count :], self.E
        turned = E[:, 0, 0] * a - E[:, 0, 1] * b, E[:, 1, 1] * b - E[:, 0, 1] * a
        real, imaginary = (x @ part.T - wanted for part, wanted in zip(self.J, self.wanted, strict=True))
        pulls = [x @ Q - cross for Q, cross, _ in self.norms]
        every = zip(pulls, self.norms, strict=True)
        rest = np.stack([square + ((pull - cross) * x).sum(axis=1) for pull, (_, cross, square) in every], axis=1)
        own, sizes = np.maximum(turned[0] * a + turned[1] * b, 0.0), real**2 + imaginary**2
        here = _Terms(turned, own, (real, imaginary), sizes, pulls, np.maximum(rest, 0.0))
        squares = here.own, here.sizes, here.rest
        count = sum(one.shape[1] for one in squares)
        total = sum(np.sqrt(one).sum(axis=1) for one in squares)
        d = np.maximum(level * total / count, 1e-9 * self.unit)[:, None] ** 2
        way = self._way(here, d)
        return x + self._best_length(here, d, way)[:, None] * way

    def _way(self, here: _Terms, d: Real) -> Real:
        """Ways (M, 2n) of Newton's method, with what stands for the second derivatives."""
        n, (top, bottom), (real, imaginary) = self.count, self.J, here.missed
        s, m, r = (np.sqrt(one + d) for one in (here.own, here.sizes, here.rest))
        gradient = self.linear + np.concatenate([one / s for one in here.turned], axis=1)
        gradient += (real / m) @ top + (imaginary / m) @ bottom
        # All terms of low rank in one product, of every function the directions along and across what is missed of it.
        size, half = np.sqrt(here.sizes), real.shape[1]
        away = size > 0
        u, v = (
            np.divide(real, size, out=np.ones_like(real), where=away)[:, :, None],
            np.divide(imaginary, size, out=np.zeros_like(real), where=away)[:, :, None],
        )
        W = np.empty((len(real), 2 * half + r.shape[1], 2 * n))
        W[:, :half], W[:, half : 2 * half] = u * top + v * bottom, u * bottom - v * top
        for k, pull in enumerate(here.pulls):
            gradient += pull / r[:, k, None]
            W[:, 2 * half + k] = pull
        scale = r[:, :1]  # of the first norm
        weights = scale * np.concatenate([1 / m - _BEND * here.sizes / m**3, 1 / m, -_BEND / r**3], axis=1)
        (one, other), E, bent = here.turned, self.E, _BEND / s**3
        off = -E[:, 0, 1] / s - bent * one * other
        ends = [scale * end for end in (E[:, 0, 0] / s - bent * one**2, E[:, 1, 1] / s - bent * other**2, off)]
        H = self._curvatures(W, weights, (scale / r)[:, 1:], ends)
        return np.stack([_solved(*each) for each in zip(H, -gradient * scale, strict=True)])

    def _curvatures(self, W: Real, weights: Real, parts: Real, ends: Sequence[Real]) -> Real:
        """Matrices (M, 2n, 2n) of all directions: terms of low rank, norms, and the diagonals of the four blocks."""
        n, size = self.count, 2 * self.count
        (first, *_), *others = self.norms
        H = np.matmul((W * weights[:, :, None]).transpose(0, 2, 1), W)
        H += first
        for k, (Q, *_) in enumerate(others):
            H += Q * parts[:, k, None, None]
        diagonals = H.reshape(len(H), -1)
        for at, end in zip((0, n * size + n, n, n * size), (*ends, ends[-1]), strict=True):
            diagonals[:, at : at + n * (size + 1) : size + 1] += end
        return H

    def _best_length(self, here: _Terms, d: Real, way: Real) -> Real:
        """The best of some lengths of a way (M, 2n), (M,): along it every square is quadratic."""
        a, b, t = way[:, : self.count], way[:, self.count :], _LENGTHS
        E, (real, imaginary) = self.E, here.missed
        one, other = (way @ part.T for part in self.J)
        turning = (E[:, 0, 0] * a - 2 * E[:, 0, 1] * b) * a + E[:, 1, 1] * b**2
        slopes = [here.turned[0] * a + here.turned[1] * b, real * one + imaginary * other]
        slopes.append(np.stack([(pull * way).sum(axis=1) for pull in here.pulls], axis=1))
        bends = [turning, one**2 + other**2]
        bends.append(np.stack([((way @ Q) * way).sum(axis=1) for Q, *_ in self.norms], axis=1))
        total = t[:, :, 0] * (way @ self.linear)
        for square, slope, bend in zip((here.own, here.sizes, here.rest), slopes, bends, strict=True):
            total = total + np.sqrt(np.maximum(square + t * (2 * slope + t * bend), 0.0) + d).sum(axis=2)
        return _LENGTHS[total.argmin(axis=0), 0, 0]


def _solved(H: Real, right: Real) -> Real:
    """Solution of a direction; LinAlgError for a singular one. A matrix that is not positive definite is rare."""
    _, found, failed = scipy.linalg.lapack.dposv(H.T, right, lower=True)  # in Fortran's order as it is
    return np.asarray(np.linalg.solve(H, right) if failed else found, dtype=float)
