"""Modes of real shape: their functions of frequency, tangent and state space against brute force."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import cont2discrete

from robustid.core import response_at
from robustid.fitting.state_space.real_modes import RealModes, mode_gains
from support.mechanics import check_symmetric_tangent, check_tangent
from support.pairwise import every_one

OMEGA = np.linspace(0.3, 2.9, 12)
POWERS = (0, 1, 2)
SHAPES = ((2, 2), (2, 1), (1, 2), (1, 1))


def modes(discrete, power, count=0, *, seed=0, nu=3):
    """Four modes, light, slow, almost double and overdamped, with rigid-body modes some of whose directions are free."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, nu))
    centre, square = np.array([-0.01, -2e-3, -0.4, -0.7]), np.array([1.2, 4e-4, 1e-4, -0.2])
    inputs, free = rng.standard_normal((4, nu)), np.abs(directions) > 0.3
    return RealModes(centre, square, inputs, directions, free, discrete=discrete, power=power).normalised()


def nodes(discrete):
    return np.exp(1j * OMEGA) if discrete else 1j * OMEGA


def physical(model, k):
    """Mode k as a mass on a spring, its output a derivative of the position; sampled behind a hold by SciPy."""
    a, w = model.centre[k], model.square[k]
    A, B = np.array([[0.0, 1.0], [-(a**2) - w, 2 * a]]), np.array([[0.0], [1.0]])
    C, D = [([[1, 0]], 0), ([[0, 1]], 0), (A[1:], 1)][model.power]
    if not model.discrete:
        return A, B, C, D
    return cont2discrete((A, B, np.atleast_2d(C), [[D]]), 1.0)[:4]


@pytest.mark.parametrize(("discrete", "power"), every_one([False, True], POWERS))
def test_a_mode_is_a_mass_on_a_spring(discrete, power):
    model, xi = modes(discrete, power), nodes(discrete)
    states = model.states(xi)
    for k in range(4):
        matrices = [np.reshape(M, shape) * 1.0 for M, shape in zip(physical(model, k), SHAPES, strict=True)]
        wanted = response_at(matrices, xi)
        assert np.allclose(states[:, k], wanted[:, 0] * model.inputs[k], rtol=1e-9)


@pytest.mark.parametrize(("power", "count", "discrete"), every_one([(0, 0), (1, 0), (2, 0), (0, 2)], [False, True]))
def test_the_tangent_is_the_derivative(discrete, power, count):
    model, xi = modes(discrete, power, count), nodes(discrete)
    C = np.random.default_rng(3).standard_normal((2, model.order))
    tangent = model.tangent(xi, model.states(xi), C)
    assert tangent.shape[3] == 4 * (2 + 2) + np.sum(model.free)
    check_tangent(tangent, lambda step: C @ model.moved(step).states(xi))


@pytest.mark.parametrize("discrete", [False, True])
def test_the_tangent_of_symmetric_modes_is_the_derivative(discrete):
    model = modes(discrete, 0, 2)
    assert len(model.tied_outputs()) == 4 + 3
    check_symmetric_tangent(model, nodes(discrete), model.moved)


@pytest.mark.parametrize(("power", "count", "discrete"), every_one([(0, 0), (1, 0), (2, 0), (0, 2)], [False, True]))
def test_the_state_space_has_two_states_a_mode_and_that_response(discrete, power, count):
    model, xi = modes(discrete, power, count), nodes(discrete)
    rng = np.random.default_rng(5)
    C, D = rng.standard_normal((2, model.order)), rng.standard_normal((2, 3))
    found = model.realised(C, D)
    assert len(found.A) == 2 * model.order
    wanted = C @ model.states(xi) + D
    assert np.allclose(response_at(found, xi), wanted, rtol=1e-9)
    chains = len(found.A) - 2 * count
    assert np.array_equal(found.A[chains:, chains:] - discrete * np.eye(2 * count), np.eye(2 * count, k=count))


@pytest.mark.parametrize(("discrete", "power"), every_one([False, True], POWERS))
def test_gains_are_residues(discrete, power):
    model = dataclasses.replace(modes(discrete, power), square=np.array([1.2, 0.3, 0.5, 0.9]))
    pole, near = model.poles[::2], 1e-6
    states = np.linalg.norm(model.inputs, axis=1) * np.array(
        [model.states(np.array([p + near]))[0, k, 0] / model.inputs[k, 0] for k, p in enumerate(pole)]
    )
    assert np.allclose(mode_gains(model.decays[:, 0], discrete, power), near * states, rtol=1e-4)


@pytest.mark.parametrize("discrete", [False, True])
def test_normals_are_the_gradients_of_the_distances(discrete):
    model, h = modes(discrete, 0), 1e-7
    coordinates = model.pole_coordinates
    for k in range(coordinates):
        step = h * np.eye(coordinates + 8)[k]
        change = (model.moved(step).distances - model.moved(-step).distances) / (2 * h)
        assert np.allclose(model.normals()[:, k], change, rtol=1e-5, atol=1e-6)


def test_steps_keep_modes_inside():
    """Far beyond the boundary, beyond Nyquist, and reflected where they began outside."""
    model = modes(True, 0)
    least = model.least_distances(nodes(True), 0.02)
    step = np.zeros(4 * 4)
    step[:8] = 50.0
    moved = model.moved(step, least)
    assert np.all(moved.distances >= least * (1 - 1e-12))
    assert np.all(np.abs(moved.decays.imag) < np.pi)
    outside = dataclasses.replace(model, centre=-model.centre)
    assert np.all(outside.distances < 0)
    assert np.all(outside.reflected().distances > 0)
    assert np.allclose(outside.reflected().centre[:2], model.centre[:2])
