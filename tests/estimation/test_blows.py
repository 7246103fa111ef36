"""Blows of a hammer: from rest, and rung out, every record is one period; a transient that looks alike is none."""

import dataclasses

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.data import FaultKind
from robustid.errors import InputError
from robustid.estimation.blows import are_blows
from support.cases import slow

DT, SAMPLES = 1 / 2048, 4096
MODES = ((55.0, 0.01, 1.0), (140.0, 0.012, -0.5), (377.0, 0.02, 0.2))


def sampled(damping=1.0):
    """Poles, and residues of the response to an input that is held between samples."""
    hz, zeta, gain = np.array(MODES).T
    omega, zeta = 2 * np.pi * hz, damping * zeta
    s = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    poles = np.exp(s * DT)
    return poles, gain * omega**2 / (2j * s.imag) * (poles - 1) / s


def response(omega, **how):
    poles, residues = sampled(**how)
    z = np.exp(1j * omega[:, None] * DT)
    return np.sum(residues / (z - poles) + residues.conj() / (z - poles.conj()), axis=1)


def blows(seed, noise, *, count=4, waits=60, **how):
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        u, first, width = np.zeros(SAMPLES), waits + rng.integers(0, 40), rng.integers(6, 8)
        u[first : first + width] = (80 + 20 * rng.random()) * np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 2
        parts = [scipy.signal.lfilter([0, c], [1, -p], u.astype(complex)) for p, c in zip(*sampled(**how), strict=True)]
        y = 2 * np.sum(parts, axis=0).real
        noises = noise * np.abs([[u.max()], [np.abs(y).max()]]) * rng.standard_normal((2, SAMPLES))
        found.append(rid.TimeRecord(u + noises[0] / 2, y + noises[1], dt=DT))
    return found


def ratios(records, **how):
    frf = rid.estimate_frf(records)
    truth = response(frf.omega, **how)
    return frf, np.abs(frf.values[:, 0, 0] - truth) / frf.bound.radius[:, 0, 0], np.abs(truth)


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 8))])
def test_the_bound_of_blows_holds_and_says_something(seed):
    """A window of lines takes the ringing for a transient: up to 12 bounds away, and bounds of 8 times the response."""
    frf, off, size = ratios(blows(seed, 1e-3))
    assert off.max() < 1
    assert np.median(frf.bound.radius[:, 0, 0] / size) < 0.4
    assert "one period" in frf.note
    assert not frf.faults


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 6))])
def test_what_rings_on_when_the_record_ends_is_part_of_the_bound(seed):
    """Cut off alike in all records, it shows in no scatter: 0.9 % of the largest is left, and next to no noise."""
    records = blows(seed, 1e-6, damping=0.6)
    level = np.abs(records[0].y[-100:]).max() / np.abs(records[0].y).max()
    assert 0.005 < level < 0.1
    assert ratios(records, damping=0.6)[1].max() < 1
    unknown = [dataclasses.replace(one, initial="free") for one in records]  # no blow: nothing is known of the start
    alone = rid.estimate_frf(unknown, method="periodic")
    off = np.abs(alone.values[:, 0, 0] - response(alone.omega, damping=0.6)) / alone.bound.radius[:, 0, 0]
    assert off.max() > 5


def test_records_that_are_no_blows_from_rest_are_estimated_as_any():
    found = blows(3, 1e-3)
    assert are_blows(found, None)
    assert are_blows(found, SAMPLES)
    assert not are_blows(found[:1], None)  # one shows no scatter
    assert not are_blows(found, SAMPLES // 2)
    assert not are_blows([dataclasses.replace(one, initial="free") for one in found], None)
    twice = [dataclasses.replace(one, u=one.u + np.roll(one.u, 1500, axis=0)) for one in found]
    assert not are_blows(twice, None)
    rings = [dataclasses.replace(one, y=one.y + 0.2 * np.abs(one.y).max()) for one in found]  # an offset is none
    assert are_blows(rings, None)
    assert not are_blows(blows(3, 1e-3, damping=0.05), None)
    turned = [dataclasses.replace(one, y=np.roll(one.y, -200, axis=0)) for one in found]  # it rings before the blow
    assert not are_blows([dataclasses.replace(one, u=np.roll(one.u, 300, axis=0)) for one in turned], None)
    rng = np.random.default_rng(0)
    assert not are_blows([dataclasses.replace(one, u=rng.standard_normal(one.u.shape)) for one in found], None)


@pytest.mark.parametrize(("spread", "noise", "period"), [(0.0, 1e-3, 1000), (0.12, 1e-3, None), (0.12, 0.0, None)])
def test_unequal_blows_in_one_record_have_no_period(spread, noise, period):
    """Frames of a hammer, one after the other: what differs between them is the hand, and no noise of the force."""
    rng, u = np.random.default_rng(0), np.zeros((4, 1000))
    u[:, 60:66] = (1 + spread * rng.standard_normal((4, 1))) * np.hanning(8)[1:7]
    u = u.ravel() + noise * rng.standard_normal(4000)
    plant = rid.TimeRecord(u, np.convolve(u, 0.95 ** np.arange(200))[:4000] + 1e-3 * rng.standard_normal(4000), dt=DT)
    unstated, stated = rid.prepare.record_faults([plant]), rid.prepare.record_faults([plant], period=1000)
    assert [int(one.size) for one in unstated if one.kind is FaultKind.UNSTATED_PERIOD] == [period] * bool(period)
    assert [one.kind for one in stated] == [FaultKind.WRONG_PERIOD] * (period is None)


def test_units_of_blows_do_not_matter():
    records = blows(4, 1e-3)
    scaled = [dataclasses.replace(one, u=one.u * 2.0**40, y=one.y * 2.0**-30) for one in records]
    plain, other = rid.estimate_frf(records), rid.estimate_frf(scaled)
    assert np.array_equal(other.values, plain.values * 2.0**-70)
    assert np.allclose(other.bound.radius, plain.bound.radius * 2.0**-70, rtol=1e-12)


def test_records_of_unequal_length_are_told_where_to_cut():
    """Three records of a laboratory are seldom of one length."""
    rng = np.random.default_rng(0)
    u = [rng.standard_normal(n) for n in (900, 650, 1120)]
    records = [rid.TimeRecord(one, np.convolve(one, [0, 1, 0.5])[: one.size], dt=DT) for one in u]
    with pytest.raises(InputError, match="cut them to 650 samples") as refused:
        rid.estimate_frf(records)
    assert dict(refused.value.remedy) == {"samples": 650}
    cut = [dataclasses.replace(one, u=one.u[:650], y=one.y[:650]) for one in records]
    assert rid.estimate_frf(cut).omega.size
    with pytest.raises(InputError, match=r"\(number 1\)$"):
        rid.estimate_frf([records[0], dataclasses.replace(records[1], dt=2 * DT)])
