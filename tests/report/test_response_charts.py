"""What is drawn of a measured frequency response, against numbers known independently."""

import dataclasses

import numpy as np
import pytest

from robustid.data import FrequencyResponse, TimeRecord
from robustid.report import plot, render_report
from robustid.report.curves import most_drawn
from robustid.report.response_charts import (
    ResponseView,
    coherence_chart,
    entry_charts,
    overview_charts,
    singular_chart,
    spectrum_charts,
)
from support.frf_records import DT, HZ, gain
from support.matrix_pages import measured, with_values
from support.report_pages import NASTY, Page, layers


def test_what_is_below_its_bound_says_nothing():
    view = ResponseView(FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.01j], bound=0.02, outputs=["x [m]"]))
    assert view.entry(0, 0) == "x [m] / u"
    assert view.silent.ravel().tolist() == [False, True]


def test_every_entry_shows_value_bound_and_levels(frf):
    charts = entry_charts(ResponseView(frf))
    assert [chart.panels[0].title for chart in charts][:2] == ["x [mm] / force [N]", "x [mm] / torque [Nm]"]
    for k, chart in enumerate(charts):
        i, j = divmod(k, 2)
        drawn, turned = layers(chart), layers(chart, 1)
        size, bound = np.abs(frf.values[:, i, j]), frf.bound[:, i, j]
        sure = bound < size
        np.testing.assert_allclose(drawn["response"].x, frf.freq_hz, rtol=1e-5)
        np.testing.assert_allclose(drawn["response"].y, np.where(sure, size, np.nan), rtol=1e-5)
        np.testing.assert_allclose(drawn["bound"].y, bound, rtol=1e-5)
        np.testing.assert_allclose(drawn["response ± bound"].high, size + bound, rtol=1e-5)
        np.testing.assert_allclose(drawn["σ of the noise"].y, frf.noise[:, i, j], rtol=1e-5)
        level = frf.distortion[:, i, j]
        np.testing.assert_allclose(drawn["σ of the distortion"].y, np.where(level > 0, level, np.nan), rtol=1e-5)
        band = turned["response ± bound"]
        half = np.degrees(np.arcsin(bound[sure] / size[sure]))
        low, high = chart.panels[1].y.range
        inside = (band.low[sure] > low) & (band.high[sure] < high)
        assert inside.sum() > 0.8 * sure.sum()
        np.testing.assert_allclose((band.high - band.low)[sure][inside], 2 * half[inside], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose((band.high - band.low)[~sure], high - low)
        angle = np.exp(1j * np.radians(turned["response"].y[sure]))
        np.testing.assert_allclose(angle, (frf.values[:, i, j] / size)[sure], atol=1e-4)
    small = layers(charts[2])["response below its bound"]
    silent = frf.bound[:, 1, 0] >= np.abs(frf.values[:, 1, 0])
    assert silent.any()
    np.testing.assert_allclose(small.y, np.abs(frf.values[silent, 1, 0]), rtol=1e-5)


def test_of_a_covariance_alone_the_standard_deviation_is_drawn():
    frf = FrequencyResponse([1.0, 2.0], [1.0, 2.0], covariance=[[[4e-4]], [[9e-4]]])
    drawn = layers(entry_charts(ResponseView(frf))[0])
    np.testing.assert_allclose(drawn["σ of the response"].y, [0.02, 0.03])
    assert set(drawn) == {"response", "σ of the response"}


def test_gaps_of_a_wrapped_phase_stay_gaps_in_the_area():
    omega = np.linspace(1.0, 100.0, 200)
    frf = FrequencyResponse(omega, np.exp(-1j * 0.5 * omega), bound=0.1, dt=0.01)
    chart = entry_charts(ResponseView(frf))[0]
    band = layers(chart, 1)["response ± bound"]
    wraps = np.flatnonzero(np.abs(np.diff(np.angle(frf.values[:, 0, 0]))) > np.pi)
    assert wraps.size == 8
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(band.low)), wraps + 1)
    area = next(
        t for t in Page(render_report(frf)).figures["entry-0-0-0"]["data"] if t.get("fill") and t["yaxis"] == "y2"
    )
    assert area["y"].count(None) == wraps.size
    assert [v is None for v in area["x"]] == [v is None for v in area["y"]]


def test_singular_values_stay_within_their_bound(frf):
    view = ResponseView(frf)
    true = np.linalg.svd(gain(frf.freq_hz), compute_uv=False)
    within = np.all(np.abs(frf.values - gain(frf.freq_hz)) <= frf.bound, axis=(1, 2))
    assert within.all()
    assert np.all(np.abs(view.singular_values - true) <= view.singular_bound[:, None] * (1 + 1e-9))
    drawn = layers(singular_chart(view))
    np.testing.assert_allclose(drawn["largest singular value"].y, view.singular_values[:, 0], rtol=1e-5)
    assert "mixed units" in singular_chart(view).panels[0].y.label
    one = FrequencyResponse([1.0], np.ones((1, 2, 2)), inputs=["a [V]", "b [V]"], outputs=["x [m]", "y [m]"])
    assert singular_chart(ResponseView(one)).panels[0].y.label == "singular value [m/V]"
    assert [chart.name for chart in overview_charts(ResponseView(frf.entry(0, 0)))] == ["coherence"]


def test_coherence_of_every_output(frf):
    drawn = layers(coherence_chart(ResponseView(frf)))
    np.testing.assert_allclose(drawn["coherence of x"].y, frf.coherence[:, 0], rtol=1e-5)
    low, high = coherence_chart(ResponseView(frf)).panels[0].y.range
    assert low < frf.coherence.min() < 1 < high


def test_spectra_are_amplitudes_with_the_lines_marked(frf, play, records):
    charts = spectrum_charts(ResponseView(frf, records))
    assert [chart.panels[0].title for chart in charts] == [
        "input force [N]",
        "input torque [Nm]",
        "output x [mm]",
        f"output {NASTY}",
    ]
    drawn = layers(charts[0])
    np.testing.assert_allclose(drawn["spectral lines of the response"].x, play.freq_hz, rtol=1e-5)
    # The same power at every line: rms^2 = sum of amplitude^2/2 over the lines.
    flat = np.sqrt(2 * np.mean(play.rms[:, 0] ** 2) / play.lines.size)
    np.testing.assert_allclose(drawn["spectral lines of the response"].y, flat, rtol=1e-5)
    assert (
        layers(charts[2])["between these spectral lines"].y.max()
        < 0.1 * layers(charts[2])["spectral lines of the response"].y.max()
    )
    sine = np.cos(HZ * 10 * DT * np.arange(200))
    one = TimeRecord(3 * sine, 5 + 2 * sine, dt=DT)
    found = ResponseView(FrequencyResponse([HZ * 10], [2 / 3], dt=DT), one).spectrum("y", 0)
    assert found.freq_hz[found.excited].tolist() == [10.0]
    assert found.amplitude[found.excited] == pytest.approx(2)
    assert found.amplitude[~found.excited].max() < 1e-12


def test_0_hz_is_left_out_of_a_logarithmic_axis_only():
    omega = np.append(0.0, np.geomspace(1, 1e3, 40))
    frf = FrequencyResponse(omega, 1 / (1 + 1j * omega), bound=0.01, coherence=np.full((41, 1), 0.9))
    for chart in (*entry_charts(ResponseView(frf)), coherence_chart(ResponseView(frf))):
        assert "0 Hz" in chart.panels[0].x.label
        assert all(np.all(layer.x > 0) for layer in chart.panels[0].layers)
    even = FrequencyResponse(np.arange(40.0), np.ones(40), bound=0.01)
    assert layers(entry_charts(ResponseView(even))[0])["response"].x[0] == 0


def test_of_many_lines_the_extremes_are_kept():
    rng = np.random.default_rng(2)
    omega = np.linspace(1, 1000, 6000)
    values = np.exp(rng.standard_normal(6000)) * np.exp(1j * omega)
    frf = FrequencyResponse(omega, values, bound=0.01)
    view = ResponseView(frf)
    drawn = layers(entry_charts(view)[0])
    shown = np.concatenate([drawn[name].y for name in ("response", "response below its bound") if name in drawn])
    assert np.nanmax(shown) == pytest.approx(np.abs(values).max(), rel=1e-5)
    assert np.nanmin(shown) == pytest.approx(np.abs(values).min(), rel=1e-5)
    assert drawn["response"].x.size <= most_drawn(6000, 1) < 2000
    assert "Of the 6000 frequency points" in render_report(frf)


def test_matplotlib_figure(frf, records):
    figure = plot.bode(frf, records=records)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 8 + 2 + 2 + 2
    assert all(axes.get_ylabel() for axes in shown)
    assert [axes.get_xlabel() for axes in shown] == [""] * 12 + ["frequency [Hz]"] * 2
    ragged = plot.bode(dataclasses.replace(frf, coherence=None))
    shown = [axes for axes in ragged.axes if axes.get_visible()]
    # Nothing stands below the last entry of the second column: it has the axis.
    assert [axes.get_xlabel() for axes in shown[-3:]] == ["", "frequency [Hz]", "frequency [Hz]"]
    assert len(plot.bode(frf.entry(0, 0)).axes) == 3


def test_singular_values_of_a_response_are_those_of_its_complete_lines():
    frf = with_values(measured(lines=9), (3, 1, 0), np.nan, np.inf)
    (chart,) = overview_charts(ResponseView(frf))
    used = np.arange(9) != 3
    drawn = layers(chart)
    np.testing.assert_allclose(drawn["largest singular value"].x, frf.freq_hz[used], rtol=1e-5)
    np.testing.assert_allclose(
        drawn["largest singular value"].y, np.linalg.norm(frf.values[used], 2, axis=(1, 2)), rtol=1e-5
    )
    np.testing.assert_allclose(drawn["bound of the singular values"].y, 0.1, rtol=1e-5)
