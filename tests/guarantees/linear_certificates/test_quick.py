"""Bands of few knots, and samples against what the others prove: quicker, and proofs like all others."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.guarantees import check_samples
from support.cases import seeds, slow
from support.edge_bands import KINDS, MATRICES, edge_plant

ONE_ENTRY = ("discrete", "continuous", "roll-off")
FEW = "discrete", "symmetric", "record of two inputs"
MODE = 20.0  # rad/s


# Quick: the kinds of which `test_edge_bands` has bands of all knots among the slow ones, and one that it has too.
@pytest.mark.parametrize("kind", [kind if kind in FEW else slow(kind) for kind in KINDS])
@pytest.mark.parametrize("seed", seeds(1, 30))
def test_a_plant_at_the_edge_is_inside_a_band_of_few_knots(kind, seed):
    plant = edge_plant(kind, seed)
    band = rid.band(plant.problem, box=plant.box, omega=[1.0], knots=120)
    omega = plant.frequencies(np.random.default_rng(seed), 200)
    centre, radius = band.at(omega)
    assert np.all(np.abs(plant.truth(omega) - centre) <= radius)
    assert all(one.angles.size <= 120 for one in band.bands)
    assert band.certified


@pytest.mark.parametrize("kind", [slow(one) if one == "discrete" else one for one in ONE_ENTRY])
@pytest.mark.parametrize("seed", seeds(1, 10))
def test_between_the_lines_few_knots_lose_little(kind, seed):
    plant = edge_plant(kind, seed)
    whole, few = (rid.band(plant.problem, omega=[1.0], knots=knots) for knots in (None, 300))
    lines = plant.problem.frequency[0].omega
    omega = np.random.default_rng(seed).uniform(lines.min(), lines.max(), 200)
    ratio = few.at(omega)[1] / whole.at(omega)[1]
    assert np.median(ratio) <= 1.2
    assert ratio.max() <= 1.6


def moved(factor, seed=0):
    """Lines of a mode and a constant, with errors inside of their bounds, and a class whose mode is elsewhere."""
    rng, omega, dt = np.random.default_rng(seed), np.linspace(2.0, 40.0, 25), 0.05
    values = rid.kautz([MODE], [0.02], dt=dt).response(omega * dt) @ [1.0, 0.5] + 0.3
    bound = 0.02 * np.abs(values) + 0.01
    values = values + bound * rng.uniform(0, 1, 25) * np.exp(2j * np.pi * rng.random(25))
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=dt)
    basis = rid.kautz([factor * MODE], [0.02], dt=dt)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2), parametric=basis)


@pytest.mark.parametrize("factor", [0.9, 0.97, 0.99, 1.0, 1.02, 1.1])
def test_no_sample_is_farther_from_the_others_than_the_margin_says(factor):
    """The judge is the semidefinite margin, which shares no formula with the sums."""
    problem = moved(factor)
    check, margin = check_samples(problem), rid.identify(problem).margin
    assert check.contradicts == (margin > 1.5)  # nothing here is between them
    assert check.margin <= max(margin, 1) * (1 + 1e-6)
    assert check.margin > 0.4 * margin or margin < 1
    assert check.omega.size == 25
    assert np.allclose(check.values, problem.frequency[0].values[:, 0, 0])


def with_stated_poles(kind, seed):
    """A plant at the edge whose poles are those of the class."""
    every = (edge_plant(kind, number) for number in range(100 * seed, 100 * seed + 100))
    return next(plant for plant in every if plant.box is None)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in (*MATRICES, "record of two inputs")])
@pytest.mark.parametrize("seed", seeds(2, 40))
def test_samples_of_a_plant_at_the_edge_never_contradict_each_other(kind, seed):
    plant = with_stated_poles(kind, seed)
    check = check_samples(plant.problem)
    assert not check.contradicts
    assert np.all(np.abs(plant.truth(check.omega)[:, 0, 0] - check.centre) <= check.radius)


def test_a_band_has_two_knots_at_least():
    with pytest.raises(InputError, match="`knots` must be at least 2; got 1"):
        rid.band(moved(1.0), knots=1)


def test_samples_of_a_matrix_are_not_checked():
    plant = edge_plant("symmetric", 0)
    with pytest.raises(InputError, match="`problem` must have one input and one output; got 2 outputs and 2 inputs"):
        check_samples(plant.problem)
