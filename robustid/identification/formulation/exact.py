"""The exact form: an input-normal pair whose nodes are those of the data, so that nothing is left out."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from robustid.bases import InputNormalPair
from robustid.core import Numbers
from robustid.errors import Remedy, SizeError
from robustid.identification.formulation.base import LARGEST_EXACT, Formulation, Realisation
from robustid.identification.formulation.functions import filtered_by
from robustid.identification.formulation.sarason import PairMap, SarasonMap
from robustid.identification.interpolant import FreeParameter
from robustid.identification.problem import MixedProblem

LARGEST_MATRIX = 1600  # coefficients of all inputs and outputs: the size of the semidefinite block of a matrix
QUICK_EXACT = 100  # coefficients; minutes begin at LARGEST_EXACT

MOST_PRODUCTS = 1e8  # numbers held at once: 0.8 GB
_SAME_NODE = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class ExactFormulation(Formulation):
    """Two coefficients for every node off the real axis, one for every other and for every time sample."""

    delays: int | None = None  # number of Taylor coefficients; None: as many as the time samples need
    # Angles of further nodes, at the head of the cascade: tight samples then say nothing about the new coefficients.
    first: tuple[float, ...] = ()

    name: ClassVar[str] = "orthonormal"
    exact: ClassVar[bool] = True

    @classmethod
    def within(cls, problem: MixedProblem, accuracy: float) -> ExactFormulation:
        """The form itself, whatever the accuracy."""
        return cls(problem)

    @property
    def determined(self) -> int:
        """Number of Taylor coefficients of G that the coefficients determine."""
        return self.problem.taylor if self.delays is None else self.delays

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.determined + sum(1 if angle in (0.0, np.pi) else 2 for angle in (*self.problem.angles, *self.first))

    @functools.cached_property
    def pair(self) -> InputNormalPair:
        """The pair whose nodes are those of the data."""
        return self.problem.region.pair(self.problem.angles, self.determined, self.first)

    @property
    def basis(self) -> InputNormalPair:
        """The functions of the pair."""
        return self.pair

    def _sarason(self) -> SarasonMap:
        return PairMap(self.pair, self.problem.entries)

    @property
    def description(self) -> str:
        """The number of coefficients."""
        return f"{self.count} coefficients{self.problem.entries.each}, exact"

    def with_node(self, angle: float) -> ExactFormulation:
        """The form with a node there; itself where it has one."""
        if np.any(np.abs(self.problem.angles - angle) <= _SAME_NODE * max(angle, 1e-300)):
            return self
        return dataclasses.replace(self, first=(min(angle, np.pi),))

    def with_nodes(self, angles: NDArray[np.float64]) -> ExactFormulation:
        """The form with nodes at all of them."""
        known = self.problem.angles
        apart = np.abs(known[:, None] - angles).min(axis=0, initial=np.inf) > _SAME_NODE * np.maximum(angles, 1e-300)
        return (
            dataclasses.replace(self, first=tuple(np.minimum(angles[apart], np.pi).tolist())) if apart.any() else self
        )

    def responses(self, angles: NDArray[np.float64]) -> Numbers:
        """Values at the nodes of the angles, (F, n)."""
        return self.values(self.problem.angles[self.problem.node_index(angles)])

    def time_responses(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Responses to an input from zero initial conditions, (T, n)."""
        return filtered_by(u, self.impulses(u.size))

    def realisation(self, x: NDArray[np.float64], E: FreeParameter = 0.0) -> Realisation:
        """The interpolant itself, with all its states."""
        states = self._states(x, E)
        return lambda _: (states, 0.0)

    @property
    def quick(self) -> bool:
        """Say whether no other form need be looked for."""
        return self.problem.entries.single and self.count <= QUICK_EXACT

    @property
    def _most(self) -> int:
        """Most coefficients; of matrices those of all signals together."""
        entries = self.problem.entries
        return LARGEST_EXACT if entries.single else LARGEST_MATRIX // (entries.outputs + entries.inputs)

    def _siso_work(self) -> float:
        return 8.0 * self.count**4 if self.count <= LARGEST_EXACT else math.inf

    def _mimo_work(self) -> float:
        (p, q), n = self.problem.entries.shape, self.count
        if n > self._most:
            return math.inf
        return self._dense_work(p * q) + (24.0 * (p + q) ** 2 + 16.0 * p**2 * q**2) * n**3

    def check_size(self, accuracy: float) -> None:
        """Refuse more coefficients than minutes are enough for."""
        if self.count > self._most:
            raise SizeError(
                f"`problem` has {self.count} coefficients in the exact form (2 per frequency point, 1 per time sample); it takes"
                f" up to {self._most}. ",
                Remedy(
                    {},
                    'Use form="auto" or "taylor", or thin the data: frf.select(slice(None, None, step)), a shorter record, or'
                    " fewer points where the response is smooth",
                ),
            )

    @property
    def _kind(self) -> tuple[str, int]:
        return "coefficients", LARGEST_EXACT
