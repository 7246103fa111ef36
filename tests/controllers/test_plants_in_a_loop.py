"""Plants measured in a loop, which may be infinite: images of R, conditions for all of them, designs judged by plants."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.conditions import conditions_of
from robustid.controllers.discs import Discs
from robustid.controllers.images import Chart, discs_of_entry, smallest_sets
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.program import Functions
from robustid.controllers.search import Question, found_for
from robustid.controllers.worst_at import worst_at
from robustid.core import StateMatrices
from robustid.design import PID
from robustid.guarantees import ErrorSets
from support.design_cases import DT, measured_in_loop, values_of
from support.loop_candidates import consistent_members, is_stable

COUNT = 400
TURN = np.exp(2j * np.pi * np.arange(720) / 720)
PEAK = 2.0


def complex_numbers(rng, size):
    return rng.standard_normal(size) + 1j * rng.standard_normal(size)


@functools.cache
def cases():
    """Images of random discs of R, half of which hold what makes the plant infinite, and the plants of their borders."""
    rng = np.random.default_rng(45)
    chart = Chart(*(complex_numbers(rng, COUNT) for _ in range(3)))
    centre = 0.3 * complex_numbers(rng, COUNT)
    infinite = np.abs(1 / chart.inner - centre)
    radius = infinite * np.where(np.arange(COUNT) % 2, rng.uniform(0.1, 0.9, COUNT), rng.uniform(1.1, 3.0, COUNT))
    bound = (np.abs(centre) + radius)[:, None, None]
    errors = ErrorSets(bound, centre[:, None, None], radius[:, None, None], np.zeros((COUNT, 0), complex))
    discs = discs_of_entry(np.ones(COUNT), chart, errors)
    change = centre[:, None] + radius[:, None] * TURN
    value, slope, inner = (one[:, None] for one in chart)
    return rng, discs, value + slope * change / (1 - inner * change)


def test_a_disc_of_r_is_a_disc_of_plants_or_all_that_is_outside_of_one():
    _, discs, F = cases()
    assert np.array_equal(discs.outside, np.arange(COUNT) % 2 == 0)
    away = np.abs(F - discs.centre[:, 0])
    assert np.allclose(away, discs.radius[:, None], rtol=1e-6)
    inside = np.abs(discs.plant - discs.centre)[:, 0, 0] < discs.radius
    assert np.array_equal(inside, ~discs.outside)


def worst(name, F, C, limit):
    """Shares of a limit at values of plants."""
    S = 1 / (1 + F * C)
    return {
        "sensitivity_peak": np.abs(S) / limit,
        "complementary_peak": np.abs(F * C * S) / limit,
        "control_peak": np.abs(C * S) / limit,
        "process_peak": np.abs(F * S) / limit,
        "tracking": limit / np.abs(F * C * S),
        "bandwidth": 1.005 / np.abs(F * C),
    }[name]


KINDS = {
    "sensitivity_peak": 1.7,
    "complementary_peak": 1.4,
    "control_peak": 3.0,
    "process_peak": 2.0,
    "tracking": 0.6,
    "bandwidth": 2.0,
}


@pytest.mark.parametrize("name", KINDS)
def test_conditions_are_the_limits_of_all_plants_infinite_ones_too(name):
    """By the maximum principle the worst is on the border, as long as none of the plants is where the map is infinite."""
    limit = KINDS[name]
    rng, discs, F = cases()
    C = 3 * complex_numbers(rng, COUNT)
    found = conditions_of(
        Limits(**{"sensitivity_peak": None, name: [(0.5, 2.0, limit)] if name == "tracking" else limit}), discs
    )
    excess, unit = np.empty(COUNT), np.empty(COUNT)
    for one in found:
        excess[one.place] = one.excess(C[:, None, None])
        unit[one.place] = 1 + np.abs(one.q).max() * np.abs(C[one.place])
        turn = one.directions(C[:, None, None])
        assert np.allclose(one.ahead(C[:, None, None], turn), one.excess(C[:, None, None]), atol=1e-9 * unit[one.place])
    pole = {"bandwidth": 0 * C, "tracking": 0 * C}.get(name, -1 / C)
    away = np.abs(pole - discs.centre[:, 0, 0])
    apart = np.where(discs.outside, away < discs.radius, away > discs.radius)
    share = worst(name, F, C[:, None], limit).max(axis=1)
    kept = apart & (share <= 1)
    sure = (np.abs(share - 1) > 1e-3) | ~apart
    exact = sure & ~((name == "process_peak") & ~discs.outside & (np.abs(discs.centre[:, 0, 0]) < discs.radius))
    assert np.array_equal(kept[exact], excess[exact] >= 0)
    assert not np.any((excess[sure] >= 0) & ~kept[sure])
    assert np.sum(kept & discs.outside) > 3


def test_nothing_rolls_off_where_the_plant_may_be_infinite():
    rng, discs, _ = cases()
    for one in conditions_of(Limits(sensitivity_peak=None, roll_off=[(0.5, 2.0, 0.5)]), discs):
        excess = one.excess(complex_numbers(rng, COUNT)[:, None, None])
        assert np.all(excess[discs.outside[one.place]] < 0)


def test_the_least_gain_of_plants_outside_of_a_disc():
    """F = 1/(R - 0.1) with |R| <= 0.2, which may be infinite: |1 + F C| >= 1/2 for all F from the C in closed form on."""
    chart = Chart(np.array([-10.0 + 0j]), np.array([-100.0 + 0j]), np.array([10.0 + 0j]))
    bound = np.full((1, 1, 1), 0.2)
    errors = ErrorSets(bound, 0j * bound, bound, np.zeros((1, 0), complex))
    discs = discs_of_entry(np.ones(1), chart, errors)
    assert discs.outside.all()
    functions = Functions(np.ones((1, 1, 1, 1), complex), np.eye(1), np.eye(1))
    least = 0.1 + 0.2 + 0.15  # |R - 0.1 + C| >= |R - 0.1|/2 at R = -0.2
    for C, kept in ((least * 0.99, False), (least * 1.01, True)):
        question = Question(
            functions, conditions_of(Limits(sensitivity_peak=2.0), discs), (-np.ones((1, 1)), np.array([-C]))
        )
        found = found_for(question, np.full((1, 1, 1), C, complex), lambda _: True)
        assert (found is not None) == kept


@functools.cache
def cart():
    """An integrator with a lag that was measured under a gain of 2, its loop with 30 lines known to 2 %."""
    plant = control.ss(control.zpk([], [1.0, 0.4], 0.12, DT))
    return plant, *measured_in_loop(plant, 2.0)


@pytest.mark.slow
def test_an_integrator_measured_in_a_loop_has_a_controller_that_no_consistent_plant_contradicts(tmp_path):
    """Systems that the data allow, and values of R on the borders of its discs, 10^4 of them at every frequency."""
    plant, loop, problem, ran = cart()
    plants = Plants.of(ran)
    assert plants.discs(plants.grid()).outside[0]  # the plant may be infinite where its loop has no error
    design = rid.design_controller(ran, PID(filter=200.0), limits=Limits(sensitivity_peak=PEAK))
    assert design.status.name == "PROVED"
    omega = np.geomspace(0.01, np.pi / DT, 1000)
    C, low = values_of(design.controller, omega), omega <= design.level
    near = [one for _, one in design.shares.values() if one > 0]
    found = consistent_members(rid.identify(problem), 20, np.random.default_rng(0), near)
    for one in (plant, *(loop.plant_of(R) for R in found)):
        L = values_of(one, omega) * C
        assert is_stable(one, design.controller)
        assert np.abs(1 / (1 + L)).max() <= PEAK
        assert np.abs(L[low]).min() >= 1
    held, rng = smallest_sets(ran.band.circle.sets_at(omega), np.ones(omega.size)), np.random.default_rng(1)
    middle, radius = values_of(ran.band.model, omega) + held.centre[:, 0, 0], held.radius[:, 0, 0]
    for _ in range(10_000):
        R = middle + radius * np.exp(2j * np.pi * rng.random(omega.size))
        L = R / (1 - 2 * R) * C  # R is the response under the gain of 2
        assert np.abs(1 / (1 + L)).max() <= PEAK
        assert np.abs(L[low]).min() >= 1
    design.save(tmp_path / "design")
    assert rid.load(tmp_path / "design").status.name == "PROVED"
    rid.write_report(design, tmp_path / "design.html")
    print(f"bandwidth {design.level:.4g} rad/s, peak of S {design.proofs[0].peaks['sensitivity'].value:.4g}")


def test_worst_cases_by_hand_of_plants_that_may_be_infinite_are_those_of_the_proof():
    _, loop, _, ran = cart()
    plants = Plants.of(ran)
    law = control.ss([], [], [], 2.4, DT)
    found, proof = worst_at(plants, StateMatrices.of(law), plants.grid()), rid.loop_bounds(ran.band, loop, law)
    assert found.clear
    assert np.isinf(found.radius[0])
    for name, peak in proof.peaks.items():
        assert 0.97 * peak.value <= found.largest[name].max() <= peak.value * (1 + 1e-9), name


def test_smaller_errors_of_r_have_smaller_images():
    plants = Plants.of(cart()[3])
    omega = plants.grid()
    whole, half, none = (plants.discs(omega, np.full(omega.size, part)) for part in (1.0, 0.5, 0.0))
    assert np.all(half.least >= whole.least)
    assert not none.outside.any()
    assert np.allclose(none.radius, 0, atol=1e-9)
    assert np.allclose(none.plant, whole.plant)
    assert isinstance(half, Discs)
