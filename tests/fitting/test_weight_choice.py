"""The weight that a fit takes: the one whose fit predicts withheld frequency points best, by one measure for all."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.fitting import FractionProblem, Weight, fit_mfd
from robustid.fitting.fraction.first_models import first_model
from robustid.fitting.fraction.weight_choice import chosen, predicted_error
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.state_descent import Settings
from robustid.fitting.state_space.state_refinement import UNLIMITED
from support.interrupts import ctrl_c
from support.mfd_systems import gaussian

OMEGA = np.linspace(1.0, 9.0, 121)
S = 1j * OMEGA
# A strong mode and a weak one, whose part of the response is largest where a strange weight looks.
TRUTH = (1 / (S**2 + 0.1 * S + 9) + 0.02 / (S**2 + 0.1 * S + 49))[:, None, None] * np.array([[1.0], [0.5]])
STRANGE = np.where(np.abs(OMEGA - 7) < 1, 1e3, 1.0)[:, None, None] * np.ones(TRUTH.shape)
SETTINGS = Settings(["lm"], None, "right", True, None)


def question(weight, *, values=TRUTH, order=2):
    problem = FractionProblem(OMEGA, values, order, Weight(weight))
    return problem, Samples(problem.values, problem.scale * problem.xi, problem.weight.entrywise, "s")


def begin(problem, data):
    return first_model(problem, data, None, "right", None, True, UNLIMITED)


def test_a_weight_that_takes_the_wrong_mode_is_left():
    noisy = TRUTH + 1e-3 * gaussian(np.random.default_rng(0), *TRUTH.shape)
    questions = [question(w, values=noisy) for w in (STRANGE, np.ones(TRUTH.shape))]
    found, _ = chosen(questions, begin, SETTINGS)
    np.testing.assert_array_equal(found.weight.entries, 1.0)
    assert "withheld frequency points" in found.weight.note
    assert chosen(questions[::-1], begin, SETTINGS) is questions[1]


def test_the_first_one_stays_where_the_others_are_as_good():
    questions = [question(size * np.ones(TRUTH.shape)) for size in (1.0, 3.0)]
    assert chosen(questions, begin, SETTINGS) is questions[0]


@pytest.mark.parametrize(
    "settings", [dataclasses.replace(SETTINGS, phases=["sk"]), dataclasses.replace(SETTINGS, budget=Budget(1e-9))]
)
def test_other_methods_and_no_time_take_the_first_one(settings):
    questions = [question(w) for w in (STRANGE, np.ones(TRUTH.shape))]
    assert chosen(questions, begin, settings) is questions[0]


def test_the_error_is_that_of_fits_without_the_points():
    """Against whole fits to three quarters of the points, from the start."""
    noisy = TRUTH + 3e-3 * gaussian(np.random.default_rng(1), *TRUTH.shape)
    problem, data = question(np.ones(TRUTH.shape), values=noisy)
    error = predicted_error(problem, data, begin(problem, data), SETTINGS, UNLIMITED)
    squares, points = [], np.arange(OMEGA.size)
    size = (np.abs(noisy) ** 2 + 10 * np.mean(np.abs(noisy) ** 2, axis=0)) / 11
    for first in range(4):
        mask = (points % 4 == first) & (points < OMEGA.size - 1)
        fit = fit_mfd(rid.FrequencyResponse(OMEGA[~mask], noisy[~mask]), order=2, weight=np.ones(noisy[~mask].shape))
        squares.append(np.abs(fit.fraction.response(OMEGA[mask]) - noisy[mask]) ** 2 / size[mask])
    assert error == pytest.approx(np.sqrt(np.mean(np.concatenate(squares))), rel=1e-3)


def test_a_pole_at_the_stability_boundary_counts_as_a_quarter_more(monkeypatch):
    unstable = (1 / (S**2 - 0.05 * S + 9))[:, None, None] * np.ones(TRUTH.shape)
    errors = {}
    for factor in (None, 1.0):
        if factor:
            monkeypatch.setattr("robustid.fitting.fraction.weight_choice._AT_BOUNDARY", factor)
        for name, values in (("boundary", unstable), ("inside", TRUTH)):
            problem, data = question(np.ones(TRUTH.shape), values=values)
            found = predicted_error(problem, data, begin(problem, data), SETTINGS, UNLIMITED)
            errors.setdefault(name, []).append(found)
    assert errors["boundary"][0] == pytest.approx(1.25 * errors["boundary"][1], rel=1e-12)
    assert errors["inside"][0] == errors["inside"][1]


def measured(covariance, dof):
    return rid.FrequencyResponse(OMEGA, TRUTH, covariance=covariance, dof=dof)


def test_few_degrees_of_freedom_let_the_points_decide_and_many_do_not():
    """Noise that is stated as large as the strong mode, where the response has none, is believed only of many experiments."""
    covariance = np.where(np.abs(OMEGA - 3) < 1.5, 9.0, 1e-6)[:, None, None] * np.eye(2)
    few, many = (fit_mfd(measured(covariance, dof), order=2, restart=False) for dof in (4.0, 2000.0))
    assert few.weight_choice.startswith("one number an entry, the inverse of its level: it predicts")
    assert few.poles[0] == pytest.approx(-0.05 + 3j, abs=0.01)
    shrunk = "the covariance of the data, shrunk as it is known from 2000 degrees of freedom"
    assert many.weight_choice.startswith(shrunk)


def test_fits_of_all_orders_have_one_weight():
    covariance = (1e-3 / STRANGE[:, :1]) ** 2 * np.eye(2)
    sweep = rid.fits.suggest_order(measured(covariance, 4.0), orders=[2, 4])
    low, high = (sweep.fits[order].problem.weight for order in (2, 4))
    np.testing.assert_array_equal(low.matrix, high.matrix)
    assert np.all(np.diff(sweep.costs) <= 0)


def test_a_response_with_missing_entries_is_judged_without_them():
    values = TRUTH.copy()
    values[::7, 0] = np.nan
    known = measured(np.broadcast_to(1e-6 * np.eye(2), (121, 2, 2)), 4.0)
    frf = dataclasses.replace(known, values=values, bound=np.where(np.isnan(values), np.inf, 1e-5))
    fit = fit_mfd(frf, order=4)
    np.testing.assert_allclose(fit.fraction.response(OMEGA), TRUTH, atol=1e-6)
    assert rid.fits.suggest_order(frf, orders=[2, 4]).suggested == 4


def test_ctrl_c_while_weights_are_judged_ends_the_fit_with_what_there_is(monkeypatch):
    monkeypatch.setattr("robustid.fitting.matrix_fraction.chosen", ctrl_c)
    fit = fit_mfd(measured(np.broadcast_to(1e-6 * np.eye(2), (121, 2, 2)), 4.0), order=2)
    assert fit.stable
    assert not fit.status.converged
