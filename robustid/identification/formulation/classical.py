"""The consistency condition in the basis of the paper: Theorem 1 and Lemma 1 of `inanc2001`."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from robustid.bases import InputNormalPair, solve_stein
from robustid.core import Frozen, freeze

_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclasses.dataclass(frozen=True, eq=False)
class ClassicalForm(Frozen):
    """Unknowns: the values w_i/K at the nodes and the Taylor coefficients g_k/K themselves.

    ``[M0^{-1} Z; Z' M0] >= 0`` with M0 = V'V the Gram matrix of the kernel functions and Z the matrix of the data:
    diagonal for nodes (a conjugate pair as a 2x2 rotation), upper-triangular Toeplitz for Taylor coefficients. V maps
    to the orthonormal basis, X = V Z V^{-1}; the condition number of M0 is that of V squared, and M0 is inverted.

    Attributes
    ----------
    V : (n, n) array
    gram : (n, n) array
        M0.
    data_basis : (n, n, n) array
        Z of each real unknown.
    to_orthonormal : (n, n) array
        The coefficients x of each unknown (columns).
    """

    V: np.ndarray
    gram: np.ndarray
    data_basis: np.ndarray
    to_orthonormal: np.ndarray

    def __post_init__(self) -> None:
        self._set(**{f.name: freeze(getattr(self, f.name)) for f in dataclasses.fields(self)})

    @property
    def condition(self) -> float:
        """Condition number of M0."""
        return float(np.linalg.cond(self.gram))


def classical_form(pair: InputNormalPair, angles: np.ndarray, decay_rate: float, taylor: int) -> ClassicalForm:
    """Theorem 1's matrices for lines at `angles` and `taylor` coefficients, in real coordinates."""
    blocks, starts, directions = [], [], []
    for angle in np.sort(angles):
        zeta = np.exp(-1j * angle) / decay_rate
        if angle in (0.0, np.pi):
            blocks.append(np.array([[zeta.real]]))
            starts.append(np.ones(1))
            directions.append([np.eye(1)])
        else:
            blocks.append(zeta.real * np.eye(2) + zeta.imag * _TURN)
            starts.append(np.array([np.sqrt(2.0), 0.0]))
            directions.append([np.eye(2), _TURN])
    if taylor:
        blocks.append(np.diag(np.full(taylor - 1, 1 / decay_rate), 1))
        starts.append(np.eye(1, taylor)[0])
        directions.append([np.eye(taylor, k=k) for k in range(taylor)])
    start = np.concatenate(starts)
    V = solve_stein(pair.A.T, np.asarray(scipy.linalg.block_diag(*blocks)), pair.c.T @ start[None, :])
    zeros = [np.zeros_like(block) for block in blocks]
    basis = np.stack(
        [
            np.asarray(scipy.linalg.block_diag(*zeros[:i], direction, *zeros[i + 1 :]))
            for i, group in enumerate(directions)
            for direction in group
        ]
    )
    return ClassicalForm(V, V.T @ V, basis, np.linalg.solve(V.T, (start @ basis).T))
