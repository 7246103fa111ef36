"""Bounds of second derivatives along arcs: against dense sampling, and near to what repeated light poles do."""

import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.guarantees.curvature import ArcDerivatives, Curvature, input_normal


def sampled(A, B, C, low, high, count=401):
    """Largest second derivative along the angle at many points, from differences of the response: no state space of it."""
    step = 1e-4
    angles = np.linspace(low, high, count)[:, None] + step * np.arange(-1, 2)
    states = np.exp(1j * angles)[..., None, None] * np.eye(len(A)) - A
    values = C @ np.linalg.solve(states, np.broadcast_to(B, (*states.shape[:2], *B.shape)))
    return np.abs(values[:, 0] - 2 * values[:, 1] + values[:, 2]).max(axis=0) / step**2


def second_derivative(A, B, C, low, high):
    """On one arc."""
    return ArcDerivatives(A, B, C).on_arcs(np.array([low]), np.array([high]))[0]


@pytest.mark.parametrize("repeat", [1, 2, 3])
def test_repeated_light_poles_are_bounded_on_arcs_as_long_as_their_distance(repeat):
    basis = rid.kautz([0.5], [0.01], dt=1.0, delay=1, repeat=repeat)
    A, B, C = input_normal(basis.A, basis.B, basis.C)
    distance = 1 - np.abs(basis.poles).max()
    for middle in (0.2, 0.45, 0.5, 0.6):
        arc = middle, middle + 0.3 * max(distance, abs(middle - 0.5) - 0.5 * distance) / repeat
        bound, least = second_derivative(A, B, C, *arc), sampled(basis.A, basis.B, basis.C, *arc)
        assert np.all(least <= bound * (1 + 1e-4))
        assert np.all(np.isfinite(bound))
        assert bound.max() < 12 * least.max()


def test_its_coordinates_change_no_value():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((5, 5))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((5, 2)), rng.standard_normal((3, 5))
    a, b, c = input_normal(A, B, C)
    np.testing.assert_allclose(a @ a.T + b @ b.T, np.eye(5), atol=1e-12)
    for z in np.exp(1j * np.array([0.0, 0.3, 2.0])):
        one, other = (H @ np.linalg.solve(z * np.eye(5) - F, G) for F, G, H in ((A, B, C), (a, b, c)))
        np.testing.assert_allclose(other, one, atol=1e-10)


@pytest.mark.parametrize(
    ("A", "B"),
    [
        (np.diag([1.0, 0.5]), np.ones((2, 1))),  # a pole on the circle
        (np.diag([0.5, 0.5 + 1e-9]), np.ones((2, 1))),  # almost dependent states
        (np.diag([0.5, 0.7]), np.array([[1.0], [0.0]])),  # a state that no input reaches
    ],
)
def test_where_there_are_no_orthonormal_states_nothing_is_lost(A, B):
    C = np.array([[1e6, 1e-6]])
    a, b, c = input_normal(A, B, C)
    z = np.exp(0.4j)
    one, other = (H @ np.linalg.solve(z * np.eye(2) - F, G) for F, G, H in ((A, B, C), (a, b, c)))
    np.testing.assert_allclose(other, one, rtol=1e-12)


@pytest.mark.parametrize("poles", [(0.9,), (0.99 * np.exp(0.5j), 0.3)])
def test_second_derivatives_on_arcs(poles):
    """Never below a fine difference quotient on the arc, and near it on short arcs."""
    blocks = [[[p.real, p.imag], [-p.imag, p.real]] if np.imag(p) else [[p]] for p in poles]
    A = scipy.linalg.block_diag(*blocks)
    n = A.shape[0]
    rng = np.random.default_rng(0)
    B, C = rng.standard_normal((n, 1)), rng.standard_normal((2, n))
    for low, high in ((0.49, 0.4905), (1.0, 1.02)):
        dense = sampled(A, B, C, low, high)[:, 0]
        bound = second_derivative(A, B, C, low, high)[:, 0]
        assert np.all(bound >= dense * (1 - 1e-4))
        assert np.all(bound <= 1.6 * dense)


def test_second_derivatives_of_many_arcs_are_those_of_each():
    """Some of the arcs are halved, others not; one holds a pole on the circle itself, at an angle that halving never meets."""
    blocks = [[[p.real, p.imag], [-p.imag, p.real]] for p in (0.99 * np.exp(0.5j), np.exp(1j / 3))]
    A, rng = scipy.linalg.block_diag(*blocks), np.random.default_rng(0)
    B, C = rng.standard_normal((4, 2)), rng.standard_normal((3, 4))
    edges = np.array([0.0, 0.3, 0.4, 0.49, 0.51, 0.7, 3.1])
    found = ArcDerivatives(A, B, C).on_arcs(edges[:-1], edges[1:])
    for own, low, high in zip(found, edges[:-1], edges[1:], strict=True):
        np.testing.assert_allclose(own, second_derivative(A, B, C, low, high), rtol=1e-9)
        if low != 0.3:
            assert np.all(own >= sampled(A, B, C, low, high) * (1 - 1e-4))
    assert np.all(found[1] > 1e12)


def problems():
    """One of each kind of class: balls with and without roll-off, discrete and continuous, and passive ones."""
    omega = np.array([1.0, 3.0, 8.0])
    values = 1 / (1j * omega + 1)
    for prior, dt in (
        (rid.Prior(gain_bound=2.0, decay_rate=1.1), 0.1),
        (rid.Prior(gain_bound=2.0, decay_rate=1.1, roll_off=2, corner=5.0), 0.1),
        (rid.Prior(gain_bound=2.0, decay=0.7, roll_off=2, corner=5.0), None),
        (rid.PositiveReal(decay=0.5), None),
        (rid.NegativeImaginary(decay=0.5), None),
    ):
        frf = rid.FrequencyResponse(omega, values, bound=0.05, dt=dt)
        yield rid.MixedProblem(frequency=frf, prior=prior)


@pytest.mark.parametrize("problem", problems(), ids=lambda problem: type(problem.prior).__name__)
def test_bounds_of_a_class_on_many_arcs_are_those_of_each(problem, monkeypatch):
    monkeypatch.setattr("robustid.identification.passive._TOGETHER", 7)  # in several parts
    nothing = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    bends = Curvature(problem, nothing, None, np.zeros((0, 1, 1)), False)
    edges = np.linspace(0.1, 2.8, 9)
    low, high = edges[:-1], edges[1:]
    for many in (bends.largest, bends.weight, bends.outside):
        alone = [many(low[k : k + 1], high[k : k + 1]) for k in range(low.size)]
        np.testing.assert_allclose(many(low, high), np.concatenate(alone), rtol=1e-12)
    assert np.all(bends.largest(low, high) > 0)


@pytest.mark.parametrize("seed", range(4))
def test_norms_of_resolvents_are_bounded_from_those_beside_them(seed):
    """Never below a norm, and above it by little; in any order, and one at a time."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((6, 6))
    A *= (0.5, 0.9, 0.99, 0.9999)[seed] / np.abs(np.linalg.eigvals(A)).max()
    found = ArcDerivatives(A, np.ones((6, 1)), np.ones((1, 6)))
    angles = rng.permutation(np.concatenate([rng.uniform(0, np.pi, 200), np.angle(np.linalg.eigvals(A))]))
    exact = np.array([np.linalg.norm(np.linalg.inv(np.exp(1j * a) * np.eye(6) - A), 2) for a in angles])
    for sizes in (found.norms(angles), np.concatenate([found.norms(a[None]) for a in angles])):
        assert np.all(sizes >= exact * (1 - 1e-9))
        assert np.all(sizes <= 1.12 * exact)
    assert np.all(np.isfinite(ArcDerivatives(np.eye(1), np.ones((1, 1)), np.ones((1, 1))).norms(np.zeros(1))))


@pytest.mark.parametrize("seed", range(6))
def test_second_derivatives_of_random_systems_are_never_above_their_bounds(seed):
    rng = np.random.default_rng(seed)
    n, inputs, outputs = int(rng.integers(1, 9)), int(rng.integers(1, 4)), int(rng.integers(1, 4))
    A = rng.standard_normal((n, n))
    A *= rng.uniform(0.3, 0.99) / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((n, inputs)), rng.standard_normal((outputs, n))
    edges = np.sort(rng.uniform(0, np.pi, 12))
    found = ArcDerivatives(A, B, C).on_arcs(edges[:-1], edges[1:])
    for own, low, high in zip(found, edges[:-1], edges[1:], strict=True):
        assert np.all(own >= sampled(A, B, C, low, high) * (1 - 1e-4) - 1e-6)


def test_poles_that_lie_together_near_the_circle_end_in_time():
    """Three real poles a few millionths from 1 and each other: arcs near them say nothing, those beyond do."""
    A = np.diag([0.9999, 0.99999, 0.999995]) + np.diag([1.0, 1.0], 1)
    parts = ArcDerivatives(A, np.array([[0.0], [0.0], [1.0]]), np.array([[1e-6, 0.0, 0.0]]))
    edges = np.geomspace(1e-4, 3.0, 400)
    found = parts.on_arcs(edges[:-1], edges[1:])[:, 0, 0]
    assert parts._known[0].size < 200_000
    assert np.isinf(found[0])
    for k in range(150, 399, 50):
        arc = edges[k], edges[k + 1]
        assert sampled(A, np.array([[0.0], [0.0], [1.0]]), np.array([[1e-6, 0.0, 0.0]]), *arc).max() <= found[k] * (
            1 + 1e-4
        )
