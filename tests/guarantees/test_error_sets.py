"""Sets of errors at points and on arcs: unions of convex sets, discs that hold them, and loops that they close."""

import numpy as np
import pytest

from robustid.guarantees.linear.error_sets import KnownErrors
from robustid.guarantees.loop_values import LoopValues

TURNS = np.exp(-2j * np.pi * np.arange(16) / 16)


def points_of(rng, count):
    """Values of random convex sets by corners, from thin to round, (count, 7)."""
    points = rng.standard_normal((count, 7)) + 1j * rng.standard_normal((count, 7)) * 10 ** rng.uniform(
        -2, 0, (count, 1)
    )
    turned = points * np.exp(2j * np.pi * rng.random((count, 1)))
    return turned + rng.standard_normal((count, 1)) + 1j * rng.standard_normal((count, 1))


def known_of(points):
    """What is known of them: a bound of their size, a disc and supports."""
    size, middle = np.abs(points).max(axis=1)[:, None, None], points.mean(axis=1)[:, None, None]
    radius = np.abs(points - middle[:, 0]).max(axis=1)[:, None, None]
    return KnownErrors(size, middle, radius, (points[:, None] * TURNS[:, None]).real.max(axis=2))


def mixtures(rng, points, count=50):
    """Values of the hulls of rows of points, (N, count)."""
    weights = rng.dirichlet(np.full(points.shape[1], 0.3), count).T
    return points @ weights


@pytest.fixture
def arcs():
    rng = np.random.default_rng(7)
    points = points_of(rng, 300)
    bends = 0.1 * rng.random((299, 1, 1))
    ends = np.concatenate([points[:-1], points[1:]], axis=1)
    values = mixtures(rng, ends) + bends[:, 0] * np.exp(2j * np.pi * rng.random((299, 50)))
    return rng, known_of(points).on_arcs(bends), values


def test_all_between_two_sets_and_a_bend_away_is_in_the_sets_of_the_arc(arcs):
    _, sets, values = arcs
    assert np.all(np.abs(values) <= sets.bound[:, 0])
    assert np.all(np.abs(values - sets.centre[:, 0]) <= sets.radius[:, 0])
    along = np.roll(sets.corners, -1, axis=1) - sets.corners
    aside = ((values[:, :, None] - sets.corners[:, None]) * along[:, None].conj()).imag
    assert np.all(aside >= -1e-9 * np.abs(along[:, None]))


def test_no_disc_leaves_out_a_value_and_the_side_that_is_seen_is_almost_a_line(arcs):
    rng, sets, values = arcs
    point = 6 * np.exp(2j * np.pi * rng.random(299))
    least = np.zeros(299)
    for held in sets.discs(point):
        assert np.all(np.abs(values - held.centre[:, 0]) <= held.radius[:, 0] * (1 + 1e-12))
        least = np.fmax(least, np.abs(point - held.centre[:, 0, 0]) - held.radius[:, 0, 0])
    weights = np.linspace(0, 1, 200)
    border = sets.corners[..., None] * weights + np.roll(sets.corners, -1, axis=1)[..., None] * (1 - weights)
    true = np.abs(border - point[:, None, None]).min(axis=(1, 2))
    clear = true > 0.3 * sets.radius[:, 0, 0]
    assert clear.sum() > 100
    assert np.all(least[clear] >= 0.96 * true[clear])


def test_smaller_sets_of_two_hold_what_both_hold():
    rng = np.random.default_rng(8)
    points = points_of(rng, 200)
    known = known_of(points)
    wide = KnownErrors(1.5 * known.bound, known.centre + 0.3 * known.radius, 1.3 * known.radius, np.zeros((200, 0)))
    for one, other in ((known, wide), (wide._replace(supports=known.supports), known._replace(supports=wide.supports))):
        both = one.or_smaller(other)
        assert np.array_equal(both.bound, known.bound)
        assert np.array_equal(both.radius, known.radius)
        assert np.all((points[:, None] * TURNS[:, None]).real.max(axis=2) <= both.supports + 1e-12)
        assert np.all(both.supports <= known.supports)


def test_sets_close_no_loop_where_they_are_said_not_to(arcs):
    """The factor by which sets with 0 in them may grow: no value within it makes 1 + E M zero, and one beyond it does."""
    rng, sets, values = arcs
    M = 0.5 * rng.standard_normal(299) * np.exp(2j * np.pi * rng.random(299))
    left = sets.closed_by(M, np.zeros(299))
    parts = rng.random(50)
    within = values * parts * M[:, None]
    real = (np.abs(within.imag) < 1e-3 * np.abs(within.real)) & (left > 1e-3)[:, None]
    assert np.all(-within.real[real] <= 1.01 * np.broadcast_to(left[:, None], real.shape)[real])
    weights = np.linspace(0, 1, 400)
    border = sets.corners[..., None] * weights + np.roll(sets.corners, -1, axis=1)[..., None] * (1 - weights)
    closing = -(border * M[:, None, None]).reshape(299, -1)  # 1/t of 1 + t E M = 0 where it is real
    ahead = np.where(np.abs(closing.imag) < 0.02 * np.abs(closing.real), closing.real, 0.0).max(axis=1)
    seen = ahead > 0.2 * np.abs(closing).max(axis=1)
    assert seen.sum() > 50
    assert np.all(left[seen] <= 1.1 * ahead[seen])
    assert np.all(left[seen] >= 0.9 * ahead[seen])
    reach = 0.05 * rng.random(299)
    wider = sets.closed_by(M, reach)
    for _ in range(20):
        moved = M + reach * np.exp(2j * np.pi * rng.random(299))
        assert np.all(sets.closed_by(moved, np.zeros(299)) <= wider * (1 + 1e-9))


def test_balls_about_other_centres_hold_all_maps_within_the_reach_of_their_values(arcs):
    rng, sets, values = arcs
    size = 299, 3, 3
    V = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    V[:, 2, 1] *= 0.2
    reach = 0.02 * rng.random(size)
    found = list(LoopValues(V, reach, (1, 1)).over(sets))
    assert len(found) == 10
    x, e, y, d, r = 2, 1, 1, 2, 0
    for k in range(50):
        moved = V + reach * np.exp(2j * np.pi * rng.random(size))
        E = values[:, k]
        closed = moved[:, :, e, None] * (E / (1 - moved[:, x, e] * E))[:, None, None] * moved[:, None, x] + moved
        for balls in found:
            for name, (row, column) in {"sensitivity": (y, d), "process_sensitivity": (y, r)}.items():
                away = np.abs(closed[:, row, column] - balls[name].centre[:, 0, 0])
                assert np.all(away <= balls[name].radius * (1 + 1e-9))
    least = np.minimum.reduce([balls["sensitivity"].radius for balls in found])
    assert np.isfinite(least).sum() > np.isfinite(found[0]["sensitivity"].radius).sum() + 30
