"""Evaluation of state spaces against a dense solution for every point, and simulation against the impulse response."""

import control
import mpmath
import numpy as np
import pytest

from robustid import core

pytestmark = pytest.mark.quick


def random_system(seed, states, outputs=2, inputs=3, radius=0.95):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((states, states))
    A *= radius / np.abs(np.linalg.eigvals(A)).max(initial=1e-3)
    shapes = (states, inputs), (outputs, states), (outputs, inputs)
    return A, *(rng.standard_normal(shape) for shape in shapes)


def dense(system, point):
    A, B, C, D = system
    return C @ np.linalg.solve(point * np.eye(len(A)) - A, B) + D


@pytest.mark.parametrize("states", [0, 1, 7])
def test_every_convention_is_the_dense_solution(states):
    system = random_system(0, states)
    angles = np.linspace(0, np.pi, 600)  # more than a block
    points = np.exp(1j * angles)
    exact = np.array([dense(system, point) for point in points])
    model = control.ss(*system, 0.1) if states else control.ss([], [], [], system[3], 0.1)
    for values in (core.response_at(system, points), core.series_at(system, 1 / points), core.responses(model, angles)):
        assert values.shape == (600, 2, 3)
        np.testing.assert_allclose(values, exact, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(core.series_at(system, 0.0)[0], system[3])  # z = infinity
    poles = core.Response(system).poles
    assert all(np.abs(poles - pole).min() < 1e-12 for pole in np.linalg.eigvals(system[0]))


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 1), (2, 2), (2, 3)])
def test_norms_are_largest_singular_values_of_any_size(shape):
    rng = np.random.default_rng(0)
    matrices = rng.standard_normal((60, *shape)) + 1j * rng.standard_normal((60, *shape))
    some = [matrices, matrices.real, matrices * 10.0 ** rng.uniform(-200, 200, (60, 1, 1)), np.zeros((2, *shape))]
    left, _, right = np.linalg.svd(matrices, full_matrices=False)
    some += [left[:, :, :1] @ right[:, :1], left @ right]  # of rank one, and with equal singular values
    for each in some:
        exact = [np.linalg.svd(one, compute_uv=False)[0] for one in each]
        np.testing.assert_allclose(core.norms(each), exact, rtol=1e-14)


def test_a_factorisation_a_point_keeps_repeated_light_poles():
    """Against 40 digits, at and beside the resonance of a double pair."""
    a, turn = np.exp((-1e-4 + 1j) * 0.3), 0.3
    block = np.array([[a.real, a.imag], [-a.imag, a.real]])
    A = np.block([[block, np.eye(2)], [np.zeros((2, 2)), block]])
    B, points = np.array([[0.0], [0.0], [1.0], [0.0]]), np.exp(1j * np.array([turn, turn + 1e-5, 1.0]))
    with mpmath.workdps(40):
        pencils = [mpmath.mpc(z) * mpmath.eye(4) - mpmath.matrix(A.tolist()) for z in points]
        exact = [mpmath.lu_solve(pencil, mpmath.matrix(B)) for pencil in pencils]
    exact = np.array([[complex(x) for x in one] for one in exact])
    system = A, B, np.eye(4), np.zeros((4, 1))
    for values, wanted in ((core.input_states(A, B, points), 3e-12), (core.response_at(system, points), 1e-9)):
        error = np.abs(values[..., 0] - exact).max(axis=1) / np.abs(exact).max(axis=1)
        assert error.max() < wanted
    scaled = points[:, None, None] * core.input_states(A, B, points)
    np.testing.assert_allclose(core.input_states(A, B, np.ones(3), 1 / points), scaled)


def test_the_transposed_state_space_has_the_transposed_response():
    system = core.StateMatrices(*random_system(3, 4))
    transposed = core.response_at(system.transposed(), [1.5, 0.3j])
    np.testing.assert_allclose(transposed, core.response_at(system, [1.5, 0.3j]).transpose(0, 2, 1), rtol=1e-12)


def test_points_are_those_of_the_axis_or_of_the_circle():
    omega = np.array([0.0, 2.0])
    assert np.array_equal(core.points_of(omega, None), [0, 2j])
    assert np.array_equal(core.points_of(omega, 0), [0, 2j])
    np.testing.assert_allclose(core.points_of(omega, np.pi / 4), [1, 1j], atol=1e-15)


def test_a_pole_gives_no_finite_value_and_a_chain_of_integrators_keeps_its_digits():
    chain = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    values = core.response_at(chain, [0.0, 1e-6j, 2.0])[:, 0, 0]
    assert not np.isfinite(values[0])
    np.testing.assert_allclose(values[1:], [-1e12, 0.25], rtol=1e-14)


def test_scales_are_powers_of_two_and_change_no_response():
    A, B, C, D = random_system(1, 5)
    units = 2.0 ** np.array([-20, 0, 9, 30, -7])
    a, b, c = core.scaled_states(units[:, None] * A / units, units[:, None] * B, C / units)
    assert np.linalg.norm(a) < 10 * np.linalg.norm(A)
    points = np.exp(1j * np.linspace(0, np.pi, 20))
    np.testing.assert_allclose(
        core.response_at((a, b, c, D), points), core.response_at((A, B, C, D), points), rtol=1e-11
    )


def test_a_simulation_is_the_convolution_and_goes_on_from_its_end():
    system = random_system(2, 4)
    model, u = control.ss(*system, 1.0), np.random.default_rng(3).standard_normal((30, 3))
    A, B, C, D = core.StateMatrices.of(model)
    pulses = [D, *(C @ np.linalg.matrix_power(A, k) @ B for k in range(29))]
    y, end = core.simulate(model, u)
    np.testing.assert_allclose(y, [sum(pulses[k - j] @ u[j] for j in range(k + 1)) for k in range(30)], atol=1e-11)
    first, middle = core.simulate(model, u[:12])
    second, last = core.simulate(model, u[12:], middle)
    np.testing.assert_array_equal(np.vstack([first, second]), y)
    np.testing.assert_array_equal(last, end)
