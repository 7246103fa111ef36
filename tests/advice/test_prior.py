"""Priors from data: closed forms, and the threshold at which an identification becomes consistent."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import says_something, suggest_prior, useful_prior
from robustid.advice.smallest_gain import smallest_gain, without_doubt
from robustid.errors import InputTypeError, SizeError
from support.refusals import refusals
from support.structure import ANY, structure_problem


def test_smallest_gain_of_two_taylor_coefficients():
    # |g1| rho <= K (1 - (g0/K)^2): with g0 free in +-0.1 around 0 the best is g0 = 0, K = rho (0.7 - 0.1).
    record = rid.TimeRecord([1.0, 0.0], [0.0, 0.7], dt=1.0, bound=0.1)
    rates = np.array([1.01, 1.2, 1.5, 3.0])
    found = suggest_prior(rid.MixedProblem(time=record, prior=ANY), decay_rates=rates)
    np.testing.assert_allclose(found.gains, 0.6 * rates, rtol=1.1e-3)
    assert np.all(found.gains >= 0.6 * rates * (1 - 1e-9))
    # K rho/(rho^2 - 1) = 0.6 rho^2/(rho^2 - 1) falls all the way
    assert found.prior.decay_rate == 3.0
    assert found.prior.gain_bound == pytest.approx(found.safety * found.gains[-1])


@pytest.mark.parametrize(("which", "rho"), [(slice(0, 0), 1.05), (slice(1, 2), 1.09), (slice(0, 1), 1.05)])
def test_smallest_gain_is_the_threshold_of_identify(which, rho):
    problem = structure_problem(which)
    gain = float(suggest_prior(problem, decay_rates=[rho]).gains[0])
    above, below = (rid.identify(problem.with_prior(gain_bound=f * gain, decay_rate=rho)) for f in (1.0001, 0.99))
    assert above.consistent
    assert below.margin_lower > 1  # with its certificate


def test_curve_rises_and_the_knee_is_inside():
    found = suggest_prior(structure_problem(slice(0, 0), lines=7, samples=6))
    assert np.all(np.diff(found.gains) > 0)
    assert found.decay_rates[0] < found.prior.decay_rate < found.decay_rates[-1]
    assert "exceeds the largest response" in found.reason  # the light mode can't be a smooth remainder
    assert found.summary().count("<- recommended") == 1


def test_placeholder_prior_is_not_used():
    problem = structure_problem(slice(0, 1))
    one = suggest_prior(problem, decay_rates=[1.05, 1.1])
    two = suggest_prior(problem.with_prior(gain_bound=1e-9, decay_rate=7.0), decay_rates=[1.1, 1.05])
    np.testing.assert_array_equal(one.gains, two.gains)
    assert one.prior == two.prior


@pytest.mark.parametrize("power", [60, pytest.param(-60, marks=pytest.mark.slow)])
def test_prior_does_not_depend_on_units(power):
    factor, data = 2.0**power, rid.datasets.flexible_structure()
    omega, values, bound = (factor * getattr(data.frequency, name) for name in ("omega", "values", "bound"))
    frequency = rid.FrequencyResponse(omega, values, bound=bound, dt=0.01 / factor)
    time = rid.TimeRecord(data.time.u, data.time.y * factor, bound=data.time.bound * factor, dt=0.01 / factor)
    one = suggest_prior(structure_problem(slice(0, 0)), decay_rates=[1.05, 1.1])
    two = suggest_prior(rid.MixedProblem(frequency=frequency, time=time, prior=ANY), decay_rates=[1.05, 1.1])
    np.testing.assert_allclose(two.gains, one.gains * factor, rtol=1e-9)
    assert two.prior.decay_rate == one.prior.decay_rate


def test_parametric_part_alone_gives_a_small_multiple_of_the_bounds():
    for seed in range(3):  # the truth is in the span of the two pairs
        found = suggest_prior(structure_problem(slice(0, 2), seed=seed), decay_rates=[1.1, 1.3])
        assert np.all(found.gains == 0)
        assert found.prior.gain_bound == pytest.approx(2 * 0.03)


def in_doubt(doubt, values=None):
    """A known pole, a rest, and noise of 0.01, in a bound that holds a doubt at the first six lines, too."""
    omega = np.linspace(0.05, 1.5, 25)
    z, known = np.exp(1j * omega), rid.kautz(np.array([0.1]), np.array([1.0]), dt=1.0)
    values = 0.1 / (z - np.exp(-0.1)) + 0.3 / (z - 0.5) if values is None else values
    unsure = np.where(np.arange(25) < 6, doubt, 0.0)
    parts = {"noise": np.full(25, 0.01), "doubt": unsure, "covariance": (1e-4 + unsure**2 / 2).reshape(-1, 1, 1)}
    frf = rid.FrequencyResponse(omega, values, dt=1.0, **parts).with_joint_bound()
    return rid.MixedProblem(frequency=frf, parametric=known, prior=ANY)


def of_halves(added):
    """The same, where halves of the measurement differ at these lines."""
    problem = in_doubt(np.sqrt(2) * added)
    (frf,) = problem.frequency
    return dataclasses.replace(
        problem, frequency=dataclasses.replace(frf, doubt=None, changed=np.abs(frf.doubt) / np.sqrt(2))
    )


@pytest.mark.parametrize("wider", [in_doubt, of_halves])
def test_a_class_is_not_smaller_for_bounds_that_are_wider_for_more_than_noise(wider):
    """Inside the wider bounds .7 of the gain bound holds the data: a band of that class would be the narrower for the doubt."""
    sure, wide = (suggest_prior(wider(doubt), decay_rates=[1.05, 1.1]) for doubt in (0.0, 0.1))
    assert smallest_gain(wider(0.1), 1.1) < 0.8 * smallest_gain(wider(0.0), 1.1)
    np.testing.assert_allclose(wide.gains, sure.gains, rtol=1e-6)
    assert wide.prior.gain_bound == pytest.approx(sure.prior.gain_bound, rel=1e-6)
    assert rid.identify(dataclasses.replace(wider(0.1), prior=wide.prior)).consistent


@pytest.mark.parametrize("wider", [in_doubt, pytest.param(of_halves, marks=pytest.mark.slow)])
def test_nor_is_a_useful_one(wider):
    assert useful_prior(wider(0.1)).prior.gain_bound == pytest.approx(
        useful_prior(wider(0.0)).prior.gain_bound, rel=1e-6
    )


def test_where_only_the_doubt_holds_the_data_it_counts():
    values = (
        in_doubt(0.0).frequency[0].values + np.where(np.arange(25) < 6, 0.2 * (-1.0) ** np.arange(25), 0)[:, None, None]
    )
    problem = in_doubt(0.2, values)
    found = suggest_prior(problem, decay_rates=[1.1])
    assert says_something(problem, found)
    assert not says_something(in_doubt(0.0, values), suggest_prior(in_doubt(0.0, values), decay_rates=[1.1]))


def test_a_bound_that_was_stated_holds_no_doubt():
    problem = in_doubt(0.1)
    assert without_doubt(problem) is not problem
    stated = dataclasses.replace(problem, frequency=problem.frequency[0].with_bound(0.03))
    assert without_doubt(stated) is stated
    certain = in_doubt(0.0).frequency[0]
    without = without_doubt(problem).frequency[0]
    np.testing.assert_allclose(without.bound.radius, certain.bound.radius)
    assert without.doubt is None  # it is taken out once


def test_contradictory_samples_have_no_prior():
    frf = rid.FrequencyResponse([1.0, 1.0, 2.0], [1.0, 2.0, 1.0], bound=0.1, dt=0.1)
    found = suggest_prior(rid.MixedProblem(frequency=frf, prior=ANY))
    assert found.prior is None
    assert np.all(np.isinf(found.gains))
    assert "samples contradict each other" in found.summary()


test_suggest_prior_refuses = refusals(
    ((None, None), "`problem` must be a MixedProblem; got NoneType", InputTypeError),
    ((structure_problem(slice(0, 0)), [1.0, 1.1]), "`decay_rates` must hold numbers above 1"),
    ((structure_problem(slice(0, 0)), []), "`decay_rates` must hold numbers above 1"),
    ((structure_problem(slice(0, 0)), [np.nan]), "`decay_rates` must be finite"),
    ((structure_problem(slice(0, 0)), 1.1), "`decay_rates` must have 1 dimension"),
    ((structure_problem(slice(0, 0), samples=300), [1.0005]), "322 coefficients where up to", SizeError),
    of=lambda problem, rates: suggest_prior(problem, decay_rates=rates),
)


# --- weights from tables


@pytest.mark.parametrize("dt", [None, 0.01])
def test_the_weight_is_above_its_table_and_near_to_it(dt):
    omega, level = np.array([0.0, 2.0, 30.0, 60.0, 300.0]), np.array([3.0, 3.0, 2.0, 0.5, 0.02])
    weight = rid.advise.prior_weight(omega, level, dt=dt)
    grid = np.geomspace(0.01, 314.0, 800)
    inside = np.maximum(grid, 2.0)
    known = np.exp(np.interp(np.log(inside), np.log(omega[1:]), np.log(level[1:])))
    ratio = np.abs(weight(np.exp(1j * grid * dt) if dt else 1j * grid)) / known
    assert ratio.min() >= 1 - 1e-9
    assert ratio.max() < 2.0
    assert weight.nstates <= 4
    prior = rid.Prior(gain_bound=1.0, decay=1.5, weight=weight)
    frf = rid.FrequencyResponse([20.0, 100.0], [1.0, 0.1], bound=0.05, dt=dt)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
    # A level that the data exceed.
    far = frf.select([1])
    low = rid.advise.prior_weight(omega, level / 20, dt=dt)
    small = rid.Prior(gain_bound=1.0, decay=1.5, weight=low)
    assert not rid.identify(rid.MixedProblem(frequency=far, prior=small)).consistent
    assert found.verification.passed


test_wrong_tables_are_refused_with_a_sentence = refusals(
    (([1.0], [1.0]), "two at least; got 1 frequencies"),
    (([1.0, 2.0], [1.0]), "got 2 frequencies and 1 levels"),
    (([2.0, 1.0], [1.0, 1.0]), "must rise"),
    (([1.0, 2.0], [1.0, -20.0]), "not in dB"),
    (([1.0, 400.0], [1.0, 1.0]), "must not exceed pi/dt"),
    (([1.0, np.nan], [1.0, 1.0]), "`omega`"),
    of=lambda omega, level: rid.advise.prior_weight(omega, level, dt=0.01),
)


# --- roll-off


def problem_of(values, omega, dt=None, **more):
    frf = rid.FrequencyResponse(omega, values, bound=0.002, dt=dt)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=4.0, **more))


@pytest.mark.parametrize("dt", [None, pytest.param(0.02, marks=pytest.mark.slow)])
def test_a_roll_off_that_the_data_show(dt):
    omega = np.linspace(1.0, 60.0, 16)
    problem = problem_of(1 / (1 + 1j * omega / 8) ** 2, omega, dt)
    found = rid.advise.suggest_roll_off(problem)
    assert found.roll_off == 2
    assert 5 < found.corner < 25
    plain = rid.suggest_prior(problem, decay_rates=[found.rate]).prior
    assert found.gain_bound < 1.3 * plain.gain_bound
    far = [150.0]
    both = [rid.identify(rid.MixedProblem(frequency=problem.frequency, prior=p)).require() for p in (found, plain)]
    widths = [rid.worst_case_error(one, omega=far, directions=4).upper.item() for one in both]
    assert widths[0] < (0.1 if dt is None else 0.5) * widths[1]


def test_none_where_the_data_do_not_fall_or_the_modes_do_all():
    omega = np.linspace(1.0, 60.0, 12)
    assert rid.advise.suggest_roll_off(problem_of((8 - 1j * omega) / (8 + 1j * omega), omega)) is None
    assert rid.advise.suggest_roll_off(problem_of(np.zeros(12), omega)) is None
    with pytest.raises(rid.InputError, match="roll-off or a weight already"):
        rid.advise.suggest_roll_off(problem_of(np.ones(12), omega, roll_off=2, corner=10.0))


MORE = (0.6, 1), (0.7, 2), (0.7, 3)


@pytest.mark.parametrize(("damping", "seed"), [(0.6, 0), *(pytest.param(*one, marks=pytest.mark.slow) for one in MORE)])
def test_a_plant_that_answers_at_once_with_its_largest_response_has_a_useful_prior(seed, damping):
    """A notch beside two real poles in the place of its damped pair: its gain at high frequencies is in every K."""
    import control

    dt, rng, w = 1e-3, np.random.default_rng(seed), 2 * np.pi * 50
    notch = control.tf([1, 0.01 * w, w**2], [1, 2 * damping * w, w**2])
    omega = 2 * np.pi * np.arange(1.0, 400.0)
    values = control.c2d(notch, dt)(np.exp(1j * omega * dt))
    error = 0.005 * (rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size))
    frf = rid.FrequencyResponse(omega, values + error, bound=0.022, dt=dt)
    poles = rid.kautz([w], [1.0], dt=dt, repeat=2)
    problem = rid.MixedProblem(frequency=frf, parametric=poles, prior=ANY)
    found = useful_prior(problem)
    assert says_something(problem, found)
    assert rid.identify(dataclasses.replace(problem, prior=found.prior)).consistent
