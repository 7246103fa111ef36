"""Lines of a response that are excited, and excitations that a model of many lines at once can't use."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError


def test_a_multisine_without_its_period_is_refused_by_that_name():
    """Of every third line in seven periods six windows were left, with values of 1e7 and bounds of 1e13; of fewer lines none."""
    rng, period = np.random.default_rng(1), 400
    spectrum = np.zeros(period // 2 + 1, complex)
    spectrum[3:100:3] = np.exp(2j * np.pi * rng.random(33))
    u = np.tile(np.fft.irfft(spectrum, period), 7)
    y = 0.5 * np.roll(u, 1) + 1e-3 * np.std(u) * rng.standard_normal(u.size)
    record = rid.TimeRecord(u, y, dt=0.01)
    with pytest.raises(InputError, match=r"excited on single spectral lines.*`period`"):
        rid.estimate_frf(record, method="local")
    assert rid.estimate_frf(record, period=period).omega.size == 33


def test_noise_and_sweeps_are_excited_on_all_their_lines():
    times, rng = np.arange(4000), np.random.default_rng(2)
    for u in (rng.standard_normal(times.size), np.sin(2 * np.pi * (0.01 + 2e-5 * times) * times)):
        y = 0.5 * np.roll(u, 1) + 1e-3 * rng.standard_normal(u.size)
        assert rid.estimate_frf(rid.TimeRecord(u, y, dt=0.01), method="local").omega.size > 500
