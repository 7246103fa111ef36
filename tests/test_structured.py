"""The interior-point method against dense formulas, an independent solver, and input that breaks others."""

import dataclasses

import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from problems import CASES, judge_margin, random_problem
from robustid.bases import Sections, input_normal_pair
from robustid.identification import margin as margin_module
from robustid.identification.forms import pose
from robustid.interpolation import SarasonMap, SectionMap, ShiftColumns, certify_margin
from robustid.solve import analytic_center, discs, gain_path, margin_path, solve_conic, support_path
from robustid.solve.ball import BlockHankelBall, DenseBall, HankelBall, TurnedBall, longest_step
from robustid.solve.design import DenseDesign, ShiftDesign
from robustid.solve.paths import _program
from robustid.solve.structured import Limits, _State, center, path, start

FORMS = (None, Sections.shift(12), Sections([0.6, 0.5 + 0.4j], 4))  # the exact form; 12 coefficients


def hankel_basis(n):
    """H_j, (n, n, n), straight from the definition."""
    a = np.arange(n)
    return (a[:, None] + a == a[:, None, None] + n - 1).astype(float)


def definite(rng, n, condition=1e3):
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return (Q * np.geomspace(1, condition, n)) @ Q.T


# --- the ball ---------------------------------------------------------------------------------------------------------


def check_ball(ball, H, rng, tolerance=1e-13):
    n = H.shape[0]
    x, Y = rng.standard_normal(n), definite(rng, n)
    M = rng.standard_normal((n, n))
    dense = np.tensordot(x, H, 1)
    assert np.abs(ball.matrix(x) - dense).max() <= tolerance * np.abs(dense).max()
    assert np.linalg.norm(ball.adjoint(Y) - np.einsum("jab,ba->j", H, Y)) <= tolerance * n * np.linalg.norm(Y)
    assert np.linalg.norm(ball.times(x, M) - dense @ M) <= tolerance * np.linalg.norm(x) * n * np.linalg.norm(M)
    pairs = [(definite(rng, n), definite(rng, n)) for _ in range(2)]
    curvature = sum(np.einsum("iab,jba->ij", H @ P, H @ Q, optimize=True) for P, Q in pairs)
    size = sum(np.linalg.norm(P) * np.linalg.norm(Q) for P, Q in pairs)
    assert np.abs(ball.curvature(pairs) - curvature).max() <= 10 * tolerance * n * size


@pytest.mark.parametrize("n", [1, 2, 7, 30])
def test_balls_against_stored_matrices(n):
    for seed in range(5):
        rng = np.random.default_rng([n, seed])
        check_ball(HankelBall(n), hankel_basis(n), rng)
        check_ball(DenseBall(hankel_basis(n)), hankel_basis(n), rng)
        angles = np.sort(rng.uniform(0.1, 3, n // 4))
        sarason = SarasonMap(input_normal_pair(angles, 0.9, n - 2 * angles.size))
        check_ball(DenseBall(sarason.symmetric_basis), sarason.symmetric_basis, rng)
        zeros = np.sqrt(rng.uniform(0, 1, 1 + seed)) * np.exp(1j * rng.uniform(0, np.pi, 1 + seed))
        zeros[seed // 2 :] = np.abs(zeros[seed // 2 :])  # real ones too
        sections = Sections(zeros, max(1, n // 4))
        basis = SarasonMap(sections.pair).symmetric_basis
        check_ball(BlockHankelBall(SectionMap(sections)), basis, rng)
        axes = np.linalg.qr(rng.standard_normal((sections.order, sections.order)))[0]
        turned = TurnedBall(BlockHankelBall(SectionMap(sections)), axes)
        check_ball(turned, np.tensordot(axes.T, basis, 1), rng)


def test_a_long_hankel_ball_against_its_definition():
    """n = 320, where products go by FFT: H by its entries, curvature by its definition on random rows and columns."""
    n, rng = 320, np.random.default_rng(0)
    ball, x, M = HankelBall(n), rng.standard_normal(320), rng.standard_normal((320, 320))
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


def triple(pair):
    """(N, 3) real vectors."""
    return np.stack([pair[0], pair[1].real, pair[1].imag], axis=1)


def arrow(pair):
    """(N, 3, 3): the matrix of the product from the left."""
    a, b = pair[0], np.stack([pair[1].real, pair[1].imag], axis=1)
    out = a[:, None, None] * np.eye(3)
    out[:, 0, 1:] = out[:, 1:, 0] = b
    return out


def times(matrices, pair):
    return np.einsum("kab,kb->ka", matrices, triple(pair))


def dense_scaling(s, z):
    """W by scaling s and z to determinant 1 and the geometric mean in the Jordan algebra: W = P(q)^(1/2), P(q) z = s.

    q = P(s^1/2) (P(s^1/2) z)^(-1/2), all by eigenvalues, and P(a) = 2 L(a)^2 - L(a^2): another way than the library's.
    """

    def power(v, exponent):
        norm = np.linalg.norm(v[1:])
        along = v[1:] / norm if norm else np.array([1.0, 0.0])
        high, low = (v[0] + norm) ** exponent, (v[0] - norm) ** exponent
        return np.concatenate([[(high + low) / 2], (high - low) / 2 * along])

    def left(v):
        out = v[0] * np.eye(3)
        out[0, 1:] = out[1:, 0] = v[1:]
        return out

    def quadratic(v):
        return 2 * left(v) @ left(v) - left(left(v) @ v)

    out = []
    for a, b in zip(triple(s), triple(z), strict=True):
        P = quadratic(power(a, 0.5))
        q = P @ power(P @ b, -0.5)
        out.append(quadratic(power(q, 0.5)))
    return np.array(out)


@pytest.mark.parametrize("seed", range(4))
def test_the_algebra_of_discs(seed):
    rng = np.random.default_rng(seed)
    s, z = random_pair(rng, 40, real=15), random_pair(rng, 40, real=15)
    assert np.allclose(triple(discs.product(s, z)), times(arrow(s), z), rtol=1e-13, atol=1e-13)
    back = discs.divide(s, z)
    assert np.allclose(times(arrow(s), back), triple(z), rtol=0, atol=1e-11 * np.abs(triple(z)).max())
    assert np.allclose(triple(discs.product(s, discs.inverse(s))), [1, 0, 0], atol=1e-10)
    assert np.allclose(discs.determinant(s), s[0] ** 2 - np.abs(s[1]) ** 2, rtol=1e-10)
    for pair in (discs.product(s, z), back, discs.inverse(s)):
        assert np.all(pair[1][25:].imag == 0)


@pytest.mark.parametrize("seed", range(4))
def test_the_scaling_of_discs_against_three_by_three_matrices(seed):
    rng = np.random.default_rng([7, seed])
    s, z = random_pair(rng, 40, real=15), random_pair(rng, 40, real=15)
    scaling, W = discs.Scaling(s, z), dense_scaling(s, z)
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
    a, b = scaling.curvature
    block = np.linalg.inv(W @ W)[:, 1:, 1:]
    e = triple(d)[:, 1:]
    value = a * np.abs(d[1]) ** 2 + (b * d[1] ** 2).real
    assert np.allclose(value, np.einsum("ka,kab,kb->k", e, block, e), rtol=1e-13 * size**2)


def test_longest_step_in_the_discs_by_bisection():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        s = random_pair(rng, 1)
        d = rng.standard_normal(1), rng.standard_normal(1) + 1j * rng.standard_normal(1)
        if seed % 4 == 0:
            d = np.abs(d[1]) * 1.5, d[1]  # into the cone
        if seed % 4 == 1:
            d = -s[0] * (1 + 1e-13), -s[1]  # through the apex: the discriminant is zero but for rounding
        step = discs.longest_step(s, d)

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
    assert discs.longest_step((np.zeros(0), np.zeros(0, complex)), (np.zeros(0), np.zeros(0, complex))) == np.inf


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


@pytest.mark.parametrize(("lines", "samples"), [(17, 5), (40, 0), (0, 9), (1, 0)])
@pytest.mark.parametrize("parameters", [0, 3])
def test_generated_columns_and_their_non_uniform_transforms(lines, samples, parameters):
    for seed, length in enumerate((1, 2, 33, 100)):
        rng = np.random.default_rng([lines, parameters, seed])
        columns, Q = random_columns(rng, lines, samples, length, parameters)
        E = np.zeros((lines + samples, length), complex)
        for k in range(lines):
            E[k] = columns.gain[k] * columns.decay * np.exp(-1j * columns.angles[k] * np.arange(length))
        E[lines:] = columns.real
        size = np.abs(E).max()
        assert columns.shape == E.shape
        assert np.abs(columns.dense() - E).max() <= 1e-13 * size
        v = rng.standard_normal(length + parameters)
        z = rng.standard_normal(lines + samples) + 1j * np.append(rng.standard_normal(lines), np.zeros(samples))
        a = rng.uniform(0.1, 2, lines + samples)
        b = a * rng.uniform(0, 1, lines + samples) * np.exp(2j * np.pi * rng.uniform(0, 1, lines + samples))
        b[lines:] = b[lines:].real
        G = np.hstack([E, Q])
        assert np.linalg.norm(columns @ v[:length] - E @ v[:length]) <= 1e-13 * np.linalg.norm(E) * np.linalg.norm(v)
        assert np.linalg.norm(columns.adjoint(z) - (E.conj().T @ z).real) <= 1e-13 * np.linalg.norm(E) * np.linalg.norm(
            z
        )
        assert columns.norm == pytest.approx(np.linalg.norm(E), rel=1e-13)
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


# --- one Newton system ------------------------------------------------------------------------------------------------


def small_data(seed, case, form, coefficients=12):
    problem = random_problem(seed, case, coefficients, spread=0.5, noise=2.0)
    return pose(problem.with_prior(decay_rate=1.25) if form else problem, form).data


def dense_arrays(data, axes=None):
    """H_j and G, by the definitions, of coordinates along the axes."""
    axes = np.eye(data.sarason.pair.order) if axes is None else axes
    H = np.array([data.sarason.symmetry @ SarasonMap(data.sarason.pair).matrix(e) for e in axes.T])
    return H, np.hstack([data.rows.E.dense() @ axes, data.orthonormal[0]])


def feasible(data):
    """A point well inside the ball with its worst residual: the centre of a set with wide bounds."""
    *_, (point, _, _) = margin_path(data)
    point = analytic_center(data, 2 * data.margin(point.x, point.p) + 1)
    return point, data.margin(point.x, point.p)


def unknowns(data, point):
    y = point.x if data.axes is None else np.linalg.solve(data.axes, point.x)
    return np.concatenate([y, data.orthonormal_parameters(point.p)])


def programs(data):
    """Margin, gain and extreme of a functional: (program, v, t) strictly feasible."""
    point, worst = feasible(data)
    level, count, v = 1.2 * worst + 0.1, data.rows.y.size, unknowns(data, point)
    e = np.abs(data.rows.y - dense_arrays(data, data.axes)[1] @ v).max()
    yield _program(data, Limits((1.0, 0.0), (np.zeros(count), np.ones(count))), 1.0), v, 2 * e + 0.1
    fixed, tail = data.rows.fixed, data.rows.tail
    yield _program(data, Limits((0.0, 1.0), (level * fixed, level * (1 - fixed) - tail)), 1.0), v, 1.0
    w = np.random.default_rng(0).standard_normal(v.size)
    yield _program(data, Limits((1.0, 0.0), (level - tail, np.zeros(count))), None, w), v, 0.0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_a_direction_solves_the_linearised_equations(case, form):
    """Affine and corrected, at the first iterates of three programs: every equation, assembled from stored matrices."""
    data = small_data(1, case, form)
    H, G = dense_arrays(data, data.axes)
    n, discs_count = H.shape[0], data.rows.discs
    for program, v, t in programs(data):
        for number, at in enumerate(path(program, start(program, v, t))):
            if number == 4:
                break
            state = _State(program, at)
            state.factorise()
            affine = state.affine()
            mu = 0.3 * state.mu
            ball, reach = program.limits.ball, program.limits.reach
            Hx = np.tensordot(at.v[:n], H, 1)
            S = [(ball[0] + ball[1] * at.t) * np.eye(n) - sign * Hx for sign in (1, -1)]
            s = reach[0] + reach[1] * at.t, program.y - G @ at.v
            s[1][discs_count:] = s[1][discs_count:].real
            W = dense_scaling(s, at.z)
            point = times(W, at.z)
            assert at.gap == pytest.approx(
                sum(np.trace(a @ b) for a, b in zip(S, at.Z, strict=True)) + np.sum(triple(s) * triple(at.z)), rel=1e-8
            )
            for d, corrected in ((affine, False), (state.centring(mu, affine), True)):
                # The slacks move with the unknowns.
                dS = [ball[1] * d.dt * np.eye(n) - sign * np.tensordot(d.dv[:n], H, 1) for sign in (1, -1)]
                for mine, theirs in zip(dS, d.dS, strict=True):
                    assert np.abs(mine - theirs).max() <= 1e-11 * (np.linalg.norm(d.dv) + abs(d.dt))
                ds = reach[1] * d.dt, -(G @ d.dv)
                ds[1][discs_count:] = ds[1][discs_count:].real
                assert np.abs(triple(ds) - triple(d.ds)).max() <= 1e-11 * (1 + np.abs(triple(ds)).max())
                # Dual equalities, met by a full step.
                Z = [a + b for a, b in zip(at.Z, d.dZ, strict=True)]
                z = triple(at.z) + triple(d.dz)
                flat = z[:, 1] + 1j * z[:, 2]
                linear = program.linear + (G.conj().T @ flat).real
                linear[:n] += np.einsum("jab,ba->j", H, Z[0] - Z[1])
                size = sum(np.linalg.norm(block) for block in Z) + np.abs(z).sum() * (1 + np.abs(G).max())
                assert np.linalg.norm(linear) <= 1e-9 * size
                if program.cost is not None:
                    cost = program.cost - ball[1] * (np.trace(Z[0]) + np.trace(Z[1])) - reach[1] @ z[:, 0]
                    assert abs(cost) <= 1e-9 * size
                # Complementarity of the ball.
                for k in (0, 1):
                    inverse = np.linalg.inv(S[k])
                    half = at.Z[k] @ dS[k] @ inverse
                    target = (mu * inverse if corrected else 0) - at.Z[k]
                    if corrected:
                        second = affine.dZ[k] @ affine.dS[k] @ inverse
                        target = target - (second + second.T) / 2
                    wrong = d.dZ[k] + (half + half.T) / 2 - target
                    assert np.linalg.norm(wrong) <= 1e-9 * (np.linalg.norm(half) + np.linalg.norm(target))
                # Complementarity of the samples, scaled.
                moved = times(np.linalg.inv(W), d.ds) + times(W, d.dz)
                pair = point[:, 0], point[:, 1] + 1j * point[:, 2]
                aim = -np.einsum("kab,kb->ka", arrow(pair), point)
                if corrected:
                    aim[:, 0] += mu
                    inner = times(np.linalg.inv(W), affine.ds)
                    first = inner[:, 0], inner[:, 1] + 1j * inner[:, 2]
                    aim -= np.einsum("kab,kb->ka", arrow(first), times(W, affine.dz))
                left = np.einsum("kab,kb->ka", arrow(pair), moved)
                size = np.linalg.norm(point, axis=1) * np.linalg.norm(moved, axis=1) + np.linalg.norm(aim, axis=1)
                assert (np.linalg.norm(left - aim, axis=1) / size).max() <= 1e-7
                assert np.all(d.dz[1][discs_count:].imag == 0)
        assert number == 4


def barrier_gradient(data, level, v):
    """Of -log det(I - X'X) - sum log(reach^2 - |e|^2), X and not H, each derivative by itself."""
    n = data.sarason.pair.order
    basis = SarasonMap(data.sarason.pair).basis
    basis = basis if data.axes is None else np.tensordot(data.axes.T, basis, 1)
    X, G = np.tensordot(v[:n], basis, 1), dense_arrays(data, data.axes)[1]
    inverse = np.linalg.inv(np.eye(n) - X.T @ X)
    e = data.rows.y - G @ v
    e[data.rows.discs :] = e[data.rows.discs :].real
    out = -(G.conj().T @ (2 * e / ((level - data.rows.tail) ** 2 - np.abs(e) ** 2))).real
    out[:n] += 2 * np.einsum("ab,jba->j", inverse @ X.T, basis)
    return out


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_the_centre_is_where_the_barrier_is_stationary(case, form):
    for seed in range(3):
        data = small_data(seed, case, form)
        point, worst = feasible(data)
        level, count = 1.05 * worst + 0.02, data.rows.y.size
        program = _program(data, Limits((1.0, 0.0), (level - data.rows.tail, np.zeros(count))), None)
        v = unknowns(data, point)

        # Its Newton matrix is the Hessian of the barrier: central differences of the independent gradient.
        state = _State(program, start(program, v, 0.0))
        state.factorise()
        scale = 1 / np.sqrt(np.diag(state.matrix))
        numeric = np.empty((v.size, v.size))
        for j in range(v.size):
            step = 1e-5 * scale[j] * np.eye(v.size)[j]
            numeric[j] = (barrier_gradient(data, level, v + step) - barrier_gradient(data, level, v - step)) / 2e-5
            numeric[j] *= scale
        exact = state.matrix * scale * scale[:, None]
        assert np.abs(numeric - exact).max() <= 1e-7
        # The documented barrier's gradient, and zero at the centre: in the norm of the Hessian, before and after.
        before = barrier_gradient(data, level, v)
        assert np.linalg.norm(scale * (state.residual - before)) <= 1e-9 * np.linalg.norm(scale * before)
        at = center(program, v)
        after = barrier_gradient(data, level, at.v)
        state = _State(program, start(program, at.v, 0.0))
        state.factorise()
        assert after @ np.linalg.solve(state.matrix, after) <= 1e-12
        found = analytic_center(data, level)
        n = found.x.size
        assert np.linalg.norm((unknowns(data, found) - at.v)[:n]) <= 1e-5


# --- whole paths ------------------------------------------------------------------------------------------------------


class Count:
    """Newton systems, by counting factorisations."""

    def __init__(self, monkeypatch):
        self.now, self.largest, factorise = 0, 0, _State.factorise

        def counted(state):
            self.now += 1
            self.largest = max(self.largest, self.now)
            factorise(state)

        monkeypatch.setattr(_State, "factorise", counted)

    def take(self):
        number, self.now = self.now, 0
        return number


def conic_support(data, level, direction, outer):
    """max <direction, (x, p)> by cvxpy, independently of the library's own conic interface."""
    rows, n = data.rows, data.sarason.pair.order
    reach = level + rows.tail if outer else level - rows.tail
    x, p = cp.Variable(n), cp.Variable(rows.P.shape[1])
    H = dense_arrays(data)[0]
    X = sum(x[j] * H[j] for j in range(n))
    E = rows.E.dense()
    e_real = rows.y.real - E.real @ x - (rows.P.real @ p if p.size else 0)
    e_imag = rows.y.imag - E.imag @ x - (rows.P.imag @ p if p.size else 0)
    limits = [np.eye(n) - X >> 0, np.eye(n) + X >> 0, cp.norm(cp.vstack([e_real, e_imag]), 2, axis=0) <= reach]
    value = direction[0] @ x + (direction[1] @ p if p.size else 0)
    program = cp.Problem(cp.Maximize(value), limits)
    tight = {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10, "accept_unknown": True}
    try:
        program.solve(solver="CLARABEL", equilibrate_enable=False, **tight)
    except cp.SolverError:
        program.solve(solver="CLARABEL", **tight)
    return float(program.value)


def check_margin_path(data):
    """Every iterate inside, every gap valid; the optimum."""
    n, H = data.sarason.pair.order, dense_arrays(data)[0]
    G, count = np.hstack([data.rows.E.dense(), data.rows.P]), data.rows.discs
    points = list(margin_path(data))
    best = min(points, key=lambda point: point[2])
    for candidate, margin, gap in points:
        assert np.abs(np.linalg.eigvalsh(np.tensordot(candidate.x, H, 1))).max() < 1 + 1e-13  # rounding of eigenvalues
        e = data.rows.y - G @ np.concatenate([candidate.x, candidate.p])
        e[count:] = e[count:].real
        assert np.abs(e).max() < margin * (1 + 1e-12) + 1e-14 * np.abs(data.rows.y).max()
        assert margin - gap <= best[1] * (1 + 1e-9)
        # Weak duality from the multipliers alone: <l, y> - ||Y||_* over sum |l|, where the equalities hold.
        weights, Y = candidate.samples, candidate.ball
        value = (weights.conj() @ data.rows.y).real - np.linalg.norm(Y, "nuc")
        value -= np.linalg.norm((G[:, :n].conj().T @ weights).real - np.einsum("jab,ab->j", data.sarason.basis, Y))
        leak = np.linalg.norm((data.orthonormal[0].conj().T @ weights).real)
        value -= leak * 2 * (np.linalg.norm(data.rows.y) + np.linalg.norm(G[:, :n]) + best[1] * data.rows.y.size)
        assert value / np.abs(weights).sum() <= best[1] * (1 + 1e-9)
    assert best[2] <= 1e-6 * max(1, best[1])
    return best


def resized(form, size):
    """A form with about so many coefficients."""
    return form and dataclasses.replace(form, repeats=-(-size // form.degree))


def check_problem(seed, case, form, coefficients, count):
    """One problem, all programs against Clarabel; returns the largest relative differences."""
    spread, noise = ((1.0, 0.9), (0.2, 4.0))[seed % 2]
    problem = random_problem(seed, case, coefficients, spread=spread, noise=noise)
    data = pose(problem.with_prior(decay_rate=1.25) if form else problem, form).data
    candidate, margin, _ = check_margin_path(data)
    count.take()
    conic = solve_conic(data, "margin", solver="cvxpy")
    n = data.sarason.pair.order
    theirs = float(np.abs(data.rows.y - data.rows.E @ conic.x - data.rows.P @ conic.p).max())
    if data.sarason.norm(conic.x) > 1 + 1e-8:  # it has left the ball: the proof of the lower end judges
        rows = dataclasses.replace(data.rows, tail=np.zeros(data.rows.y.size))
        walk = [c for c, _, _ in margin_path(data)]
        theirs = max(certify_margin(c.samples, c.ball, margin, rows, data.sarason).value for c in walk)
        count.take()
    off = {"margin": abs(margin - theirs) / max(1, theirs)}
    level = 1.1 * data.margin(candidate.x, candidate.p) + 0.1
    inside = analytic_center(data, level)
    count.take()
    *_, (point, gain, gap) = gain_path(data, inside, level)
    count.take()
    conic = solve_conic(data, "gain", solver="cvxpy", factor=level)
    off["gain"] = abs(gain - data.sarason.norm(conic.x)) / max(gain, 1e-2)
    assert data.sarason.norm(point.x) <= gain * (1 + 1e-9)
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(n), rng.standard_normal(data.rows.P.shape[1])
    for outer in (False, True):
        values = list(support_path(data, inside, level, direction, outer))
        count.take()
        theirs = conic_support(data, level, direction, outer)
        name = "outer" if outer else "inner"
        off[name] = abs(values[-1][1] - theirs) / max(1, abs(theirs))
        reach = level + data.rows.tail if outer else level - data.rows.tail
        for found, value, gap in values:
            assert data.sarason.norm(found.x) < 1 + 1e-13  # rounding of the norm
            e = data.rows.ratio(found.x, found.p) - data.rows.tail
            assert np.all(e < reach * (1 + 1e-12) + 1e-14 * np.abs(data.rows.y).max())
            assert value + gap >= values[-1][1] - 1e-9 * max(1, abs(theirs))
    return off


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_paths_end_at_the_optimum_of_an_independent_solver(case, form, monkeypatch):
    """36 problems, consistent and not: margin, gain, support functions of both sets to 1e-6; at most 60 systems each."""
    count = Count(monkeypatch)
    for seed in range(3):
        off = check_problem(seed, case, resized(form, 8), 8, count)
        assert max(off.values()) <= 1e-6, off
    assert count.largest <= 60


@pytest.mark.slow
def test_paths_on_two_hundred_problems(monkeypatch, capsys):
    count, worst, failures = Count(monkeypatch), {}, []
    for seed in range(25):
        for case in CASES:
            for form in FORMS:
                size = 6 + 2 * (seed % 6)
                off = check_problem(100 + seed, case, resized(form, size), size, count)
                worst = {name: max(worst.get(name, 0.0), value) for name, value in off.items()}
                if max(off.values()) > 1e-6:
                    failures.append((100 + seed, case, form, size, off))
    with capsys.disabled():
        print("\nlargest differences", worst, "most Newton systems", count.largest)
    assert not failures
    assert count.largest <= 60


# --- decisions on the border, and degenerate input --------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_barely_feasible_problems_are_decided(case):
    """K from the gain path such that the margin is 1 + d: the margin path returns it, and the proof decides."""
    decided = 0
    for seed in range(3):
        problem = random_problem(40 + seed, case, 10, spread=0.5, noise=1.5)
        K = problem.prior.gain_bound
        for d in (-1e-6, 1e-6):
            data = pose(problem).data
            inside = analytic_center(data, 1 + d) if data.rows.y.size and lowest(data) < 1 else None
            if inside is None:
                continue
            *_, (_, gain, _) = gain_path(data, inside, 1 + d)
            if gain < 1e-3:
                continue  # the parametric part fits alone
            barely = problem.with_prior(gain_bound=K * gain)
            assert lowest(pose(barely).data) == pytest.approx(1 + d, abs=1e-8)
            result = rid.identify(barely, solver="structured", accuracy=1e-6)
            assert result.margin_lower <= 1 + d + 1e-8
            assert result.margin >= 1 + d - 1e-8
            assert result.status is (rid.Status.CONSISTENT if d < 0 else rid.Status.INCONSISTENT)
            assert result.verification.passed, result.summary()
            decided += 1
    assert decided >= 2


def lowest(data):
    return min(margin_path(data), key=lambda point: point[2])[1]


def two_lines(values, bound, K=3.0, rho=1.1, omega=(10.0, 50.0)):
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=0.01)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=K, decay_rate=rho))


def identified(problem, **options):
    result = rid.identify(problem, solver="structured", **options)
    assert result.verification.passed, result.summary()
    return result


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_equal_lines_that_contradict_each_other(form):
    """Two discs around one value: the margin is half the distance, whatever else is measured."""
    first = rid.FrequencyResponse([10.0, 50.0], [1.0, 0.8 - 0.5j], bound=0.1, dt=0.01)
    again = rid.FrequencyResponse([50.0] * 3, [0.8 - 0.5j, 1.0 - 0.5j, 0.9 - 0.2j], bound=0.1, dt=0.01)
    prior = rid.Prior(gain_bound=3, decay_rate=1.1)
    result = identified(rid.MixedProblem(frequency=[first, again], prior=prior), form=form)
    # The smallest disc around (0.8, -0.5), (1.0, -0.5), (0.9, -0.2): the circle through the three.
    radius = (0.1**2 + 0.3**2) / (2 * 0.3)
    assert result.margin == pytest.approx(radius / 0.1, abs=2e-4)
    assert result.margin_lower <= radius / 0.1 + 1e-9
    assert result.margin >= radius / 0.1 - 1e-9


@pytest.mark.parametrize("case", CASES)
def test_every_bound_active(case):
    """Data at distance exactly 1 of a member, in every sample: consistent, and never proved to be below what it is."""
    for seed in range(3):
        problem = random_problem(seed, case, 12, noise=0.0)
        rng = np.random.default_rng(seed)
        frequency = [
            rid.FrequencyResponse(
                f.omega, f.values[:, 0, 0] + f.bound[:, 0, 0] * np.exp(1j * rng.uniform(0, 6.3, f.omega.size)),
                bound=f.bound[:, 0, 0], dt=f.dt,
            )
            for f in problem.frequency
        ]  # fmt: skip
        time = [
            rid.TimeRecord(
                t.u[:, 0], t.y[:, 0] + t.bound[:, 0] * rng.choice([-1, 1], t.y.size), dt=t.dt, bound=t.bound[:, 0]
            )
            for t in problem.time
        ]
        active = rid.MixedProblem(frequency=frequency, time=time, prior=problem.prior, parametric=problem.parametric)
        result = identified(active)
        assert result.margin_lower <= 1 + 1e-9
        assert result.consistent
        doubled = rid.MixedProblem(
            frequency=[*frequency, *[rid.FrequencyResponse(f.omega, 2 * g.values - f.values, bound=f.bound, dt=f.dt)
                                     for f, g in zip(frequency, problem.frequency, strict=True)]],
            time=[*time, *[rid.TimeRecord(t.u, 2 * g.y - t.y, dt=t.dt, bound=t.bound)
                           for t, g in zip(time, problem.time, strict=True)]],
            prior=problem.prior, parametric=problem.parametric,
        )  # fmt: skip
        both = identified(doubled)  # the two opposite ends of every bound: the member is all that is left
        assert both.margin == pytest.approx(1, abs=2e-6)
        assert both.margin_lower == pytest.approx(1, abs=2e-6)


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_gain_barely_enough_for_exact_values(form):
    """One line at omega = 0: the margin is (value - K)/bound, here 1e-7 from 1 on either side."""
    for d in (-1e-7, 1e-7):
        problem = two_lines([2.0], 0.1, K=2.0 - 0.1 * (1 + d), omega=[0.0])
        result = identified(problem, form=form, accuracy=1e-8 if form == "orthonormal" else 1e-4)
        assert result.margin_lower <= 1 + d <= result.margin
        if form == "orthonormal":
            assert result.consistent == (d < 0)


@pytest.mark.parametrize("rho", [1 + 1e-3, 1 + 1e-5])
def test_a_decay_rate_near_one(rho):
    """Nodes next to the circle: every value inside the gain bound is possible, and no more than that helps."""
    rng = np.random.default_rng(0)
    omega = np.linspace(5, 290, 5)
    values = 0.9 * np.exp(1j * rng.uniform(0, 6.3, 5))
    assert identified(two_lines(values, 0.01, K=1.0, rho=rho, omega=omega), form="orthonormal").consistent
    problem = two_lines(values, 0.01, K=0.5, rho=rho, omega=omega)
    tight, judge = identified(problem, form="orthonormal"), judge_margin(problem)
    assert tight.margin == pytest.approx(judge, rel=1e-6)
    assert tight.margin >= (0.9 - 0.5) / 0.01


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_badly_scaled_bounds_and_units(case, scale):
    """Data, bounds and K in other units have the same margin; bounds alone scale it."""
    problem = random_problem(3, case, 12, spread=0.2, noise=4.0)
    base = identified(problem)

    def changed(data, bound):
        return rid.MixedProblem(
            frequency=[rid.FrequencyResponse(f.omega, f.values * data, bound=f.bound * bound, dt=f.dt)
                       for f in problem.frequency],
            time=[rid.TimeRecord(t.u, t.y * data, dt=t.dt, bound=t.bound * bound) for t in problem.time],
            prior=rid.Prior(gain_bound=problem.prior.gain_bound * data, decay_rate=problem.prior.decay_rate),
            parametric=problem.parametric,
        )  # fmt: skip

    assert identified(changed(scale, scale)).margin == pytest.approx(base.margin, rel=1e-6, abs=2e-6)
    other = identified(changed(1.0, scale))
    size = max(1.0, base.margin / scale)
    assert other.margin_lower - 1e-4 * size <= base.margin / scale
    assert base.margin_lower / scale <= other.margin + 1e-4 * size


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_one_line_one_sample_zero_data(form):
    one = identified(two_lines([2.0j], 0.1, omega=[30.0]), form=form)
    assert one.consistent
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    sample = rid.TimeRecord([2.0], [3.0], dt=0.1, bound=0.5)  # |g_0| <= K: |3 - 2 g_0| >= 1
    result = identified(rid.MixedProblem(time=sample, prior=prior), form=form)
    assert result.margin == pytest.approx(2.0, abs=2e-4)
    for bound in (0.5, 500.0):
        silent = rid.TimeRecord(np.zeros(5), np.zeros(5), dt=0.1, bound=bound)
        assert identified(rid.MixedProblem(time=silent, prior=prior), form=form).margin == pytest.approx(0, abs=1e-4)
    wrong = rid.TimeRecord(np.zeros(5), [0.0, 1.0, 0, 0, -0.25], dt=0.1, bound=0.5)  # nothing can explain it
    assert identified(rid.MixedProblem(time=wrong, prior=prior), form=form).margin == pytest.approx(2.0, abs=2e-4)
    zero = identified(two_lines([0.0, 0.0], 0.1), form=form)
    assert zero.margin == pytest.approx(0, abs=1e-4)
    assert zero.consistent


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_an_interrupt_leaves_the_best_verified_point(form, monkeypatch):
    problem = random_problem(2, "mixed", 12, spread=0.2, noise=4.0).with_prior(decay_rate=1.3)
    whole = identified(problem, form=form, accuracy=1e-3)
    walk, stopped = margin_module.margin_path, 0
    for last in range(6):

        def interrupted(data, *rest, last=last):
            for number, point in enumerate(walk(data, *rest)):
                if number == last:
                    raise KeyboardInterrupt
                yield point

        monkeypatch.setattr(margin_module, "margin_path", interrupted)
        if not last:
            with pytest.raises(KeyboardInterrupt):
                rid.identify(problem, solver="structured", form=form, accuracy=1e-3)
            continue
        result = rid.identify(problem, solver="structured", form=form, accuracy=1e-3)
        monkeypatch.setattr(margin_module, "margin_path", walk)
        assert result.margin_lower <= whole.margin
        assert result.margin >= whole.margin_lower
        failed = [check.name for check in result.verification.checks if not check.holds]
        assert failed in ([], ["width of the proven interval of the margin"])
        if result.margin - result.margin_lower > 1e-3 * max(1, result.margin):
            stopped += 1
            assert failed
            assert result.status in (rid.Status.FAILED, rid.Status.CONSISTENT, rid.Status.INCONSISTENT)
    assert stopped >= 3


def test_an_interrupt_during_the_centring_keeps_the_proof(monkeypatch):
    from robustid.identification import consistency

    def interrupted(*arguments):
        raise KeyboardInterrupt

    problem = random_problem(1, "mixed", 28)
    whole = rid.identify(problem, solver="structured")
    monkeypatch.setattr(consistency, "analytic_center", interrupted)
    result = rid.identify(problem, solver="structured")
    assert result.claim.margin == whole.margin
    assert result.verification.passed
    assert "interrupted" in result.notes[0]
