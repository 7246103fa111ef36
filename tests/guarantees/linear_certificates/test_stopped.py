"""Bands whose search was ended: by a time limit, at every point of it, and by Ctrl-C. What is left holds the truth all the same."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.core import progress as clocks
from robustid.guarantees.linear import search
from robustid.guarantees.linear.directed_search import DirectedSearch
from support.interrupts import ctrl_c, ctrl_c_when

TWO_PI = 2 * np.pi
DT, RHO, GAIN = 1e-3, 1.05, 0.05
HZ, DAMPING = [31.0, 122.0], [0.01, 0.008]
BASIS = rid.kautz(TWO_PI * np.array(HZ), DAMPING, dt=DT, delay=1)
BOX = (
    TWO_PI * np.array(HZ)[:, None] * (1 + np.array(DAMPING)[:, None] * [-0.1, 0.1]),
    np.array(DAMPING)[:, None] * [0.9, 1.1],
)
RESIDUES = np.array([[1.0, -0.4, 0.3], [0.5, 0.2, -0.1], [-0.7, 0.9, 0.4], [0.2, -0.3, 0.6]])[:, :, None]


def truth(omega):
    """A system of three outputs whose non-parametric part has its gain at the bound in no entry."""
    z = np.exp(1j * omega * DT)
    return np.tensordot(BASIS.response(omega * DT), RESIDUES, 1) + (0.7 * GAIN / RHO / z)[:, None, None] / np.sqrt(3)


def problem(lines=20):
    omega, rng = TWO_PI * np.linspace(5, 300, lines), np.random.default_rng(3)
    values = truth(omega)
    bound = 0.01 * np.abs(values) + 1e-3
    noise = bound * np.sqrt(rng.random(bound.shape)) * np.exp(1j * TWO_PI * rng.random(bound.shape))
    frf = rid.FrequencyResponse(omega, values + noise, bound=bound, dt=DT)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=GAIN, decay_rate=RHO), parametric=BASIS)


PROBLEM = problem()
OMEGA = np.linspace(1.0, np.pi / DT, 60)
LIMITS = 1, 5, 40  # looks at the clock


@pytest.fixture
def ticking(monkeypatch):
    """A clock that goes on by a second whenever it is read."""
    seconds = iter(range(10**6))
    monkeypatch.setattr(clocks.time, "monotonic", lambda: float(next(seconds)))


def holds(band):
    centre, radius = band.at(OMEGA)
    return np.all(np.abs(truth(OMEGA) - centre) <= radius)


@pytest.mark.parametrize("box", [None, BOX], ids=["poles as stated", "box"])
def test_what_a_limit_leaves_is_proved_and_says_so(ticking, box):
    whole, widths = rid.band(PROBLEM, box=box, knots=30), []
    assert not whole.unfinished
    for limit in LIMITS:
        found = rid.band(PROBLEM, box=box, knots=30, time_limit=limit)
        complete = [one.complete for one in found.bands]
        assert holds(found)
        assert found.verify()
        assert bool(found.unfinished) == (not all(complete))
        assert ("unfinished" in found.summary()) == (not all(complete))
        widths.append(found.at(OMEGA)[1])
        for one, other, done in zip(found.bands, whole.bands, complete, strict=True):
            if done:
                np.testing.assert_array_equal(one.radius, other.radius)
    states = [np.isfinite(width).all(axis=(0, 2)).sum() for width in widths]
    assert (states[0], states[-1]) == (0, 3)
    assert states == sorted(states)
    assert all(complete)


def test_without_modes_the_class_bounds_what_there_was_no_time_for(ticking):
    omega = np.linspace(1.0, 30.0, 20)
    frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-0.1j * omega)), bound=0.01, dt=0.1)
    smooth = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5))
    found = rid.band(smooth, time_limit=1.0)
    assert not found.bands[0].searched
    np.testing.assert_allclose(found.radius, 2.0, rtol=1e-9)
    assert found.verify()


def test_entries_are_counted():
    told = []
    rid.band(PROBLEM, knots=60, progress=lambda *one: told.append(one))
    words = "proving the error at every frequency"
    assert told == [(words, k, 3) for k in range(4)]


def test_ctrl_c_keeps_what_is_finished():
    whole = rid.band(PROBLEM, knots=60)
    found = rid.band(PROBLEM, knots=60, progress=ctrl_c_when(lambda text, done, count: done == 1))
    assert [one.complete for one in found.bands] == [True, False, False]
    assert holds(found)
    np.testing.assert_array_equal(found.bands[0].radius, whole.bands[0].radius)
    assert np.all(np.isfinite(found.at(OMEGA)[1]))
    with pytest.raises(KeyboardInterrupt):
        rid.band(PROBLEM, progress=ctrl_c)


def test_a_file_keeps_what_is_unfinished(ticking, tmp_path):
    found = rid.band(PROBLEM, time_limit=8.0)
    assert found.unfinished
    found.save(tmp_path / "band")
    again = rid.load(tmp_path / "band")
    assert again.unfinished == found.unfinished
    np.testing.assert_array_equal(again.radius, found.radius)


def test_a_search_for_contradictions_can_be_watched_and_stopped(ticking):
    frf, told = PROBLEM.frequency[0], []
    values = frf.values.copy()
    values[10, 0] += 0.5
    bad = dataclasses.replace(PROBLEM, frequency=dataclasses.replace(frf, values=values))
    found = rid.guarantee.contradiction(bad, progress=lambda *one: told.append(one))
    assert found.entry[0] == 0
    assert [one[1:] for one in told] == [(k, 3) for k in range(4)]
    assert rid.guarantee.contradiction(bad, time_limit=0.5) is None
    stop = ctrl_c_when(lambda text, done, count: done == 1)
    assert rid.guarantee.contradiction(bad, progress=stop).excess == found.excess


def test_a_search_for_contradictions_looks_at_its_time_at_every_step(ticking, monkeypatch):
    """Of one entry too: a record of many samples takes minutes in it."""
    steps, own = [], search._solved
    monkeypatch.setattr(search, "_solved", lambda *one: steps.append(1) or own(*one))
    smooth = rid.FrequencyResponse(PROBLEM.frequency[0].omega, np.ones(20), bound=0.01, dt=DT)
    one = dataclasses.replace(PROBLEM, frequency=smooth)
    counts = []
    for limit in (1.0, 40.0, None):
        steps.clear()
        rid.guarantee.contradiction(one, time_limit=limit)
        counts.append(len(steps))
    assert counts[0] == 0
    assert 5 < counts[1] < 40 < counts[2]


def test_a_search_between_polygons_looks_at_its_time_at_every_step(ticking, monkeypatch):
    """On every arc too: of a class of slow decay there are hundreds, a tenth of a second each."""
    steps, own = [], DirectedSearch.search
    monkeypatch.setattr(DirectedSearch, "search", lambda *one: steps.append(1) or own(*one))
    frf = PROBLEM.frequency[0]
    single = rid.FrequencyResponse(frf.omega, frf.values[:, 0, 0], bound=frf.bound.outer_radius[:, 0, 0], dt=DT)
    result = rid.identify(dataclasses.replace(PROBLEM, frequency=single))
    plain, error = rid.band(result, knots=20), rid.worst_case_error(result, omega=OMEGA[[3, 8]], directions=4)
    counts, limits = [], (1.0, 60.0)
    for limit in limits:
        steps.clear()
        found = plain.between(error, Budget(limit))
        centre, radius = found.at(OMEGA)
        assert np.all(np.abs(truth(OMEGA)[:, 0, 0] - centre[:, 0, 0]) <= radius[:, 0, 0])
        counts.append(len(steps))
    assert counts[0] == 0 < counts[1] < 60
