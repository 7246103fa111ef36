"""Models of one order fitted to time and frequency samples together: least squares, then minimax.

A model, seen from its heads, is G = D + C (zI - A)^-1 X + sum_j H_j/(z - 1)^j: linear in (X, D, H) for given (A, C). With
Sigma = I + C (zI - A)^-1 d, the model Sigma^-1 N has the poles eig(A - d C), and at d = 0 its derivative along d is
-C (zI - A)^-1 d times C (zI - A)^-1 X: Gauss-Newton steps are linear problems in (N, d). With one head the functions are
orthonormal (Takenaka-Malmquist) however close the poles are to each other or to the circle; with several, (A, C) is input normal in
a Schur form, which is the same, and C moves too.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.bases import Sections
from robustid.core import Array, Budget, Complex, DampedSteps, Real, singular_parts
from robustid.reduction.gramians import Parts, gramian_factors
from robustid.reduction.sample_map import SampleMap, Samples, Signals, triangular
from robustid.reduction.smallest_maximum import orthonormal_columns, smallest_maximum

Poles = Array  # complex, or real where all of them are

_STEPS = 40  # of one descent
_NONE = np.zeros(0, complex)
_UNLIMITED = Budget()
_FLAT = 1e-3  # relative gain of a step below which a descent ends
_UNSEEN = 1e-9  # of the change that the largest move makes: less is none, beside numerators
_FIRST_RADIUS, _LEAST_RADIUS = 0.5, 1e-4  # of the trust region, in units of a pole's distance to the circle


class Pair(NamedTuple):
    """Functions C (zI - A)^-1: A (n, n), C (heads, n). In their normal form `size` (n,) is that of a d that moves the pole of
    each by about its distance to the circle.
    """

    A: Real
    C: Real
    size: Real | None = None

    @property
    def poles(self) -> Poles:
        """Poles of the functions."""
        return np.linalg.eigvals(self.A) if self.A.size else np.zeros(0, complex)


@dataclasses.dataclass(frozen=True)
class Functions:
    """Functions C (zI - A)^-1 at the samples; a fit, its moves and the next step take what is computed once."""

    samples: SampleMap
    pair: Pair

    @functools.cached_property
    def states(self) -> Signals:
        """Outputs of the functions, by experiment: see `SampleMap.states`."""
        return self.samples.states(self.pair.A, self.pair.C)

    @functools.cached_property
    def numerators(self) -> Samples:
        """The columns of X and of what is fixed, (N, tails n + k)."""
        return np.hstack([self.samples.columns(self.states), self.samples.fixed])

    @functools.cached_property
    def basis(self) -> tuple[Real, Real]:
        """U and V of `orthonormal_columns` of the numerators."""
        return orthonormal_columns(self.samples.real(self.numerators))

    @functools.cached_property
    def normal(self) -> Functions:
        """The same in their normal form."""
        pair = normal_functions(self.pair, self.samples.weights)
        return self if pair is self.pair else Functions(self.samples, pair)

    def solved(self, y: Samples) -> Real:
        """The numerators of least squares for these samples."""
        U, V = self.basis
        return V @ (U.T @ self.samples.real(y))


@dataclasses.dataclass(frozen=True)
class Fit:
    """A model with its residuals at the samples."""

    functions: Functions
    X: Real  # (n, tails), their coefficients
    fixed: Real  # (k,) coefficients of `SampleMap.fixed`: D, those of the integrators, those of the free responses
    outputs: Signals  # of the entries of the stable part, by experiment: see `SampleMap.outputs_of`
    error: Complex  # (N,), in units of the bounds
    sizes: Real  # (M,) norm of the errors under each bound

    @property
    def pair(self) -> Pair:
        """Pair A, C of the functions C (zI - A)^-1."""
        return self.functions.pair

    @property
    def poles(self) -> Poles:
        """Poles of the stable part."""
        return self.pair.poles

    @property
    def cost(self) -> float:
        """Root mean square of |residual|/bound: no greater than `worst`."""
        return float(np.sqrt(np.mean(self.sizes**2)))

    @property
    def worst(self) -> float:
        """Largest |residual|/bound."""
        return float(self.sizes.max())


class Moves(NamedTuple):
    """Ways in which the functions of a fit can change: derivatives of its residuals times -1, sizes of steps, and the steps."""

    columns: Complex
    size: Real
    step: Callable[[Real], Pair]


def pole_functions(poles: Poles) -> Pair:
    """The orthonormal functions of these poles (conjugates included), all inside the unit circle, for one head."""
    upper = [complex(a) for a in poles if a.imag >= 0]
    if not upper:
        return Pair(np.zeros((0, 0)), np.zeros((1, 0)), np.zeros(0))
    sections = Sections(tuple(upper), 1)
    sizes = [np.full(2 if a.imag else 1, np.sqrt(1 - abs(a) ** 2)) for a in sections.zeros]
    return Pair(np.array(sections.section.A), sections.section.c.copy(), np.concatenate(sizes))


def normal_functions(pair: Pair, weights: Real) -> Pair:
    """The span of the same functions with A'A + C'W^2 C = I, A in real Schur form; of one head those of its poles."""
    if pair.size is not None:
        return pair
    if len(weights) == 1:
        return pole_functions(pair.poles)
    A, C, _ = pair
    if not A.size:
        return Pair(A, C, np.zeros(0))
    factor, _ = gramian_factors(Parts(A, np.zeros((A.shape[0], 1)), weights[:, None] * C), discrete=True)
    _, values, Vt = np.linalg.svd(factor.T)
    values = np.maximum(values, 1e-9 * values[0])  # functions that depend on the others are left as small as they are
    A = (values[:, None] * Vt) @ A @ (Vt.T / values)
    C = C @ (Vt.T / values)
    schur, basis = scipy.linalg.schur(A, output="real")[:2]
    poles = np.diagonal(schur).astype(complex)
    for k in np.flatnonzero(np.diagonal(schur, -1)):
        poles[k : k + 2] = np.linalg.eigvals(schur[k : k + 2, k : k + 2])
    size = np.sqrt(np.maximum(1 - np.abs(poles) ** 2, np.finfo(float).eps))
    return Pair(schur, C @ basis, size)


def inside(pair: Pair, radius: float) -> Pair:
    """The functions with poles beyond `radius` drawn back to it."""

    def drawn(poles: Poles) -> Poles:
        size = np.abs(poles)
        return np.where(size > radius, poles * (radius / np.maximum(size, radius)), poles)

    return with_poles(pair, drawn)


def with_poles(pair: Pair, mapped: Callable[[Poles], Poles]) -> Pair:
    """The functions with other poles, each in place of one, the eigenvectors as they are."""
    poles = pair.poles
    new = mapped(poles)
    if np.array_equal(new, poles):
        return pair
    if pair.C.shape[0] == 1:
        return pole_functions(new)
    values, V = np.linalg.eig(pair.A)
    return Pair(np.real(V @ (mapped(values)[:, None] * np.linalg.inv(V))), pair.C)


def least_squares(samples: SampleMap, pair: Pair) -> Fit:
    """The best numerators for given functions."""
    functions = Functions(samples, pair).normal
    return evaluated(functions, functions.solved(samples.y))


def evaluated(functions: Functions, v: Real) -> Fit:
    """The model with the numerators v = (X, one tail after the other, fixed)."""
    samples = functions.samples
    count = functions.pair.A.shape[0] * samples.tails
    X, fixed = v[:count].reshape(samples.tails, -1).T, v[count:]
    outputs = samples.outputs_of(functions.states, X)
    error = samples.y - samples.samples_of(outputs) - samples.fixed @ fixed
    return Fit(functions, X, fixed, outputs, error, samples.sizes(error))


def pole_columns(samples: SampleMap, pair: Pair, outputs: Signals) -> Complex:
    """Derivatives of the residuals along d, times -1, one head after the other, (N, heads n)."""
    (h, n), form = pair.C.shape, triangular(pair.A)
    parts: list[Complex] = []
    for track, out in zip(samples.tracks, outputs, strict=True):
        each = np.zeros((track.y.size, h, n), complex)
        for i, c in enumerate(pair.C):
            driven = out[i % len(out)]
            states = track.states(form, c, driven.reshape(driven.shape[0], -1)).reshape(*driven.shape, n)
            for k, j in np.ndindex(h, samples.tails):
                each[:, k] -= samples.read(track, i, j, states[:, k, j])
        parts.append(each.reshape(track.y.size, -1))
    return np.vstack(parts)


def direction_columns(samples: SampleMap, pair: Pair, X: Real) -> Complex:
    """Derivatives of the residuals along C, times -1, one head after the other, (N, heads n)."""
    (h, n), form = pair.C.shape, triangular(pair.A.T)
    parts: list[Complex] = []
    for track in samples.tracks:
        each = np.zeros((track.y.size, h, n), complex)
        for i in range(h):
            signals = samples.into(track, i)
            for j, x in enumerate(X.T):
                each[:, i] += samples.read(track, i, j, track.states(form, x, signals[:, j : j + 1])[:, 0])
        parts.append(each.reshape(track.y.size, -1))
    return np.vstack(parts)


def moved(pair: Pair, d: Real) -> Pair:
    """The functions of Sigma^-1 N: those of A - d C, d (n, heads)."""
    return Pair(pair.A - d @ pair.C, pair.C)


def _size(pair: Pair) -> Real:
    """Sizes of the moves of a pair in its normal form."""
    return np.zeros(0) if pair.size is None else pair.size


def moves(fit: Fit, radius: float, held: Poles) -> Moves:
    """Ways in which the functions of a fit, in their normal form, can change; poles that are held stay."""
    samples = fit.functions.samples
    if samples.heads == 1:
        moving = pole_functions(apart(fit.poles, held))

        def stepped(d: Real) -> Pair:
            found = inside(moved(moving, d[:, None]), radius)
            return pole_functions(np.concatenate([held, found.poles])) if held.size else found

        return Moves(pole_columns(samples, moving, fit.outputs), _size(moving), stepped)
    functions = fit.functions.normal
    pair, U = functions.pair, functions.basis[0]
    size, (h, n) = _size(pair), pair.C.shape
    v = functions.solved(samples.y - fit.error)
    turned = direction_columns(samples, pair, v[: n * samples.tails].reshape(samples.tails, -1).T)
    turned_size = (size / samples.weights[:, None]).ravel()
    if held.size:

        def only_turned(d: Real) -> Pair:
            return Pair(pair.A, pair.C + d.reshape(h, n))

        return _seen(samples, U, Moves(turned, turned_size, only_turned))

    def turned_and_moved(d: Real) -> Pair:
        first, second = d[: h * n].reshape(h, n), d[h * n :].reshape(h, n)
        return inside(Pair(pair.A - first.T @ pair.C, pair.C + second), radius)

    columns = np.hstack([pole_columns(samples, pair, fit.outputs), turned])
    sizes = np.concatenate([np.outer(samples.weights, size).ravel(), turned_size])
    return _seen(samples, U, Moves(columns, sizes, turned_and_moved))


def _seen(samples: SampleMap, U: Real, ways: Moves) -> Moves:
    """Moves, in units of their sizes, without those that other numerators (whose columns have the span of U) undo:
    similarities, above all. What is left has one set of steps for one change of the residuals, so that a region of trust holds
    the numerators nowhere.
    """
    J = samples.real(ways.columns) * ways.size
    R = np.asarray(np.linalg.qr(J - U @ (U.T @ J), mode="r"), dtype=float)
    _, values, right = singular_parts(R)
    kept = right[: values.size][values > _UNSEEN * values.max(initial=0.0)].T
    turn = ways.size[:, None] * kept

    def turned(d: Real) -> Pair:
        return ways.step(turn @ d)

    return Moves(ways.columns @ turn, np.ones(kept.shape[1]), turned)


def descended(fit: Fit, radius: float, steps: int = _STEPS, held: Poles = _NONE, budget: Budget = _UNLIMITED) -> Fit:
    """Levenberg-Marquardt over the functions, the numerators at their best for all (variable projection)."""
    samples = fit.functions.samples
    damping = 0.1
    y = samples.real(samples.y)
    for _ in range(steps):
        if budget.over:
            return fit
        ways = moves(fit, radius, held)
        if not ways.size.size:
            return fit
        U, _ = fit.functions.normal.basis
        J = samples.real(ways.columns) * ways.size
        J, rest = J - U @ (U.T @ J), y - U @ (U.T @ y)
        damped = DampedSteps.of(J, rest)
        largest = damped.sizes.max(initial=0.0)
        if largest == 0:
            return fit
        before = fit.cost
        while damping < 1e4:
            ahead = least_squares(samples, ways.step(ways.size * damped.step((damping * largest) ** 2)))
            if ahead.cost < before:
                fit, damping = ahead, damping / 5
                break
            damping *= 4
        if not fit.cost < before * (1 - _FLAT):
            return fit
    return fit


def apart(poles: Poles, held: Poles) -> Poles:
    """The poles without those that are held."""
    for pole in held:
        poles = np.delete(poles, np.argmin(np.abs(poles - pole)))
    return poles


def levelled(
    fit: Fit, radius: float, limit: float, steps: int, held: Poles = _NONE, budget: Budget = _UNLIMITED
) -> Fit:
    """Minimax: a sequence of convex min-max problems in (numerators, d), d in a trust region; poles that are held stay. Ends
    where a step gains less than 0.1 %, 2 % once `limit` is met; or where it cannot meet it.
    """
    samples = fit.functions.samples
    trust, gain = _FIRST_RADIUS, np.inf
    fit = numerators_levelled(fit)
    for step in range(steps):
        worst = fit.worst
        ways = moves(fit, radius, held)
        if not ways.size.size or worst < 0.5 * limit or budget.over:
            return fit
        linear = fit.functions.normal.numerators
        first = np.concatenate([fit.functions.normal.solved(samples.y - fit.error), np.zeros(ways.size.size)])
        reach = np.concatenate([np.full(linear.shape[1], np.inf), trust * ways.size])
        G = np.hstack([linear, ways.columns])
        v, expected = smallest_maximum(G, samples.y, samples.discs, first, reach, samples.cone)
        pair = ways.step(v[linear.shape[1] :])
        ahead = (
            numerators_levelled(least_squares(samples, pair))
            if held.size or np.abs(pair.poles).max() >= radius * (1 - 1e-12)
            else evaluated(Functions(samples, pair), v[: linear.shape[1]])
        )
        part = (worst - ahead.worst) / max(worst - expected, 1e-12 * worst)
        if ahead.worst < worst:
            gain, fit = 1 - ahead.worst / worst, ahead
        trust *= 2.0 if part > 0.75 else 0.25 if part < 0.25 else 1.0
        slow = 1 - expected / worst < _FLAT or trust < _LEAST_RADIUS
        met = fit.worst <= limit and gain < 0.02
        hopeless = step > 5 and gain < 0.02 and expected > 1.3 * limit
        if slow or met or hopeless:
            return fit
    return fit


def numerators_levelled(fit: Fit) -> Fit:
    """The numerators with the smallest largest residual for the functions of a fit."""
    functions, samples = fit.functions.normal, fit.functions.samples
    first, reach = functions.solved(samples.y), np.full(functions.numerators.shape[1], np.inf)
    v, _ = smallest_maximum(functions.numerators, samples.y, samples.discs, first, reach, samples.cone)
    return evaluated(functions, v)
