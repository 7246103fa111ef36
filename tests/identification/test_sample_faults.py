"""Faults of the samples of records that are used as they stand: clean records are told nothing, true faults of samples are."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.data import FaultKind
from robustid.identification.sample_faults import sample_faults
from support.cases import slow
from support.fault_plants import recipes, record, step
from support.faulty_files import record as excited

SAMPLES = 200


def steps(seeds, samples=60):
    for name, recipe in recipes().items():
        for seed in seeds:
            yield name, seed, step(recipe, np.random.default_rng([seed, *map(ord, name)]), samples=samples)


def told(records):
    return [(name, seed, found) for name, seed, one in records if (found := sample_faults(one))]


@pytest.mark.parametrize(
    ("seeds", "samples"),
    [(range(1000, 1008), 60), (range(2), 500), *(slow(range(1000, 1200), samples) for samples in (60, 500))],
)
def test_clean_step_records_are_told_nothing(seeds, samples):
    assert told(steps(seeds, samples)) == []


@pytest.mark.parametrize("seeds", [range(1), slow(range(5))])
@pytest.mark.parametrize("kind", ["periodic", "random"])
def test_clean_excited_records_are_told_nothing(kind, seeds):
    def records():
        for name, recipe in recipes().items():
            for seed in seeds:
                one = record(recipe, np.random.default_rng([seed, *map(ord, name)]), kind=kind, periods=1)
                yield name, seed, one.with_bound(np.broadcast_to(4 * recipe.noise * one.y.std(axis=0), one.y.shape))

    assert told(records()) == []


def changed(one, strength, kind):
    """The record with a fault of the first output, in parts of its largest value."""
    y, top, middle = one.y.copy(), np.abs(one.y[:, 0]).max(), len(one.y) // 2
    if kind == "spike":
        y[middle, 0] += strength * top
    if kind == "jump":
        y[middle:, 0] += strength * top
    if kind == "offset":
        y[:, 0] += strength * top
    if kind == "saturated":
        y[:, 0] = np.minimum(y[:, 0], np.quantile(y[:, 0], 1 - strength))
    return dataclasses.replace(one, y=y)


@pytest.mark.parametrize(
    ("kind", "kinds", "strength"),
    [
        ("spike", {"spike"}, 0.6),
        ("jump", {"jump", "spike"}, 0.4),
        ("offset", {"offset"}, 0.3),
        ("saturated", {"saturated"}, 0.3),
    ],
)
@pytest.mark.parametrize("seeds", [2, slow(6)])
def test_faults_of_samples_are_told_and_within_the_bounds_they_are_harmless(kind, kinds, strength, seeds):
    """Six seeds of each plant of one output (of two, a spike in the answer to one step is mostly not seen)."""
    records = [one for one in steps(range(seeds), SAMPLES) if one[0] != "matrix"]
    found = [{f.kind for f in sample_faults(changed(one, strength, kind))} for *_, one in records]
    assert sum(bool(kinds & one) for one in found) >= 0.8 * len(found), found
    if kind != "saturated":  # a thousandth of the largest value: the bound is a hundredth
        assert told((name, seed, changed(one, 0.001, kind)) for name, seed, one in records) == []


def test_a_problem_of_records_alone_has_the_faults_of_their_samples():
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.05)
    clean, other = excited(0), excited(1)
    assert rid.MixedProblem(time=[clean, other], prior=prior).data_faults == ()
    problem = rid.MixedProblem(time=[clean, changed(other, 0.9, "spike")], prior=prior)
    ((fault, kind, number),) = problem.placed_faults
    assert (fault.kind, fault.record, kind, number) == (FaultKind.SPIKE, 2, "time", 1)
    assert problem.open_faults == (fault,)


def test_records_with_samples_that_are_missing_are_not_judged():
    one = step(recipes()["stage"], np.random.default_rng(0))
    bound = np.where(np.arange(60) == 30, np.inf, 0.01)
    gone = dataclasses.replace(one, y=np.where(np.arange(60)[:, None] == 30, 0.0, one.y), bound=bound)
    assert sample_faults(gone) == []
