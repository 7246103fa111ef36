"""Certificates: multipliers whose value bounds the margin from below, or a functional from above, whatever solver found them.

This module must not import a solver: its independence is what makes the numbers a proof.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Numbers, freeze, real_rows
from robustid.identification.formulation.rows import Rows
from robustid.identification.formulation.sarason import SarasonMap

_UNUSED = 1e-6  # relative slope of a parameter below which the proof doesn't use the ends of its interval
_DROPPED = 1e-12  # singular values of a multiplier that are left out, relative: they only cost their part of the bound


@dataclasses.dataclass(frozen=True, eq=False)
class MarginCertificate(Frozen):
    """A proof that no system of the class keeps every |residual| below ``value`` times its bound.

    For any multipliers `samples` l (one per sample, complex for discs) and any matrix `ball` S, with Y = S - A S A':

        margin * sum|l_k|  >=  Re<l, y> - ||Y||_* - r ||E'l - c S|| - max (P'l)'p - sum|l_k| tail_k

    because <c S, x> = <Y, X(x)>, ||X(x)|| <= 1 bounds <Y, X(x)> by the nuclear norm of Y and implies ||x|| <= r, where r = 1, of
    p x q matrices min(p, q)^(1/2) (of other classes than the ball: `SarasonMap.product` and `SarasonMap.largest`). |l_k| is the
    norm of the multipliers that share the bound k. The maximum is over the parameters p in their intervals; of the free ones it
    is |P'l| p_max, where p_max bounds those of every system whose margin is at most `upper` (others need no proof). The
    right-hand side is recomputed from the numbers by `evaluate_certificate`: sums and products only, with an allowance for their
    rounding. The arrays y, E, P, A, c are taken as they are in double precision.

    Attributes
    ----------
    samples : (N,) complex array
        Multipliers of the samples, normalised to sum|l_k| = 1.
    ball : (np, nq) array
        S.
    upper : float
        A margin that is known to be reachable.
    value : float
        The proven lower bound of the margin; above 1 the data are refuted.
    """

    samples: NDArray[np.complex128]
    ball: NDArray[np.float64]
    upper: float
    value: float

    def __post_init__(self) -> None:
        self._set(samples=freeze(self.samples), ball=freeze(self.ball))

    def shares(self, rows: Rows) -> NDArray[np.float64]:
        """|l_k|, which sum to one: the part that each bound has in the proof, (M,)."""
        return rows.sizes(self.samples)

    def verify(self, rows: Rows, sarason: SarasonMap) -> bool:
        """Say whether the numbers, evaluated anew, support the stated value."""
        if self.value <= 0:
            return self.value == 0  # claims nothing
        return bool(evaluate_certificate(self.samples, self.ball, self.upper, rows, sarason) >= self.value)


def certify_margin(
    samples: Numbers, Y: NDArray[np.float64], upper: float, rows: Rows, sarason: SarasonMap
) -> MarginCertificate:
    """Certificate from any multipliers of the samples and of X; a useless one (value 0) where they prove nothing."""
    # The multipliers of a solver satisfy their equation E'l = c S only to its accuracy, and what remains costs its norm, in
    # units of K/bound. Two versions are evaluated: as they are, and with the smallest relative change of l that removes it.
    weight = float(np.sum(rows.sizes(samples)))
    best = MarginCertificate(np.zeros(rows.y.size, complex), np.zeros(sarason.shape), upper, 0.0)
    if not (np.isfinite(weight) and weight > 0 and np.all(np.isfinite(Y)) and np.isfinite(upper)):
        return best
    raw = np.asarray(samples, np.complex128) / weight
    S = sarason.stein(Y / weight)
    changes: list[NDArray[np.complex128]] = [raw]
    if rows.E.stored or sarason.largest(upper) > 1:
        changes.append(_balanced(raw, sarason.first_row(S), rows))
    for changed in changes:
        for without in _powerless(changed, rows):
            multipliers = _orthogonal(changed, rows, without)
            norm = float(np.sum(rows.sizes(multipliers)))
            value = evaluate_certificate(multipliers / norm, S / norm, upper, rows, sarason) if norm > 0 else 0.0
            if value > best.value:
                best = MarginCertificate(multipliers / norm, S / norm, upper, value)
    return best


def evaluate_certificate(
    samples: NDArray[np.complex128], ball: NDArray[np.float64], upper: float, rows: Rows, sarason: SarasonMap
) -> float:
    """The lower bound of the margin that the multipliers prove, rounding errors allowed for."""
    size, count, eps = np.abs(samples), rows.y.size, float(np.finfo(float).eps)
    shared = rows.sizes(samples)
    weight = float(np.sum(shared))
    if not (weight > 0 and np.isfinite(weight)):
        return 0.0
    # An inner product of length m, complex or not, errs by at most 2 (m + 2) eps sum|terms|.
    long = 2 * (count + 2) * eps
    fit = float(np.real(samples.conj() @ rows.y)) - long * float(size @ np.abs(rows.y))
    nuclear, mismatch = largest_product(ball, sarason, upper), mismatched(samples, ball, rows, sarason, upper)
    leak = leaked(samples, rows, upper, sarason.largest(upper))
    tail = float(shared @ rows.tail) * (1 + long)
    return float((fit - nuclear - mismatch - leak - tail) / (weight * (1 + long)))


@dataclasses.dataclass(frozen=True, eq=False)
class Functional(Frozen):
    """A real number that every system of the class has: f = <x, u> + <p, v> + remainder, |remainder| <= tail."""

    x: NDArray[np.float64]  # (n,); weights of the coefficients of the non-parametric part
    p: NDArray[np.float64]  # (m,); weights of the scaled parameters (transients included)
    tail: float = 0.0  # what the other coefficients can do; 0 where the n coefficients determine the value

    def __post_init__(self) -> None:
        self._set(x=freeze(self.x), p=freeze(self.p))

    def __call__(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> float:
        """The value but for the remainder."""
        return float(self.x @ x + self.p @ p)


@dataclasses.dataclass(frozen=True, eq=False)
class SupportCertificate(Frozen):
    """A proof that a functional f is at most ``value`` for every system of the class with |residual_k| <= level * bound_k.

    For any multipliers `samples` l (one per sample, complex for discs) and any matrix Y = `left` `right`', with the S that solves
    S - A S A' = Y,

        f <= Re<l, y> + sum|l_k| reach_k + ||Y||_* + r ||w - E'l - c S|| + max (d - P'l)'p + tail

    because y = E x + P p + e with |e_k| <= reach_k (level, and the tail of the sample), <c S, x> = <Y, X(x)> with ||X(x)|| <= 1,
    which implies ||x|| <= r (r and |l_k| as in `MarginCertificate`), and the parameters are in their intervals or bounded by the
    samples. w and d are the weights of f. The right-hand side is evaluated as sums and products, Y as S - A S A' of the S found,
    with an allowance for their rounding.

    Attributes
    ----------
    samples : (N,) complex array
    left, right : (n, r) arrays
        Factors of Y: few directions of the contraction are at their limit.
    level : float
        Multiple of the bounds that is allowed.
    value : float
    """

    samples: NDArray[np.complex128]
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    level: float
    value: float

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("samples", "left", "right")})

    def shares(self, rows: Rows) -> NDArray[np.float64]:
        """Part of each bound in the proof, (M,); they sum to one."""
        size = rows.sizes(self.samples)
        return size / max(float(size.sum()), np.finfo(float).tiny)

    def verify(self, functional: Functional, rows: Rows, sarason: SarasonMap) -> bool:
        """Say whether the numbers, evaluated anew, support the stated value."""
        multipliers = self.samples, self.left @ self.right.T
        return bool(evaluate_support(functional, *multipliers, self.level, rows, sarason) <= self.value)


def certify_support(
    functional: Functional,
    samples: NDArray[np.complex128],
    Y: NDArray[np.float64],
    level: float,
    rows: Rows,
    sarason: SarasonMap,
) -> SupportCertificate:
    """Certificate from any multipliers; value inf where they are not numbers.

    Free parameters may be very large: their equation P'l = d is met to rounding first.
    """
    count, (high, wide) = rows.y.size, sarason.shape
    if not (np.all(np.isfinite(samples)) and np.all(np.isfinite(Y))):
        return SupportCertificate(np.zeros(count, complex), np.zeros((high, 0)), np.zeros((wide, 0)), level, np.inf)
    multipliers = _match_parameters(np.asarray(samples, complex), functional.p, rows)
    left, singular, right = np.linalg.svd(Y, full_matrices=False)
    rank = int(np.sum(singular > _DROPPED * singular.max(initial=0.0)))
    root = np.sqrt(singular[:rank])
    factors = left[:, :rank] * root, right[:rank].T * root
    value = evaluate_support(functional, multipliers, factors[0] @ factors[1].T, level, rows, sarason)
    # Solving for S again, elsewhere, may differ in its last digits.
    return SupportCertificate(multipliers, *factors, level, float(value + 1e-12 * abs(value)))


def evaluate_support(
    functional: Functional,
    samples: NDArray[np.complex128],
    Y: NDArray[np.float64],
    level: float,
    rows: Rows,
    sarason: SarasonMap,
) -> float:
    """The upper bound of the functional that the multipliers prove, rounding errors allowed for."""
    count, eps, size = rows.y.size, float(np.finfo(float).eps), np.abs(samples)
    if functional.x.shape != (sarason.size,) or functional.p.shape != (rows.P.shape[1],):
        return np.inf
    long = 2 * (count + 2) * eps
    S = sarason.stein(Y)
    reach = level + rows.tail
    fit = float(np.real(samples.conj() @ rows.y)) + long * float(size @ np.abs(rows.y))
    total = fit + float(rows.sizes(samples) @ reach) * (1 + long)
    total += largest_product(S, sarason, level)
    total += mismatched(-samples, S, rows, sarason, level, functional.x)
    total += leaked(-samples, rows, level, sarason.largest(level), functional.p) + functional.tail
    return float(total + 8 * eps * (abs(fit) + abs(total)))


def _match_parameters(
    samples: NDArray[np.complex128], wanted: NDArray[np.float64], rows: Rows
) -> NDArray[np.complex128]:
    """The nearest multipliers with P'l = wanted for the free parameters."""
    free = ~rows.held
    if not free.any():
        return samples
    stacked, flat, wanted = real_rows(rows.P[:, free]), real_rows(samples), wanted[free]
    for _ in range(2):  # the second pass removes the rounding of the first
        flat = flat - np.linalg.lstsq(stacked.T, stacked.T @ flat - wanted, rcond=None)[0]
    return flat[: samples.size] + 1j * flat[samples.size :]


def largest_product(S: NDArray[np.float64], sarason: SarasonMap, level: float) -> float:
    """Above <Y, X> of all functions of the class, Y = S - A S A' (for MIMO A stands for A (x) I); ||Y||_* of the ball.

    With an allowance for rounding; `level` as in `SarasonMap.largest`.
    """
    A, n, eps = sarason.pair.A, sarason.pair.order, float(np.finfo(float).eps)
    if not n:
        return 0.0
    parts = sarason.entries.parted(S)
    if sarason.entrywise:
        some = np.any(parts != 0, axis=(2, 3))  # those of a proof about one entry are zero elsewhere
        parts = parts[np.ix_(some.any(axis=1), some.any(axis=0))]
    if not parts.size:
        return 0.0
    Y = sarason.entries.joined(parts - A @ parts @ A.T)
    spread = np.abs(parts) + np.abs(A) @ np.abs(parts) @ np.abs(A.T)
    most, small = sarason.product(Y, level), min(sarason.shape)
    rounding = 4 * (n + 2) * eps * np.sqrt(small) * float(np.linalg.norm(spread))
    return most + 10 * max(sarason.shape) * eps * most + rounding * sarason.largest(level)


def mismatched(
    samples: NDArray[np.complex128],
    S: NDArray[np.float64],
    rows: Rows,
    sarason: SarasonMap,
    level: float,
    wanted: NDArray[np.float64] | float = 0.0,
) -> float:
    """An upper bound of <wanted + E'l - c S, x> over the class, with an allowance for rounding."""
    c, n, size, eps = sarason.pair.c, sarason.pair.order, np.abs(samples), float(np.finfo(float).eps)
    long, short = 2 * (size.size + 2) * eps, 2 * (n + 4) * eps
    mismatch = float(np.linalg.norm(wanted + rows.E.adjoint(samples) - sarason.first_row(S)))
    mismatch += long * float(np.linalg.norm(rows.E.spread(size))) + 4 * eps * float(np.linalg.norm(wanted))
    spread = sarason.entries.spread(np.abs(c[0]) @ np.abs(sarason.entries.parted(S)))
    reach = rows.reach * sarason.largest(level)
    return reach * (mismatch + short * float(np.linalg.norm(spread))) * (1 + 4 * eps)


def leaked(
    samples: NDArray[np.complex128], rows: Rows, upper: float, largest: float, wanted: NDArray[np.float64] | float = 0.0
) -> float:
    """An upper bound of (wanted + P'l)'p over all parameters in their intervals, the free ones of margin <= upper.

    `largest` bounds ||X|| of these systems.
    """
    if not rows.P.shape[1]:
        return 0.0
    eps, held = float(np.finfo(float).eps), rows.held
    slope = wanted + np.real(rows.P.conj().T @ samples)
    rounding = 2 * (samples.size + 2) * eps * (np.abs(rows.P).T @ np.abs(samples)) + 4 * eps * np.abs(wanted)
    ends = rows.ends[held]
    free = float(np.linalg.norm(slope[~held]) + np.linalg.norm(rounding[~held]))
    leak = free * _parameter_bound(upper, largest, rows) if free else 0.0
    reach = np.abs(ends).max(axis=1, initial=0.0)
    error = rounding[held] + 2 * (held.size + 2) * eps * np.abs(slope[held])
    return leak + float(np.sum((slope[held, None] * ends).max(axis=1, initial=-np.inf))) + float(error @ reach)


def _balanced(samples: NDArray[np.complex128], target: NDArray[np.float64], rows: Rows) -> NDArray[np.complex128]:
    """The smallest relative change of the multipliers for which E'l = target and P'l = 0 of the free parameters, approximately."""
    flat, scale = real_rows(samples), np.tile(np.abs(samples), 2)
    free = real_rows(rows.P[:, ~rows.held])
    matrix = np.hstack([real_rows(rows.E.dense()), free])
    wanted = np.concatenate([target, np.zeros(free.shape[1])])
    for _ in range(3):  # each pass removes the rounding of the one before
        flat = flat + scale * np.linalg.lstsq((scale[:, None] * matrix).T, wanted - matrix.T @ flat, rcond=None)[0]
    return flat[: samples.size] + 1j * flat[samples.size :]


def _powerless(samples: NDArray[np.complex128], rows: Rows) -> list[NDArray[np.bool_]]:
    """Parameters to which multipliers may be made orthogonal: the free ones, and those too whose ends the proof doesn't use.

    In a wide interval the rounding of the multipliers is worth more than the end.
    """
    free = ~rows.held
    slope = np.abs(np.real(rows.P.conj().T @ samples))
    unused = slope <= _UNUSED * (np.abs(rows.P).T @ np.abs(samples))
    return [free] if np.array_equal(free, free | unused) else [free, free | unused]


def _orthogonal(samples: NDArray[np.complex128], rows: Rows, without: NDArray[np.bool_]) -> NDArray[np.complex128]:
    """The nearest multipliers that are orthogonal to some parameters: those may be very large."""
    if not without.any():
        return samples
    stacked, flat = real_rows(rows.P[:, without]), real_rows(samples)
    for _ in range(2):  # the second pass removes the rounding of the first
        flat = flat - stacked @ np.linalg.lstsq(stacked, flat, rcond=None)[0]
    return flat[: samples.size] + 1j * flat[samples.size :]


def _parameter_bound(upper: float, largest: float, rows: Rows) -> float:
    """||p|| of the free parameters with margin <= upper: P p = y - E x - e - (the others), ||x|| <= r, |e_k| <= upper + tail_k."""
    widest, smallest = rows.free_singular
    smallest -= 10 * sum(rows.P.shape) * np.finfo(float).eps * widest
    if smallest <= 0:
        return np.inf
    reach = (
        np.linalg.norm(rows.y)
        + rows.E.norm * rows.reach * largest
        + upper * np.sqrt(rows.cones)
        + np.linalg.norm(rows.tail)
    )
    reach += np.linalg.norm(rows.P[:, rows.held]) * np.linalg.norm(
        np.abs(rows.ends[rows.held]).max(axis=1, initial=0.0)
    )
    return float(reach / smallest) * (1 + 1e-9)
