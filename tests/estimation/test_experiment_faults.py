"""Faults of records beside a response: what is found, with which number, and that clean data and other units change nothing."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from support.cases import slow
from support.fault_plants import SIMULATED, recipes, simulated, step
from support.fault_responses import changed

STAGE = simulated("stage")


def faults(record, response=STAGE.response):
    return rid.prepare.experiment_faults(response, record)


def longer(samples=60, seed=1):
    return step(recipes()["stage"], np.random.default_rng(seed), samples=samples)


@pytest.mark.parametrize(
    ("factor", "kind", "correction"), [(-1, "sign", "negate"), (1e3, "unit", "times 0.001"), (0.5, "unit", "times 2")]
)
def test_another_sign_or_unit_is_named_and_undone(factor, kind, correction):
    wrong = changed(STAGE.step, y=factor * STAGE.step.y, bound=abs(factor) * STAGE.step.bound.radius)
    (fault,) = faults(wrong)
    assert (fault.kind, fault.correction, fault.where) == (kind, correction, "output y")
    assert faults(rid.prepare.correct(wrong, fault.correction)) == ()


@pytest.mark.parametrize("shift", [1, pytest.param(4, marks=pytest.mark.slow), 12])
def test_samples_of_delay_too_much_or_too_little_are_counted(shift):
    record = longer(120)
    late = changed(record, y=np.concatenate([np.zeros((shift, 1)), record.y[:-shift]]))
    early = changed(record, u=record.u[:-shift], y=record.y[shift:], bound=record.bound.radius[shift:])
    for wrong, correction, size in ((late, "advance", shift), (early, "delay", -shift)):
        (fault,) = faults(wrong)
        assert (fault.kind, fault.correction, fault.size) == ("late", f"{correction} {shift}", size)
    assert faults(rid.prepare.correct(late, f"advance {shift}")) == ()


def test_a_sample_time_in_milliseconds_is_named_although_no_frequency_is_then_common():
    (fault,) = faults(changed(STAGE.step, dt=1e3 * STAGE.step.dt))
    assert (fault.kind, fault.correction) == ("sample time", "time times 0.001")


def test_a_sample_time_that_explains_all_is_found():
    faster = step(recipes()["stage"], np.random.default_rng(2), plant=recipes()["stage"].faster(1.3), samples=100)
    (fault,) = faults(faster)
    assert fault.kind == "sample time"
    assert fault.size == pytest.approx(1.3, rel=0.01)


def test_exchanged_columns_are_named():
    record = longer()
    (fault,) = faults(changed(record, u=record.y, y=record.u))
    assert (fault.kind, fault.correction) == ("exchanged", "exchange")


def test_a_record_that_begins_in_motion_is_not_at_rest_and_a_free_one_is_right():
    record = longer(100)
    cut = changed(record, u=record.u[30:], y=record.y[30:], bound=record.bound.radius[30:])
    (fault,) = faults(cut)
    assert (fault.kind, fault.correction) == ("not at rest", "")
    assert faults(changed(cut, initial="free")) == ()


def test_a_record_in_steady_state_that_is_called_at_rest_is_named():
    given = STAGE.periodic[0]
    one = changed(given, u=given.u[:1000], y=given.y[:1000], initial="rest", bound=3 * STAGE.noise)
    (fault,) = faults(one)
    assert fault.kind == "not at rest"
    assert faults(changed(one, initial="periodic")) == ()


def test_an_offset_is_named_with_its_size():
    (fault,) = faults(changed(STAGE.step, y=STAGE.step.y + 5))
    assert fault.kind == "offset"
    assert fault.size == pytest.approx(5, rel=0.02)


def test_single_samples_are_named_with_their_place():
    y = STAGE.step.y.copy()
    y[37] += 8
    (fault,) = faults(changed(STAGE.step, y=y))
    assert fault.kind == "spike"
    assert fault.size == pytest.approx(8, rel=0.05)
    assert "sample 37 " in str(fault)


def test_another_plant_is_what_no_correction_explains():
    other = step(recipes()["arm"], np.random.default_rng(3))
    (fault,) = faults(changed(other, dt=STAGE.step.dt))
    assert (fault.kind, fault.correction) == ("other plant", "")


def test_one_output_of_two_has_no_correction_for_both_and_all_outputs_have_one_fault():
    clean = simulated("matrix")
    y = clean.step.y.copy()
    y[:, 1] *= -1
    (fault,) = faults(changed(clean.step, y=y), clean.response)
    assert (fault.kind, fault.where, fault.correction) == ("sign", "output y2", "")
    (fault,) = faults(changed(clean.step, y=-clean.step.y), clean.response)
    assert (fault.kind, fault.where, fault.correction) == ("sign", "outputs y1, y2", "negate")


def test_records_without_a_bound_are_judged_by_their_own_noise():
    free = STAGE.random
    assert faults(free) == ()
    (fault,) = faults([changed(free[0], y=-free[0].y), free[1]])
    assert (fault.kind, fault.record, fault.correction) == ("sign", 1, "negate")


def test_modes_beyond_the_measured_frequencies_are_no_fault():
    low = STAGE.response.band(1, 50)  # a mode at 140 Hz, in the step
    heavy = dataclasses.replace(recipes()["stage"], faster=recipes()["stage"].faster)
    for seed in range(5):
        assert faults(step(heavy, np.random.default_rng(seed)), low) == ()


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_units_change_nothing(power):
    scale = 2.0**power
    frf = STAGE.response
    large = rid.FrequencyResponse(frf.omega, scale * frf.values, bound=scale * frf.bound.outer_radius, dt=frf.dt)
    one = rid.FrequencyResponse(frf.omega, frf.values, bound=frf.bound.outer_radius, dt=frf.dt)
    record = changed(STAGE.step, y=-STAGE.step.y)
    given = changed(record, y=scale * record.y, bound=scale * record.bound.radius)
    (expected,), (found,) = faults(record, one), faults(given, large)
    assert (found.kind, found.correction, found.words) == (expected.kind, expected.correction, expected.words)
    slow = rid.FrequencyResponse(frf.omega / scale, frf.values, bound=frf.bound.outer_radius, dt=frf.dt * scale)
    (found,) = faults(changed(record, dt=record.dt * scale), slow)
    assert (found.kind, found.correction) == (expected.kind, expected.correction)


def test_too_little_says_nothing():
    few = STAGE.response.select(np.arange(5))
    assert faults(STAGE.step, few) == ()
    short = changed(STAGE.step, u=STAGE.step.u[:4], y=STAGE.step.y[:4], bound=None)
    assert faults(short) == ()
    unused = changed(STAGE.step, bound=np.inf)
    assert faults(unused) == ()


def test_other_numbers_of_signals_are_refused():
    with pytest.raises(rid.errors.InputError, match="record"):
        faults(simulated("matrix").step)
    with pytest.raises(rid.errors.InputTypeError, match="record"):
        faults("step")


def clean_and_told(seeds, names=SIMULATED):
    told = []
    for name in names:
        for seed in seeds:
            clean = simulated(name, seed)
            bare = changed(clean.step, bound=None)
            bounded = [changed(one, bound=3 * clean.noise) for one in clean.random]
            for record in (clean.step, bare, clean.random, clean.periodic, bounded):
                told += [(name, seed, str(fault)) for fault in faults(record, clean.response)]
    return told


@pytest.mark.parametrize(
    ("names", "seeds"), [(("stage", "heater"), range(1)), slow(SIMULATED, range(1)), slow(SIMULATED, range(600, 650))]
)
def test_clean_records_are_told_nothing(names, seeds):
    assert clean_and_told(seeds, names) == []


def test_faults_of_a_record_beside_a_response_are_faults_of_the_problem():
    wrong = changed(STAGE.step, y=-STAGE.step.y)
    problem = rid.MixedProblem(
        frequency=STAGE.response, time=wrong, prior=rid.Prior(gain_bound=100.0, decay_rate=1.001)
    )
    assert [fault.kind for fault in problem.data_faults] == ["sign"]


def test_a_response_of_continuous_time_judges_a_sampled_record():
    omega = np.linspace(1, 20, 60)
    frf = rid.FrequencyResponse(omega, 100 / (100 - omega**2 + 2j * omega), bound=0.01)
    t = 0.1 * np.arange(100)
    y = 1 - np.exp(-t) * (np.cos(np.sqrt(99) * t) + np.sin(np.sqrt(99) * t) / np.sqrt(99))
    assert faults(rid.TimeRecord(np.ones(100), y, dt=0.1, bound=0.01), frf) == ()
    (fault,) = faults(rid.TimeRecord(np.ones(100), 1e-3 * y, dt=0.1, bound=1e-5), frf)
    assert fault.correction == "times 1000"
