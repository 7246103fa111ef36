"""Conditions on the response that the outputs keep: held to rounding, and the projection against differences."""

import numpy as np
import pytest

from robustid.fitting import FractionProblem, RollOff, StaticGain, Weight, Zero, subspace_estimate
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.state_refinement import Outputs, refine
from support.mfd_systems import noisy, random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 80)
GAIN = np.array([[0.3, -0.2], [0.1, 0.4], [-0.5, 0.2]])
WEIGHTS = {
    "entries": lambda rng, shape: Weight(rng.uniform(0.5, 2, shape)),
    "alike": lambda rng, shape: Weight(np.ones(shape)),
    "separable": lambda rng, shape: Weight(np.ones(shape), output=rng.standard_normal((shape[0], 3, 3))),
}
# What is asked in s and in z, and whether with a feed-through.
ASKED = {
    "gain": ([StaticGain(GAIN)], None, False),
    "gain in z, through": ([StaticGain(GAIN)], 2e-4, True),
    "zero": ([Zero(-3e3)], None, True),
    "zero at a complex point": ([Zero(-3e3 + 1e4j)], None, False),
    "direction": ([Zero(0.4 + 1j, [1.0, -2.0, 3.0])], 2e-4, False),
    "roll-off": ([RollOff(3)], None, False),
    "all": ([StaticGain(GAIN), RollOff(2), Zero(1e3, [1.0, 2.0, 0.5])], None, False),
}


def posed(asked, kind, *, transposed):
    """A 3x2 problem of order 9 with its conditions, or the transposed one, and a start."""
    constraints, dt, feedthrough = ASKED[asked]
    points = 1j * OMEGA if dt is None else np.exp(1j * OMEGA * dt)
    values = noisy(np.random.default_rng(1), random_modal_system(0, 3, 2, 4, dt=dt).response(points), 0.05)
    values = values / np.abs(values).max()
    weight = WEIGHTS[kind](np.random.default_rng(2), values.shape)
    problem = FractionProblem(OMEGA, values, 9, weight, dt=dt, feedthrough=feedthrough)
    for constraint in constraints:
        problem = constraint.apply(problem)
    found = subspace_estimate(values, points, 9, domain="s" if dt is None else "z")
    A, B = (found.A.T, found.C.T) if transposed else (found.A, found.B)
    start = BlockModel.of(A / problem.scale, B / problem.scale, discrete=dt is not None)
    return problem.transposed() if transposed else problem, start


def left_over(problem, fitted):
    """Largest remainder of the conditions, from the matrices alone, relative to the response."""
    A, B = fitted.model.matrices()
    worst = 0.0
    for held in problem.response_conditions:
        if np.isinf(held.point):
            value = fitted.C @ np.linalg.matrix_power(A, held.power) @ B
        else:
            value = fitted.C @ np.linalg.solve(held.point * np.eye(len(A)) - A, B.astype(complex)) + fitted.D
        worst = max(worst, np.abs(held.left @ value @ held.right - held.value).max())
    return worst / np.abs(fitted.response).max()


@pytest.mark.parametrize(
    ("asked", "kind", "transposed"),
    [
        ("gain", "entries", False),
        ("gain in z, through", "separable", True),
        ("zero", "alike", True),
        ("zero at a complex point", "entries", True),
        ("direction", "alike", False),
        ("roll-off", "separable", False),
        ("roll-off", "entries", True),
        ("all", "entries", False),
        ("all", "alike", True),
    ],
)
def test_conditions_hold_and_the_gradient_is_that_of_differences(asked, kind, transposed):
    problem, start = posed(asked, kind, transposed=transposed)
    outputs = Outputs(problem)
    fitted = outputs.fitted(start)
    assert left_over(problem, fitted) <= 1e-10
    assert fitted.condition - 1 <= 1e-10
    assert fitted.cost == pytest.approx(np.linalg.norm(problem.residual(fitted.response)) ** 2, rel=1e-9)
    options = {"dt": problem.dt, "feedthrough": problem.feedthrough}
    free = FractionProblem(OMEGA, problem.values, 9, problem.weight, **options)
    assert fitted.cost >= Outputs(free).fitted(start).cost
    gradient = -2 * outputs.directions(fitted).T @ fitted.residual.ravel()
    for k, size in enumerate(1e-5 * start.reach(problem.xi)):
        step = np.zeros(gradient.size)
        step[k] = size
        rise = outputs.fitted(start.moved(step)).cost - outputs.fitted(start.moved(-step)).cost
        assert rise / (2 * size) == pytest.approx(gradient[k], abs=1e-5 * np.abs(gradient).max())


def test_the_outputs_are_the_best_that_meet_the_conditions():
    """Against one dense least-squares problem with Lagrange multipliers."""
    problem, start = posed("all", "entries", transposed=False)
    fitted = Outputs(problem).fitted(start)
    states = start.states(problem.xi)
    A, B = start.matrices()
    rows = [np.kron(np.eye(3), column.T) for column in (np.linalg.solve(-A, B), B)]
    at = np.linalg.solve(1e3 / problem.scale * np.eye(9) - A, B)
    rows.append(np.kron([1.0, 2.0, 0.5], at.T))
    E, e = np.concatenate(rows), np.concatenate([GAIN.ravel(), np.zeros(6 + 2)])
    design, target = [], []
    for i in range(3):
        for j in range(2):
            weight = problem.weight.entries[:, i, j]
            row = np.zeros((OMEGA.size, 27), dtype=complex)
            row[:, 9 * i : 9 * i + 9] = weight[:, None] * states[:, :, j]
            design += [row.real, row.imag]
            target += [(weight * problem.values[:, i, j]).real, (weight * problem.values[:, i, j]).imag]
    X, t = np.concatenate(design), np.concatenate(target)
    unit = np.linalg.norm(X, axis=0)
    KKT = np.block([[(X / unit).T @ (X / unit), (E / unit).T], [E / unit, np.zeros((len(E), len(E)))]])
    found = np.linalg.lstsq(KKT, np.concatenate([(X / unit).T @ t, e]), rcond=None)[0][:27] / unit
    assert fitted.cost == pytest.approx(np.sum((X @ found - t) ** 2), rel=1e-8)


@pytest.mark.parametrize("kind", ["entries", "separable"])
def test_importance_is_the_rise_of_the_criterion_with_the_conditions(kind):
    problem, start = posed("gain", kind, transposed=False)
    outputs = Outputs(problem)
    fitted = outputs.fitted(start)
    for block, rise in enumerate(outputs.importance(fitted)):
        assert rise == pytest.approx(outputs.fitted(start.without(block)).cost - fitted.cost, rel=1e-6)


def test_every_step_of_a_refinement_keeps_them():
    problem, start = posed("all", "entries", transposed=False)
    found = refine(problem, start.resolved(problem.xi), stable=True, limit=20)
    costs = [step.cost for step in found.history]
    assert len(costs) > 2
    assert np.all(np.diff(costs) < 0)
    assert left_over(problem, found.fitted) <= 1e-10
    assert np.all(found.fitted.model.distances > 0)


def test_conditions_that_contradict_each_other_cost_infinitely_much():
    problem, start = posed("gain", "entries", transposed=False)
    both = StaticGain(2 * GAIN).apply(problem)
    assert np.isinf(Outputs(both).fitted(start).cost)
