"""Modes that the data hardly show are named, and left out where all samples allow it."""

import control
import numpy as np

import robustid as rid
from robustid.identification import largest_ratio
from robustid.reduction import without_doubtful_modes


def structure(extra):
    """A resonance at 10 Hz, and what is said to be beside it: data, identification, model."""
    dt, omega = 0.01, 2 * np.pi * np.arange(1.0, 31.0)
    basis = rid.kautz(2 * np.pi * 10.0, 0.05, dt=dt, delay=1)
    values = basis.response(omega * dt) @ [1.0, 0.5]
    frf = rid.FrequencyResponse(omega, values, bound=0.02, dt=dt)
    prior = rid.Prior(gain_bound=0.05, decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    own = control.ss(basis.A, basis.B, np.array([[1.0, 0.5]]) @ basis.C, np.array([[1.0, 0.5]]) @ basis.D, dt)
    hz, damping, size = extra
    other = rid.kautz(2 * np.pi * hz, damping, dt=dt, delay=1)
    more = control.ss(other.A, other.B, np.array([[size, 0.0]]) @ other.C, np.zeros((1, 1)), dt)
    return found, control.parallel(own, more)


def test_a_mode_that_a_zero_almost_cancels_is_left_out():
    found, model = structure((9.7, 0.03, 0.003))
    assert largest_ratio(found.problem, model) < 1
    smaller, modes = without_doubtful_modes(found, model)
    assert smaller.nstates == 2
    (mode,) = modes
    assert mode.removed
    np.testing.assert_allclose([mode.hz, mode.damping], [9.7, 0.03], rtol=1e-6)
    assert "a zero almost cancels" in mode.summary()
    assert largest_ratio(found.problem, smaller) <= 1


def test_a_mode_between_the_points_and_one_at_the_limit_of_damping_are_named():
    for extra, words in (((20.5, 0.001, 0.002), "narrower"), ((20.5, 1e-5, 1e-4), "limit of damping")):
        found, model = structure(extra)
        smaller, modes = without_doubtful_modes(found, model)
        assert [words in mode.why for mode in modes] == [True]
        assert smaller.nstates == 2


def test_points_that_were_not_used_and_samples_that_need_a_mode_keep_it():
    found, model = structure((20.5, 0.001, 0.002))
    unused = 2 * np.pi * np.array([20.5])
    shown = rid.FrequencyResponse(unused, model(np.exp(1j * unused * 0.01)), bound=0.01, dt=0.01)
    kept, modes = without_doubtful_modes(found, model, [shown])
    assert kept is model
    assert [mode.removed for mode in modes] == [False]
    assert "measure more points" in modes[0].summary()


def test_a_mode_that_the_data_show_is_not_doubtful():
    found, _ = structure((20.0, 0.05, 0.0))
    plain, modes = without_doubtful_modes(found, found.model)
    assert plain is found.model
    assert modes == ()
