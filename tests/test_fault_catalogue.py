"""The catalogue of faults: clear ones are named with what undoes them, and clean measurements are told nothing."""

from collections import Counter

import pytest

from support.cases import slow
from support.fault_judge import STRENGTHS, catalogue, found_faults, judged
from support.fault_plants import MEASURED, SIMULATED, measured, short, simulated
from support.measured import realdata

NAMED = 0.95  # of all clear faults
TOLD = 0.02  # of clean measurements


def outcomes(plants, strengths=STRENGTHS, every=1):
    return {
        (name, plant, strength): found.outcome
        for plant, clean in plants.items()
        for name, fault in list(catalogue().items())[::every]
        for strength in strengths
        if (found := judged(fault, clean, strength)) is not None
    }


@pytest.mark.parametrize("every", [18, *map(slow, (9, 1))])
def test_clear_faults_are_named_with_what_undoes_them(every):
    found = outcomes({"arm": simulated("arm")}, ("clear",), every)
    missed = {name for (name, _, _), outcome in found.items() if outcome != "named"}
    assert len(found) > 80 // every
    assert not missed


@pytest.mark.slow
@pytest.mark.parametrize("plants", [SIMULATED, pytest.param(MEASURED, marks=realdata)])
def test_on_all_plants_nearly_all_clear_faults_are_named(plants):
    found = outcomes({name: simulated(name) if name in SIMULATED else measured(name) for name in plants}, ("clear",))
    counts = Counter(found.values())
    assert counts["named"] >= NAMED * counts.total(), {
        key: outcome for key, outcome in found.items() if outcome != "named"
    }


@pytest.mark.parametrize(
    ("plants", "seeds"),
    [(("arm", "heater"), range(1)), *(slow(SIMULATED, each) for each in (range(1), range(1000, 1200)))],
)
def test_clean_measurements_are_told_nothing(plants, seeds):
    told = [(name, seed, found) for seed in seeds for name in plants if (found := found_faults(simulated(name, seed)))]
    assert len(told) <= TOLD * len(seeds) * len(plants), told


@pytest.mark.parametrize("seeds", [range(8), slow(range(300))])
def test_clean_short_records_are_told_nothing(seeds):
    told = [(clean.name, seed, found) for seed in seeds if (found := found_faults(clean := short(seed)))]
    assert len(told) <= TOLD * len(seeds), told
