"""Coprime factors of systems and of loops: stable, their quotient the system, their products the identity."""

import numpy as np
import pytest

from robustid.core import Response, StateMatrices
from robustid.core.coprime import closed_loop, decay_of, inverse, loop_factors, mirroring_feedback, normalised_factors
from robustid.errors import InputError
from support.loops import controller_of, pair_of, points
from support.pairwise import every_one
from support.refusals import refused

TIMES = (0.1, 0.0)
LOOPS = [(dt, integrators, seed) for dt in TIMES for integrators in (False, True) for seed in range(10)]


def values(system, dt):
    return Response(system).at(points(dt))


def apart(found, expected):
    """Largest error, relative to the largest value."""
    return np.abs(found - expected).max() / max(1.0, np.abs(expected).max())


@pytest.mark.parametrize(("dt", "integrators", "seed"), LOOPS)
def test_factors_of_a_loop_are_stable_and_those_of_its_systems(dt, integrators, seed):
    plant, controller = pair_of(seed, dt, integrators=integrators)
    loop = loop_factors(plant, controller, dt)
    back = inverse(loop)
    decay = decay_of(np.linalg.eigvals(closed_loop(plant, controller).A), dt)
    assert decay_of(np.linalg.eigvals(loop.A), dt) >= decay * (1 - 1e-6)
    assert decay_of(np.linalg.eigvals(back.A), dt) == pytest.approx(decay, rel=1e-6)
    nu = plant.B.shape[1]
    M, p, c = (values(system, dt) for system in (loop, plant, controller))
    D, N, Nc, Dc = M[:, :nu, :nu], M[:, nu:, :nu], -M[:, :nu, nu:], M[:, nu:, nu:]
    assert apart(N, p @ D) < 1e-10
    assert apart(Nc, c @ Dc) < 1e-10
    assert apart(values(back, dt) @ M, np.eye(M.shape[1])) < 1e-10
    both = np.block([[np.tile(np.eye(nu), (len(c), 1, 1)), c], [-p, np.tile(np.eye(p.shape[1]), (len(p), 1, 1))]])
    assert apart(values(closed_loop(plant, controller), dt), np.linalg.inv(both)) < 1e-10


@pytest.mark.parametrize(("dt", "seed"), every_one(TIMES, range(5)))
def test_normalised_factors_are_an_isometry(dt, seed):
    plant, _ = pair_of(seed, dt)
    factors = values(normalised_factors(plant, dt), dt)
    nu = plant.B.shape[1]
    assert apart(np.conj(factors.swapaxes(1, 2)) @ factors, np.eye(nu)) < 1e-10
    assert apart(factors[:, nu:], values(plant, dt) @ factors[:, :nu]) < 1e-10


@pytest.mark.parametrize("dt", TIMES)
def test_slow_poles_are_mirrored_and_the_others_stay(dt):
    plant, _ = pair_of(3, dt, order=6)
    poles = np.linalg.eigvals(plant.A)
    exponents = np.log(poles + 0j) / dt if dt else poles
    decay = float(np.sort(-exponents.real)[3] + 1e-3)
    expected = np.where(exponents.real > -decay, -2 * decay - np.conj(exponents), exponents)
    found = np.linalg.eigvals(plant.A + plant.B @ mirroring_feedback(plant, dt, decay))
    found = np.log(found + 0j) / dt if dt else found
    cost = np.abs(np.exp(0.1 * found)[:, None] - np.exp(0.1 * expected))  # the angle of a pole has no sheet
    assert cost.min(axis=1).max() < 1e-6
    assert cost.min(axis=0).max() < 1e-6


def test_a_loop_that_is_none_is_refused():
    plant, controller = pair_of(0, 0.1)
    wrong = StateMatrices(controller.A, controller.B, -controller.C, controller.D)
    refused("the loop must be stable; got a closed-loop pole at", loop_factors, plant, wrong, 0.1, error=InputError)
    gain = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.eye(1))
    opposite = StateMatrices(*gain[:3], -np.eye(1))
    refused(r"I \+ C P is singular", loop_factors, gain, opposite, 0.1, error=InputError)
    hidden = StateMatrices(np.diag([1.2, 0.5]), np.array([[0.0], [1.0]]), np.ones((1, 2)), np.zeros((1, 1)))
    refused("moved by the inputs", mirroring_feedback, hidden, 0.1, 0.0, error=InputError)
    assert controller_of(plant, 0.1).A.shape == plant.A.shape
