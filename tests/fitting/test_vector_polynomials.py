"""Orthonormal vector polynomials against monomials and least squares, at sizes where monomials still work."""

import numpy as np
import pytest

from robustid.errors import InputError
from robustid.fitting import orthonormal_polynomials, polynomial_nodes
from robustid.fitting.fraction.householder import orthonormal, triangle, triangle_inverse
from robustid.fitting.fraction.krylov_blocks import block_layout
from support.pairwise import every_one

pytestmark = pytest.mark.quick
PATTERNS = [[4, 4, 3], [5, 5, 5, 5], [1, 0, -1], [0, 0, 0], [3, 2, 2, 1], [2, 3, 3]]


def problem(seed, limits, dt, lines=60, rows=2):
    rng = np.random.default_rng(seed)
    xi, _ = polynomial_nodes(np.sort(rng.uniform(1, 300, lines)), dt)
    shape = (lines, rows, len(limits))
    return rng, xi, rng.normal(size=shape) + 1j * rng.normal(size=shape)


def on_data(columns, polynomial):
    """M_k x(xi_k), real parts above imaginary parts."""
    flat = np.einsum("krb,kb->kr", columns, polynomial).ravel()
    return np.concatenate([flat.real, flat.imag])


def monomials(xi, limits):
    for component, limit in enumerate(limits):
        for degree in range(limit + 1):
            one = np.zeros((xi.size, len(limits)), complex)
            one[:, component] = xi**degree
            yield one


@pytest.mark.parametrize(("limits", "dt"), every_one(PATTERNS, [None, 0.01]))
def test_orthonormal_in_the_right_span_and_evaluated_anywhere(limits, dt):
    rng, xi, columns = problem(0, limits, dt)
    basis = orthonormal_polynomials(columns, xi, limits)
    assert basis.size == sum(limit + 1 for limit in limits)
    assert basis.condition - 1 <= 1e-13
    np.testing.assert_allclose(basis.values.T @ basis.values, np.eye(basis.size), atol=1e-13)
    # monomials of the limits are reproduced on the data, and as polynomials at points off the nodes
    points = rng.normal(size=7) + 1j * rng.normal(size=7)
    for there, elsewhere in zip(monomials(xi, limits), monomials(points, limits), strict=True):
        x = on_data(columns, there)
        coordinates = basis.project(x)
        np.testing.assert_allclose(basis.values @ coordinates, x, atol=1e-10)
        np.testing.assert_allclose(basis.evaluate(points, coordinates), elsewhere, atol=1e-6)
        np.testing.assert_allclose(basis.polynomials(points) @ coordinates, elsewhere, atol=1e-6)


@pytest.mark.parametrize(("limits", "dt"), every_one(PATTERNS, [None, 0.01]))
def test_monic_minimum_is_the_least_squares_solution(limits, dt):
    for seed in range(10):
        rng, xi, columns = problem(seed, limits, dt)
        coefficients = rng.normal(size=len(limits))
        leading = xi[:, None] ** (np.array(limits) + 1) * coefficients
        free = np.array([on_data(columns, one) for one in monomials(xi, limits)]).T
        wanted = on_data(columns, leading)
        wanted = wanted - free @ np.linalg.lstsq(free, wanted, rcond=None)[0]
        basis = orthonormal_polynomials(columns, xi, limits)
        found = basis.monic(coefficients)
        assert found.length == pytest.approx(np.linalg.norm(wanted), rel=1e-10)
        values = basis.evaluate(xi, found.coordinates, found.shifted, found.constant)
        np.testing.assert_allclose(on_data(columns, values), wanted, atol=1e-10 * np.linalg.norm(wanted))


def test_condition_stays_one_where_monomials_are_hopeless():
    omega = np.geomspace(1, 1e4, 400)
    xi, _ = polynomial_nodes(omega, None)
    rng = np.random.default_rng(1)
    modes = 1 / (xi[:, None] ** 2 + 0.01 * xi[:, None] + rng.uniform(0, 0.3, 12) ** 2)
    noise = 1 + 0.01 * (rng.normal(size=omega.size) + 1j * rng.normal(size=omega.size))
    columns = np.stack([modes.sum(axis=1) * noise, -np.ones(omega.size)], axis=1)[:, None, :]
    limits = [40, 40]
    free = np.array([on_data(columns, one) for one in monomials(xi, limits)]).T
    assert np.linalg.cond(free / np.linalg.norm(free, axis=0)) > 1e13
    basis = orthonormal_polynomials(columns, xi, limits)
    assert basis.condition - 1 <= 1e-12
    pick = np.eye(basis.size)[[0, 30, basis.size - 1]]
    for one in pick:  # Clenshaw's recursion returns what the process built, to rounding of the polynomial itself
        polynomial = basis.evaluate(xi, one)
        size = np.abs(columns[:, 0] * polynomial).max()
        np.testing.assert_allclose(on_data(columns, polynomial), basis.values @ one, rtol=0, atol=1e-13 * size)


@pytest.mark.parametrize("dt", [None, 0.01])
def test_an_exact_fit_is_deflated(dt):
    xi, _ = polynomial_nodes(np.linspace(1, 200, 80), dt)
    denominator = (xi + 0.5) * (xi**2 - 0.3 * xi + 0.4)
    columns = np.stack([1 / denominator, -np.ones(xi.size)], axis=1)[:, None, :]  # d/denominator = n: degree 3 fits
    basis = orthonormal_polynomials(columns, xi, [6, 6])
    assert basis.null.sum() == 4  # degrees 3, 4, 5, 6 of the second component
    assert basis.condition - 1 <= 1e-12
    null = np.flatnonzero(basis.null)[0]
    values = basis.evaluate(xi, np.eye(basis.size)[null])
    assert np.abs(on_data(columns, values)).max() <= 1e-10 * np.abs(values).max()
    ratio = values[:, 0] / values[:, 1]
    np.testing.assert_allclose(ratio, denominator, rtol=1e-9)


@pytest.mark.parametrize("power", [-60, 60])
def test_units_scale_exactly(power):
    limits = [5, 5, 4]
    _, xi, columns = problem(3, limits, None)
    factor = 2.0**power
    plain = orthonormal_polynomials(columns, xi, limits)
    scaled = orthonormal_polynomials(columns * np.array([factor, 1.0, 1.0]), xi, limits)
    np.testing.assert_array_equal(scaled.values, plain.values)
    nodes, unit = polynomial_nodes(factor * np.array([1.0, 6.0]), None)
    np.testing.assert_array_equal(nodes, [0.125j, 0.75j])
    assert unit == 8 * factor


def test_components_of_the_largest_limits_come_first_and_all_end_in_the_last_block():
    assert [(block.here, block.fresh.tolist()) for block in block_layout(np.array([1, 2, -1, 2]))] == [
        (slice(0, 2), [1, 3]),
        (slice(2, 5), [0]),
        (slice(5, 8), []),
    ]


def test_bad_input_is_named():
    _, xi, columns = problem(0, [1, 1], None)
    with pytest.raises(InputError, match="241 coefficients where the data give 240"):
        orthonormal_polynomials(columns, xi, [120, 119])
    with pytest.raises(InputError, match=r"`columns` must have shape \(F, r, b\)"):
        orthonormal_polynomials(columns, xi[1:], [1, 1])
    columns[3, 0, 1] = np.nan
    with pytest.raises(InputError, match="`columns` must be finite"):
        orthonormal_polynomials(columns, xi, [1, 1])


# --- factorisations of tall matrices


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
