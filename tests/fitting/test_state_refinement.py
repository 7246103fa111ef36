"""Refinement of a state space against brute force, and what it promises: never worse, stable, in time."""

import time

import numpy as np
import pytest
import scipy.optimize

import robustid as rid
from robustid.core import Budget, response_at
from robustid.fitting import FitStatus, FractionProblem, Weight, fit_mfd, subspace_estimate
from robustid.fitting.state_space import state_descent, state_refinement
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.state_descent import blocks_of
from robustid.fitting.state_space.state_refinement import Outputs, exchange_modes, refine
from robustid.fitting.state_space.withheld_points import left_out_cost
from support.cases import slow
from support.interrupts import ctrl_c_at_call
from support.mfd_systems import noisy, random_modal_system, relative_error, stand_in
from support.pairwise import every_one

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 120)


def weights(kind, shape, seed=0):
    rng = np.random.default_rng(seed)
    F, ny, nu = shape
    if kind == "entries":
        return Weight(rng.uniform(0.5, 2, shape))
    if kind == "rows alike":
        return Weight(np.broadcast_to(rng.uniform(0.5, 2, (F, 1, nu)), shape))
    if kind == "separable":
        return Weight(np.ones(shape), output=rng.standard_normal((F, ny, ny)), input=rng.standard_normal((F, nu, nu)))
    matrix = rng.standard_normal((F, ny * nu, ny * nu)) + 1j * rng.standard_normal((F, ny * nu, ny * nu))
    return Weight(rng.uniform(0.5, 2, shape), matrix=matrix)


def problem_of(seed, ny, nu, modes, order, *, kind="entries", feedthrough=False, dt=None, level=0.05):
    system = random_modal_system(seed, ny, nu, modes, dt=dt)
    points = 1j * OMEGA if dt is None else np.exp(1j * OMEGA * dt)
    values = noisy(np.random.default_rng([seed, 1]), system.response(points), level)
    values = values / np.abs(values).max()
    weight = weights(kind, values.shape)
    return FractionProblem(OMEGA, values, order, weight, dt=dt, feedthrough=feedthrough)


def start_of(problem):
    domain = "s" if problem.dt is None else "z"
    data = Samples(problem.values, problem.scale * problem.xi, problem.weight.entrywise, domain)
    found = subspace_estimate(data.values, data.points, problem.order, weight=data.weight, domain=domain)
    start = BlockModel.of(found.A / problem.scale, found.B / problem.scale, discrete=domain == "z")
    return data, found, start


@pytest.mark.parametrize(
    ("kind", "feedthrough"), every_one(["entries", "rows alike", "separable", "matrix"], [False, True])
)
def test_outputs_and_directions_against_dense_least_squares(kind, feedthrough):
    """C and D against one stacked problem, the cost against the criterion, directions against its projection."""
    problem = problem_of(0, 3, 2, 3, 6, kind=kind, feedthrough=feedthrough)
    _, _, start = start_of(problem)
    outputs = Outputs(problem)
    fitted = outputs.fitted(start)
    assert fitted.cost == pytest.approx(np.linalg.norm(problem.residual(fitted.response)) ** 2, rel=1e-10)
    columns = []
    for i in range(3):
        for state in np.moveaxis(start.states(problem.xi), 1, 0):
            change = np.zeros(problem.values.shape, dtype=complex)
            change[:, i] = state
            columns.append(change)
        for j in range(2 if feedthrough else 0):
            change = np.zeros(problem.values.shape, dtype=complex)
            change[:, i, j] = 1
            columns.append(change)

    def stacked(change):
        weighted = problem.weight.apply(change).ravel()
        return np.concatenate([weighted.real, weighted.imag])

    design = np.stack([stacked(column) for column in columns], axis=1)
    size = np.linalg.norm(design, axis=0)
    solution = np.linalg.lstsq(design / size, stacked(problem.values), rcond=None)[0] / size
    assert fitted.cost == pytest.approx(np.sum((design @ solution - stacked(problem.values)) ** 2), rel=1e-8)
    Q = np.linalg.qr(design / size)[0]
    tangent = start.tangent(problem.xi, fitted.states, fitted.C)
    brute = np.stack([stacked(column) for column in np.moveaxis(tangent, 3, 0)], axis=1)
    brute = brute - Q @ (Q.T @ brute)
    found = outputs.directions(fitted)
    assert np.allclose(found.T @ found, brute.T @ brute, rtol=1e-7, atol=1e-8 * np.abs(brute.T @ brute).max())
    gradient, rest = found.T @ fitted.residual.ravel(), stacked(problem.values) - design @ solution
    assert np.allclose(gradient, brute.T @ rest, atol=1e-7 * np.abs(gradient).max())
    assert fitted.condition - 1 <= 1e-10


@pytest.mark.parametrize("kind", ["entries", "matrix"])
def test_importance_against_taking_every_block_away(kind):
    problem = problem_of(1, 2, 2, 4, 8, kind=kind)
    outputs = Outputs(problem)
    fitted = outputs.fitted(start_of(problem)[2])
    found = outputs.importance(fitted)
    for block, rise in enumerate(found):
        without = outputs.fitted(fitted.model.without(block))
        assert rise == pytest.approx(without.cost - fitted.cost, rel=1e-6)


@pytest.mark.parametrize(("dt", "order"), [(None, 5), (2e-4, 6)])
def test_it_ends_where_a_general_optimiser_ends(dt, order):
    """scipy's least_squares on all entries of A, B, C from the end finds nothing lower; it arrives from the subspace start."""
    problem = problem_of(2, 2, 1, 4, order, dt=dt, level=0.1)
    start = start_of(problem)[2]
    found = refine(problem, start.resolved(problem.xi), stable=True, limit=100, patient=True)
    A, B, C, _ = found.fitted.state_space(1.0)
    n = len(A)

    def residual(x):
        parts = np.split(x, [n * n, n * n + n])
        A, B, C = parts[0].reshape(n, n), parts[1].reshape(n, 1), parts[2].reshape(2, n)
        weighted = problem.residual(response_at((A, B, C, np.zeros((2, 1))), problem.xi)).ravel()
        return np.concatenate([weighted.real, weighted.imag])

    end = scipy.optimize.least_squares(residual, np.concatenate([A.ravel(), B.ravel(), C.ravel()]), x_scale="jac")
    assert found.status.converged
    assert 2 * end.cost >= (1 - 1e-3) * found.fitted.cost


@pytest.mark.parametrize(
    ("seed", "order"),
    [
        pytest.param(seed, order, marks=() if (seed == 0) == (order in (4, 13)) and seed < 2 else pytest.mark.slow)
        for seed in range(3)
        for order in (4, 8, 12, 13)
    ],
)
def test_every_step_falls_and_the_end_is_stable(seed, order):
    """12 problems, orders below, at and above the true one: costs fall, condition one, poles inside."""
    problem = problem_of(seed, 3, 2, 4, order, kind="entries" if seed else "matrix")
    start = start_of(problem)[2]
    found = refine(problem, start.resolved(problem.xi), stable=True, limit=40)
    costs = [step.cost for step in found.history]
    assert np.all(np.diff(costs) < 0)
    assert found.fitted.cost <= Outputs(problem).fitted(start.resolved(problem.xi)).cost
    assert np.all(found.fitted.model.distances > 0)
    assert max((step.condition for step in found.history), default=1.0) - 1 <= 1e-10


def test_an_exchange_never_costs_more_and_finds_a_missed_mode():
    """A start whose poles all lie beside one mode: the exchange ends within 5 % of the fit from the subspace estimate."""
    problem = problem_of(3, 2, 2, 4, 8, level=0.02)
    data, _, start = start_of(problem)
    good = refine(problem, start.resolved(problem.xi), stable=True, limit=100)
    poles = np.array([-0.01 + 0.03j, -0.011 + 0.031j, -0.012 + 0.033j, -0.013 + 0.034j])
    A = np.zeros((8, 8))
    for k, pole in enumerate(poles):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    bad = BlockModel.of(A, np.random.default_rng(0).standard_normal((8, 2)), discrete=False)
    stuck = refine(problem, bad, stable=True, limit=5)
    found = exchange_modes(problem, data, stuck, stable=True, rounds=3, budget=Budget())
    assert found.fitted.cost <= stuck.fitted.cost
    assert found.fitted.cost <= 1.05 * good.fitted.cost


def test_time_limit_and_interruption_give_the_best_so_far():
    """No time: a stable model, no worse than the subspace estimate. Ctrl-C after two steps: the same, and the status."""
    system = random_modal_system(5, 2, 2, 6)
    frf = rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng(5), system.response(1j * OMEGA), 0.05))
    free = fit_mfd(frf, order=8)
    begin = time.monotonic()
    quick = fit_mfd(frf, order=8, time_limit=1e-3)
    assert time.monotonic() - begin < 5
    assert quick.status is FitStatus.TIME
    assert quick.stable
    assert free.cost <= quick.cost <= quick.start_cost * (1 + 1e-9)
    stopped = fit_mfd(frf, order=8, progress=ctrl_c_at_call(2))
    assert stopped.status is FitStatus.INTERRUPTED
    assert stopped.stable
    assert stopped.cost <= stopped.start_cost
    assert len(stopped.history) == 2


def against_subspace(seed, modes, lines, orders):
    """Costs, errors on withheld frequency points and those of the subspace estimate, relative weights."""
    frf, judge = stand_in(seed, modes, lines)
    rows = []
    for order in orders:
        fit = fit_mfd(frf, order=order)
        data = fit.problem
        weight = 1 / np.abs(frf.values)
        estimate = subspace_estimate(frf.values, np.exp(1e-3j * frf.omega), order, weight=weight, domain="z")
        here = [fit.fraction.response(judge.omega), estimate.response(np.exp(1e-3j * judge.omega))]
        sizes = [np.linalg.norm((H - judge.values) / np.abs(judge.values)) for H in here]
        errors = [float(size / np.sqrt(judge.values.size)) for size in sizes]
        rows.append((fit.cost, data.residual(estimate.response(np.exp(1e-3j * frf.omega))), *errors, fit.stable))
    return rows


@pytest.mark.parametrize(
    ("seeds", "modes", "lines", "orders"),
    [((0,), 8, 80, (4, 8)), slow((0,), 12, 120, (6, 12)), slow(range(5), 40, 1000, (12, 24, 36, 48, 60))],
)
def test_no_order_is_right_and_every_fit_arrives(seeds, modes, lines, orders):
    """Error on withheld points at most that of the subspace estimate, a tenth lower in the median; cost falls with the order."""
    ratios = []
    for seed in seeds:
        rows = against_subspace(seed, modes, lines, orders)
        costs = [row[0] for row in rows]
        assert np.all(np.diff(costs) <= 0), costs
        for cost, residual, error, other, stable in rows:
            assert stable
            assert cost <= np.linalg.norm(residual) ** 2
            assert error <= other
            ratios.append(error / other)
    assert np.median(ratios) <= 0.9


@pytest.mark.parametrize(("modes", "lines", "order"), [(8, 80, 8), slow(12, 120, 14)])
def test_the_response_is_that_of_the_fraction(modes, lines, order):
    """Formed again from the state space: polynomials, realisation and refinement agree."""
    frf, _ = stand_in(1, modes, lines)
    fit = fit_mfd(frf, order=order)
    assert fit.fraction.error <= 1e-9
    assert relative_error(fit.nodes.response, fit.fraction.response(frf.omega)) <= 1e-9
    residual = fit.problem.residual(fit.fraction.response(frf.omega))
    assert fit.cost == pytest.approx(np.linalg.norm(residual) ** 2, rel=1e-6)


# --- points left out


@pytest.mark.parametrize(("ny", "nu", "lines"), [(1, 1, 24), slow(2, 2, 24)])
def test_equals_fits_without_each_point(ny, nu, lines):
    """Small noise: first order is all there is."""
    omega = 2 * np.pi * np.geomspace(5, 900, lines)
    truth = random_modal_system(3, ny, nu, 2).response(1j * omega)
    frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng(0), truth, 1e-4))
    weight = 1 / np.abs(truth)
    fit = fit_mfd(frf, order=4, weight=rid.fits.Weight(weight))
    outputs = Outputs(fit.problem)
    fitted = outputs.fitted(blocks_of(fit.problem, fit.fraction.matrices))
    total = 0.0
    for point in range(omega.size):
        kept = rid.fits.Weight(np.where((np.arange(lines) != point)[:, None, None], weight, 0.0))
        without = fit_mfd(frf, order=4, weight=kept).problem
        other = refine(without, fitted.model, stable=True, limit=20).fitted
        residual = weight[point] * (other.response[point] - frf.values[point])
        total += float(np.linalg.norm(residual) ** 2)
    # Fits end within a hundredth of a deviation.
    assert left_out_cost(outputs, fitted) == pytest.approx(total, rel=0.05)
    assert total > 1.1 * fitted.cost


def test_a_narrow_mode_of_the_plant_stays():
    """Damping of a thirtieth of the spacing, almost no noise: the criterion would rise by more than the factor."""
    experiment = rid.datasets.flexible_structure(bound=1e-4)
    fit = fit_mfd(experiment.frequency, order=4)
    hz = np.sort(np.abs(np.log(fit.fraction.poles)) / (2 * np.pi * 0.01))[::2]
    np.testing.assert_allclose(hz, experiment.modes[:, 0] / (2 * np.pi), rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.1, 0.3])
def test_modes_that_single_points_decide_do_not_stand_between_them(level, monkeypatch):
    """Order 36 for 12, modes of the plant as wide as half the spacing, 12 seeds: where wide modes were taken for narrow ones they
    err less between the points, but for one seed, and by a third in the median."""
    omega = 2 * np.pi * np.linspace(5, 1000, 120)
    errors = {"chosen": [], "narrow": []}
    for kind, found in errors.items():
        if kind == "narrow":  # no point is said to decide a mode by itself
            monkeypatch.setattr(state_descent, "left_out_cost", lambda outputs, fitted: 0.0)
        for seed in range(12):
            plant = random_modal_system(seed, 2, 2, 6, band_hz=(100.0, 1000.0), damping=(0.05, 0.15))
            truth = plant.response(1j * omega)
            values = noisy(np.random.default_rng([seed, 5]), truth, level)[::2]
            fit = fit_mfd(rid.FrequencyResponse(omega[::2], values), order=36, weight=Weight.relative(values))
            error = np.abs(fit.fraction.response(omega[1::2]) - truth[1::2]) / np.abs(truth[1::2])
            found.append(np.sqrt(np.mean(error**2)))
    ratio = np.divide(errors["chosen"], errors["narrow"])
    acted = ratio[ratio != 1]
    assert acted.size >= 6
    assert np.sum(acted > 1) <= 1, acted
    assert np.median(acted) <= 2 / 3


def test_steps_that_held_poles_make_long_get_shorter_until_they_end(monkeypatch):
    """Held on their limits, several poles make a step longer than the radius; none of the trials is better than the start."""
    problem = problem_of(1, 2, 2, 3, 6)
    start, lengths = start_of(problem)[2], []
    outputs = Outputs(problem)
    first = outputs.fitted(start)
    plain = state_refinement._step

    def long(R, gradient, radius, *rest):
        step, _ = plain(R, gradient, radius, *rest)
        lengths.append(4 * radius)
        assert len(lengths) < 100
        return step * 4 * radius / np.linalg.norm(step), True

    monkeypatch.setattr(state_refinement, "_step", long)
    monkeypatch.setattr(outputs, "fitted", lambda model: first._replace(cost=first.cost * (1 + (model is not start))))
    found = refine(problem, start, stable=True, limit=5, outputs=outputs)
    assert found.history == ()
    assert np.all(np.diff(lengths) < 0)
