"""Answers of designs that can't be had: the closest controller, what stands in the way, and searches that end before their end."""

import itertools
import math
import time
import types

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers import designing, proved_search
from robustid.controllers.conditions import conditions_of
from robustid.controllers.designing import At, Task
from robustid.controllers.discs import Discs
from robustid.controllers.obstacles import Law, means_of, obstacle_of
from robustid.controllers.plants import Plants
from robustid.controllers.structure import as_structure
from robustid.core import StateMatrices, points_of, response_at
from robustid.design import PID, Attenuation, LeadLag, Limits, Notch
from support.design_cases import DT, band_of, lag_band
from support.interrupts import ctrl_c_at_call
from support.one_design import small_band

P = PID(integral=False)
TOP = math.pi / DT


@pytest.fixture(scope="module")
def band():
    return lag_band()


def least_factor(band, value, part):
    """Least factor on a peak of 2 and an attenuation from 1 to 20 rad/s, over a grid of gains, for parts of the radii."""
    omega = np.unique(np.concatenate([np.geomspace(0.5, TOP, 400), np.linspace(1.0, 20.0, 50)]))
    discs = Plants.of(band).discs(omega)
    centre = discs.centre[:, 0, 0]
    k = np.concatenate([np.geomspace(1e-3, 19.0, 4000), -np.geomspace(1e-3, 1.0, 400)])[:, None]
    least = np.abs(1 + centre * k) - part * discs.radius * np.abs(k)
    S = np.where(least > 0, 1 / np.maximum(least, 1e-9), np.inf)
    slow = (omega >= 1) & (omega <= 20)
    return np.maximum(S.max(axis=1) / 2, S[:, slow].max(axis=1) / value).min()


@pytest.mark.slow
def test_the_closest_controller_is_that_of_the_least_factor(band):
    asked = Limits(attenuation=[(1.0, 20.0, 0.15)])
    judged = least_factor(band, 0.15, 1.0)
    assert judged > 1.1
    found = rid.design_controller(band, P, limits=asked)
    assert found.status.name == "NONE"
    shares = {name: found.shares[name][0] for name in ("sensitivity peak", "attenuation")}
    assert max(shares.values()) == pytest.approx(judged, rel=0.03)
    assert found.limited_by[0] in shares
    assert "closest: " in found.summary()
    assert np.abs(control.feedback(found.proofs[0].band.model, found.controller).poles()).max() < 1


def test_limits_that_can_just_be_kept_are_proved_though_a_search_that_leaves_some_for_the_proof_finds_none():
    """Of a gain alone, over a grid of gains and frequencies: the best takes 3 parts in 1000 less than the limits, or 3 more."""
    band, goal = small_band(), Attenuation(0.0, 3.0)
    plants = Plants.of(band)
    grid = plants.grid()
    discs = plants.discs(np.unique(np.concatenate([grid, np.geomspace(grid[0], 0.9999 * grid[-1], 2000)])))
    k = np.geomspace(0.3, 0.5, 1000)[:, None]
    S = 1 / (np.abs(1 + discs.centre[:, 0, 0] * k) - discs.radius * discs.units[:, 0] * k)
    best = np.flatnonzero(S.max(axis=1) <= 1.6).max()
    peak, low = S[best].max(), S[best, discs.omega <= 3.0].max()  # of more gain the one is larger, of less the other
    for part, status in ((0.997, "PROVED"), (1.003, "NONE")):
        limits = Limits(sensitivity_peak=peak / part, attenuation=[(0.0, 3.0, low / part)])
        task = Task.of([plants], as_structure(P), limits, goal)
        assert At(task, task.middle).first() is None
        found = rid.design_controller(band, P, limits=limits, maximise=goal)
        assert found.status.name == status
        assert all(share <= 1 for share, _ in found.shares.values()) == (status == "PROVED")
        assert max(share for share, _ in found.shares.values()) == pytest.approx(part, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("parts", "answer"), [((1.0, 0.5), 0.5), ((0.5, 0.0), 0.0)])
def test_smaller_bounds_help_where_they_do(band, parts, answer):
    """The attenuation that is asked for lies between those that a grid of gains reaches with the two parts of the radii."""
    values = np.geomspace(0.1, 0.9, 60)
    reached = [next(v for v in values if least_factor(band, v, part) <= 1) for part in parts]
    assert reached[0] > 1.01 * reached[1]
    limits = Limits(attenuation=[(1.0, 20.0, math.sqrt(reached[0] * reached[1]) * 0.995)])
    found = rid.design_controller(band, P, limits=limits)
    assert (found.status.name, found.bounds) == ("NONE", answer)
    assert "bounds     half as large" in found.summary()


@pytest.mark.slow
def test_a_controller_that_breaks_the_limits_is_not_written_as_one_that_was_designed(band, tmp_path):
    found = rid.design_controller(band, P, limits=Limits(attenuation=[(1.0, 60.0, 1e-3)]))
    assert found.status.name == "NONE"
    for ending in (".c", ".m"):
        with pytest.raises(rid.InputError, match="the closest one breaks them"):
            rid.save(tmp_path / f"controller{ending}", found)


@pytest.mark.slow
@pytest.mark.parametrize("given", [{"limits": Limits(attenuation=[(1.0, 20.0, 0.15)])}, {"time_limit": 1e-9}])
def test_designs_without_a_controller_that_keeps_the_limits_are_stored_and_have_a_page(band, given, tmp_path):
    found = rid.design_controller(band, P, **given)
    rid.save(tmp_path / "design.npz", found)
    again = rid.load(tmp_path / "design.npz")
    assert (again.status, again.bounds, again.finished) == (found.status, found.bounds, found.finished)
    assert again.summary() == found.summary()
    rid.write_report(again, tmp_path / "design.html")
    page = (tmp_path / "design.html").read_text(encoding="utf-8")
    assert ("closest: sensitivity peak exceeded" in page) == ("limits" in given)


def test_a_law_with_its_numbers_says_that_no_controller_keeps_limits(band):
    plants, structure = [Plants.of(band)], (PID(filter=200.0),)
    for value in (0.3, 0.05):  # of |S| over a third of the axis, at most 2 elsewhere
        found = obstacle_of(plants, structure, Limits(attenuation=[(0.0, TOP / 3, value)]))
        assert (found is not None) == (math.log(value) + 2 * math.log(2) < 0)
    steep = Limits(attenuation=[(0.0, 20.0, 0.001)], sensitivity_peak=1.2)
    found = obstacle_of(plants, structure, steep)
    assert found.law is Law.BODE
    assert found.have == pytest.approx(20 / TOP * math.log(0.001) + (1 - 20 / TOP) * math.log(1.2))
    assert "the limits allow at most -0.26" in found.sentence


def test_an_unstable_zero_and_pole_need_their_peak():
    """(z + p)/(z - p) in continuous time, |(1 - p q)/(q - p)| and |p| to the delay in samples, from both sides."""
    s = control.tf("s")
    slow = StateMatrices.of(control.ss((s - 5) / ((s - 2) * (s + 9))))
    sampled = StateMatrices.of(control.ss(control.zpk([1.6], [1.2, 0.3], 1.0, DT)))
    late = StateMatrices.of(control.ss(control.zpk([], [1.2, 0.0, 0.0], 1.0, DT)))
    cases = [
        (slow, 0.0, Law.ZERO, "sensitivity_peak", 7 / 3),
        (slow, 0.0, Law.POLE, "complementary_peak", 7 / 3),
        (sampled, DT, Law.ZERO, "sensitivity_peak", (1 - 1.2 * 1.6) / (1.2 - 1.6)),
        (late, DT, Law.POLE, "complementary_peak", 1.2**3),
    ]
    for model, dt, law, name, peak in cases:
        plants = types.SimpleNamespace(dt=dt, model=model)
        for factor in (0.999, 1.001):
            limits = Limits(**{"sensitivity_peak": None, name: peak * factor})
            over = [one.law for one in means_of(plants, (P,), limits) if one.need > one.have * (1 + 1e-9) + 1e-9]
            assert (law in over) == (factor < 1), (law, factor)


def loops(rng, count):
    """Random loops that are stable: plants with delays, unstable poles and zeros."""
    for _ in range(count * 40):
        poles = [*rng.uniform(-0.9, 0.95, rng.integers(1, 3)), *rng.uniform(1.05, 1.4, rng.integers(0, 2))]
        zeros = rng.choice([-1, 1]) * rng.uniform(0.2, 3.0, rng.integers(0, len(poles)))
        plant = control.ss(control.zpk(zeros, [*poles, *[0.0] * rng.integers(0, 4)], rng.uniform(0.05, 0.5), DT))
        gains = rng.standard_normal(2) * 10 ** rng.uniform(-1, 0.5)
        C = control.ss(control.tf([gains[0], gains[1]], [1, -rng.uniform(-0.5, 0.9)], DT))
        if np.abs(control.feedback(plant, C).poles()).max() < 0.999:
            yield plant, C


def test_no_law_contradicts_a_loop_that_runs():
    """Limits are the largest values of the loop itself on intervals, a little above: a controller that keeps them is there."""
    rng, count, delays = np.random.default_rng(4), 0, 0
    omega = np.linspace(1e-3, TOP, 3000)
    for plant, C in loops(rng, 40):
        L = np.prod([response_at(StateMatrices.of(one), points_of(omega, DT))[:, 0, 0] for one in (plant, C)], axis=0)
        S, T = np.abs(1 / (1 + L)) * 1.001, np.abs(L / (1 + L)) * 1.001
        edges = np.linspace(0.0, TOP, 40)
        rows = [(a, b, (omega >= a) & (omega <= b)) for a, b in itertools.pairwise(edges)]
        below = np.flatnonzero(np.abs(L) < 1)
        limits = Limits(
            sensitivity_peak=max(S.max(), 1.01),
            complementary_peak=max(T.max(), 1.01),
            attenuation=[(a, b, S[here].max()) for a, b, here in rows],
            roll_off=[(a, b, T[here].max()) for a, b, here in rows],
            bandwidth=float(omega[below[0] - 1]) if below.size and below[0] > 1 else None,
        )
        plants = types.SimpleNamespace(dt=DT, model=StateMatrices.of(plant))
        for one in means_of(plants, (P,), limits):
            assert one.need <= one.have + 5e-3, one
            delays += one.law is Law.DELAY_REAL
        count += 1
        if count == 40:
            break
    assert count == 40
    assert delays > 500


def test_a_plant_that_may_be_zero_and_too_little_action_are_proved_to_stand_in_the_way(band):
    plants = [Plants.of(band)]
    few = obstacle_of(plants, (P,), Limits(attenuation=[(1.0, 10.0, 0.2)], control_peak=0.3))
    discs = plants[0].discs(np.geomspace(1.0, 10.0, 50))
    assert few.law is Law.ACTION
    assert few.need == pytest.approx(np.max(0.8 / (np.abs(discs.centre[:, 0, 0]) - discs.radius)), rel=1e-2)
    away = band.with_model(control.ss([], [], [], 0.02, DT))
    assert obstacle_of([Plants.of(away)], (P,), Limits(bandwidth=20.0)) is None  # a poor model, and no plant that is 0
    frf = band.problem.frequency[0].with_bound(0.1)
    wide = rid.band(rid.MixedProblem(frequency=frf, prior=band.problem.prior), model=band.model)
    zero = obstacle_of([Plants.of(wide)], (P,), Limits(bandwidth=200.0))
    assert zero.law is Law.BOUNDS
    assert zero.have > 1


def test_the_time_is_over_before_and_after_something_is_found(band, monkeypatch):
    early = rid.design_controller(band, P, time_limit=1e-9)
    assert early.status.name == "UNFINISHED"
    assert not early.finished
    assert early.controller is None
    calls = []

    def over(self, best):
        calls.append(best.level)
        monkeypatch.setattr(proved_search, "_RESERVE", 1e9)  # no time is left beside that of a proof
        raise designing.TimeIsOver

    monkeypatch.setattr(Task, "searched", over)
    late = rid.design_controller(band, [P, LeadLag((20.0, 200.0))], time_limit=100.0)
    assert (late.status.name, late.finished) == ("PROVED", False)
    assert 0.9 * calls[0] <= late.level <= calls[0]
    assert "the best so far" in late.summary()


def test_ctrl_c_keeps_what_was_found_and_proves_it(band, monkeypatch):
    found = rid.design_controller(band, P, progress=ctrl_c_at_call(4))
    assert (found.status.name, found.finished) == ("PROVED", False)
    monkeypatch.setattr(proved_search.At, "first", lambda self: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        rid.design_controller(band, P)


def test_a_delay_margin_keeps_its_arcs_clear():
    """1 + L exp(-j w t) is not 0 for any plant of a disc and any delay up to the margin, where the conditions are kept."""
    rng, turn, kept = np.random.default_rng(3), np.exp(2j * np.pi * np.arange(200) / 200), 0
    for tau, peak in ((0.3, None), (1.0, 2.0), (2.0, 2.0)):
        centre, radius = np.array([0.6 - 0.9j, -1.1 + 0.2j, 0.4 + 0.9j]), np.array([0.1, 0.2, 0.02])
        discs = Discs.of(np.array([0.3, 1.0, 1.2]), centre[:, None, None], radius, np.ones((3, 1)))
        limits = Limits(sensitivity_peak=peak, delay_margin=tau)
        conditions = conditions_of(limits, discs)
        for C in rng.standard_normal(200) + 1j * rng.standard_normal(200):
            if all(one.excess(np.full((3, 1, 1), C)).min(initial=1) >= 0 for one in conditions):
                L = (centre[:, None] + radius[:, None] * turn)[:, :, None] * C
                late = np.exp(-1j * np.linspace(0, tau, 40) * discs.omega[:, None])[:, None, :]
                assert np.abs(1 + L * late).min() > 1e-3
                kept += 1
    assert kept > 25


@pytest.mark.slow
def test_a_delay_margin_is_kept(band):
    free = rid.design_controller(band, PID())
    least = 1.5 * free.proofs[0].margins.delay
    kept = rid.design_controller(band, PID(), limits=Limits(delay_margin=least))
    assert kept.status.name == "PROVED"
    assert kept.proofs[0].margins.delay >= least
    assert kept.level < free.level
    assert kept.shares["delay margin"][0] > 0.8


def bandwidth_by_grid(band, smaller=lambda omega: 1.0, peak=2.0):
    """Bandwidth that gains reach under a peak of S, over a grid of gains, with radii times a factor of frequency."""
    discs = Plants.of(band).discs(np.geomspace(0.5, TOP, 4000))
    centre = discs.centre[:, 0, 0]
    k, radius = np.linspace(0.5, 19.0, 2000)[:, None], discs.radius * smaller(discs.omega)
    kept = np.all(np.abs(1 + centre * k) - radius * k >= 1 / peak, axis=1)
    high = (np.abs(centre) - radius) * k >= 1
    count = np.where(high.all(axis=1), high.shape[1], np.argmin(high, axis=1))
    return discs.omega[count[kept & (count > 0)] - 1].max()


@pytest.mark.slow
def test_improvements_are_what_a_design_with_smaller_bounds_or_wider_limits_reaches(band):
    """Against a grid of gains: with all radii halved, with those of each range halved, and with a wider peak."""
    found = rid.design_controller(band, P)
    rows = found.improvements(0.5)
    assert [row.ratio for row in rows] == sorted((row.ratio for row in rows), reverse=True)
    assert {row.of for row in rows} == {"bounds", "sensitivity_peak"}
    for row in rows:
        peak = 2.0 if row.of == "bounds" else 2.2
        here = (lambda w, row=row: np.where((w >= row.low) & (w <= row.high), 0.5, 1.0)) if peak == 2 else np.ones_like
        least, most = (
            bandwidth_by_grid(band, here, part * peak) for part in (0.98, 1.0)
        )  # bounds jump from line to line
        assert 0.99 * least <= row.level <= 1.01 * most
        assert row.level / found.level == pytest.approx(row.ratio, rel=0.02)
        assert row.of.replace("_", " ") in row.sentence
        in_a_range = row.of == "bounds" and np.isfinite(row.high)
        assert np.isfinite(row.point) == ("most from the point" in row.sentence) == in_a_range
        assert not in_a_range or np.abs(band.problem.frequency[0].omega / row.point - 1).min() < 1e-9
    assert max(row.ratio for row in rows) > 1.02
    assert rid.design_controller(band, P, limits=Limits(attenuation=[(1.0, 20.0, 0.01)])).improvements() == ()
    with pytest.raises(rid.InputError, match="below 1; got 2"):
        found.improvements(2.0)


@pytest.mark.slow
def test_more_time_never_gives_less_and_is_not_overrun():
    band, levels = band_of(5)[1], []
    structure = [PID(filter=(20.0, 300.0)), Notch((20.0, 250.0))]
    rid.design_controller(band, PID(), time_limit=2.0)  # what a band computes once
    for limit in (1.0, 4.0, 12.0):
        began = time.monotonic()
        found = rid.design_controller(band, structure, time_limit=limit)
        assert time.monotonic() - began < limit + 0.5
        levels.append(found.level if found.status.name == "PROVED" else 0.0)
    assert levels == sorted(levels)
    assert levels[-1] > 0
