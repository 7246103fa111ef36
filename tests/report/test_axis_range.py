"""The axis of magnitudes follows what says something."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import default_grid
from robustid.report.charts import frequency_axis
from robustid.report.curves import log_axis
from robustid.report.frequency import frequency_charts


def test_samples_below_their_own_bounds_do_not_stretch_the_axis():
    """Beyond the end of a sweep values of 1e5 hid a response of 1e-5: the first plot showed nothing of it."""
    omega = np.linspace(1.0, 250.0, 40)
    z = np.exp(0.01j * omega)
    values, bound = 0.01 / (z - 0.9), np.full(40, 1e-4)
    values[-3:], bound[-3:] = 1e5, 3e5
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=0.01)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.3, decay_rate=1.05)))
    bottom, top = frequency_charts(result)[0].panels[0].y.range
    assert 0.1 < top < 10
    assert bottom < 0.01


@pytest.mark.parametrize(("dt", "top"), [(None, 1015.0), (1e-4, 1015.0), (1 / 2020, 1010.0)])
def test_lines_within_an_octave_are_drawn_and_bounded_around_themselves(dt, top):
    """From 995 to 1005 Hz they were a stroke on an axis from 251 to 2010 Hz, where the default frequencies lay too."""
    hz = np.linspace(995.0, 1005.0, 11)
    frf = rid.FrequencyResponse(2 * np.pi * hz, 1 / (1 + 0.5j * (hz - 1000)), bound=0.1, dt=dt)
    rate = {"decay": 20.0} if dt is None else {"decay_rate": 1.001}
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, **rate)))
    ends = [985.0, top]
    grid = default_grid(result.problem) / (2 * np.pi)
    np.testing.assert_allclose([grid[0], grid[-1]], ends)
    axis = frequency_charts(result)[0].panels[0].x
    np.testing.assert_allclose(axis.range, ends)
    assert not axis.log
    wide = rid.FrequencyResponse(2 * np.pi * hz[:2] * [1, 2], [0.1, 0.1], bound=0.1, dt=dt and 1e-4)
    wide = rid.MixedProblem(frequency=wide, prior=rid.Prior(gain_bound=2.0, **rate))
    np.testing.assert_allclose(default_grid(wide)[-1] / (2 * np.pi), 2 * 2 * hz[1] if dt is None else 5000.0)


def test_the_axis_of_a_response_on_a_narrow_band_is_that_of_its_lines():
    omega = 2 * np.pi * np.linspace(995.0, 1005.0, 11)
    axis = frequency_axis(omega)
    np.testing.assert_allclose(axis.range, (994.8, 1005.2))
    assert not log_axis(np.geomspace(*omega[[0, -1]], 11))
    assert log_axis(np.geomspace(1.0, 10.0, 11))
