"""Noise from the roughness of a response where it is as large as a part of the response; derivatives behind the refinement."""

import numpy as np
import pytest

import robustid as rid
from robustid.estimation import pole_fit
from robustid.estimation.roughness import roughness


@pytest.mark.quick
def test_derivatives_by_the_poles_are_those_of_differences():
    rng = np.random.default_rng(0)
    x, poles = 1j * np.linspace(0, 1, 30), np.array([-0.1 + 0.3j, -0.2, -0.05 + 0.8j, -0.7])
    c, step = rng.standard_normal(7), 1e-6  # the last one is that of a constant
    ways = [*np.eye(4), 1j * np.eye(4)[0], 1j * np.eye(4)[2]]
    ends = [[pole_fit._fractions(x, poles + sign * step * way) @ c[:6] for sign in (1, -1)] for way in ways]
    differences = np.stack([(up - down) / (2 * step) for up, down in ends], axis=1)
    np.testing.assert_allclose(pole_fit._slopes(x, poles, c), differences, atol=1e-6)


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 20))])
def test_noise_that_is_a_large_part_of_the_response(seed, part):
    """A hammer test with few averages: a mode in the band, one above it; the noise that is found is that of the data."""
    rng, hz = np.random.default_rng(seed), np.arange(5, 150, 0.3125)
    s = 2j * np.pi * hz
    smooth = (1 + s / 300) / (1 + 2e-3 * s / 1206 + (s / 1206) ** 2) + 0.2 / (1 + 0.01 * s / 300 + (s / 300) ** 2)
    deviation = part * np.abs(smooth)
    noise = deviation * (rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size)) / np.sqrt(2)
    found = roughness(rid.FrequencyResponse(2 * np.pi * hz, smooth + noise))
    assert found.white
    assert 0.8 <= np.median(found.deviation / deviation) <= 1.25
