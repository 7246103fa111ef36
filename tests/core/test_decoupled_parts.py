"""Parts of a matrix that have no row in common."""

import numpy as np

from robustid.core import decoupled_fit, decoupled_parts, decoupled_qr


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


def test_factors_and_fits_part_by_part_are_those_of_the_whole():
    """R is unique but for signs; Q has exact zeros where a column has none of the rows; a part of too few rows is left whole."""
    rng, matrix = np.random.default_rng(1), np.zeros((12, 5))
    for rows, columns in (([0, 4, 7, 11], [1, 4]), ([1, 2, 9], [0]), ([3, 5, 6, 8], [2, 3])):
        matrix[np.ix_(rows, columns)] = rng.standard_normal((len(rows), len(columns)))
    Q, R = decoupled_qr(matrix)
    np.testing.assert_allclose(Q @ R, matrix, atol=1e-14)
    np.testing.assert_allclose(Q.T @ Q, np.eye(5), atol=1e-14)
    assert np.array_equal(R, np.triu(R))
    np.testing.assert_allclose(np.abs(R), np.abs(np.linalg.qr(matrix)[1]), atol=1e-14)
    assert not Q[1, 1:].any()
    values = rng.standard_normal(12)
    np.testing.assert_allclose(
        decoupled_fit(matrix, values), np.linalg.lstsq(matrix, values, rcond=None)[0], atol=1e-14
    )
    few = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    np.testing.assert_allclose(np.matmul(*decoupled_qr(few)), few, atol=1e-14)
