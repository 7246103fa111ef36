"""The band as a result: knots and arcs, proofs, units, and what it refuses."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.bases import stack_bases
from robustid.errors import InputTypeError
from support.cases import seeds, slow
from support.edge_bands import KINDS, edge_plant
from support.refusals import refused

POLE = np.exp(-0.05 + 1j * np.sqrt(1 - 0.05**2))
SEEDS = seeds(1, 20)


def with_tight_box(kind, seed):
    """A plant at the edge whose band is finite: the amplitude of its mode is proved."""
    for number in range(100 * seed, 100 * seed + 100):
        plant = edge_plant(kind, number)
        if plant.box is not None and plant.box[1][0, 1] < 1.25 * plant.box[1][0, 0]:
            return plant
    raise AssertionError


def simple(scale=1.0, dt=0.1):
    """Lines and a record of POLE's mode and 1/(2 - x), and the box of the mode; frequencies are in units of 0.1/dt."""
    turns, u = np.linspace(0.1, 2.5, 10), np.random.default_rng(0).standard_normal(12)
    x, h = np.exp(-1j * turns), (2 * 0.3 * POLE ** np.arange(12.0)).real + 0.5 ** np.arange(1, 13)
    values = 0.3 / (1 - POLE * x) + 0.3 / (1 - POLE.conj() * x) + 1 / (2 - x)
    frf = rid.FrequencyResponse(turns / dt, scale * values, bound=0.1 * scale, dt=dt)
    record = rid.TimeRecord(u, scale * np.convolve(u, h)[:12], dt=dt, bound=0.1 * scale)
    omega, prior = 10.0 * (0.1 / dt), rid.Prior(gain_bound=2.0 * scale, decay_rate=1.5)
    problem = rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=rid.kautz(omega, 0.05, dt=dt))
    return problem, (omega * np.array([[0.997, 1.003]]), 0.05 * np.array([[0.9, 1.1]]))


def near_simple():
    """A model that has the mode, and two terms of the rest."""
    mode = control.tf([0.6, -0.6 * POLE.real, 0.0], [1.0, -2 * POLE.real, abs(POLE) ** 2], 0.1)
    return control.ss(mode + control.tf([0.5, 0.25], [1.0, 0.0], 0.1))


@pytest.mark.parametrize("kind", [slow("discrete"), "continuous", slow("record")])
@pytest.mark.parametrize("seed", SEEDS)
def test_between_knots_the_radius_is_nearly_that_of_a_search_there(kind, seed):
    plant = with_tight_box(kind, seed)
    omega = plant.frequencies(np.random.default_rng(seed), 60)
    between, there = (
        rid.band(plant.problem, box=plant.box, omega=[1.0]),
        rid.band(plant.problem, box=plant.box, omega=omega),
    )
    ratio = between.at(there.omega)[1] / there.radius
    assert np.median(ratio) <= 1.05
    assert ratio.max() <= 1.6


@pytest.mark.parametrize("kind", ["simple", *(slow(kind) for kind in KINDS)])
def test_the_bound_of_an_arc_is_above_the_bounds_at_its_frequencies(kind):
    """About a model that is near: the arcs add little."""
    if kind == "simple":
        (problem, box), model = simple(), near_simple()
    else:
        plant = with_tight_box(kind, 0)
        problem, box, model = plant.problem, plant.box, rid.identify(plant.problem).model
    band = rid.band(problem, box=box, omega=[1.0], model=model)
    omega = np.random.default_rng(0).uniform(*band.range, 500)
    arc = np.searchsorted(band.circle.edges, omega) - 1
    assert np.all(np.isfinite(band.circle.bound))
    assert np.all(band.error_at(omega) <= band.circle.entries[arc])
    assert np.median(band.circle.entries[arc] / band.error_at(omega)) < 1.2


@pytest.mark.parametrize("kind", ["discrete", "continuous", "roll-off", "record", "symmetric"])
@pytest.mark.parametrize("seed", [slow(seed) for seed in range(3)])
def test_its_discs_hold_in_ball_arithmetic(kind, seed):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    plant = edge_plant(kind, seed)
    band = rid.band(plant.problem, box=plant.box, omega=[1.0])
    assert band.certified
    assert band.verify(exact=True)


def test_small_discs_hold_in_ball_arithmetic_too():
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    problem, box = simple()
    band = rid.band(problem, box=box, omega=[1.0])
    few = dataclasses.replace(band, bands=tuple(every_tenth(one) for one in band.bands))
    assert few.verify()
    assert few.verify(exact=True)


def every_tenth(one):
    kept = slice(None, None, 10)
    return dataclasses.replace(one, angles=one.angles[kept], points=one.points[kept], multipliers=one.multipliers[kept])


@pytest.mark.parametrize(("size", "time"), [(30, 0), slow(-30, 0), slow(0, 20), slow(0, -20), (-17, 9)])
def test_units_that_are_powers_of_two_change_nothing_but_the_units(size, time):
    """Up to where the search for the middle of a box stops: that depends on the rounding of its frequencies."""
    (problem, box), (other, wide) = simple(), simple(2.0**size, 0.1 * 2.0**time)
    omega = np.random.default_rng(0).uniform(0, 31, 50)
    first, second = rid.band(problem, box=box, omega=[1.0]), rid.band(other, box=wide, omega=[2.0**-time])
    for one, again in zip(first.at(omega), second.at(omega * 2.0**-time), strict=True):
        np.testing.assert_allclose(again, one * 2.0**size, rtol=1e-6 if time else 1e-9)
    assert np.isfinite(first.radius).all()


LOW, HIGH = simple()[1]
TWO = np.ones((2, 1))


@pytest.mark.parametrize(
    ("omega", "damping", "sentence"),
    [
        (LOW[0], HIGH[0], "`box` must"),
        (LOW * TWO, HIGH, "`box` must"),
        (LOW[:, :1], HIGH, r"`box` must hold positive ends \(low, high\) of the frequencies"),
        (LOW[:, ::-1], HIGH, "`box` must hold positive ends .* of the frequencies"),
        (LOW, -HIGH, "`box` must hold positive ends .* of the damping ratios"),
        (LOW, HIGH + 0.97, "`box` must hold damping ratios below 1; got"),
        (LOW * TWO, HIGH * TWO, "`box` must have one row .* each of the 1 modes"),
        (LOW * 1.1, HIGH, "`box` must hold the poles .* mode 1 has the frequency 10, its row"),
        (LOW, HIGH * 2, "`box` must hold the poles .* mode 1 has the damping 0.05, its row"),
    ],
)
def test_a_sentence_for_each_box(omega, damping, sentence):
    refused(sentence, rid.band, simple()[0], box=(omega, damping))


def test_bad_input():
    problem, box = simple()
    bare = dataclasses.replace(problem, parametric=None)
    passive = dataclasses.replace(bare, time=None, prior=rid.PositiveReal(decay_rate=1.5))
    refused("`thing` is of a .* class, which has no gain bound", rid.band, passive)
    refused("`box` holds poles of `kautz` pairs, and `parametric` has none", rid.band, bare, box=box)
    refused("`omega` must lie between 0 and pi/dt = 31.4159 rad/s", rid.band, problem, omega=[40.0])
    refused("`omega` must lie between 0 and pi/dt", rid.band, problem, omega=[-1.0])
    refused("`omega` is empty", rid.band, problem, omega=[])
    refused("between 0 and 31.4159 rad/s, where the band stands; got 32", rid.band(problem).at, [32.0])
    refused("`model` is missing", lambda: rid.band(problem).circle)
    other, no_box = "must be an Identification or a MixedProblem; got float", r"KautzSuggestion or a pair of \(M, 2\)"
    refused("`thing` " + other, rid.band, 3.0, error=InputTypeError)
    refused("`box` must be a " + no_box + " arrays", rid.band, problem, box=3.0, error=InputTypeError)
    pairs = stack_bases([rid.kautz(10.0, 0.05, dt=0.1), rid.kautz(20.0, 0.05, dt=0.1, delay=1)])
    two, both = dataclasses.replace(problem, parametric=pairs), (LOW * [[1], [2]], HIGH * TWO)
    refused("`box` needs pairs of one delay", rid.band, two, box=both)


@pytest.mark.parametrize("kind", [slow("discrete"), "continuous", "symmetric"])
def test_no_disc_at_a_line_is_larger_than_the_bound_of_the_sample(kind):
    plants = [edge_plant(kind, seed) for seed in range(12)]
    for plant in [one for one in plants if one.box is None]:
        frf = plant.problem.frequency[0]
        found = rid.band(plant.problem, omega=frf.omega)
        rounding = 2e-6 * plant.problem.prior.gain_bound  # of the norm, whose square has an error of some 1e-13
        assert np.all(found.at(frf.omega)[1] <= frf.bound.radius * (1 + 1e-9) + rounding)


def test_a_box_without_width_leaves_what_exact_poles_leave():
    problem, _ = simple()
    exact = rid.band(problem, omega=[1.0])
    boxed = rid.band(problem, box=([[10.0, 10.0]], [[0.05, 0.05]]), omega=[1.0])
    (centre, radius), (other, again) = (one.at(np.random.default_rng(0).uniform(0, 31, 50)) for one in (exact, boxed))
    np.testing.assert_allclose(again, radius, rtol=0.1)
    assert np.all(np.abs(centre - other) <= radius + again)


def test_a_box_that_holds_every_line_leaves_nothing_proved():
    omega = np.linspace(9.0, 11.0, 12)
    pair = rid.kautz(10.0, 0.05, dt=0.1, delay=1)
    values = pair.response(0.1 * omega) @ np.array([1.0, 0.5])
    frf = rid.FrequencyResponse(omega, values, bound=0.01, dt=0.1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.2), parametric=pair)
    found = rid.band(problem, box=([[8.0, 12.0]], [[1e-5, 0.9]]))
    assert not found.bounded.any()
    assert "none" in found.summary()
    assert found.verify()
