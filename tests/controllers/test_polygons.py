"""Conditions and worst cases over convex sets of plants, discs and polygons alike: against all of their values, sampled densely."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.conditions import conditions_of
from robustid.controllers.discs import Discs
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.program import Functions
from robustid.controllers.search import Question, found_for
from robustid.controllers.worst_at import closed_by
from robustid.design import PID
from robustid.guarantees import ErrorSets, LoopValues
from robustid.guarantees.linear.polygon_discs import hull
from support.design_cases import DT, sizes_of, values_of
from support.halvings import arcs_halved
from support.loop_candidates import consistent_members, is_stable


def polygons(rng, count):
    """Corners of random convex sets about 0, from thin to round, (count, 12): the last one again where there are fewer."""
    found = np.empty((count, 12), complex)
    for k in range(count):
        points = rng.standard_normal(9) + 1j * rng.standard_normal(9) * 10 ** rng.uniform(-2, 0)
        corners = hull(points * np.exp(2j * np.pi * rng.random()) * rng.uniform(0.05, 0.3))
        found[k] = np.pad(corners, (0, 12 - corners.size), mode="edge")
    return found


def inside(rng, corners, count):
    """Values of every hull: of its border, which holds the worst, and within; (N, count)."""
    first, part = rng.integers(0, corners.shape[1], count), rng.random(count)
    second = np.where(rng.random(count) < 0.8, (first + 1) % corners.shape[1], rng.integers(0, corners.shape[1], count))
    edge = corners[:, first] * part + corners[:, second] * (1 - part)
    middle = corners.mean(axis=1, keepdims=True)
    return np.concatenate([edge, corners, middle + (edge - middle) * rng.random(count)], axis=1)


def cases(seed, count):
    """Polygons about random centres, as they are held by discs, and their values."""
    rng = np.random.default_rng([72, seed])
    corners, centre = polygons(rng, count), 0.6 * np.exp(2j * np.pi * rng.random(count)) * rng.uniform(0.3, 2, count)
    radius = np.abs(corners).max(axis=1)
    discs = Discs.of(np.ones(count), centre[:, None, None], radius, np.ones((count, 1)))
    held = discs._replace(corners=corners, around=np.zeros(count))
    return rng, held, centre[:, None] + inside(rng, corners, 600)


def around(discs):
    """The loop of the centres of discs without a controller."""
    one, F = np.ones(discs.centre.shape), discs.centre
    return LoopValues.at(np.block([[one, 0 * F, 0 * F], [F, one, one], [one, 0 * F, 0 * F]]), (1, 1))


def errors_of(discs):
    """Their polygons, about the centres."""
    radius = discs.radius[:, None, None]
    return ErrorSets(radius, 0j * radius, radius, discs.corners)


LIMITS = {
    "sensitivity_peak": (1.7, lambda F, C: sizes_of(F, C)["sensitivity"]),
    "complementary_peak": (1.4, lambda F, C: sizes_of(F, C)["complementary_sensitivity"]),
    "control_peak": (1.1, lambda F, C: sizes_of(F, C)["control_sensitivity"]),
    "attenuation": (0.8, lambda F, C: sizes_of(F, C)["sensitivity"]),
    "roll_off": (0.6, lambda F, C: sizes_of(F, C)["complementary_sensitivity"]),
    "tracking": (0.7, lambda F, C: 0.7**2 / sizes_of(F, C)["complementary_sensitivity"]),
    "action": (1.1, lambda F, C: sizes_of(F, C)["control_sensitivity"]),
    "bandwidth": (2.0, lambda F, C: 2.0 * 1.005 / np.abs(F * C)),
}


@pytest.mark.parametrize("name", LIMITS)
def test_conditions_are_the_limits_for_all_values_of_a_polygon(name):
    """Kept exactly where the worst value keeps them, as long as -1 is not between the values of the open loop."""
    limit, size = LIMITS[name]
    given = limit if name.endswith("peak") or name == "bandwidth" else [(0.5, 2.0, limit)]
    rng, held, F = cases(1, 1000)
    C = rng.standard_normal(1000) + 1j * rng.standard_normal(1000)
    (condition,) = conditions_of(Limits(**{"sensitivity_peak": None, name: given}), held)
    excess, worst = condition.excess(C[:, None, None]), size(F, C[:, None]).max(axis=1)
    if name not in ("roll_off", "tracking"):
        outside = (
            Discs.least.fget(
                held._replace(centre=held.centre + (1 / C if name != "bandwidth" else 0 * C)[:, None, None])
            )
            > 0
        )
        assert np.all(outside[excess > 0])
        excess, worst = excess[outside], worst[outside]
    clear = np.abs(worst / limit - 1) > 0.02
    assert np.array_equal(excess[clear] >= 0, worst[clear] <= limit)
    assert 30 < np.sum(excess[clear] >= 0) < clear.sum() - 30


def test_margins_keep_their_polygons_clear_of_all_values():
    rng, held, F = cases(2, 1000)
    C = rng.standard_normal(1000) + 1j * rng.standard_normal(1000)
    (gain,) = conditions_of(Limits(sensitivity_peak=None, gain_margin=2.0), held)
    L = F * C[:, None]
    near = np.min([np.abs(1 + L - x).min(axis=1) for x in np.linspace(0, 0.5, 40)], axis=0)  # from the segment
    excess = gain.excess(C[:, None, None])
    assert np.all(near[excess > 0] >= excess[excess > 0] * (1 - 1e-9))
    apart = excess > 0.05
    assert np.all(near[apart] <= excess[apart] * 1.2)
    assert apart.sum() > 300


def test_a_cone_at_the_corners_is_the_condition_and_wins_over_the_disc():
    """The largest real C with |S| <= 2 for plants on a segment, and for those in the disc about it: both in closed form."""
    centre, half = -0.5, 0.2j  # F = -0.5 + j t, |t| <= 0.2: |1 + F C| >= 1/2 until C = 1
    discs = Discs.of(np.ones(1), np.full((1, 1, 1), centre, complex), np.array([0.2]), np.ones((1, 1)))
    thin = discs._replace(corners=np.array([[half, -half]]), around=np.zeros(1))
    functions = Functions(np.ones((1, 1, 1, 1), complex), np.eye(1), np.eye(1))
    for held, most in ((thin, 1.0), (discs, 0.5 / 0.7)):
        for C, kept in ((most * 0.999, True), (most * 1.001, False)):
            question = Question(
                functions, conditions_of(Limits(sensitivity_peak=2.0), held), (np.ones((1, 1)), np.array([C]))
            )
            found = found_for(question, np.full((1, 1, 1), C, complex), lambda _: True)
            assert (found is not None) == kept


def test_worst_cases_over_polygons_hold_and_are_near_the_worst_value():
    rng, held, F = cases(3, 1000)
    C = rng.standard_normal(1000) + 1j * rng.standard_normal(1000)
    true, found = sizes_of(F, C[:, None]), {}
    for balls in closed_by(around(held), C).over(errors_of(held)):
        found = {name: np.minimum(ball.largest, found.get(name, np.inf)) for name, ball in balls.items()}
    for name, bound in found.items():
        worst = true[name].max(axis=1)
        finite = np.isfinite(bound)
        assert np.all(bound[finite] >= worst[finite] * (1 - 1e-9)), name
        if name == "sensitivity":
            clear = worst < 4
            assert np.all(bound[clear] <= worst[clear] * 1.02)
            discs = closed_by(around(held), C).balls(held.radius[:, None, None])[name].largest
            assert np.isinf(discs).sum() > 5 * np.sum(~finite)
    outside = Discs.least.fget(held._replace(centre=held.centre + (1 / C)[:, None, None])) > 0.02
    assert np.all(np.isfinite(found["sensitivity"][outside]))


@functools.cache
def refined():
    """The band of a lag, with polygons, and plants that the data allow."""
    plant = control.ss(control.tf([0.1], [1, -0.9], DT))
    lines = np.linspace(3.0, 312.0, 20)
    frf = rid.FrequencyResponse(
        lines, values_of(plant, lines), bound=0.1 * np.abs(values_of(plant, lines)) + 0.01, dt=DT
    )
    plain = rid.band(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.2, decay_rate=1.08)), model=plant)
    result = rid.identify(plain.problem)
    with arcs_halved(0):
        band = plain.refine(result, omega=[0.3, 12.0])
    return plain, band, consistent_members(result, 2, np.random.default_rng(0), [5.0])


@pytest.mark.slow
def test_polygons_of_a_band_hold_the_plants_that_the_data_allow_and_prove_more_of_a_loop():
    plain, band, members = refined()
    omega = np.geomspace(0.3, 12.0, 60)
    discs = Plants.of(band).discs(omega)
    assert np.sum(discs.around == 0) > 20
    for one in members:
        assert np.all(discs._replace(centre=discs.centre - values_of(one, omega)[:, None, None]).least <= 1e-9)
    law = control.ss(1.0, 1.0, 0.12, 0.3, DT)
    wide, found = (rid.loop_bounds(one, controller=law) for one in (plain, band))
    assert found.guaranteed
    assert found.peaks["sensitivity"].value < 0.99 * wide.peaks["sensitivity"].value
    assert found.sensitivity.max() <= found.peaks["sensitivity"].value
    fine = np.geomspace(0.1, np.pi / DT, 3000)
    for one in members:
        assert is_stable(one, law)
        for name, size in sizes_of(values_of(one, fine), values_of(law, fine)).items():
            assert size.max() <= found.peaks[name].value


@pytest.mark.slow
def test_a_refined_band_has_a_faster_loop_which_plants_that_the_data_allow_keep():
    plain, band, members = refined()
    before, after = (rid.design_controller(one, PID(filter=200.0)) for one in (plain, band))
    assert {before.status.name, after.status.name} == {"PROVED"}
    assert after.level > 1.02 * before.level
    fine = np.geomspace(0.1, np.pi / DT, 3000)
    for one in members:
        assert is_stable(one, after.controller)
        for name, size in sizes_of(values_of(one, fine), values_of(after.controller, fine)).items():
            assert size.max() <= after.proofs[0].peaks[name].value
