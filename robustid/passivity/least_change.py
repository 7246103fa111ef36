"""Least squares under a linear matrix inequality, posed to the solver of cones as it is: a layer between takes longer than it."""

from __future__ import annotations

from collections.abc import Callable

import clarabel
import numpy as np
import scipy.sparse

from robustid.core import Real


def least_change(rows: Real, block: Real, slopes: scipy.sparse.csc_matrix, reach: float) -> Real | None:
    """The x of the least ``|R x - r|``, rows [R, r], with ``|x| <= reach``, where ``block + sum x_i slopes_i`` is negative
    semidefinite. Columns of `slopes` are such matrices as `packed` has them; None where the solver finds nothing.
    """
    count, small, sparse = slopes.shape[1], len(rows), scipy.sparse.csc_matrix
    first = sparse(([-1.0], ([0], [count])), shape=(1, count + 1))  # the cost
    held = scipy.sparse.vstack([sparse(-rows[:, :-1]), sparse((1, count)), -scipy.sparse.eye(count), slopes])
    matrix = sparse(scipy.sparse.vstack([first, scipy.sparse.hstack([held, sparse((held.shape[0], 1))])]))
    constant = np.concatenate([[0.0], -rows[:, -1], [reach], np.zeros(count), -packed(block)])
    cones = [
        clarabel.SecondOrderConeT(small + 1),
        clarabel.SecondOrderConeT(count + 1),
        clarabel.PSDTriangleConeT(len(block)),
    ]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    goal = np.append(np.zeros(count), 1.0)
    solution = clarabel.DefaultSolver(sparse((count + 1, count + 1)), goal, matrix, constant, cones, settings).solve()
    found = np.asarray(solution.x, dtype=float)
    solved = str(solution.status) in ("Solved", "AlmostSolved")
    return found[:count] if solved and np.all(np.isfinite(found)) else None


def packed(matrix: Real) -> Real:
    """The upper triangle of a symmetric matrix by columns, times sqrt(2) beside the diagonal."""
    columns, rows = np.tril_indices(len(matrix))
    return matrix[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2))


def slopes_of(block: Callable[[Real], Real], size: int) -> scipy.sparse.csc_matrix:
    """Derivatives of a block, affine in a matrix (size, size), by its entries, row by row: packed, (rows, size^2)."""
    rest = block(np.zeros((size, size)))
    units = np.eye(size**2).reshape(-1, size, size)
    return scipy.sparse.csc_matrix(np.column_stack([packed(block(unit) - rest) for unit in units]))
