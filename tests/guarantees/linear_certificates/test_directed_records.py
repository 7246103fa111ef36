"""Samples of records in certificates of one direction: norms by series, plants at the edge, any multipliers, solved values."""

import dataclasses
import functools
import importlib.util

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.errors import FileFormatError
from robustid.guarantees.linear import further_points
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.directed import DirectedBand, Measure, Sides, class_bound, directions
from robustid.guarantees.linear.directed_search import DirectedSearch
from robustid.guarantees.linear.directed_verification import holds_exactly
from support.cases import seeds, slow
from support.edge_bands import edge_plant
from support.forging import arrays_of, forge, kept, with_lower_sides
from support.halvings import arcs_halved
from support.refusals import refused

KINDS = "record", "free record", "record of two inputs"
DT = 0.01


@functools.cache
def by_directions(kind, seed):
    """A plant at the edge of its class with a record, and its band by sums of one direction each."""
    plant = edge_plant(kind, seed)
    with arcs_halved(0):
        return plant, rid.band(plant.problem, box=plant.box, knots=12).by_directions(Budget())


@functools.cache
def step_and_points():
    """Frequency points from 1 Hz on and a step, and the band by sums of one direction each."""
    data = rid.datasets.flexible_structure(lines=12, samples=60)
    modes = rid.kautz(*data.modes.T, dt=DT, delay=1)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    return rid.identify(rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=modes))


def sides_of(found):
    return [one for one in found.directed if isinstance(one, DirectedBand)]


def directed(kind):
    """The first seed with samples of a record whose certificates of directions pay, and its plant."""
    every = (by_directions(kind, k) for k in range(20))
    return next((plant, found) for plant, found in every if any(one.samples.rows for one in sides_of(found)))


@pytest.mark.parametrize("kind", [KINDS[0], *map(slow, KINDS[1:])])
def test_the_norm_of_what_is_missed_is_that_of_real_series(kind):
    """Coefficients of psi from values of h all around a circle; points, rows and the target as functionals of them."""
    _, found = directed(kind)
    one, rng = sides_of(found)[0], np.random.default_rng(0)
    samples, sides = one.samples, one.sides
    assert samples.rows
    some = np.flatnonzero(np.abs(samples.nodes[: sides.half]) < 0.985)[:4]
    points = np.concatenate([[-samples.rows, -1], np.arange(-samples.rows + 1, -1)[::7], some])
    inside = np.abs(samples.problem.region.points(one.angles)) < 0.985
    for k in np.flatnonzero(inside)[[inside.sum() // 2]].tolist():
        target = targets_at(samples, one.angles[k : k + 1])
        c = rng.standard_normal((1, 16, points.size)) + 1j * rng.standard_normal((1, 16, points.size))
        base, terms = complex(target.base[0]), 1500
        circle = 0.99 * np.exp(2j * np.pi * np.arange(2**14) / 2**14)
        h = (np.fft.fft(Measure(base).outer(circle)) / 2**14 / 0.99 ** np.arange(2**14))[:terms].real
        rows = points < 0
        square = np.zeros(16)
        for component, U in enumerate(samples.blocks):
            phi = np.zeros((rows.sum(), terms))
            phi[:, : U.shape[1]] = U[points[rows]]
            seen = np.array([[row[m:] @ h[: terms - m] for m in range(U.shape[1])] for row in phi])
            g = np.zeros((16, terms))
            g[:, : U.shape[1]] = c[0][:, rows].real @ seen
            z, w = samples.nodes[points[~rows]], samples.weights[points[~rows], component]
            g += (c[0][:, ~rows] @ ((Measure(base).outer(z) * w)[:, None] * z[:, None] ** np.arange(terms))).real
            if component == samples.target:
                own = target.weight[0] * complex(Measure(base).outer(np.array(base))) * base ** np.arange(terms)
                g -= (one.turns[:, None] * own).real
            square += (g**2).sum(axis=1)
        shown = class_bound(sides, target, points, c, one.turns)[0]
        np.testing.assert_allclose(shown, np.sqrt(square), rtol=1e-5)
        assert np.all(np.sqrt(square) <= shown * (1 + 1e-9))


@pytest.mark.parametrize("kind", [*KINDS[:2], slow(KINDS[2])])
@pytest.mark.parametrize("seed", seeds(1, 40))
def test_a_plant_at_the_edge_is_within_every_side(kind, seed):
    plant, found = by_directions(kind, seed)
    omega = plant.frequencies(np.random.default_rng([seed, 1]), 150)
    omega = omega[(omega >= found.range[0]) & (omega <= found.range[1])]
    values = plant.truth(omega)
    for one in sides_of(found):
        own = values[:, *one.samples.entry]
        assert np.all((own[:, None] * one.turns).real <= one.supports(plant.problem.plane.angles(omega)))


@pytest.mark.parametrize("seed", seeds(1, 3))
def test_whatever_the_multipliers_are_the_sides_hold(seed):
    kind = KINDS[seed % 3]
    plant, found = directed(kind)
    one, rng = sides_of(found)[0], np.random.default_rng(seed)
    noise = rng.standard_normal(one.multipliers.shape) + 1j * rng.standard_normal(one.multipliers.shape)
    changed = (one.multipliers * (1 + 10 ** rng.uniform(-3, 0.5) * noise)).astype(np.complex64)
    omega = plant.frequencies(rng, 100)
    omega = omega[(omega >= found.range[0]) & (omega <= found.range[1])]
    own = plant.truth(omega)[:, *one.samples.entry]
    forged = dataclasses.replace(one, multipliers=changed)
    assert np.all((own[:, None] * one.turns).real <= forged.supports(plant.problem.plane.angles(omega)))


def test_a_step_narrows_the_band_where_frequency_points_end():
    """Below the first of them to what semidefinite programs prove, within a sixth; it was as wide as without the step."""
    result = step_and_points()
    problem = result.problem
    omega = np.array([1.0])
    with arcs_halved(0):
        band = rid.band(problem, omega=omega, knots=12).with_model(result.model).by_directions(Budget())
    (one,) = sides_of(band)
    assert np.any((one.points < 0) & (np.abs(one.multipliers).max(axis=1) > 0))
    least = rid.worst_case_error(result, omega=omega, directions=16)
    found = band.error_at(omega)[:, 0, 0]
    assert np.all(found >= least.lower[:, 0, 0])
    assert np.all(found <= 7 / 6 * least.upper[:, 0, 0])
    # Without the step no bound is as small as that: a system that agrees with the frequency points is farther away.
    alone = rid.identify(dataclasses.replace(problem, time=None))
    farther = rid.worst_case_error(alone, model=result.model, omega=omega, directions=16).lower[:, 0, 0]
    assert np.all(farther > 3 * found)


def test_what_the_class_of_the_farthest_system_does_in_a_record_is_the_slope_of_its_norm():
    """Differences of the norm, with a little of each sample that is not among the points."""
    (one,) = rid.band(step_and_points().problem, knots=20).bands
    sides = Sides(one.samples, one.extraction, np.zeros((0, 1), complex))
    search, points = DirectedSearch(sides, directions(8)), np.array([-60, -31, 0, 1, 4])
    target = targets_at(one.samples, np.array([0.3]))
    c, _ = search.search(target, points)
    norm = class_bound(sides, target, points, c[None], search.turns)[0]
    found = further_points._extreme(sides, target, points, c, search.turns)[1].real / norm[:, None]
    for k in range(8):
        for row in (-59, -38, -15, -1):
            tried = np.append(c[k], 1e-6)[None, None]
            more = class_bound(sides, target, np.append(points, row), tried, search.turns[[k]])[0, 0]
            assert (more - norm[k]) / 1e-6 == pytest.approx(found[k, row], rel=1e-3, abs=1e-6)


@pytest.mark.skipif(importlib.util.find_spec("flint") is None, reason="needs robustid[exact]")
@pytest.mark.parametrize("kind", ["record", slow("record of two inputs")])
def test_sides_hold_in_ball_arithmetic_and_lower_ones_do_not(kind):
    _, found = directed(kind)
    one = sides_of(found)[0]
    few = dataclasses.replace(one, angles=one.angles[::30], points=one.points[::30], multipliers=one.multipliers[::30])
    assert np.any((few.points < 0) & (np.abs(few.multipliers).max(axis=1) > 0))
    assert holds_exactly(few)
    assert not holds_exactly(with_lower_sides(few))


def test_it_comes_back_from_its_files_and_samples_that_no_record_has_are_refused(tmp_path):
    _, band = directed("record")
    omega = np.linspace(*band.range, 50)
    again = kept(band, tmp_path / "band")
    np.testing.assert_array_equal(again.at(omega)[1], band.at(omega)[1])
    assert again.certified
    band.save(tmp_path / "other")
    name = next(k for k in arrays_of(tmp_path / "other") if k.startswith("directed/") and k.endswith("0/points"))
    forge(tmp_path / "other", lambda arrays: {name: arrays[name] - 1})
    refused("do not belong to the samples", rid.load, tmp_path / "other", error=FileFormatError)
