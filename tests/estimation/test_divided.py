"""Response of a plant in a loop as a quotient: what the first order leaves out, and lines that tell nothing."""

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.errors import InputError
from robustid.estimation.divided import divided, widening
from support.cases import seeds


@pytest.mark.parametrize("unsure", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("alike", [True, False])
def test_the_widened_bound_holds_at_its_probability(unsure, alike):
    """Errors of (y, u) with one cause, as in a loop, and with two: many draws against 1 - 0.05 in all lines together."""
    rng, lines, dof, draws = np.random.default_rng(0), 200, 20.0, 400
    true = np.array([[0.3 + 0.2j], [0.9 - 0.1j]])
    gain = true[0, 0] / true[1, 0]
    root = unsure * np.array([[1.0, 0.0], [-0.8, 0.0]] if alike else np.eye(2), dtype=complex)
    outside = 0
    for _ in range(draws):
        noise = (rng.standard_normal((lines, 2)) + 1j * rng.standard_normal((lines, 2))) / np.sqrt(2)
        values = true[:, 0] + noise @ root.T
        spread = rng.chisquare(2 * dof, lines) / (2 * dof)  # the variance is estimated
        covariance = (root @ root.conj().T)[None] * spread[:, None, None]
        found, variance = divided(values[:, :, None], covariance, 1)
        wider, told = widening(values[:, :, None], covariance, 1, dof)
        quantile = dof * ((0.05 / lines) ** (-1 / dof) - 1)
        radius = np.sqrt(quantile * variance[:, 0, 0].real * wider)
        outside += bool(np.any((np.abs(found[:, 0, 0] - gain) > radius)[told]))
    assert outside <= 0.05 * draws + 3 * np.sqrt(0.05 * draws)


def test_where_the_answer_of_the_input_is_not_known_nothing_is_told():
    values = np.array([[[0.5], [1.0]], [[0.5], [1.0]]], dtype=complex)
    covariance = np.array([1e-4, 1.0])[:, None, None] * np.eye(2)
    wider, told = widening(values, covariance, 1, 20.0)
    assert told.tolist() == [True, False]
    assert 1 < wider[0] < 1.2
    assert wider[1] == pytest.approx(25)


@pytest.mark.parametrize("seed", seeds(2, 20))
def test_beyond_the_end_of_a_sweep_in_a_loop_no_line_is_told(seed):
    """There both answers to the reference are extrapolated, and their quotient is near the inverse of the controller."""
    rng, samples, dt, gain = np.random.default_rng(seed), 12000, 2e-3, 0.6
    plant = control.c2d(control.ss(control.tf([40], [1, 6, 0]) * control.tf([1], [0.02, 1])), dt)
    sensitivity = control.feedback(control.ss([], [], [], [[1.0]], dt), gain * plant)
    time = np.arange(samples) * dt
    r = 0.5 * scipy.signal.chirp(time, 0.2, time[-1], 30)
    y = control.forced_response(gain * plant * sensitivity, time, r).outputs
    y = y + control.forced_response(sensitivity, time, 0.002 * rng.standard_normal(samples)).outputs
    frf = rid.estimate_frf(rid.TimeRecord(gain * (r - y), y, dt=dt, reference=r))
    true = plant(np.exp(1j * frf.omega * dt))
    assert frf.freq_hz[-1] < 30.5
    assert np.mean(np.abs(frf.values[:, 0, 0] - true) <= frf.bound.radius[:, 0, 0]) > 0.995


@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("count", [3, pytest.param(40, marks=pytest.mark.slow)])
def test_periods_of_a_loop_hold_their_bound_however_large_the_noise(noise, count):
    """Of 12 with noise as large as the reference 6 were outside, with three times that all."""
    dt, period, gain = 2e-3, 1000, 0.8
    plant = control.c2d(control.ss(control.tf([40], [1, 6, 0]) * control.tf([1], [0.02, 1])), dt)
    sensitivity = control.feedback(control.ss([], [], [], [[1.0]], dt), gain * plant)
    outside = 0
    for seed in range(count):
        play = rid.prepare.multisine(band_hz=(0.5, 200), period=period, dt=dt, rms=1.0, seed=seed, minimise_crest=False)
        r = np.tile(play.u[0], (10, 1))[:, 0]
        time = np.arange(r.size) * dt
        v = noise * np.random.default_rng(seed).standard_normal(r.size)
        y = control.forced_response(gain * plant * sensitivity, time, r).outputs
        y = (y + control.forced_response(sensitivity, time, v).outputs)[2 * period :]
        r = r[2 * period :]
        record = rid.TimeRecord(gain * (r - y), y, dt=dt, reference=r, initial="periodic")
        frf = rid.estimate_frf(record, period=period)
        error = np.abs(frf.values[:, 0, 0] - plant(np.exp(1j * frf.omega * dt)))
        outside += bool(np.any(error > frf.bound.radius[:, 0, 0]))
    assert outside <= 0.05 * count + 3 * np.sqrt(0.05 * count)


def test_a_reference_below_the_noise_is_refused():
    rng, samples = np.random.default_rng(0), 2000
    y = rng.standard_normal(samples)
    r = 1e-3 * rng.standard_normal(samples)
    with pytest.raises(
        InputError, match="the reference moves the inputs at no spectral line surely more than noise does"
    ):
        rid.estimate_frf(rid.TimeRecord(0.5 * (r - y), y, dt=1e-3, reference=r))
