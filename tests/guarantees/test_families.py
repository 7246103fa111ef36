"""Families: union, nominal, drivers and circle against brute force and known truths; members that don't fit."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import responses
from robustid.guarantees import CircleBound
from robustid.guarantees.circle import union_of_circles
from robustid.guarantees.common_nominal import ENOUGH
from support.families import DT, LINES, identified, measured, truth
from support.forging import forge
from support.structure import about_structure

OMEGA = np.array([0.0, 2.0, 11.0, 20.0, np.pi / DT])
GAINS = {"weak": 0.8, "middle": 1.0, "strong": 1.3}


@pytest.fixture(scope="module")
def members():
    return [
        rid.guarantee.Member(identified(g, seed=k), name, amplitude=10 * g) for k, (name, g) in enumerate(GAINS.items())
    ]


@pytest.fixture(scope="module")
def three(members):
    return rid.family(members, omega=OMEGA, directions=8, interval=(5, 13))


def test_every_true_member_is_inside_and_every_bound_certified(three):
    for gain in GAINS.values():
        away = np.abs(truth(gain, three.omega) - three.nominal)
        assert np.all(away <= three.upper[:, 0, 0])
    assert three.certified
    assert three.uppers.shape == (3, 5, 1, 1)


def test_what_holds_of_the_family_is_the_union_over_its_members(three):
    np.testing.assert_array_equal(three.upper, three.uppers.max(axis=0))
    for name in ("lower", "sigma_upper", "sigma_lower"):
        np.testing.assert_array_equal(getattr(three, name), np.max([getattr(e, name) for e in three.errors], axis=0))
    ranges = np.array([e.magnitude for e in three.errors])
    np.testing.assert_array_equal(three.magnitude, np.stack([ranges[..., 0].min(0), ranges[..., 1].max(0)], axis=1))
    names = [claim.name for claim in three.claims()]
    assert len(set(names)) == three.claim_count == sum(e.claim_count for e in three.errors)


def test_the_union_is_that_of_the_polygons_around_any_nominal(three):
    other = control.ss([], [], [], 1.1, DT)
    for family in (three, three.with_model(other)):
        nominal = responses(family.model, OMEGA * DT)[:, 0, 0]
        for k in range(OMEGA.size):
            corners = np.concatenate([m.result.values[k].vertices for m in family.members])
            assert family.upper[k, 0, 0] == pytest.approx(np.abs(corners - nominal[k]).max())
            assert three.centres.radius[k, 0, 0] <= np.abs(corners - nominal[k]).max() * (1 + 1e-9)


def test_the_nominal_is_almost_as_good_as_the_centres_and_small(three):
    assert (three.upper / three.centres.radius).max() <= ENOUGH
    assert three.model.nstates == three.tried[-1][0] <= 2
    assert three.with_model(three.model).upper == pytest.approx(three.upper)


def test_drivers_are_the_largest_bounds_from_low_to_high(three):
    rows = three.drivers()
    assert rows[0].low == 0
    assert rows[-1].high == pytest.approx(np.pi / DT)
    for row in rows:
        part = (three.omega >= row.low) & (three.omega <= row.high)
        mine = three.sigma_uppers[three.names.index(row.member), part]
        assert np.all(mine == three.sigma_uppers[:, part].max(axis=0))
        assert row.upper == mine.max()
        assert row.second <= row.upper


def test_what_is_not_known_between_the_members_is_said(three):
    said = " ".join(three.not_known)
    assert "Measured at amplitude 8, 10, 13; asked about 5 to 13." in said
    assert "between amplitude 8 and 10, nor between amplitude 10 and 13, nor below amplitude 8:" in said
    assert "The widest gap is 3" in said
    assert said.split(".")[0] in three.summary()
    assert "driven by" in three.summary()


def test_without_numbers_nothing_is_said_of_other_conditions(members):
    plain = rid.family({m.name: m.result for m in members}, omega=[2.0], directions=4)
    assert plain.schedule is None
    assert plain.not_known == ("Nothing is proved of the plant under other conditions than those of the members.",)
    stated = rid.family(plain.members[:2], model=plain.model)  # bounded already
    assert stated.upper[0, 0, 0] <= plain.upper[0, 0, 0]


def test_the_circle_the_weights_and_the_margin_are_those_of_all_members(three):
    two = three.members[0], three.members[2]
    three = dataclasses.replace(three, members=two)
    circle = three.on_circle(1.0, everywhere=True)
    assert three.hinf == circle.largest
    omega = np.linspace(0, np.pi / DT, 701)[:-1]
    cell = np.searchsorted(circle.edges, omega, side="right") - 1
    nominal = responses(three.model, omega * DT)[:, 0, 0]
    for gain in (0.8, 1.3):
        assert np.all(np.abs(truth(gain, omega) - nominal) <= circle.bound[cell])
    for error in three.errors:
        for low, high, bound in zip(error.circle.edges, error.circle.edges[1:], error.circle.bound, strict=False):
            inside = (circle.edges[:-1] >= low) & (circle.edges[1:] <= high)
            assert np.all(circle.bound[inside] >= bound)
    weight = three.weight()
    assert weight.certified
    assert np.all(weight.bound == three.cover()[1])
    relative = three.weight(kind="multiplicative")
    assert relative.certified
    middle = responses(three.model, (relative.edges[:-1] + relative.edges[1:]) / 2 * DT)[:, 0, 0]
    assert np.all(relative.bound * np.abs(middle) >= three.circle.bound)
    gain = control.ss([], [], [], 0.2, DT)
    found = three.robust_stability_margin(gain)
    each = [
        rid.guarantee.robust_stability_margin(three.model, gain, e.circle.edges, e.circle.bound) for e in three.errors
    ]
    assert found.margin == pytest.approx(min(one.margin for one in each), rel=2e-3)
    both = [
        three.robust_stability_margin(gain, kind=kind).margin for kind in ("multiplicative", "input_multiplicative")
    ]
    assert both[0] == pytest.approx(both[1], rel=1e-6)  # of one input and one output they are one


def test_the_union_of_circles_is_the_largest_on_every_piece():
    first = CircleBound(np.array([0.0, 1.0, 3.0]), np.array([1.0, 5.0]), 0.5, True, ())
    other = CircleBound(np.array([0.0, 2.0, 3.0]), np.array([2.0, 4.0]), 0.7, False, ())
    both = union_of_circles([first, other])
    assert both.edges.tolist() == [0, 1, 2, 3]
    assert both.bound.tolist() == [2, 5, 5]
    assert (both.lower, both.converged) == (0.7, False)


def test_a_member_over_a_pole_uncertainty_box():
    """The band covers plants whose poles are elsewhere in the box; the circle takes its time, which no attribute does."""
    data = rid.datasets.flexible_structure(lines=5, samples=2, extra_hz=[17.6, 17.7])
    problem, frf = about_structure(data, 0.1, 1.3), data.frequency
    shifted = dataclasses.replace(frf, values=frf.values * (1 + 1e-3))
    first, second = (rid.identify(one) for one in (problem, dataclasses.replace(problem, frequency=shifted)))
    box = data.modes[:, :1] * [0.999, 1.001], data.modes[:, 1:] * [0.95, 1.05]
    omega = 2 * np.pi * np.array([30.0])
    alone = rid.family([first, second], omega=omega, directions=4)
    wide = rid.family(
        [rid.guarantee.Member(first, "a", poles=box), rid.guarantee.Member(second, "b")],
        omega=omega,
        directions=4,
        model=alone.model,
    )
    assert wide.certified
    assert wide.uppers[0, 0] >= alone.uppers[0, 0]
    assert wide.uppers[1, 0] == alone.uppers[1, 0]
    around = wide.centres
    assert np.all(np.abs(alone.centres.centre - around.centre) + alone.centres.radius <= around.radius * (1 + 1e-9))
    assert np.isfinite(wide.hinf)
    assert wide.known_circle is None


# Bad input.


def refused(members, words, error=rid.InputError, **options):
    with pytest.raises(error, match=words):
        rid.family(members, **{"omega": [2.0], "directions": 4} | options)


def test_one_member(members):
    refused(members[:1], "`members` has 1: a family is made of two or more")


def test_identical_members(members):
    twin = dataclasses.replace(members[0], name="twin")
    refused([members[0], twin], "'weak' and 'twin' hold the same data")


def test_unlike_sample_times_and_signals(members):
    slow = rid.guarantee.Member(identified(1.0, dt=DT / 2), "slow")
    refused([members[0], slow], "'weak' and 'slow' have different sample times: dt = 0.1 s and dt = 0.05 s")
    other = rid.guarantee.Member(identified(1.0, outputs=["torque [Nm]"]), "other")
    refused([members[0], other], r"different outputs: y and torque \[Nm\]")


def test_signals_that_are_called_otherwise_are_matched_by_their_place_and_this_is_said(members):
    other = rid.guarantee.Member(identified(1.0, outputs=["angle"]), "other")
    found = rid.family([members[0], other], omega=[2.0], directions=4)
    (said,) = found.matched
    assert "outputs of other" in said
    assert "angle is taken for y" in said
    assert said in found.summary()
    alike = rid.family([members[0], rid.guarantee.Member(identified(1.0), "other")], omega=[2.0], directions=4)
    assert alike.matched == ()
    assert np.array_equal(found.upper, alike.upper)


def test_unlike_classes(members):
    narrow = rid.guarantee.Member(identified(1.0, gain_bound=2.0), "narrow")
    refused(
        [members[0], narrow],
        "'weak' and 'narrow' have different values of gain_bound: 3.0 and 2.0; a family is one class",
    )
    pair = rid.kautz(10.0, 0.1, dt=DT, delay=1)
    resonant = rid.guarantee.Member(identified(1.0, parametric=pair), "resonant")
    refused([members[0], resonant], "different parametric parts: 0 functions and 2 functions")


def test_a_member_that_refutes_the_class(members):
    wild = rid.guarantee.Member(identified(9.0), "wild")
    assert not wild.identification.consistent
    refused([members[0], wild], "'wild' .inconsistent, margin", error=rid.errors.InconsistentDataError)


def test_names_and_kinds(members):
    refused([members[0], dataclasses.replace(members[1], name="weak")], "the name 'weak' is given to 2")
    refused(members[0], "`members` must be a sequence", error=TypeError)
    refused([members[0], 3.0], "`result` of a member must be one of Identification", error=TypeError)


def test_schedules_and_intervals(members):
    refused(members, "`schedule` must be one of", schedule="colour")
    refused(members, "every member must state its load", schedule="load")
    refused(members, "`interval` must be two numbers, the lower one first", interval=(3, 1))
    plain = [m.result for m in members]
    refused(plain, "`interval` belongs to a condition", interval=(1, 3))


def test_nominals(members, three):
    refused(members, "`order` is that of the nominal that is fitted", model=three.model, order=2)
    unstable = control.ss(1.1, 1, 1, 0, DT)
    refused(members, "`model` must be stable", model=unstable)
    with pytest.raises(rid.InputError, match="bounded at other frequencies"):
        rid.family([three.members[0], members[1]], omega=[3.0])


def test_progress_counts_all_members(members):
    told = []
    rid.family(members[:2], omega=OMEGA[1:3], directions=4, progress=lambda text, *counts: told.append(counts))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_family_keeps_the_measured_lines_of_its_members(three):
    """`coverage` against what the members were made from: nothing is contradicted."""
    for k, gain in enumerate(GAINS.values()):
        found = rid.coverage(three, measured(gain, seed=k), kind="lines")
        assert found.omega.tolist() == [w for w in LINES if w in OMEGA]
        assert not found.contradicted


def test_a_time_limit_leaves_the_frequencies_that_all_members_have(members, three, caplog):
    """The bounds are those of the whole family there; what is missing is said."""
    omega = np.linspace(0.5, 25.0, 16)
    found = rid.family(members, omega=omega, directions=4, model=three.model, time_limit=0.05)
    assert 1 <= found.omega.size < omega.size
    assert f"{found.omega.size} of 16 frequencies are bounded for all members" in caplog.text
    whole = rid.family(members, omega=found.omega, directions=4, model=three.model)
    np.testing.assert_allclose(found.upper, whole.upper, rtol=1e-9)
    assert found.certified
    bounded = rid.worst_case_error(members[0].result, omega=omega, directions=4)
    mixed = [rid.guarantee.Member(bounded, "weak"), *members[1:]]
    found = rid.family(mixed, directions=4, model=three.model, time_limit=0.05)
    assert found.omega.size < omega.size
    assert np.array_equal(found.members[0].result.missing, np.setdiff1d(omega, found.omega))
    assert found.certified


# Files.


@pytest.fixture(scope="module")
def two():
    members = [
        rid.guarantee.Member(identified(g, seed=k), load=g, date=f"2026-11-0{k + 1}") for k, g in enumerate((0.8, 1.0))
    ]
    return rid.family(members, omega=[2.0, 9.0, np.pi / DT], directions=4)


def test_round_trip(two, tmp_path):
    two.save(tmp_path / "a")
    again = rid.load(tmp_path / "a")
    assert again.summary() == two.summary()
    assert np.array_equal(again.upper, two.upper)
    assert np.array_equal(again.centres.radius, two.centres.radius)
    assert [m.condition for m in again.members] == [m.condition for m in two.members]
    assert (again.schedule, again.interval, again.tried) == (two.schedule, two.interval, two.tried)
    assert again.certified


def test_a_bound_on_the_circle_survives(two, tmp_path):
    circle = two.on_circle(1.0)
    rid.save(tmp_path / "a", two)
    again = rid.load(tmp_path / "a")
    assert all(error.known_circle is not None for error in again.errors)
    assert np.array_equal(again.circle.bound, circle.bound)


@pytest.mark.parametrize("change", [{"members": []}, {"interval": [1]}, {"tried": 3}])
def test_edited_text_is_refused(two, tmp_path, change):
    two.save(tmp_path / "a")
    forge(tmp_path / "a", text=lambda record: record.update(change))
    with pytest.raises(rid.errors.FileFormatError):
        rid.load(tmp_path / "a")
