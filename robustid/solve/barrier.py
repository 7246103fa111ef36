"""A barrier method in the unknowns themselves: central paths of the margin and of the gain, and analytic centres."""

from __future__ import annotations

import dataclasses
import itertools
import logging
from collections.abc import Iterator

import numpy as np
import scipy.linalg

from robustid.errors import SolverError
from robustid.solve.conic import Candidate, ConvexData

_log = logging.getLogger("robustid.solve")

_GROWTH = 20.0  # of the weight of the objective per outer step
_CENTERED = 1e-14  # squared Newton decrement at which a centre is accepted
_NEAR = 1e-2  # squared decrement of quadratic convergence
_LAST = 1e-10  # relative gap at which a path ends: digits run out soon after
_STEPS = 60  # Newton steps per centre; self-concordance needs far fewer


@dataclasses.dataclass(frozen=True)
class _Limits:
    """Radius of the ball and reach of the samples as affine functions of one number t: a + b t."""

    ball: tuple[float, float]
    reach: tuple[np.ndarray, np.ndarray]

    def at(self, t: float) -> tuple[float, np.ndarray]:
        return self.ball[0] + self.ball[1] * t, self.reach[0] + self.reach[1] * t


class _Barrier:
    """f(v, t) = -log det(bI - H) - log det(bI + H) - sum log(r_k^2 - |e_k|^2).

    H = H(x), e = y - E x - Q q, v = (x, q); b and r_k affine in t. Self-concordant, with parameter 2 (n + N).
    """

    def __init__(self, data: ConvexData, limits: _Limits):
        self.data, self.limits = data, limits
        self.y, E, Q, _ = data.stacked
        self.G = np.hstack([E, Q])
        self.n = data.sarason.pair.order
        self.samples, self.discs = data.rows.y.size, data.rows.discs
        self.H = data.sarason.symmetric_basis
        self.flat = self.H.reshape(self.n, self.n**2)
        self.parameter = 2.0 * (self.n + self.samples)

    def squares(self, e: np.ndarray) -> np.ndarray:
        """|e_k|^2 of every sample from its real rows."""
        out = e[: self.samples] ** 2
        out[: self.discs] += e[self.samples :] ** 2
        return out

    def matrix(self, v: np.ndarray) -> np.ndarray:
        """H(x)."""
        return (v[: self.n] @ self.flat).reshape(self.n, self.n)

    def value(self, v: np.ndarray, t: float) -> float:
        """F, infinite outside its domain."""
        ball, reach = self.limits.at(t)
        slack = reach**2 - self.squares(self.y - self.G @ v)
        if ball <= 0 or reach.min() <= 0 or slack.min() <= 0:
            return np.inf
        total = -float(np.sum(np.log(slack)))
        if self.n:
            eigenvalues = np.linalg.eigvalsh(self.matrix(v))
            gaps = (ball - eigenvalues) * (ball + eigenvalues)
            if gaps.min() <= 0:
                return np.inf
            total -= float(np.sum(np.log(gaps)))
        return total

    def derivatives(self, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian in (v, t)."""
        ball, reach = self.limits.at(t)
        e = self.y - self.G @ v
        slack = reach**2 - self.squares(e)
        weight = np.concatenate([2 / slack, 2 / slack[: self.discs]])
        # -log(r^2 - |e|^2): gradient 2e/slack in e, -2r/slack in r; second derivatives 2/slack I + 4 ee'/slack^2, ...
        radial = (2 * e[: self.samples] / slack)[:, None] * self.G[: self.samples]
        radial[: self.discs] += (2 * e[self.samples :] / slack[: self.discs])[:, None] * self.G[self.samples :]
        pull = 2 * reach / slack * self.limits.reach[1]
        size = v.size
        gradient, hessian = np.empty(size + 1), np.empty((size + 1, size + 1))
        gradient[:size], gradient[size] = -self.G.T @ (weight * e), -np.sum(pull)
        hessian[:size, :size] = self.G.T @ (weight[:, None] * self.G) + radial.T @ radial
        hessian[size, :size] = radial.T @ pull
        hessian[size, size] = np.sum(pull**2 - 2 * self.limits.reach[1] ** 2 / slack)
        if self.n:
            self._add_ball(v, ball, gradient, hessian)
        hessian[:size, size] = hessian[size, :size]
        return gradient, hessian

    def _add_ball(self, v: np.ndarray, ball: float, gradient: np.ndarray, hessian: np.ndarray) -> None:
        n, slope = self.n, self.limits.ball[1]
        eigenvalues, U = np.linalg.eigh(self.matrix(v))
        rotated = U.T @ self.H @ U
        diagonal = np.einsum("jaa->ja", rotated)
        # `value` saw a positive gap; another eigenvalue routine may round it away at the limit of precision.
        least = np.finfo(float).eps * ball
        minus, plus = (1 / np.maximum(ball + sign * eigenvalues, least) for sign in (-1, 1))
        gradient[:n] += diagonal @ (minus - plus)
        gradient[-1] -= slope * np.sum(minus + plus)
        # tr(S H_i S H_j) for S = (bI -+ H)^{-1}, diagonal in the eigenbasis: one weight for both blocks.
        scaled = (rotated * np.sqrt(np.outer(minus, minus) + np.outer(plus, plus))).reshape(n, -1)
        hessian[:n, :n] += scaled @ scaled.T
        hessian[-1, :n] += slope * (diagonal @ (plus**2 - minus**2))
        hessian[-1, -1] += slope**2 * np.sum(minus**2 + plus**2)

    def candidate(self, v: np.ndarray, t: float) -> Candidate:
        """The point with the multipliers that the gradient of the barrier defines, up to a common factor."""
        ball, reach = self.limits.at(t)
        e = self.y - self.G @ v
        scale = 2 / (reach**2 - self.squares(e))
        samples = (scale * e[: self.samples]).astype(complex)
        samples[: self.discs] += 1j * scale[: self.discs] * e[self.samples :]
        Y = np.zeros((self.n, self.n))
        if self.n:
            eigenvalues, U = np.linalg.eigh(self.matrix(v))
            Y = self.data.sarason.symmetry @ ((U * (1 / (ball - eigenvalues) - 1 / (ball + eigenvalues))) @ U.T)
        return Candidate(v[: self.n], self.data.scaled_parameters(v[self.n :]), samples, Y, "central path")


def margin_path(data: ConvexData, level: float = 0.0) -> Iterator[tuple[Candidate, float, float]]:
    """Points on the central path of min s, ||X|| <= 1, |e_k| <= s: (candidate, s, gap to the smallest margin, nearly).

    Stops lowering s once it is below `level`; starts there at once where a simple point allows. Ends at the limit of
    working precision.
    """
    count = data.rows.y.size
    barrier = _Barrier(data, _Limits((1.0, 0.0), (np.zeros(count), np.ones(count))))
    v = np.zeros(barrier.G.shape[1])
    v[barrier.n :] = barrier.G[:, barrier.n :].T @ barrier.y
    worst = float(np.sqrt(barrier.squares(barrier.y - barrier.G @ v).max()))
    # Residuals are known to the rounding of y, in units of the bounds: no path goes below.
    floor = 4 * np.finfo(float).eps * max(1.0, float(np.abs(barrier.y).max()))
    s = level if worst < 0.9 * level else 2 * max(worst, floor)
    yield from _follow(barrier, v, s, level, floor)


def gain_path(data: ConvexData, center: Candidate, level: float) -> Iterator[tuple[Candidate, float, float]]:
    """Points on the central path of min kappa, ||X|| <= kappa, |e_k| <= level * (the bound at gain kappa K)."""
    fixed = data.rows.fixed
    barrier = _Barrier(data, _Limits((0.0, 1.0), (level * fixed, level * (1 - fixed))))
    v = np.concatenate([center.x, data.orthonormal_parameters(center.p)])
    yield from _follow(barrier, v, 1.0, 0.0, 1e-12)


def analytic_center(data: ConvexData, level: float, start: Candidate | None = None) -> Candidate:
    """Analytic centre of {||X(x)|| <= 1, |e_k| <= level}: maximises log det(I - X'X) + sum log(level^2 - |e_k|^2).

    From `start` where that is inside; else follows the central path of min s until s <= level. `level` must exceed the
    smallest margin strictly.

    Raises
    ------
    SolverError
        Where the path ends above `level`: it is not above the smallest margin, to working precision.
    """
    count, s = data.rows.y.size, np.inf
    barrier = _Barrier(data, _Limits((1.0, 0.0), (np.full(count, level), np.zeros(count))))
    inside = ((point, 0.0, 0.0) for point in [start] if point is not None)
    for point, s, _ in itertools.chain(inside, margin_path(data, level)):
        v = np.concatenate([point.x, data.orthonormal_parameters(point.p)])
        if s <= level and np.isfinite(barrier.value(v, 0.0)):
            return barrier.candidate(_center(barrier, v, 0.0, None)[0], 0.0)
    raise SolverError(f"no point with every |residual| <= {level:.9g} * bound was found; the best is {s:.9g}")


def _follow(
    barrier: _Barrier, v: np.ndarray, t: float, level: float, floor: float
) -> Iterator[tuple[Candidate, float, float]]:
    weight = barrier.parameter / t
    while True:
        if t > level:
            v, t = _center(barrier, v, t, weight)
        gap = barrier.parameter / weight
        _log.debug("central path: %.9g, gap %.2g", t, gap)
        yield barrier.candidate(v, t), t, gap
        if gap < _LAST * t or t <= 4 * floor:
            return
        weight *= _GROWTH


def _center(barrier: _Barrier, v: np.ndarray, t: float, weight: float | None) -> tuple[np.ndarray, float]:
    """Damped Newton: min weight * t + f(v, t) over (v, t); over v alone where weight is None."""
    price = 0.0 if weight is None else weight
    free = v.size + (weight is not None)
    last = np.inf
    for _ in range(_STEPS):
        gradient, hessian = barrier.derivatives(v, t)
        if not np.all(np.isfinite(hessian)):
            break  # beyond the limit of precision
        gradient[-1] += price
        step = np.zeros(v.size + 1)
        step[:free] = _newton(hessian[:free, :free], -gradient[:free])
        decrement = float(-gradient[:free] @ step[:free])
        # Near the centre values differ by less than their rounding: there the decrement itself must fall.
        near = decrement < _NEAR
        if decrement < _CENTERED or (near and decrement > 0.5 * last):
            break
        current = np.inf if near else price * t + barrier.value(v, t)
        last = decrement if near else np.inf
        # The damped step of self-concordance always descends; longer ones are tried first.
        damped = 1 / (1 + np.sqrt(decrement))
        for trial in (1.0, 4 * damped, 2 * damped, damped, damped / 4, damped / 64):
            size = min(trial, 1.0)
            ahead_v, ahead_t = v + size * step[:-1], t + size * step[-1]
            if price * ahead_t + barrier.value(ahead_v, ahead_t) < current:
                break
        else:
            break  # rounding level reached
        v, t = ahead_v, float(ahead_t)
    return v, t


def _newton(hessian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the Newton system, scaled to a unit diagonal; in the least-squares sense at the limit of precision."""
    scale = 1 / np.sqrt(np.diag(hessian))
    scaled = hessian * scale[:, None] * scale
    try:
        factor = scipy.linalg.cho_factor(scaled, lower=True)
        return scale * scipy.linalg.cho_solve(factor, scale * right)
    except np.linalg.LinAlgError:
        return scale * np.linalg.lstsq(scaled, scale * right, rcond=None)[0]
