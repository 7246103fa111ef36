"""Intervals of the parametric coefficients: against closed forms, an independent solver, and their certificates."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.identification.certificate import certify_margin, evaluate_certificate
from robustid.identification.formulation import ExactFormulation
from robustid.identification.solver import Supports, analytic_center, gain_path, margin_path
from robustid.identification.solver.cvxpy_backend import solve_conic
from support.cases import slow
from support.intervals import FREE, KINDS, bounded, inside, intervals, tight
from support.matrix_plants import judge_margin
from support.pairwise import every_one
from support.problems import identified, random_problem

# --- known answers ----------------------------------------------------------------------------------------------------


def one_constant(value, low, high, dt=0.01):
    """y = p + G at omega = 0, |G| <= 1: the margin is the distance of y from [low - 1, high + 1] over the bound."""
    frf = rid.FrequencyResponse([0.0, 50.0], [value, value], bound=0.1, dt=dt)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    one = control.ss([], [], [], 1.0, dt)
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=one, parameter_bounds=[(low, high)])


@pytest.mark.parametrize(
    ("options", "low", "high"),
    every_one(
        [{"solver": "cvxpy"}, {"solver": "structured"}, {"form": "taylor"}, {"form": "sections"}],
        [(0.0, 1.0), (1.0, 1.0), (-5.0, 1.0), (-1e7, 1.0), (1 - 1e-7, 1.0)],
    ),
)
def test_a_constant_out_of_reach(options, low, high):
    result = identified(one_constant(3.0, low, high), **options)
    assert result.status is rid.Status.INCONSISTENT
    assert result.margin_lower <= 10 + 1e-9
    assert result.margin == pytest.approx(10, abs=1e-3)
    assert result.margin >= 10 - 1e-9
    assert result.margin - result.margin_lower <= 1e-3
    assert result.parameters == pytest.approx([1.0], abs=2e-6)
    assert inside(result)
    ends = [end for _, end in result.active_intervals]
    assert (1.0 in ends) == (low < high) or 0 < high - low < 1e-6  # narrower than what the samples tell apart


@pytest.mark.parametrize(
    "options", [{"solver": "cvxpy"}, {"solver": "structured"}, {"form": "taylor"}, {"form": "sections"}]
)
def test_a_constant_below_its_interval_and_one_inside(options):
    below = rid.identify(one_constant(-4.0, -1.0, 2.0), **options)  # -4 is 2 below [-2, 3]
    assert below.margin == pytest.approx(20, abs=2e-3)
    assert below.active_intervals[0][1] == -1.0
    inside_it = rid.identify(one_constant(2.5, 0.0, 2.0), **options)
    assert inside_it.consistent
    assert inside_it.active_intervals == ()


def test_the_extremes_of_a_coefficient_are_the_ends_of_its_interval():
    """Where the samples say little, max and min of a coefficient over the set are the ends that were stated."""
    for kind in ("outside", "one side", "fixed", "wide"):
        problem = random_problem(1, "parametric", 10, spread=0.3)
        bounds = np.array(intervals(kind, np.array([0.3, -0.4]), np.random.default_rng(0)))
        loose = [f.with_bound(1e9) for f in problem.frequency]
        data = ExactFormulation(dataclasses.replace(problem, frequency=loose, time=None, parameter_bounds=bounds)).data
        center = analytic_center(data, 1.0)
        for i, k in np.argwhere(np.isfinite(bounds)):
            sign = 2 * k - 1
            along = sign * np.eye(2)[i] / data.rows.column_scale  # of the coefficient in its own unit
            values = [
                step.value for step in Supports(data, center, 1.0).path((np.zeros(data.sarason.pair.order), along))
            ]
            found = values[-1] if values else float(along @ center.p)
            assert sign * found == pytest.approx(bounds[i, k], rel=1e-7, abs=1e-7)


# --- an independent solver --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seeds", [1, slow(20)])
@pytest.mark.parametrize("kind", [k if k in KINDS[1:4:2] else slow(k) for k in KINDS])
def test_margin_against_the_paper_s_theorem(kind, seeds):
    """Clarabel on the printed inequality with the intervals written out; Taylor forms enclose the same number."""
    active = positive = 0
    for seed in range(seeds):
        problem = bounded(tight(seed), kind, seed)
        judge = judge_margin(problem)
        result = identified(problem, solver="structured")
        size = max(1.0, judge)
        assert result.margin == pytest.approx(judge, abs=2e-6 * size)
        assert result.margin_lower <= judge + 1e-6 * size
        assert result.margin - result.margin_lower <= 2e-5 * size
        assert inside(result)
        active += bool(result.active_intervals)
        positive += judge > 1e-3
        if seed % 4 == 0:
            conic = rid.identify(problem, solver="cvxpy")
            assert conic.margin == pytest.approx(judge, abs=1e-5 * size)
            assert conic.margin_lower == pytest.approx(judge, abs=1e-5 * size)
            taylor = identified(problem, form="taylor")
            assert taylor.margin_lower - 1e-6 * size <= judge <= taylor.margin + 1e-6 * size
            assert taylor.margin - taylor.margin_lower <= 1e-4 * size
    assert positive >= 3 * seeds // 4
    assert active >= {"outside": 3, "one side": 1, "far": 1}.get(kind, 0) * seeds // 4


@pytest.mark.parametrize("seeds", [1, slow(4)])
@pytest.mark.parametrize("kind", [k if k in KINDS[::2] else slow(k) for k in KINDS])
def test_gain_and_centre_with_intervals(kind, seeds):
    """The smallest gain against Clarabel; every point on the way keeps to the intervals; the centre is stationary."""
    for seed in range(seeds):
        problem = bounded(tight(seed), kind, seed)
        data = ExactFormulation(problem).data
        *_, (best, _, _) = margin_path(data)
        level = 1.1 * data.margin(best.x, best.p) + 0.1
        center = analytic_center(data, level)
        walk = list(gain_path(data, center, level))
        assert all(data.rows.within(point.p) for point, _, _ in walk)
        conic = solve_conic(data, "gain", solver="cvxpy", factor=level)
        assert walk[-1][1] == pytest.approx(data.sarason.norm(conic.x), abs=2e-6)
        value = barrier(data, level, center.x, center.p)
        rng = np.random.default_rng(seed)
        for _ in range(5):  # the centre maximises the barrier: it falls in every direction
            step = 1e-3 * rng.standard_normal(center.x.size)
            low, high = data.rows.ends.T
            room = np.minimum(np.minimum(center.p - low, high - center.p), 1.0)
            step_p = 1e-3 * room * rng.standard_normal(center.p.size)
            assert barrier(data, level, center.x + step, center.p + step_p) <= value


def barrier(data, level, x, p):
    """log det(I - X'X) + sum log(level^2 - |e|^2) + sum log(1 - ((p - middle)/half)^2)."""
    low, high = data.rows.ends.T
    held = np.isfinite(low) & (low < high)
    out = 2 * (p - low)[held] / (high - low)[held] - 1
    e, X = data.rows.ratio(x, p), np.tensordot(x, data.sarason.basis, 1)
    if e.max() >= level or np.linalg.norm(X, 2) >= 1 or np.abs(out).max(initial=0) >= 1:
        return -np.inf
    total = np.linalg.slogdet(np.eye(x.size) - X.T @ X)[1] + np.log(level**2 - e**2).sum()
    return total + np.log(1 - out**2).sum()


# --- certificates -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seeds", [1, slow(10)])
def test_a_certificate_belongs_to_its_intervals(seeds):
    """Evaluated under wider intervals it proves no more than holds there; under its own, what it says."""
    for seed in range(seeds):
        problem = bounded(tight(seed), "outside", seed)
        result = rid.identify(problem, solver="structured")
        proof, own = result.certificate, ExactFormulation(problem).data
        assert proof.verify(own.rows, own.sarason)
        assert proof.shares(own.rows).sum() == pytest.approx(1)
        middle, half = problem.parameter_bounds.mean(axis=1), np.diff(problem.parameter_bounds)[:, 0] / 2
        for factor in (1.5, 4.0, 1e3):
            wider = dataclasses.replace(
                problem, parameter_bounds=np.stack([middle - factor * half, middle + factor * half], 1)
            )
            data = ExactFormulation(wider).data
            value = evaluate_certificate(proof.samples, proof.ball, proof.upper, data.rows, data.sarason)
            slope = np.real(own.rows.P.conj().T @ proof.samples) * own.rows.column_scale
            assert value == pytest.approx(proof.value - (factor - 1) * np.abs(slope) @ half, abs=1e-9 * factor)
            assert value <= judge_margin(wider) + 1e-6
        assert not proof.verify(data.rows, data.sarason) or result.margin_lower < 1e-6


@pytest.mark.parametrize("seeds", [3, slow(30)])
def test_certificates_from_arbitrary_multipliers_hold_for_members(seeds):
    """Random multipliers, good or bad: no member with coefficients in their intervals is below the value."""
    proved = 0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        problem = random_problem(seed, "parametric", 8, spread=0.05)
        bounds = [(20.0, 21.0), FREE if seed % 2 else (-1.0, 1.0)]
        data = ExactFormulation(dataclasses.replace(problem, parameter_bounds=bounds)).data
        rows, n = data.rows, data.sarason.pair.order
        *_, (found, _, _) = margin_path(data)
        scatter = 1e-3 * (rng.standard_normal(rows.y.size) + 1j * rng.standard_normal(rows.y.size))
        scatter[rows.discs :] = scatter[rows.discs :].real
        weights = found.samples + np.abs(found.samples).max() * scatter
        proof = certify_margin(weights, found.ball, data.margin(found.x, found.p), rows, data.sarason)
        proved += proof.value > 1
        low, high = rows.ends.T
        free = ~rows.held
        for _ in range(50):
            x = rng.standard_normal(n)
            x *= rng.uniform() / data.sarason.norm(x)
            p = rng.uniform(np.where(free, 0, low), np.where(free, 0, high))
            rest = rows.real(rows.y - rows.E @ x - rows.P @ p)
            p[free] = np.linalg.lstsq(rows.real(rows.P[:, free]), rest, rcond=None)[0]
            assert data.margin(x, p) >= proof.value
    assert proved >= 2 * seeds // 3
