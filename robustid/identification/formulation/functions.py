"""The functions that stand for the non-parametric part, as the measurements see them."""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Numbers, Real
from robustid.data import tilted
from robustid.identification.formulation.columns import Columns, DenseColumns
from robustid.identification.problem import MixedProblem

EntryColumns = Callable[[NDArray[np.bool_], float, float, NDArray[np.float64], NDArray[np.complex128] | None], Columns]

_SHORT = 1000  # samples; above, responses come by FFT: a matrix of all delays takes too much memory


class Functions(abc.ABC):
    """n functions K phi_j(z/rho) of an entry of the non-parametric part, and the tails: bounds of what they leave out, nothing
    unless a formulation says so. Where the class has a weight W, responses and their tails are those of W K phi_j; in time
    the inputs come filtered by W (`Weighting.filtered`).
    """

    problem: MixedProblem

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number n of coefficients of an entry."""

    @abc.abstractmethod
    def responses(self, angles: NDArray[np.float64]) -> Numbers:
        """Values at exp(j angle), (F, n), at frequencies of the data."""

    @abc.abstractmethod
    def time_responses(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Responses to an input (T,) from zero initial conditions, (T, n)."""

    def response_tail(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest singular value of the remainder at exp(j angle), without the scaling of the prior, (F,)."""
        return np.zeros(angles.size)

    def time_tail(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest response of the remainder of a row of G to inputs (T, q), (T,)."""
        return np.zeros(len(u))

    def entry_columns(self, angles: NDArray[np.float64]) -> EntryColumns:
        """Return what makes the columns of one entry at some of the angles: from the mask of these angles, the scale of the
        entry in the prior, what the entry is of its unknown, and the bounds and tilts there.
        """
        values = self.responses(angles)

        def columns(
            used: NDArray[np.bool_],
            scale: float,
            part: float,
            bound: NDArray[np.float64],
            tilt: NDArray[np.complex128] | None,
        ) -> Columns:
            return DenseColumns(tilted(values[used] * (scale * part) / bound[:, None], tilt))

        return columns

    def joined(self, lines: Sequence[Columns], real: Sequence[Columns]) -> Columns | None:
        """Columns of complex and of real samples in one piece, all of them on all coefficients; None where they differ in kind."""
        if not all(part.stored for part in lines):
            return None
        return DenseColumns(np.vstack([part.dense() for part in (*lines, *real)]))


def filtered_by(u: NDArray[np.float64], impulse: NDArray[np.float64]) -> Real:
    """Responses to u of systems with these impulse responses (T, m), from zero initial conditions."""
    if u.size <= _SHORT:
        return scipy.linalg.toeplitz(u, np.zeros(u.size)) @ impulse
    return scipy.linalg.matmul_toeplitz((u, np.zeros(u.size)), impulse)
