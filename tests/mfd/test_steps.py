"""Steps and forms of a fit: against brute force, against each other, and what keeps a fit stable or starts it again."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.mfd import Weight, fit_mfd
from robustid.mfd.iteration import fit_fraction
from robustid.mfd.node_fraction import Held
from robustid.mfd.problem import FractionProblem
from robustid.mfd.steps import column_step, gauss_newton_direction, minimum_norm_step, relaxed_step, retract, sk_step
from robustid.mfd.vector_polynomials import orthonormal_polynomials, polynomial_nodes
from support.mfd_systems import noisy, random_modal_system, relative_error

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 300)


def problem_of(seed, outputs, inputs, modes, *, level=0.01, omega=OMEGA, **options):
    system = random_modal_system(seed, outputs, inputs, modes)
    truth = system.response(1j * omega)
    values = noisy(np.random.default_rng([seed, 2]), truth, level) if level else truth
    return FractionProblem(omega, values, system.order, Weight(1 / np.abs(truth)), **options), truth


def identity(problem):
    lines, nu = problem.omega.size, problem.values.shape[2]
    return np.broadcast_to(np.eye(nu), (lines, nu, nu))


@pytest.mark.parametrize("dt", [None, 0.1])
def test_derivatives_and_highest_coefficients_are_those_of_the_monomials(dt):
    rng = np.random.default_rng(0)
    xi, _ = polynomial_nodes(np.linspace(1, 9, 40), dt)
    limits = np.array([5, 4, 5, 3])
    basis = orthonormal_polynomials(rng.standard_normal((40, 3, 4)) + 1j * rng.standard_normal((40, 3, 4)), xi, limits)
    circle = np.exp(2j * np.pi * np.arange(8) / 8)
    monomials = np.fft.fft(basis.polynomials(circle), axis=0) / 8  # coefficient k first
    for order, values in enumerate(basis.derivatives(0.3, 3)):
        expected = sum(
            monomials[k] * np.prod(np.arange(k, k - order, -1.0)) * 0.3 ** (k - order) for k in range(order, 6)
        )
        np.testing.assert_allclose(values, expected, rtol=1e-10, atol=1e-10)
    for below, values in enumerate(basis.derivatives(np.inf, 2)):
        expected = np.stack([monomials[limit - below, k] for k, limit in enumerate(limits)])
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)
    monic = basis.monic(np.array([1.0, 0.0, 0.0, 0.0]))[:3]
    plain = np.fft.fft(basis.evaluate(circle, *monic), axis=0) / 8
    top = np.stack([plain[limit, k] for k, limit in enumerate(limits)])
    np.testing.assert_allclose(basis.derivatives_of(np.inf, 1, monic)[0], top, atol=1e-12)


@pytest.mark.parametrize("step", [sk_step, relaxed_step, minimum_norm_step, column_step])
@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (2, 2), (3, 4)])
def test_every_normalisation_reproduces_exact_data(step, shape):
    """Noise-free, six steps from D = I; 3 of 3 seeds, degrees by ones and by twos."""
    if step is minimum_norm_step and shape[1] > 1:
        with pytest.raises(rid.InputError, match="sk-minimum-norm"):
            step(problem_of(0, *shape, 3)[0], np.zeros(1))
        return
    for seed in range(3):
        for pairs in (False, True):
            problem, truth = problem_of(seed, *shape, 4 if shape[1] == 4 else 3, level=0, pairs=pairs)
            denominators, held = identity(problem), Held()
            for _ in range(6):
                result = step(problem, denominators, held)
                fraction = result if step is column_step else result[0]
                denominators, held = fraction.denominators, fraction.held
            assert relative_error(fraction.response, truth) <= 1e-5


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("pairs", [False, True])
@pytest.mark.parametrize(("order", "inputs"), [(12, 4), (7, 2), (10, 4), (9, 4), (5, 3)])
def test_the_tangent_space_has_the_dimension_of_the_model_set(order, inputs, pairs, feedthrough):
    problem, _ = problem_of(1, 3, inputs, order // 2 + 1)
    problem = dataclasses.replace(problem, order=order, pairs=pairs, feedthrough=feedthrough)
    fraction = fit_fraction(problem, method="sk", steps=3).fraction
    basis = problem.basis(fraction.denominators, fraction.response)
    expected = order * (3 + inputs) + 3 * inputs * feedthrough
    assert basis.size - len(problem.forbidden(basis, fraction)) == expected


@pytest.mark.parametrize(("seeds", "every"), [(1, 3), pytest.param(2, 1, marks=pytest.mark.slow)])
def test_the_degrees_that_a_fit_chooses_are_as_good_as_any(seeds, every):
    """4x4 with 6 modes: no worse than by ones, or by twos with any two inputs ahead (some stop early)."""
    omega = OMEGA[::every]
    for seed in range(seeds):
        forms = [{}] + [{"pairs": True, "priority": order} for order in ((0, 1, 2, 3), (0, 2, 1, 3), (3, 1, 2, 0))]
        costs = []
        for options in forms:
            problem, truth = problem_of(seed, 4, 4, 6, omega=omega, **options)
            start = retract(problem, truth, identity(problem), columnwise=8, steps=1)
            costs.append(fit_fraction(problem, start=start, method="lm").cost)
        problem, _ = problem_of(seed, 4, 4, 6, omega=omega)
        fit = fit_mfd(rid.FrequencyResponse(omega, problem.values), order=12, weight=problem.weight)
        assert fit.problem.pairs
        assert fit.status.converged
        assert fit.cost <= min(costs) * (1 + 1e-5)
        assert min(costs) <= fit.cost * (1 + 1e-5)


def test_degrees_by_twos_keep_odd_numbers_of_modes_well_conditioned():
    """Noise-free, 2 to 4 channels, modes no multiple of them: 1e-9 in all 8 (by ones: up to 1e-5)."""
    for seed, (ports, modes) in enumerate([(2, 3), (2, 7), (3, 5), (3, 10), (4, 5), (4, 6), (4, 7), (4, 9)]):
        _, truth = problem_of(seed, ports, ports, modes, level=0)
        fit = fit_mfd(rid.FrequencyResponse(OMEGA, truth), order=2 * modes)
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 1e-9
        assert fit.fraction.error <= 1e-8


@pytest.mark.parametrize(("pairs", "modes"), [(False, 4), (True, 5), (True, 6)])
def test_the_direction_is_that_of_steepest_descent_in_orthonormal_coordinates(pairs, modes):
    """The criterion falls along it by 2 step slope^2 cost, to first order."""
    problem, truth = problem_of(3, 3, 4, modes, pairs=pairs)
    start = retract(problem, truth, identity(problem), columnwise=6)
    direction = gauss_newton_direction(problem, start)
    cost = problem.cost(start)
    assert direction.condition - 1 <= 1e-10
    step = 1e-5
    fall = cost - problem.cost(problem.tie(start.moved(step, direction.fraction)))
    assert fall == pytest.approx(2 * step * direction.slope**2 * cost, rel=1e-2)


@pytest.mark.parametrize("method", ["sk", "sk-relaxed", "sk+lm", "sk-relaxed+lm", "gn", "iv", "iv+lm", "sk+iv+gn+lm"])
def test_every_method_runs_on_the_same_loop(method):
    problem, truth = problem_of(0, 2, 2, 4)
    start = retract(problem, truth, identity(problem), columnwise=8)
    fit = fit_fraction(problem, start=start, method=method)
    best = fit_fraction(problem, start=start, method="lm")
    assert fit.cost <= problem.cost(start)
    assert fit.cost <= best.cost * (1 + (1e-6 if "lm" in method or method in ("gn", "iv") else 0.2))
    assert {step.method for step in fit.history} <= set(method.split("+"))
    assert max(step.condition for step in fit.history) - 1 <= 1e-8


def test_an_unknown_method_is_named():
    problem, _ = problem_of(0, 1, 1, 1)
    with pytest.raises(rid.InputError, match='"sk-relaxed"'):
        fit_fraction(problem, method="sk+newton")
    with pytest.raises(rid.InputError, match="`start` is needed"):
        fit_fraction(problem, method="lm")


@pytest.mark.parametrize("dt", [None, 2e-4])
def test_an_unstable_machine_is_fitted_as_it_is_or_by_a_stable_model(dt):
    """One pole pair beyond the boundary: reflected and reported by default, kept on request."""
    system = random_modal_system(4, 2, 2, 4, damping=(0.005, 0.02), dt=dt)
    system = dataclasses.replace(system, damping=system.damping * np.array([1, -1, 1, 1]))
    points = 1j * OMEGA if dt is None else np.exp(1j * OMEGA * dt)
    frf = rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng(0), system.response(points), 0.01), dt=dt)
    free = fit_mfd(frf, order=8, stable=False)
    assert not free.stable
    assert relative_error(free.fraction.response(OMEGA), system.response(points)) <= 2e-3
    kept = fit_mfd(frf, order=8)
    assert kept.stable
    assert kept.reflected == 2
    assert kept.unstable_cost == pytest.approx(free.cost, rel=1e-6)
    assert kept.cost > free.cost
    assert np.all(np.real(kept.model.poles()) < 0 if dt is None else np.abs(kept.model.poles()) < 1)


def test_too_many_states_stay_stable_and_never_cost_more():
    """2x2, 2 modes, orders 4 to 8 on 60 lines: all stable, costs fall; 3 of 3 seeds."""
    omega = 2 * np.pi * np.geomspace(4, 1200, 60)
    for seed in range(3):
        truth = random_modal_system(seed, 2, 2, 2).response(1j * omega)
        frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng([seed, 3]), truth, 0.01))
        fits = [fit_mfd(frf, order=order, weight=1 / np.abs(truth)) for order in (4, 6, 8)]
        assert all(fit.stable for fit in fits)
        costs = [fit.cost for fit in fits]
        assert costs == sorted(costs, reverse=True)


def test_a_mode_that_the_start_missed_is_found_by_a_second_start():
    omega = 2 * np.pi * np.geomspace(4, 1200, 200)
    system = random_modal_system(5, 1, 1, 2)
    truth = system.response(1j * omega)
    frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng([5, 1]), truth, 0.01))
    single = fit_mfd(frf, order=4, restart=False)
    double = fit_mfd(frf, order=4)
    best = fit_mfd(frf, order=4, start=control.ss(*system.arrays()))
    assert single.cost > 2 * best.cost  # the case is one in 40: it says what the restart is for
    assert double.cost == pytest.approx(best.cost, rel=1e-6)


def test_duplicated_lines_and_silent_channels_are_refused():
    _, truth = problem_of(0, 2, 2, 2)
    double = np.concatenate([OMEGA[:3], OMEGA[2:]])
    with pytest.raises(rid.InputError, match=r"2 lines at|increasing"):
        fit_mfd(rid.FrequencyResponse(double, np.concatenate([truth[:3], truth[2:]])), order=4)
    silent = truth.copy()
    silent[:, 1] = 0
    with pytest.raises(rid.InputError, match=r"zero at frequency point 0, entry \(1, 0\)"):
        fit_mfd(rid.FrequencyResponse(OMEGA, silent), order=4)
    covariance = np.broadcast_to(np.ones((4, 4)), (OMEGA.size, 4, 4))
    with pytest.raises(rid.InputError, match="positive definite"):
        fit_mfd(rid.FrequencyResponse(OMEGA, truth, covariance=covariance), order=4)


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("form", ["right", "left"])
def test_poles_are_a_start(form, every):
    """Poles 2 % off lead to the optimum; 2 of 2 seeds."""
    omega = OMEGA[::every]
    for seed in range(2):
        system = random_modal_system(seed, 2, 2, 4)
        truth = system.response(1j * omega)
        frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng([seed, 5]), truth, 0.01))
        best = fit_mfd(frf, order=8, form=form)
        other = fit_mfd(frf, order=8, form=form, start=system.poles * 1.02)
        assert other.cost == pytest.approx(best.cost, rel=1e-4)
    with pytest.raises(rid.InputError, match="`start`"):
        fit_mfd(frf, order=8, start=system.poles, rigid_body=rid.RigidBody(1))
    with pytest.raises(rid.InputTypeError, match="`start`"):
        fit_mfd(frf, order=8, start="somewhere")


@pytest.mark.parametrize("form", ["right", "left"])
def test_decoupling_shows_the_rigid_body_alone(form):
    rng = np.random.default_rng(0)
    directions, shapes = rng.standard_normal((2, 3)), rng.standard_normal((4, 2))
    s = 1j * OMEGA[:, None, None]
    flexible = random_modal_system(1, 4, 3, 3)
    truth = 1e4 * shapes @ directions / s**2 + flexible.response(1j * OMEGA)
    body = rid.RigidBody(2, side="input" if form == "right" else "output")
    fit = fit_mfd(rid.FrequencyResponse(OMEGA, truth), order=10, rigid_body=body)
    T_y, T_u = fit.decoupling
    rest = T_y @ fit.model(1e-4j) @ T_u * 1e-4j**2  # far below the first mode
    expected = np.zeros((4, 3))
    expected[:2, :2] = np.eye(2)
    np.testing.assert_allclose(rest, expected, atol=1e-7)
