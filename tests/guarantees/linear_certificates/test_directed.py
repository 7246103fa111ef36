"""Certificates of one direction each: norms by quadrature, plants at the edge and solved values inside, for any multipliers."""

import contextlib
import dataclasses
import functools
import importlib.util

import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.errors import FileFormatError
from robustid.guarantees.common_nominal import smallest_disc
from robustid.guarantees.linear import directed
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.directed import DirectedBand, Sides, directions
from robustid.guarantees.linear.directed_search import DirectedSearch
from robustid.guarantees.linear.directed_verification import holds_exactly
from robustid.guarantees.linear.polygon_discs import corners_of_supports, hull, smallest_discs
from support.edge_bands import edge_plant
from support.forging import arrays_of, forge, kept, with_lower_sides
from support.halvings import arcs_halved
from support.refusals import refused

# Plants without records of which the data are consistent: with exact poles, and with those of a problem whose poles are in a box.
EXACT = {
    "discrete": [11, 12, 16, 21], "continuous": [10, 15, 19, 29, 30], "roll-off": [0, 2, 5, 14, 18], "symmetric": [2, 23],
    "matrix": [0, 2],
}  # fmt: skip
OVER_BOX = {"discrete": [2, 10], "continuous": [1, 5], "roll-off": [1, 3]}
QUICK = ("discrete", 11), ("continuous", 30)
ONE = QUICK[0]


def seeds(quick, all_of_them):
    return [pytest.param(k, marks=() if k < quick else pytest.mark.slow) for k in range(all_of_them)]


@functools.cache
def joined(kind, seed):
    """A plant at the edge of its class, and the band with polygons at three frequencies.

    Of the quick ones at two and at one, and with arcs halved once, not four times.
    """
    plant = edge_plant(kind, seed)
    result, rng = rid.identify(plant.problem), np.random.default_rng(seed)
    lines = plant.problem.frequency[0].omega
    knots = 40 if (kind, seed) in QUICK else 80
    band, omega = rid.band(result, box=plant.box, knots=knots), np.sort(rng.uniform(lines.min(), lines.max(), 3))
    omega = omega[: {QUICK[0]: 2, QUICK[1]: 1}.get((kind, seed))]
    with arcs_halved(1) if (kind, seed) in QUICK else contextlib.nullcontext():
        return plant, result, band.refine(result, omega=omega)


def sides_of(found):
    return [one for one in found.directed if isinstance(one, DirectedBand)]


def edges(quick, *of):
    """The plants, those of `quick` quick."""
    every = [(kind, seed) for one in of for kind, found in one.items() for seed in found]
    return [pytest.param(*one, marks=() if one in quick else pytest.mark.slow) for one in every]


def frequencies(plant, found, seed, count=80):
    omega = plant.frequencies(np.random.default_rng([seed, 1]), count)
    beside = (found.polygons.omega[:, None] * (1 + np.linspace(-0.01, 0.01, 5))).ravel()
    omega = np.concatenate([omega, beside])
    return omega[(omega >= found.range[0]) & (omega <= found.range[1])]


@pytest.mark.parametrize(("kind", "seed"), edges((ONE,), EXACT, OVER_BOX))
def test_a_plant_at_the_edge_is_within_every_side(kind, seed):
    plant, _, found = joined(kind, seed)
    omega = frequencies(plant, found, seed)
    values = plant.truth(omega)
    assert len(sides_of(found)) == len(found.directed) or kind == "matrix"
    for one in sides_of(found):
        support, own = one.supports(plant.problem.plane.angles(omega)), values[:, *one.samples.entry]
        assert np.all((own[:, None] * one.turns).real <= support)
        assert [part.size for part in one.at(np.zeros(0))] == [0, 0]
        centre, radius = one.at(plant.problem.plane.angles(omega))
        assert np.all(np.abs(own - centre) <= radius)


@pytest.mark.parametrize(("kind", "seed"), edges((ONE,), EXACT))
def test_no_side_cuts_off_the_value_of_a_consistent_system(kind, seed):
    """Solved there: what systems attain is below the bound of every direction."""
    plant, result, found = joined(kind, seed)
    omega = frequencies(plant, found, seed, 3)[:3]
    brute = rid.worst_case_error(result, omega=omega, directions=8)
    for one in sides_of(found):
        for value in (v for v in brute.values if v.entry == one.samples.entry):
            support = one.supports(plant.problem.plane.angles(np.array([value.omega])))[0]
            attained = value.points[np.isfinite(value.points)]
            assert np.all((attained[:, None] * one.turns).real - value.slack <= support)


@pytest.mark.parametrize("seed", seeds(3, 10))
def test_whatever_the_multipliers_are_the_sides_hold(seed):
    plant, _, found = joined(*ONE)
    one, rng = sides_of(found)[0], np.random.default_rng(seed)
    size = 10 ** rng.uniform(-3, 0.5)
    noise = rng.standard_normal(one.multipliers.shape) + 1j * rng.standard_normal(one.multipliers.shape)
    points = np.sort(
        np.argsort(rng.random((len(one.points), one.sides.half)), axis=1)[:, : one.points.shape[1]], axis=1
    )
    forged = dataclasses.replace(
        one,
        multipliers=(one.multipliers * (1 + size * noise)).astype(np.complex64),
        points=points if seed % 2 else one.points,
    )
    omega = frequencies(plant, found, seed)
    own = plant.truth(omega)[:, 0, 0]
    assert np.all((own[:, None] * one.turns).real <= forged.supports(plant.problem.plane.angles(omega)))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=() if k in (0, 2, 4) else pytest.mark.slow) for k in range(30)])
def test_the_norm_of_what_is_missed_is_that_of_real_series_with_the_mean_of_two_poisson_kernels(seed):
    """Taylor coefficients, the moments of the measure from its density at equally spaced angles, and one linear system."""
    rng = np.random.default_rng(seed)
    kind = ("discrete", "continuous")[seed % 2]
    _, _, found = joined(*QUICK[kind == "continuous"])
    one = sides_of(found)[0]
    samples = one.samples
    near = 0.985  # of the circle: farther out it takes more coefficients than a matrix should have rows
    knot = int(rng.choice(np.flatnonzero(np.abs(samples.problem.region.points(one.angles)) < near)))
    targets = targets_at(samples, one.angles[knot : knot + 1])
    base, points = complex(targets.base[0]), one.points[knot]
    c = one.multipliers[knot][None] * (1 + rng.integers(2, size=(1, 16, 1)) * rng.standard_normal((1, 16, points.size)))
    use = np.abs(samples.nodes[points]) < near
    points, c = points[use], c[:, :, use]
    shown = directed.class_bound(one.sides, targets, points, c, one.turns)[0]
    z = samples.nodes[points]
    terms = int(20 / (1 - near))
    x = np.exp(2j * np.pi * np.arange(16384) / 16384)
    density = sum((1 - abs(b) ** 2) / np.abs(1 - np.conj(b) * x) ** 2 for b in (base, base.conjugate())) / 2
    moments = np.fft.ifft(density).real
    index = np.arange(terms)
    gram = moments[np.abs(index[:, None] - index)]
    own = samples.weights[points, samples.target]
    powers = np.array([base, *z])[:, None] ** index
    weights = np.concatenate([(targets.weight[0] * one.turns)[:, None], -c[0] * own], axis=1)
    functionals = (weights @ powers).real
    norms = np.sqrt((functionals * np.linalg.solve(gram, functionals.T).T).sum(axis=1))
    assert np.all(norms <= shown * (1 + 1e-7))
    np.testing.assert_allclose(shown, norms, rtol=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_discs_of_many_polygons_are_the_smallest_and_hulls_hold_all_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((50, 16)) + 1j * rng.standard_normal((50, 16)) * 10.0 ** -rng.integers(0, 9)
    points = points * 10 ** rng.uniform(-6, 6) + rng.standard_normal() * rng.choice([0, 1e3])
    points[0], points[1] = points[0, 0], points[1].real
    points[2] = np.exp(2j * np.pi * np.arange(16) / 16)
    centre, radius = smallest_discs(points)
    least = np.array([smallest_disc(one).radius for one in points])
    assert np.all(np.abs(points - centre[:, None]) <= radius[:, None])
    np.testing.assert_allclose(radius, least, rtol=1e-7, atol=1e-11 * np.abs(points).max())
    turns = directed.directions(16)
    support = (points[:, :, None] * turns).real.max(axis=1)
    around = corners_of_supports(support)
    every = np.exp(1j * rng.uniform(0, 2 * np.pi, 40))
    slack = 1e-12 * np.abs(points).max()
    for one, own in zip(points, around, strict=True):
        assert np.all((one[:, None] * every).real.max(axis=0) <= (own[:, None] * every).real.max(axis=0) + slack)
        corners = hull(one)
        np.testing.assert_allclose((corners[:, None] * every).real.max(axis=0), (one[:, None] * every).real.max(axis=0))
    endless = np.array([[1.0, 2.0, np.inf]], complex)
    np.testing.assert_array_equal(smallest_discs(endless)[1], [np.inf])


@pytest.mark.skipif(importlib.util.find_spec("flint") is None, reason="needs robustid[exact]")
@pytest.mark.parametrize("kind", ["discrete", pytest.param("continuous", marks=pytest.mark.slow)])
def test_sides_hold_in_ball_arithmetic_and_lower_ones_do_not(kind):
    _, _, found = joined(*QUICK[kind == "continuous"])
    one = sides_of(found)[0]
    few = dataclasses.replace(one, angles=one.angles[::12], points=one.points[::12], multipliers=one.multipliers[::12])
    assert holds_exactly(few)
    assert not holds_exactly(with_lower_sides(few))


def test_without_time_the_discs_around_the_polygons_stand():
    _, _, found = joined(*ONE)
    plain = dataclasses.replace(found, polygons=None, directed=())
    quick, late = plain.between(found.polygons, None), plain.between(found.polygons, Budget(1e-9))
    assert not sides_of(quick)
    assert not sides_of(late)
    np.testing.assert_array_equal(quick.radius, late.radius)
    omega = np.random.default_rng(0).uniform(*found.range, 200)
    assert np.median(found.at(omega)[1] / quick.at(omega)[1]) < 0.98
    assert np.all(found.at(omega)[1] <= plain.at(omega)[1])


def test_sums_of_the_lines_alone_narrow_a_band_and_come_back_from_its_files(tmp_path):
    plant, _, found = joined(*ONE)
    plain, omega = dataclasses.replace(found, polygons=None, directed=()), frequencies(plant, found, ONE[1])
    values = plant.truth(omega)
    for limit in (0.1, None):  # wherever the time ends
        with arcs_halved(1):
            alone = plain.by_directions(Budget(limit))
        centre, radius = alone.at(omega)
        assert np.all(np.abs(values - centre) <= radius)
    assert np.median(radius / plain.at(omega)[1]) < 0.98
    assert "refined    Sums of one direction each narrow the band (to " in alone.summary()
    again = kept(alone, tmp_path / "band")
    np.testing.assert_array_equal(again.at(omega)[1], radius)
    assert again.certified
    assert again.summary() == alone.summary()
    for budget in (None, Budget(1e-9)):  # polygons: where multipliers with and without them are mixed, rounding is left
        with arcs_halved(1):
            between = alone.between(found.polygons, budget)
        assert np.all(between.at(omega)[1] <= radius * (1 + 1e-4))


def test_the_search_comes_near_to_what_a_conic_solver_finds():
    """All terms of the bound as cones, without smoothing: of four directions at two frequencies between the lines."""
    plant = edge_plant("discrete", 10)
    (one,) = rid.band(rid.identify(plant.problem), box=plant.box, knots=80).bands
    search = DirectedSearch(Sides(one.samples, one.extraction, np.zeros((0, 3), complex)), directions(4))
    for angle in one.angles[[20, 60]] + 0.3 * np.diff(one.angles)[[20, 60]]:
        target = targets_at(one.samples, np.array([angle]))
        points, _, bounds = search.at(target)
        (Q, cross, square), (J, wanted), (centre, E) = (
            search._norms(target, points), search._rows(target, points), search._ellipses,
        )  # fmt: skip
        half, low = len(J) // 2, np.linalg.cholesky(Q + 1e-12 * np.trace(Q) * np.eye(len(Q)))
        for k, bound in enumerate(bounds):
            a, b = cp.Variable(points.size), cp.Variable(points.size)
            x = cp.hstack([a, b])
            shift = np.linalg.solve(low, cross[k])
            rest = cp.norm(cp.hstack([low.T @ x - shift, np.sqrt(max(square[k] - shift @ shift, 0.0))]))
            sides = [cp.norm(np.linalg.cholesky(E[at]).T @ cp.hstack([a[i], -b[i]])) for i, at in enumerate(points)]
            missed = J @ x - wanted[k]
            left = [cp.norm(cp.hstack([missed[i], missed[half + i]])) for i in range(half)]
            linear = centre[points].real @ a - centre[points].imag @ b
            program = cp.Problem(cp.Minimize(linear + rest + cp.sum(cp.hstack([*sides, *left]))))
            least = program.solve(solver="CLARABEL") + _of_amplitudes(search, target, k)
            assert bound >= least - 1e-6 * abs(least)
            assert bound <= least + 0.005 * np.ptp(bounds)


def _of_amplitudes(search, target, direction):
    """The part of the bound that multipliers do not move: the functions at the middles of their amplitudes."""
    return float((search.turns[direction] * (target.values[0] @ search._centres)).real)


def test_no_arc_is_wider_with_polygons_than_without():
    _, result, found = joined(*ONE)
    plain = dataclasses.replace(found, polygons=None, directed=())
    assert set(plain._entries.knots()) <= set(found._entries.knots())
    assert found.with_model(result.model).hinf <= plain.with_model(result.model).hinf * (1 + 1e-12)


CHANGES = {
    "a point twice": lambda a: {"points": np.repeat(a["points"][:, :1], a["points"].shape[1], axis=1)},
    "a point that is none": lambda a: {"points": a["points"] + 10**6},
    "multipliers that are no numbers": lambda a: {"multipliers": a["multipliers"] * np.nan},
    "two directions": lambda a: {"multipliers": a["multipliers"][:, :2]},
}


@pytest.mark.parametrize("change", CHANGES)
def test_files_of_other_multipliers_are_refused(tmp_path, change):
    _, _, found = joined(*ONE)
    found.save(tmp_path / "band")
    names = {n: next(k for k in arrays_of(tmp_path / "band") if k.startswith("directed/") and k.endswith(f"0/{n}"))
             for n in ("points", "multipliers")}  # fmt: skip

    def changed(arrays):
        new = CHANGES[change]({n: arrays[k] for n, k in names.items()})
        return {names[n]: value for n, value in new.items()}

    forge(tmp_path / "band", changed)
    refused("do not belong to the samples", rid.load, tmp_path / "band", error=FileFormatError)
