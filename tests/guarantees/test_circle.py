"""Bounds on the whole circle: no system exceeds them, what ran out of time holds, and what is remembered."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget, response
from robustid.guarantees import CircleBound, worst_case_result
from robustid.guarantees.circle import Remembered, joined
from robustid.guarantees.linear.entry_band import EntryBands
from robustid.guarantees.whole_axis import discs_of_entries, whole_axis, without_long_records
from robustid.identification import Functional
from robustid.identification.formulation import Candidate
from robustid.identification.model import nominal_model
from support.cases import slow
from support.edge_bands import edge_plant
from support.passive import passive_edge
from support.problems import CASES, random_experiment


def members(error, count=4):
    """Consistent systems at the extremes of the set."""
    consistent = error.consistent_set
    rng = np.random.default_rng(0)
    n, m = consistent.data.sarason.pair.order, consistent.data.rows.P.shape[1]
    for _ in range(count):
        found = consistent.extreme(Functional(rng.standard_normal(n), rng.standard_normal(m)), 0.05)
        x, p = 0.999 * found.x + 0.001 * consistent.center.x, 0.999 * found.p + 0.001 * consistent.center.p
        yield x, p


TWENTY = [slow(seed, case, 10, 100_000) for case in CASES for seed in range(60, 65)]


@pytest.mark.parametrize(
    ("seed", "case", "coefficients", "points"), [(4, "parametric", 8, 5_000), slow(4, "mixed", 8, 20_000), *TWENTY]
)
def test_no_system_exceeds_the_bound_on_the_circle(seed, case, coefficients, points):
    """Cell by cell: the truth, and central interpolants of extreme coefficients."""
    problem, truth = random_experiment(seed, case, coefficients)
    error = rid.worst_case_error(rid.identify(problem), omega=[50.0, 90.0])
    sums = error.circle
    assert error.known_circle is None
    assert error.circle is sums
    circle = error.on_circle(0.2)
    assert circle.converged
    assert error.hinf == circle.largest
    assert circle.edges[0] == 0
    assert circle.edges[-1] == pytest.approx(np.pi / problem.dt)
    omega = np.linspace(0, np.pi / problem.dt, points)
    assert (sums.edges[0], sums.edges[-1]) == (0, pytest.approx(np.pi / problem.dt))
    each = [
        one.bound[np.clip(np.searchsorted(one.edges, omega, side="right") - 1, 0, one.bound.size - 1)]
        for one in (circle, sums)
    ]
    bound = np.minimum(*each)
    nominal, worst = response(error.model, omega * problem.dt), 0.0
    assert np.all(np.abs(truth.response(omega * problem.dt) - nominal) <= bound)
    for x, p in members(error):
        point = Candidate(x, p, np.zeros(0), np.zeros((0, 0)), "")
        member = nominal_model(error.consistent_set.posed, point, 1.0).model
        away = np.abs(response(member, omega * problem.dt) - nominal)
        assert np.all(away <= bound)
        worst = max(worst, away.max())
    assert circle.lower <= circle.largest
    assert seed != 4 or worst >= 0.05 * circle.largest


def test_a_bound_on_the_circle_that_ran_out_of_time_holds_and_goes_on():
    problem, truth = random_experiment(1, "mixed", 8)
    error = rid.worst_case_error(rid.identify(problem), omega=[50.0], directions=6)
    first = error.on_circle(0.02, time_limit=1e-9)
    assert not first.converged
    omega = np.linspace(0, np.pi / problem.dt, 200)
    away = np.abs(truth.response(omega * problem.dt) - response(error.model, omega * problem.dt))
    cell = np.clip(np.searchsorted(first.edges, omega, side="right") - 1, 0, first.bound.size - 1)
    assert np.all(away <= first.bound[cell])
    told = []
    second = error.on_circle(0.5, progress=lambda text, done, count: told.append((done, count)))
    assert second.converged
    assert set(first.edges) <= set(second.edges)
    assert told[-1][0] == told[-1][1]
    assert error.hinf == second.largest


def test_an_attribute_is_a_bound_however_little_work_it_may_take(monkeypatch):
    """Of classes without a gain bound, of which the circle has no sums: wider with less work, and not remembered."""
    truth, problem = passive_edge(4, "positive", 1)
    error = rid.worst_case_error(rid.identify(problem), omega=[1.0], directions=4, rtol=0.3)
    found = []
    for seconds in (1e-9, 0.2):  # the ends alone; some frequencies
        monkeypatch.setattr(worst_case_result, "_AT_ONCE", seconds)
        circle = dataclasses.replace(error).circle
        omega = np.linspace(*circle.edges[[0, -2]], 400)[:-1]
        bound = circle.bound[np.searchsorted(circle.edges, omega, side="right") - 1]
        assert np.all(np.abs(truth(1j * omega)[:, 0, 0] - error.model(1j * omega)) <= bound)
        found.append((circle, bound))
    (ends, wide), (more, narrow) = found
    assert not ends.converged
    assert ends.bound.size < more.bound.size
    assert np.all(narrow <= wide)
    assert np.median(narrow) < np.inf
    assert error.known_circle is None
    assert error.on_circle(0.5, time_limit=0.1).largest == error.hinf


@pytest.mark.parametrize(("seed", "case"), [(4, "parametric"), slow(1, "mixed")])
def test_a_weight_is_above_the_truth_and_costs_no_semidefinite_program(seed, case, monkeypatch):
    problem, truth = random_experiment(seed, case, 8)
    error = rid.worst_case_error(rid.identify(problem), omega=[50.0, 90.0], directions=6)
    monkeypatch.setattr(type(error.consistent_set), "extreme", None)
    weight = error.weight()
    assert weight.certified
    omega = np.linspace(0, np.pi / problem.dt, 5000)
    away = np.abs(truth.response(omega * problem.dt) - response(error.model, omega * problem.dt))
    assert np.all(away <= np.abs(response(weight.model, omega * problem.dt)))
    edges, bound = joined(error.circle)
    assert edges.size < error.circle.edges.size
    cell = np.searchsorted(edges, (error.circle.edges[1:] + error.circle.edges[:-1]) / 2) - 1
    assert np.all(bound[cell] >= error.circle.bound)
    assert np.all(bound[cell] <= 1.05 * error.circle.bound)


def test_a_circle_that_is_still_unbounded_goes_on_from_its_arcs():
    remembered = Remembered()
    for arcs in (2, 3, 2):
        bound = np.append(np.ones(arcs - 1), np.inf)
        remembered.take(CircleBound(np.linspace(0, np.pi, arcs + 1), bound, 0.5, False, ()))
    assert remembered.bound is not None
    assert remembered.bound.bound.size == 3


def test_long_records_beside_responses_are_left_out_of_sums_on_the_circle():
    """The truth stays inside of what is left; short records, and those without a response, stay in."""
    plant = edge_plant("record", 0)
    several = dataclasses.replace(plant.exact, time=6 * plant.exact.time)
    lines = without_long_records(several)
    assert not lines.time
    assert lines.frequency == several.frequency
    for kept in (plant.exact, dataclasses.replace(several, frequency=None)):
        assert without_long_records(kept) is kept
    bands = EntryBands(lines, discs_of_entries(lines, None, np.array([10.0]), 100, Budget()))
    circle = whole_axis(bands, control.ss(0.5, 0.0, 0.0, 0.0, several.dt))
    w = np.linspace(1.0, 0.999 * plant.top, 2000)
    cell = np.searchsorted(circle.edges, w, side="right") - 1
    assert np.all(np.abs(plant.truth(w)[:, 0, 0]) <= circle.bound[cell])
