"""Modes that lie together, whose places the points do not bound: without them no class holds the data."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice import every_mode
from robustid.app.run.every_mode import _beside
from robustid.app.run.settings import Modes

MODES = ((340, 0.026, -1.6), (355, 0.025, -1.7), (381, 0.011, -0.6), (530, 0.027, 1.2))


def plant(hz):
    return sum(c * hz**2 / (hz**2 - 2j * z * w * hz - w**2) for w, z, c in MODES)


def measured(part, seed=0):
    rng, hz = np.random.default_rng(seed), np.arange(200, 650, 5.0)
    values = plant(hz)
    bound = part * np.median(np.abs(values))
    noise = 0.2 * bound * (rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size))
    return rid.FrequencyResponse(2 * np.pi * hz, values + noise, bound=bound)


def test_modes_that_lie_together_stand_in_the_class_if_none_holds_the_data_without(unreduced, undrawn):
    found = rid.identify_reduced(measured(0.2), worst_case=False)
    assert found.consistent
    modes = found.run_file.modes
    np.testing.assert_allclose(modes.hz, [one[0] for one in MODES], rtol=0.01)
    assert "more mode" in modes.note
    exact = [low == high for low, high in modes.hz_interval]
    assert (exact[0], exact[1], exact[3]) == (True, True, False)  # that of 381 Hz may be either
    band, hz = rid.band(found.identification), np.linspace(202, 640, 2001)
    centre, radius = band.at(2 * np.pi * hz)
    assert np.all(np.abs(plant(hz) - centre[:, 0, 0]) <= radius[:, 0, 0])


def test_without_a_fit_inside_all_bounds_there_are_none():
    rng = np.random.default_rng(0)
    frf = measured(0.2)
    noisy = rid.FrequencyResponse(frf.omega, rng.standard_normal(90) + 1j * rng.standard_normal(90), bound=1e-3)
    assert every_mode(noisy, None).shape == (0, 2)
    np.testing.assert_allclose(every_mode(frf, None)[:, 0] / (2 * np.pi), [one[0] for one in MODES], rtol=0.01)


@pytest.mark.parametrize(("hz", "added"), [((10.0, 20.0), None), ((10.0,), 1), ((), 2)])
def test_what_stands_already_is_not_added(hz, added):
    intervals = tuple((0.9 * one, 1.1 * one) for one in hz)
    modes = Modes(hz=hz, damping=(0.01,) * len(hz), hz_interval=intervals, damping_interval=((0.005, 0.02),) * len(hz))
    found = _beside(modes, np.array([[2 * np.pi * 10.01, 0.011], [2 * np.pi * 20.0, 0.01]]))
    if added is None:
        assert found is None
    else:
        assert len(found.hz) == 2
        assert sum(low == high for low, high in found.hz_interval) == added
