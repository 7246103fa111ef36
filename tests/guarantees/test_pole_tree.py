"""Cells of a box of poles that are halved where the error is largest, other ones at every frequency."""

import dataclasses
import functools
import types

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.guarantees import box_of, placement, pole_tree
from robustid.guarantees.candidates import shares_of
from robustid.guarantees.pole_proofs import KeptCell
from robustid.guarantees.pole_tree import PoleTree
from robustid.guarantees.sweep import Means
from robustid.guarantees.value_set import gap_of, value_set_claims

BOX = np.array([[9.85, 10.15]]), np.array([[0.035, 0.065]])
PEAK, NEAR, BESIDE = 10.0, 12.0, 18.0
SIDES = 8, gap_of(0.1, 8, True)


def response(omega):
    x, a = np.exp(-0.1j * omega), np.exp(-0.05 + 1j * np.sqrt(1 - 0.05**2))
    return 0.3 * x / (1 - a * x) + 0.3 * x / (1 - a.conj() * x) + 1 / (2 - x)


@functools.cache
def identified(omega=10.0, damping=0.05):
    lines = np.linspace(1.0, 25.0, 17)
    values = response(lines) + 0.27 * np.exp(2j * np.pi * np.random.default_rng(0).random(lines.size))
    frf = rid.FrequencyResponse(lines, values, bound=0.3, dt=0.1)
    prior = rid.Prior(gain_bound=2.0, decay_rate=1.5)
    pair = rid.kautz(omega, damping, dt=0.1, delay=1)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=pair))


@functools.cache
def tree():
    found = identified()
    return PoleTree(found.problem, found.model, box_of(found, *BOX, 1), SIDES)


def largest(omega, most):
    """Largest error at a frequency that so many cells prove, and the cells."""
    leaves, told = tree().cover(omega, np.ones((1, 1, 1)), most, Means(), lambda _: None), []
    for leaf in leaves:
        item = leaf.kept(omega)
        told.append(item.values[0].farthest(complex(identified().model(np.exp(0.1j * omega))))[0])
        told[-1] += float(item.slack(np.array([omega])).max())
    return max(told), leaves


@functools.cache
def reached(omega, count):
    """Largest error of consistent systems with poles on a grid of the box."""
    found = []
    for w in np.linspace(*BOX[0][0], count):
        for d in np.linspace(*BOX[1][0], count):
            one = identified(w, d)
            if one.consistent:
                error = rid.worst_case_error(one, model=identified().model, omega=[omega], directions=8, rtol=0.05)
                found.append(error.lower.max())
    return max(found)


def test_more_cells_prove_less_and_never_less_than_consistent_systems_reach():
    one, few, many = (largest(PEAK, most)[0] for most in (1, 4, 8))
    assert reached(PEAK, 3) <= many <= few <= 0.8 * one


@pytest.mark.slow
def test_many_cells_come_near_to_what_consistent_systems_reach():
    """A plain grid of poles, each solved by itself."""
    assert reached(PEAK, 9) <= largest(PEAK, 24)[0] <= 1.1 * reached(PEAK, 9)


def test_sides_of_halves_that_the_multipliers_of_the_whole_prove_hold_too():
    _, leaves = largest(PEAK, 8)
    taken = 0
    for leaf in leaves:
        (found,) = leaf.values[PEAK]
        assert all(claim.verify() for claim in value_set_claims(leaf.found, found))
        taken += leaf.before(PEAK) is not None and bool(np.any(np.isnan(found.points)))  # not all of them were solved
    assert taken


def test_far_from_the_box_one_cell_says_it_all():
    assert len(largest(25.0, 24)[1]) == 1


def test_halves_have_amplitudes_of_their_own():
    """A mode of less damping has a smaller residue for the same peak; what a half says is proved by its own sums."""
    whole = tree().root.cell
    halves = whole.split(identified().problem, 0)
    assert all(half.amplitude[0] < whole.amplitude[0] for half in halves)
    for half in halves:
        np.testing.assert_array_equal(half.proved_again(identified().problem), half.amplitude)
    assert max(half.amplitude[0] for half in halves) >= 0.3


@functools.cache
def polygons():
    plain = rid.band(identified(), omega=[NEAR, BESIDE], box=BOX, knots=40)
    return plain.refine(identified(), omega=[NEAR, BESIDE]).polygons


def test_every_frequency_has_its_own_cells_and_each_cover_is_checked(tmp_path):
    found = polygons()
    used = {tuple(w in item.omega for w in (NEAR, BESIDE)) for item in found.kept}
    assert len(used) > 1  # some cells stand at one frequency alone
    assert found.verify()
    rid.save(tmp_path / "box", found)
    again = rid.load(tmp_path / "box")
    np.testing.assert_array_equal(again.upper, found.upper)
    assert again.verify()
    for w in (NEAR, BESIDE):
        number = next(k for k, item in enumerate(found.kept) if w in item.omega)
        kept = list(found.kept)
        kept[number] = KeptCell(tuple(one for one in kept[number].values if one.omega != w), kept[number].cell)
        less = dataclasses.replace(found, kept=tuple(item for item in kept if item.values))
        assert not less.covered
        assert not less.verify()


def test_an_amplitude_below_the_proved_one_is_not_accepted():
    found = polygons()
    first = found.kept[0]
    small = dataclasses.replace(first.cell, amplitude=0.99 * first.cell.amplitude)
    forged = dataclasses.replace(found, kept=(KeptCell(first.values, small), *found.kept[1:]))
    assert not forged.covered
    unproved = dataclasses.replace(first.cell, proofs=())
    assert not dataclasses.replace(found, kept=(KeptCell(first.values, unproved), *found.kept[1:])).covered


def test_cells_of_which_nothing_is_known_are_no_polygons(monkeypatch):
    """As where the time is over before their margin is decided."""
    monkeypatch.setattr(pole_tree, "looked_at", lambda *_: None)
    found, omega = identified(), np.array([BESIDE, PEAK])
    programs = placement.OverBox(found, found.model, BOX, np.ones((1, 1)), Budget())
    discs = types.SimpleNamespace(error_at=lambda omega, model: np.ones((omega.size, 1, 1)))
    seen, radius = programs.lower(omega, discs, Means())
    assert seen.size == radius.size == 0
    assert programs.polygons() is None


def test_errors_without_bound_are_larger_than_all_others_and_one_of_themselves():
    errors = np.array([[[1.0, np.inf]], [[np.inf, 2.0]], [[4.0, 1.0]]])
    np.testing.assert_array_equal(shares_of(errors, np.array([[2.0, 4.0]])), [np.inf, np.inf, 2.0])
    np.testing.assert_array_equal(shares_of(errors, np.array([[2.0, np.inf]])), [1.0, np.inf, 2.0])
