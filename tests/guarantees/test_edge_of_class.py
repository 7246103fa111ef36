"""Matrices at the very edge of the class: gain exactly K everywhere on its circle, every error as large as its bound."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import norm_of_bounds
from support.cases import seeds
from support.edge_plants import edge_problem, inner


def test_an_inner_function_has_norm_one_on_the_circle():
    values = inner(np.random.default_rng(0), 2, 3, np.exp(1j * np.linspace(0, 3, 7)))
    np.testing.assert_allclose(np.linalg.norm(values, 2, axis=(1, 2)), 1)


@pytest.mark.parametrize("seed", seeds(1, 50))
def test_a_plant_at_the_edge_is_inside_every_band_and_interval(seed):
    """At a line and between lines; the slow seeds at two of each."""
    problem, truth, residues = edge_problem(seed)
    result = rid.identify(problem)
    omega = np.concatenate([problem.frequency[0].omega[[1, 5]], [0.05, 1.7]])[:: 1 if seed else 3]
    error = rid.worst_case_error(result, omega=omega, rtol=0.1)
    off = truth(error.omega) - error.nominal
    assert np.all(np.abs(off) <= error.upper)
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= error.sigma_upper)
    assert np.all(error.lower <= error.upper)
    assert np.all(error.sigma_lower <= error.sigma_upper)
    assert np.all(error.sigma_upper <= norm_of_bounds(error.upper))
    assert np.all(error.sigma_lower >= error.lower.max(axis=(1, 2)))
    low, high = np.moveaxis(error.magnitude, -1, 0)
    assert np.all((low <= np.abs(truth(error.omega))) & (np.abs(truth(error.omega)) <= high))
    for entry in np.ndindex(off.shape[1:]):
        assert all(
            one.excludes(value) == 0
            for one, value in zip(error.of_entry(*entry), truth(error.omega)[:, *entry], strict=True)
        )
    assert np.all((error.parameters.lower <= residues) & (residues <= error.parameters.upper))
    # Of every entry a consistent system is as near to the bound as was asked for.
    assert np.all(error.lower >= 0.9 * error.upper)
    assert error.certified


def impulse_of(truth, horizon, size=4096):
    """The first samples of the impulse response, (horizon, ny, nu), from the values all around the circle."""
    return np.fft.irfft(truth(2 * np.pi * np.arange(size // 2 + 1) / size), size, axis=0)[:horizon]


@pytest.mark.parametrize("seed", seeds(1, 50))
def test_a_plant_at_the_edge_is_inside_every_tube(seed):
    problem, truth, _ = edge_problem(seed)
    result, horizon = rid.identify(problem), 4
    response = impulse_of(truth, horizon)
    for entry in np.ndindex(*response.shape[1:]) if seed else [(1, 0)]:
        tube = rid.guarantee.response_tube(result, input="impulse", horizon=horizon, entry=entry)
        inside = response[:, *entry]
        assert np.all((tube.lower <= inside) & (inside <= tube.upper))
        assert np.all(np.abs(inside - tube.nominal) <= tube.error_upper)
        assert np.all(tube.error_lower <= tube.error_upper)
        assert tube.verify()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_certificates_of_a_plant_at_the_edge_hold_in_ball_arithmetic(seed):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    result = rid.identify(edge_problem(seed)[0])
    error = rid.worst_case_error(result, omega=[0.7], rtol=0.1)
    claims = list(error.claims())
    assert claims
    assert all(claim.verify(exact=True) for claim in claims[:: max(len(claims) // 8, 1)])
