"""Parts of a matrix that have no row in common."""

import numpy as np

from robustid.core import decoupled_parts


def test_parts_put_together_are_the_matrix_and_cannot_be_split():
    rng = np.random.default_rng(0)
    matrix = np.zeros((9, 6))
    blocks = [([0, 4, 7], [1, 5]), ([1, 2], [0]), ([3, 5, 6, 8], [2, 4])]
    for rows, columns in blocks:
        matrix[np.ix_(rows, columns)] = rng.standard_normal((len(rows), len(columns)))
    found = sorted((rows.tolist(), columns.tolist()) for rows, columns in decoupled_parts(matrix))
    assert found == [([], [3]), *sorted(blocks)]  # a column of zeros is in no row


def test_a_chain_of_rows_is_one_part():
    ((rows, columns),) = decoupled_parts(np.eye(4) + np.eye(4, k=1))
    assert (rows.tolist(), columns.tolist()) == ([0, 1, 2, 3], [0, 1, 2, 3])
