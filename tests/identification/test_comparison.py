"""Two measurements of one plant differ by chance as rarely as stated; a mode that has moved is found where it is."""

import logging

import control
import numpy as np
import pytest
from scipy.special import chdtrc
from scipy.stats import binom

import robustid as rid
from robustid.core import fingerprint, simulate
from robustid.data import chance_beyond, joint_radius
from robustid.identification import Comparison, Validation
from support.forging import kept

pytestmark = pytest.mark.quick

HZ, DT, PERIOD = 2 * np.pi, 0.01, 200
OMEGA = np.linspace(5.0, 250.0, 120)
POINTS = np.exp(1j * OMEGA * DT)
DAMPING = 0.02


def plant(hz=17.67):
    s = control.tf("s")
    light = 0.3 / (s**2 / (HZ * hz) ** 2 + 2 * DAMPING * s / (HZ * hz) + 1)
    heavy = 1 / (s**2 / (HZ * 9) ** 2 + 0.1 * s / (HZ * 9) + 1)
    return control.sample_system(control.ss(heavy + light), DT)


ONE, MOVED = plant(), plant(17.67 * (1 + DAMPING / 2))  # half of its half-width


def response(rng, system=ONE, level=0.05, **stated):
    errors = level * (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size)) / np.sqrt(2)
    stated = stated or {"covariance": np.full((OMEGA.size, 1, 1), level**2)}
    return rid.FrequencyResponse(OMEGA, system(POINTS) + errors, dt=DT, **stated)


def record(rng, system=ONE, periods=4, level=0.05):
    """Steady state under a periodic excitation of its own."""
    lines, time = np.arange(2, 81), np.arange(PERIOD) * DT
    u = np.cos(np.outer(time, lines * HZ / (PERIOD * DT)) + rng.uniform(0, HZ, lines.size)).sum(1) / 8
    u = np.tile(u, periods + 4)
    y = simulate(system, u[:, None])[0][4 * PERIOD :, 0] + level * rng.standard_normal(periods * PERIOD)
    return rid.TimeRecord(u[4 * PERIOD :], y, dt=DT, initial="periodic")


def rate(count, compared):
    return [compared(np.random.default_rng(seed)).differ for seed in range(count)]


def at_most(found, probability=0.05):
    """So many false alarms, or fewer, are likely (99.9 %) where each has at most that probability."""
    return sum(found) <= binom.ppf(0.999, len(found), probability)


@pytest.mark.parametrize("dof", [3.0, 11.0, 1e9])
def test_chance_is_the_inverse_of_the_radius(dof):
    real = np.array([True, False])
    radius = joint_radius(0.95, 40, np.full((2, 1, 1), dof), real)
    np.testing.assert_allclose(chance_beyond(radius, np.full((2, 1, 1), dof), real), 0.05 / 40, rtol=1e-6)


def test_two_responses_with_known_noise_are_told_apart_at_most_at_the_stated_rate_and_a_moved_mode_is_found():
    assert at_most(rate(60, lambda rng: rid.compare(response(rng), response(rng))))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        found = rid.compare(response(rng), response(rng, MOVED))
        assert found.differ
        assert abs(found.hz - 17.67) < 2 * DAMPING * 17.67
        assert found.where[0].low < 17.9
        assert found.where[0].high > 17.3


def test_the_sum_of_known_noise_is_chi_square():
    """Of one frequency point in each block the mean over blocks is the smaller witness: the sum decides."""
    rng = np.random.default_rng(1)
    first, second = response(rng), response(rng, level=0.09)
    size = np.abs(second.values - first.values) ** 2 / (0.05**2 + 0.09**2)
    found = rid.compare(first, with_level(second, 0.09))
    np.testing.assert_allclose(-np.log(found.chance), size, rtol=1e-6)
    assert found.together >= chdtrc(2 * size.size, 2 * size.sum()) * (1 - 1e-6)


def with_level(frf, level):
    return rid.FrequencyResponse(OMEGA, frf.values, dt=DT, covariance=np.full((OMEGA.size, 1, 1), level**2))


def test_a_small_difference_everywhere_is_found_by_all_points_together():
    rng = np.random.default_rng(0)
    found = rid.compare(response(rng), response(rng, ONE + 0.06))
    assert found.differ
    assert found.together < 1e-3 < found.largest


@pytest.mark.slow
@pytest.mark.parametrize("periods", [2, 4])
def test_two_estimates_of_one_plant_are_told_apart_at_most_at_the_stated_rate(periods):
    found = rate(200, lambda rng: rid.compare(record(rng, ONE, periods), record(rng, ONE, periods), period=PERIOD))
    assert at_most(found)


@pytest.mark.slow
def test_records_without_periods_are_told_apart_at_most_at_the_stated_rate():
    def one(rng, system):
        u = rng.standard_normal(800)
        y = simulate(system, u[:, None])[0][:, 0] + 0.05 * rng.standard_normal(800)
        return rid.TimeRecord(u, y, dt=DT)

    assert at_most(rate(40, lambda rng: rid.compare(one(rng, ONE), one(rng, ONE))))
    found = rid.compare(one(np.random.default_rng(0), ONE), one(np.random.default_rng(1), MOVED))
    assert found.differ


def test_records_are_compared_by_their_responses_and_a_moved_mode_is_found(caplog):
    rng = np.random.default_rng(3)
    one, same, moved = record(rng), record(rng), record(rng, MOVED)
    assert not rid.compare(one, same, period=PERIOD).differ
    found = rid.compare(one, moved, period=PERIOD)
    assert found.differ
    assert abs(found.hz - 17.67) < 1
    assert "first and second: from one excitation" in found.summary()
    # a record beside a response
    again = rid.compare(rid.estimate_frf(one, period=PERIOD), moved, period=PERIOD)
    assert again.by_chance == found.by_chance
    assert not [r for r in caplog.records if r.levelno > logging.WARNING]


def test_a_hard_bound_explains_all_that_it_allows_and_nothing_more():
    first = rid.FrequencyResponse(OMEGA, np.ones(120), bound=0.1, dt=DT)
    for offset, differ in ((0.199, False), (0.201, True)):
        found = rid.compare(first, rid.FrequencyResponse(OMEGA, np.full(120, 1 + offset), bound=0.1, dt=DT))
        assert found.differ is differ
        assert found.by_chance == (0.0 if differ else 1.0)
    # beside noise it widens what that explains
    noisy = response(np.random.default_rng(0))
    hard = rid.FrequencyResponse(OMEGA, ONE(POINTS), bound=0.3, dt=DT)
    assert rid.compare(noisy, hard).chance.min() > 0.9
    # a confidence bound stands for the noise that gave it
    bounded = response(np.random.default_rng(0)).with_joint_bound(0.95)
    alone = rid.FrequencyResponse(OMEGA, bounded.values, bound=bounded.bound, dt=DT)
    other = response(np.random.default_rng(1))
    np.testing.assert_allclose(rid.compare(alone, other).chance, rid.compare(bounded, other).chance, rtol=1e-6)


def test_one_response_twice_is_alike_and_zero_noise_forgives_rounding_only():
    frf = response(np.random.default_rng(0))
    assert rid.compare(frf, frf).by_chance == 1.0
    exact = rid.FrequencyResponse(OMEGA, frf.values, covariance=np.zeros((120, 1, 1)), dt=DT)
    turned = rid.FrequencyResponse(OMEGA, frf.values * (1 + 1e-14), covariance=np.zeros((120, 1, 1)), dt=DT)
    assert not rid.compare(exact, turned).differ
    assert rid.compare(
        exact, rid.FrequencyResponse(OMEGA, frf.values + 1e-6, covariance=np.zeros((120, 1, 1)), dt=DT)
    ).differ


def test_entries_are_compared_each_with_its_noise_and_what_is_missing_is_left_out():
    rng = np.random.default_rng(5)
    level = np.array([[0.01, 0.1], [0.02, 0.05]])

    def measured(offset=0.0):
        errors = rng.standard_normal((2, 120, 2, 2)) / np.sqrt(2)
        values = np.ones((120, 2, 2)) + level * (errors[0] + 1j * errors[1])
        values[40, 1, 0] += offset
        covariance = np.broadcast_to(np.diag(level.T.ravel() ** 2), (120, 4, 4))
        bound = np.ones((120, 2, 2))
        bound[7, 0, 1] = np.inf
        return rid.FrequencyResponse(OMEGA, values, covariance=covariance, bound=bound, dt=DT)

    assert not rid.compare(measured(), measured()).differ
    found = rid.compare(measured(), measured(0.3))
    assert found.most == (40, 1, 0)
    assert [(one.output, one.input, one.worst) for one in found.where] == [(1, 0, 40)]
    assert np.isnan(found.chance[7, 0, 1])
    assert "y2 / u1" in found.summary()
    rows = found.to_dataframe()
    assert len(rows) == 4 * 120 - 1
    assert rows.loc[rows["chance"].idxmin(), ["output", "input"]].tolist() == ["y2", "u1"]


def test_scales_of_signals_and_of_time_change_nothing():
    rng = np.random.default_rng(0)
    pair = response(rng), response(rng, MOVED)
    scaled = [
        rid.FrequencyResponse(2.0**20 * OMEGA, 2.0**-40 * f.values, covariance=2.0**-80 * f.covariance, dt=DT / 2**20)
        for f in pair
    ]
    np.testing.assert_array_equal(rid.compare(*scaled).chance, rid.compare(*pair).chance)


def test_a_comparison_comes_back_from_its_files(tmp_path):
    rng = np.random.default_rng(0)
    found = rid.compare(response(rng), response(rng, MOVED), probability=0.99)
    again = kept(found, tmp_path / "compared")
    assert isinstance(again, Comparison)
    assert again.by_chance == found.by_chance
    assert fingerprint(again) == fingerprint(found)


def test_a_model_beside_data_is_validated():
    rng = np.random.default_rng(0)
    data = response(rng, level=0.01, bound=0.05)
    found = rid.compare(data, ONE)
    assert isinstance(found, Validation)
    assert found.ratio == rid.compare(ONE, data).ratio == rid.validate(ONE, data).ratio
    assert isinstance(rid.compare(ONE, data.to_control()), Validation)


@pytest.mark.parametrize(
    ("a", "b", "options", "sentence"),
    [
        ("model", "model", {}, "`a` or `b` must be a measurement.*nu_gap"),
        ("model", "frf", {"period": 3}, "`period` is for two measurements"),
        ("frf", "elsewhere", {}, "no frequency point in common"),
        ("frf", "wide", {}, "must have the same signals"),
        ("frf", "metres", {}, "same units; got y .mm. and y .m.: convert"),
        ("frf", "slow", {}, "same sample time; got 0.01 s and 0.005 s"),
        ("frf", "bare", {}, "`second` has neither a covariance nor a bound.*estimate_bound"),
        ("frf", "frf", {"probability": 95}, "`probability`"),
        ("frf", "directions", {}, "response in directions"),
        ("frf", [], {}, "validate|must be a control.StateSpace"),
    ],
)
def test_what_can_not_be_compared_says_why(a, b, options, sentence):
    frf = response(np.random.default_rng(0), bound=0.1)
    with_unit = rid.FrequencyResponse(OMEGA, frf.values, bound=0.1, dt=DT, outputs=["y [mm]"])
    things = {
        "frf": with_unit,
        "model": ONE,
        "elsewhere": rid.FrequencyResponse([1.0, 2.0], [1.0, 1.0], bound=0.1, dt=DT),
        "wide": rid.FrequencyResponse(OMEGA, np.ones((120, 2, 1)), bound=0.1, dt=DT),
        "metres": rid.FrequencyResponse(OMEGA, frf.values, bound=0.1, dt=DT, outputs=["y [m]"]),
        "slow": rid.FrequencyResponse(OMEGA, frf.values, bound=0.1, dt=DT / 2),
        "bare": rid.FrequencyResponse(OMEGA, frf.values, dt=DT),
        "directions": frf.tangential(right=[1.0]),
    }
    with pytest.raises(rid.RobustIdError, match=sentence):
        rid.compare(*(things[one] if isinstance(one, str) else one for one in (a, b)), **options)
