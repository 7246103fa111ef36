"""Certificates of upper bounds: multipliers that bound a functional over every consistent system, whatever solver found them.

This module must not import a solver: its independence is what makes the numbers a proof.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen, freeze
from robustid.identification.certificate import leaked, mismatched, nuclear_norm, real_rows
from robustid.identification.formulation.rows import Rows
from robustid.identification.formulation.sarason import SarasonMap

_DROPPED = 1e-12  # singular values of a multiplier that are left out, relative: they only cost their part of the bound


@dataclasses.dataclass(frozen=True, eq=False)
class Functional(Frozen):
    """A real number that every system of the class has: f = <x, u> + <p, v> + rest, |rest| <= tail.

    Attributes
    ----------
    x : (n,) array
        Weights of the coefficients of the non-parametric part.
    p : (m,) array
        Weights of the scaled parameters (transients included).
    tail : float
        What the other coefficients can do; 0 where the n coefficients determine the value.
    """

    x: np.ndarray
    p: np.ndarray
    tail: float = 0.0

    def __post_init__(self) -> None:
        self._set(x=freeze(self.x), p=freeze(self.p))

    def __call__(self, x: np.ndarray, p: np.ndarray) -> float:
        """The value but for the rest."""
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

    samples: np.ndarray
    left: np.ndarray
    right: np.ndarray
    level: float
    value: float

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("samples", "left", "right")})

    def shares(self, rows: Rows) -> np.ndarray:
        """Part of each bound in the proof, (M,); they sum to one."""
        size = rows.sizes(self.samples)
        return size / max(float(size.sum()), np.finfo(float).tiny)

    def verify(self, functional: Functional, rows: Rows, sarason: SarasonMap) -> bool:
        """Whether the numbers, evaluated anew, support the stated value."""
        multipliers = self.samples, self.left @ self.right.T
        return bool(evaluate_support(functional, *multipliers, self.level, rows, sarason) <= self.value)


def certify_support(
    functional: Functional, samples: np.ndarray, Y: np.ndarray, level: float, rows: Rows, sarason: SarasonMap
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
    functional: Functional, samples: np.ndarray, Y: np.ndarray, level: float, rows: Rows, sarason: SarasonMap
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
    total += nuclear_norm(S, sarason)
    total += mismatched(-samples, S, rows, sarason, functional.x)
    total += leaked(-samples, rows, level, functional.p) + functional.tail
    return float(total + 8 * eps * (abs(fit) + abs(total)))


def _match_parameters(samples: np.ndarray, wanted: np.ndarray, rows: Rows) -> np.ndarray:
    """The nearest multipliers with P'l = wanted for the free parameters."""
    free = ~rows.held
    if not free.any():
        return samples
    stacked, flat, wanted = real_rows(rows.P[:, free]), real_rows(samples), wanted[free]
    for _ in range(2):  # the second pass removes the rounding of the first
        flat = flat - np.linalg.lstsq(stacked.T, stacked.T @ flat - wanted, rcond=None)[0]
    return flat[: samples.size] + 1j * flat[samples.size :]
