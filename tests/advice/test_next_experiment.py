"""suggest_next(): what is promised is kept when the measurement is made."""

import dataclasses
import itertools
import logging

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice import next_experiment, suggest_next
from robustid.core import simulate
from support.matrix_plants import random_matrix_problem, response
from support.problems import random_problem, truth_of


@pytest.fixture(scope="module")
def result():
    return rid.identify(random_problem(6, "frequency", 8))


def test_closed_form_of_a_real_line():
    # Value 0 at z = 1, next to exactly: at z = -1 |F| <= d = (2/rho)/(1 + rho^-2), the model is 0 there.
    rho, eps = 1.4, 0.05
    frf = rid.FrequencyResponse([0.0], [0.0], bound=1e-6, dt=0.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=rho)))
    best, line = suggest_next(result, candidates=[0.0, np.pi / 0.1], bound=eps)
    d = (2 / rho) / (1 + rho**-2)
    assert best.at == pytest.approx(np.pi / 0.1)
    assert best.guaranteed == pytest.approx(d - 2 * eps, rel=0.05)
    assert best.guaranteed <= d - 2 * eps + 1e-5
    assert best.possible >= d - 1e-5
    assert best.remaining == 2 * eps
    assert line.guaranteed == 0


@pytest.mark.parametrize("error", [*(pytest.param(e, marks=pytest.mark.slow) for e in (0.0, 0.95)), -0.95j])
def test_the_promise_is_kept(result, error):
    eps = 0.01
    best = suggest_next(result, candidates=[60.0, 130.0, 250.0, 300.0], bound=eps, count=1)[0]
    assert best.guaranteed > 0
    value = truth_of(6, "frequency")[1](best.at) + eps * error
    new = rid.FrequencyResponse([best.at], [value], bound=eps, dt=result.problem.dt)
    again = rid.identify(dataclasses.replace(result.problem, frequency=(*result.problem.frequency, new)))
    after = rid.worst_case_error(again, omega=[best.at], directions=32, rtol=0.01)
    assert after.lower.item() <= best.remaining
    assert after.upper.item() <= best.remaining * 1.01
    assert best.lower - after.upper.item() >= best.guaranteed - 0.01 * best.remaining
    assert best.upper - after.lower.item() <= best.possible


def test_order_and_count(result):
    found = suggest_next(result, bound=0.02, count=4)
    assert len(found) == 4
    gains = [item.guaranteed for item in found]
    assert gains == sorted(gains, reverse=True)
    assert all(item.lower <= item.upper == item.possible for item in found)
    assert all(0 < item.at <= np.pi / 0.01 for item in found)
    assert all(item.kind == "frequency" for item in found)
    assert f"{found[0].at / (2 * np.pi):.5g} Hz" in str(found[0])


def test_large_bounds_promise_nothing(result):
    assert all(item.guaranteed == 0 for item in suggest_next(result, candidates=[60.0, 250.0], bound=10.0))


def test_default_bounds():
    problem = random_problem(6, "mixed", 12)
    result = rid.identify(problem)
    lines, record = problem.frequency[0], problem.time[0]
    assert suggest_next(result, candidates=[100.0])[0].bound == np.median(lines.bound)
    alone = rid.identify(dataclasses.replace(problem, frequency=None))
    converted = np.median(record.bound) / np.abs(record.u).max()
    assert suggest_next(alone, candidates=[100.0])[0].bound == pytest.approx(converted)


def test_a_worst_case_error_is_not_computed_again(result, monkeypatch):
    error = rid.worst_case_error(result, omega=[60.0, 250.0], directions=6)

    def refuse(*_, **__):
        raise RuntimeError("solved anew")

    monkeypatch.setattr(next_experiment, "worst_case_error", refuse)
    found = suggest_next(error)
    assert sorted(item.at for item in found) == [60.0, 250.0]
    for item in found:
        k = int(np.flatnonzero(error.omega == item.at)[0])
        assert (item.lower, item.upper) == (error.lower[k].item(), error.upper[k].item())


def test_more_time_samples_are_a_candidate():
    problem = random_problem(6, "time", 4)
    result = rid.identify(problem)
    found = suggest_next(rid.worst_case_error(result, omega=[100.0], directions=4), count=100)
    times = [item for item in found if item.kind == "time"]
    assert len(times) == 1
    item, record = times[0], problem.time[0]
    drive = np.abs(record.u).max()
    assert 4 * 0.01 <= item.at + 1e-12 <= 9 * 0.01
    assert item.bound == pytest.approx(np.median(record.bound) / drive)
    # The truth's continuation is no further from the model than stated.
    u = np.concatenate([record.u[:, 0], np.full(6, record.u[-1, 0])])
    k = round(item.at / 0.01)
    truth = np.convolve(u, truth_of(6, "time")[0](10))[k]
    model = result.model
    assert abs(truth - simulate(model, u[:, None])[0][k, 0]) <= item.upper * drive
    assert "time samples to" in str(item)


def test_default_candidates_lie_between_the_lines_and_on_the_poles():
    problem = random_problem(6, "parametric", 16)
    grid = next_experiment._between(problem)
    pole = np.angle(problem.parametric.poles.max()) / 0.01
    assert np.abs(grid - abs(pole)).min() < 1e-6
    lines = problem.frequency[0].omega
    assert np.abs(grid[:, None] - lines).min() > 0
    for low, high in itertools.pairwise(lines):
        assert np.any((grid > low) & (grid < high))
    assert grid.min() < lines[0]
    assert grid.max() > lines[-1]


def test_bad_input(result):
    sentence = "`identification` must be an Identification or a WorstCaseError"
    with pytest.raises(rid.errors.InputTypeError, match=sentence):
        suggest_next(result.problem)
    for options, sentence in (
        ({"candidates": [400.0]}, "`omega` must lie between 0 and pi/dt"),
        ({"bound": -1.0}, "`bound` must be positive"),
        ({"count": 0}, "`count` must be at least 1"),
    ):
        with pytest.raises(rid.InputError, match=sentence):
            suggest_next(result, **options)


# --- MIMO


@pytest.fixture(scope="module")
def measured():
    problem, truth = random_matrix_problem(4, 2, 2, 3, rho=1.4)
    return truth, rid.worst_case_error(rid.identify(problem), omega=[0.3, 2.9], directions=6, rtol=0.2)


def test_the_promise_is_kept_in_every_entry_of_the_column(measured):
    truth, error = measured
    eps, problem = np.array([[0.02, 0.05], [0.04, 0.01]]), error.identification.problem
    best = suggest_next(error, bound=eps, count=1)[0]
    assert best.guaranteed > 0
    i, j = best.entry
    assert best.bound == eps[i, j]
    assert best.name == f"u{j + 1} to y{i + 1}"
    assert best.name in str(best)
    values, bound = response(truth, np.array([best.at])), np.full((1, 2, 2), np.inf)
    bound[0, :, j] = eps[:, j]
    turns = np.exp(2j * np.pi * np.random.default_rng(0).random((1, 2, 2)))
    new = rid.FrequencyResponse([best.at], values + 0.99 * eps * turns, bound=bound, dt=1.0)
    again = rid.identify(dataclasses.replace(problem, frequency=(*problem.frequency, new)))
    after = rid.worst_case_error(again, omega=[best.at], rtol=0.05)
    assert np.all(after.lower[0, :, j] <= 2 * eps[:, j])
    assert after.upper[0, i, j] <= 1.05 * best.remaining
    assert best.lower - after.upper[0, i, j] >= best.guaranteed - 0.05 * best.remaining
    assert best.upper - after.lower[0, i, j] <= best.possible


def test_one_for_every_frequency_and_input_with_the_entry_that_gains_most(measured):
    _, error = measured
    found = suggest_next(error, bound=0.02, count=100)
    assert sorted((item.at, item.entry[1]) for item in found) == [(w, j) for w in (0.3, 2.9) for j in (0, 1)]
    gains = [item.guaranteed for item in found]
    assert gains == sorted(gains, reverse=True)
    for item in found:
        k = int(np.flatnonzero(error.omega == item.at)[0])
        column = error.lower[k, :, item.entry[1]]
        assert item.lower == error.lower[k, *item.entry]
        assert item.guaranteed == max(0.0, column.max() - 0.04)
    # In units in which an entry counts less, another one may gain most.
    prior = dataclasses.replace(error.identification.problem.prior, scaling=[[1e6, 1.0], [1.0, 1e-6]])
    problem = dataclasses.replace(error.identification.problem, prior=prior)
    posed = dataclasses.replace(error.identification.formulation, problem=problem)
    other = dataclasses.replace(error, identification=dataclasses.replace(error.identification, formulation=posed))
    entries = {item.entry for item in suggest_next(other, bound=0.02, count=100)}
    assert entries == {(1, 0), (1, 1)}


def test_bounds_of_entries_are_their_own_and_those_of_unmeasured_ones_in_the_units_of_the_prior():
    problem, _ = random_matrix_problem(4, 2, 2, 3, rho=1.4)
    frf, units = problem.frequency[0], np.array([[1.0, 2.0], [3.0, 4.0]])
    bound = np.array(frf.bound.radius * units)
    bound[:, 1, 1] = np.inf
    prior = dataclasses.replace(problem.prior, scaling=units)
    result = rid.identify(dataclasses.replace(problem, frequency=frf.with_bound(rid.Bound(bound)), prior=prior))
    found = suggest_next(result, candidates=frf.omega[1:2])
    size = frf.bound.max()
    assert [item.bound for item in found] == pytest.approx([size * units[item.entry] for item in found])
    assert found[0].entry == (1, 1)  # which nothing was known of


def test_more_samples_of_a_record_with_several_inputs(measured):
    truth, _ = measured
    rng = np.random.default_rng(3)
    u = rng.standard_normal((4, 2)) * [1.0, 0.1]
    more = np.concatenate([u, np.repeat(u[-1:], 4, axis=0)])
    y = control.forced_response(truth, np.arange(8.0), more.T).outputs.T
    record = rid.TimeRecord(u, y[:4] + 0.05 * np.sign(rng.standard_normal((4, 2))), dt=1.0, bound=[[0.06, 0.08]] * 4)
    prior = random_matrix_problem(4, 2, 2, 3, rho=1.4)[0].prior
    result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    found = suggest_next(rid.worst_case_error(result, omega=[1.0], directions=4))
    (item,) = (one for one in found if one.kind == "time")
    drive, (i, j) = np.abs(u[:, 0]).max(), item.entry
    assert j == 0
    assert item.bound == pytest.approx([0.06, 0.08][i] / drive)
    model = control.forced_response(result.model, np.arange(8.0), more.T).outputs.T
    k = round(item.at)
    assert 4 <= k < 8
    assert np.abs(y[k, i] - model[k, i]) <= item.upper * drive
    assert item.lower <= item.upper


def test_the_time_ends_it_with_what_is_finished(measured, caplog):
    _, error = measured
    told, options = [], {"candidates": np.linspace(0.1, 3, 50), "time_limit": 0.2, "count": 100}
    with caplog.at_level(logging.WARNING, "robustid"):
        found = suggest_next(error, **options, progress=lambda text, *at: told.append(at))
    assert 2 <= len(found) < 100
    assert told[-1][1] == 50
    assert "of 50 frequencies are bounded" in caplog.text
    with pytest.raises(rid.InputError, match=r"`bound` must be positive, one number or one of every entry, \(2, 2\)"):
        suggest_next(error, bound=[0.1, 0.2])
