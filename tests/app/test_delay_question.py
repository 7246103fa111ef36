"""A delay that the data hold and nobody stated is a question, not a model without a word: a plant with it measures the same."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.measurements import Measured, part_of
from robustid.app.run.modes import with_modes, with_questions
from robustid.app.run.run_file import read_run_file
from robustid.app.run.run_folder import Surroundings
from robustid.estimation import delay_fault
from robustid.report.data_faults import fault_verdict
from support.cases import slow
from support.fault_plants import SIMULATED, recipes, record, simulated

OWN = {"stage": 0, "arm": 0, "heater": 4, "matrix": 0}  # samples


def found(frf):
    fault = delay_fault(frf, True)
    return 0 if fault is None else int(fault.size)


def late(one, samples):
    """The outputs of a record later, without its ends."""
    return dataclasses.replace(one, u=one.u[samples:], y=one.y[: len(one.y) - samples])


@pytest.mark.parametrize(("name", "more"), [("stage", 0), ("stage", 3), ("arm", 0), ("arm", 5), ("matrix", 0)])
def test_delay_of_a_response_is_found_to_the_sample_and_none_where_there_is_none(name, more):
    response = simulated(name).response
    assert found(response.without_delay(-more * response.dt)) == more


@pytest.mark.parametrize("more", [0, 3])
def test_delay_below_a_fifth_of_nyquist_is_found_within_a_sample(more):
    """The response of the heater ends there: a pole takes over a part of its four samples."""
    response = simulated("heater").response
    assert abs(found(response.without_delay(-more * response.dt)) - OWN["heater"] - more) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMULATED)
def test_clean_plants_are_asked_for_no_delay_that_they_do_not_have(name):
    """Two in a hundred at most."""
    close = 1 if OWN[name] else 0
    wrong = [seed for seed in range(100) if abs(found(simulated(name, seed).response) - OWN[name]) > close]
    assert len(wrong) <= 2, wrong


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "samples", "silent"), [("stage", 3, 0), ("stage", 40, 0), ("heater", 3, 1), ("heater", 40, 0)]
)
def test_late_channel_of_random_records_is_asked_about(name, samples, silent):
    """Of 20 each, but for one at most where four poles may follow seven samples, below a fifth of Nyquist, as well.

    Seed 3 of the heater: the likelihood of the records themselves, without any response, tells the delay by 1 nat, that of
    five others by 7 to 11.
    """
    recipe, unasked = recipes()[name], []
    for seed in range(20):
        rng = np.random.default_rng([seed, samples])
        records = [late(record(recipe, rng, kind="random"), samples) for _ in range(2)]
        told = found(rid.estimate_frf(records))
        assert not told or abs(told - OWN[name] - samples) <= 1, seed
        unasked += [seed] * (not told)
    assert len(unasked) <= silent, unasked


def questions(frf, **stated):
    """Questions about a response when the poles of the class have been chosen."""
    run, data = part_of(read_run_file(stated, "delay", sources=False), Measured((frf,), ()))
    around = Surroundings(None)
    found = with_questions(with_modes(run, data, around), data, run.modes, around)
    return found.responses[0].faults


@pytest.fixture(scope="module")
def late_response():
    frf = simulated("stage").response
    return rid.prepare.correct(frf.select(np.arange(frf.omega.size) % 4 == 0), "delay 3")


def test_a_run_asks_whose_a_delay_is(late_response):
    (fault,) = questions(late_response)
    assert (fault.kind, fault.size, fault.correction) == ("delay", 3.0, "advance 3")
    (verdict,) = fault_verdict([fault])
    assert (verdict.key, verdict.word) == ("undecided", "Question about the data")
    assert "nobody stated a delay" in verdict.words


@pytest.mark.parametrize("how", [{"modes": {"delay": 3}}, {"delay": {"seconds": 0.006}}])
def test_a_stated_delay_is_not_asked_about(late_response, how):
    assert not questions(late_response, **how)


def test_nothing_is_asked_when_the_delay_is_undone(late_response):
    assert not questions(rid.prepare.correct(late_response, "advance 3"))


def test_of_records_the_record_is_late():
    fault = delay_fault(simulated("heater").response, False)
    assert fault.of_records
    assert not delay_fault(simulated("heater").response, True).of_records


@pytest.mark.parametrize("name", ["stage", slow("matrix")])
def test_of_held_inputs_an_output_that_comes_first_is_told(name):
    """By two samples, which a plant whose response rises with the frequency would explain, were the inputs not held."""
    response = simulated(name).response
    early = response.without_delay(2 * response.dt)
    fault = delay_fault(early, False, held=True)
    assert (fault.kind, fault.size, fault.correction) == ("late", -2.0, "delay 2")
    assert delay_fault(early, False) is None
    assert delay_fault(response, False, held=True) is None
