"""Orthonormal bases of generalised interpolation: spectrum, orthonormality, coefficients."""

import numpy as np
import pytest

from robustid.bases import input_normal_pair, solve_stein

pytestmark = pytest.mark.quick


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
