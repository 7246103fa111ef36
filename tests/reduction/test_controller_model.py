"""Controllers that are known by their frequency response: the model is the one that made it."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, points_of, response_at
from robustid.prepare import controller_model

DT = 0.001
SLOW, FAST = np.geomspace(1.0, 3000.0, 60), np.geomspace(1.0, 1e5, 90)
PID = control.ss(control.tf([3, -5.5, 2.6], [1, -1.5, 0.5], DT) * control.tf([1, -1.6, 0.98], [1, -1.2, 0.5], DT))
PAIR = control.append(
    control.ss(control.tf([1, 200, 1e4], [1 / 3000, 1, 0])), control.ss(control.tf([2, 100], [1 / 4000, 1, 0]))
)
UNSTABLE = control.ss(control.tf([3.0, 20], [1, -5]) * control.tf([400], [1, 400]))
GAIN = control.ss([], [], [], [[2.0, 0.5], [0.0, 1.0]], DT)


def response(model, omega):
    return response_at(StateMatrices.of(model), points_of(omega, model.dt))


@pytest.mark.parametrize(("model", "omega"), [(PID, SLOW), (PAIR, FAST), (UNSTABLE, FAST), (GAIN, SLOW)])
def test_the_model_is_the_one_that_made_the_response(model, omega):
    found = controller_model(control.frd(model, omega))
    assert found.nstates == model.nstates
    assert found.dt == model.dt
    between = np.geomspace(2.0, 2500.0, 50)
    true = response(model, between)
    assert np.abs(response(found, between) - true).max() <= 1e-9 * np.abs(true).max()


def test_a_response_of_six_digits_in_a_file_is_enough():
    values = response(PID, SLOW)
    rounded = np.array([complex(f"{one.real:.7g}{one.imag:+.7g}j") for one in values[:, 0, 0]])
    found = controller_model(rid.FrequencyResponse(SLOW, rounded, dt=DT))
    assert found.nstates == PID.nstates
    assert np.all(np.abs(response(found, SLOW) - values) < 1e-5 * np.abs(values))


def test_a_measured_controller_is_refused():
    rng = np.random.default_rng(0)
    values = response(PID, SLOW[::3])[:, 0, 0] * (1 + 1e-3 * rng.standard_normal(20))
    with pytest.raises(rid.InputError, match="without noise: no model of up to 6 states"):
        controller_model(rid.FrequencyResponse(SLOW[::3], values, dt=DT))


def test_the_loop_is_that_of_the_model():
    plant, controller = control.ss(1.1, 1.0, 1.0, 0.0, DT), control.ss(control.tf([0.5, 0.1], [1, 0.1], DT))
    frf = rid.FrequencyResponse(SLOW, response(control.feedback(plant, controller), SLOW), bound=1e-6, dt=DT)
    one, other = (rid.prepare.loop_from_data(frf, given) for given in (controller, control.frd(controller, SLOW)))
    assert rid.guarantee.nu_gap(one.controller, other.controller).value < 1e-9
    assert rid.guarantee.nu_gap(one.auxiliary, other.auxiliary).value < 1e-5


def test_a_loop_of_a_response_leads_to_its_model():
    response = control.frd(control.ss(control.tf([0.5, 0.1], [1, 0.1], DT)), SLOW)
    with pytest.raises(rid.errors.InputTypeError, match=r"got a frequency response.*prepare\.controller_model"):
        rid.Loop(response)
    assert rid.Loop(controller_model(response)).shape == (1, 1)
