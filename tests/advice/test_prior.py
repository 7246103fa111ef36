"""Priors from data: closed forms, and the threshold at which an identification becomes consistent."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import computable_step, gain_curve, kept_gains, prior, says_something, suggest_prior, useful_prior
from robustid.advice.sensitivity import guaranteed
from robustid.advice.smallest_gain import gain_bounds, missed, selected, smallest_gain, thinned, without_doubt
from robustid.core import Budget
from robustid.errors import InputTypeError, SizeError
from robustid.identification.formulation import formulate
from support.cases import seeds
from support.interrupts import ctrl_c_when
from support.refusals import refusals
from support.structure import ANY, about_structure, structure_problem


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
    assert useful_prior(wider(0.1)).prior.gain_bound == pytest.approx(
        useful_prior(wider(0.0)).prior.gain_bound, rel=1e-6
    )
    assert rid.identify(dataclasses.replace(wider(0.1), prior=wide.prior)).consistent


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


# --- a part of many frequency points


def dense(lines=150, seed=0):
    """Many frequency points of the structure, its light mode in the parametric part, the damped one left to the rest."""
    return about_structure(rid.datasets.flexible_structure(seed=seed, lines=lines), 1.0, 1.5)


def test_points_lie_densely_at_the_modes_and_everywhere_a_few():
    problem = dense()
    (mask,) = thinned(problem, 40)
    hz = problem.frequency[0].freq_hz
    assert 35 <= mask.sum() <= 40
    assert mask[0]
    assert mask[-1]
    assert np.diff(hz[mask]).max() < 3 * (hz[-1] - hz[0]) / 40
    near = np.abs(hz - 17.67) < 0.25
    assert mask[near].mean() > 2 * mask[~near].mean()
    (few,) = thinned(problem, 400)
    assert few.all()


def test_points_that_a_model_misses_join():
    problem = dense()
    masks = thinned(problem, 40)
    model = rid.identify(selected(problem, masks).with_prior(gain_bound=0.06, decay_rate=1.3)).model
    assert missed(problem, masks, model) is None
    frf = problem.frequency[0]
    values = frf.values.copy()
    left = int(np.flatnonzero(~masks[0])[50])
    values[left] += 1.0
    wrong = dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=values))
    (joined,) = missed(wrong, masks, model)
    assert np.flatnonzero(joined & ~masks[0]).tolist() == [left]


def test_prior_of_many_points_is_consistent_with_all_of_them_and_says_something():
    problem = dense(70)
    found = suggest_prior(problem)
    assert found.points < 56
    assert found.decay_rates[0] - 1 > 2 * np.median(np.diff(problem.angles))
    stated = dataclasses.replace(problem, prior=found.prior)
    assert rid.identify(stated).consistent
    omega = problem.frequency[0].omega
    on, between = omega[[20, 60]], (omega[[20, 60]] + omega[[21, 61]]) / 2
    assert guaranteed(stated, between)[1] < 3 * guaranteed(stated, on)[1]


def test_a_search_that_ran_out_of_time_or_was_interrupted_returns_what_is_there():
    problem = dense(lines=20)
    late = suggest_prior(problem, time_limit=1e-9)
    assert late.decay_rates.size == 1
    assert not late.complete
    stopped = suggest_prior(problem, progress=ctrl_c_when(lambda text, done, count: (done, count) == (2, 9)))
    assert stopped.decay_rates.size == 2
    assert not stopped.complete


def risen(seed, monkeypatch):
    """A problem, gains that rise with the decay rate and with points that join four times, and a list of those asked for.

    They take the place of those of programs; who judges knows all of them.
    """
    rng, asked = np.random.default_rng(seed), []
    frf = rid.FrequencyResponse(np.linspace(0.1, 3.0, 200), np.ones(200), bound=0.01, dt=1.0)
    problem = rid.MixedProblem(frequency=frf, prior=ANY)
    steps = rng.uniform(0, 1, (5, 9)) * rng.choice([0.02, 0.3, 3.0], (5, 9))
    every = 0.1 * np.exp(np.cumsum(np.cumsum(steps, axis=1), axis=0))
    rates, first = gain_curve.default_rates(problem), int(gain_curve.representatives(problem)[0].sum())

    def gain(part, rate, *_):
        asked.append((sum(f.omega.size for f in part.frequency), rate))
        return float(every[(asked[-1][0] - first) // 8, int(np.argmin(np.abs(rates - rate)))])

    def more(_, masks, __):
        (mask,) = masks
        return None if mask.sum() == first + 32 else (mask | (~mask & (np.cumsum(~mask) <= 8)),)

    monkeypatch.setattr(kept_gains, "smallest_gain", gain)
    monkeypatch.setattr(prior, "missed", more)
    for module in (prior, gain_curve):
        monkeypatch.setattr(module, "lighter", lambda whole, part, rate: part)
    monkeypatch.setattr(prior, "_of_all", lambda problem, found, budget: found)
    monkeypatch.setattr(prior, "identify", lambda *_, **__: problem)
    monkeypatch.setattr(type(problem), "model", None, raising=False)
    return problem, every, asked


@pytest.mark.parametrize("seed", seeds(1, 20))
def test_where_points_joined_the_gain_is_computed_as_often_as_the_smallest_slope_asks_for(seed, monkeypatch):
    problem, every, asked = risen(seed, monkeypatch)
    rates, first = gain_curve.default_rates(problem), int(gain_curve.representatives(problem)[0].sum())
    found = suggest_prior(problem)
    last = every[(found.points - first) // 8]
    slopes = [rid.Prior(gain_bound=found.safety * k, decay_rate=r).slope for k, r in zip(last, rates, strict=True)]
    assert found.points == first + 32
    assert found.prior.decay_rate == rates[int(np.argmin(slopes))]
    assert found.prior.gain_bound == pytest.approx(found.safety * last[int(np.argmin(slopes))])
    assert np.all(found.gains <= last * (1 + 1e-12))
    assert len(asked) <= 45


def test_bounds_of_the_smallest_gain_close_on_it():
    problem = dense(70)
    pairs = list(gain_bounds(problem, 1.05))
    gain = smallest_gain(problem, 1.05)
    below, above = np.array(pairs).T
    assert len(pairs) > 3
    assert pairs[-1] == (gain, gain)
    assert np.all(below <= gain)
    assert np.all(above >= gain)
    assert np.all(np.diff(above) <= 0)


@pytest.mark.parametrize("seed", seeds(5, 100))
def test_the_gain_of_all_points_is_that_of_a_search_at_every_decay_rate(seed, monkeypatch):
    # The gains of few points are known, those of all of them come closer from both sides; infinite from one rate on, or nowhere.
    frf = rid.FrequencyResponse(np.linspace(0.1, 3.0, 30), np.ones(30), bound=0.01, dt=1.0)
    problem, rng = rid.MixedProblem(frequency=frf, prior=ANY), np.random.default_rng(seed)
    rates, few = gain_curve.default_rates(problem), np.exp(np.cumsum(rng.uniform(0, 1, 9)))
    every = few * np.exp(np.cumsum(rng.uniform(0, 1, 9)) * rng.choice([0.02, 0.5]))
    every[rng.integers(0, 12) :] = np.inf

    def closer(_, rate, *__):
        gain = every[int(np.argmin(np.abs(rates - rate)))]
        for part in (*(0.5 ** np.arange(10)), 0.0):
            yield (gain * (1 - part), gain * (1 + part)) if np.isfinite(gain) else (gain, gain)

    monkeypatch.setattr(prior, "gain_bounds", closer)
    start = prior._result(problem, gain_curve.GainCurve(rates, few), np.full(9, np.nan), 10)
    best = prior._of_all(problem, start, Budget(None, None, "looking for a prior"))
    slopes = gain_curve.GainCurve(rates, every).slopes(problem)
    if np.all(np.isinf(slopes)):
        assert best.prior is None
        return
    k = int(np.argmin(slopes))
    assert best.prior.decay_rate == rates[k]
    assert best.gains[k] == every[k]
    assert np.all(best.gains <= every)


@pytest.mark.parametrize("count", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_a_search_for_a_useful_class_ends_early_and_decides_as_the_whole_one(monkeypatch, count):
    # So many sets of gains; the largest response is 1.
    saved, said = 0, []
    for seed in range(count):
        with monkeypatch.context() as patch:
            problem, _, asked = risen(seed, patch)
            whole, all_asked = suggest_prior(problem), len(asked)
            asked.clear()
            found = useful_prior(problem)
        said.append(says_something(problem, whole))
        assert says_something(problem, found) == said[-1]
        assert whole.complete
        assert found.complete
        if said[-1]:
            assert found.prior == whole.prior
        else:
            assert min(found.gains) > 1 or found.points == whole.points
        saved += len(asked) < all_asked
    assert 0.15 * count < sum(said) < 0.85 * count
    assert saved > 0.15 * count


def test_the_fewest_points_are_left_out_with_which_some_form_takes_a_class_that_decays_slowly():
    frf = rid.FrequencyResponse(np.geomspace(10, 1e5, 240), np.ones((240, 2, 2)), bound=0.1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay=20.0))
    step = computable_step(problem)
    assert step > 1
    for part in range(1, step):
        with pytest.raises(SizeError):
            formulate(dataclasses.replace(problem, frequency=frf.select(slice(None, None, part))))
    few = dataclasses.replace(problem, frequency=frf.select(slice(None, None, step)))
    formulate(few)
    assert computable_step(few) == 1
    assert computable_step(problem.with_prior(gain_bound=2.0, rate=1e4)) == 1


def test_of_a_matrix_that_takes_too_long_as_many_points_are_left_as_there_is_time_for():
    frf = rid.FrequencyResponse(np.linspace(0.001, 3.1, 4000), np.ones((4000, 2, 1)), bound=0.1, dt=1.0)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1e6, decay_rate=1.03))
    assert computable_step(problem) == computable_step(problem, seconds=1e4) == 1
    steps = [computable_step(problem, seconds=seconds) for seconds in (15.0, 5.0, 0.1)]
    assert 1 < steps[0] < steps[1] <= steps[2]
    few = dataclasses.replace(problem, frequency=frf.select(slice(None, None, steps[0])))
    assert not formulate(few).is_late(15.0, 15)
    assert formulate(problem).is_late(15.0)
    single = dataclasses.replace(problem, frequency=frf.entry(0, 0), prior=problem.prior)
    assert computable_step(single, seconds=0.1) == 1


def test_a_search_for_a_useful_class_tries_only_decay_rates_that_all_points_can_be_posed_with():
    rng = np.random.default_rng(0)
    values = rng.standard_normal((300, 3, 3)) + 1j * rng.standard_normal((300, 3, 3))
    frf = rid.FrequencyResponse(np.linspace(0.5, 1.5, 300), values, bound=0.1, dt=1.0)
    problem = rid.MixedProblem(frequency=frf, prior=ANY)
    rates = gain_curve.possible_rates(problem)
    assert rates[0] > gain_curve.default_rates(problem)[0]
    assert useful_prior(problem, time_limit=1e-9).decay_rates[0] == rates[0]
    assert suggest_prior(problem, time_limit=1e-9).decay_rates[0] < rates[0]


def three_modes(count=90):
    """Of three modes of a plant one is known: what the others leave decays at 3/s, which 40 points over 100 rad/s do not tell."""
    omega = np.geomspace(2.0, 100.0, count)
    values = sum(1 / (w**2 - omega**2 + 6j * omega) for w in (12.0, 20.0, 40.0))
    frf = rid.FrequencyResponse(omega, values, bound=0.03 * np.abs(values))
    known = rid.kautz([20.0], [0.15], dt=None)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=1.0), parametric=known)


def test_slower_rates_are_those_that_the_distance_of_all_points_allows():
    for count in (40, 79, 90, 240):
        slowest = float(gain_curve.default_rates(three_modes(count))[0])
        rates = gain_curve.slower_rates(three_modes(count), slowest)
        assert slowest == 2 * 100.0 / 40
        np.testing.assert_allclose(rates, [slowest / 2**k for k in (2, 1) if slowest / 2**k >= 2 * 100.0 / count])
    record = rid.TimeRecord(np.ones(9), np.ones(9), dt=0.1, bound=0.1)
    assert not gain_curve.slower_rates(rid.MixedProblem(time=record, prior=ANY), 1.1).size


@pytest.mark.slow
def test_where_no_class_of_the_default_rates_holds_the_points_slower_ones_are_tried():
    problem = three_modes()
    default = gain_curve.default_rates(problem)
    assert np.isinf(suggest_prior(problem, decay_rates=default).gains[0])
    found = suggest_prior(problem)
    assert found.prior.decay == default[0] / 2
    assert rid.identify(dataclasses.replace(problem, prior=found.prior)).consistent
