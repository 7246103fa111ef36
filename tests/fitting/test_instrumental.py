"""Bi-orthonormal vector polynomials and the instrumental-variable step, against dense algebra and the true gradient."""

import dataclasses

import numpy as np
import pytest

from robustid.errors import InputError
from robustid.fitting import FractionProblem, Weight, fit_fraction, polynomial_nodes, retract, sk_step
from robustid.fitting.fraction.fraction_steps import gauss_newton_direction
from robustid.fitting.fraction.instrumental import BreakdownError, biorthonormal_polynomials, instrumental_pair, iv_step
from robustid.fitting.fraction.krylov_blocks import stacked
from support.cases import slow
from support.mfd_systems import gaussian, identity, noisy, random_modal_system, relative_error


def monomials(columns, xi, limits):
    """Real stacked columns of every free monomial, component by component."""
    free = [columns[..., i] * xi[:, None] ** k for i, limit in enumerate(limits) for k in range(limit + 1)]
    return stacked(np.stack(free, axis=2))


def structure(seed, *, ports=2, modes=6, lines=1000, level=0.01):
    """(problem, a fraction of the truth): modes from 5 to 1000 Hz, log-spaced lines, relative noise."""
    omega = 2 * np.pi * np.geomspace(4, 1200, lines)
    truth = random_modal_system(seed, ports, ports, modes).response(1j * omega)
    values = noisy(np.random.default_rng([seed, 1]), truth, level)
    problem = FractionProblem(omega, values, 2 * modes, Weight(100 / np.abs(truth)))
    return problem, retract(problem, truth, identity(problem), steps=8)


def small_problem(seed, dt, feedthrough):
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(1, 3000, 40))
    poles = -rng.uniform(1, 60, 5) + 1j * rng.uniform(100, 2500, 5)
    points = 1j * omega if dt is None else np.exp(1j * omega * dt)
    poles = poles if dt is None else np.exp(poles * dt)
    values = gaussian(rng, 2, 5) / (points[:, None, None] - poles) @ gaussian(rng, 5, 3)
    weight = Weight(rng.uniform(0.5, 2, values.shape), output=gaussian(rng, 2, 2), matrix=gaussian(rng, 6, 6))
    return FractionProblem(omega, values, 5, weight, dt=dt, feedthrough=feedthrough)


def seen(columns, fraction):
    """columns vec([D; N]) on the lines, real parts above imaginary parts."""
    both = np.concatenate([fraction.denominators, fraction.numerators], axis=1).transpose(0, 2, 1)
    return stacked(columns @ both.reshape(len(both), -1, 1))[:, 0]


# the pair of bases


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_pair_is_biorthonormal_and_spans_all_polynomials(dt):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        limits = np.array([3, -1, 5, 4, 3])
        xi, _ = polynomial_nodes(np.sort(rng.uniform(1, 2500, 50)), dt)
        trial = gaussian(rng, 50, 2, 5)
        test = trial + 0.5 * gaussian(rng, 50, 2, 5)
        pair = biorthonormal_polynomials(trial, test, xi, limits)
        assert pair.size == 4 + 6 + 5 + 4
        assert pair.condition - 1 <= 1e-11
        np.testing.assert_allclose(pair.tests.T @ pair.values, np.eye(pair.size), atol=1e-11)
        # The recursion, which alone knows the polynomials, gives these values back; no component goes beyond its limit.
        at_nodes = pair.polynomials(xi)
        np.testing.assert_allclose(stacked(trial @ at_nodes), pair.values, atol=1e-10 * np.abs(pair.values).max())
        assert not np.any(at_nodes[:, 1])
        for values, columns in ((pair.values, trial), (pair.tests, test)):
            free = monomials(columns, xi, limits)
            missing = values - free @ np.linalg.lstsq(free, values, rcond=None)[0]
            assert np.abs(missing).max() <= 1e-9 * np.abs(values).max()


def test_both_sides_are_scaled_equally_and_units_scale_the_pair():
    rng = np.random.default_rng(0)
    xi, _ = polynomial_nodes(np.linspace(1, 9, 40), None)
    limits = np.array([4, 3])
    trial, test = gaussian(rng, 40, 1, 2), gaussian(rng, 40, 1, 2)
    pair = biorthonormal_polynomials(trial, test, xi, limits)
    np.testing.assert_allclose(np.linalg.norm(pair.values[:, :1]), np.linalg.norm(pair.tests[:, :1]), rtol=1e-12)
    scaled = biorthonormal_polynomials(trial * 2.0**60, test * 2.0**-40, xi, limits)
    np.testing.assert_array_equal(scaled.values, pair.values)
    np.testing.assert_array_equal(scaled.tests, pair.tests)


@pytest.mark.parametrize("limit", [0, 5])
def test_breakdown_is_raised_not_divided_by(limit):
    """trial 1, test exp(j theta): the first cosine is cos(theta)."""
    xi, _ = polynomial_nodes(np.linspace(1, 9, 40), None)
    trial, limits = np.ones((40, 1, 1)), np.array([limit])
    near = biorthonormal_polynomials(trial, trial * np.exp(1j * (np.pi / 2 - 1e-4)), xi, limits)
    assert near.cosine == pytest.approx(1e-4, rel=1e-6)
    assert near.condition - 1 <= 1e-11
    for first, test, message in [
        (trial, 1j * trial, "the tests don't see"),
        (trial, 0 * trial, "of the tests is a combination"),
        (0 * trial, trial, "of the trial side is a combination"),
    ]:
        with pytest.raises(BreakdownError, match=message):
            biorthonormal_polynomials(first, test, xi, limits)
    assert issubclass(BreakdownError, np.linalg.LinAlgError)


def test_bad_columns_are_named():
    xi, ones = 1j * np.linspace(0.1, 1, 4), np.ones((4, 1, 2))
    for arguments, message in [
        ((ones, ones[:3], xi, np.array([0, 0])), "`trial` and `test` must both have shape"),
        ((ones, ones, xi, np.array([0])), "b = 1 from `limits`"),
        ((ones, ones, xi, np.array([4, 4])), "10 coefficients where the data give 8"),
        ((ones, ones * np.nan, xi, np.array([0, 0])), "`test` must be finite"),
    ]:
        with pytest.raises(InputError, match=message):
            biorthonormal_polynomials(*arguments)


# the step


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("dt", [None, 1e-3])
def test_step_solves_the_oblique_equations(dt, feedthrough):
    """Judge: monomials, made orthonormal for A by QR, and a dense solve; 5 seeds of 5."""
    for seed in range(5):
        problem = small_problem(seed, dt, feedthrough)
        old, _ = sk_step(problem, gaussian(np.random.default_rng(seed), 40, 3, 3))
        A, J = (problem.regressor(old.denominators, response) for response in (problem.values, old.response))
        xi, limits, start = problem.xi, problem.limits, problem.leading != 0
        leading = stacked(np.sum(A[..., start] * xi[:, None, None] ** (limits[start] + 1), axis=2)[..., None])[:, 0]
        free, tests = monomials(A, xi, limits), np.linalg.qr(monomials(J, xi, limits))[0]
        basis = np.linalg.qr(free)[0]
        solution = leading - basis @ np.linalg.solve(tests.T @ basis, tests.T @ leading)  # A x on the lines

        fraction, condition = iv_step(problem, old)
        reached = seen(A, fraction)
        assert np.linalg.norm(reached - solution) <= 1e-8 * np.linalg.norm(solution)
        assert condition - 1 <= 1e-10


def test_fixed_points_are_the_stationary_points():
    """Anywhere, the step is the part of the residual in the tangent space, seen obliquely: one is 0 as the other is."""
    for seed in range(5):
        problem = small_problem(seed, None, False)
        old, _ = sk_step(problem, gaussian(np.random.default_rng(seed), 40, 3, 3))
        pair, residual = instrumental_pair(problem, old), stacked(problem.residual(old.response)[..., None])[:, 0]
        tangent = np.linalg.qr(pair.tests)[0].T @ residual
        slope = gauss_newton_direction(problem, old).slope
        assert np.linalg.norm(tangent) == pytest.approx(slope * np.linalg.norm(residual), rel=1e-8)
        A = problem.regressor(old.denominators, problem.values)
        assert np.linalg.norm(seen(A, old) - residual) <= 1e-10 * np.linalg.norm(residual)
        moved, _ = iv_step(problem, old)
        wanted = residual - pair.values @ pair.project(residual)
        assert np.linalg.norm(seen(A, moved) - wanted) <= 1e-8 * np.linalg.norm(wanted)


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(5)])
def test_the_optimum_stays_where_it_is_and_sk_leaves_it(seed):
    """5 seeds of 5, 1 % noise."""
    problem, start = structure(seed, lines=200)
    best = fit_fraction(problem, start=start, method="lm", rtol=1e-16).fraction
    slope = gauss_newton_direction(problem, best).slope
    assert slope <= 1e-7
    moved, other = iv_step(problem, best)[0], sk_step(problem, best.denominators)[0]
    here, there = (relative_error(one.response, best.response) for one in (moved, other))
    assert here <= 1e-6
    assert there >= 100 * here
    assert problem.cost(other) >= (1 + 1e-4) * problem.cost(best)


def contraction(problem, best):
    """Spectral radius of the derivative of iv_step at a fixed point, by differences, in tangent coordinates."""
    basis = problem.basis(best.denominators, best.response)
    size = 1e-5 * np.linalg.norm(problem.residual(best.response))

    def coordinates(fraction):
        equation = best.response @ fraction.denominators - fraction.numerators
        return basis.project(problem.weight.apply(equation @ np.linalg.inv(best.denominators))) / size

    here = coordinates(iv_step(problem, best)[0])
    moved = (best.moved(size, problem.split(basis.evaluate(basis.xi, one))) for one in np.eye(basis.size))
    derivative = np.stack([coordinates(iv_step(problem, one)[0]) - here for one in moved], axis=1)
    return np.abs(np.linalg.eigvals(derivative)).max()


@pytest.mark.parametrize(("seeds", "lines", "attracting"), [((0, 3), 100, 1), slow(range(5), 200, 3)])
def test_it_converges_from_nearby_exactly_where_the_optimum_attracts(seeds, lines, attracting):
    """2x2, order 12, 1 % noise: of 200 lines 3 seeds of 5 attract, of 100 one of 2; the condition number stays one on all."""
    attract = []
    for seed in seeds:
        problem, start = structure(seed, lines=lines)
        best = fit_fraction(problem, start=start, method="lm", rtol=1e-14).fraction
        basis = problem.basis(best.denominators, best.response)
        one = np.random.default_rng(seed).normal(size=basis.size)
        one *= 0.01 * np.linalg.norm(problem.residual(best.response)) / np.linalg.norm(one)
        fraction, slopes, conditions = best.moved(1.0, problem.split(basis.evaluate(basis.xi, one))), [], []
        for _ in range(40):
            slopes.append(gauss_newton_direction(problem, fraction).slope ** 2)
            if slopes[-1] <= 1e-10:
                break
            fraction, condition = iv_step(problem, fraction)
            conditions.append(condition)
        radius = contraction(problem, best)
        assert max(conditions) - 1 <= 1e-8
        assert (slopes[-1] <= 1e-10) == (radius < 1)
        attract.append(radius < 1)
    assert sum(attract) == attracting


def test_exact_data_are_reproduced():
    problem, truth = structure(2, lines=300)
    exact = dataclasses.replace(problem, values=truth.response)
    pair = instrumental_pair(exact, truth)
    assert pair.cosine >= 1 - 1e-8
    assert relative_error(iv_step(exact, truth)[0].response, truth.response) <= 1e-8


@pytest.mark.parametrize(
    ("order", "seed", "steps", "lines", "least"),
    [(16, 0, 1, 60, 1e-5), slow(40, 0, 1, 100, 1e-5), *(slow(40, seed, 4, 1000, 1e-6) for seed in range(5))],
)
def test_condition_number_one_at_high_orders(order, seed, steps, lines, least):
    """Noisy 4x4 data: no breakdown in any step from the optimum nor from the truth."""
    problem, truth = structure(seed, ports=4, modes=order // 2, lines=lines)
    best = fit_fraction(problem, start=truth, method="lm").fraction
    for fraction in (best, truth):
        for _ in range(steps):
            pair = instrumental_pair(problem, fraction)
            assert pair.cosine >= least
            assert pair.condition - 1 <= 1e-8
            np.testing.assert_allclose(pair.tests.T @ pair.values, np.eye(8 * order), atol=1e-8)
            fraction = problem.split(pair.evaluate(pair.xi, *pair.monic(problem.leading)[:3]))
