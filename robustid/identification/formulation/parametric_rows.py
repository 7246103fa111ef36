"""The measurement equations of the parametric part alone: which of its functions the data tell apart, and what each does."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Numbers, Real, decoupled_parts, lengths, singular_parts
from robustid.identification.formulation.functions import Functions
from robustid.identification.formulation.rows import experiment_blocks
from robustid.identification.problem import MixedProblem

_RANK = 1e-9  # stricter than what a class is refused for, whose bounds of a free record depend on its gain
_PART = 0.1  # of the largest part in a dependence, from which a function takes part in it


class ToldApart(NamedTuple):
    """Functions of a parametric part as the data tell them apart."""

    # (m,) bool; functions that take part in a linear dependence on the samples, or act on none
    dependent: NDArray[np.bool_]
    complete: bool  # True where the data tell all of them, and the transients, apart
    # (N, m); values of each at the samples, in units of the bounds, in the shortest least-squares fit; over all
    # entries
    parts: Real


@dataclasses.dataclass(frozen=True)
class _None(Functions):
    """No functions beside the parametric ones."""

    problem: MixedProblem

    @property
    def count(self) -> int:
        return 0

    def responses(self, angles: NDArray[np.float64]) -> Numbers:
        return np.zeros((angles.size, 0), complex)

    def time_responses(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.zeros((u.size, 0))


def told_apart_functions(problem: MixedProblem) -> ToldApart:
    """The functions of the parametric part of a problem, as its samples see them beside the transients of its records."""
    blocks, size = experiment_blocks(_None(problem)), 0 if problem.parametric is None else problem.parametric.size
    free = scipy.linalg.block_diag(*(b.free for b in blocks))
    P = np.hstack([np.vstack([b.P for b in blocks]), free])
    y = np.concatenate([b.y for b in blocks])
    stacked, right = (np.concatenate([np.real(a), np.imag(a)]) for a in (P, y))
    size_of = lengths(stacked)
    own = size * problem.entries.count
    silent = ~np.any(stacked, axis=0)
    if not stacked.shape[1]:
        return ToldApart(np.zeros(0, bool), True, np.zeros((right.size, 0)))
    stacked = stacked / size_of
    best, unseen, rank = np.zeros(stacked.shape[1]), np.ones(stacked.shape[1]), 0
    parts = [(at, columns, *singular_parts(stacked[np.ix_(at, columns)])) for at, columns in decoupled_parts(stacked)]
    least = _RANK * max(singular.max(initial=0.0) for _, _, _, singular, _ in parts)
    for at, columns, left, singular, rows in parts:
        seen = singular > least
        best[columns] = rows[seen].T @ ((left[:, seen].T @ right[at]) / singular[seen])
        # Part of every unknown that lies in the dependences: the diagonal of the projection on them.
        unseen[columns] = np.sqrt(np.maximum(1 - np.sum(rows[seen] ** 2, axis=0), 0.0))
        rank += int(seen.sum())
    complete = rank == stacked.shape[1]
    involved = silent | (unseen > _PART * unseen.max()) if not complete else silent
    by_function = involved[:own].reshape(-1, size).any(axis=0) if size else np.zeros(0, bool)
    values = (stacked * best)[:, :own].reshape(right.size, -1, size).sum(axis=1) if size else np.zeros((right.size, 0))
    return ToldApart(by_function, complete, values)
