"""Outputs that grow without end: the pole outside the circle is found, and what only looks like it is told nothing."""

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.data import FaultKind
from robustid.estimation import all_faults
from support.cases import slow

SAMPLES = 1500
TIME = np.arange(SAMPLES)


def record(poles, u, noise=0.01, seed=0):
    y = scipy.signal.lfilter([0.0, 1.0], np.poly(poles).real, u)
    return rid.TimeRecord(u, y + noise * np.random.default_rng([seed, 1]).standard_normal(u.size), dt=1e-3)


def growing(record_):
    return [fault for fault in rid.prepare.record_faults(record_) if fault.kind is FaultKind.UNSTABLE]


@pytest.mark.parametrize("growth", [5.0, 20.0, 200.0])
@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_an_unstable_plant_that_nothing_holds_is_told_with_its_growth(growth, angle):
    pole = np.exp(growth / SAMPLES + 1j * angle)
    poles = [pole.real] if angle == 0 else [pole, pole.conj()]
    given = record(poles, np.random.default_rng(0).standard_normal(SAMPLES))
    (fault,) = rid.prepare.record_faults(given)  # nothing else is looked for
    assert fault.kind is FaultKind.UNSTABLE
    assert fault.where == "output y"
    assert fault.size == pytest.approx(growth, rel=0.02)
    response = rid.estimate_frf(given)
    assert FaultKind.PHASE_SIGN not in {one.kind for one in all_faults(response)}


def sounding(kind, seed):
    """A stable plant, or a free mass, whose answer is largest at the end."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    hz = float(np.exp(rng.uniform(*np.log([0.02, 0.3]))))
    mode = np.exp(2 * np.pi * hz * np.array([-0.01 + 1j, -0.01 - 1j]))
    sweep = np.sin(2 * np.pi * hz * TIME**2 / 2 / SAMPLES)  # ends at the resonance
    return {
        "sweep up to the resonance": lambda: record(mode, sweep, seed=seed),
        "input that grows": lambda: record(mode, np.exp(6 * TIME / SAMPLES) * np.sin(0.1 * TIME), seed=seed),
        "free mass": lambda: record([1.0, 1.0], rng.standard_normal(SAMPLES), seed=seed),
        "pushed mass": lambda: record([1.0, 1.0], (TIME > 100) * 1.0, seed=seed),
    }[kind]()


@pytest.mark.parametrize("seeds", [range(10), slow(range(200))])
@pytest.mark.parametrize("kind", ["sweep up to the resonance", "input that grows", "free mass", "pushed mass"])
def test_what_only_grows_is_told_nothing_of(kind, seeds):
    told = [seed for seed in seeds if growing(sounding(kind, seed))]
    assert len(told) <= 0.02 * len(seeds), told
