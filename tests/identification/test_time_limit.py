"""What is left of an identification that ran out of time, or was interrupted: less, and verified all the same."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import Source
from support.interrupts import ctrl_c_at_call
from support.matrix_plants import random_matrix_problem, response
from support.problems import random_problem

pytestmark = pytest.mark.quick
NEVER = 1e-9  # seconds


@pytest.fixture(scope="module", params=["consistent", "inconsistent"])
def question(request):
    """A problem of 30 coefficients, on the path of our own solver, with its whole answer."""
    spread = 1.0 if request.param == "consistent" else 0.2
    problem = random_problem(3, "mixed", 30, spread=spread, noise=0.9 / spread)
    return problem, rid.identify(problem, solver="structured")


def check(problem, found, whole):
    assert found.verification.passed, found.summary()
    assert found.margin_lower <= whole.margin * (1 + 1e-9)
    assert whole.margin_lower <= found.margin * (1 + 1e-9)
    assert max(r.ratio.max() for r in found.residuals) <= max(1.0, found.margin) * (1 + 1e-5)


@pytest.mark.parametrize("objective", ["center", "margin", "gain", "order"])
def test_without_time_the_interval_is_wide_and_holds_the_margin(question, objective):
    problem, whole = question
    found = rid.identify(problem, solver="structured", objective=objective, time_limit=NEVER)
    check(problem, found, whole)
    assert found.accuracy >= whole.accuracy
    assert any(note.startswith("stopped at the time limit") for note in found.notes)
    assert found.status is (rid.Status.CONSISTENT if found.margin <= 1 else rid.Status.UNDECIDED)


def test_of_a_matrix_no_step_begins_that_would_take_longer_than_there_is_time(monkeypatch):
    problem, _ = random_matrix_problem(2, 2, 2)
    whole = rid.identify(problem)
    monkeypatch.setattr("robustid.identification.formulation.base._PER_SECOND", 1.0)
    found = rid.identify(problem, solver="structured", time_limit=60.0)
    check(problem, found, whole)
    assert found.notes[0].startswith("stopped at the time limit")
    assert found.margin_lower < 0.5 * whole.margin_lower


def test_where_no_step_begins_the_model_is_the_parametric_part_alone(monkeypatch, tmp_path):
    """No matrix of the coefficients is factorised, and everything is verified all the same, also from its files."""
    problem, _ = random_matrix_problem(3, 2, 2)
    basis = rid.kautz([0.8, 2.0], [0.05, 0.02], dt=1.0)
    problem = dataclasses.replace(problem, parametric=basis)
    monkeypatch.setattr("robustid.identification.formulation.base._PER_SECOND", 1.0)
    monkeypatch.setattr("robustid.identification.solver.newton.cholesky", None)
    found = rid.identify(problem, time_limit=60.0)
    assert found.verification.passed, found.summary()
    assert not found.coefficients.any()
    assert found.order == 2 * basis.size
    assert found.choices["objective"].source is Source.STOPPED
    found.save(tmp_path / "late")
    assert rid.load(tmp_path / "late").verification.passed
    frf = problem.frequency[0]
    columns = np.vstack([part(basis.response(frf.omega)) for part in (np.real, np.imag)])
    for i, j in np.ndindex(2, 2):
        y = np.concatenate([frf.values[:, i, j].real, frf.values[:, i, j].imag])
        best = columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        fit = response(found.model, frf.omega)[:, i, j]
        np.testing.assert_allclose(np.concatenate([fit.real, fit.imag]), best, atol=1e-9)


@pytest.mark.parametrize("calls", [2, 6])
def test_interrupted_it_keeps_what_is_proved(question, calls, tmp_path):
    problem, whole = question
    found = rid.identify(problem, solver="structured", progress=ctrl_c_at_call(calls))
    check(problem, found, whole)
    assert found.notes[0].startswith("interrupted")
    found.save(tmp_path / "early")
    again = rid.load(tmp_path / "early")
    assert (again.margin, again.margin_lower, again.accuracy) == (found.margin, found.margin_lower, found.accuracy)
    assert again.verification.passed


def test_time_enough_changes_nothing_and_progress_comes_to_its_end(question):
    problem, whole = question
    told = []
    found = rid.identify(
        problem, solver="structured", time_limit=600.0, progress=lambda text, done, count: told.append(done / count)
    )
    assert (found.margin, found.margin_lower, found.notes) == (whole.margin, whole.margin_lower, whole.notes)
    assert told == sorted(told)
    assert told[0] < 0.5 < told[-1] == 1


def test_after_ctrl_c_on_the_way_to_the_margin_nobody_waits_for_the_centre(question):
    problem, whole = question
    found = rid.identify(problem, solver="structured", progress=ctrl_c_at_call(3))
    check(problem, found, whole)
    assert found.choices["margin"].source is found.choices["objective"].source is Source.STOPPED
    assert "interrupted" in found.choices["objective"].reason
