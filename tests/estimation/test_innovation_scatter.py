"""Records without periods: sample instants that are off, loops whose reference nobody recorded, modes that ring, delays."""

import functools

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from support.fault_catalogue import changed
from support.fault_judge import CATALOGUE
from support.fault_plants import answer, recipes, simulated
from support.measured import realdata
from support.pairwise import every_one

ARM = simulated("arm")


def told(records, *kinds, period=None):
    return [fault for fault in rid.prepare.record_faults(records, period=period) if fault.kind in kinds]


@functools.cache
def of(name, strength, plant="arm", seed=0):
    return CATALOGUE[name].of(simulated(plant), strength, np.random.default_rng(seed)).records


@pytest.mark.parametrize("plant", ["stage", "arm", "heater"])
def test_instants_that_are_off_are_named_with_their_size(plant):
    (fault,) = told(of("jitter (random)", "limit", plant), "jitter")
    assert fault.where == "output y"
    assert fault.size == pytest.approx(0.1, rel=0.4)


def test_noise_of_any_colour_is_not_taken_for_instants_that_are_off():
    rng = np.random.default_rng(1)
    for one in (ARM.random[0], simulated("heater").random[0]):
        for pole in (0.0, 0.9):
            noise = scipy.signal.lfilter(
                [1.0], [1.0, -pole], 0.05 * one.y.std() * rng.standard_normal(one.y.shape), axis=0
            )
            assert told(changed(one, y=one.y + noise), "jitter", "feedback") == []


@pytest.mark.parametrize(("plant", "strength"), every_one(["stage", "arm", "heater"], ["clear", "limit"]))
def test_a_loop_without_its_reference_is_named(plant, strength):
    (fault,) = told(of("feedback without reference (random)", strength, plant), "feedback")
    assert fault.where == "input u and output y"


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_units_change_nothing(power):
    for name in ("jitter (random)", "feedback without reference (random)"):
        (one, *_) = of(name, "clear")
        scaled = changed(one, u=2.0**-power * one.u, y=2.0**power * one.y)
        assert [(f.kind, f.size) for f in told(scaled, "jitter", "feedback")] == [
            (f.kind, pytest.approx(f.size)) for f in told(one, "jitter", "feedback")
        ]


def test_inputs_of_an_open_loop_know_nothing_of_the_noise():
    """Of any band, of few steps, of a plant without noise."""
    plant, rng = recipes()["arm"].plant, np.random.default_rng(0)
    white = rng.standard_normal((4000, 1))
    slow = scipy.signal.lfilter([1.0], [1.0, -0.95], white, axis=0)
    steps = np.repeat(rng.choice([-1.0, 1.0], 20), 200)[:, None]
    for u in (white, slow, steps):
        for noise in (0.0, 0.05):
            y = answer(plant, u)
            y = y + noise * y.std() * rng.standard_normal(y.shape)
            assert told(rid.TimeRecord(u, y, dt=plant.dt), "jitter", "feedback") == []


@pytest.mark.parametrize("hz", [3.21, pytest.param(20.4, marks=pytest.mark.slow)])
def test_a_mode_that_rings_is_no_tone(hz):
    """What is there before the first sample dies away, a tone goes on; both as large."""
    one = ARM.random[0]
    t = one.dt * np.arange(len(one.y))
    wave = 0.3 * one.y.std() * np.sin(2 * np.pi * hz * t)[:, None]
    (tone,) = told(changed(one, y=one.y + wave), "tone")
    assert tone.size == pytest.approx(0.3, rel=0.1)
    assert told(changed(one, y=one.y + wave * np.exp(-1.5 * t / t[-1])[:, None]), "tone") == []


@pytest.mark.slow
@pytest.mark.realdata
@realdata[1]
def test_of_the_beam_only_the_mains_is_a_tone():
    """Its first mode, at 1.43 Hz, rings for a minute after the sweep."""
    (fault,) = told(rid.datasets.load("beam_ring"), "tone")
    assert "50.0" in fault.words
    assert "1.43" not in fault.words


@pytest.mark.parametrize("kind", ["periodic", "random"])
def test_columns_of_a_plant_that_follows_its_input_closely_are_exchanged(kind):
    """The output of a stage is that of a short model; the inverse is followed by a long one too."""
    period = 1000 if kind == "periodic" else None
    found = told(of(f"exchanged columns ({kind})", "clear", "stage"), "exchanged", "late", period=period)
    assert [fault.correction for fault in found] == ["exchange"]


@pytest.mark.parametrize("plant", ["stage", "heater"])
def test_a_delay_of_a_slow_plant_is_named_with_its_samples(plant):
    clean = simulated(plant)
    (fault,) = told(of("late channel (periodic)", "clear", plant), "late", period=clean.period)
    assert fault.size == pytest.approx(40, abs=4)
