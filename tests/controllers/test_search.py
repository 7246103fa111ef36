"""Programs for given directions: distances along them, and the few conditions that limit against all of them."""

import pathlib

import numpy as np
import pytest

from robustid.controllers.designing import At, Task
from robustid.controllers.goals import Bandwidth
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.search import _solved, _solved_some, _spread
from support.cases import slow
from support.design_cases import STRUCTURES, band_of, matrix_band_of

BENCHMARKS = pathlib.Path(__file__).parents[2] / "benchmarks"
LIMITS = Limits(sensitivity_peak=1.8, complementary_peak=1.5, roll_off=((200.0, 300.0, 0.5),))


def small_matrix_band(seed):
    return matrix_band_of(seed, lines=12)


CASES = [(band_of, 0, False), (band_of, 1, False), (band_of, 0, True), (small_matrix_band, 0, False)]
CASES += [slow(band_of, 2, False), slow(band_of, 1, True), slow(band_of, 2, True), slow(matrix_band_of, 0, False)]


def question_of(make, seed, cornered=False):
    """Conditions of a random problem at a tenth of its axis, a loop to begin with and its directions; discs or polygons in them."""
    task = Task.of([Plants.of(make(seed)[1])], tuple(STRUCTURES[0]), LIMITS, Bandwidth())
    here = At(task, task.middle)
    if cornered:
        turn = 2j * np.pi * np.arange(12) / 12
        round_ = np.exp(turn + 1j * np.angle(here.discs.centre[:, 0])) + np.exp(-turn) / 3
        here.discs = here.discs._replace(
            corners=0.7 * here.discs.radius[:, None] * round_, around=0 * here.discs.around
        )
    limits = task.asked(0.1 * here.ends[0] ** 0.5 * here.ends[1] ** 0.5)
    question, discs = here.question(limits)
    _, wanted = next(here._starts(discs, limits, None))
    return question, wanted, question.directions(wanted)


@pytest.mark.parametrize(("make", "seed", "cornered"), CASES)
def test_distances_along_directions_are_at_most_those_along_the_best(make, seed, cornered):
    question, _, wanted = question_of(make, seed, cornered)
    factors, _ = _solved_some(question, wanted, every_corner(question))
    values = question.values(factors)
    for one, turn in zip(question.conditions, wanted, strict=True):
        excess, size = one.excess(values), 1 + np.abs(one.excess(values))
        assert np.all(np.abs(one.ahead(values, one.directions(values)) - excess) <= 1e-9 * size)
        assert np.all(one.ahead(values, turn) <= excess + 1e-9 * size)
        every = one.at_corners(values, turn)
        half = np.arange(every.size).reshape(every.shape) % 2 == 1
        row, corner = np.nonzero(half)
        alone = one.with_corner(row, corner).ahead(values, turn[row])
        assert np.all(np.abs(alone - every[half]) <= 1e-12 * size[row])


def every_corner(question):
    """All conditions at all of their corners."""
    return [np.ones((one.place.size, one.moved.shape[1]), bool) for one in question.conditions]


@pytest.mark.parametrize(("make", "seed", "cornered"), CASES)
def test_the_conditions_that_limit_give_the_slack_of_all(make, seed, cornered):
    question, values, turns = question_of(make, seed, cornered)
    every = every_corner(question)
    for _ in range(3):
        _, most = _solved_some(question, turns, every)
        asked = _spread(question, values, turns)
        factors = _solved(question, turns, asked)
        values = question.values(factors)
        reached = min(
            float(np.min(one.ahead(values, turn) / unit))
            for (one, unit), turn in zip(question.with_units(), turns, strict=True)
            if one.place.size
        )
        assert reached >= most - 0.03 * abs(most) - 1e-5
        assert sum(map(np.sum, asked)) < (0.1 if cornered else 0.5) * sum(map(np.size, asked))
        turns = question.directions(values)


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.skipif(not BENCHMARKS.exists(), reason="benchmarks are not part of the source archive")
def test_a_climb_that_is_stuck_is_led_on_by_the_model_alone(monkeypatch):
    """Two pairs of poles for a beam within a wide weight: C = 0 is where it begins, and 2.07 what is known to be reachable."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from control_problems import beams, of_weight

    machine = next(beams())
    structure, goal = machine.structures["two pairs"]
    task = Task.of([Plants.of(of_weight(machine.band)[0])], tuple(structure), Limits(sensitivity_peak=2.0), goal)
    here = At(task, task.middle)
    found = here.first()
    assert found.level < 1.01
    assert here._climbed(found, here.ends[1], 1.5).level < 1.01  # what directions of the loop itself lead to
    assert here.raised(found).level > 2.0


class Forgotten(dict):
    """Levels that nobody remembers."""

    def __setitem__(self, name, level):
        pass


@pytest.mark.parametrize(
    ("make", "seed", "limits"),
    [
        (band_of, 0, Limits(sensitivity_peak=1.8)),
        *(slow(*case, LIMITS) for case in ((band_of, 0), (band_of, 1), (matrix_band_of, 0))),
    ],
)
def test_starts_that_found_nothing_at_a_level_are_not_missed_above(make, seed, limits):
    task = Task.of([Plants.of(make(seed)[1])], tuple(STRUCTURES[0]), limits, Bandwidth())
    levels, asked = [], []
    for lost in ({}, Forgotten()):
        here = At(task, task.middle)
        here.lost = lost
        programs = iter(range(10**6))
        task.go_on = lambda programs=programs: next(programs)  # called before each of them
        levels.append(here.raised(here.first()).level)
        asked.append(next(programs))
    assert levels[0] == levels[1]
    assert asked[0] < asked[1]
