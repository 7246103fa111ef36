"""Criterion, iterations and realisation of matrix fractions, against brute force and known systems."""

import dataclasses
import pickle

import numpy as np
import pytest

from robustid.errors import InputError
from robustid.mfd import FitStatus, Weight
from robustid.mfd.iteration import fit_fraction
from robustid.mfd.model import realise
from robustid.mfd.node_fraction import NodeFraction, staircase
from robustid.mfd.problem import FractionProblem
from robustid.mfd.steps import gauss_newton_direction, retract, sk_step
from support.mfd_systems import noisy, random_modal_system, relative_error


def vec(matrix):
    return matrix.T.ravel()


def gaussian(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def poles_and_residues(seed, ny, nu, order, lines=150, dt=None, feedthrough=False):
    """A random system by partial fractions: (omega, response, the response at any points s or z)."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(1, 3000, lines))
    pairs = order // 2
    upper = -rng.uniform(1, 60, pairs) + 1j * rng.uniform(100, 2500, pairs)
    poles = np.concatenate([upper, upper.conj(), -rng.uniform(1, 60, order - 2 * pairs)])
    shapes, drives = gaussian(rng, ny, pairs), gaussian(rng, pairs, nu)
    real = order - 2 * pairs
    shapes = np.hstack([shapes, shapes.conj(), rng.normal(size=(ny, real))])
    drives = np.vstack([drives, drives.conj(), rng.normal(size=(real, nu))])
    constant = rng.normal(size=(ny, nu)) * feedthrough * (0.01 if dt is None else 1.0)
    poles = poles if dt is None else np.exp(poles * dt)

    def response(points):
        return (shapes / (np.asarray(points)[:, None, None] - poles)) @ drives + constant

    return omega, response(1j * omega if dt is None else np.exp(1j * omega * dt)), response


def structure(seed, *, level=0.01, modes=20, ports=4, lines=1000):
    """The benchmark of the noisy cold start: modes from 5 to 1000 Hz, zeta 0.5 to 2 %, log-spaced lines."""
    system = random_modal_system(seed, ports, ports, modes)
    omega = 2 * np.pi * np.geomspace(4, 1200, lines)
    truth = system.response(1j * omega)
    return omega, truth, noisy(np.random.default_rng(1000 + seed), truth, level)


# criterion


def test_weight_is_the_kronecker_product_it_stands_for():
    rng = np.random.default_rng(0)
    lines, ny, nu = 4, 3, 2
    weight = Weight(
        rng.uniform(0, 2, (lines, ny, nu)),
        output=gaussian(rng, lines, ny, ny),
        input=gaussian(rng, lines, nu, nu),
        matrix=gaussian(rng, lines, ny * nu, ny * nu),
    )
    residual, inverse, left = gaussian(rng, lines, ny, nu), gaussian(rng, lines, nu, nu), gaussian(rng, lines, ny, 5)
    columns = weight.linearised(inverse.transpose(0, 2, 1), left)
    for k in range(lines):
        W = weight.matrix[k] @ np.diag(vec(weight.entries[k])) @ np.kron(weight.input[k].T, weight.output[k])
        np.testing.assert_allclose(weight.apply(residual)[k], W @ vec(residual[k]), rtol=1e-12)
        np.testing.assert_allclose(columns[k], W @ np.kron(inverse[k].T, left[k]), rtol=1e-11)
    turned = weight.transposed().apply(residual.transpose(0, 2, 1))
    np.testing.assert_allclose(np.sum(np.abs(turned) ** 2), np.sum(np.abs(weight.apply(residual)) ** 2), rtol=1e-12)


def test_covariance_gives_the_likelihood():
    rng = np.random.default_rng(1)
    root = gaussian(rng, 5, 6, 6) * 10.0 ** rng.uniform(-6, 6, (5, 6, 1))
    covariance = root @ root.conj().transpose(0, 2, 1)
    residual = gaussian(rng, 5, 3, 2)
    weighted = Weight.from_covariance(covariance, 3, 2).apply(residual)
    for k in range(5):
        wanted = np.linalg.norm(np.linalg.solve(root[k], vec(residual[k]))) ** 2
        assert np.linalg.norm(weighted[k]) ** 2 == pytest.approx(wanted, rel=1e-8)


def test_bands_and_masks_multiply():
    weight = Weight(np.ones((4, 1, 2)))
    banded = weight.banded(np.array([1.0, 2.0, 3.0, 4.0]), [(2, 3, 10.0), (3, 9, 0.5)])
    np.testing.assert_array_equal(banded.entries[:, 0, 0], [1, 10, 5, 0.5])
    masked = banded.scaled([True, False, True, True])
    np.testing.assert_array_equal(masked.entries[:, 0, 1], [1, 0, 5, 0.5])


def test_bad_weights_are_named():
    ones = np.ones((3, 2, 2))
    for arguments, message in [
        ({"entries": -ones}, "must be >= 0"),
        ({"entries": 0 * ones}, "mask everything"),
        ({"entries": ones, "output": np.ones((2, 2, 2))}, r"`output` must have shape \(F, 2, 2\) with F = 3"),
        ({"entries": ones, "matrix": np.full((4, 4), np.nan)}, "`matrix` must be finite"),
    ]:
        with pytest.raises(InputError, match=message):
            Weight(**arguments)
    with pytest.raises(InputError, match=r"zero at frequency point 1, entry \(0, 1\)"):
        Weight.relative(np.where(np.arange(12).reshape(3, 2, 2) == 5, 0, 1.0))
    with pytest.raises(InputError, match="positive definite; at frequency point 0"):
        Weight.from_covariance(np.ones((3, 4, 4)), 2, 2)
    with pytest.raises(InputError, match="no frequency point lies between 7 and 9"):
        Weight(ones).banded(np.arange(3.0), [(7, 9, 2.0)])
    with pytest.raises(InputError, match="`factors` must have shape"):
        Weight(ones).scaled(np.ones(2))


def test_weights_of_single_entries_are_the_column_lengths():
    rng = np.random.default_rng(2)
    parts = {"output": gaussian(rng, 5, 2, 2), "input": gaussian(rng, 5, 3, 3), "matrix": gaussian(rng, 5, 6, 6)}
    weight = Weight(rng.uniform(0.5, 2, (5, 2, 3)), **parts)
    for k in range(5):
        W = np.kron(parts["input"][k].T, parts["output"][k])
        columns = np.linalg.norm(parts["matrix"][k] @ (vec(weight.entries[k])[:, None] * W), axis=0)
        np.testing.assert_allclose(vec(weight.entrywise[k]), columns, rtol=1e-13)
        assert weight.size[k] == pytest.approx(np.sqrt(np.mean(columns**2)), rel=1e-13)


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


# fits


CASES = [(1, 1, 4), (2, 3, 7), (3, 2, 7), (3, 4, 2), (2, 2, 5), (4, 4, 13)]


@pytest.mark.parametrize("form", ["right", "left"])
@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("dt", [None, 1e-3])
@pytest.mark.parametrize("size", CASES, ids=str)
def test_exact_data_give_back_the_system(size, dt, feedthrough, form):
    ny, nu, order = size
    omega, values, truth = poles_and_residues(3, ny, nu, order, dt=dt, feedthrough=feedthrough)
    problem = FractionProblem(omega, values, order, Weight.relative(values), dt=dt, feedthrough=feedthrough)
    problem = problem if form == "right" else problem.transposed()
    fit = fit_fraction(problem)
    assert fit.status is FitStatus.EXACT
    found = realise(problem, fit.fraction, form=form)
    assert found.A.shape == (order, order)
    assert found.error <= 1e-8
    elsewhere = np.linspace(20.0, 2900.0, 31)
    points = 1j * elsewhere if dt is None else np.exp(1j * elsewhere * dt)
    N, D = found.numerator(points), found.denominator(points)
    quotient = N @ np.linalg.inv(D) if form == "right" else np.linalg.inv(D) @ N
    state_space = np.moveaxis(found.model(points, squeeze=False), -1, 0)
    for response in (found.response(elsewhere), quotient, state_space):
        assert relative_error(response, truth(points)) <= 1e-8
    assert np.all(found.model.D == 0) or feedthrough


def test_poles_are_those_of_the_system_and_D_is_monic():
    system = random_modal_system(5, 2, 3, 6)
    omega = 2 * np.pi * np.geomspace(4, 1200, 300)
    values = system.response(1j * omega)
    problem = FractionProblem(omega, values, 12, Weight.relative(values))
    found = realise(problem, fit_fraction(problem).fraction)
    for pole in system.poles:
        assert np.abs(found.poles - pole).min() <= 1e-8 * abs(pole)
        assert abs(np.linalg.det(found.denominator(np.array([pole]))[0])) <= 1e-6 * abs(
            np.linalg.det(found.denominator(np.array([1.01 * pole]))[0])
        )
    far = 1e6 * found.scale
    np.testing.assert_allclose(found.denominator(np.array([far]))[0] / 1e24, np.eye(3), atol=1e-4)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.response(omega), found.response(omega))


def test_noise_free_structures_from_a_cold_start():
    for seed in range(4):
        omega, truth, _ = structure(seed)
        fit = fit_fraction(FractionProblem(omega, truth, 40, Weight.relative(truth)))
        assert fit.status is FitStatus.EXACT, seed
        assert relative_error(fit.fraction.response, truth) <= 1e-8
        assert max(step.condition for step in fit.history) - 1 <= 1e-10


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_noisy_structure_reaches_the_statistical_limit_from_a_good_start(seed):
    omega, truth, values = structure(seed)
    exact = FractionProblem(omega, truth, 40, Weight.relative(truth))
    good = retract(exact, truth, np.broadcast_to(np.eye(4), truth.shape), steps=3)
    problem = FractionProblem(omega, values, 40, Weight.relative(values))
    fit = fit_fraction(problem, denominators=good.denominators)
    assert fit.status.converged
    assert max(step.condition for step in fit.history) - 1 <= 1e-10  # every SK and every LM step
    # Likelihood ratio: cost(truth) - cost(fit) is half a chi-square of 320 degrees, in units of the variance 1e-4.
    gain = (problem.cost(good) - fit.cost) / 1e-4
    assert abs(gain - 160) <= 5 * np.sqrt(640) / 2 + 0.05 * 160
    assert relative_error(fit.fraction.response, truth) <= 8e-4
    found = realise(problem, fit.fraction)
    assert found.error <= 1e-8
    # Quadratic convergence: the curved coordinates don't slow it down.
    assert sum(step.method == "lm" for step in fit.history) <= 5
    lm = [step.slope for step in fit.history if step.method == "lm"]
    assert lm == sorted(lm, reverse=True)


def test_a_fit_is_never_worse_than_its_start_and_says_when_it_has_not_converged():
    omega, _, values = structure(1, modes=6, ports=2, lines=200, level=0.3)
    problem = FractionProblem(omega, values, 12, Weight.relative(values))
    start = fit_fraction(problem, method="sk", steps=3)
    assert start.status is FitStatus.LIMIT
    assert not start.status.converged
    fit = fit_fraction(problem, start=start.fraction)
    assert fit.cost <= start.cost
    assert fit.cost == problem.cost(fit.fraction)
    costs = [step.cost for step in fit.history if step.method == "lm"]
    assert costs == sorted(costs, reverse=True)
    rng = np.random.default_rng(0)
    bad = fit_fraction(problem, start=start.fraction, denominators=gaussian(rng, 200, 2, 2), method="sk", steps=2)
    assert bad.cost <= start.cost


@pytest.mark.parametrize(("time", "amplitude"), [(60, 0), (-60, 0), (0, 60), (0, -60), (-60, 60)])
def test_units_scale_the_fit(time, amplitude):
    omega, _, values = structure(2, modes=4, ports=2, lines=120)

    def fitted(omega, values):
        problem = FractionProblem(omega, values, 7, Weight.relative(values))
        fit = fit_fraction(problem, steps=4)
        return fit, realise(problem, fit.fraction)

    plain, model = fitted(omega, values)
    scaled, scaled_model = fitted(omega * 2.0**time, values * 2.0**amplitude)
    assert scaled.status == plain.status
    assert scaled.cost == pytest.approx(plain.cost, rel=1e-9)
    np.testing.assert_allclose(
        scaled.fraction.response * 2.0**-amplitude, plain.fraction.response, rtol=1e-9, atol=1e-9 * np.abs(values).min()
    )
    np.testing.assert_allclose(
        np.sort_complex(scaled_model.poles) * 2.0**-time,
        np.sort_complex(model.poles),
        rtol=1e-9,
        atol=1e-9 * np.abs(model.poles).max(),
    )


def test_masked_lines_have_no_say():
    omega, truth, _ = structure(3, modes=4, ports=2, lines=120)
    spoiled = truth.copy()
    spoiled[50:55] *= 7.0
    weight = Weight.relative(truth).scaled((np.arange(120) < 50) | (np.arange(120) >= 55))
    fit = fit_fraction(FractionProblem(omega, spoiled, 8, weight))
    assert relative_error(fit.fraction.response, truth) <= 1e-8


def test_a_higher_order_than_the_data_have_is_deflated():
    for seed in range(5):
        omega, truth, _ = structure(seed, modes=4, ports=2, lines=200)
        problem = FractionProblem(omega, truth, 12, Weight.relative(truth))
        fit = fit_fraction(problem)
        assert fit.status is FitStatus.EXACT
        assert max(step.condition for step in fit.history) - 1 <= 1e-10
        assert relative_error(fit.fraction.response, truth) <= 1e-8


def test_bad_problems_are_named():
    omega, _, values = structure(0, modes=2, ports=2, lines=20)
    weight = Weight.relative(values)
    for change, message in [
        ({"order": 0}, "`order` must be at least 1"),
        ({"order": 41}, "`order` = 41 has 164 free coefficients.* 160 real equations"),
        ({"omega": omega[1:]}, "`values` must have shape"),
        ({"weight": Weight.relative(values[1:])}, "`weight` must have shape"),
        ({"values": np.where(values == values[0, 0, 0], np.nan, values)}, "`values` must be finite"),
        ({"dt": -1.0}, "`dt` must be positive"),
    ]:
        arguments = {"omega": omega, "values": values, "order": 4, "weight": weight, "dt": None} | change
        with pytest.raises(InputError, match=message):
            FractionProblem(**arguments)
    problem = FractionProblem(omega, values, 4, weight)
    with pytest.raises(InputError, match="nonsingular on every line"):
        fit_fraction(problem, denominators=np.zeros((20, 2, 2)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.order = 5
    assert staircase(3, range(5)).tolist() == [1, 1, 1, 0, 0]
    assert not NodeFraction(values, values).numerators.flags.writeable
