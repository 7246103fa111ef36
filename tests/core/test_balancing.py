"""The square-root method for any factors: Gramians diagonal and equal, projections that belong together."""

import numpy as np
import pytest
import scipy.linalg

from robustid.core import balancing

pytestmark = pytest.mark.quick


def test_balanced_coordinates_of_any_factors():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((6, 6))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(6)
    B, C = rng.standard_normal((6, 2)), rng.standard_normal((3, 6))
    reached = scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)
    seen = scipy.linalg.solve_continuous_lyapunov(A.T, -C.T @ C)
    turn = np.linalg.qr(rng.standard_normal((9, 9)))[0][:6]  # factors of any number of columns
    found = balancing(np.linalg.cholesky(seen), np.linalg.cholesky(reached) @ turn)
    np.testing.assert_allclose(found.hankel**2, np.sort(np.linalg.eigvals(reached @ seen).real)[::-1], rtol=1e-9)
    into, onto = found.projections(6)
    np.testing.assert_allclose(onto @ into, np.eye(6), atol=1e-10)
    a, b, c = found.truncated(A, B, C, 6)
    for left, right in ((a, -b @ b.T), (a.T, -c.T @ c)):
        gramian = scipy.linalg.solve_continuous_lyapunov(left, right)
        np.testing.assert_allclose(gramian, np.diag(found.hankel), atol=1e-9 * found.hankel[0])
    left, right = found.coordinates(2)
    np.testing.assert_allclose(left.T @ right, np.diag(found.hankel[:2]), atol=1e-12 * found.hankel[0])


def test_factors_without_columns_have_no_state():
    found = balancing(np.zeros((3, 0)), np.zeros((3, 0)))
    assert found.hankel.size == 0
    assert found.truncated(np.eye(3), np.ones((3, 1)), np.ones((1, 3)), 0)[0].shape == (0, 0)
