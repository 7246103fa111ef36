"""Poles over decades: real ones where a plant relaxes, none where it only has modes."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice.kautz import over_decades

OMEGA = np.geomspace(1, 1e3, 60)


def response(values):
    return rid.FrequencyResponse(OMEGA, values, bound=1e-3 * np.abs(values))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k >= 3 else k for k in range(8)])
def test_damped_modes_over_decades_are_no_relaxations(seed):
    """Six modes of damping 0.3: pairs follow them, and a real pole would say what is not there."""
    rng, s = np.random.default_rng(seed), 1j * OMEGA
    values = sum(rng.uniform(0.5, 2) * f**2 / (s**2 + 0.6 * f * s + f**2) for f in 10 ** rng.uniform(0.3, 2.7, 6))
    assert over_decades(response(values)) is None


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k >= 3 else k for k in range(8)])
def test_real_poles_are_found_and_nothing_over_less_than_two_decades(seed):
    rng, s = np.random.default_rng(seed), 1j * OMEGA
    places = np.geomspace(0.5, 500, 4) * np.exp(rng.uniform(-0.3, 0.3, 4))
    frf = response(0.1 + sum(rng.uniform(0.5, 2) * p / (s + p) for p in places))
    found = over_decades(frf)
    assert np.all(found.damping == 1)
    assert found.largest <= 1
    assert over_decades(frf.select(frf.omega < 90)) is None
