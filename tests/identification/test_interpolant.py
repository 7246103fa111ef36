"""Known answers: theory of one and two data, the set of all solutions, Lemma 1."""

import itertools

import control
import numpy as np
import pytest
from scipy.optimize import brentq

import robustid as rid
from robustid.bases import input_normal_pair
from robustid.identification.certificate import evaluate_certificate
from robustid.identification.formulation.classical import classical_form
from robustid.identification.formulation.sarason import PairMap
from support.cases import seeds, slow
from support.problems import CASES, identified, random_problem

K, RHO, DT = 1.7, 1.2, 0.01


def margin(frequency=None, time=None, **options):
    problem = rid.MixedProblem(frequency=frequency, time=time, prior=rid.Prior(gain_bound=K, decay_rate=RHO))
    result = identified(problem, **options)
    assert result.margin_lower <= result.margin <= result.margin_lower + 1e-6 * max(1, result.margin)
    return result.margin


def line(omega, value, bound):
    return rid.FrequencyResponse([omega], [value], bound=bound, dt=DT)


def test_without_other_data_the_modulus_is_bounded_by_the_gain():
    assert margin(line(0.0, 2.0, 0.1)) == pytest.approx((2.0 - K) / 0.1, abs=1e-6)
    assert margin(line(np.pi / DT, -2.5, 0.1)) == pytest.approx((2.5 - K) / 0.1, abs=1e-6)


def test_real_coefficients_bound_the_imaginary_part():
    angle = 0.8
    zeta = np.exp(-1j * angle) / RHO
    s = 2 * abs(zeta.imag) / abs(1 - zeta**2)
    largest = K * (1 - np.sqrt(1 - s**2)) / s
    assert margin(line(angle / DT, 2.0j, 0.05)) == pytest.approx((2.0 - largest) / 0.05, abs=1e-6)


def test_two_taylor_coefficients_meet_at_schur_s_parabola():
    g0, g1, bound = 1.0, 1.4, 0.03
    record = rid.TimeRecord([1.0, 0.0], [g0, g1], dt=DT, bound=bound)

    def gap(s):  # |g1| rho / K <= 1 - (g0/K)^2, both moved towards the origin by s * bound
        return (g1 - s * bound) * RHO / K - 1 + ((g0 - s * bound) / K) ** 2

    assert margin(time=record) == pytest.approx(brentq(gap, 0, g0 / bound, xtol=1e-14), abs=1e-6)


def test_two_values_at_real_nodes_meet_at_pick_s_disc():
    w, v, bound = 1.4, -1.6, 0.02
    frf = rid.FrequencyResponse([0.0, np.pi / DT], [w, v], bound=bound, dt=DT)
    z, y = 1 / RHO, -1 / RHO
    radius = abs(z - y) / abs(1 - z * y)

    def gap(s):
        a, b = (w - s * bound) / K, (v + s * bound) / K
        return (a - b) / (1 - a * b) - radius

    assert margin(frf) == pytest.approx(brentq(gap, 0, 1.3 / bound, xtol=1e-14), abs=1e-6)


def coefficients_in(sarason, size, rng):
    x = rng.standard_normal(sarason.pair.order)
    return x * size / sarason.norm(x)


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_every_solution_interpolates_and_stays_in_the_ball(seed):
    rng = np.random.default_rng(seed)
    angles, taylor = np.sort(rng.uniform(0.1, 3, 4)), 5
    pair = input_normal_pair(angles, 1 / RHO, taylor)
    sarason = PairMap(pair)
    x = coefficients_in(sarason, rng.uniform(0.3, 0.999), rng)
    family = sarason.interpolants(x)
    zeta, circle = np.exp(-1j * angles) / RHO, np.exp(1j * np.linspace(0, np.pi, 3000))
    dynamic = control.ss([[0.5]], [[0.5]], [[0.4]], [[0.2]], True)
    # One state less at the centre: theory of `Interpolants`.
    for E, states in ((0.0, -1), (0.6, 0), (-1.0, 0), (dynamic, 1)):
        a, b, c, d = family.realise(E)
        model = control.ss(a, b, c, d, True)
        assert a.shape[0] == pair.order + states
        assert np.abs(np.linalg.eigvals(a)).max() < 1
        # Series convention: phi(zeta) = d + zeta c (I - zeta a)^-1 b is the transfer function at 1/zeta.
        assert np.abs(model(1 / zeta) - pair.evaluate(zeta) @ x).max() < 1e-11
        f = [d[0, 0]] + [(c @ np.linalg.matrix_power(a, k) @ b)[0, 0] for k in range(taylor - 1)]
        assert np.abs(np.array(f) - pair.taylor(taylor) @ x).max() < 1e-11
        peak = np.abs(model(1 / circle)).max()
        assert peak <= 1 + 1e-10
        if E == -1.0:
            assert np.abs(np.abs(model(1 / circle)) - 1).max() < 1e-8  # an inner free parameter gives an inner solution


def test_central_interpolant_is_the_closed_form():
    rng = np.random.default_rng(3)
    pair = input_normal_pair([0.3, 1.0, 2.0], 1 / RHO, 3)
    sarason = PairMap(pair)
    x = coefficients_in(sarason, 0.9, rng)
    X = sarason.matrix(x)
    M = np.eye(pair.order) - X.T @ X
    W = M + np.outer(x, x)
    assert np.abs(W - pair.A.T @ M @ pair.A - pair.c.T @ pair.c).max() < 1e-13
    a, b, c, d = sarason.interpolants(x).realise()
    for zeta in 0.8 * np.exp(1j * rng.uniform(0, 3, 5)):
        direct = x @ np.linalg.solve(W - zeta * pair.A.T @ M, pair.c[0])
        ours = (d + zeta * c @ np.linalg.solve(np.eye(a.shape[0]) - zeta * a, b))[0, 0]
        assert abs(direct - ours) < 1e-13


def test_weyl_disc_is_filled_by_complex_free_parameters_and_holds_the_real_ones():
    rng = np.random.default_rng(4)
    pair = input_normal_pair([0.5, 1.5], 1 / RHO, 2)
    family = PairMap(pair).interpolants(coefficients_in(PairMap(pair), 0.8, rng))
    n, zeta = pair.order, 0.6 * np.exp(0.9j)
    centre, radius = family.weyl_disc(zeta)

    def value(E):
        full = family.V + E * family.outer @ family.inner.T
        state = np.linalg.solve(np.eye(n) - zeta * full[:n, :n], full[:n, n])
        return full[n, n] + zeta * full[n, :n] @ state

    distance = np.array([abs(value(np.exp(1j * t)) - centre[0]) for t in np.linspace(0, 6, 30)])
    assert np.abs(distance - radius[0]).max() < 1e-12
    inside = [abs(value(E) - centre[0]) for E in rng.uniform(-1, 1, 30)]
    assert max(inside) <= radius[0] + 1e-12


def test_lemma_1_the_condition_number_at_the_roots_of_unity():
    rho = 1.1
    for N in (4, 8, 16, 24):
        angles = 2 * np.pi * np.arange(N // 2 + 1) / N
        pair = input_normal_pair(angles, 1 / rho)
        assert pair.order == N
        form = classical_form(pair, np.exp(-1j * angles) / rho, 1 / rho, 0)
        assert form.condition == pytest.approx(rho ** (2 * (N - 1)), rel=1e-6)


def test_the_paper_s_matrices_are_those_of_its_theorem():
    angles, rho, taylor = np.array([0.4, 1.9]), 1.15, 3
    pair = input_normal_pair(angles, 1 / rho, taylor)
    form = classical_form(pair, np.exp(-1j * angles) / rho, 1 / rho, taylor)
    z = np.exp(-1j * np.array([0.4, -0.4, 1.9, -1.9]))
    k = np.arange(taylor)
    Q, S = 1 / (1 - np.outer(z.conj(), z) / rho**2), z.conj()[:, None] ** k * rho ** (-2.0 * k)
    M0 = np.block([[Q, S], [S.conj().T, np.diag(rho ** (-2.0 * k))]])
    half = np.array([[1, 1j], [1, -1j]]) / np.sqrt(2)  # (z, conj z) from the real form of a pair
    change = np.block([[np.kron(np.eye(2), half), np.zeros((4, 3))], [np.zeros((3, 4)), np.eye(3)]])
    assert np.abs(np.linalg.eigvalsh(M0) - np.linalg.eigvalsh(form.gram)).max() < 1e-12
    real = change.conj().T @ M0 @ change
    assert np.abs(real - form.gram).max() < 1e-12
    for j in range(pair.order):
        X = form.V @ form.data_basis[j] @ np.linalg.inv(form.V)
        assert np.abs(X - PairMap(pair).matrix(form.to_orthonormal[:, j])).max() < 1e-11


def test_adjoint_and_basis_agree_with_the_stein_equation():
    pair = input_normal_pair([0.0, 0.7, 2.0, np.pi], 1 / RHO, 4)
    sarason, rng = PairMap(pair), np.random.default_rng(0)
    x, Y = rng.standard_normal(pair.order), rng.standard_normal((pair.order, pair.order))
    X = sarason.matrix(x)
    assert np.abs(X - pair.A.T @ X @ pair.A - pair.c.T @ x[None, :]).max() < 1e-13
    assert np.abs(np.tensordot(x, sarason.basis, 1) - X).max() < 1e-13
    assert (pair.c @ sarason.stein(Y))[0] @ x == pytest.approx(np.sum(Y * X), rel=1e-12)
    H = np.tensordot(x, sarason.symmetric_basis, 1)
    assert np.linalg.norm(H, 2) == pytest.approx(np.linalg.norm(X, 2), rel=1e-12)


@pytest.mark.parametrize("seeds", [2, slow(5)])
def test_any_multipliers_prove_a_true_bound(seeds):
    """Four problems a seed x 20 random multipliers: none claims more than the margin that a system reaches."""
    for seed, case in itertools.product(range(seeds), CASES):
        result = rid.identify(random_problem(seed, case, 8, spread=0.2, noise=4.0))
        data, best, rng = result.formulation.data, result.certificate, np.random.default_rng(seed)
        for size in np.logspace(-9, 1, 20):
            samples = best.samples + size * rng.standard_normal(best.samples.size)
            ball = best.ball + size * rng.standard_normal(best.ball.shape)
            claim = evaluate_certificate(samples, ball, result.margin, data.rows, data.sarason)
            assert claim <= result.margin * (1 + 1e-12)
