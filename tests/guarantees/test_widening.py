"""Bounds that make room for a known distance: judged by errors and distances at their limits."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.widening import bounds_at, widened_points, widened_record

OMEGA = np.array([0.5, 1.5])


def drawn(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def bounds(rng, p, q):
    """A bound of every kind."""
    radius = rng.uniform(0.5, 2, (2, p, q))
    yield rid.Bound(radius)
    yield rid.Bound(radius, tilt=0.8 * np.exp(1j * radius) * rng.random(radius.shape))
    yield rid.Bound(radius, joint="column")
    root = drawn(rng, 2, p * q, p * q)
    yield rid.Bound(joint="matrix", ellipsoid=root @ root.conj().swapaxes(1, 2) + 0.1 * np.eye(p * q))


@pytest.mark.parametrize("shape", [(1, 1), (2, 3)])
def test_every_error_and_distance_fit_into_the_wider_bound_and_some_just_do(shape):
    rng = np.random.default_rng(0)
    for bound in bounds(rng, *shape):
        frf = rid.FrequencyResponse(OMEGA, np.zeros((2, *shape), complex), bound=bound, dt=1.0)
        extra = 0.3 * frf.bound.radius * rng.random((2, *shape))
        wider, largest = widened_points(frf, extra).bound, 0.0
        for number in range(500):
            d = extra * np.exp(2j * np.pi * rng.random(extra.shape))
            e = drawn(rng, 2, *shape) * frf.bound.radius if number % 2 else d
            e = e / frf.bound.ratio(e)
            ratio = wider.ratio(e + d)
            assert ratio.max() <= 1 + 1e-12
            largest = max(largest, ratio.max())
        # The ellipsoid grows as a whole, by what the worst signs of any matrix of these sizes would do.
        assert largest > (0.8 if wider.joint == "matrix" else 0.99)
        assert wider.joint == ("entry" if shape == (1, 1) else frf.bound.joint)


def test_directions_see_the_distances_that_they_combine():
    rng = np.random.default_rng(1)
    right, values = drawn(rng, 2, 3, 1), np.zeros((2, 2, 1), complex)
    data = rid.TangentialResponse(OMEGA, values, right=right, bound=0.5, dt=1.0)
    extra = 0.1 * rng.random((2, 2, 3))
    wider = widened_points(data, extra).bound.radius
    np.testing.assert_allclose(wider, 0.5 + np.einsum("fij,fjr->fir", extra, np.abs(right)))
    problem = rid.MixedProblem(
        frequency=(data, rid.FrequencyResponse([1.0], np.zeros((1, 2, 3)), bound=0.5, dt=1.0)),
        prior=rid.Prior(gain_bound=1.0, decay_rate=1.2),
    )
    reach = np.maximum(np.abs(right)[:, None, :, 0], 1)
    np.testing.assert_allclose(bounds_at(problem, OMEGA), np.broadcast_to(0.5 / reach, (2, 2, 3)))


def test_bounds_at_a_frequency_are_those_of_the_samples_beside_it():
    """Straight between two points that see the entry; where no response does, that of a record over the largest input."""
    bound = np.array([[[1.0, 4.0]], [[2.0, np.inf]], [[6.0, 8.0]]])
    frf = rid.FrequencyResponse([1.0, 2.0, 3.0], np.zeros((3, 1, 2)), bound=bound, dt=1.0)
    record = rid.TimeRecord([[0.5, 2.0], [1.0, 0.0]], [[0.0], [0.0]], dt=1.0, bound=[[0.2], [0.1]])
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    both = rid.MixedProblem(frequency=frf, time=record, prior=prior)
    np.testing.assert_allclose(bounds_at(both, np.array([0.5, 1.5, 3.0]))[:, 0], [[1, 4], [1.5, 5], [6, 8]])
    alone = rid.MixedProblem(time=record, prior=prior)
    np.testing.assert_allclose(bounds_at(alone, np.array([0.5]))[0, 0], [0.1, 0.05])


def test_samples_that_would_say_next_to_nothing_are_left_out():
    bound = np.array([[[1.0, 1.0]], [[1.0, np.inf]]])
    frf = rid.FrequencyResponse(OMEGA, np.zeros((2, 1, 2)), bound=bound, dt=1.0)
    extra = np.array([[[3.1, 1.0]], [[np.inf, 1.0]]])
    for joint in ("entry", "column"):
        wider = widened_points(frf.with_bound(rid.Bound(bound, joint=joint)), extra)
        assert wider.omega.tolist() == [0.5]
        np.testing.assert_allclose(wider.bound.radius, [[[np.inf, 2.0]]])
    assert widened_points(frf, np.full(extra.shape, np.inf)) is None
    joint = frf.select([0]).with_bound(rid.Bound(joint="matrix", ellipsoid=np.eye(2)[None]))
    assert widened_points(joint, extra[:1]) is None


def test_a_record_has_room_for_every_impulse_response_that_near():
    rng = np.random.default_rng(2)
    u, y = rng.standard_normal((6, 3)), np.zeros((6, 2))
    rest = rng.random((6, 2, 3))
    wider = widened_record(rid.TimeRecord(u, y, dt=1.0, bound=0.1), rest).bound.radius - 0.1
    largest = 0.0
    for _ in range(300):
        h = rest * np.sign(rng.standard_normal(rest.shape))
        out = np.array([sum(h[j] @ u[k - j] for j in range(k + 1)) for k in range(6)])
        assert np.all(np.abs(out) <= wider * (1 + 1e-12))
        largest = max(largest, float((np.abs(out) / wider).max()))
    assert largest > 0.99
