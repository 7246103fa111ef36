"""Cutting planes for passive gains: least distances against a solver, and the nearest gains against a semidefinite program."""

import control
import numpy as np
import pytest
import scipy.optimize

import robustid as rid
from robustid.passivity import passive_cuts, passive_fit
from support.cases import slow
from support.networks import foster, scattering


@pytest.mark.parametrize("seed", range(3))
def test_the_shortest_vector_of_a_polyhedron(seed):
    rng = np.random.default_rng(seed)
    rows, room = rng.standard_normal((6, 4)), -rng.uniform(0.1, 1.0, 6)
    rows[:, 0] = np.abs(rows[:, 0]) + 0.5  # so that there is one
    found = passive_cuts._least(rows, room)
    wanted = scipy.optimize.minimize(
        lambda y: y @ y, -np.ones(4), constraints={"type": "ineq", "fun": lambda y: room - rows @ y}, method="SLSQP"
    )
    assert np.all(rows @ found <= room + 1e-9)
    assert found @ found == pytest.approx(wanted.fun, rel=1e-5)


def test_no_vector_of_an_empty_polyhedron():
    assert passive_cuts._least(np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0])) is None


@pytest.mark.parametrize("kind", ["bounded real", pytest.param("positive real", marks=pytest.mark.slow)])
def test_the_nearest_passive_gains_are_those_of_the_semidefinite_program(kind):
    """A response that is beyond the limit by 0.1 to 1 %."""
    omega = np.geomspace(0.3, 300, 25)
    model = foster(np.random.default_rng(2), 1, 2, damping=0.05, resistance=1e-3)
    model = scattering(model) if kind == "bounded real" else model
    beyond = 1.004 if kind == "bounded real" else 1.0
    less = 0 if kind == "bounded real" else 3e-3
    active = control.StateSpace(model.A, model.B, beyond * model.C, beyond * model.D - less * np.eye(2), 0)
    assert not rid.prove_passive(active, kind=kind).holds
    data = rid.FrequencyResponse(omega, passive_fit.response_of(active, omega))
    fit = passive_fit._Fit(active, kind, data)
    cut, program = fit.of_cuts(), fit.of_gains(fit.squares)
    assert fit.cost(cut) == pytest.approx(fit.cost(program), rel=1e-3)
    touched = fit.touched()
    assert fit.cost(touched) <= fit.cost(cut)
    found = rid.passive.make_passive(active, kind=kind, response=data)
    assert found.passivity.holds
    assert fit.cost(found.model) <= 1.001 * fit.cost(touched)
    far = control.StateSpace(model.A, model.B, 2 * model.C, 2 * model.D - less * np.eye(2), 0)
    if kind == "bounded real":
        assert passive_fit._Fit(far, kind, data).touched() is None


def test_a_fit_that_is_almost_exact_stays_almost_exact():
    """What is beyond the limit by 1e-8 at infinity only, far from the data, costs next to nothing at the data."""
    omega = np.geomspace(0.3, 30, 60)
    plant = scattering(foster(np.random.default_rng(3), 2, 1, damping=0.02, resistance=0.0))
    data = rid.FrequencyResponse(omega, passive_fit.response_of(plant, omega))
    fit = control.StateSpace(plant.A, plant.B, plant.C, (1 + 1e-8) * plant.D, 0)
    assert not rid.prove_passive(fit).holds
    found = rid.passive.make_passive(fit, response=data)
    assert found.passivity.holds
    assert np.sqrt(np.mean(np.abs(passive_fit.response_of(found.model, omega) - data.values) ** 2)) < 2e-9


@pytest.mark.parametrize(
    ("seed", "damping"), [(0, 0.0), (1, 0.1), *(slow(*case) for case in ((0, 0.1), (1, 0.0), (2, 0.0), (2, 0.1)))]
)
def test_rounded_responses_of_networks_at_the_limit_are_as_near_as_the_truth(seed, damping):
    """The truth is passive, so the best passive model of its order is no farther from its rounded response than it is.

    Two one-ports, the first one lossless, behind an ideal transformer that turns them: a singular value is 1 at every frequency.
    """
    rng = np.random.default_rng(seed)
    omega = np.geomspace(0.3, 30, 60)
    parts = [scattering(foster(rng, 1, 1, damping=each)) for each in (0.0, damping)]
    apart, angle = control.append(*parts), rng.uniform(0.3, 1.2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    truth = control.StateSpace(apart.A, apart.B @ turn, turn.T @ apart.C, turn.T @ apart.D @ turn, 0)
    values = passive_fit.response_of(truth, omega)
    data = rid.FrequencyResponse(omega, np.round(values, 9))
    fit = rid.fit_mfd(data, order=truth.nstates, feedthrough=True, weight=np.ones(values.shape))
    found = rid.passive.make_passive(fit.model, response=data)
    assert found.passivity.holds
    error = passive_fit.response_of(found.model, omega) - data.values
    assert np.linalg.norm(error) <= 1.01 * np.linalg.norm(values - data.values)
