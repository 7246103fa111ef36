"""A part of many frequency points stands for all."""

import dataclasses

import numpy as np

import robustid as rid
from robustid.advice import suggest_prior
from robustid.advice.sensitivity import guaranteed
from robustid.advice.smallest_gain import missed, selected, thinned
from support.structure import ANY


def dense(lines=150, seed=0):
    """Many frequency points of the structure, its light mode in the parametric part, the damped one left to the rest."""
    data = rid.datasets.flexible_structure(seed=seed, lines=lines)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    return rid.MixedProblem(frequency=data.frequency, prior=ANY, parametric=basis)


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
    wrong = dataclasses.replace(problem, frequency=rid.FrequencyResponse(frf.omega, values, bound=frf.bound, dt=frf.dt))
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
    assert suggest_prior(problem, time_limit=1e-9).decay_rates.size == 1

    def stop(text, done, count):
        assert count == 9
        if done == 2:
            raise KeyboardInterrupt

    assert suggest_prior(problem, progress=stop).decay_rates.size == 2
