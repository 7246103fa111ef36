"""Intervals of the parametric coefficients: the laws of a hard constraint, what people see, and what is refused."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import diagnose
from robustid.identification.formulation import ExactFormulation
from robustid.identification.solver import margin_path
from robustid.report.assumptions import assumptions
from support.cases import slow
from support.intervals import FREE, KINDS, bounded, inside, tight, truthful
from support.pairwise import every_one
from support.problems import identified, in_units, random_problem
from support.refusals import refused
from support.structure import about_structure

# --- laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", [1, slow(3)])
@pytest.mark.parametrize(("power", "form"), every_one([-60, 60], ["orthonormal", "taylor", "sections"]))
def test_units_do_not_matter(power, form, kinds):
    """Every kind of interval in one form at least (slow: in all forms)."""
    turn = ["orthonormal", "taylor", "sections"].index(form)
    for kind in np.roll(KINDS[power > 0 :: 2], turn)[:kinds]:
        problem, unit = bounded(tight(3), kind, 3), 2.0**power
        pair = problem, in_units(problem, unit)
        first, second = (rid.identify(p, solver="structured", form=form) for p in pair)
        assert second.margin == first.margin
        assert second.margin_lower == first.margin_lower
        assert np.array_equal(second.parameters, unit * first.parameters)


@pytest.mark.parametrize("seeds", [1, slow(6)])
@pytest.mark.parametrize("form", ["orthonormal", slow("taylor"), "sections"])
def test_intervals_around_the_truth_never_refute(form, seeds):
    for seed in range(seeds):
        problem, p = truthful(seed)
        before, step = rid.identify(problem, form=form).margin, 1 if form == "orthonormal" or seeds > 1 else 4
        for half in (3.0, 0.3, 1e-3, 1e-9, 0.0)[::step]:  # nested: the margin only rises
            aside = half * np.random.default_rng(seed).uniform(-1, 1, (2, 1)) * (half == 3)
            bounds = np.stack([p - half, p + half], 1) + aside
            result = identified(dataclasses.replace(problem, parameter_bounds=bounds), form=form)
            assert result.consistent
            assert result.margin >= before - 1e-4
            assert inside(result)
            before = result.margin_lower if half < 3 else before


@pytest.mark.parametrize("seeds", [2, slow(6)])
def test_a_fixed_coefficient_belongs_to_the_data(seeds):
    """The margin is that of the data minus the known function, with the other function alone."""
    for seed in range(seeds):
        problem = tight(seed)
        basis, value = problem.parametric, 1.7
        rest = dataclasses.replace(basis, C=basis.C[1:], D=basis.D[1:], functions=basis.functions[1:])
        (f,), (t,) = problem.frequency, problem.time
        lines = f.values - value * basis.response(f.omega * f.dt)[:, :1, None]
        samples = t.y - value * np.convolve(t.u[:, 0], basis.impulse(t.y.size)[:, 0])[: t.y.size, None]
        changed = {"frequency": dataclasses.replace(f, values=lines), "time": dataclasses.replace(t, y=samples)}
        subtracted = dataclasses.replace(problem, **changed, parametric=rest)
        fixed = dataclasses.replace(problem, parameter_bounds=[(value, value), FREE])
        first, second = rid.identify(fixed, solver="structured"), rid.identify(subtracted, solver="structured")
        assert first.margin == pytest.approx(second.margin, abs=1e-6 * max(1, second.margin))
        assert first.parameters[0] == value
        assert first.parameters[1] == pytest.approx(second.parameters[0], rel=1e-3, abs=1e-3)


def test_free_ends_change_nothing():
    problem = tight(5)
    same = dataclasses.replace(problem, parameter_bounds=[FREE, FREE])
    first, second = (rid.identify(p, solver="structured") for p in (problem, same))
    assert (first.margin, first.margin_lower) == (second.margin, second.margin_lower)
    assert np.array_equal(first.parameters, second.parameters)


@pytest.mark.parametrize(
    ("objective", "kind", "noise"),
    every_one(
        ["center", "margin", "gain", "order"],
        [("outside", 0.5), ("outside", 2.0), ("one side", 2.0), ("fixed", 0.5), ("wide", 2.0)],
    ),
)
def test_every_objective_keeps_to_the_intervals(objective, kind, noise):
    problem = bounded(random_problem(2, "parametric", 8, spread=0.4, noise=noise), kind, 2)
    assert inside(identified(problem, objective=objective))


def test_unknown_states_and_intervals_together():
    """Free transients stand beside the bounded coefficients."""
    problem, p = truthful(0)
    free = dataclasses.replace(problem.time[0], initial="free")
    for bounds in (np.stack([p - 0.1, p + 0.1], 1), np.stack([p + 50, p + 51], 1), np.stack([p, p], 1)):
        result = identified(dataclasses.replace(problem, time=free, parameter_bounds=bounds))
        assert inside(result)
        assert result.consistent == (bounds[0, 0] < p[0] + 1)


# --- what people see --------------------------------------------------------------------------------------------------


def test_storage_summary_and_advice(tmp_path):
    problem = bounded(random_problem(0, "parametric", 8, spread=0.3, noise=3.0), "outside", 1)
    result = rid.identify(problem)
    assert problem.samples == sum(r.axis.size for r in result.residuals)
    assert {end for _, end in result.active_intervals} <= set(problem.parameter_bounds.ravel())
    (name, end), *_ = result.active_intervals
    assert f"interval   the coefficient of {name} is at the end {end:.6g} of its interval" in result.summary()
    assert any(
        what == "Intervals" and name in words and "is at the end" in words for what, words in assumptions(result)
    )
    result.save(tmp_path / "result")
    again = rid.load(tmp_path / "result")
    assert np.array_equal(again.problem.parameter_bounds, problem.parameter_bounds)
    assert again.verification.passed
    assert again.active_intervals == result.active_intervals
    trials = {one.name: one.margin for one in diagnose(result).corrections}
    assert trials["coefficients without intervals"] < 0.9 * result.margin
    assert "each pair repeated once more" in trials
    smaller = rid.suggest_prior(dataclasses.replace(problem, parameter_bounds=None), decay_rates=[1.2]).gains[0]
    assert rid.suggest_prior(problem, decay_rates=[1.2]).gains[0] >= smaller
    wrong = dataclasses.replace(problem, parameter_bounds=problem.parameter_bounds + 1e6)
    assert "an interval of its coefficients is wrong" in rid.suggest_prior(wrong, decay_rates=[1.2]).reason


def test_a_forged_point_outside_its_interval_fails():
    problem = bounded(random_problem(0, "parametric", 8, spread=0.3, noise=3.0), "outside", 1)
    data = ExactFormulation(problem).data
    *_, (point, _, _) = margin_path(data)
    for shift in (1.5, -1.5):
        p = point.p + shift * np.eye(2)[0] * np.diff(data.rows.ends[0])
        assert data.margin(point.x, p) == np.inf
    assert data.margin(point.x, point.p) < np.inf


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        ([0.0, 1.0], "shape \\(m, 2\\) with m = 2"),
        ([[0.0, 1.0]], "got \\(1, 2\\)"),
        ([[0.0, np.nan], [0.0, 1.0]], "number 0 .* must not be NaN"),
        ([[0.0, 1.0], [2.0, 1.0]], "number 1 .* lower end above the upper one: 2 > 1"),
        ([[0.0, np.inf], [0.0, 1.0]], "number 0 .* one infinite end"),
        ([[0.0, 1.0], [-np.inf, 1.0]], "number 1 .* one infinite end"),
        ([[np.inf, np.inf], [0.0, 1.0]], "number 0 .* one infinite end"),
        ([["a", "b"], ["c", "d"]], "must be an array of numbers"),
        ([[0.0, 1j], [0.0, 1.0]], "must be real"),
    ],
)
def test_bad_intervals(bounds, words):
    problem = random_problem(0, "parametric", 8)
    refused(words, dataclasses.replace, problem, error=rid.RobustIdError, parameter_bounds=bounds)


def test_intervals_need_functions():
    problem = random_problem(0, "mixed", 8)
    refused("`parametric`, which is missing", dataclasses.replace, problem, parameter_bounds=[[0.0, 1.0]])


def test_intervals_take_the_place_of_samples_that_tell_coefficients_apart():
    """One line, four functions: refused with free coefficients, and a bounded set where all of them lie in intervals."""
    data = rid.datasets.flexible_structure(lines=1, samples=2)
    refused("cannot tell its 4 functions", lambda: rid.identify(about_structure(data, 0.1, 1.3)))
    box = np.tile([-20.0, 20.0], (4, 1))
    held = rid.identify(about_structure(data, 0.1, 1.3, parameter_bounds=box))
    assert held.consistent
    error = rid.worst_case_error(held, omega=[30.0], directions=4)
    assert error.certified
    assert np.all(np.abs(held.parameters) <= 20)
    # One complex line tells two real functions apart, not three.
    free = np.where(np.arange(4)[:, None] < 3, FREE, box)
    refused("cannot tell its 3 functions", lambda: rid.identify(about_structure(data, 0.1, 1.3, parameter_bounds=free)))
