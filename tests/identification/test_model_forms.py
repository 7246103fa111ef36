"""A model is taken in every form that other programs have: state space, transfer function, zeros and poles, scipy's systems."""

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid

pytestmark = pytest.mark.quick

DT = 0.01
NUMERATOR, DENOMINATOR = [0.1, 0.05], [1.0, -1.6, 0.9]
OMEGA = np.linspace(1.0, 300.0, 50)
PLANT = control.ss(control.tf(NUMERATOR, DENOMINATOR, DT))
ZEROS, POLES, GAIN = scipy.signal.tf2zpk(NUMERATOR, DENOMINATOR)
FORMS = {
    "tf": control.tf(NUMERATOR, DENOMINATOR, DT),
    "zpk": control.zpk(ZEROS, POLES, GAIN, DT),
    "dlti": scipy.signal.dlti(NUMERATOR, DENOMINATOR, dt=DT),
    "dlti of roots": scipy.signal.dlti(ZEROS, POLES, GAIN, dt=DT),
    "dlti in states": scipy.signal.dlti(PLANT.A, PLANT.B, PLANT.C, PLANT.D, dt=DT),
}
FRF = rid.FrequencyResponse(OMEGA, PLANT(np.exp(1j * OMEGA * DT)), bound=0.01, dt=DT)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_a_model_is_the_model(form, tmp_path):
    model = FORMS[form]
    assert rid.validate(model, FRF).ratio < 1e-9
    assert rid.compare(FRF, model).outside == 0
    assert rid.balanced_truncation(model, order=1).model.nstates == 1
    assert rid.fits.mode_table(model)[0].hz == pytest.approx(rid.fits.mode_table(PLANT)[0].hz)
    np.testing.assert_allclose(rid.plot.bode(model).axes[0].lines[0].get_ydata()[0], 0.15 / 0.3, rtol=1e-2)
    rid.save(tmp_path / "plant.npz", model)
    assert rid.validate(rid.load(tmp_path / "plant.npz"), FRF).ratio < 1e-9
    fit = rid.fit_mfd(FRF, order=2, start=model)
    assert rid.validate(fit, FRF).ratio < 1e-6


def test_continuous_forms_are_continuous():
    for model in (control.tf([1], [1, 0.2, 16]), scipy.signal.lti([1], [1, 0.2, 16])):
        frf = rid.FrequencyResponse(OMEGA, 1 / (16 - OMEGA**2 + 0.2j * OMEGA), bound=1e-3)
        assert rid.validate(model, frf).ratio < 1e-9


def test_a_matrix_of_transfer_functions_needs_no_slycot():
    first, second = ([0.1, 0.05], [1.0, -1.6, 0.9]), ([0.2], [1.0, -0.5])
    entries = [[first, second, first], [second, first, second]]
    matrix = control.tf(*([[entry[k] for entry in row] for row in entries] for k in (0, 1)), DT)
    z = np.exp(1j * OMEGA * DT)
    values = np.array([[control.tf(*entry, DT)(z) for entry in row] for row in entries]).transpose(2, 0, 1)
    frf = rid.FrequencyResponse(OMEGA, values, bound=1e-3, dt=DT)
    assert rid.validate(matrix, frf).ratio < 1e-9


def test_a_result_stands_for_its_model_and_others_are_refused(tmp_path):
    fit = rid.fit_mfd(FRF, order=2)
    assert rid.balanced_truncation(fit, order=1).model.nstates == 1
    rid.save(tmp_path / "plant.m", fit)
    assert "ss(" in (tmp_path / "plant.m").read_text()
    assert rid.plot.bode(FRF.to_control()).axes[0].get_ylabel() == "magnitude"
    with pytest.raises(
        rid.errors.InputTypeError, match=r"`model` must be a control.StateSpace or TransferFunction.*got str"
    ):
        rid.validate("model", FRF)
    with pytest.raises(
        rid.InputError, match="`model` must be proper; got a transfer function with more zeros than poles"
    ):
        rid.validate(control.tf([1, 0, 0], [1, 1]), FRF)
