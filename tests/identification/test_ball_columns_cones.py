"""The structured interior-point method, part by part: balls, discs, the design."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from robustid.bases import Sections, input_normal_pair, shift_pair
from robustid.identification.entries import Entries
from robustid.identification.formulation import DenseDesign
from robustid.identification.formulation.ball import Axes, DenseMap, SymmetricBall, TurnedBall
from robustid.identification.formulation.passive import PassiveMap
from robustid.identification.formulation.passive_blocks import QuadratureRealPart, QuadratureRealParts
from robustid.identification.formulation.quadrature import QuadratureMap, QuadratureProducts
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.formulation.sections import BlockHankelMap, SectionMap
from robustid.identification.formulation.taylor import HankelMap
from robustid.identification.formulation.taylor_columns import ShiftColumns, ShiftDesign
from robustid.identification.solver import cones as discs
from robustid.identification.solver.cones import longest_step
from support.cases import seeds
from support.pairwise import every_one
from support.paths import arrow, dense_scaling, times, triple

pytestmark = pytest.mark.quick
ENTRIES = [Entries(2, 1), Entries(1, 3), Entries(2, 2), Entries(2, 2, symmetric=True)]


def hankel_basis(n):
    """H_j, (n, n, n), straight from the definition."""
    a = np.arange(n)
    return (a[:, None] + a == a[:, None, None] + n - 1).astype(float)


def definite(rng, n, condition=1e3):
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return (Q * np.geomspace(1, condition, n)) @ Q.T


# --- the ball ---------------------------------------------------------------------------------------------------------


def check_map(symmetric, H, rng):
    check_blocks(SymmetricBall(symmetric), [-H, H], rng, slack=1)


def check_blocks(ball, A, rng, slack=None):
    """The blocks of a ball against the stored A_kj, (n, s, s) each."""
    n, tolerance = ball.size, 1e-13
    x, sizes = rng.standard_normal(n), [one.shape[1] for one in A]
    Z, M = [definite(rng, s) for s in sizes], [rng.standard_normal((s, s)) for s in sizes]
    dense = [np.tensordot(x, one, 1) for one in A]
    for found, wanted in zip(ball.matrices(x), dense, strict=True):
        assert np.abs(found - wanted).max() <= tolerance * (slack or n) * np.abs(wanted).max()
    adjoint = sum(np.einsum("jab,ba->j", one, z) for one, z in zip(A, Z, strict=True))
    assert np.linalg.norm(ball.adjoint(Z) - adjoint) <= tolerance * n * sum(np.linalg.norm(z) for z in Z)
    for found, wanted, right in zip(ball.times(x, M), dense, M, strict=True):
        assert np.linalg.norm(found - wanted @ right) <= tolerance * np.linalg.norm(x) * n * np.linalg.norm(right)
    for first, second in zip(ball.both(x, M), (ball.matrices(x), ball.times(x, M)), strict=True):
        for one, other in zip(first, second, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * n * np.abs(other).max())
    pairs = [(definite(rng, s), definite(rng, s)) for s in sizes]
    curvature = sum(np.einsum("iab,jba->ij", a @ P, a @ Q, optimize=True) for a, (P, Q) in zip(A, pairs, strict=True))
    size = sum(np.linalg.norm(P) * np.linalg.norm(Q) for P, Q in pairs)
    assert np.abs(ball.curvature(pairs) - curvature).max() <= 10 * tolerance * n * size


@pytest.mark.parametrize("n", [1, 2, 7, 30])
def test_balls_against_stored_matrices(n):
    for seed in range(5):
        rng = np.random.default_rng([n, seed])
        check_map(HankelMap(n), hankel_basis(n), rng)
        check_map(DenseMap(hankel_basis(n)), hankel_basis(n), rng)
        angles = np.sort(rng.uniform(0.1, 3, n // 4))
        sarason = PairMap(input_normal_pair(angles, 0.9, n - 2 * angles.size))
        check_map(DenseMap(sarason.symmetric_basis), sarason.symmetric_basis, rng)
        zeros = np.sqrt(rng.uniform(0, 1, 1 + seed)) * np.exp(1j * rng.uniform(0, np.pi, 1 + seed))
        zeros[seed // 2 :] = np.abs(zeros[seed // 2 :])  # real ones too
        sections = Sections(zeros, max(1, n // 4))
        basis = PairMap(sections.pair).symmetric_basis
        check_map(BlockHankelMap(SectionMap(sections)), basis, rng)
        axes = np.linalg.qr(rng.standard_normal((sections.order, sections.order)))[0]
        turned = TurnedBall(SymmetricBall(BlockHankelMap(SectionMap(sections))), Axes(axes[None]))
        check_blocks(turned, [sign * np.tensordot(axes.T, basis, 1) for sign in (-1, 1)], rng)


@pytest.mark.parametrize("radius", [0.5, 0.9, 0.99])
def test_the_quadrature_of_a_pair_against_its_stored_matrices(radius):
    """Equal zeros (time samples), zeros at both ends of the circle, nodes at the head and close ones (1e-6 apart)."""
    for seed in range(20):
        rng = np.random.default_rng([int(100 * radius), seed])
        angles = np.sort(rng.uniform(0.05, 3.1, rng.integers(0, 12)))
        close = [angles[:1] + 1e-6, [0.0], [np.pi], []][seed % 4]
        first = rng.uniform(0.05, 3.1, seed % 3)
        pair = input_normal_pair(np.concatenate([angles, close]), radius, 1 + seed % 7, first)
        sarason = PairMap(pair)
        found = QuadratureMap.of(pair, sarason.symmetry)
        assert found is not None
        check_blocks(SymmetricBall(found), [-sarason.symmetric_basis, sarason.symmetric_basis], rng)
        passive = PassiveMap(pair).ball()
        assert isinstance(passive, QuadratureRealPart)
        check_blocks(passive, [(sarason.basis + sarason.basis.transpose(0, 2, 1)) / 2], rng)


@pytest.mark.parametrize(
    ("entries", "radius"), every_one([Entries(2, 2), Entries(2, 2, symmetric=True), Entries(3, 3)], [0.5, 0.97])
)
def test_a_passive_class_of_several_ports_against_its_stored_matrices(entries, radius):
    for seed in range(5):
        rng = np.random.default_rng([int(100 * radius), seed])
        passive = PassiveMap(input_normal_pair(np.sort(rng.uniform(0.05, 3.1, 2)), radius, seed), entries)
        assert isinstance(passive.ball(), QuadratureRealParts)
        X = passive.unit_matrices
        check_blocks(passive.ball(), [(X + X.transpose(0, 2, 1)) / 2], rng)


def test_a_pair_without_the_quadrature_does_without_it():
    sarason, x = PairMap(shift_pair(4)), np.arange(4.0)  # no cascade
    assert QuadratureMap.of(sarason.pair, sarason.symmetry) is None
    assert np.allclose(sarason.ball(quick=True).matrices(x)[1], np.tensordot(x, sarason.symmetric_basis, 1))


@pytest.mark.parametrize(("entries", "radius"), every_one(ENTRIES, [0.5, 0.97]))
def test_the_matrix_ball_by_quadrature_against_stored_matrices(entries, radius):
    for seed in range(5):
        rng = np.random.default_rng([int(100 * radius), seed])
        sarason = PairMap(input_normal_pair(np.sort(rng.uniform(0.05, 3.1, 3)), radius, seed), entries)
        assert isinstance(sarason._products(), QuadratureProducts)
        H = np.array([sarason.turned(X) for X in sarason.unit_matrices])
        high, A = sarason.shape[0], np.zeros((sarason.size, sum(sarason.shape), sum(sarason.shape)))
        A[:, :high, high:], A[:, high:, :high] = H, H.transpose(0, 2, 1)
        check_blocks(sarason.ball(), [A], rng)


@pytest.mark.parametrize(("entries", "zeros"), every_one(ENTRIES, [[0.5j], [0.3 + 0.4j, -0.2], [0.1, 0.7]]))
def test_the_matrix_ball_of_a_repeated_section_against_stored_matrices(entries, zeros):
    rng, sarason = np.random.default_rng(0), SectionMap(Sections(np.array(zeros), 3), entries)
    H = np.array([sarason.turned(X) for X in sarason.unit_matrices])
    high, A = sarason.shape[0], np.zeros((sarason.size, sum(sarason.shape), sum(sarason.shape)))
    A[:, :high, high:], A[:, high:, :high] = H, H.transpose(0, 2, 1)
    check_blocks(sarason.ball(), [A], rng)
    for groups in (1, entries.count):  # one V for all, and one for every entry
        blocks = np.linalg.qr(rng.standard_normal((groups, *(sarason.size // groups,) * 2)))[0]
        dense = scipy.linalg.block_diag(*blocks)
        check_blocks(sarason.ball(Axes(blocks)), [np.tensordot(dense.T, A, 1)], rng)
    x = rng.standard_normal(sarason.size)
    assert np.abs(sarason.matrix(x) - np.tensordot(x, sarason.unit_matrices, 1)).max() <= 1e-12 * np.linalg.norm(x)


def test_a_long_hankel_ball_against_its_definition():
    """n = 320, where products go by FFT: H by its entries, curvature by its definition on random rows and columns."""
    n, rng = 320, np.random.default_rng(0)
    ball, x, M = HankelMap(n), rng.standard_normal(320), rng.standard_normal((320, 320))
    a = np.arange(n)
    index = a[:, None] + a - (n - 1)
    H = np.where(index >= 0, x[np.maximum(index, 0)], 0.0)
    assert np.array_equal(ball.matrix(x), H)
    assert np.linalg.norm(ball.times(x, M) - H @ M) <= 1e-12 * np.linalg.norm(H @ M)
    traces = [np.trace(M[:, ::-1], offset=-j) for j in range(n)]
    assert np.abs(ball.adjoint(M) - traces).max() <= 1e-12 * np.abs(traces).max()
    P, Q, R, S = (definite(rng, n) for _ in range(4))
    curvature = ball.curvature([(P, Q), (R, S)])
    unit = np.eye(n)
    for i, j in rng.integers(0, n, (6, 2)):
        Hi, Hj = ball.matrix(unit[i]), ball.matrix(unit[j])
        expected = np.trace(Hi @ P @ Hj @ Q) + np.trace(Hi @ R @ Hj @ S)
        assert abs(curvature[i, j] - expected) <= 1e-11 * np.linalg.norm(P) * np.linalg.norm(Q)


@pytest.mark.parametrize("n", [0, 1, 5, 40, 200])
def test_longest_step_in_the_semidefinite_cone(n):
    """At most the true one, by less than 0.3 % (Lanczos from 160 on); unlimited into the cone."""
    for seed in range(4):
        rng = np.random.default_rng([n, seed])
        S, D = definite(rng, n) if n else np.zeros((0, 0)), rng.standard_normal((n, n))
        D = D + D.T
        root = np.linalg.cholesky(S)
        step = longest_step(root, D)
        if not n:
            assert step == np.inf
            continue
        half = np.linalg.solve(root, np.linalg.solve(root, D).T)
        least = np.linalg.eigvalsh(half)[0]
        true = -1 / least if least < 0 else np.inf
        if np.isinf(true):
            assert np.isinf(step)
        else:
            assert true * 0.997 <= step <= true * (1 + 1e-9)
        assert longest_step(root, S) == np.inf


# --- the discs --------------------------------------------------------------------------------------------------------


def random_pair(rng, count, real=0):
    e = rng.standard_normal(count) + 1j * rng.standard_normal(count)
    e[count - real :] = e[count - real :].real
    return np.abs(e) * (1 + rng.uniform(1e-4, 3, count)), e


@pytest.mark.parametrize("seed", seeds(2, 4))
def test_the_algebra_of_discs(seed):
    rng = np.random.default_rng(seed)
    cones, s, z = discs.Cones(40), random_pair(rng, 40, real=15), random_pair(rng, 40, real=15)
    assert np.allclose(triple(cones.product(s, z)), times(arrow(s), z), rtol=1e-13, atol=1e-13)
    back = cones.divide(s, z)
    assert np.allclose(times(arrow(s), back), triple(z), rtol=0, atol=1e-11 * np.abs(triple(z)).max())
    assert np.allclose(triple(cones.product(s, cones.inverse(s))), [1, 0, 0], atol=1e-10)
    assert np.allclose(cones.determinant(s), s[0] ** 2 - np.abs(s[1]) ** 2, rtol=1e-10)
    for pair in (cones.product(s, z), back, cones.inverse(s)):
        assert np.all(pair[1][25:].imag == 0)


@pytest.mark.parametrize("seed", seeds(2, 4))
def test_the_scaling_of_discs_against_three_by_three_matrices(seed):
    rng = np.random.default_rng([7, seed])
    s, z = random_pair(rng, 40, real=15), random_pair(rng, 40, real=15)
    scaling, W = discs.Scaling(discs.Cones(40), s, z), dense_scaling(s, z)
    d = rng.standard_normal(40), rng.standard_normal(40) + 1j * np.append(rng.standard_normal(25), np.zeros(15))
    size = np.linalg.cond(W).max()

    def close(pair, expected):
        error = np.linalg.norm(triple(pair) - expected, axis=1) / np.linalg.norm(expected, axis=1)
        assert error.max() <= 1e-13 * size**2
        assert np.all(pair[1][25:].imag == 0)

    close(scaling.apply(d), times(W, d))
    close(scaling.solve(d), times(np.linalg.inv(W), d))
    close(scaling.solve_twice(d), times(np.linalg.inv(W @ W), d))
    close(scaling.point, times(W, z))
    close(scaling.point, times(np.linalg.inv(W), s))
    a, b, c = scaling.curvature
    assert c is None
    block = np.linalg.inv(W @ W)[:, 1:, 1:]
    e = triple(d)[:, 1:]
    value = a * np.abs(d[1]) ** 2 + (b * d[1] ** 2).real
    assert np.allclose(value, np.einsum("ka,kab,kb->k", e, block, e), rtol=1e-13 * size**2)


def test_longest_step_in_the_discs_by_bisection():
    cones = discs.Cones(1)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        s = random_pair(rng, 1)
        d = rng.standard_normal(1), rng.standard_normal(1) + 1j * rng.standard_normal(1)
        if seed % 4 == 0:
            d = np.abs(d[1]) * 1.5, d[1]  # into the cone
        if seed % 4 == 1:
            d = -s[0] * (1 + 1e-13), -s[1]  # through the apex: the discriminant is zero but for rounding
        step = cones.longest_step(s, d)

        def inside(a, s=s, d=d):
            return s[0][0] + a * d[0][0] >= abs(s[1][0] + a * d[1][0])

        low, high = 0.0, 1e9
        if inside(high):
            assert step == np.inf
            continue
        while high - low > 1e-13 * high:
            middle = (low + high) / 2
            low, high = (middle, high) if inside(middle) else (low, middle)
        assert step == pytest.approx(low, rel=1e-6 if seed % 4 == 1 else 1e-9)
    nothing = np.zeros(0), np.zeros(0, complex)
    assert discs.Cones(0).longest_step(nothing, nothing) == np.inf


# --- the design -------------------------------------------------------------------------------------------------------


def random_columns(rng, lines, samples, length, parameters):
    angles = rng.uniform(0, np.pi, lines)
    angles[: lines // 4] = angles[lines // 4 : 2 * (lines // 4)]  # duplicates
    angles[-2:] = [0.0, np.pi][: angles[-2:].size]
    decay = rng.uniform(1.01, 1.2) ** -np.arange(length, dtype=float)
    columns = ShiftColumns(angles, rng.uniform(0.1, 10, lines), decay, rng.standard_normal((samples, length)))
    Q = rng.standard_normal((lines + samples, parameters)) + 0j
    Q[:lines] += 1j * rng.standard_normal((lines, parameters))
    return columns, Q


@pytest.mark.parametrize(
    ("lines", "samples", "tilted", "parameters"),
    every_one([(17, 5, False), (17, 5, True), (40, 0, False), (0, 9, False), (1, 0, False)], [0, 3]),
)
def test_generated_columns_and_their_non_uniform_transforms(lines, samples, tilted, parameters):
    for seed, length in enumerate((1, 2, 33, 100)):
        rng = np.random.default_rng([lines, parameters, seed])
        columns, Q = random_columns(rng, lines, samples, length, parameters)
        if tilted:
            kappa = np.sqrt(rng.uniform(size=lines)) * np.exp(2j * np.pi * rng.uniform(size=lines)) * 0.999
            columns = dataclasses.replace(columns, tilt=kappa)
        elif seed % 2:  # of a class with a weight
            phases = np.exp(2j * np.pi * rng.uniform(0, 1, lines))
            columns = dataclasses.replace(columns, gain=columns.gain * phases)
        E = np.zeros((lines + samples, length), complex)
        for k in range(lines):
            E[k] = columns.gain[k] * columns.decay * np.exp(-1j * columns.angles[k] * np.arange(length))
        E[lines:] = columns.real
        straight = np.linalg.norm(E)
        if tilted:
            E[:lines] += kappa[:, None] * E[:lines].conj()
        size = np.abs(E).max()
        assert columns.shape == E.shape
        assert np.abs(columns.dense() - E).max() <= 1e-13 * size
        v = rng.standard_normal(length + parameters)
        z = rng.standard_normal(lines + samples) + 1j * np.append(rng.standard_normal(lines), np.zeros(samples))
        a = rng.uniform(0.1, 2, lines + samples)
        b = a * rng.uniform(0, 1, lines + samples) * np.exp(2j * np.pi * rng.uniform(0, 1, lines + samples))
        b[lines:] = b[lines:].real
        b[:1], b[1:2] = 0, -np.abs(b[1:2])  # no phase, and that at the cut of its root
        G = np.hstack([E, Q])
        norm = np.linalg.norm(E)
        assert np.linalg.norm(columns @ v[:length] - E @ v[:length]) <= 1e-13 * norm * np.linalg.norm(v)
        assert np.linalg.norm(columns.adjoint(z) - (E.conj().T @ z).real) <= 1e-13 * norm * np.linalg.norm(z)
        assert norm * (1 - 1e-13) <= columns.norm <= (2 if tilted else 1 + 1e-13) * straight
        assert np.all(columns.spread(np.abs(z)) >= np.abs(E).T @ np.abs(z) * (1 - 1e-13))
        gram = (G.conj().T @ (a[:, None] * G) + G.T @ (b[:, None] * G)).real
        for design in (ShiftDesign(columns, Q), DenseDesign(G, lines)):
            out = design.apply(v)
            assert np.linalg.norm(out - G @ v) <= 1e-12 * np.linalg.norm(G) * np.linalg.norm(v)
            assert np.all(out[lines:].imag == 0)
            adjoint = (G.conj().T @ z).real
            assert np.linalg.norm(design.adjoint(z) - adjoint) <= 1e-12 * np.linalg.norm(G) * np.linalg.norm(z)
            found = design.gram(a, b)
            assert np.abs(found - gram).max() <= 1e-12 * np.trace(gram)
            assert np.abs(found - found.T).max() <= 1e-13 * np.trace(gram)
