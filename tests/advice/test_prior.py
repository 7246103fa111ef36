"""Priors from data: closed forms, and the threshold at which an identification becomes consistent."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_prior
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
    found = suggest_prior(structure_problem(slice(0, 0)))
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


@pytest.mark.parametrize("power", [60, -60])
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
