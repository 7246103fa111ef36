"""suggest_next() of matrices: which input to move where, and what is promised of every entry."""

import dataclasses
import logging

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_next
from support.matrix_plants import random_matrix_problem, response


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
    posed = dataclasses.replace(
        error.identification.formulation, problem=dataclasses.replace(error.identification.problem, prior=prior)
    )
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
    told = []
    with caplog.at_level(logging.WARNING, "robustid"):
        found = suggest_next(
            error,
            candidates=np.linspace(0.1, 3, 50),
            time_limit=0.2,
            progress=lambda text, *at: told.append(at),
            count=100,
        )
    assert 2 <= len(found) < 100
    assert told[-1][1] == 50
    assert "of 50 frequencies are bounded" in caplog.text
    with pytest.raises(rid.InputError, match=r"`bound` must be positive, one number or one of every entry, \(2, 2\)"):
        suggest_next(error, bound=[0.1, 0.2])
