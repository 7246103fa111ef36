"""Jumps and spikes that come in both of two periods: the answer of a plant to an input that repeats, not a fault of a sensor."""

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.data import FaultKind
from support.cases import slow

PERIOD = 1000
KINDS = FaultKind.JUMP, FaultKind.SPIKE


def record(seed, *, noise=0.01, spike=0.0, jump=0.0, periods=2.2):
    """A lag behind a multisine, whose friction turns at two places of every period; beside that a spike, or a jump, at one time."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[1:60] = np.exp(2j * np.pi * rng.random(59))
    u = np.tile(np.fft.irfft(spectrum, PERIOD), 4)[: int((1 + periods) * PERIOD)]
    u = u / u.std()
    y = scipy.signal.lfilter([0, 0.1], [1, -0.9], u)
    size = y.std()
    phase = np.arange(y.size) % PERIOD
    y = y + 0.15 * size * ((phase > 300) & (phase < 640))
    u, y = u[PERIOD:], y[PERIOD:]
    y = y + noise * size * rng.standard_normal(y.size)
    y[700] += spike * size
    y[1450:] += jump * size
    return rid.TimeRecord(u, y, dt=0.01, initial="free")


def told(one):
    return [fault for fault in rid.prepare.record_faults(one) if fault.kind in KINDS]


@pytest.mark.parametrize("seed", [0, slow(1), slow(2), slow(3)])
@pytest.mark.parametrize("noise", [0.01, 0.0])
def test_what_comes_in_both_periods_is_no_fault(seed, noise):
    """The bench of two masses, cut to 2.2 periods, was told of seven jumps of its level: three came a period later again."""
    assert not told(record(seed, noise=noise))


@pytest.mark.parametrize("seed", [0, slow(1), slow(2), slow(3)])
def test_what_is_in_one_period_alone_is_told(seed):
    (found,) = told(record(seed, spike=0.3))
    assert found.kind is FaultKind.SPIKE
    assert "off at sample 700 " in str(found)
    (found,) = told(record(seed, jump=0.4))
    assert found.kind is FaultKind.JUMP
    assert "level at sample 1450 " in str(found)


@pytest.mark.realdata
def test_two_periods_of_a_bench_are_told_of_no_jump():
    bench = rid.datasets.load("two_mass")
    part = slice(1603, 7127)
    assert not told(rid.TimeRecord(bench.u[part], bench.y[part, 0], dt=bench.dt, initial="free"))
