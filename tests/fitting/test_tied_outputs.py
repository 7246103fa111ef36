"""Outputs tied to the inputs: their least squares, and what a mode is worth, against brute force."""

import numpy as np
import pytest

from robustid.fitting import FractionProblem, Weight
from robustid.fitting.modal.modal_fit import TiedOutputs, symmetric_matrices
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.real_modes import RealModes
from support.pairwise import every_two

OMEGA = np.linspace(0.2, 1.9, 25)


def problem_of(weighted, feedthrough):
    """Noisy symmetric data of three modes, with weights that mix the entries or one number an entry."""
    rng = np.random.default_rng(0)
    b = rng.standard_normal((3, 2))
    s = 1j * OMEGA[:, None, None]
    values = sum(np.outer(x, x) / (s**2 + 0.02 * w * s + w**2) for x, w in zip(b, (0.5, 1.0, 1.5), strict=True))
    values = values + 0.05 * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    entries = rng.uniform(0.5, 2, values.shape)
    weight = Weight(entries, matrix=rng.standard_normal((4, 4)) if weighted == "mixed" else None)
    return FractionProblem(OMEGA, values, 6, weight, feedthrough=feedthrough)


def model_of(kind, problem):
    rng = np.random.default_rng(1)
    hz, none = np.array([0.5, 1.0, 1.5]) / problem.scale, np.zeros((0, 2))
    if kind == "real":
        inputs = rng.standard_normal((3, 2))
        return RealModes(-0.01 * hz, hz**2, inputs, none, none.astype(bool), discrete=False, power=0).normalised()
    blocks = [np.array([[-0.01 * w, w], [-w, -0.01 * w]]) for w in hz]
    A = np.kron(np.eye(3), np.ones((2, 2)))
    A[A > 0] = np.concatenate([np.ravel(block) for block in blocks])
    return BlockModel.of(A, rng.standard_normal((6, 2)), discrete=False)


def brute_force(problem, model):
    """Cost and [C D] of least squares over the tied coefficients, written out."""
    states = model.states(problem.xi)
    gains = [(tie, np.zeros((2, 2))) for tie in model.tied_outputs()]
    if problem.feedthrough:
        gains += [(np.zeros((2, model.order)), D) for D in symmetric_matrices(2)]
    columns = np.stack([problem.weight.apply(C @ states + D).ravel() for C, D in gains], axis=1)
    target = problem.weight.apply(problem.values).ravel()
    system, right = np.vstack([columns.real, columns.imag]), np.concatenate([target.real, target.imag])
    found = np.linalg.lstsq(system, right, rcond=None)[0]
    cost = float(np.sum((right - system @ found) ** 2))
    return cost, sum(x * np.hstack(gain) for x, gain in zip(found, gains, strict=True))


@pytest.mark.parametrize(
    ("kind", "weighted", "feedthrough"), every_two(["real", "blocks"], ["entries", "mixed"], [False, True])
)
def test_least_squares_and_importance(kind, weighted, feedthrough):
    problem = problem_of(weighted, feedthrough)
    model = model_of(kind, problem)
    outputs = TiedOutputs(problem)
    fitted = outputs.fitted(model)
    cost, matrix = brute_force(problem, model)
    assert np.isclose(fitted.cost, cost, rtol=1e-10)
    assert np.allclose(np.hstack([fitted.C, fitted.D]), matrix, rtol=1e-8, atol=1e-10)
    assert fitted.condition - 1 < 1e-10
    rises = [brute_force(problem, model.without(k))[0] - cost for k in range(3)]
    assert np.allclose(outputs.importance(fitted), rises, rtol=1e-7)


@pytest.mark.parametrize("kind", ["real", "blocks"])
def test_directions_are_the_derivative_of_the_projected_residual(kind):
    """In the sense of variable projection: the gradient of the cost, by central differences."""
    problem = problem_of("mixed", True)
    model, outputs, h = model_of(kind, problem), TiedOutputs(problem), 1e-6
    fitted = outputs.fitted(model)
    gradient = -2 * outputs.directions(fitted).T @ fitted.residual.ravel()
    for k, slope in enumerate(gradient):
        step = h * np.eye(gradient.size)[k]
        change = (outputs.fitted(model.moved(step)).cost - outputs.fitted(model.moved(-step)).cost) / (2 * h)
        assert np.isclose(slope, change, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())
