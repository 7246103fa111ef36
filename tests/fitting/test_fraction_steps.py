"""Steps and forms of a fit: against brute force and against each other."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import (
    FractionProblem,
    Weight,
    fit_fraction,
    fit_mfd,
    orthonormal_polynomials,
    polynomial_nodes,
    retract,
    sk_step,
)
from robustid.fitting.fraction.fraction_steps import (
    column_step,
    gauss_newton_direction,
    minimum_norm_step,
    relaxed_step,
)
from robustid.fitting.fraction.node_fraction import Held
from support.cases import slow
from support.mfd_systems import gaussian, identity, noisy, poles_and_residues, problem_of, relative_error
from support.pairwise import every_two

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 300)


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


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize("step", [sk_step, relaxed_step, minimum_norm_step, column_step])
@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (2, 2), slow((3, 4))])
def test_every_normalisation_reproduces_exact_data(step, shape, seeds):
    """Noise-free, six steps from D = I; all seeds, degrees by ones and by twos."""
    if step is minimum_norm_step and shape[1] > 1:
        with pytest.raises(rid.InputError, match="sk-minimum-norm"):
            step(problem_of(0, *shape, 3)[0], np.zeros(1))
        return
    for seed in range(seeds):
        for pairs in (False, True):
            problem, truth = problem_of(seed, *shape, 4 if shape[1] == 4 else 3, level=0, pairs=pairs)
            denominators, held = identity(problem), Held()
            for _ in range(6):
                result = step(problem, denominators, held)
                fraction = result if step is column_step else result[0]
                denominators, held = fraction.denominators, fraction.held
            assert relative_error(fraction.response, truth) <= 1e-5


@pytest.mark.parametrize(
    ("order", "inputs", "pairs", "feedthrough"),
    every_two([(12, 4), (7, 2), (10, 4), (9, 4), (5, 3)], [False, True], [False, True]),
)
def test_the_tangent_space_has_the_dimension_of_the_model_set(order, inputs, pairs, feedthrough):
    problem, _ = problem_of(1, 3, inputs, order // 2 + 1)
    problem = dataclasses.replace(problem, order=order, pairs=pairs, feedthrough=feedthrough)
    fraction = fit_fraction(problem, method="sk", steps=3).fraction
    basis = problem.basis(fraction.denominators, fraction.response)
    expected = order * (3 + inputs) + 3 * inputs * feedthrough
    assert basis.size - len(problem.forbidden(basis, fraction)) == expected


@pytest.mark.parametrize(("seeds", "every"), [slow(1, 3), slow(2, 1)])
def test_the_degrees_that_a_fit_chooses_are_as_good_as_any(seeds, every):
    """4x4 with 6 modes: no worse than by ones, or by twos with any two inputs ahead (some stop early)."""
    omega = OMEGA[::every]
    for seed in range(seeds):
        ahead = ((0, 1, 2, 3), (0, 2, 1, 3), (3, 1, 2, 0))[:: 2 if every > 1 else 1]
        forms = [{}] + [{"pairs": True, "priority": order} for order in ahead]
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


@pytest.mark.parametrize("count", [3, slow(8)])
def test_degrees_by_twos_keep_odd_numbers_of_modes_well_conditioned(count):
    """Noise-free, 2 to 4 channels, modes no multiple of them: 1e-9 in all 8 (by ones: up to 1e-5)."""
    cases = [(2, 3), (2, 7), (3, 5), (3, 10), (4, 5), (4, 6), (4, 7), (4, 9)]
    for seed, (ports, modes) in enumerate(cases[:count]):
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


# one step against brute force with monomials


def brute_force(problem, denominators, response):
    """Columns W (D^-T kron [response -I]) of every free monomial and of the leading term, stacked real."""
    ny, nu = problem.values.shape[1:]
    W = np.stack([problem.weight.apply(one) for one in np.eye(ny * nu).reshape(-1, 1, nu, ny).transpose(0, 1, 3, 2)
                  * np.ones((1, problem.omega.size, 1, 1))], axis=2)  # fmt: skip
    kron = np.stack(
        [np.kron(np.linalg.inv(d).T, np.hstack([r, -np.eye(ny)])) for d, r in zip(denominators, response, strict=True)]
    )
    columns = W @ kron
    xi, free, leading = problem.xi, [], 0
    for j in range(nu):
        for i in range(nu + ny):
            column = columns[:, :, j * (nu + ny) + i]
            limit = problem.degrees[i] - 1 if i < nu else problem.degrees[j] - 1 + problem.feedthrough
            free += [(xi[:, None] ** k * column).ravel() for k in range(limit + 1)]
            if i == j:
                leading = leading + (xi[:, None] ** problem.degrees[i] * column).ravel()
    both = np.stack([*free, leading], axis=1)
    both = np.concatenate([both.real, both.imag])
    return both[:, :-1], both[:, -1]


def small_problem(seed, dt, feedthrough):
    rng = np.random.default_rng(seed)
    omega, values, _ = poles_and_residues(seed, 2, 3, 5, lines=40, dt=dt, feedthrough=feedthrough)
    values = noisy(rng, values, 0.1)
    weight = Weight(rng.uniform(0.5, 2, values.shape), output=gaussian(rng, 2, 2), matrix=gaussian(rng, 6, 6))
    return FractionProblem(omega, values, 5, weight, dt=dt, feedthrough=feedthrough)


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("dt", [None, 1e-3])
def test_sk_step_is_the_least_squares_solution(dt, feedthrough):
    for seed in range(5):
        problem = small_problem(seed, dt, feedthrough)
        old = gaussian(np.random.default_rng(seed), 40, 3, 3)
        free, leading = brute_force(problem, old, problem.values)
        least = np.linalg.norm(leading - free @ np.linalg.lstsq(free, leading, rcond=None)[0])
        fraction, condition = sk_step(problem, old)
        equation = problem.values @ fraction.denominators - fraction.numerators
        reached = np.linalg.norm(problem.weight.apply(equation @ np.linalg.inv(old)))
        assert reached == pytest.approx(least, rel=1e-9)
        assert condition - 1 <= 1e-12


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("dt", [None, 1e-3])
def test_gauss_newton_direction_against_lstsq_and_finite_differences(dt, feedthrough):
    for seed in range(5):
        problem = small_problem(seed, dt, feedthrough)
        fraction, _ = sk_step(problem, gaussian(np.random.default_rng(seed), 40, 3, 3))
        direction, slope, condition = gauss_newton_direction(problem, fraction)
        jacobian, _ = brute_force(problem, fraction.denominators, fraction.response)
        residual = problem.residual(fraction.response).ravel()
        residual = np.concatenate([residual.real, residual.imag])
        best = jacobian @ np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        assert slope == pytest.approx(np.linalg.norm(best) / np.linalg.norm(residual), rel=1e-7)
        assert condition - 1 <= 1e-12
        # along the direction the criterion falls at the rate 2 slope^2 cost
        cost, step = problem.cost(fraction), 1e-6
        size = max(1.0, np.abs(direction.denominators @ np.linalg.inv(fraction.denominators)).max())
        step /= size
        up, down = (problem.cost(fraction.moved(sign * step, direction)) for sign in (1, -1))
        assert (up - down) / (2 * step) == pytest.approx(-2 * slope**2 * cost, rel=1e-4)
