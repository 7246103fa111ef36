"""A fit that is not told of a feed-through has one where units or names of the signals say so."""

import numpy as np
import pytest

import robustid as rid
from robustid.data import FeedThrough, expected_feedthrough
from robustid.fitting import RollOff, fit_mfd, suggest_order
from support.cases import slow
from support.report_pages import printed

OMEGA = np.linspace(1, 9, 60)
MODE = 1 / ((1j * OMEGA) ** 2 + 0.2j * OMEGA + 16)
ACCELERATION, WAVES = FeedThrough.ACCELERATION, FeedThrough.SCATTERING


def response(outputs, inputs, values=MODE, dt=None):
    return rid.FrequencyResponse(OMEGA, values, outputs=[outputs], inputs=[inputs], dt=dt)


@pytest.mark.parametrize(
    ("output", "input", "expected"),
    [
        ("x [m]", "F [N]", None),
        ("v [m/s]", "F [N]", None),
        ("a [m/s^2]", "F [N]", ACCELERATION),
        ("a [m/s²]", "F [kN]", ACCELERATION),
        ("a [mm/s^2]", "F [N]", ACCELERATION),
        ("a [g]", "F [N]", ACCELERATION),
        ("phi [rad/s^2]", "T [Nm]", ACCELERATION),
        ("a [m/s^2]", "x [m]", None),
        ("m [g]", "u [V]", None),
        ("b2", "a1", WAVES),
        ("b2 [V]", "a1 [V]", None),
        ("b", "a1", None),
        ("y", "u", None),
    ],
)
def test_units_and_names_say_what_a_response_does_at_infinity(output, input, expected):
    assert expected_feedthrough(response(output, input)) is expected
    whole = rid.FrequencyResponse(
        OMEGA, np.broadcast_to(MODE[:, None, None], (60, 1, 2)), outputs=[output], inputs=[input, "u"]
    )
    assert expected_feedthrough(whole) is None  # one entry of another kind


@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_waves_are_those_of_continuous_time(sample_time):
    assert (expected_feedthrough(response("b1", "a1", dt=sample_time)) is None) == (sample_time is not None)


@pytest.mark.parametrize(("output", "input"), [("a [m/s^2]", "F [N]"), slow("b1", "a1")])
def test_the_default_follows_and_what_is_stated_stands(output, input):
    data = response(output, input, 0.3 + MODE)
    fit = fit_mfd(data, order=2)
    assert fit.problem.feedthrough
    assert np.isclose(fit.model.D[0, 0], 0.3, atol=1e-6)
    assert "Feed-through" in printed(fit, data=data)
    sweep = suggest_order(data, orders=[1, 2])
    assert sweep.suggested == 2
    assert sweep.fits[2].problem.feedthrough
    for stated in (
        fit_mfd(data, order=2, feedthrough=False),
        fit_mfd(data, order=2, constraints=[RollOff(1)]),
        fit_mfd(response("x [m]", "F [N]", 0.3 + MODE), order=2),
        suggest_order(data, orders=[2], feedthrough=False).fits[2],
    ):
        assert not stated.problem.feedthrough
        assert stated.model.D[0, 0] == 0
        assert "Feed-through" not in printed(stated)
    assert fit_mfd(response("x [m]", "F [N]", 0.3 + MODE), order=2, feedthrough=True).problem.feedthrough
