"""Matrices at the very edge of the class: gain exactly K everywhere on its circle, every error as large as its bound."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.value_set import norm_of_bounds

SHAPES = (2, 2), (2, 3), (3, 2)


def inner(rng, p, q, zeta):
    """U diag(b_k(zeta)) V with Blaschke factors b_k and orthonormal columns and rows: of norm 1 wherever |zeta| = 1, (F, p, q)."""
    rank = min(p, q)
    U, V = (np.linalg.qr(rng.standard_normal((size, rank)))[0] for size in (p, q))
    zeros = rng.uniform(-0.9, 0.9, (2, rank))
    factors = np.prod([(zeta[:, None] - a) / (1 - a * zeta[:, None]) for a in zeros], axis=0)
    return np.einsum("ik,fk,jk->fij", U, factors, V)


def edge_problem(seed):
    """(problem, truth at angles, residues): 2x2, 2x3 and 3x2, one mode of free residues, and an inner function times K."""
    rng = np.random.default_rng(seed)
    (p, q), rho, gain, bound = SHAPES[seed % 3], rng.uniform(1.1, 1.4), rng.uniform(0.5, 2), 0.1
    basis = rid.kautz([rng.uniform(0.5, 1.5)], [0.03], dt=1.0, delay=1)
    residues, state = rng.standard_normal((2, p, q)), rng.bit_generator.state

    def truth(angles):
        again = np.random.default_rng()
        again.bit_generator.state = state
        rest = gain * inner(again, p, q, np.exp(-1j * angles) / rho)
        return rest + np.tensordot(basis.response(angles), residues, 1)

    lines = np.sort(rng.uniform(0.1, 3.0, 8))
    values = truth(lines)
    values = values + bound * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(lines, values, bound=bound * (1 + 1e-9), dt=1.0)
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), truth, residues


def test_an_inner_function_has_norm_one_on_the_circle():
    values = inner(np.random.default_rng(0), 2, 3, np.exp(1j * np.linspace(0, 3, 7)))
    np.testing.assert_allclose(np.linalg.norm(values, 2, axis=(1, 2)), 1)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 50))])
def test_a_plant_at_the_edge_is_inside_every_band_and_interval(seed):
    problem, truth, residues = edge_problem(seed)
    result = rid.identify(problem)
    omega = np.concatenate([problem.frequency[0].omega[[1, 5]], [0.05, 1.7]])
    error = rid.worst_case_error(result, omega=omega, rtol=0.1)
    off = truth(error.omega) - error.nominal
    assert np.all(np.abs(off) <= error.upper)
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= error.sigma_upper)
    assert np.all(error.lower <= error.upper)
    assert np.all(error.sigma_lower <= error.sigma_upper)
    assert np.all(error.sigma_upper <= norm_of_bounds(error.upper))
    for entry in np.ndindex(off.shape[1:]):
        assert all(
            one.excludes(value) == 0
            for one, value in zip(error.of_entry(*entry), truth(error.omega)[:, *entry], strict=True)
        )
    assert np.all((error.parameters.lower <= residues) & (residues <= error.parameters.upper))
    # Of every entry a consistent system is as near to the bound as was asked for.
    assert np.all(error.lower >= 0.9 * error.upper)
    assert error.certified
