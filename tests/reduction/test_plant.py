"""The smallest model of a plant in a loop that its controller stabilises, and whose R keeps every bound."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, response_at
from robustid.reduction import plant_of
from support.cases import slow
from support.interrupts import ctrl_c
from support.loops import measured_machine


def check(case, found):
    """What a model of the plant must keep, from the numbers."""
    frf = case.problem.frequency[0]
    R = case.loop.residual_of(found.model)
    missed = np.abs(frf.values - response_at(StateMatrices.of(R), np.exp(1j * frf.omega * frf.dt)))
    assert np.max(missed / frf.bound.outer_radius) == pytest.approx(found.margin, rel=1e-6)
    assert found.margin <= 1 + 1e-5
    assert np.abs(control.feedback(found.model, case.controller).poles()).max() < 1
    assert np.abs(R.poles()).max() < 1


def found_orders(seeds):
    """States of the plants found less those of the true ones; errors are anywhere within the bounds."""
    found = []
    for seed in seeds:
        case = measured_machine(seed, edge=False)
        small = rid.reduce_plant(rid.identify(case.problem), case.loop)
        check(case, small)
        found.append(small.order - case.plant.nstates)
    return found


@pytest.mark.parametrize(("plants", "least"), [(1, 1), slow(30, 29)])
def test_of_lines_the_order_of_the_plant_is_found(plants, least):
    """Of thirty plants one that is hidden by a loop of very large gain may take more states."""
    found = found_orders(range(plants))
    assert sum(extra <= 0 for extra in found) >= least, found


def test_without_lines_the_factors_are_truncated():
    rng, gain = np.random.default_rng(0), control.ss([], [], [], 0.5, 0.01)
    plant, loop = control.ss(1.1, 1.0, 1.0, 0.0, 0.01), rid.Loop(gain)
    r = rng.standard_normal(60)
    y = control.forced_response(control.feedback(plant, gain), inputs=r).outputs + rng.uniform(-0.05, 0.05, 60)
    record = rid.TimeRecord(r, y, bound=0.05, dt=0.01)
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4)))
    found = rid.reduce_plant(result, loop)
    assert found.order <= 6
    assert found.margin <= 1 + 1e-5
    assert np.abs(control.feedback(found.model, gain).poles()).max() < 1
    assert np.abs(found.model.poles()).max() == pytest.approx(1.1, abs=0.05)


def test_where_the_time_is_over_the_plant_keeps_every_bound_all_the_same():
    case = measured_machine(0, edge=False)
    result, said = rid.identify(case.problem), []
    found = rid.reduce_plant(result, case.loop, time_limit=1e-9)
    check(case, found)
    assert not found.finished
    small = rid.reduce_plant(result, case.loop, time_limit=600.0, progress=lambda *one: said.append(one))
    assert small.finished
    assert small.order < found.order
    assert said[0][0] == "searching for the smallest plant"
    ended = rid.reduce_plant(result, case.loop, progress=ctrl_c)
    check(case, ended)
    assert not ended.finished


def test_states_that_cancel_are_dropped():
    case = measured_machine(3)
    found = plant_of(case.loop, control.ss(*case.residual, case.plant.dt))
    assert found.nstates == case.plant.nstates
    z = np.exp(1j * np.linspace(0.1, 3, 20))
    np.testing.assert_allclose([found(one) for one in z], [case.plant(one) for one in z], rtol=1e-6)


def test_another_loop_is_refused():
    case = measured_machine(0)
    other = rid.Loop(control.ss([], [], [], [[0.1, 0.1]], 0.01))
    with pytest.raises(rid.InputError, match="must be of the R of `loop`"):
        rid.reduce_plant(rid.identify(case.problem), other)
