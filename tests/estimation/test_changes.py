"""Plants that change from one half of the measurements to the next: the bound holds either, and clean data keep theirs."""

import numpy as np
import pytest

from robustid.data import Caveat, TimeRecord, variances
from robustid.estimation.changes import CHANGED, added_variance
from robustid.estimation.frf import response_alone
from robustid.report.response_charts import ResponseView
from robustid.report.response_page import response_verdict
from support.cases import slow
from support.fault_judge import CATALOGUE
from support.fault_plants import SIMULATED, recipes, records, simulated

LEFT = 0.05  # of the responses, as is promised; nearly all were left before halves were compared
WIDENED = 0.02  # of clean responses


def distance(frf, plant):
    """Of the plant from the values, in bounds, the largest."""
    truth = plant(np.exp(1j * frf.omega * frf.dt), squeeze=False).transpose(2, 0, 1)
    return float(np.max(np.abs(frf.values - truth) / frf.bound.radius))


def assert_said(frf):
    """The page says so where the bound stands, and the noise is without what was added."""
    lead = response_verdict(ResponseView(frf, None))
    assert lead.key == "weak"
    assert "Halves of the measurement differ" in lead.sentence
    assert added(frf).min() > -1e-9


def added(frf):
    """Variances that the bound holds beyond those of noise, in units of these."""
    found = variances(frf.covariance, frf.values.shape) / frf.noise**2 - 1
    if frf.distortion is None and frf.doubt is None:  # nothing else is in the bound
        np.testing.assert_allclose((frf.changed / frf.noise) ** 2, found, atol=1e-9)
    return found


CLEAN = [(("stage", "heater"), range(2)), slow(SIMULATED, range(1000, 1200))]


@pytest.mark.parametrize("seeds", [range(1), *(slow(each) for each in (range(2), range(100, 140)))])
def test_the_bound_holds_the_plant_that_half_of_the_periods_are_of(seeds):
    """A heater that is 1 % faster half-way: silent, its bounds were left by up to 1.36 times in all cases."""
    far = []
    for seed in seeds:
        clean = simulated("heater", seed)
        faulty = CATALOGUE["varying plant (periodic)"].of(clean, "limit", np.random.default_rng([seed, 7]))
        assert faulty is not None
        found = response_alone(faulty.records, period=faulty.period)
        assert_said(found)
        assert added(found).max() > 1
        far.append(distance(found, clean.plant))
    assert np.sum(np.array(far) > 1) <= LEFT * len(seeds), far


@pytest.mark.slow  # quick: beside the modes of both halves, below
@pytest.mark.parametrize(("plants", "seeds"), [(("stage",), range(500, 501)), (SIMULATED, range(100, 110))])
@pytest.mark.parametrize("fault", ["another plant (random)", "varying plant (random)"])
def test_the_bound_of_any_excitation_is_wider_where_half_of_the_time_is_of_another_plant(plants, seeds, fault):
    """1 % faster in one of two records, or half-way in each: a change with a double pole at a resonance, which a window smooths."""
    far = []
    for seed in seeds:
        for name in plants:
            clean = simulated(name, seed)
            faulty = CATALOGUE[fault].of(clean, "limit", np.random.default_rng([seed, 7]))
            assert faulty is not None
            found = response_alone(faulty.records)
            assert CHANGED in found.note
            assert_said(found)
            far.append(distance(found, clean.plant))
    assert np.mean(np.array(far) > 1) <= LEFT, far


@pytest.mark.parametrize("seed", [0, *(slow(seed) for seed in (1, 2))])
@pytest.mark.parametrize("size", [1.1, slow(1.01)])
def test_modes_are_those_of_both_halves(size, seed):
    """A class without them takes a band around their mean that leaves either plant: by 28, 20 and 8 times of these seeds."""
    clean, strength = simulated("stage", seed), {1.1: "clear", 1.01: "limit"}[size]
    faulty = CATALOGUE["varying plant (random)"].of(clean, strength, np.random.default_rng(seed))
    assert faulty is not None
    found = response_alone(faulty.records)
    assert CHANGED in found.note
    assert_said(found)
    assert distance(found, clean.plant) <= 1  # at a resonance, with a double pole that a window smooths
    ends = np.array(found.modes)
    first = 2 * np.pi * 17.67
    wanted = np.array([[first, 0.01], [size * first, 0.01]])
    assert np.all((ends[:, [0, 2]] <= wanted) & (wanted <= ends[:, [1, 3]]))
    assert np.max(ends[:, 1] / ends[:, 0]) < 1.001


@pytest.mark.parametrize(("plants", "seeds"), [(("heater",), range(1)), slow(SIMULATED, range(1000, 1040))])
def test_bounds_of_clean_measurements_of_any_excitation_stay_as_they_are(plants, seeds):
    found = [CHANGED in response_alone(simulated(name, seed).random).note for seed in seeds for name in plants]
    assert sum(found) <= WIDENED * len(found)


@pytest.mark.parametrize(("plants", "seeds"), CLEAN)
def test_bounds_of_clean_measurements_stay_as_they_are(plants, seeds):
    widened = []
    for seed in seeds:
        for name in plants:
            recipe, rng = recipes()[name], np.random.default_rng([seed, *map(ord, name)])
            found = response_alone(records(recipe, rng, kind="periodic"), period=recipe.period)
            widened += [(name, seed)] if CHANGED in found.note else []
    assert len(widened) <= WIDENED * len(seeds) * len(plants), widened


@pytest.mark.parametrize("draws", [134, slow(400)])
@pytest.mark.parametrize(("dof", "shared"), [(3.0, 1.0), slow(14.0, 1.0), (14.0, 0.2)])
def test_chance_adds_nothing(dof, shared, draws):
    """Lines farther apart than their windows are wide, too: each says no more than its own."""
    rng = np.random.default_rng(0)
    added = 0
    for _ in range(draws):
        difference = (rng.standard_normal((60, 1)) + 1j * rng.standard_normal((60, 1))) / np.sqrt(2)
        own = rng.chisquare(2 * dof, (60, 1)) / (4 * dof)
        added += bool(np.any(added_variance(difference, own, dof, shared=shared)))
    assert added <= 3 * draws / 400  # of 400, less than one in the mean


def test_what_is_added_is_the_scatter_of_two_plants():
    """Halves at 0 and at 3: about their mean they scatter by a quarter of 9, where their noise does not explain it."""
    difference, known = np.full((40, 1), 3.0 + 0j), np.full((40, 1), 0.1)
    np.testing.assert_allclose(added_variance(difference, known, 10.0), 9 / 4)
    assert not added_variance(difference, 1e4 * known, 10.0).any()


@pytest.mark.parametrize("seeds", [range(1), slow(range(40))])
def test_a_long_record_of_a_plant_that_does_not_change_is_not_said_to(seeds):
    """Of 24000 samples one line in three is estimated: a change was told of every such record, beyond chance by far.

    The model of the change had a denominator where the response has none; its columns took half of the noise.
    """
    said = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        u = rng.standard_normal(24000)
        y = np.convolve(u, [0, 0.5, 0.3, 0.1])[: u.size] + 0.1 * rng.standard_normal(u.size)
        found = response_alone(TimeRecord(u, y, dt=1e-3), method="local")
        said.append(Caveat.CHANGING in found.bound.caveats)
        truth = np.exp(-1j * np.outer(found.omega * 1e-3, range(4))) @ [0, 0.5, 0.3, 0.1]
        assert np.mean(np.abs(found.values[:, 0, 0] - truth) > found.bound.radius[:, 0, 0]) < 1e-3
    assert not any(said), said
