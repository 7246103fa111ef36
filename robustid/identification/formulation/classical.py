"""The consistency condition in the basis of the paper: Theorem 1 and Lemma 1 of `inanc2001`."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.bases import InputNormalPair, solve_stein
from robustid.core import Frozen, freeze
from robustid.identification.formulation.ball import Inequalities
from robustid.identification.formulation.exact import ExactFormulation
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.problem import MixedProblem

_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclasses.dataclass(frozen=True, eq=False)
class ClassicalForm(Frozen):
    """Unknowns: the values w_i/K at the nodes and the Taylor coefficients g_k/K themselves; [M0^{-1} Z; Z' M0] >= 0."""

    # M0 = V'V is the Gram matrix of the kernel functions and Z the matrix of the data: diagonal for nodes (a conjugate pair as
    # a 2x2 rotation), upper-triangular Toeplitz for Taylor coefficients. V maps to the orthonormal basis, X = V Z V^{-1}; the
    # condition number of M0 is that of V squared, and M0 is inverted.

    V: NDArray[np.float64]  # (n, n)
    gram: NDArray[np.float64]  # (n, n), M0
    data_basis: NDArray[np.float64]  # (n, n, n), Z of each real unknown
    to_orthonormal: NDArray[np.float64]  # (n, n), the coefficients x of each unknown (columns)

    def __post_init__(self) -> None:
        self._set(**{f.name: freeze(getattr(self, f.name)) for f in dataclasses.fields(self)})

    @property
    def condition(self) -> float:
        """Condition number of M0."""
        return float(np.linalg.cond(self.gram))


def classical_form(pair: InputNormalPair, nodes: NDArray[np.complex128], radius: float, taylor: int) -> ClassicalForm:
    """Return the matrices of Theorem 1 for nodes in the order of their angles and `taylor` coefficients, in real coordinates."""
    blocks: list[NDArray[np.float64]] = []
    starts: list[NDArray[np.float64]] = []
    directions: list[list[NDArray[np.float64]]] = []
    for zeta in nodes:
        if abs(zeta.imag) <= 1e-15:
            blocks.append(np.array([[zeta.real]]))
            starts.append(np.ones(1))
            directions.append([np.eye(1)])
        else:
            blocks.append(zeta.real * np.eye(2) + zeta.imag * _TURN)
            starts.append(np.array([np.sqrt(2.0), 0.0]))
            directions.append([np.eye(2), _TURN])
    if taylor:
        blocks.append(np.diag(np.full(taylor - 1, radius), 1))
        starts.append(np.eye(1, taylor)[0])
        directions.append([np.eye(taylor, k=k) for k in range(taylor)])
    start = np.concatenate(starts)
    V = solve_stein(pair.A.T, scipy.linalg.block_diag(*blocks), pair.c.T @ start[None, :])
    zeros = [np.zeros_like(block) for block in blocks]
    basis = np.stack(
        [
            scipy.linalg.block_diag(*zeros[:i], direction, *zeros[i + 1 :])
            for i, group in enumerate(directions)
            for direction in group
        ]
    )
    return ClassicalForm(V, V.T @ V, basis, np.asarray(np.linalg.solve(V.T, (start @ basis).T), dtype=float))


@dataclasses.dataclass(frozen=True, eq=False)
class ClassicalMap(PairMap):
    """The map of a pair, whose condition is stated to general solvers as in Theorem 1."""

    form: ClassicalForm = dataclasses.field(kw_only=True)

    conic: ClassVar[bool] = True

    def inequalities(self) -> Inequalities:
        """``[b M0^{-1} Z; Z' b M0] >= 0``, = F [b I X; X' b I] F' with F = diag(V^{-1}, V')."""
        form, n = self.form, self.pair.order
        both = np.zeros((n, 2 * n, 2 * n))
        both[:, :n, n:], both[:, n:, :n] = form.data_basis, form.data_basis.transpose(0, 2, 1)
        constant = scipy.linalg.block_diag(np.linalg.inv(form.gram), form.gram)

        def multiplier(Z: list[NDArray[np.float64]]) -> NDArray[np.float64]:
            return -2 * np.linalg.inv(form.V).T @ Z[0][:n, n:] @ form.V.T

        return Inequalities((constant,), (both,), form.to_orthonormal, multiplier)


@dataclasses.dataclass(frozen=True, eq=False)
class ClassicalFormulation(ExactFormulation):
    """The exact form, solved in the basis of the paper: for small data, and to show what its conditioning costs."""

    name: ClassVar[str] = "classical"

    @classmethod
    def takes(cls, problem: MixedProblem) -> bool:
        """Say whether the problem is SISO."""
        return problem.entries.single

    @classmethod
    def refusal(cls, problem: MixedProblem) -> str:
        """The theorem is about one entry."""
        p, q = problem.entries.shape
        return (
            f"is the one of the paper, whose theorem is about one input and one output; got {p}x{q}. Take"
            ' form="orthonormal": the same conditions in another basis, for matrices too'
        )

    def _sarason(self) -> ClassicalMap:
        problem = self.problem
        radius = float(np.sqrt(1 - problem.region.inside(np.zeros(1))[0]))
        nodes = problem.region.points(np.sort([*problem.angles, *self.first]))
        form = classical_form(self.pair, nodes, radius, self.determined)
        return ClassicalMap(self.pair, problem.entries, form=form)
