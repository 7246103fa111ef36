"""Central models of several channels in closed form, all solutions, and the balls of their values."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.bases import input_normal_pair, shift_pair
from robustid.identification import Prior
from robustid.identification.entries import Entries
from robustid.identification.formulation.sarason import PairMap
from support.cases import slow
from support.matrix_plants import random_matrix_problem, response
from support.problems import identified

pytestmark = pytest.mark.quick


SHAPES = (2, 2), (2, 3), (3, 2), (1, 3), (3, 1)
ANGLES = np.linspace(0, np.pi, 41)


def contractions(rng, p, q):
    """Functions of the unit ball: isometries, constants inside, and a dynamic one; (name, E, whether an isometry)."""
    unitary = np.linalg.qr(rng.standard_normal((max(p, q), min(p, q))))[0]
    isometry = unitary if p >= q else unitary.T
    yield isometry, True
    inside = rng.standard_normal((p, q))
    yield 0.7 * inside / np.linalg.norm(inside, 2), False
    yield dynamic(rng, p, q), False


def dynamic(rng, p, q):
    """A corner of an orthogonal matrix, as a system in the delay: H-infinity norm at most 1."""
    n = 2
    M = np.linalg.qr(rng.standard_normal((n + p + q, n + p + q)))[0]
    return control.ss(M[:n, :n], M[:n, n : n + q], M[n : n + p, :n], M[n : n + p, n : n + q], 1.0)


def sampled(p, q, seed, lines=3):
    """Interpolants of random coefficients with ||X|| = 0.9, and their coefficients."""
    rng = np.random.default_rng([seed, p, q])
    problem = random_matrix_problem(seed, p, q, lines)[0]
    return rng, problem, identified(problem)


@pytest.mark.parametrize(("p", "q"), SHAPES)
def test_the_central_model(p, q):
    """Order n min(p, q), poles inside 1/rho, in the ball on |z| = 1/rho, through the values of its coefficients."""
    _, problem, result = sampled(p, q, 1)
    frf, prior, model = problem.frequency[0], problem.prior, result.model
    assert result.order == problem.coefficients * min(p, q)
    assert np.abs(np.linalg.eigvals(model.A)).max() * prior.decay_rate < 1
    largest = max(np.linalg.norm(G, 2) for G in response(model, ANGLES, 1 / prior.decay_rate))
    assert largest <= prior.gain_bound * (1 + 1e-9)
    # The coefficients are inner products with the functions of the pair: their values at the nodes.
    pair = input_normal_pair(problem.angles, 1 / prior.decay_rate)
    phi = pair.evaluate(np.exp(-1j * problem.angles) / prior.decay_rate)
    x = result.coefficients.reshape(p, q, -1)
    expected = prior.gain_bound * np.einsum("pqn,fn->fpq", x, phi)
    np.testing.assert_allclose(response(model, problem.angles), expected, rtol=0, atol=1e-8 * prior.gain_bound)
    assert frf.ratio(frf.values - response(model, frf.omega)).max() <= 1 + 1e-9


@pytest.mark.parametrize(
    ("shape", "seed", "lines", "tolerance"),
    [*((shape, 2, 3, 1e-7) for shape in SHAPES), *(slow(SHAPES[seed % 3], seed, 6, 1e-6) for seed in range(30))],
)
def test_all_solutions_and_their_balls(shape, seed, lines, tolerance):
    """Every E: the same values at the lines, in the ball, its values in the Weyl balls; isometries on their borders."""
    rng, problem, result = sampled(*shape, seed, lines)
    gain, radius = problem.prior.gain_bound, 1 / problem.prior.decay_rate
    assert result.order == problem.coefficients * min(shape)
    centre, left, right = result.weyl_ball(ANGLES)
    reached, at_lines = 0.0, response(result.model, problem.angles)
    for E, isometry in contractions(rng, *shape):
        model = result.solution(E)
        np.testing.assert_allclose(response(model, problem.angles), at_lines, rtol=0, atol=1e-8 * gain)
        assert max(np.linalg.norm(G, 2) for G in response(model, ANGLES, radius)) <= gain * (1 + 1e-9)
        U = np.linalg.solve(left, response(model, ANGLES) - centre) @ np.linalg.inv(right)
        sizes = np.linalg.svd(U, compute_uv=False)
        assert sizes.max() <= 1 + tolerance
        if isometry:  # maps of balls take isometries to isometries
            np.testing.assert_allclose(sizes, 1, rtol=0, atol=tolerance)
        reached = max(reached, sizes.max())
    assert reached > 1 - tolerance
    _, left, right = result.weyl_ball(problem.frequency[0].omega)
    assert (np.linalg.norm(left, 2, axis=(1, 2)) * np.linalg.norm(right, 2, axis=(1, 2))).max() < 1e-5 * gain


def test_the_ball_of_one_exact_value():
    """Of g(0) = W0 alone, at zeta: Pick's ball {U: ||(I - W0 W0')^-1/2 (U - W0) (I - W0'U)^-1 (I - W0'W0)^1/2|| <= |zeta|}."""
    rng = np.random.default_rng(3)
    for p, q in ((2, 2), (2, 3), (3, 2)):
        W = rng.standard_normal((p, q))
        W *= 0.6 / np.linalg.norm(W, 2)
        family = PairMap(shift_pair(1), Entries(p, q)).interpolants(W.ravel())
        zeta = 0.5 * np.exp(0.7j)
        centre, left, right = (part[0] for part in family.weyl_ball(np.array([zeta])))
        for _ in range(10):
            U = np.linalg.qr(rng.standard_normal((max(p, q),) * 2) + 1j * rng.standard_normal((max(p, q),) * 2))[0]
            V = centre + left @ U[:p, :q] @ right  # a matrix of norm 1: on the border
            outer, inner = (np.linalg.eigh(np.eye(m) - part) for m, part in ((p, W @ W.T), (q, W.T @ W)))
            before = (outer[1] / np.sqrt(outer[0])) @ outer[1].T
            after = (inner[1] * np.sqrt(inner[0])) @ inner[1].T
            moved = before @ (V - W) @ np.linalg.inv(np.eye(q) - W.T @ V) @ after
            assert np.linalg.norm(moved, 2) == pytest.approx(abs(zeta), rel=1e-9)


def test_schwarz():
    """Of g(0) = 0: |g(zeta)| <= |zeta|."""
    family = PairMap(shift_pair(1), Entries(2, 3)).interpolants(np.zeros(6))
    zeta = 0.5 * np.exp(0.7j)
    centre, left, right = family.weyl_ball(np.array([zeta]))
    assert np.abs(centre).max() < 1e-14
    both = np.linalg.svd(left, compute_uv=False)[..., None] * np.linalg.svd(right, compute_uv=False)[:, None]
    np.testing.assert_allclose(both, 0.5, atol=1e-12)


@pytest.mark.parametrize(("p", "q"), [(2, 3), (3, 2)])
def test_records_cost_a_state_less(p, q):
    """Order (T - 1) min(p, q) from T delays: the impulse response is met by every solution."""
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal((4, q)), 0.1 * rng.standard_normal((4, p))
    record = rid.TimeRecord(u, y, dt=1.0, bound=0.02)
    result = identified(rid.MixedProblem(time=record, prior=Prior(gain_bound=1.0, decay_rate=1.2)))
    assert result.order == 3 * min(p, q)
    expected = control.forced_response(result.model, inputs=u.T).outputs
    for E, _ in contractions(rng, p, q):
        model = result.solution(E)
        np.testing.assert_allclose(control.forced_response(model, inputs=u.T).outputs, expected, atol=1e-9)


def test_a_scaled_prior_scales_the_ball():
    """The model divided by the scaling is in the ball, for a scaling of rank two; its states are twice as many."""
    problem, _ = random_matrix_problem(5, 2, 2, 3)
    scaling = np.array([[1.0, 3.0], [2.0, 0.5]])
    result = identified(problem.with_prior(scaling=scaling))
    sizes = [np.linalg.norm(G / scaling, 2) for G in response(result.model, ANGLES, 1 / problem.prior.decay_rate)]
    assert max(sizes) <= problem.prior.gain_bound * (1 + 1e-9)
    assert result.order == 2 * 2 * problem.coefficients
    centre, left, right = result.weyl_ball(ANGLES)
    values = response(result.solution(np.eye(2)), ANGLES)
    U = np.linalg.solve(left, (values - centre) / scaling) @ np.linalg.inv(right)
    np.testing.assert_allclose(np.linalg.svd(U, compute_uv=False), 1, atol=1e-7)


def test_a_free_parameter_must_be_a_contraction():
    result = sampled(2, 2, 6, 2)[2]
    for E in (1.5 * np.eye(2), np.ones((2, 3)), 0.3, np.full((2, 2), np.nan)):
        with pytest.raises((rid.InputError, rid.errors.InputTypeError), match="`E`"):
            result.solution(E)
    with pytest.raises(rid.InputError, match="weyl_ball"):
        result.weyl_disc(1.0)
