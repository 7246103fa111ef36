"""Proved errors as shares of the response, and their median: one number wherever it is shown."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, hz_span, hz_words, rounded_up
from robustid.identification import MixedProblem

_SAME = 1e-9  # relative: frequencies that are one


@dataclasses.dataclass(frozen=True, eq=False)
class RelativeErrors(Frozen):
    """Bounds of the largest singular value of F - model over that of the model, at the frequencies of the data."""

    # (N,), rad/s; frequencies between the lowest and the highest frequency point at which something is proved; where
    # there are none, all at which something is
    omega: Real
    share: Real  # (N,)

    @property
    def median(self) -> float:
        """Median, per cent of the response, rounded up to four digits; NaN where nothing is proved."""
        return rounded_up(100 * float(np.median(self.share))) if self.share.size else float("nan")

    @property
    def words(self) -> str:
        """The median in words, with what it is the median of."""
        hz = self.omega / (2 * np.pi)
        where = (
            f"at {hz_words(hz[0], 4)}"
            if hz.size == 1
            else f"at {hz.size} frequencies from {hz_span(float(hz[0]), float(hz[-1]), 4)}"
        )
        return f"{self.median:.4g} % of the response {where}"


def relative_errors(
    problem: MixedProblem, omega: Real, upper: Real, nominal: Complex, known: NDArray[np.bool_]
) -> RelativeErrors:
    """The bounds `upper` (F,) as shares of the response (F, ny, nu), where they are known."""
    inside = known & of_data(problem, omega)
    chosen = inside if inside.any() else known
    size = np.linalg.norm(nominal[chosen], 2, axis=(1, 2))
    with np.errstate(over="ignore"):  # of a response that is 0 any error is infinitely many per cent
        share = upper[chosen] / np.maximum(size, np.finfo(float).tiny)
    return RelativeErrors(omega[chosen], share)


def of_data(problem: MixedProblem, omega: Real) -> NDArray[np.bool_]:
    """Mask of the frequencies between the lowest and the highest frequency point; none without any."""
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    if not lines.size:
        return np.zeros(omega.size, bool)
    return (omega >= lines.min() * (1 - _SAME)) & (omega <= lines.max() * (1 + _SAME))
