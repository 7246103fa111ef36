"""The search for good linear certificates: reweighted least squares, for many targets at once. Nothing of it is trusted."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Pieces, Real
from robustid.guarantees.linear.certificate import (
    Amplitudes,
    Chosen,
    Radii,
    Targets,
    choose,
    class_square,
    mismatch,
    sizes_of,
)
from robustid.guarantees.linear.samples import Samples

POINTS = 44  # of the samples at frequencies, for a target
FEW = 24  # where it has to be quick: between the lines as good, beyond the data wider
_NEAR = 0.3  # of them the nearest ones; the others ever farther apart
STEPS = 10
_CHANGE = 1e-20, 1e20  # of a weight, in a step
_FARTHER = 1.8  # times the change of the logarithm of a weight
_SELDOM = 3  # steps after which the weights of most functions are taken anew: half of the arithmetic is theirs
_STACK = 4e5  # complex numbers in the matrices of a stack: what a cache holds
_FLOOR = 1e-3  # least part of the largest multiplier, and of the radius, that a weight is made of
_EXACT = (
    1e-100  # radius for weights where it is zero: of a sample that sees nothing yet, which none is needed to predict
)
_STABLE = 1e-13  # of the diagonal: what the Gram matrix of nodes close together loses to rounding


def nearest_points(samples: Samples, base: Complex, count: int) -> NDArray[np.intp]:
    """Points for every target, (B, n): the nearest in the hyperbolic distance, and others ever farther apart."""
    z, total = samples.nodes, samples.angles.size
    count = min(count, total)
    if count == total:
        return np.broadcast_to(np.arange(total), (base.size, total))
    near = max(int(_NEAR * count), 1)
    far = np.geomspace(near, total, count - near + 1)
    place = np.unique(np.concatenate([np.arange(near), np.floor(far[:-1]).astype(int)]))
    spare = np.setdiff1d(np.arange(total), place, assume_unique=True)
    place = np.sort(np.concatenate([place, spare[: count - place.size]]))
    seen = np.abs(samples.v[:, samples.target]) > 0
    found = np.empty((base.size, count), int)
    for k, one in enumerate(base):
        away = np.abs((z - one) / (1 - one.conjugate() * z)) + ~seen  # what does not see the entry comes last
        found[k] = np.argsort(away)[place]
    return found


def search(
    samples: Samples,
    targets: Targets,
    known: Amplitudes,
    *,
    points: int | NDArray[np.intp] = POINTS,
    steps: int = STEPS,
    start: tuple[NDArray[np.intp], Complex] | None = None,
    budget: Budget | None = None,
) -> tuple[NDArray[np.intp], Complex]:
    """Points (B, n) and multipliers (B, n + T) with small radii, from a start with radii that are at least as large, if given.

    `points` are so many of the nearest, or these. Where the budget is over the multipliers are those that were found by then.
    """
    if start is not None:
        points = start[0]
    chosen_points = nearest_points(samples, targets.base, points) if isinstance(points, int) else points
    size = chosen_points.shape[1] + samples.rows
    if not size:  # a box reaches the circle so far that no sample says anything
        return chosen_points, np.zeros((targets.base.size, 0), complex)
    stack = max(int(_STACK / (size * (3 * size + 2 * samples.amplitude_of.size + 1))), 1)
    found = np.zeros((targets.base.size, size), complex)
    for first in range(0, targets.base.size, stack):
        part = slice(first, first + stack)
        before = None if start is None else start[1][part]
        if first and budget is not None and budget.over:
            found[part] = 0 if before is None else before
            continue
        chosen = choose(samples, targets[part], chosen_points[part])
        found[part] = reweighted(samples, chosen, targets[part], known, steps=steps, start=before, budget=budget)
    return chosen_points, found


class _Stack:
    """A stack of targets: what they ask of multipliers, the best ones along the way, and weights that follow from others."""

    def __init__(self, samples: Samples, chosen: Chosen, targets: Targets, known: Amplitudes, one: Complex | None):
        _, radius = known.coefficients(samples)
        free = np.isinf(radius)
        self.samples, self.chosen, self.targets = samples, chosen, targets
        finite = Amplitudes(known.centre, np.where(np.isinf(known.radius), 0.0, known.radius))
        sizes = sizes_of(samples, chosen, finite)
        self._free, self._radii = free, Radii(samples, targets, finite, sizes)
        self.bound = sizes.bound
        self.soft, self.hard = chosen.values[:, :, ~free], chosen.values[:, :, free]
        self.wanted, self.matched = targets.values[:, ~free], targets.values[:, free]
        if one is not None:
            self.hard = np.concatenate([self.hard, one[:, :, None]], axis=2)
            self.matched = np.insert(self.matched, self.matched.shape[1], 1, axis=1)
        self.radius = radius[~free]
        # The first functions of the modes at every step, the others, most of them and smaller, at some.
        first = samples.first[~free]
        self.groups = [(np.flatnonzero(first), 1), (np.flatnonzero(~first), _SELDOM)]
        self.size = int(self.bound.shape[1])
        self.best: Complex = np.zeros(self.bound.shape, complex)
        self.value: Real = np.full(len(self.bound), np.inf)

    def kept(self, d: Complex) -> tuple[Real, Real, Complex]:
        """The radii of multipliers, which are kept where they are the best, with `class_square` and `mismatch`."""
        square, missed = class_square(self.chosen, self.targets, d), mismatch(self.chosen, self.targets, d)
        total = self._radii(d, square, missed)
        better = total < self.value
        self.best[better], self.value[better] = d[better], total[better]
        return total, square, missed

    def weights(self, d: Complex) -> list[Real]:
        """Weights 1/t of multipliers, of the class and of functions: t the moduli at d."""
        (total, square, missed), sizes, radius = self.kept(d), np.abs(d), self.radius
        # It is infinite where a series does not converge.
        total = np.maximum(np.where(np.isfinite(total), total, (sizes * self.bound).sum(axis=1)), _EXACT)
        least = _FLOOR * total[:, None] / (np.maximum(radius, 1e-300) * max(radius.size, 1))
        return [
            self.bound / np.maximum(sizes, _FLOOR * sizes.max(axis=1, keepdims=True) + _EXACT),
            1 / np.sqrt(np.maximum(square, (1e-6 * total) ** 2 + 1e-300)),
            np.maximum(radius, 1e-300) / np.maximum(np.abs(missed[:, ~self._free]), least),
        ]

    def first_weights(self) -> list[Real]:
        """Weights where there are no multipliers yet, on a scale of their own."""
        bound, radius = self.bound, self.radius
        level = np.broadcast_to(np.maximum(radius, 1e-300) ** 2 * max(radius.size, 1), (len(bound), radius.size))
        return [bound**2 * bound.shape[1], np.ones(len(bound)), level]

    def without_search(self) -> None:
        """Keep no samples at all, or the nearest one alone, where nothing is to be matched exactly."""
        if self.hard.shape[2]:
            return
        self.kept(np.zeros_like(self.best))
        if self.chosen.points.shape[1]:
            away = np.abs(self.samples.nodes[self.chosen.points] - self.targets.base[:, None])
            self.kept(np.eye(self.size, dtype=complex)[away.argmin(axis=1)])


def reweighted(
    samples: Samples,
    chosen: Chosen,
    targets: Targets,
    known: Amplitudes,
    *,
    steps: int = STEPS,
    start: Complex | None = None,
    one: Complex | None = None,
    budget: Budget | None = None,
) -> Complex:
    r"""Multipliers of the smallest radius along the way; unbounded functions and `one` (B, S), to 1, are matched exactly.

    A sum of moduli is at most the sum of |d|^2/(2 t) + t/2: with t the moduli of the last step that is least squares. Weights 1/t
    that go `_FARTHER` than that, in their logarithms, take half of the steps. None begins that takes longer than the budget.
    """
    pieces = Pieces(budget)
    stack = _Stack(samples, chosen, targets, known, one)
    L, adjoint = stack.soft.swapaxes(1, 2), stack.soft.conj()  # (B, m, S), (B, S, m)
    gram, at = chosen.gram.swapaxes(1, 2), np.arange(stack.size)
    ridge = _STABLE * np.einsum("bss->bs", chosen.gram).real.max(axis=1)
    used = stack.first_weights() if start is None else stack.weights(start)
    stack.without_search()
    products = [np.zeros_like(gram) for _ in stack.groups]
    parts = [(group, every, adjoint[:, :, group], L[:, group]) for group, every in stack.groups]
    v = np.array(used[2])
    for step in range(steps):
        if not pieces.begins():  # what comes before the first step takes about as long as one
            break
        q, w, latest = used
        for k, (group, every, left, right) in enumerate(parts):
            if group.size and (step == 0 or (step - 1) % every == 0):  # the first weights are on a scale of their own
                products[k] = (left * latest[:, None, group]) @ right
                v[:, group] = latest[:, group]
        A = w[:, None, None] * gram
        for product in products:
            A += product
        A[:, at, at] += q + (w * ridge)[:, None]
        onto = w[:, None] * chosen.cross.conj() + (adjoint @ (v * stack.wanted)[:, :, None])[:, :, 0]
        try:
            d = _solved(A, onto, stack.hard, stack.matched)
        except np.linalg.LinAlgError:  # a singular one of the stack: what is best so far stays
            return stack.best
        new = stack.weights(d)
        if step or start is not None:
            new = [old * np.clip(now / old, *_CHANGE) ** _FARTHER for old, now in zip(used, new, strict=True)]
            largest = np.abs(d).max(axis=1, keepdims=True)
            new[0] = np.minimum(new[0], stack.bound / (_FLOOR * largest + _EXACT))
        used = new
    return stack.best


def _solved(A: Complex, right: Complex, hard: Complex, matched: Complex) -> Complex:
    """Solution of A d = right, or that of the least distance from it in A for which the `hard` functions are matched."""
    if not hard.shape[2]:
        return np.asarray(np.linalg.solve(A, right[:, :, None])[:, :, 0], dtype=complex)
    unit = 1 / np.maximum(np.linalg.norm(hard, axis=1, keepdims=True), 1e-300)
    P, t = hard * unit, (matched * unit[:, 0])[:, :, None]
    rows = P.swapaxes(1, 2)
    both = np.concatenate([right[:, :, None], P.conj()], axis=2)
    solved = np.asarray(np.linalg.solve(A, both), dtype=complex)
    d, Y = solved[:, :, :1], solved[:, :, 1:]
    schur = rows @ Y
    for _ in range(2):  # the second time for what rounding left of the first
        d = d + Y @ np.asarray(np.linalg.solve(schur, t - rows @ d), dtype=complex)
    return d[:, :, 0]
