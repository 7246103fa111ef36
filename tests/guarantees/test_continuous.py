"""Guarantees in continuous time: bounds that hold for truths at the edge of the class, at frequencies and up to infinity."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from support.cases import seeds, slow
from support.half_plane import edge_truth
from support.passive import passive_edge
from support.refusals import refused


def edge_problem(seed, gain=0.5, decay=1.5, points=7, bound=0.02):
    """A truth at the edge of its class: modes, a rest of modulus `gain` on the whole line, noise at the ends of its bounds."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(0.2, 12, points))
    mode = control.ss(control.tf([rng.uniform(-2, 2), rng.uniform(-20, 20)], [1, 2 * 0.02 * 5, 25]))
    truth = edge_truth(rng, gain, decay, int(rng.integers(1, 5)), 4.0) + mode
    noise = bound * np.exp(2j * np.pi * rng.random(points))
    wide = bound * (1 + 1e-3)  # beyond the accuracy of the margin
    frf = rid.FrequencyResponse(omega, truth(1j * omega) + noise, bound=wide)
    prior = rid.Prior(gain_bound=gain * (1 + 1e-9), decay=decay)
    return truth, rid.MixedProblem(frequency=frf, prior=prior, parametric=rid.kautz(5.0, 0.02, dt=0))


@pytest.mark.parametrize("seed", seeds(1, 100))
def test_truths_at_the_edge_of_the_class_are_inside(seed):
    truth, problem = edge_problem(seed)
    found = rid.identify(problem).require()
    grid = np.array([0.0, 0.7, 5.1, 20.0])
    error = rid.worst_case_error(found, omega=grid, directions=8, rtol=0.1)
    away = np.abs(truth(1j * grid) - found.model(1j * grid))
    assert np.all(away <= error.sigma_upper * (1 + 1e-9))
    assert np.all(error.sigma_lower <= error.sigma_upper)
    assert error.verify()


@pytest.mark.parametrize("problem", [edge_problem(3)[1], passive_edge(3, "positive", 1)[1]], ids=["gain", "positive"])
def test_more_data_never_widen_the_band(problem):
    (frf,) = problem.frequency
    few = dataclasses.replace(problem, frequency=frf.select(slice(0, None, 2)))
    wide, narrow = (
        rid.worst_case_error(rid.identify(one), omega=[1.0, 5.0], directions=8, rtol=0.05) for one in (few, problem)
    )
    for one, other in zip(wide.values, narrow.values, strict=True):
        before, after = (np.abs(v.vertices[:, None] - v.vertices).max() for v in (one, other))
        assert after <= before * 1.05


def test_the_bound_on_the_axis_holds_up_to_infinity(tmp_path):
    truth, problem = edge_problem(5, gain=0.4, decay=6.0)
    found = rid.identify(problem).require()
    error = rid.worst_case_error(found, omega=[1.0, 5.0], directions=4)
    circle = error.on_circle(0.3)
    assert circle.converged
    assert circle.edges[-1] == np.inf
    assert error.circle_supported
    s = 1j * np.concatenate([np.linspace(0, 15, 400), np.geomspace(15, 1e5, 200)])
    away, cell = np.abs(truth(s) - found.model(s)), np.searchsorted(circle.edges, np.abs(s), side="right") - 1
    assert np.all(away <= circle.bound[cell])
    assert circle.bound[-1] >= 0.4  # nothing but the gain bound is known there
    error.save(tmp_path / "bound.json")
    again = rid.load(tmp_path / "bound.json")
    assert again.known_circle.edges[-1] == np.inf
    assert again.verify()


@pytest.mark.slow
def test_the_frequency_as_a_node_or_a_tail():
    _, problem = edge_problem(7, points=8)
    exact, sections = (rid.identify(problem, form=form) for form in ("orthonormal", "sections"))
    assert exact.margin == pytest.approx(sections.margin, abs=1e-3)
    bounds = [rid.worst_case_error(one, omega=[3.0], directions=8, rtol=0.02) for one in (exact, sections)]
    areas = [np.ptp(one.values[0].vertices.real) for one in bounds]
    assert areas[0] == pytest.approx(areas[1], rel=0.05)


def test_a_small_model_is_continuous_and_inside_every_bound():
    rng = np.random.default_rng(0)
    omega = np.linspace(1, 20, 16)
    truth = control.ss(control.tf([4.0], [1, 0.4, 16.0])) + control.ss(control.tf([1.0], [1, 9.0]))
    frf = rid.FrequencyResponse(omega, truth(1j * omega) + 0.004 * np.exp(2j * np.pi * rng.random(16)), bound=0.005)
    prior = rid.Prior(gain_bound=0.4, decay=4.0)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=rid.kautz(4.0, 0.05, dt=0)))
    small = rid.reduce_within_bounds(found)
    assert small.model.dt == 0
    assert small.order <= 3
    assert np.linalg.eigvals(small.model.A).real.max() < 0
    assert np.abs(small.model(1j * omega) - frf.values[:, 0, 0]).max() <= 0.005


def test_what_needs_a_sample_time_says_so():
    _, problem = edge_problem(1, points=6)
    found = rid.identify(problem)
    refused("a response in time needs a sample time", rid.guarantee.response_tube, found)
    refused("`model` must be continuous", rid.worst_case_error, found, model=SAMPLED, omega=[1.0])


SAMPLED = control.ss(0.5, 1, 1, 0, 0.1)


def flexible():
    """A continuous nominal model, edges up to infinity and a bound on every cell."""
    nominal = control.ss(control.tf([4.0], [1, 0.4, 16.0]))
    edges = np.array([0.0, 1.0, 3.0, 5.0, 20.0, np.inf])
    return nominal, edges, np.array([0.02, 0.05, 0.2, 0.1, 0.05])


def test_a_continuous_weight_is_above_the_bound_on_the_whole_axis():
    nominal, edges, bound = flexible()
    weight = rid.guarantee.uncertainty_weight(nominal, edges, bound)
    assert weight.certified
    assert weight.model.dt == 0
    poles, zeros = weight.model.poles(), weight.model.zeros()
    assert max(poles.real.max(), zeros.real.max()) < 0
    omega = np.concatenate([np.linspace(1e-3, 30, 3000), np.geomspace(30, 1e6, 300)])
    cell = np.searchsorted(edges, omega, side="right") - 1
    assert np.all(np.abs(weight.model(1j * omega)) >= bound[cell] * (1 - 1e-9))
    pair = weight.to_control()
    assert pair.nominal is nominal
    assert pair.controller(nominal) is nominal


@pytest.mark.parametrize("kind", ["additive", *(slow(k) for k in ("multiplicative", "inverse"))])
def test_the_margin_of_a_continuous_loop_is_that_of_a_fine_grid(kind):
    nominal, edges, bound = flexible()
    nominal = nominal + control.ss([], [], [], [[2.0]])  # no zero near the axis: relative bounds are finite
    controller = control.ss(control.tf([0.3, 1.0], [0.05, 1.0]))
    found = rid.guarantee.robust_stability_margin(nominal, controller, edges, bound, kind=kind)
    omega = np.concatenate([np.linspace(1e-4, 30, 20000), np.geomspace(30, 1e7, 1000)])
    F, K = nominal(1j * omega), controller(1j * omega)
    loop = {"additive": K / (1 + F * K), "multiplicative": F * K / (1 + F * K), "inverse": 1 / (1 + F * K)}[kind]
    gain = bound[np.searchsorted(edges, omega, side="right") - 1] * np.abs(loop)
    assert found.margin == pytest.approx(1 / gain.max(), rel=3e-3)
    assert found.margin <= 1 / gain.max() * (1 + 1e-9)
    assert found.edges[-1] == np.inf
    margin = rid.guarantee.robust_stability_margin
    refused("must end at infinity", margin, nominal, controller, edges[:-1], bound[:-1])
    refused("`controller` must be continuous", margin, nominal, SAMPLED, edges, bound)
