"""The structured interior-point method: one Newton system, and whole paths against an independent solver."""

import dataclasses

import cvxpy as cp
import numpy as np
import pytest

from robustid.bases import Sections
from robustid.identification.certificate import certify_margin
from robustid.identification.formulation import formulate_in
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.solver import Limits, Supports, analytic_center, gain_path, margin_path, path, start
from robustid.identification.solver.cvxpy_backend import solve_conic
from robustid.identification.solver.interior_point import center
from robustid.identification.solver.newton import State
from robustid.identification.solver.paths import barrier_program
from support.cases import slow
from support.pairwise import every_one
from support.paths import arrow, dense_scaling, times, triple
from support.problems import CASES, random_problem

FORMS = (None, Sections.shift(12), Sections([0.6, 0.5 + 0.4j], 4))  # the exact form; 12 coefficients


# --- one Newton system ------------------------------------------------------------------------------------------------


def small_data(seed, case, form, coefficients=12):
    problem = random_problem(seed, case, coefficients, spread=0.5, noise=2.0)
    return formulate_in(problem.with_prior(decay_rate=1.25) if form else problem, form).data


def dense_arrays(data, axes=None):
    """H_j and G, by the definitions, of coordinates along the axes."""
    axes = np.eye(data.sarason.pair.order) if axes is None else axes.blocks[0]
    H = np.array([data.sarason.symmetry @ PairMap(data.sarason.pair).matrix(e) for e in axes.T])
    return H, np.hstack([data.rows.E.dense() @ axes, data.orthonormal[0]])


def feasible(data):
    """A point well inside the ball with its worst residual: the centre of a set with wide bounds."""
    *_, (point, _, _) = margin_path(data)
    point = analytic_center(data, 2 * data.margin(point.x, point.p) + 1)
    return point, data.margin(point.x, point.p)


def unknowns(data, point):
    y = point.x if data.axes is None else np.linalg.solve(data.axes.blocks[0], point.x)
    return np.concatenate([y, data.orthonormal_parameters(point.p)])


def programs(data):
    """Margin, gain and extreme of a functional: (program, v, t) strictly feasible."""
    point, worst = feasible(data)
    level, count, v = 1.2 * worst + 0.1, data.rows.y.size, unknowns(data, point)
    e = np.abs(data.rows.y - dense_arrays(data, data.axes)[1] @ v).max()
    yield barrier_program(data, Limits((1.0, 0.0), (np.zeros(count), np.ones(count))), 1.0), v, 2 * e + 0.1
    fixed, tail = data.rows.fixed, data.rows.tail
    yield barrier_program(data, Limits((0.0, 1.0), (level * fixed, level * (1 - fixed) - tail)), 1.0), v, 1.0
    w = np.random.default_rng(0).standard_normal(v.size)
    yield (
        dataclasses.replace(barrier_program(data, Limits((1.0, 0.0), (level - tail, np.zeros(count))), None), linear=w),
        v,
        0.0,
    )


@pytest.mark.parametrize(("case", "form"), every_one(CASES, FORMS))
def test_a_direction_solves_the_linearised_equations(case, form):
    """Affine and corrected, at the first iterates of three programs: every equation, assembled from stored matrices."""
    data = small_data(1, case, form)
    H, G = dense_arrays(data, data.axes)
    n, discs_count = H.shape[0], data.rows.discs
    for program, v, t in programs(data):
        for number, at in enumerate(path(program, start(program, v, t))):
            if number == 4:
                break
            state = State(program, at)
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
    basis = PairMap(data.sarason.pair).basis
    basis = basis if data.axes is None else np.tensordot(data.axes.blocks[0].T, basis, 1)
    X, G = np.tensordot(v[:n], basis, 1), dense_arrays(data, data.axes)[1]
    inverse = np.linalg.inv(np.eye(n) - X.T @ X)
    e = data.rows.y - G @ v
    e[data.rows.discs :] = e[data.rows.discs :].real
    out = -(G.conj().T @ (2 * e / ((level - data.rows.tail) ** 2 - np.abs(e) ** 2))).real
    out[:n] += 2 * np.einsum("ab,jba->j", inverse @ X.T, basis)
    return out


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize(("case", "form"), every_one(CASES, FORMS))
def test_the_centre_is_where_the_barrier_is_stationary(case, form, seeds):
    for seed in range(seeds):
        data = small_data(seed, case, form)
        point, worst = feasible(data)
        level, count = 1.05 * worst + 0.02, data.rows.y.size
        program = barrier_program(data, Limits((1.0, 0.0), (level - data.rows.tail, np.zeros(count))), None)
        v = unknowns(data, point)

        # Its Newton matrix is the Hessian of the barrier: central differences of the independent gradient.
        state = State(program, start(program, v, 0.0))
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
        state = State(program, start(program, at.v, 0.0))
        state.factorise()
        assert after @ np.linalg.solve(state.matrix, after) <= 1e-12
        found = analytic_center(data, level)
        n = found.x.size
        assert np.linalg.norm((unknowns(data, found) - at.v)[:n]) <= 1e-5


# --- whole paths ------------------------------------------------------------------------------------------------------


class Count:
    """Newton systems, by counting factorisations."""

    def __init__(self, monkeypatch):
        self.now, self.largest, factorise = 0, 0, State.factorise

        def counted(state):
            self.now += 1
            self.largest = max(self.largest, self.now)
            factorise(state)

        monkeypatch.setattr(State, "factorise", counted)

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
    data = formulate_in(problem.with_prior(decay_rate=1.25) if form else problem, form).data
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
        values = [step[:3] for step in Supports(data, inside, level, outer).path(direction)]
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


@pytest.mark.parametrize("seeds", [(), slow(range(3)), slow(range(100, 125))])
@pytest.mark.parametrize(("case", "form"), every_one(CASES, range(len(FORMS))))
def test_paths_end_at_the_optimum_of_an_independent_solver(case, form, seeds, monkeypatch):
    """Consistent and not: margin, gain, support functions of both sets to 1e-6; at most 60 Newton systems each."""
    count = Count(monkeypatch)
    for seed in seeds or [(CASES.index(case) + form) % 2]:
        size = 8 if seed < 100 else 6 + 2 * (seed % 100 % 6)
        off = check_problem(seed, case, resized(FORMS[form], size), size, count)
        assert max(off.values()) <= 1e-6, (seed, off)
    assert count.largest <= 60
