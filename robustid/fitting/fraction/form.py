"""Forms of a fraction: the right fraction that is fitted, and the response of the data, from one to the other.

A left fraction D^{-1} N is the right fraction of the transposed response. Poles that all entries share, with free residues,
are the right fraction of the response as one column: a scalar denominator, and a numerator for every entry.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import StateMatrices
from robustid.errors import InputError
from robustid.fitting.state_space.state_fit import diagonal_blocks

if TYPE_CHECKING:
    from robustid.fitting.fraction.constraints import Constraint
    from robustid.fitting.fraction.problem import FractionProblem

FORMS = ("right", "left", "shared")
_SAME_POLE = 1e-6  # poles of a start that differ by this part of their size are one


def checked(form: Any) -> str:
    """Return the form, or say which there are."""
    if form not in FORMS:
        raise InputError(f'`form` must be "right", "left" or "shared"; got {form!r}')
    return str(form)


def fitted(array: np.ndarray, form: str) -> np.ndarray:
    """Entries of the data (F, ny, nu) as those of the right fraction that is fitted; (i, j) in row i*nu + j of a column."""
    if form == "left":
        return array.transpose(0, 2, 1)
    return array.reshape(len(array), -1, 1) if form == "shared" else array


def oriented(array: np.ndarray, form: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Entries of the right fraction that is fitted as those of the data; `shape` is their (ny, nu) where poles are shared."""
    if form == "left":
        return array.transpose(0, 2, 1)
    return array.reshape(len(array), *shape) if form == "shared" and shape else array


def problem_of(problem: FractionProblem, form: str) -> FractionProblem:
    """The problem of the right fraction that is fitted."""
    if form == "left":
        return problem.transposed()
    return problem.stacked() if form == "shared" else problem


def constraint_of(constraint: Constraint, form: str, shape: tuple[int, ...]) -> Constraint:
    """The constraint on the right fraction that is fitted; `shape` is (ny, nu) of the data."""
    if form == "left":
        return constraint.transposed()
    return constraint.stacked(shape) if form == "shared" else constraint


def shared_model(column: StateMatrices, shape: tuple[int, int]) -> StateMatrices:
    """State space of a response from that of its column: a copy of the poles for every signal of the smaller side."""
    ny, nu = shape
    entries = column.C.reshape(ny, nu, -1)
    D, n = column.D.reshape(ny, nu), len(column.A)
    if nu <= ny:
        copies, b = (diagonal_blocks(*[part] * nu) for part in column[:2])
        return StateMatrices(copies, b, entries.reshape(ny, nu * n), D)
    copies, c = (diagonal_blocks(*[part.T] * ny) for part in column[:2])
    return StateMatrices(copies, entries.transpose(0, 2, 1).reshape(ny * n, nu), c, D)


def states_of_poles(poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and B of one input that drives these poles; those that are told twice, or with their conjugates, count once."""
    blocks: list[np.ndarray] = []
    known: list[complex] = []
    for pole in sorted((complex(pole.real, abs(pole.imag)) for pole in poles), key=abs):
        if not any(abs(pole - other) <= _SAME_POLE * abs(pole) for other in known):
            known.append(pole)
            a, w = pole.real, pole.imag
            blocks.append(np.array([[a, w], [-w, a]]) if w else np.array([[a]]))
    A = diagonal_blocks(*blocks)
    return A, np.ones((len(A), 1))
