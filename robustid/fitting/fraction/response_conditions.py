"""Conditions on a response that are linear in the outputs C and D of its realisation, for given poles and inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real, freeze
from robustid.fitting.state_space.block_model import BlockModel


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseCondition(Frozen):
    """``left P(point) right = value``; at infinity P stands for the Markov parameter ``C A^power B``.

    Attributes
    ----------
    left : (a, ny) array
    right : (nu, c) array
    value : (a, c) array
    point : complex
        In the unit of the nodes, or inf.
    power : int
        Of A, at infinity.
    """

    left: Real
    right: Real
    value: Real
    point: complex
    power: int = 0

    def __post_init__(self) -> None:
        self._set(left=freeze(self.left), right=freeze(self.right), value=freeze(self.value))

    def transposed(self) -> ResponseCondition:
        """The condition on the transposed response."""
        return dataclasses.replace(self, left=self.right.T, right=self.left.T, value=self.value.T)

    def rows(self, model: BlockModel, feedthrough: bool) -> Real:
        """Rows of [C D] as the equations see them: (equations, ny, columns)."""
        if np.isinf(self.point):
            A, B = model.matrices()
            states = np.linalg.matrix_power(A, self.power) @ B
            through = np.zeros((B.shape[1], B.shape[1]))
        else:
            states, through = model.states(np.array([self.point]))[0], np.eye(self.right.shape[0])
        seen = (np.vstack([states, through]) if feedthrough else states) @ self.right
        return self._parts(self.left[:, None, :, None] * seen.T[None, :, None, :])

    def values(self) -> Real:
        """Right sides of the equations, (equations,)."""
        return self._parts(self.value)

    def changes(self, model: BlockModel, C: Real) -> Real:
        """Derivatives (equations, T) of the left side in the coordinates of the model, outputs held."""
        if np.isinf(self.point):
            tangent = model.markov_tangent(C, self.power)
        else:
            xi = np.array([self.point])
            tangent = model.tangent(xi, model.states(xi), C)[0]
        return self._parts(np.einsum("ao,out,uc->act", self.left, tangent, self.right))

    def _parts(self, values: NDArray[np.generic]) -> Real:
        """Real equations from complex ones (a, c, ...): the axes of the equations merged."""
        flat = values.reshape(-1, *values.shape[2:])
        return np.concatenate([flat.real, flat.imag]) if np.imag(self.point) else np.asarray(flat.real)


def equations(conditions: Sequence[ResponseCondition], model: BlockModel, feedthrough: bool) -> Real:
    """Rows of [C D] as all equations see them, (m, ny, columns)."""
    return np.concatenate([condition.rows(model, feedthrough) for condition in conditions])


def wanted(conditions: Sequence[ResponseCondition]) -> Real:
    """Right sides of all equations, (m,)."""
    return np.concatenate([condition.values() for condition in conditions])
