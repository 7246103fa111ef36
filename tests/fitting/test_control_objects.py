"""Objects of python-control go in as they are."""

import control
import numpy as np
import pytest

import robustid as rid

PLANT = control.ss([[0, 1], [-16, -0.2]], [[0], [1]], [[1, 0]], 0)
OMEGA = np.linspace(1, 9, 60)


@pytest.mark.parametrize("dt", [0, 0.1])
def test_fit_mfd_takes_an_frd(dt):
    plant = PLANT if dt == 0 else control.sample_system(PLANT, dt)
    frd = control.frequency_response(plant, OMEGA)
    fit = rid.fit_mfd(frd, order=2)
    assert fit.model.dt == dt
    np.testing.assert_allclose(np.sort_complex(fit.poles), np.sort_complex(plant.poles()), rtol=1e-6)
    assert rid.fits.suggest_order(frd, orders=[1, 2]).suggested == 2


def test_what_an_frd_does_not_say_is_asked_for():
    frd = control.FRD([1 - 0.1j, 0.5j, 0.1j], [1.0, 2.0, 3.0], dt=True)
    with pytest.raises(rid.InputError, match=r"without a sample time; give `dt`"):
        rid.fit_mfd(frd, order=1)
    sentence = "`frf` must be a FrequencyResponse or a control.FRD; got StateSpace"
    with pytest.raises(rid.errors.InputTypeError, match=sentence):
        rid.fit_mfd(PLANT, order=1)
    with pytest.raises(rid.errors.InputTypeError, match=r"`frf` must be .* got list"):
        rid.fits.suggest_order([1.0], orders=[1])


def test_names_of_signals_come_along():
    frd = control.FRD(np.ones((2, 1, 3)), [1.0, 2.0, 3.0], inputs=["force [N]"], outputs=["x [m]", "v"])
    frf = rid.FrequencyResponse.from_control(frd)
    assert [str(signal) for signal in (*frf.inputs, *frf.outputs)] == ["force [N]", "x [m]", "v"]
    plain = rid.FrequencyResponse.from_control(control.FRD(np.ones((2, 1, 3)), [1.0, 2.0, 3.0]))
    assert [str(signal) for signal in (*plain.inputs, *plain.outputs)] == ["u", "y1", "y2"]
    assert str(rid.FrequencyResponse.from_control(frd, inputs="current [A]").inputs[0]) == "current [A]"


def test_validate_takes_results():
    frf = rid.FrequencyResponse.from_control(control.frequency_response(PLANT, OMEGA))
    fit = rid.fit_mfd(frf, order=2)
    reduced = rid.balanced_truncation(fit.model, order=1)
    for result in (fit, reduced):
        found, expected = rid.validate(result, frf), rid.validate(result.model, frf)
        np.testing.assert_array_equal(found.residuals, expected.residuals)
    discrete = rid.to_continuous(control.sample_system(PLANT, 0.1))
    assert rid.validate(discrete, frf).fit.min() > 0.999
    with pytest.raises(
        rid.errors.InputTypeError,
        match=r"`model` must be a control.StateSpace or TransferFunction, .*; got FrequencyResponse",
    ):
        rid.validate(frf, frf)
