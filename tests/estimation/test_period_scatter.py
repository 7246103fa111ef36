"""Scatter from period to period: sample instants that are off, inputs that follow outputs, records that are driven harder."""

import numpy as np
import pytest

import robustid as rid
from support.fault_catalogue import changed
from support.fault_judge import CATALOGUE
from support.fault_plants import answer, recipes, record, simulated

ARM = simulated("arm")


def told(records, *kinds, period=1000):
    return [fault for fault in rid.prepare.record_faults(records, period=period) if fault.kind in kinds]


def of(name, strength, seed=0):
    found = CATALOGUE[name].of(ARM, strength, np.random.default_rng(seed))
    return found.records


@pytest.mark.parametrize(("strength", "size"), [("clear", 0.83), ("limit", 0.1)])
def test_instants_that_are_off_are_named_with_their_size(strength, size):
    """Of one sample rms: between the samples the signal is drawn straight, which takes some of it away."""
    (fault,) = told(of("jitter (periodic)", strength), "jitter")
    assert fault.where == "output y"
    assert fault.size == pytest.approx(size, rel=0.2)


def test_the_size_is_that_of_the_instants_whatever_the_units():
    for power in (-60, 0, 60):
        scaled = [changed(one, y=2.0**power * one.y) for one in of("jitter (periodic)", "limit")]
        (fault,) = told(scaled, "jitter")
        assert fault.size == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize("strength", [pytest.param("clear", marks=pytest.mark.slow), "limit"])
def test_an_input_that_follows_the_output_is_named(strength):
    for seed in range(3):
        (fault,) = told(of("feedback without reference (periodic)", strength, seed), "feedback")
        assert fault.where == "input u and output y"


def test_an_input_that_moves_the_output_is_no_loop():
    """What an amplifier adds to its input goes through the plant: coherent, and by the response."""
    recipe = recipes()["arm"]
    for seed in range(2):
        rng = np.random.default_rng(seed)
        made = []
        for one in ARM.periodic:
            u = np.concatenate([one.u, one.u]) + 0.05 * rng.standard_normal((2 * len(one.u), 1))
            y = answer(recipe.plant, u) + ARM.noise * rng.standard_normal(u.shape)
            made.append(changed(one, u=u[len(one.u) :], y=y[len(one.u) :]))
        assert told(made, "feedback", "jitter") == []


def test_a_reference_ends_the_search_for_a_loop():
    closed = of("feedback without reference (periodic)", "clear")
    known = [changed(one, reference=two.u) for one, two in zip(closed, ARM.periodic, strict=True)]
    assert told(known, "feedback") == []


@pytest.mark.parametrize("many", [5, pytest.param(200, marks=pytest.mark.slow)])
def test_sound_records_are_told_of_neither(many):
    recipe = recipes()["stage"]
    for seed in range(many):
        rng = np.random.default_rng([7, seed])
        assert told([record(recipe, rng) for _ in range(2)], "jitter", "feedback") == []


def test_records_that_are_driven_harder_have_no_fault():
    """A linear plant answers in proportion; the noise stays as it is."""
    rng, sizes = np.random.default_rng(0), (5.0, 1.0)
    made = []
    for one, size in zip(ARM.periodic, sizes, strict=False):
        noise = ARM.noise * rng.standard_normal(one.y.shape)
        made.append(changed(one, u=size * one.u, y=size * one.y + noise))
    assert len(made) == 2
    assert rid.prepare.record_faults(made, period=1000) == ()
