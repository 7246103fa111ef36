"""What is left of an identification that ran out of time, or was interrupted: less, and verified all the same."""

import pytest

import robustid as rid
from robustid.core import Source
from support.interrupts import ctrl_c_at_call
from support.matrix_plants import random_matrix_problem
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
