"""Steps that end early for want of time: modes, the margin, the small model; each is named, and none ends a run."""

import dataclasses
import math

import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_kautz
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import with_modes
from robustid.app.run.posing import posed
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sequence import identified, reduced
from robustid.app.run.work import Work, narrowing_limit
from robustid.core import Budget, Source
from robustid.errors import SizeError
from support.matrix_plants import random_matrix_problem

FRF = rid.datasets.flexible_structure(lines=40, extra_hz=np.linspace(17.2, 18.1, 10)).frequency
DATA = Measured((FRF,), ())
SEARCH = "robustid.app.run.modes.suggest_kautz"


def test_half_of_the_time_that_is_left_is_for_the_modes(monkeypatch):
    asked = []

    def search(frf, *, time_limit, **how):
        asked.append(time_limit)
        return dataclasses.replace(suggest_kautz(frf, **how), complete=False)

    monkeypatch.setattr(SEARCH, search)
    around = Surroundings(budget=Budget(1000.0))
    run = with_modes(RunFile(), DATA, around)
    assert 499 < asked[0] <= 500
    assert len(run.modes.hz) == 2
    assert len(around.stops.unfinished.steps) == 1
    with_modes(RunFile().changed("modes", count=1), DATA, around)
    assert asked[1] is None  # a number that was asked for is found


def test_without_time_for_the_first_mode_a_run_goes_on_without_any(monkeypatch):
    def search(frf, **how):
        raise SizeError("the next step takes too long")

    monkeypatch.setattr(SEARCH, search)
    around = Surroundings()
    run, problem, _ = posed(RunFile(), DATA, around)
    assert (run.modes.hz, run.modes.source, problem.parametric) == ((), Source.PROGRAM, None)
    assert len(around.stops.unfinished.steps) >= 1
    around = Surroundings()
    monkeypatch.setattr(SEARCH, suggest_kautz)
    assert len(with_modes(RunFile(), DATA, around).modes.hz) == 2
    assert around.stops.unfinished is None


def test_a_step_with_too_little_time_to_begin_is_named_though_time_is_left(monkeypatch):
    problem, _ = random_matrix_problem(3, 2, 2)
    problem = dataclasses.replace(problem, parametric=rid.kautz([0.8, 2.0], [0.05, 0.02], dt=1.0))
    around = Surroundings(budget=Budget(600.0))
    monkeypatch.setattr("robustid.identification.formulation.base._PER_SECOND", 1.0)
    work = Work(run=RunFile(), identification=identified(RunFile(), problem, around), around=around)
    assert len(around.stops.late) == 1
    monkeypatch.setattr("robustid.reduction.within_bounds._LOOK", 1e3)
    reduced(work)
    assert len(around.stops.late) == 2
    assert work.small.order == work.identification.order
    assert around.budget.left > 500


@pytest.mark.parametrize("late", [-30.0, -1e-3, 0.0, 1e-3, 0.5, 10.0, 30.0])
def test_narrowing_takes_no_more_than_what_is_left_of_a_run(late):
    """Where the time was over by 4 s, a share of -4 of these was 14 s."""
    seconds = narrowing_limit(30.0, late)
    assert 0 <= seconds <= max(late, 0)
    assert seconds == pytest.approx(max(0.12 * 30 - (30 - late), 0.03 * late, 0.0))


def test_narrowing_of_a_run_without_end_takes_what_it_takes_of_one_that_begins_with_it():
    assert narrowing_limit(300.0, math.inf) == narrowing_limit(300.0, 300.0)
