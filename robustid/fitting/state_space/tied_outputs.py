"""The best outputs where they are tied to the inputs, so that the response is symmetric."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import Complex, Real
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.state_space.outputs import Criterion, Fitted, LocalModel, Outputs


class TiedOutputs(Outputs):
    """`Outputs` of reciprocal systems: ``P = P'``, what drives a mode is also how it shows.

    C is a combination of the matrices that the model names (`tied_outputs`), one or two for every mode in the place of one or
    two for every mode and output; D is symmetric. Moving the inputs moves C, whose derivative is the transpose.
    """

    def __init__(self, problem: FractionProblem | Criterion) -> None:
        super().__init__(problem)
        self.apart = self.alike = False
        self.target = self.rows([block.values[..., None] for block in self.criterion.blocks])[..., 0]

    def design(self, model: LocalModel, states: Complex) -> Real:
        """Weighted response (1, rows, columns) of every coefficient: of C first, then of D."""
        changes: Any = np.einsum("tok,fku->fout", model.tied_outputs(), states, optimize=True)
        if self.criterion.feedthrough:
            through = symmetric_matrices(self.ny).transpose(1, 2, 0)
            through = np.broadcast_to(through, (*changes.shape[:3], through.shape[2]))
            changes = np.concatenate([changes, through], axis=3)
        return self.rows([changes])

    def matrix(self, model: LocalModel, coefficients: Real) -> Real:
        """[C D] of the coefficients (1, columns) that `design` belongs to."""
        ties = model.tied_outputs()
        C = np.tensordot(coefficients[0, : len(ties)], ties, axes=1)
        if not self.criterion.feedthrough:
            return C
        return np.hstack([C, np.tensordot(coefficients[0, len(ties) :], symmetric_matrices(self.ny), axes=1)])

    def changes(self, fitted: Fitted) -> Real:
        """Weighted derivatives (1, rows, T) of the response in the coordinates of the model, the ties kept."""
        xi, model = self.criterion.xi, fitted.model
        tangent = model.tangent(xi, fitted.states, fitted.C)
        return self.rows([model.tied_changes(fitted.states, fitted.C, tangent)])

    def by_blocks(self, fitted: Fitted) -> tuple[Real, int]:
        """Coefficients (1, columns), and how many belong to a block of poles."""
        seen = fitted.basis.transpose(0, 2, 1) @ self.target[..., None]
        return (fitted.inverse @ seen)[..., 0], fitted.model.width


def symmetric_matrices(size: int) -> Real:
    """A basis (T, size, size) of the symmetric matrices."""
    pairs = [(i, j) for i in range(size) for j in range(i + 1)]
    out = np.zeros((len(pairs), size, size))
    for gain, (i, j) in zip(out, pairs, strict=True):
        gain[i, j] = gain[j, i] = 1.0
    return out
