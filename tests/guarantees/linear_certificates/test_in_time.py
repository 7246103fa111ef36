"""Responses in time that bands hold: plants at the edge of the class by their impulse responses, and closed forms."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.linear.certificate import choose
from robustid.guarantees.linear.functions import fixed_functions
from robustid.guarantees.linear.in_time import sample_targets
from robustid.guarantees.linear.samples import samples_of
from support.cases import seeds
from support.edge_bands import DT, KINDS, SIZE, edge_band, edge_plant
from support.problems import in_units, random_experiment
from support.refusals import refused

SAMPLED = [
    # Quick: one entry, of every kind of samples.
    pytest.param(kind, marks=pytest.mark.slow) if kind in ("matrix", "symmetric", "record of two inputs") else kind
    for kind in KINDS
    if kind not in ("continuous", "roll-off")
]
SEEDS = seeds(1, 40)


def impulse_of(plant):
    """All around the circle: (SIZE, ny, nu), which has rung down by its half."""
    return np.fft.irfft(plant.truth(2 * np.pi * np.arange(SIZE // 2 + 1) / SIZE / DT), SIZE, axis=0)


@pytest.mark.parametrize("kind", SAMPLED)
@pytest.mark.parametrize("seed", SEEDS)
def test_responses_of_a_plant_at_the_edge_are_inside(kind, seed):
    plant, band = edge_plant(kind, seed), edge_band(kind, seed)
    pulse, count = impulse_of(plant), 30 if seed else 12
    step = np.cumsum(pulse, axis=0)
    for (centre, radius), truth in [(band.impulse_response(count), pulse), (band.step_response(count), step)]:
        assert centre.shape == radius.shape == (count, *plant.problem.entries.shape)
        assert np.all(np.abs(truth[:count] - centre) <= radius + 1e-9 * np.abs(pulse).max())  # the transform's rounding
    gain, off = band.static_gain
    assert np.all(np.abs(plant.truth(np.zeros(1))[0].real - gain) <= off)
    for samples in (4, None):
        assert np.all(np.abs(step[: SIZE // 2]).max(axis=0) <= band.peak_step(samples) * (1 + 1e-9))


def plain(bound, **kwargs):
    omega = np.linspace(1, 30, 12)
    frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-0.1j * omega)), bound=bound, dt=0.1)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5), **kwargs)


def test_data_that_say_nothing_leave_what_the_class_says():
    """K rho^-t of a pulse; of a step the root of the sum of their squares, and the sum for its peak."""
    band, t = rid.band(plain(1e4)), np.arange(12)
    np.testing.assert_allclose(band.impulse_response(12)[1][:, 0, 0], 2 * 1.5**-t, rtol=1e-9)
    squares = np.sqrt(np.cumsum(1.5 ** (-2.0 * t)))
    np.testing.assert_allclose(band.step_response(12)[1][:, 0, 0], 2 * squares, rtol=1e-9)
    late = 1.5**-3.0 / (1.5 - 1)  # of the sum from number 4 on
    assert band.peak_step(3).item() == pytest.approx(2 * (1 + late), rel=1e-6)


def test_good_data_leave_little():
    band, t = rid.band(plain(1e-3)), np.arange(8)
    centre, radius = band.impulse_response(8)
    assert np.all(np.abs(centre[:, 0, 0] - 0.5 ** (t + 1)) <= radius[:, 0, 0])
    assert radius.max() < 0.01
    assert band.peak_step().item() == pytest.approx(1.0, abs=0.02)


def test_a_record_of_a_pulse_is_its_own_answer():
    record = rid.TimeRecord(np.eye(1, 6)[0], 0.5 ** np.arange(1, 7), dt=0.1, bound=1e-6)
    band = rid.band(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)), omega=[1.0])
    centre, radius = band.impulse_response(6)
    assert np.all(np.abs(centre[:, 0, 0] - 0.5 ** np.arange(1, 7)) <= radius[:, 0, 0])
    assert radius.max() < 1.5e-6  # rounding of the norm of the class included
    centre, radius = band.step_response(6)
    assert radius[-1] < 7e-6


@pytest.mark.parametrize("seed", seeds(2, 30))
def test_inner_products_with_samples_of_a_response_are_those_of_coefficients(seed):
    """In the mean over the circle itself powers of zeta are orthonormal."""
    rng = np.random.default_rng(seed)
    omega, u, drive = rng.uniform(0.1, 31, 3), rng.standard_normal(7), rng.standard_normal(int(rng.integers(1, 12)))
    problem = rid.MixedProblem(
        frequency=rid.FrequencyResponse(np.sort(omega), np.ones(3), bound=0.1, dt=0.1),
        time=rid.TimeRecord(u, np.ones(7), dt=0.1, bound=0.1),
        prior=rid.Prior(gain_bound=3.0, decay_rate=1.5),
    )
    samples = samples_of(problem, fixed_functions(None), (0, 0))
    targets, count = sample_targets(samples, drive), 120
    chosen = choose(samples, targets, np.tile(np.arange(6), (drive.size, 1)))
    decay = 3.0 * 1.5 ** -np.arange(float(count))

    def convolution(one):
        rows = np.zeros((one.size, count))
        for t in range(one.size):
            rows[t, : t + 1] = one[t::-1]
        return rows * decay

    own = np.concatenate([np.exp(-1j * samples.angles)[:, None] ** np.arange(count) * decay, convolution(u)])
    wanted = convolution(drive)
    np.testing.assert_allclose(chosen.cross, (own @ wanted.T).T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(targets.square, (wanted**2).sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(chosen.gram[0], own @ own.conj().T, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", seeds(1, 40))
def test_amplitudes_without_a_box_are_the_coefficients_of_the_functions(seed):
    problem, truth = random_experiment(seed, "parametric", 24)
    ((centre, radius),) = rid.band(problem, omega=[1.0]).amplitudes
    assert np.all(centre.imag == 0)
    assert np.all(np.abs(truth.weights - centre) <= radius)


def test_amplitudes_are_those_of_the_entry_alone():
    plant = edge_plant("record of two inputs", 1)
    found = rid.band(plant.problem, box=plant.box, omega=[1.0], knots=20).amplitudes
    assert [one[0].size for one in found] == [1, 1] if plant.box is not None else [2, 2]


def test_the_static_gain_is_the_band_at_zero():
    for kind in ("discrete", "continuous", "symmetric"):
        band = rid.band(edge_plant(kind, 1).problem, omega=[1.0], knots=40)
        centre, radius = band.at([0.0])
        np.testing.assert_array_equal(band.static_gain[0], centre[0].real)
        np.testing.assert_array_equal(band.static_gain[1], radius[0])


def test_bad_input():
    continuous = rid.band(edge_plant("continuous", 0).problem, omega=[1.0])
    integrating = rid.band(plain(0.1, parametric=rid.integrators(dt=0.1)), omega=[1.0])
    for call in (continuous.impulse_response, continuous.step_response):
        refused("`problem` is of continuous time", call, 3)
    refused("`problem` is of continuous time", continuous.peak_step)
    refused("`problem` has an integrator", integrating.peak_step)
    refused("`problem` has an integrator", lambda: integrating.static_gain)
    refused("`count` must be at least 1", integrating.impulse_response, 0)
    refused("`problem` has an integrator", integrating.peak_step, 0)
    centre, radius = integrating.step_response(5)  # so many samples have a bound
    assert np.all(np.isfinite(centre))
    assert np.all(np.isfinite(radius))


def test_units_change_nothing_but_the_units():
    problem = plain(0.01)
    other = in_units(problem, 2.0**40)
    for one, again in zip(rid.band(problem).step_response(6), rid.band(other).step_response(6), strict=True):
        np.testing.assert_allclose(again, 2.0**40 * one, rtol=1e-9)
