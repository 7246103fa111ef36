"""Damped least-squares steps: the normal equations they solve, the radius they keep, the directions they leave alone."""

import numpy as np
import pytest
import scipy.linalg

from robustid.core import DampedSteps, balancing, lengths, singular_parts

pytestmark = pytest.mark.quick


@pytest.fixture
def problem():
    rng = np.random.default_rng(0)
    return rng.standard_normal((9, 4)), rng.standard_normal(9)


@pytest.mark.parametrize("damping", [0.0, 1e-3, 1.0, 1e3])
def test_a_step_solves_the_damped_normal_equations(problem, damping):
    J, r = problem
    d = DampedSteps.of(J, r).step(damping)
    np.testing.assert_allclose((J.T @ J + damping * np.eye(4)) @ d, J.T @ r, atol=1e-12 * (1 + damping))


def test_a_step_within_a_radius_is_the_best_one_there(problem):
    J, r = problem
    steps = DampedSteps.of(J, r)
    free = steps.step(0.0)
    np.testing.assert_array_equal(steps.within(2 * np.linalg.norm(free)), free)
    radius = 0.3 * float(np.linalg.norm(free))
    best = steps.within(radius)
    assert np.linalg.norm(best) == pytest.approx(radius, rel=1e-6)
    turn = np.random.default_rng(1).standard_normal((200, 4))
    others = radius * turn / np.linalg.norm(turn, axis=1, keepdims=True)
    assert np.all(np.linalg.norm(J @ best - r) <= np.linalg.norm(others @ J.T - r, axis=1))


def test_directions_that_are_not_seen_are_not_moved_along(problem):
    J, r = problem
    J = J * np.array([1.0, 1.0, 1.0, 1e-14])
    assert abs(DampedSteps.of(J, r, 1e-12).within(np.inf)[3]) < 1e-9
    assert abs(DampedSteps.of(J, r).within(np.inf)[3]) > 1.0


def test_lengths_are_norms_but_never_zero():
    matrix = np.array([[3.0, 0.0, 1j], [4.0, 0.0, 0.0]])
    assert np.array_equal(lengths(matrix), [5.0, 1.0, 1.0])
    assert np.array_equal(lengths(matrix[:, 1:2], axis=1), [1.0, 1.0])
    assert lengths(matrix, axis=1, keepdims=True).shape == (2, 1)


# --- balancing


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


def test_a_decomposition_that_the_faster_method_cannot_find_is_found(monkeypatch):
    """The driver by divide and conquer fails on rare matrices of finite numbers; the parts are the same up to signs."""
    A = np.random.default_rng(0).standard_normal((7, 4))

    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    wanted = np.linalg.svd(A, compute_uv=False)
    with monkeypatch.context() as patch:
        patch.setattr(np.linalg, "svd", fails)
        left, sizes, directions = singular_parts(A)
    np.testing.assert_allclose(sizes, wanted, rtol=1e-12)
    np.testing.assert_allclose(left * sizes @ directions, A, atol=1e-12)
