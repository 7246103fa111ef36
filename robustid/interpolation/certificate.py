"""Certificates: multipliers whose value bounds the margin from below, whatever solver found them.

This module must not import a solver: its independence is what makes the numbers a proof.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.interpolation.rows import Rows
from robustid.interpolation.sarason import SarasonMap


@dataclasses.dataclass(frozen=True, eq=False)
class MarginCertificate(Frozen):
    """A proof that no system of the class keeps every |residual| below ``value`` times its bound.

    For any multipliers `samples` (one per sample, complex for discs) and any matrix `ball`:

        margin * sum|l_k|  >=  Re<l, y> - ||Y||_* - ||E'l - X*(Y)||  - |P'l| p_max

    because ||X(x)|| <= 1 bounds <Y, X(x)> by the nuclear norm of Y, and implies ||x|| <= 1; p_max bounds the free
    parameters of every system whose margin is at most `upper` (others need no proof). The right-hand side is recomputed
    from the numbers by `evaluate_certificate`, with an allowance for rounding.

    Attributes
    ----------
    samples : (N,) complex array
        Multipliers of the samples, normalised to sum|l_k| = 1.
    ball : (n, n) array
        Multiplier Y of the contraction X.
    upper : float
        A margin that is known to be reachable.
    value : float
        The proven lower bound of the margin; above 1 the data are refuted.
    """

    samples: np.ndarray
    ball: np.ndarray
    upper: float
    value: float

    def __post_init__(self) -> None:
        self._set(samples=freeze(self.samples), ball=freeze(self.ball))

    @property
    def shares(self) -> np.ndarray:
        """|l_k|, which sum to one: the part that each sample has in the proof, (N,)."""
        return np.abs(self.samples)

    def verify(self, rows: Rows, sarason: SarasonMap) -> bool:
        """Whether the numbers, evaluated anew, support the stated value."""
        if self.value <= 0:
            return self.value == 0  # claims nothing
        return bool(evaluate_certificate(self.samples, self.ball, self.upper, rows, sarason) >= self.value)


def certify_margin(
    samples: np.ndarray, ball: np.ndarray, upper: float, rows: Rows, sarason: SarasonMap
) -> MarginCertificate:
    """Certificate from any multipliers; a useless one (value 0) where they prove nothing."""
    n = sarason.pair.order
    weight = float(np.sum(np.abs(samples)))
    if not (np.isfinite(weight) and weight > 0 and np.all(np.isfinite(ball))):
        return MarginCertificate(np.zeros(rows.y.size, complex), np.zeros((n, n)), upper, 0.0)
    samples, ball = _cancel_parameters(np.asarray(samples, complex) / weight, rows), ball / weight
    norm = float(np.sum(np.abs(samples)))
    samples, ball = samples / norm, ball / norm
    value = evaluate_certificate(samples, ball, upper, rows, sarason)
    return MarginCertificate(samples, ball, upper, max(value, 0.0))


def evaluate_certificate(samples: np.ndarray, ball: np.ndarray, upper: float, rows: Rows, sarason: SarasonMap) -> float:
    """The lower bound of the margin that the multipliers prove, rounding errors allowed for."""
    n, count = sarason.pair.order, rows.y.size
    gain = np.real(rows.E.conj().T @ samples) if n else np.zeros(0)
    nuclear = float(np.sum(np.linalg.svd(ball, compute_uv=False))) if n else 0.0
    mismatch = float(np.linalg.norm(gain - sarason.adjoint(ball))) if n else 0.0
    fit = float(np.real(samples.conj() @ rows.y))
    free = np.real(rows.P.conj().T @ samples)
    leak = float(np.linalg.norm(free)) * _parameter_bound(upper, rows) if free.size else 0.0
    weight = float(np.sum(np.abs(samples)))
    if weight == 0:
        return 0.0
    # Each inner product of length N errs by at most N eps sum|terms|; the nuclear norm by O(n^2) eps ||Y||_F.
    size = float(np.sum(np.abs(samples) * (np.abs(rows.y) + np.linalg.norm(rows.E, axis=1))))
    allowance = 4 * np.finfo(float).eps * ((count + n) * size + n**2 * (nuclear + mismatch))
    return (fit - nuclear - mismatch - leak - allowance) / weight


def _cancel_parameters(samples: np.ndarray, rows: Rows) -> np.ndarray:
    """The nearest multipliers that are orthogonal to the free parameters: those may be arbitrarily large."""
    if not rows.P.shape[1]:
        return samples
    stacked = np.vstack([np.real(rows.P), np.imag(rows.P)])
    flat = np.concatenate([np.real(samples), np.imag(samples)])
    for _ in range(2):  # the second pass removes the rounding of the first
        flat = flat - stacked @ np.linalg.lstsq(stacked, flat, rcond=None)[0]
    return flat[: samples.size] + 1j * flat[samples.size :]


def _parameter_bound(upper: float, rows: Rows) -> float:
    """||p|| of every system with margin <= upper: P p = y - E x - e, ||x|| <= 1, |e_k| <= upper."""
    stacked = np.vstack([np.real(rows.P), np.imag(rows.P)])
    smallest = np.linalg.svd(stacked, compute_uv=False)[-1]
    reach = np.linalg.norm(rows.y) + np.linalg.norm(rows.E) + upper * np.sqrt(rows.y.size)
    return float(reach / smallest) * (1 + 1e-6)
