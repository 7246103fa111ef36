"""Contradictions: never where the truth is in the class, mostly where it is not, and never above the margin."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from support.cases import seeds, slow
from support.edge_bands import IN_TIME, KINDS, edge_plant
from support.problems import CASES, random_problem

SEEDS = seeds(1, 40)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_data_of_a_plant_at_the_edge_are_never_contradicted(kind, seed):
    """Gain exactly K, errors exactly at their bounds, poles in a corner of their box."""
    plant = edge_plant(kind, seed)
    assert rid.guarantee.contradiction(plant.problem, box=plant.box) is None


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", [0, *(slow(seed) for seed in range(2, 30))])
def test_its_factor_is_never_above_the_margin(case, seed):
    problem = random_problem(seed, case, 16, noise=(1.5, 3, 6)[seed % 3])
    found, margin = rid.guarantee.contradiction(problem), rid.identify(problem).margin
    if found is None:
        assert margin < 1.2
    else:
        assert 1 <= found.factor <= margin * (1 + 1e-6)
        assert found.excess <= found.factor * (1 + 1e-6)


def wrong_sign(problem, rng):
    """One line turned around."""
    points = problem.frequency[0]
    values, k = np.array(points.values), rng.integers(points.omega.size)
    values[k] *= -1
    return dataclasses.replace(problem, frequency=dataclasses.replace(points, values=values))


def small_gain(problem, rng):
    """A bound K of the class that is a third of the plant's."""
    return dataclasses.replace(
        problem, prior=dataclasses.replace(problem.prior, gain_bound=problem.prior.gain_bound / 3)
    )


@pytest.mark.parametrize(
    ("change", "seed", "kinds"),
    [
        (wrong_sign, 1, KINDS[:4:3]),
        (small_gain, 1, KINDS[1:5:3]),
        *(slow(change, seed, KINDS) for change in (wrong_sign, small_gain) for seed in range(12)),
    ],
)
def test_what_is_wrong_is_found_for_most_kinds_of_samples(change, seed, kinds):
    """Over the box of the poles too, as far as that is not wide. The wrong sample and the others stand apart."""
    missed = 0
    for kind in kinds:
        plant = edge_plant(kind, seed)
        problem = change(plant.problem, np.random.default_rng(seed))
        margin = rid.identify(problem).margin
        for box in (None, plant.box) if plant.box is not None else (None,):
            found = rid.guarantee.contradiction(problem, box=box)
            if found is None:
                missed += box is None and margin > 1.1
                continue
            assert abs(found.centre - found.measured) > found.radius + found.bound
            assert 1 <= found.factor <= margin * (1 + 1e-6)
            assert found.verify()
            assert found.multipliers[found.sample] == -1
    assert missed <= len(kinds) // 4


def test_the_sum_of_the_samples_is_larger_than_what_the_class_allows_by_a_slow_judge():
    """No formula of the library: norms on a grid of the circle as seen from the base, for a class without parametric part."""
    problem = small_gain(dataclasses.replace(edge_plant("discrete", 1).problem, parametric=None), None)
    found, points = rid.guarantee.contradiction(problem), problem.frequency[0]
    lines, d, gain, rho = points.omega.size, found.multipliers, problem.prior.gain_bound, problem.prior.decay_rate
    number = found.points % lines
    conjugate = found.points >= lines
    y = np.where(conjugate, points.values[number, 0, 0].conj(), points.values[number, 0, 0])
    angle = np.where(conjugate, -1, 1) * points.omega[number] * problem.dt
    # Values at the points are means over the circle against (1 - conj(zeta) w)^-1 conj; the functional of least mean square.
    w, base = np.exp(2j * np.pi * np.arange(2**14) / 2**14), found.base
    zeta = np.exp(-1j * angle) / rho
    harmonic = (1 - abs(base) ** 2) / np.abs(w - base) ** 2
    outer = np.sqrt(1 - abs(base) ** 2) / (1 - np.conj(base) * w)  # |outer|^2 is the measure
    values = np.sqrt(1 - abs(base) ** 2) / (1 - np.conj(base) * zeta)
    seen = sum(dk / v / (1 - z * w.conj()) for dk, v, z in zip(d, values, zeta, strict=True))  # of outer g
    norm = np.sqrt(np.mean(np.abs(seen) ** 2))
    assert np.allclose(np.abs(outer) ** 2, harmonic)
    assert abs(d @ y) > gain * norm + np.abs(d) @ points.bound.radius[number, 0, 0]
    assert found.excess == pytest.approx(abs(d @ y) / (gain * norm + np.abs(d) @ points.bound.radius[number, 0, 0]))


@pytest.mark.parametrize("kind", ["discrete", "continuous", "record", "symmetric"])
def test_its_proof_holds_in_ball_arithmetic(kind):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    found = rid.guarantee.contradiction(wrong_sign(edge_plant(kind, 0).problem, np.random.default_rng(1)))
    assert found.verify(exact=True)
    forged = dataclasses.replace(found, multipliers=0.5 * found.multipliers + 0.5)
    assert not forged.verify()
    assert not forged.verify(exact=True)


def test_a_sample_of_a_record_is_named():
    u = np.random.default_rng(0).standard_normal(20)
    y = np.convolve(u, 0.5 ** np.arange(1, 21))[:20]
    y[11] += 2.0
    record = rid.TimeRecord(u, y, dt=0.1, bound=0.01)
    found = rid.guarantee.contradiction(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    assert found.omega is None
    assert found.time == pytest.approx(1.1)
    assert found.measured == y[11]
    assert abs(found.centre - (y[11] - 2)) <= found.radius
    assert "at 1.1 s, where" in found.summary()


@pytest.mark.parametrize("kind", ["discrete", IN_TIME[0], "symmetric"])
def test_saved_and_loaded_it_is_the_same(tmp_path, kind):
    plant = edge_plant(kind, 1)
    found = rid.guarantee.contradiction(wrong_sign(plant.problem, np.random.default_rng(1)), box=plant.box)
    found.save(tmp_path / "found.zip")
    again = rid.load(tmp_path / "found.zip")
    assert again.verify()
    assert (again.excess, again.factor, again.summary()) == (found.excess, found.factor, found.summary())


def test_a_sample_before_the_input_moves_is_predicted_exactly():
    """The system says nothing there, and the weights of a radius of zero are finite all the same."""
    u = np.concatenate([np.zeros(3), np.random.default_rng(0).normal(size=17)])
    basis = rid.kautz([0.5], [0.1], dt=1.0)
    record = rid.TimeRecord(u, 0.1 * u, dt=1.0, bound=0.01)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.5)
    problem = rid.MixedProblem(time=record, prior=prior, parametric=basis)
    assert rid.guarantee.contradiction(problem) is None
    moved = rid.TimeRecord(u, 0.1 * u + 0.5 * np.eye(1, 20)[0], dt=1.0, bound=0.01)
    found = rid.guarantee.contradiction(dataclasses.replace(problem, time=moved))
    assert found.time == 0
    assert found.verify()


def test_bad_input():
    passive = rid.MixedProblem(
        frequency=rid.FrequencyResponse([1.0, 2.0], [1.0, 1.0], bound=0.1, dt=0.1),
        prior=rid.PositiveReal(decay_rate=1.5),
    )
    with pytest.raises(rid.InputError, match=r"`problem` is of a .* class, which has no gain bound"):
        rid.guarantee.contradiction(passive)
    with pytest.raises(InputTypeError, match="`problem` must be a MixedProblem"):
        rid.guarantee.contradiction(3.0)
