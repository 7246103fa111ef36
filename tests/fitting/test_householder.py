"""QR factorisations of tall matrices against NumPy's."""

import numpy as np
import pytest

from robustid.fitting.fraction.householder import orthonormal, triangle, triangle_inverse


@pytest.mark.parametrize("shape", [(3, 200, 40), (1, 2500, 33), (2, 5, 8), (1, 7, 1), (1, 4, 0)])
def test_the_factors_are_those_of_numpy(shape):
    stack = np.random.default_rng(0).standard_normal(shape)
    Q, R = orthonormal(stack)
    for matrix, basis, upper in zip(stack, Q, R, strict=True):
        wanted_basis, wanted_upper = np.linalg.qr(matrix)
        np.testing.assert_allclose(basis, wanted_basis, atol=1e-13)
        np.testing.assert_allclose(upper, wanted_upper, atol=1e-12)


def test_columns_that_depend_on_each_other_leave_an_orthonormal_basis():
    matrix = np.random.default_rng(1).standard_normal((1, 300, 6))
    matrix[0, :, 4] = matrix[0, :, 0] - matrix[0, :, 2]
    matrix[0, :, 5] = 0
    Q, R = orthonormal(matrix)
    np.testing.assert_allclose(Q[0].T @ Q[0], np.eye(6), atol=1e-14)
    np.testing.assert_allclose(Q @ R, matrix, atol=1e-13)


@pytest.mark.parametrize("rows", [3, 900, 9500])
def test_the_triangle_of_chunks_has_the_gram_matrix_of_all_rows(rows):
    matrix = np.random.default_rng(2).standard_normal((rows, 20)) * np.logspace(0, 5, 20)
    upper = triangle(matrix)
    assert np.array_equal(upper, np.triu(upper))
    size = np.linalg.norm(matrix, axis=0)
    np.testing.assert_allclose((upper / size).T @ (upper / size), (matrix / size).T @ (matrix / size), atol=1e-13)


def test_the_inverse_of_a_triangle():
    upper = np.triu(np.random.default_rng(3).standard_normal((9, 9))) + 4 * np.eye(9)
    np.testing.assert_allclose(triangle_inverse(upper) @ upper, np.eye(9), atol=1e-14)
