"""Whole runs of faulty measurements: what a page says first, and whether its band holds the plant without the fault."""

import dataclasses

import pytest

from support.fault_catalogue import Faulty
from support.fault_judge import CATALOGUE, faulty_of
from support.fault_plants import simulated
from support.fault_runs import judged_run, ran, run_of

ARM = simulated("arm")


@pytest.mark.slow
def test_the_band_of_clean_data_holds_the_plant_and_none_that_is_two_percent_larger():
    result = run_of(Faulty(response=ARM.response))
    found = judged_run(result, ARM)
    assert found.outcome == "green"
    assert 0.05 < found.distance < 1
    assert judged_run(result, dataclasses.replace(ARM, plant=1.02 * ARM.plant)).outcome == "green and left"


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["stage", "arm", "heater", "matrix"])
@pytest.mark.parametrize(
    "name", ["seam", "seam of the phase", "jitter (random)", "feedback without reference (random)"]
)
def test_no_band_of_a_fault_at_the_limit_leaves_the_plant_without_a_word(plant, name):
    clean = simulated(plant)
    if (faulty := faulty_of(CATALOGUE[name], clean, "limit")) is not None:
        assert ran(faulty, clean).outcome != "green and left"
