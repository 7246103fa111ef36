"""Lines that next to nothing excites: left out with a note, and no number of the others moves."""

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.estimation import frf as module
from robustid.estimation import nonperiodic
from robustid.estimation.excited_lines import driven_lines, silent_lines
from robustid.estimation.frf import response_alone
from support.cases import slow
from support.short_records import plant_of

PART = 100  # times the largest response that is known


def part_of_a_sweep(seed, start, count):
    """Of a sweep from 5 to 200 Hz in 40 s, and its plant."""
    rng, dt = np.random.default_rng(seed), 1e-3
    t, plant = np.arange(40_000) * dt, plant_of(np.random.default_rng(seed), dt)
    u = scipy.signal.chirp(t, 5.0, t[-1], 200.0)
    y = plant.output(u)
    y = y + 0.01 * y.std() * rng.standard_normal(y.size)
    return rid.TimeRecord(u[start : start + count], y[start : start + count], dt=dt, initial="free"), plant


def known(frf):
    """The largest response that is larger than its bound."""
    size = np.abs(frf.values)
    return float(np.max(np.where(frf.bound.radius < size, size, 0.0)))


@pytest.mark.parametrize("seed", [1, slow(3), slow(4)])
@pytest.mark.parametrize(("start", "count"), [(3000, 500), slow(10_000, 800), slow(25_000, 2000)])
def test_lines_far_from_a_sweep_are_left_out(monkeypatch, seed, start, count):
    """Their bounds were up to 1.7e7 times every response; they were most of the lines."""
    record, _ = part_of_a_sweep(seed, start, count)
    found = response_alone(record)
    assert found.bound.radius.max() <= PART * known(found)
    assert "more are left out, which next to nothing excites" in found.note
    monkeypatch.setattr(module, "silent_lines", lambda values, _: np.zeros(len(values), bool))
    monkeypatch.setattr(nonperiodic, "driven_lines", lambda x, _: np.ones(x.shape[1], bool))
    full = response_alone(record)
    assert full.bound.radius.max() > 1e4 * known(full)
    there = np.isin(full.omega, found.omega)
    assert np.sum(there) < 0.6 * full.omega.size
    for name in ("values", "covariance", "noise"):
        np.testing.assert_array_equal(getattr(found, name), getattr(full, name)[there])
    np.testing.assert_array_equal(found.bound.radius, full.bound.radius[there])


@pytest.mark.parametrize("seed", [0, 9, *map(slow, range(1, 9)), *map(slow, range(10, 20))])
def test_bounds_hold_where_a_short_part_of_a_sweep_drives_the_plant(seed):
    """Beside these lines is what they leak, as smooth as a transient: bounds were left by up to 40 times, in 11 of 20 seeds."""
    record, plant = part_of_a_sweep(seed, 3000, 500)  # from 19.6 to 22.1 Hz, with 2 Hz between lines
    found = response_alone(record)
    np.testing.assert_allclose(found.freq_hz, [20, 22])
    assert np.all(np.abs(found.values[:, 0, 0] - plant.response(found.omega)) <= found.bound.radius[:, 0, 0])


def test_lines_that_are_driven_stay():
    rng, t = np.random.default_rng(0), np.arange(1000)
    multisine = np.fft.irfft(np.where(np.arange(501) % 3 == 1, np.exp(6.28j * rng.random(501)), 0))
    step, hammer = (t > 300).astype(float), np.exp(-(((t - 100) / 3) ** 2))
    for u in (rng.standard_normal(1000), np.cumsum(rng.standard_normal(1000)), multisine, step, hammer):
        assert driven_lines(np.fft.rfft(u)[None, :, None] / 1000, 14)[1:499].all()


def test_lines_beyond_the_end_of_a_sweep_go():
    u = scipy.signal.chirp(np.arange(1000) / 1000, 20, 1, 200)
    kept = np.flatnonzero(driven_lines(np.fft.rfft(u)[None, :, None] / 1000, 14))
    assert kept.min() <= 20
    assert 200 <= kept.max() < 230


def test_lines_that_are_asked_for_stay():
    record, _ = part_of_a_sweep(1, 3000, 500)
    found = response_alone(record, lines=[10, 11, 80])
    assert found.omega.size == 3
    assert found.bound.radius.max() > PART * known(found)


def test_a_line_stays_for_one_entry_and_where_nothing_is_known():
    values = np.ones((3, 1, 2), complex)
    radius = np.array([[[0.1, 0.1]], [[200.0, 0.1]], [[200.0, 200.0]]])
    assert silent_lines(values, radius).tolist() == [False, False, True]
    assert not silent_lines(values, 2 * radius + 1).any()  # no response is larger than its bound
    assert silent_lines(1e-9 * values, 1e-9 * radius).tolist() == [False, False, True]


def test_lines_of_thrice_the_largest_known_response_say_nothing():
    """A sweep that ends at 180 Hz: beyond 172 Hz bounds up to 100 times the largest response, whose values stood for its size."""
    values = np.ones((4, 1, 1), complex)
    radius = np.array([0.1, 2.9, 3.1, 30.0])[:, None, None]
    assert silent_lines(values, radius).tolist() == [False, False, True, True]
