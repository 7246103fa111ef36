"""Figures of records, of comparisons, and of models over a measured response."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.report.comparison_page import comparison_chart
from robustid.report.record_charts import amplitudes, record_chart
from robustid.report.response_charts import response_bode
from support.report_pages import named

pytestmark = pytest.mark.quick

OMEGA = np.linspace(1.0, 9.0, 60)
MODEL = control.ss([[0, 1], [-16, -0.2]], [[0], [1]], [[1, 0]], 0)
VALUES = 1 / (16 - OMEGA**2 + 0.2j * OMEGA)
FRF = rid.FrequencyResponse(OMEGA, VALUES, bound=0.01, inputs=["force [N]"], outputs=["x [m]"])


def test_amplitudes_are_those_of_the_sines():
    t = np.arange(400) * 0.01
    hz, size = amplitudes(np.array([3 * np.cos(2 * np.pi * 5 * t) + 0.5 * np.sin(2 * np.pi * 20 * t) + 7]), 0.01)
    assert hz[size > 0.1].round(9).tolist() == [5.0, 20.0]
    np.testing.assert_allclose(size[size > 0.1], [3.0, 0.5], rtol=1e-9)
    # at the Nyquist frequency a cosine of amplitude 1 is 1, not 2
    assert amplitudes(np.array([np.cos(np.pi * np.arange(8))]), 1.0)[1][-1] == pytest.approx(1.0)


def test_a_record_shows_signals_references_bounds_and_spectra():
    u = np.cos(np.arange(64.0))
    bound = np.full((64, 1), 0.2)
    bound[:8] = np.inf
    record = rid.TimeRecord(
        u, 2 * u, dt=0.1, bound=bound, reference=3 * u, inputs=["force [N]"], outputs=["x [m]"], initial="free"
    )
    panels = record_chart(record).panels
    assert [panel.title for panel in panels[::2]] == ["input force [N]", "reference 1", "output x [m]"]
    assert [panel.y.label for panel in panels] == [
        *("force [N]", "amplitude [N]", "reference 1", "amplitude", "x [m]", "amplitude [m]")
    ]
    area = named(panels[4], "± bound")
    np.testing.assert_allclose(area.high - area.low, 0.4, rtol=1e-4)  # six digits are drawn
    assert area.x[0] == 0.8
    assert named(panels[4], "not used").x.size == 8
    constant = rid.TimeRecord(np.ones(4), [0.0, 1.0, 1.0, 1.0], dt=0.1)
    assert record_chart(constant).panels[1].title == "spectrum: nothing but a constant"
    assert len(constant.plot().axes) == 4


def test_models_lie_over_the_response_at_their_own_frequencies():
    chart = response_bode(FRF, models={"exact": MODEL})
    line = named(chart.panels[0], "exact")
    np.testing.assert_allclose(line.y, np.abs(MODEL(2j * np.pi * line.x)), rtol=1e-4)
    assert line.y.max() > 1.245 > np.abs(VALUES).max()  # the peak between two frequency points
    phase, measured = named(chart.panels[1], "exact"), named(chart.panels[1], "response")
    near = np.interp(phase.x, measured.x, measured.y)
    assert np.nanmax(np.abs(phase.y - near)) < 180
    for models in (MODEL, [MODEL], control.tf([1], [1, 0.2, 16]), rid.fit_mfd(FRF, order=2)):
        names = [layer.name for layer in response_bode(FRF, models=models).panels[0].layers]
        assert names[-1] in ("model", "model 1")
    with pytest.raises(rid.InputError, match=r"`models\['model'\]` must have 1 output and 1 input"):
        FRF.plot(models=control.ss([], [], [], np.eye(2), 0))
    with pytest.raises(rid.InputError, match=r"must be continuous, as the data; got dt = 0.1"):
        FRF.plot(models=control.ss(0.5, 1, 1, 0, 0.1))


def test_a_comparison_marks_what_is_beyond_noise():
    second = rid.FrequencyResponse(
        OMEGA, VALUES + 0.05 * (OMEGA > 8), bound=0.01, inputs=["force [N]"], outputs=["x [m]"]
    )
    found = rid.compare(FRF, second)
    magnitude, phase, difference = comparison_chart(found).panels
    assert named(difference, "beyond noise").x.size == np.sum(OMEGA > 8)
    np.testing.assert_allclose(named(difference, "limit of noise").y, 0.02, rtol=1e-5)
    assert magnitude.y.label == "magnitude [m/N]"
    assert len(named(phase, "second").x) == OMEGA.size
    same = comparison_chart(rid.compare(FRF, FRF))
    assert "beyond noise" not in {layer.name for panel in same.panels for layer in panel.layers}
    assert same.panels[2].y.label == "difference [m/N]"
    rid.compare(FRF, FRF).plot()


def test_a_comparison_of_entries_that_were_not_measured():
    bound = np.full((60, 1, 2), 0.1)
    bound[:, 0, 1] = np.inf
    frf = rid.FrequencyResponse(OMEGA, np.ones((60, 1, 2)), bound=bound)
    assert [panel.title for panel in comparison_chart(rid.compare(frf, frf)).panels[:2]] == [
        "y / u1",
        "y / u2: not compared",
    ]
    rid.compare(frf, frf).plot()
