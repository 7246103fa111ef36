"""Schur's algorithm against closed forms and the dense interpolant; truncation of long impulse responses."""

import control
import numpy as np
import pytest
import scipy.linalg as sla

from robustid.bases import input_normal_pair
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.schur import taylor_interpolants
from robustid.identification.truncation import balanced_from_impulse
from robustid.reduction import balanced_truncation, hankel_singular_values
from support.cases import seeds, slow
from support.reduction_models import gap, points_of
from support.refusals import refused

CIRCLE = np.exp(1j * np.linspace(0, np.pi, 2001))


def norm(x):
    """||X(x)||: turned upside down, the Toeplitz matrix is symmetric."""
    return np.abs(np.linalg.eigvalsh(sla.toeplitz(x, np.zeros(x.size))[::-1])).max()


def polynomial(coefficients, zeta):
    return np.polyval(coefficients[::-1], zeta)


def markov(A, B, C, D, count):
    """D, C B, C A B, ..."""
    g, state = np.full(count, np.ravel(D)[0]), B
    for k in range(1, count):
        g[k] = (C @ state)[0, 0]
        state = A @ state
    return g


def at(parts, zeta):
    """Values of the series D + C B zeta + C A B zeta^2 + ..."""
    return control.ss(*parts, True)(1 / zeta)


def test_one_coefficient_leaves_pick_s_disc():
    w, zeta = 0.7, np.array([0.0, 0.3, -0.95, 0.6 * np.exp(0.9j), 1j])
    centre, radius = taylor_interpolants([w]).weyl_disc(zeta)
    t = np.abs(zeta) ** 2
    assert np.abs(centre - w * (1 - t) / (1 - w**2 * t)).max() < 1e-15
    assert np.abs(radius - np.abs(zeta) * (1 - w**2) / (1 - w**2 * t)).max() < 1e-15


def test_two_coefficients_by_hand():
    x0, x1 = 0.6, -0.4
    g = x1 / (1 - x0**2)  # phi = (x0 + g zeta)/(1 + x0 g zeta): value x0, slope g (1 - x0^2)
    family = taylor_interpolants([x0, x1])
    assert family.gamma == pytest.approx([x0, g], rel=1e-15)
    P, Q = family.central()
    assert P / Q[0] == pytest.approx([x0, g], rel=1e-14)
    assert Q / Q[0] == pytest.approx([1, x0 * g], rel=1e-14)
    assert np.abs(family.evaluate(CIRCLE) - (x0 + g * CIRCLE) / (1 + x0 * g * CIRCLE)).max() < 1e-15
    assert family.coefficients(5) == pytest.approx([x0, x1, *x1 * (-x0 * g) ** np.arange(1, 4)], rel=1e-13)
    assert family.coefficients(0).shape == (0,)


@pytest.mark.parametrize("seed", seeds(5, 20))
def test_every_solution_is_that_of_the_dense_form(seed):
    rng = np.random.default_rng(seed)
    L = int(rng.integers(1, 31))
    x = rng.standard_normal(L) * rng.uniform(0.8, 1.1) ** np.arange(L)
    x *= rng.uniform(0.3, 0.999) / norm(x)
    pair = input_normal_pair([], 1.0, taylor=L)
    # The pair deals its delays out over two halves: its coefficients are those of x in another order.
    dense, family = PairMap(pair).interpolants(pair.taylor(L).T @ x), taylor_interpolants(x)
    zeta = rng.uniform(0, 0.99, 40) * np.exp(1j * rng.uniform(-3, 3, 40))
    found, expected = family.weyl_disc(zeta), dense.weyl_disc(zeta)
    assert max(np.abs(a - b).max() for a, b in zip(found, expected, strict=True)) < 1e-10
    P, Q = family.central()
    p, q = zeta * polynomial(P[::-1], zeta), zeta * polynomial(Q[::-1], zeta)
    # The dense form leaves the sign of E open, as that of the null vectors u_r and u_d.
    sign = 1.0 if np.abs(at(dense.realise(1.0), zeta) - family.evaluate(zeta, 1.0)).max() < 1e-10 else -1.0
    for E in (0.0, 1.0, -1.0, 0.4):
        model, values = dense.realise(sign * E), family.evaluate(zeta, E)
        assert np.abs(at(model, zeta) - values).max() < 1e-10
        assert np.abs((polynomial(P, zeta) + q * E) / (polynomial(Q, zeta) + p * E) - values).max() < 1e-10
        taylor = markov(*model, 2 * L)
        assert np.abs(family.coefficients(2 * L, E) - taylor).max() < 1e-10
        assert np.abs(taylor[:L] - x).max() < 1e-11


GAINS = 0.5, 0.99, 1 - 1e-6, 1 - 1e-10


@pytest.mark.parametrize(
    ("kind", "gain"),
    [
        *(slow("noise", gain) for gain in GAINS),
        *(("resonances", gain) if gain == GAINS[2] else slow("resonances", gain) for gain in GAINS),
    ],
)
def test_a_thousand_coefficients_up_to_the_edge(kind, gain):
    rng, k = np.random.default_rng(5), np.arange(1000)
    modes = ((0.999, 0.3), (0.995, 1.0), (0.9995, 2.0))
    noise = rng.standard_normal(k.size)
    x = noise if kind == "noise" else 0.01 * noise + sum(r**k * np.cos(t * k + 1) for r, t in modes)
    x *= gain / norm(x)
    family, fine = taylor_interpolants(x), np.exp(1j * np.linspace(0, np.pi, 20001))
    for E in (0.0, 1.0, -0.5):
        assert np.abs(family.coefficients(k.size, E) - x).max() < 1e-12
        assert np.abs(family.evaluate(CIRCLE, E)).max() < 1 + 1e-11
    assert np.abs(np.abs(family.evaluate(CIRCLE, -1.0)) - 1).max() < 1e-11  # E inner: phi inner
    P, Q = (polynomial(c, fine) for c in family.central())
    size = np.abs(Q) ** 2
    assert np.abs(size - np.abs(P) ** 2 - 1).max() < 1e-12 * size.max()
    assert np.abs(P / Q - family.evaluate(fine)).max() < 1e-11
    turns = np.unwrap(np.angle(Q))  # Q real: a zero in the disc would turn it by pi over the half circle
    assert abs(turns[-1] - turns[0]) < 1e-6


def test_an_x_at_or_outside_the_edge_is_refused():
    for x, coefficient in (([1.0], 0), ([0.6, 0.64], 1), ([0.5, 0.1, 0.9], 2)):
        refused(rf"`x` must lie inside the ball: .* coefficient {coefficient} is", taylor_interpolants, x)
    x = np.random.default_rng(2).standard_normal(300)
    x /= norm(x)
    refused("`x` must lie inside the ball", taylor_interpolants, x * (1 + 1e-9))
    assert np.abs(taylor_interpolants(x * (1 - 1e-9)).gamma).max() < 1
    refused("`x` must hold", taylor_interpolants, [])


def test_points_outside_the_disc_and_free_numbers_outside_the_interval_are_refused():
    family = taylor_interpolants([0.5, 0.1])
    refused("`zeta` must lie in the closed unit disc", family.evaluate, 1.01j)
    refused("`E` must lie in", family.evaluate, 0.5, -1.1)
    refused("`E` must lie in", family.coefficients, 3, 2.0)


@pytest.mark.parametrize("pole", [0.5, -0.9, 0.98])
def test_a_first_order_response_has_one_state_and_one_known_singular_value(pole):
    g = np.append(2.0, 3 * pole ** np.arange(2500))
    small = balanced_from_impulse(g, 1e-9)
    assert small.hankel == pytest.approx([3 / (1 - pole**2)], rel=1e-13)
    assert small.A[0, 0] == pytest.approx(pole, rel=1e-12)
    assert small.D[0, 0] == 2.0
    assert small.bound <= 1e-9
    assert np.abs(markov(*small[:4], 2501) - g).max() < 1e-13


@pytest.mark.parametrize("seed", seeds(1, 6))
def test_the_truncation_is_that_of_a_state_space(seed):
    rng = np.random.default_rng(seed)
    n, M = 7, int(rng.integers(400, 1500))
    poles = rng.uniform(0.3, 0.95, 3) * np.exp(1j * rng.uniform(0.2, 2.8, 3))
    a = sla.block_diag(*([[p.real, p.imag], [-p.imag, p.real]] for p in poles), rng.uniform(-0.9, 0.9))
    model = control.ss(a, rng.standard_normal((n, 1)), rng.standard_normal((1, n)), 0.3, True)
    g = markov(model.A, model.B, model.C, model.D, M)
    sigma = hankel_singular_values(model)
    full = balanced_from_impulse(g, 1e-11 * sigma[0])
    assert np.abs(full.hankel - sigma[: full.hankel.size]).max() < 1e-13 * sigma[0]
    for order in range(1, n):
        peer = balanced_truncation(model, order=order)
        if peer.bound < 1e-8 * sigma[0]:
            break
        small = balanced_from_impulse(g, peer.bound * (1 + 1e-2))
        assert small.hankel.size == order
        assert small.bound == pytest.approx(peer.bound, rel=1e-2)
        assert gap(control.ss(*small[:4], True), peer.model, points_of(model)) < 1e-9 * sigma[0]


def smooth(rng, M, decay):
    k = np.arange(M)
    modes = sum(r**k * np.cos(t * k + 1) for r, t in ((0.9, 0.3), (0.95, 1.0)))
    return modes + 0.02 * rng.standard_normal(M) * decay**k


@pytest.mark.parametrize(
    ("M", "decay", "tolerance"),
    [
        (800, 0.9, 1e-6),
        (100, 1.0, 0.1),
        *(slow(*c) for c in ((300, 1.0, 0.1), (800, 0.9, 1e-1), (800, 0.9, 1e-10), (1500, 0.9, 1e-8))),
    ],
)
def test_the_error_stays_within_the_bound_and_the_order_is_the_smallest(M, decay, tolerance):
    g = smooth(np.random.default_rng(7), M, decay)
    small = balanced_from_impulse(g, tolerance)
    sigma = np.sort(np.abs(np.linalg.eigvalsh(sla.hankel(g[1:]))))[::-1]
    order = small.hankel.size
    assert np.abs(small.hankel - sigma[:order]).max() < 1e-13 * sigma[0]
    assert 2 * sigma[order:].sum() - 1e-12 <= small.bound <= tolerance
    assert 2 * sigma[order - 1 :].sum() > 0.99 * tolerance
    assert 0 < order < M - 1
    count = 1 << 15
    assert np.abs(np.linalg.eigvals(small.A)).max() ** count < 1e-14  # stable, and nothing folds over in the transform
    error = markov(*small[:4], count)
    error[:M] -= g
    peak = np.abs(np.fft.rfft(error)).max()
    assert 1e-3 * small.bound < peak <= small.bound


def test_a_partial_decomposition_finds_what_the_whole_one_does(monkeypatch):
    g = smooth(np.random.default_rng(3), 700, 0.9)
    partial = balanced_from_impulse(g, 1e-4)
    monkeypatch.setattr("robustid.identification.truncation._FIRST_RANK", g.size)
    whole = balanced_from_impulse(g, 1e-4)
    assert partial.hankel.size == whole.hankel.size
    assert np.abs(partial.hankel - whole.hankel).max() < 1e-13 * whole.hankel[0]
    assert whole.bound <= partial.bound <= whole.bound + 1e-6
    assert np.abs(markov(*partial[:4], 700) - markov(*whole[:4], 700)).max() < 1e-9


def test_units_of_the_response_do_not_matter():
    g = smooth(np.random.default_rng(4), 500, 0.9)
    one = balanced_from_impulse(g, 1e-4)
    for scale in (2.0**-60, 2.0**60):
        other = balanced_from_impulse(scale * g, scale * 1e-4)
        assert np.array_equal(other.A, one.A)
        assert np.array_equal(other.hankel, scale * one.hankel)
        assert other.bound == scale * one.bound
        assert np.array_equal(other.B @ other.C, scale * (one.B @ one.C))


@pytest.mark.parametrize("g", [[1.5], [1.5, 0.0], [1.5, 1e-9, 0.0, 0.0]])
def test_nothing_to_keep_leaves_the_static_gain(g):
    small = balanced_from_impulse(g, 1e-8)
    assert [part.shape for part in small[:4]] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert small.D[0, 0] == 1.5
    assert small.bound == 2 * max(g[1:], default=0.0)


def test_of_a_tolerance_below_rounding_the_bound_says_what_rounding_leaves():
    g = smooth(np.random.default_rng(4), 500, 0.9)
    small = balanced_from_impulse(g, 1e-18)
    assert 1e-18 < small.bound < 1e-9 * small.hankel[0]
    assert np.abs(markov(*small[:4], len(g)) - g).sum() < small.bound


def test_a_response_or_tolerance_of_no_use_is_refused():
    g = smooth(np.random.default_rng(4), 500, 0.9)
    for wrong in (0.0, -1.0):
        refused("`tolerance` must be positive", balanced_from_impulse, g, wrong)
    refused("`response` must hold at least one sample", balanced_from_impulse, [], 1e-3)
    refused("`response` must be finite", balanced_from_impulse, [1.0, np.inf], 1e-3)
