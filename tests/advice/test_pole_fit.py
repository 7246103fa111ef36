"""The fit of damped pairs beside a smooth remainder: its derivatives, and a minimum that a finer search does not lower."""

import itertools

import numpy as np
import pytest
import scipy.optimize

import robustid as rid
from robustid.advice import pole_fit, step_clock, suggest_kautz
from robustid.core import ZPlane
from robustid.errors import SizeError

pytestmark = pytest.mark.quick

POLES = np.log([[0.56, 0.12], [1.108, 0.005]])  # angle and damping, near those of the simulated structure


@pytest.fixture(scope="module")
def data():
    frf = rid.datasets.flexible_structure(lines=40, extra_hz=np.linspace(17.2, 18.1, 10)).frequency
    return pole_fit.line_data([frf], ZPlane(frf.dt))


def test_pairs_change_as_their_differences_say():
    angle, step = np.linspace(0.1, 3, 50), 1e-6
    for pole in POLES:
        for e, change in zip(step * np.eye(2), pole_fit.pair_changes(angle, pole), strict=True):
            quotient = (pole_fit.pole_pair(angle, pole + e) - pole_fit.pole_pair(angle, pole - e)) / (2 * step)
            np.testing.assert_allclose(change, quotient, atol=1e-8 * np.abs(quotient).max())


def test_the_gradient_is_that_of_differences_and_vanishes_at_the_end(data):
    """Kaufman's Jacobian leaves out terms of the size of the residual, which the gradient J'r does not see."""

    def gradient(poles):
        return 2 * pole_fit.residual_slopes(poles, data).T @ pole_fit.residual_rows(poles, data)

    start = POLES.ravel()
    cost = [[np.sum(pole_fit.residual_rows(start + e, data) ** 2) for e in (step, -step)] for step in 1e-6 * np.eye(4)]
    np.testing.assert_allclose(gradient(start), np.diff(cost)[:, 0] / -2e-6, rtol=1e-5)
    end = pole_fit.refine(POLES, data)
    assert np.abs(gradient(end.ravel())).max() < 1e-6 * np.abs(gradient(start)).max()
    finer = scipy.optimize.least_squares(
        pole_fit.residual_rows, end.ravel(), args=(data,), method="lm", xtol=1e-15, ftol=1e-15
    )
    np.testing.assert_allclose(finer.x.reshape(-1, 2), end, atol=1e-7)


def test_gains_of_many_pairs_are_those_of_one_fit_after_the_other(data):
    tried = np.log(np.array([[0.4, 0.01], [0.9, 0.1], [1.1, 0.004], [2.0, 0.05]]))
    before = pole_fit.residual_rows(POLES[:1], data)
    slow = [before @ before - np.sum(pole_fit.residual_rows(np.vstack([POLES[:1], pole]), data) ** 2) for pole in tried]
    fast = pole_fit._gains(data, pole_fit._projected(data, POLES[:1])[0], pole_fit._first_functions(data.angle, tried))
    np.testing.assert_allclose(fast, slow, rtol=1e-7, atol=1e-7 * (before @ before))
    assert pole_fit.design(data, POLES).shape[1] == 7


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k >= 2 else k for k in range(4)])
def test_modes_that_are_small_beside_others_are_found(seed):
    """Each a ten-thousandth of the sum of squares and half of what is left, but all that there is around it."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.05, 3.0, 600)
    values = sum(
        size * (pole_fit.pole_pair(angle, np.log([turn, zeta])) @ [1.0, -0.9])
        for size, turn, zeta in ((1.0, 0.5, 0.01), (1.0, 1.8, 0.02), (0.01, 1.0, 0.01), (0.01, 2.5, 0.01))
    )
    noise = 0.01 * np.exp(2j * np.pi * rng.random(600)) * np.sqrt(rng.random(600))
    small = rid.FrequencyResponse(angle, values + noise, bound=0.01, dt=1.0)
    data = pole_fit.line_data([small], ZPlane(1.0))
    poles, reason = pole_fit.find_poles(data, None, step_clock.StepClock(*data.size, None))
    found = np.exp(poles[np.argsort(poles[:, 0])])
    assert len(found) == 4, reason
    np.testing.assert_allclose(found[:, 0], [0.5, 1.0, 1.8, 2.5], rtol=0.01)


def test_of_modes_that_lie_together_the_second_counts_for_both():
    """A duct of 12 modes: one more than eight alone removes little, and it ended there, 3.5 bounds off."""
    rng, hz = np.random.default_rng(5), np.arange(10, 1000, 2.5)
    natural, damping, gain = np.sort(rng.uniform(40, 950, 12)), rng.uniform(0.008, 0.03, 12), rng.standard_normal(12)
    parts = zip(natural, damping, gain, strict=True)
    values = sum(c * hz**2 / (hz**2 - 2j * z * w * hz - w**2) for w, z, c in parts)
    bound = 0.12 * np.median(np.abs(values))
    noise = 0.15 * bound * (rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size))
    data = pole_fit.checked_lines(rid.FrequencyResponse(2 * np.pi * hz, values + noise, bound=bound), None)
    _, reason = pole_fit.find_poles(data, None, step_clock.StepClock(*data.size, None))
    assert "keep all frequency points in bounds" in reason


def test_a_search_that_takes_longer_than_its_limit_is_refused_before_it_begins():
    """A mode of 400 entries takes 8 s; the first step is expected by its number of multiplications."""
    values = np.random.default_rng(0).normal(size=(200, 100, 4)) + 0j
    large = rid.FrequencyResponse(np.linspace(0.01, 3, 200), values, bound=0.1, dt=1.0)
    with pytest.raises(SizeError, match=r"400 entries of 200 frequency points: 0 modes found .* about 8 s.* is 6 s"):
        suggest_kautz(large, time_limit=6.0)


def test_no_step_begins_that_ends_after_the_search_if_it_takes_as_long_as_the_longest_before(data, monkeypatch):
    """Of 10 s the search has 6.5: 4.7 s after its start there is no time for another step of 2 s."""
    times = iter((0.0, 0.0, 1.0, 3.0, 4.7))
    monkeypatch.setattr(step_clock.time, "monotonic", lambda: next(times))
    clock = step_clock.StepClock(*data.size, 10.0)
    assert [clock.begins() for _ in range(3)] == [True, True, True]
    assert not clock.ended
    assert not clock.begins()
    assert clock.ended
    assert "3 modes after 4.7 s, and the next step takes about 2 s" in str(clock.refuse("3 modes"))


def test_a_search_without_time_for_the_next_mode_keeps_what_it_has_found(monkeypatch):
    """Of two modes, which both count where they are asked for; a second passes at every look at the clock."""
    frf = rid.datasets.flexible_structure(lines=40, extra_hz=np.linspace(17.2, 18.1, 10)).frequency
    whole, seconds = suggest_kautz(frf), itertools.count()
    monkeypatch.setattr(step_clock, "_PATIENCE", 0.0)
    monkeypatch.setattr(step_clock.time, "monotonic", lambda: float(next(seconds)))
    found = suggest_kautz(frf, time_limit=4.0)
    assert (whole.omega.size, whole.complete) == (2, True)
    assert (found.omega.size, found.complete) == (1, False)
    nearest = np.argmin(np.abs(whole.omega - found.omega[0]))
    assert found.omega[0] == pytest.approx(whole.omega[nearest], rel=0.02)
    assert found.omega_interval[0, 0] < found.omega[0] < found.omega_interval[0, 1]
    with pytest.raises(SizeError, match="1 mode found"):
        suggest_kautz(frf, modes=2, time_limit=4.0)
