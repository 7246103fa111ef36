"""The smallest disc: closed forms, and a judge that tries every pair and every triple."""

import itertools

import numpy as np
import pytest

from robustid.guarantees.common_nominal import smallest_disc
from robustid.guarantees.linear.polygon_discs import tightened
from support.cases import seeds


def judged(points):
    """Radius of the smallest disc: of all discs on two points and through three, the smallest that holds every point."""
    found = np.inf
    for a, b in itertools.combinations(points, 2):
        found = min(found, held((a + b) / 2, points, abs(a - b) / 2))
    for a, b, c in itertools.combinations(points, 3):
        system = 2 * np.array([[(b - a).real, (b - a).imag], [(c - a).real, (c - a).imag]])
        if abs(np.linalg.det(system)) > 1e-12:
            x, y = np.linalg.solve(system, [abs(b) ** 2 - abs(a) ** 2, abs(c) ** 2 - abs(a) ** 2])
            found = min(found, held(x + 1j * y, points, abs(a - x - 1j * y)))
    return found


def held(centre, points, radius):
    return radius if np.abs(points - centre).max() <= radius * (1 + 1e-9) else np.inf


@pytest.mark.parametrize("seed", seeds(8, 30))
def test_it_is_the_smallest_of_all_pairs_and_triples(seed):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal(rng.integers(2, 14)) + 1j * rng.standard_normal(1) * rng.standard_normal(1)
    points = points + 1j * rng.uniform(0, 1) * rng.standard_normal(points.size) + 100 * rng.standard_normal()
    disc = smallest_disc(points)
    assert np.all(np.abs(points - disc.centre) <= disc.radius)
    assert disc.radius == pytest.approx(judged(points), rel=1e-9)


def test_polygons_of_several_members():
    """Corners on common circles, several times: as many points on the rim as there are."""
    corners = np.exp(2j * np.pi * np.arange(16) / 16)
    for factor in (1e-12, 1.0, 1e12):
        disc = smallest_disc(factor * np.concatenate([corners, corners, 0.5 + 0.4 * corners]))
        assert disc.radius == pytest.approx(factor, rel=1e-12)
        assert abs(disc.centre) < 1e-12 * factor


def test_two_discs_side_by_side():
    """Members of radius 1 and 2 whose centres are 5 apart: (1 + 5 + 2)/2, between the far ends."""
    around = np.exp(2j * np.pi * np.arange(360) / 360)
    disc = smallest_disc(np.concatenate([around, 5 + 2 * around]))
    assert disc.radius == pytest.approx(4.0)
    assert disc.centre == pytest.approx(3.0)


@pytest.mark.parametrize("points", [[2 - 1j], [2 - 1j, 2 - 1j], [0, 1, 2, 3.0], [1j, 1j, 4j]])
def test_points_on_a_line_or_one_alone(points):
    points = np.array(points, complex)
    disc = smallest_disc(points)
    assert disc.radius == pytest.approx(np.ptp(points.real) / 2 + np.ptp(points.imag) / 2)
    assert disc.centre == pytest.approx(
        (points.real.min() + points.real.max()) / 2 + 0.5j * (points.imag.min() + points.imag.max())
    )


def test_nothing_depends_on_units_or_place():
    rng = np.random.default_rng(3)
    points = rng.standard_normal(40) + 1j * rng.standard_normal(40)
    disc = smallest_disc(points)
    small = smallest_disc(2.0**-60 * points)
    assert small.radius == 2.0**-60 * disc.radius
    far = smallest_disc(points + 1e6)
    assert far.radius == pytest.approx(disc.radius, rel=1e-9)


@pytest.mark.parametrize("count", [3, 4, 5, 8, 16, 24])
def test_loose_sides_are_drawn_to_the_polygon_of_the_others(count):
    """By brute force: the largest Re(exp(-j theta) v) over the corners of all pairs of sides that lie within every side."""
    rng = np.random.default_rng(count)
    turns = np.exp(-2j * np.pi * np.arange(count) / count)
    for _ in range(20):
        points = rng.standard_normal(6) + 1j * rng.standard_normal(6)
        support = (turns[:, None] * points).real.max(axis=1) + rng.exponential(0.5, count) * rng.integers(0, 2, count)
        found, corners = tightened(support), []
        for k, j in itertools.combinations(range(count), 2):
            sides = np.array([[turns[i].real, -turns[i].imag] for i in (k, j)])
            if abs(np.linalg.det(sides)) > 1e-9:
                x, y = np.linalg.solve(sides, support[[k, j]])
                if np.all((turns * (x + 1j * y)).real <= support + 1e-9):
                    corners.append(x + 1j * y)
        least = (turns[:, None] * np.array(corners)).real.max(axis=1)
        np.testing.assert_allclose(found, least, rtol=1e-7, atol=1e-7)
        assert np.all(found <= support)
        assert np.all((turns[:, None] * points).real.max(axis=1) <= found)
    np.testing.assert_array_equal(tightened(np.full((2, count), np.inf)), np.full((2, count), np.inf))
