"""Realisations in blocks: states, tangent and steps against brute force."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.integrator_chains import chain
from support.mechanics import check_symmetric_tangent, check_tangent, unscaled
from support.pairwise import every_one

OMEGA = np.linspace(0.3, 3, 11)


def plant(seed, n, nu, discrete):
    """A random stable A and B, nodes on the boundary."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A -= (np.abs(np.linalg.eigvals(A).real).max() + 0.3) * np.eye(n)
    if discrete:
        A = np.linalg.solve(np.eye(n) - A / 2, np.eye(n) + A / 2)
    return A, rng.standard_normal((n, nu)), np.exp(1j * OMEGA) if discrete else 1j * OMEGA


def block_model(seed, n, nu, count, discrete):
    """Blocks of a random plant with rigid-body chains; some of their directions are free."""
    A, B, xi = plant(seed, n, nu, discrete)
    rng = np.random.default_rng([seed, 1])
    directions = rng.standard_normal((count, nu))
    free = np.abs(directions) > 0.3
    return BlockModel.of(A, B, discrete=discrete, directions=directions, free=free), A, B, xi


@pytest.mark.parametrize(
    ("n", "nu", "count", "discrete"), every_one([(7, 1, 0), (8, 2, 1), (1, 1, 0), (5, 3, 2)], [False, True])
)
def test_states_and_rows_against_linear_solves(discrete, n, nu, count):
    model, *_, xi = block_model(n, n, nu, count, discrete)
    A, B = model.matrices()
    C = np.random.default_rng(2).standard_normal((2, model.order))
    for point, states, rows in zip(xi, model.states(xi), model.output_rows(xi, C), strict=True):
        resolvent = np.linalg.inv(point * np.eye(len(A)) - A)
        assert np.allclose(states, resolvent @ B, rtol=1e-11, atol=1e-12)
        assert np.allclose(rows, C @ resolvent, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(
    ("n", "nu", "count", "discrete"), every_one([(7, 1, 0), (8, 2, 1), (1, 1, 0), (5, 3, 2)], [False, True])
)
def test_the_tangent_is_the_derivative(discrete, n, nu, count):
    """Central differences of the response, and n*nu coordinates where no direction is held."""
    model, *_, xi = block_model(n, n, nu, count, discrete)
    C = np.random.default_rng(3).standard_normal((2, model.order))
    tangent = model.tangent(xi, model.states(xi), C)
    assert tangent.shape[3] == n * nu + np.sum(model.free)
    check_tangent(tangent, lambda step: C @ unscaled(model, step).states(xi))


@pytest.mark.parametrize(("n", "nu", "count", "discrete"), every_one([(7, 1, 0), (8, 2, 1), (5, 3, 2)], [False, True]))
def test_the_tangent_of_symmetric_blocks_is_the_derivative(discrete, n, nu, count):
    model, *_, xi = block_model(n, n, nu, count, discrete)
    check_symmetric_tangent(model, xi, lambda step: unscaled(model, step))


def check_reach(model, A, B, xi, rtol):
    """Every response C (xi - A)^{-1} B is one of the blocks."""
    wanted = np.stack([np.linalg.solve(point * np.eye(len(A)) - A, B) for point in xi])
    parts = (model.states(xi), wanted)
    rows = [np.concatenate([p.real, p.imag]).transpose(0, 2, 1).reshape(-1, len(A)) for p in parts]
    left = np.linalg.lstsq(rows[0], rows[1], rcond=None)[0]
    assert np.allclose(rows[0] @ left, rows[1], rtol=rtol, atol=rtol * np.abs(rows[1]).max())


@pytest.mark.parametrize("discrete", [False, True])
def test_blocks_have_the_poles_and_reach_of_the_plant(discrete):
    A, B, xi = plant(4, 9, 2, discrete)
    model = BlockModel.of(A, B, discrete=discrete)
    assert np.allclose(np.sort_complex(model.poles), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-9)
    check_reach(model, A, B, xi, 1e-9)


@pytest.mark.parametrize("count", [1, 2])
def test_chains_of_integrators_are_blocks(count):
    """Double poles, which have no basis of eigenvectors, in random coordinates."""
    rng = np.random.default_rng(5)
    T = scipy.linalg.orth(rng.standard_normal((2 * count + 2, 2 * count + 2)))
    A = T @ scipy.linalg.block_diag(chain(count, 0.0), [[-0.1, 2], [-2, -0.1]]) @ T.T
    B = rng.standard_normal((len(A), 2))
    check_reach(BlockModel.of(A, B, discrete=False), A, B, 1j * OMEGA, 1e-7)


def test_a_pair_becomes_two_real_poles_and_back():
    """The coupling stays, so that the response is smooth where the square root of the poles isn't."""
    model = BlockModel.of(np.array([[-1.0, 0.1], [-0.1, -1.0]]), np.eye(2)[:, :1], discrete=False)
    moved = model.moved(np.array([0.0, -2 * model.fall[0]]))
    assert np.all(np.imag(model.poles) != 0)
    assert np.allclose(np.sort(moved.poles), [-1.1, -0.9])
    back = moved.moved(np.array([0.0, -2 * moved.fall[0]]))
    assert np.allclose(np.sort_complex(back.poles), np.sort_complex(model.poles))


@pytest.mark.parametrize("discrete", [False, True])
def test_poles_stay_inside(discrete):
    """20 random steps of any length from a plant: never nearer to the boundary than was said."""
    model, *_, xi = block_model(6, 7, 2, 0, discrete)
    rng = np.random.default_rng(7)
    for _ in range(20):
        step = rng.standard_normal(14) * 10.0 ** rng.uniform(-2, 2)
        least = model.least_distances(xi, 0.02)
        moved = model.moved(step, least)
        assert np.all(moved.distances >= least * (1 - 1e-6))
        poles = moved.poles
        assert np.all(np.abs(poles) < 1 if discrete else poles.real < 0)
        model = moved


@pytest.mark.parametrize("discrete", [False, True])
def test_normals_are_the_derivatives_of_the_distances(discrete):
    model = block_model(8, 7, 1, 0, discrete)[0]
    normals, h = model.normals(), 1e-7
    for k in range(normals.shape[1]):
        step = np.zeros(7)
        step[k] = h
        there, back = unscaled(model, step).distances, unscaled(model, -step).distances
        assert np.allclose(normals[:, k], (there - back) / (2 * h), atol=1e-6)


def test_reflection():
    """Unstable poles go to -conj(s) or 1/conj(z); the others stay."""
    for discrete, pole, wanted in ((False, 0.2 + 3j, -0.2 + 3j), (True, 1.1 * np.exp(1j), np.exp(1j) / 1.1)):
        A = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])
        inside = 0.5 if discrete else -0.5
        A = scipy.linalg.block_diag(A, inside)
        found = BlockModel.of(A, np.ones((3, 1)), discrete=discrete).reflected().poles
        assert np.allclose(np.sort_complex(found), np.sort_complex([wanted, np.conj(wanted), inside]))


def test_blocks_come_and_go():
    model = block_model(9, 6, 2, 0, False)[0]
    other = block_model(10, 4, 2, 0, False)[0]
    both = model.joined(other)
    assert both.order == 2 * both.centre.size + model.single.size
    without = both.without(0)
    assert np.array_equal(without.centre, both.centre[1:])
    assert dataclasses.replace(without).order == both.order - 2
