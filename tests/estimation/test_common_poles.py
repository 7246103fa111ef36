"""Short records: what common poles explain is taken out before windows are looked at, and its covariance is part of the bound."""

import dataclasses

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.core import responses, simulate
from robustid.data import variances
from robustid.errors import InputError
from robustid.estimation import response_alone
from robustid.estimation.common_poles import predicted
from support.cases import seeds, slow
from support.fault_plants import recipes, record
from support.loop_truths import recorded
from support.processes import process_of
from support.short_records import plant_of, record_of

DT = 1e-3


def spectra_of(plant, u, noise, rng):
    y = plant.output(u)
    y = y + noise * y.std() * rng.standard_normal(y.size)
    return tuple(np.fft.rfft(part)[None, :, None] / u.size for part in (u, y))


def test_modes_that_share_a_window_leave_rounding_errors_alone():
    """Half a second without noise: 2 Hz between lines, three modes and a real pole, which is a fourth pair here."""
    rng = np.random.default_rng(0)
    plant, u = plant_of(rng, DT), rng.standard_normal(500)
    x, z = spectra_of(plant, u, 0.0, rng)
    index = np.arange(1, 249)
    found = predicted(x, z, u.size, index, 249)
    truth = plant.response(2 * np.pi * index / (u.size * DT))
    assert np.max(np.abs(found.values[:, 0, 0] - truth) / np.abs(truth)) < 1e-4
    assert np.max(np.abs(z - found.spectra)[:, 1:250]) < 1e-6 * np.abs(z).max()


@pytest.mark.parametrize("draws", [4, slow(10)])
def test_covariance_is_that_of_many_draws_of_the_noise(draws):
    """Error^2/variance, 1 % noise, of modes alone: no smooth part that windows would have to find. Exponentially distributed."""
    rng = np.random.default_rng(1)
    plant, u = dataclasses.replace(plant_of(rng, DT), rest=(0.0, 500.0)), rng.standard_normal(1000)
    index = np.arange(1, 499)
    truth = plant.response(2 * np.pi * index / (u.size * DT))
    squares = []
    for _ in range(draws):
        x, z = spectra_of(plant, u, 0.01, rng)
        found = predicted(x, z, u.size, index, 499)
        squares.append(np.abs(found.values[:, 0, 0] - truth) ** 2 / found.covariance[:, 0, 0].real)
    assert 0.7 < np.mean(squares) < 1.5
    assert np.quantile(squares, 0.5) == pytest.approx(np.log(2), rel=0.35)


@pytest.mark.parametrize("draws", [10, slow(40)])
def test_covariance_holds_where_all_poles_lie_among_few_lines(draws):
    """Three modes within 9 Hz of a second, of which 22 unknowns follow the noise too: 1.5 with the noise of all lines' unknowns."""
    rng = np.random.default_rng(2)
    plant, u = plant_of(rng, DT), rng.standard_normal(1000)
    plant = dataclasses.replace(
        plant, omega=2 * np.pi * np.array([20.0, 24.0, 28.0]), damping=np.full(3, 0.01), rest=(0.0, 500.0)
    )
    index, near = np.arange(1, 499), slice(14, 33)
    truth = plant.response(2 * np.pi * index / (u.size * DT))
    squares = []
    for _ in range(draws):
        found = predicted(*spectra_of(plant, u, 0.01, rng), u.size, index, 499)
        squares.append((np.abs(found.values[:, 0, 0] - truth) ** 2 / found.covariance[:, 0, 0].real)[near])
    assert 0.7 < np.mean(squares) < 1.3
    assert np.median(squares) == pytest.approx(np.log(2), rel=0.2)


def test_poles_that_meet_leave_the_covariance_of_the_response():
    """Two pairs at one place, nearly real: bounds were 6 times the response, by rounding errors of what the poles err."""
    recipe, rng = recipes()["heater"], np.random.default_rng([16, 3])
    records = [record(recipe, rng, kind="random") for _ in range(2)]
    records = [dataclasses.replace(one, u=one.u[3:], y=one.y[:-3]) for one in records]
    frf = response_alone(records)
    seen = frf.freq_hz < recipe.band_hz[1]
    truth = recipe.plant(np.exp(1j * frf.omega * frf.dt)) * np.exp(-3j * frf.omega * frf.dt)
    assert np.all(np.abs(frf.values[seen, 0, 0] - truth[seen]) <= frf.bound[seen, 0, 0])
    assert np.median(frf.bound[seen, 0, 0] / np.abs(truth[seen])) < 0.1


@pytest.mark.parametrize(
    ("constants", "seeds", "least"), [(None, 10, 7), *(slow(c, 40, 34) for c in (None, 2.0, 20.0))]
)
def test_bounds_of_short_records_hold(constants, seeds, least):
    """Of 95 %, in 34 of 40 seeds or more, 7 of 10: fewer once in 300 or 1000.

    The local method alone: 5 of 40 in half a second, 22 of two constants.

    The intervals of the modes, four deviations on either side, hold in all but one in 40.
    """
    held = shown = 0
    for seed in range(seeds):
        plant, record, _ = record_of(seed, constants)
        frf = response_alone(record)
        held += bool(np.all(np.abs(frf.values[:, 0, 0] - plant.response(frf.omega)) <= frf.bound[:, 0, 0]))
        for omega, damping in zip(plant.omega, plant.damping, strict=True):
            shown += any(a <= omega <= b and c <= damping <= d for a, b, c, d in frf.modes)
    assert held >= least
    assert shown >= 3 * seeds * 0.975


@pytest.mark.parametrize(("slow_pole", "seeds"), [((0.0, 0.2), 2), slow((0.0, 0.2), 25), slow((-0.5, 0.1), 25)])
def test_a_mode_beside_a_slow_pole_keeps_its_bound(slow_pole, seeds):
    """20 Hz of 1 % in two seconds: fits without the integrator, or the pole at .5 rad/s, took that in place of the mode."""
    (rate, part), omega, dt, left = slow_pole, 40 * np.pi, 2e-3, 0
    A = np.array([[rate, 0, 0], [0, 0, omega], [0, -omega, -0.02 * omega]])
    plant = control.c2d(control.ss(A, [[1.0], [0], [1]], [[1, 0.05 * part, 0]], 0), dt, "zoh")
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((1500, 1))
        y = simulate(plant, u, 0.02 * rng.standard_normal(3))[0]
        y = y + 0.01 * np.std(y - np.linspace(y[0], y[-1], 1500)) * rng.standard_normal(y.shape)
        frf = response_alone(rid.TimeRecord(u[500:], y[500:], dt=dt, initial="free"))
        left += bool(np.any(np.abs(frf.values - responses(plant, frf.omega * dt)) > frf.bound.radius))
    assert left <= (0 if seeds == 2 else 3)


def coloured(rng, count, colour):
    """Noise of deviation 1: a resonance of 2 to 5 % damping between 20 and 200 Hz, or red up to 8 Hz."""
    if colour == "red":
        poles = np.array([0.95])
    else:
        pole = np.exp(2 * np.pi * rng.uniform(20, 200) * DT * (-rng.uniform(0.02, 0.05) + 1j))
        poles = np.array([pole, pole.conj()])
    noise = scipy.signal.lfilter([1.0], np.poly(poles).real, rng.standard_normal(count + 2000))[2000:]
    return noise / noise.std()


@pytest.mark.parametrize(
    ("colour", "seeds", "least"),
    [("resonant", 3, 2), *(slow(*each) for each in (("resonant", 10, 7), ("resonant", 40, 34), ("red", 40, 34)))],
)
def test_bounds_hold_in_coloured_noise(colour, seeds, least):
    """A second of three modes, 3 % noise, bounds of 95 %; fewer once in 300 to 1000.

    What is told as a mode is one, but for one in 120: the peak of the noise is not taken for a mode.
    """
    held = told = wrong = 0
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 5])
        plant, u = dataclasses.replace(plant_of(rng, DT), rest=(0.0, 500.0)), rng.standard_normal(1000)
        y = plant.output(u)
        frf = response_alone(rid.TimeRecord(u, y + 0.03 * y.std() * coloured(rng, y.size, colour), dt=DT))
        held += bool(np.all(np.abs(frf.values[:, 0, 0] - plant.response(frf.omega)) <= frf.bound[:, 0, 0]))
        told += len(frf.modes)
        for a, b, c, d in frf.modes:
            wrong += not np.any((a <= plant.omega) & (plant.omega <= b) & (c <= plant.damping) & (plant.damping <= d))
    assert held >= least
    assert told >= 2.5 * seeds
    assert wrong <= max(seeds // 20, 1)


def test_modes_of_a_loop_are_not_those_of_the_plant():
    """With a reference the poles are those of the loop: none are told."""
    _, record, _ = record_of(3)
    loop = rid.TimeRecord(record.u, record.y, dt=record.dt, reference=record.u, initial="free")
    assert rid.estimate_frf(record).modes
    assert not rid.estimate_frf(loop).modes


def test_modes_are_kept_in_files_and_checked(tmp_path):
    _, record, _ = record_of(3)
    frf = rid.estimate_frf(record)
    for name in ("frf.npz", "frf.csv"):
        rid.save(tmp_path / name, frf)
        assert rid.load(tmp_path / name).modes == frf.modes
    unsure = response_alone(process_of(85)[1])
    variance = variances(unsure.covariance, unsure.values.shape)
    np.testing.assert_allclose(unsure.noise**2 + np.abs(unsure.doubt) ** 2 / 2, variance)
    for name in ("unsure.npz", "unsure.csv"):
        rid.save(tmp_path / name, unsure)
        np.testing.assert_allclose(rid.load(tmp_path / name).doubt, unsure.doubt)
    with pytest.raises(InputError, match="`modes` must hold positive ends"):
        rid.FrequencyResponse([10.0], [1.0], modes=[(2.0, 1.0, 0.1, 0.2)])


def test_a_pole_that_runs_to_infinity_ends_no_estimate():
    """A machine in its loop, from u to y: the input follows the noise, and what is ahead of it is one of z, a pole at infinity."""
    _, record, how = recorded(5, periodic=False, level=0.05, samples=2000)
    found = rid.estimate_frf(dataclasses.replace(record, reference=None), **how)
    assert np.all(np.isfinite(found.values))
    assert np.all(np.isfinite(found.bound.outer_radius))


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
def test_a_plant_that_integrates_has_its_pole_and_no_others_in_its_place(seed):
    """A servo valve, from end to end of the record 1 m away. Twelve pairs in place of 1/(z - 1) left bounds to rounding errors."""
    rng, samples = np.random.default_rng(seed), 6000
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 8), 8)
    b, a = scipy.signal.zpk2tf([], [1.0, 0.78 + 0.13j, 0.78 - 0.13j], 1e-4)
    y = scipy.signal.lfilter(np.append(np.zeros(3), b), a, u)
    y += 1e-4 * y.std() * rng.standard_normal(samples)
    record = rid.TimeRecord(u, y, dt=DT)
    found = rid.estimate_frf(record)
    low = found.omega < 2 * np.pi * 30
    truth = scipy.signal.freqz(np.append(np.zeros(3), b), a, found.omega * DT)[1]
    off = np.abs(found.values[:, 0, 0] - truth)
    assert np.all(off <= found.bound.radius[:, 0, 0])
    assert np.median(found.bound.radius[low, 0, 0] / np.abs(truth[low])) < 0.2
    again = rid.estimate_frf(
        dataclasses.replace(record, y=record.y * (1 + 1e-15 * rng.standard_normal(y.shape)[:, None]))
    )
    both = [float(np.median(one.bound.radius[one.omega < 2 * np.pi * 30])) for one in (again, found)]
    assert max(both) < 3 * min(both)


@pytest.mark.parametrize("seed", seeds(2, 20))
def test_real_poles_beside_an_integrator_are_found_in_a_sweep(seed):
    """Narrow pairs hardly become real poles: up to nine lines were off by up to 11 bounds."""
    samples, dt = 20000, 2e-3
    plant = control.c2d(control.ss(control.tf([40], [1, 6, 0]) * control.tf([1], [0.02, 1])), dt)
    time = np.arange(samples) * dt
    u = 0.5 * scipy.signal.chirp(time, 0.2, time[-1], 30)
    noise = 0.002 * np.random.default_rng(seed).standard_normal(samples)
    frf = rid.estimate_frf(rid.TimeRecord(u, control.forced_response(plant, time, u).outputs + noise, dt=dt))
    true = plant(np.exp(1j * frf.omega * dt))
    ratio = np.abs(frf.values[:, 0, 0] - true) / frf.bound.radius[:, 0, 0]
    assert ratio[frf.freq_hz >= 0.2].max() <= 1.2  # 95 % jointly
    assert np.sum(ratio > 1) <= 3
