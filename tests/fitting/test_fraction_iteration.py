"""Fits of fractions that are known by their values: known systems, methods, units, status."""

import dataclasses
import pickle

import numpy as np
import pytest

from robustid.errors import InputError
from robustid.fitting import FitStatus, FractionProblem, NodeFraction, Weight, fit_fraction, retract
from robustid.fitting.fraction.fraction_model import realise
from robustid.fitting.fraction.node_fraction import staircase
from support.mfd_systems import (
    gaussian,
    identity,
    noisy,
    poles_and_residues,
    problem_of,
    random_modal_system,
    relative_error,
)
from support.pairwise import every_two
from support.refusals import refused


def structure(seed, *, level=0.01, modes=20, ports=4, lines=1000):
    """The benchmark of the noisy cold start: modes from 5 to 1000 Hz, zeta 0.5 to 2 %, log-spaced lines."""
    system = random_modal_system(seed, ports, ports, modes)
    omega = 2 * np.pi * np.geomspace(4, 1200, lines)
    truth = system.response(1j * omega)
    return omega, truth, noisy(np.random.default_rng(1000 + seed), truth, level)


SIZES = [(1, 1, 4), (2, 3, 7), (3, 2, 7), (3, 4, 2), (2, 2, 5), (4, 4, 13)]


@pytest.mark.parametrize(
    ("ny", "nu", "order", "dt", "feedthrough", "form"), every_two(SIZES, [None, 1e-3], [False, True], ["right", "left"])
)
def test_exact_data_give_back_the_system(ny, nu, order, dt, feedthrough, form):
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
        here, beside = np.abs(np.linalg.det(found.denominator(np.array([pole, 1.01 * pole]))))
        assert here <= 1e-6 * beside
    far = 1e6 * found.scale
    np.testing.assert_allclose(found.denominator(np.array([far]))[0] / 1e24, np.eye(3), atol=1e-4)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.response(omega), found.response(omega))


SMALL = {"modes": 4, "ports": 2, "lines": 200}


@pytest.mark.parametrize(("seeds", "order", "size"), [pytest.param(4, 40, {}, marks=pytest.mark.slow), (5, 12, SMALL)])
def test_noise_free_structures_from_a_cold_start(seeds, order, size):
    """At their order, and at a higher one: what the data do not have is deflated."""
    for seed in range(seeds):
        omega, truth, _ = structure(seed, **size)
        fit = fit_fraction(FractionProblem(omega, truth, order, Weight.relative(truth)))
        assert fit.status is FitStatus.EXACT, seed
        assert relative_error(fit.fraction.response, truth) <= 1e-8
        assert max(step.condition for step in fit.history) - 1 <= 1e-10


@pytest.mark.parametrize(
    ("seed", "ports", "modes", "lines"),
    [(0, 2, 8, 400), *(pytest.param(k, 4, 20, 1000, marks=pytest.mark.slow) for k in (0, 1, 2))],
)
def test_noisy_structure_reaches_the_statistical_limit_from_a_good_start(seed, ports, modes, lines):
    omega, truth, values = structure(seed, ports=ports, modes=modes, lines=lines)
    order, coefficients = 2 * modes, 4 * modes * ports
    exact = FractionProblem(omega, truth, order, Weight.relative(truth))
    good = retract(exact, truth, np.broadcast_to(np.eye(ports), truth.shape), steps=3)
    problem = FractionProblem(omega, values, order, Weight.relative(values))
    fit = fit_fraction(problem, denominators=good.denominators)
    assert fit.status.converged
    assert max(step.condition for step in fit.history) - 1 <= 1e-10  # every SK and every LM step
    # Likelihood ratio: cost(truth) - cost(fit) is half a chi-square with a degree for every coefficient, in units of the
    # variance 1e-4.
    gain = (problem.cost(good) - fit.cost) / 1e-4
    assert abs(gain - coefficients / 2) <= 5 * np.sqrt(2 * coefficients) / 2 + 0.05 * coefficients / 2
    assert relative_error(fit.fraction.response, truth) <= 0.8e-2 * np.sqrt(coefficients / (2 * lines * ports**2))
    found = realise(problem, fit.fraction)
    assert found.error <= 1e-8
    # Quadratic convergence: the curved coordinates don't slow it down.
    assert sum(step.method == "lm" for step in fit.history) <= 5
    lm = [step.slope for step in fit.history if step.method == "lm"]
    assert lm == sorted(lm, reverse=True)


def test_a_fit_is_never_worse_than_its_start_and_says_when_it_has_not_converged():
    omega, _, values = structure(1, modes=4, ports=2, lines=100, level=0.3)
    problem = FractionProblem(omega, values, 8, Weight.relative(values))
    start = fit_fraction(problem, method="sk", steps=3)
    assert start.status is FitStatus.LIMIT
    assert not start.status.converged
    fit = fit_fraction(problem, start=start.fraction)
    assert fit.cost <= start.cost
    assert fit.cost == problem.cost(fit.fraction)
    costs = [step.cost for step in fit.history if step.method == "lm"]
    assert costs == sorted(costs, reverse=True)
    rng = np.random.default_rng(0)
    bad = fit_fraction(problem, start=start.fraction, denominators=gaussian(rng, 100, 2, 2), method="sk", steps=2)
    assert bad.cost <= start.cost


@pytest.mark.parametrize(("time", "amplitude"), [(60, 0), (0, -60), (-60, 60)])
def test_units_scale_the_fit(time, amplitude):
    omega, _, values = structure(2, modes=3, ports=2, lines=60)

    def fitted(omega, values):
        problem = FractionProblem(omega, values, 5, Weight.relative(values))
        fit = fit_fraction(problem, steps=4)
        return fit, realise(problem, fit.fraction)

    plain, model = fitted(omega, values)
    scaled, scaled_model = fitted(omega * 2.0**time, values * 2.0**amplitude)
    assert scaled.status == plain.status
    assert scaled.cost == pytest.approx(plain.cost, rel=1e-9)
    for one, other, size in (
        (scaled.fraction.response * 2.0**-amplitude, plain.fraction.response, np.abs(values).min()),
        (np.sort_complex(scaled_model.poles) * 2.0**-time, np.sort_complex(model.poles), np.abs(model.poles).max()),
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * size)


def test_masked_lines_have_no_say():
    omega, truth, _ = structure(3, modes=4, ports=2, lines=120)
    spoiled = truth.copy()
    spoiled[50:55] *= 7.0
    weight = Weight.relative(truth).scaled((np.arange(120) < 50) | (np.arange(120) >= 55))
    fit = fit_fraction(FractionProblem(omega, spoiled, 8, weight))
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
    with pytest.raises(InputError, match="nonsingular at every frequency point"):
        fit_fraction(problem, denominators=np.zeros((20, 2, 2)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.order = 5
    assert not NodeFraction(values, values).numerators.flags.writeable


@pytest.mark.parametrize(
    ("order", "priority", "pivots", "step", "degrees"),
    [
        (3, range(5), [], 1, [1, 1, 1, 0, 0]),
        (7, range(3), [], 1, [3, 2, 2]),
        (7, range(4), [1, 2, 3], 1, [1, 2, 2, 2]),
        (12, [3, 1, 0, 2], [], 2, [2, 4, 2, 4]),
    ],
)
def test_degrees_differ_as_little_as_they_can(order, priority, pivots, step, degrees):
    assert staircase(order, priority, pivots, step=step).tolist() == degrees


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
    refused('"sk-relaxed"', fit_fraction, problem, method="sk+newton")
    refused("`start` is needed", fit_fraction, problem, method="lm")
