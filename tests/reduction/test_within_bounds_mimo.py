"""The smallest model within the bounds for MIMO models: derivatives by differences, the judge, known truths."""

import control
import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate
from robustid.identification import largest_ratio, model_residuals
from robustid.reduction import sample_fits
from robustid.reduction.pole_starts import statespace
from robustid.reduction.sample_map import sample_map
from robustid.reduction.smallest_maximum import smallest_maximum
from support.cases import slow
from support.matrix_lines import DT, found_at, lines, plant
from support.pairwise import every_one

PRIOR = rid.Prior(gain_bound=1, decay_rate=1.2)


def record(rng, truth, kind="rest", bound=0.05):
    u = np.sign(rng.standard_normal((40, truth.ninputs)))
    repeats = 60 if kind == "periodic" else 1
    y = simulate(truth, np.tile(u, (repeats, 1)))[0][-40:]
    half = np.full(y.shape, bound)
    half[::5, 0] = np.inf
    y = y + bound * rng.uniform(-1, 1, y.shape)
    return rid.TimeRecord(u, y, dt=DT, bound=half, initial=kind)


def every_kind(rng, truth):
    """Discs with a missing entry, ellipses, columns, ellipsoids, directions, records."""
    frf = lines(rng, truth, count=6)
    shape = frf.values.shape
    holes = np.where(rng.random(shape) < 0.2, np.inf, 0.05)
    size = shape[1] * shape[2]
    root = rng.standard_normal((shape[0], size, size)) + 1j * rng.standard_normal((shape[0], size, size))
    E = root @ root.conj().swapaxes(1, 2) + 0.1 * np.eye(size)
    directions = rng.standard_normal((shape[0], shape[2], 1))
    tilted, columns = rid.Bound(0.05, tilt=0.3 * np.exp(1j * np.arange(6))), rid.Bound(0.05, joint="column")
    bounds = holes, tilted, columns, rid.Bound(joint="matrix", ellipsoid=0.01 * E)
    along = rid.TangentialResponse(frf.omega, frf.values @ directions, right=directions, bound=0.05, dt=DT)
    return [*(frf.with_bound(bound) for bound in bounds), along]


@pytest.mark.parametrize(("outputs", "inputs", "integrators"), every_one([(2, 2), (3, 2), (2, 3), (3, 1)], [0, 1]))
def test_residuals_of_the_map_are_those_of_the_judge(outputs, inputs, integrators):
    rng = np.random.default_rng(outputs + 10 * inputs)
    truth, basis = plant(rng, 2, outputs, inputs)
    records = [record(rng, truth), *([] if integrators else [record(rng, truth, "periodic")])]
    problem = rid.MixedProblem(frequency=every_kind(rng, truth), time=records, prior=PRIOR, parametric=basis)
    samples = sample_map(problem, integrators)
    pair = sample_fits.Pair(
        np.array([[0.9, 0.3, 0], [-0.3, 0.9, 0], [0, 0, 0.5]]), rng.standard_normal((samples.heads, 3))
    )
    v = rng.standard_normal(3 * samples.tails + samples.fixed.shape[1])
    fit = sample_fits.evaluated(sample_fits.Functions(samples, pair), v)
    model = statespace(samples, fit, truth)
    assert model.nstates == 3 + integrators * samples.heads
    assert np.sum(np.abs(model.poles() - 1) < 1e-12) == integrators * samples.heads
    assert fit.worst == pytest.approx(largest_ratio(problem, model), rel=1e-9)
    ratios = np.concatenate([r.ratio for r in model_residuals(problem, model)])
    assert np.sort(fit.sizes) == pytest.approx(np.sort(ratios), rel=1e-9)
    left = samples.y - fit.functions.numerators @ v
    np.testing.assert_allclose(fit.error, left, atol=1e-9 * np.abs(fit.error).max())


@pytest.mark.parametrize(("outputs", "inputs"), [(2, 2), (3, 2)])
def test_columns_of_poles_and_directions_are_the_derivatives(outputs, inputs):
    rng = np.random.default_rng(1)
    truth, _ = plant(rng, 2, outputs, inputs)
    problem = rid.MixedProblem(frequency=lines(rng, truth), time=record(rng, truth), prior=PRIOR)
    samples = sample_map(problem, 0)
    pair = sample_fits.Pair(0.9 * np.linalg.qr(rng.standard_normal((4, 4)))[0], rng.standard_normal((2, 4)))
    v = rng.standard_normal(4 * samples.tails + outputs * inputs)
    fit, step = sample_fits.evaluated(sample_fits.Functions(samples, pair), v), 1e-6
    along_d, along_C = (
        sample_fits.pole_columns(samples, pair, fit.outputs),
        sample_fits.direction_columns(samples, pair, fit.X),
    )
    for k in range(8):
        change = step * np.eye(8)[k].reshape(2, 4)
        by_poles = [
            sample_fits.evaluated(sample_fits.Functions(samples, sample_fits.moved(pair, s * change.T)), v).error
            for s in (1, -1)
        ]
        by_C = [
            sample_fits.evaluated(
                sample_fits.Functions(samples, sample_fits.Pair(pair.A, pair.C + s * change)), v
            ).error
            for s in (1, -1)
        ]
        for (plus, minus), J in ((by_poles, along_d), (by_C, along_C)):
            np.testing.assert_allclose((plus - minus) / (2 * step), -J[:, k], atol=1e-7 * np.abs(J).max())


def test_normal_form_spans_the_same_functions():
    rng = np.random.default_rng(3)
    truth, _ = plant(rng, 2)
    samples = sample_map(rid.MixedProblem(frequency=lines(rng, truth), prior=PRIOR), 0)
    weights = np.array([2.0, 5.0])
    pair = sample_fits.Pair(truth.A, truth.C)
    A, C, size = sample_fits.normal_functions(pair, weights)
    np.testing.assert_allclose(A.T @ A + (weights[:, None] * C).T @ (weights[:, None] * C), np.eye(4), atol=1e-9)
    assert np.sort(1 - size**2) == pytest.approx(np.sort(np.abs(truth.poles()) ** 2), rel=1e-9)
    costs = [sample_fits.least_squares(samples, one).cost for one in (pair, sample_fits.Pair(A, C))]
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)


@pytest.mark.parametrize(
    ("size", "modes", "count", "seed"),
    [(2, 2, 12, 0), slow(2, 3, 20, 1), *(slow(size, 3, 30, seed) for size in (2, 3) for seed in range(10))],
)
def test_truth_of_known_order_bounds_the_order_found(size, modes, count, seed):
    """Its own samples keep to the truth: an order above its order would be a miss."""
    rng = np.random.default_rng(seed)
    truth, basis = plant(rng, modes, size, size)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2)
    frequency = lines(rng, truth, count=count)
    found_at(rid.MixedProblem(frequency=frequency, prior=prior, parametric=basis), truth, 2 * modes)


@pytest.mark.parametrize("seeds", [2, slow(6)])
def test_smallest_maximum_of_joint_bounds_is_that_of_another_solver(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        F, T, n = 14, 6, 4
        G, y = (rng.standard_normal((F + T, n)) + 0j, rng.standard_normal(F + T) + 0j)
        G[:F] += 1j * rng.standard_normal((F, n))
        y[:F] += 1j * rng.standard_normal(F)
        cone = np.concatenate([np.repeat(np.arange(4), [5, 1, 4, 4]), 4 + np.arange(T)])
        reach = np.array([np.inf, np.inf, 0.2, 0.2])
        v, value = smallest_maximum(G, y, F, np.zeros(n), reach, cone)
        x = cp.Variable(n)
        e = cp.hstack([cp.real(y - G @ x), cp.imag(y - G @ x)])
        worst = cp.max(cp.hstack([cp.norm(e[np.flatnonzero(np.tile(cone, 2) == k)]) for k in range(4 + T)]))
        best = cp.Problem(cp.Minimize(worst), [cp.abs(x[2:]) <= 0.2]).solve(solver=cp.CLARABEL)
        assert np.all(np.abs(v[2:]) <= 0.2 * (1 + 1e-9))
        reached = np.sqrt(np.bincount(cone, np.abs(y - G @ v) ** 2)).max()
        assert reached == pytest.approx(value, rel=1e-9)
        assert best * (1 - 1e-7) <= value <= best * (1 + 2e-4)


def test_more_outputs_than_inputs_columns_and_a_record():
    """One input: the directions of the modes at the outputs are linear, and the heads are the inputs."""
    rng = np.random.default_rng(5)
    truth, basis = plant(rng, 1, 3, 1)
    frf = lines(rng, truth, bound=0.03, count=7).with_column_bound(0.05 * np.sqrt(3))
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2)
    problem = rid.MixedProblem(frequency=frf, time=record(rng, truth), prior=prior, parametric=basis)
    assert found_at(problem, truth, 2).model.D.shape == (3, 1)


def test_records_alone_from_an_unknown_state():
    rng = np.random.default_rng(6)
    truth, basis = plant(rng, 1)
    free = record(rng, truth, "free")
    prior = rid.Prior(gain_bound=0.05, decay_rate=1.3)
    problem = rid.MixedProblem(time=[free, record(rng, truth)], prior=prior, parametric=basis)
    found_at(problem, truth, 2)


def test_integrators_of_a_matrix_stay_exact():
    """Of two inputs and outputs every integrator of the parametric part is two, and a rigid body two modes."""
    rng = np.random.default_rng(7)
    flexible, basis = plant(rng, 1)
    slow = control.ss(np.eye(2), 0.02 * np.eye(2), rng.standard_normal((2, 2)), 0, DT)
    truth = control.ss(flexible + slow, dt=DT)
    frf = lines(rng, truth, bound=0.03, count=12)
    integrator = control.ss(1, 1, 1, 0, DT)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=[basis, integrator])
    small = found_at(problem, truth, 4)
    assert np.sum(small.model.poles() == 1) == 2
    with pytest.raises(rid.InputError, match=r"RigidBody\(2\), a mode for every signal"):
        rid.reduce_within_bounds(rid.identify(problem), rigid_body=rid.RigidBody(1))
