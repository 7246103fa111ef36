"""Least squares beside a linear matrix inequality."""

import cvxpy as cp
import numpy as np
import pytest

from robustid.passivity.least_change import least_change, packed, slopes_of


@pytest.mark.parametrize("reach", [0.3, 30.0])
def test_the_minimum_is_that_of_a_modelling_layer(reach):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        size, d = 2, 3
        parts, start = rng.standard_normal((size**2, d, d)), -np.eye(d)
        parts = parts + parts.transpose(0, 2, 1)
        rows = rng.standard_normal((6, size**2 + 1))

        def block(unit, parts=parts, start=start):
            return start + np.tensordot(unit.ravel(), parts, 1)

        found = least_change(rows, start, slopes_of(block, size), reach)
        x = cp.Variable(size**2)
        inside = [start + sum(x[i] * parts[i] for i in range(size**2)) << 0, cp.norm(x) <= reach]
        least = cp.Problem(cp.Minimize(cp.norm(rows[:, :-1] @ x - rows[:, -1])), inside).solve(solver=cp.CLARABEL)
        assert np.linalg.norm(rows[:, :-1] @ found - rows[:, -1]) == pytest.approx(least, rel=1e-6)
        np.testing.assert_allclose(found, x.value, atol=1e-3)
        assert np.linalg.eigvalsh(start + np.tensordot(found, parts, 1))[-1] < 1e-7
        assert np.linalg.norm(found) < reach * (1 + 1e-7)


def test_what_no_change_satisfies_is_none():
    slopes = slopes_of(lambda unit: np.zeros((2, 2)), 1)
    assert least_change(np.array([[1.0, 1.0]]), np.eye(2), slopes, 1.0) is None


def test_packed_matrices_keep_the_inner_product():
    rng = np.random.default_rng(0)
    A, B = (part + part.T for part in rng.standard_normal((2, 4, 4)))
    assert packed(A) @ packed(B) == pytest.approx(np.trace(A @ B))
