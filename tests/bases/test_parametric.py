"""Parametric bases: impulse responses, free responses, refusals."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.bases import as_basis, input_normal_pair, solve_stein
from robustid.core import ZPlane
from support.pairwise import every_one
from support.refusals import refusals

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(("delay", "repeat"), every_one([0, 1, 3], [1, 2, 3]))
def test_kautz_spans_the_impulse_responses_of_its_pole(delay, repeat):
    omega, damping, dt = 2 * np.pi * 8, 0.03, 0.01
    basis = rid.kautz(omega, damping, dt=dt, repeat=repeat, delay=delay)
    a = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * omega * dt)
    k = np.arange(3000)
    impulse = basis.impulse(3000 + delay)
    assert np.all(impulse[:delay] == 0)
    assert np.abs(np.linalg.norm(impulse, axis=0) - 1).max() < 1e-9
    span = impulse[delay:]
    for j in range(repeat):
        for part in (np.real, np.imag):
            target = part(k**j * a**k)
            fit = np.linalg.lstsq(span, target, rcond=None)[0]
            assert np.linalg.norm(span @ fit - target) < 1e-8 * np.linalg.norm(target)
    angles = np.linspace(0.1, 3, 20)
    direct = np.exp(-1j * np.outer(angles, np.arange(3000 + delay))) @ impulse
    assert np.abs(basis.response(angles) - direct).max() < 1e-8 * np.abs(direct).max()


def test_zero_order_hold_mode_needs_the_delayed_pair():
    omega, damping, dt = 2 * np.pi * 17.67, 0.004, 0.01
    mode = control.c2d(control.ss([[0, 1], [-(omega**2), -2 * damping * omega]], [[0], [1]], [[1, 0]], 0), dt)
    f = np.asarray(control.impulse_response(mode, np.arange(500) * dt).outputs)
    left = {}
    for delay in (0, 1):
        span = rid.kautz(omega, damping, dt=dt, delay=delay).impulse(500)
        left[delay] = np.linalg.norm(f - span @ np.linalg.lstsq(span, f, rcond=None)[0]) / np.linalg.norm(f)
    assert left[1] < 1e-12
    assert left[0] > 1e-3


def test_a_statespace_basis_keeps_its_outputs_and_integrator():
    rigid = control.ss([[1, 0.01], [0, 1]], [[0.5e-4], [0.01]], [[1, 0]], [[0]], 0.01)
    basis = as_basis([rigid, rid.kautz(50.0, 0.01, dt=0.01)], ZPlane(0.01))
    assert (basis.size, basis.states) == (3, 4)
    assert basis.has_integrator
    z = np.exp(0.3j)
    assert abs(basis.response(np.array([0.3]))[0, 0] - rigid(z)) < 1e-12


def test_transients_span_every_free_response():
    basis = rid.kautz([40.0, 90.0], 0.02, dt=0.01)
    columns = basis.transients(60)
    assert columns.shape == (60, 4)
    state = np.random.default_rng(0).standard_normal(4)
    free = np.array([basis.C[0] @ np.linalg.matrix_power(basis.A, k) @ state for k in range(60)])
    assert np.linalg.norm(free - columns @ (columns.T @ free)) < 1e-10 * np.linalg.norm(free)


test_kautz_refuses_by_name = refusals(
    ({"omega": 100.0, "damping": 0.0}, "damping"),
    ({"omega": 100.0, "damping": 1.2}, "damping"),
    ({"omega": 400.0, "damping": 0.01}, "pi/dt"),
    ({"omega": -1.0, "damping": 0.01}, "omega"),
    ({"omega": [1.0, 2.0, 3.0], "damping": [0.1, 0.2]}, "same length"),
    ({"omega": 10.0, "damping": 0.1, "repeat": 0}, "repeat"),
    ({"omega": 10.0, "damping": 0.1, "delay": -1}, "delay"),
    ({"omega": np.nan, "damping": 0.1}, "finite"),
    of=functools.partial(rid.kautz, dt=0.01),
)

test_parametric_bases_are_checked = refusals(
    (control.ss([[1.2]], [[1]], [[1]], [[0]], 0.01), "inside the unit circle"),
    (control.ss([[-1.0]], [[1]], [[1]], [[0]], 0.01), "inside the unit circle"),
    (control.ss([[0.5]], [[1]], [[1]], [[0]], 0.02), "dt"),
    (control.ss([[-0.5]], [[1]], [[1]], [[0]]), "discrete"),
    (control.ss([[0.5]], [[1, 1]], [[1]], [[0, 0]], 0.01), "one input"),
    ([], "empty"),
    ("kautz", "StateSpace", rid.errors.InputTypeError),
    of=lambda basis: as_basis(basis, ZPlane(0.01)),
)

test_integrators_are_counted = refusals((lambda: rid.integrators(0, dt=0.1), "`count`"))


def test_damping_one_is_a_single_real_pole():
    basis = rid.kautz([30.0, 50.0], [1.0, 0.1], dt=0.01, delay=1)
    assert basis.size == 3
    assert basis.poles[0] == pytest.approx(np.exp(-0.3), rel=1e-15)
    impulse = basis.impulse(40)[:, 0]
    np.testing.assert_allclose(impulse[2:], np.exp(-0.3) * impulse[1:-1], rtol=1e-12)
    assert np.sum(basis.impulse(4000)[:, 0] ** 2) == pytest.approx(1.0, rel=1e-12)


def test_integrators_span_the_sampled_rigid_body():
    z = np.exp(1j * np.array([0.1, 1.0, 3.0]))
    columns = rid.integrators(2, dt=0.1).response([0.1, 1.0, 3.0])
    np.testing.assert_allclose(columns, np.stack([1 / (z - 1), 1 / (z - 1) ** 2], axis=1), rtol=1e-12)
    assert rid.integrators(dt=0.1).has_integrator


# --- input-normal pairs


@pytest.mark.parametrize("layout", ["spread", "clustered", "near the ends"])
def test_input_normal_pair_of_160_states_is_orthonormal(layout):
    rng = np.random.default_rng(0)
    angles = {
        "spread": np.linspace(0, np.pi, 62),
        "clustered": np.concatenate([[0.0, np.pi], 1.0 + 1e-9 * np.arange(60)]),
        "near the ends": np.concatenate([[0.0, np.pi], 10.0 ** rng.uniform(-12, 0, 60)]),
    }[layout]
    pair = input_normal_pair(angles, 1 / 1.001, taylor=38)
    assert pair.order == 160
    assert np.abs(pair.A.T @ pair.A + pair.c.T @ pair.c - np.eye(160)).max() < 1e-13
    T = pair.symmetry()
    assert np.abs(T @ T - np.eye(160)).max() < 1e-11
    assert np.abs(pair.A.T @ T - T @ pair.A).max() < 1e-11


def test_nodes_are_the_spectrum_and_functions_are_orthonormal():
    angles, radius = np.array([0.0, 0.4, 1.7, np.pi]), 0.9
    pair = input_normal_pair(angles, radius, taylor=3)
    wanted = radius * np.exp(1j * np.array([0, 0.4, -0.4, 1.7, -1.7, np.pi]))
    spectrum = np.linalg.eigvals(pair.A)
    for node in wanted:
        assert np.abs(spectrum - node).min() < 1e-12
    assert np.sort(np.abs(spectrum))[:3].max() < 1e-4  # a triple zero splits by eps^(1/3)
    circle = np.exp(2j * np.pi * np.arange(2048) / 2048)
    phi = pair.evaluate(circle)
    assert np.abs(phi.conj().T @ phi / 2048 - np.eye(pair.order)).max() < 1e-13


def test_coefficients_reproduce_values_and_taylor_coefficients():
    angles, rho, taylor = np.array([0.3, 1.1, 2.9]), 1.1, 4
    pair = input_normal_pair(angles, 1 / rho, taylor)
    g = 0.7 ** np.arange(400) * np.cos(np.arange(400))  # Taylor coefficients of a function
    x = g @ pair.taylor(400)
    zeta = np.exp(-1j * angles) / rho
    assert np.abs(pair.evaluate(zeta) @ x - np.polyval(g[::-1], zeta)).max() < 1e-14
    assert np.abs(pair.taylor(taylor) @ x - g[:taylor]).max() < 1e-14


def test_stein_doubling_agrees_with_the_defining_equation():
    rng = np.random.default_rng(1)
    left, right = 0.3 * rng.standard_normal((5, 5)), 0.3 * rng.standard_normal((4, 4))
    constant = rng.standard_normal((3, 5, 4))
    X = solve_stein(left, right, constant)
    assert np.abs(X - left @ X @ right - constant).max() < 1e-12
