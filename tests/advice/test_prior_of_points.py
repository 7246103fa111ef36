"""Priors from many frequency points: a part of them, the others, and the searches that this saves."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import computable_step, gain_curve, kept_gains, prior, says_something, suggest_prior, useful_prior
from robustid.advice.sensitivity import guaranteed
from robustid.advice.smallest_gain import gain_bounds, missed, pressing, selected, smallest_gain, thinned
from robustid.core import Budget
from robustid.errors import SizeError
from robustid.identification.formulation import bounded_points, formulate
from support.cases import seeds
from support.interrupts import ctrl_c_when
from support.mimo_data import real_poles, response
from support.structure import ANY, about_structure


def dense(lines=150, seed=0):
    """Many frequency points of the structure, its light mode in the parametric part, the damped one left to the rest."""
    return about_structure(rid.datasets.flexible_structure(seed=seed, lines=lines), 1.0, 1.5)


def without_modes(seed, lines=150):
    """Many frequency points of three real poles, which the non-parametric part has to be."""
    omega, rng = np.linspace(0.02, 3.0, lines), np.random.default_rng(seed)
    plant = real_poles(seed, 1, 1, dt=1.0)
    values = plant(np.exp(1j * omega), squeeze=False).transpose(2, 0, 1)
    noise = 0.02 * rng.uniform(0, 1, values.shape) * np.exp(2j * np.pi * rng.uniform(size=values.shape))
    return rid.MixedProblem(frequency=rid.FrequencyResponse(omega, values + noise, bound=0.02, dt=1.0), prior=ANY)


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
    monkeypatch.setattr(prior, "gains_of_all", lambda problem, few, budget: few)
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


@pytest.mark.parametrize("lines", [50, pytest.param(70, marks=pytest.mark.slow)])
def test_bounds_of_the_smallest_gain_close_on_it(lines):
    problem = dense(lines)
    pairs = list(gain_bounds(problem, 1.05))
    gain = smallest_gain(problem, 1.05)
    below, above = np.array([one[:2] for one in pairs]).T
    assert len(pairs) > 3
    assert pairs[-1][:2] == (gain, gain)
    assert np.all(below <= gain)
    assert np.all(above >= gain)
    assert np.all(np.diff(above) <= 0)


@pytest.mark.parametrize("seed", seeds(5, 100))
@pytest.mark.parametrize("points", [False, True])
def test_the_gain_of_all_points_is_that_of_a_search_at_every_decay_rate(seed, points, monkeypatch):
    # The gains of few points are known, those of all of them come closer from both sides; infinite from one rate on, or nowhere.
    frf = rid.FrequencyResponse(np.linspace(0.1, 3.0, 30), np.ones(30), bound=0.01, dt=1.0)
    problem, rng = rid.MixedProblem(frequency=frf, prior=ANY), np.random.default_rng(seed)
    rates, few = gain_curve.default_rates(problem), np.exp(np.cumsum(rng.uniform(0, 1, 9)))
    every = few * np.exp(np.cumsum(rng.uniform(0, 1, 9)) * rng.choice([0.02, 0.5]))
    every[rng.integers(0, 12) :] = np.inf

    def closer(_, rate, *__):
        gain = every[int(np.argmin(np.abs(rates - rate)))]
        for part in (*(0.5 ** np.arange(10)), 0.0):
            bounds = (gain * (1 - part), gain * (1 + part)) if np.isfinite(gain) else (gain, gain)
            yield *bounds, np.ones(30 * points)

    def of_points(_, rate, *__):
        k = int(np.argmin(np.abs(rates - rate)))
        asked.append(k)
        return few[k] + rng.uniform() * (min(every[k], 2 * few[k]) - few[k])

    asked = []
    monkeypatch.setattr(gain_curve, "gain_bounds", closer)
    monkeypatch.setattr(gain_curve, "smallest_gain", of_points)
    monkeypatch.setattr(gain_curve, "lighter", lambda whole, part, rate: part)
    start = gain_curve.GainCurve(rates, few)
    best = gain_curve.gains_of_all(problem, start, Budget(None, None, "looking for a prior"))
    slopes = gain_curve.GainCurve(rates, every).slopes(problem)
    if np.all(np.isinf(slopes)):
        assert np.all(np.isinf(best.gains))
        return
    k = int(np.argmin(slopes))
    assert best.knee(problem) == k
    assert best.gains[k] == every[k]
    assert np.all(best.gains <= every)
    assert points or not asked
    assert len(asked) == len(set(asked))


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


@pytest.mark.parametrize("rate", [1.05, 1.1, 1.2])
def test_points_that_ask_for_the_gain_ask_for_nearly_all_of_it(rate):
    problem = without_modes(0)
    *_, (_, gain, multipliers) = gain_bounds(problem, rate)
    masks = pressing(problem, multipliers, 30)
    assert sum(mask.sum() for mask in masks) <= 33
    few = smallest_gain(selected(problem, masks), rate, problem)
    assert few == pytest.approx(gain, rel=0.01)
    weak = tuple(~mask for mask in masks)
    assert smallest_gain(selected(problem, weak), rate, problem) < few
    assert pressing(problem, np.zeros(0), 30) is None


@pytest.mark.parametrize("joint", ["entry", "column", "matrix"])
def test_bounds_are_those_of_their_points(joint):
    """The rows that change with the values at one point are those that say so."""
    frf = response(0, joint, missing=joint != "matrix")
    problem = rid.MixedProblem(frequency=frf, prior=ANY)
    rows = formulate(problem).data.rows
    places = bounded_points(frf)
    assert places.size == rows.cones
    for point in range(frf.omega.size):
        values = frf.values.copy()
        values[point] *= 2
        other = dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=values))
        moved = rows.sizes(formulate(other).data.rows.y - rows.y) > 0
        assert np.array_equal(moved, places == point)
