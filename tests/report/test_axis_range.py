"""The axis of magnitudes follows what says something."""

import numpy as np

import robustid as rid
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
