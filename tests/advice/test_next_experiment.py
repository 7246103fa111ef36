"""suggest_next(): what is promised is kept when the measurement is made."""

import dataclasses
import itertools

import numpy as np
import pytest

import robustid as rid
from robustid.advice import next_experiment, suggest_next
from robustid.core import simulate
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
    found = suggest_next(rid.identify(problem), count=100)
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
    model = rid.identify(problem).model
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
