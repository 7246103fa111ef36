"""What is drawn of a measured frequency response, against numbers known independently."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

import robustid as rid
from robustid.data import FrequencyResponse, TimeRecord, estimate_frf
from robustid.report import frf_charts, plot_fit, plot_frf, render_summary, write_report
from robustid.report.frf_view import FrfView
from robustid.report.html import render_report
from robustid.report.plots import draw
from support.frf_records import DT, HZ, NASTY, PERIOD, gain, measured


@pytest.fixture(scope="module")
def play():
    return measured()[0]


@pytest.fixture(scope="module")
def records():
    return measured()[1]


@pytest.fixture(scope="module")
def frf(play, records):
    return estimate_frf(records, period=PERIOD, lines=play.lines)


def layers(chart, panel=0):
    return {layer.name: layer for layer in chart.panels[panel].layers}


def specs(page):
    return json.loads(re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.S)[1])


# ---------------------------------------------------------------- what is drawn


def test_every_entry_shows_value_bound_and_levels(frf):
    charts = frf_charts.entry_charts(FrfView(frf))
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
    drawn = layers(frf_charts.entry_charts(FrfView(frf))[0])
    np.testing.assert_allclose(drawn["σ of the response"].y, [0.02, 0.03])
    assert set(drawn) == {"response", "σ of the response"}


@pytest.mark.parametrize("turns", [1.5, 5.0])
def test_phase_is_continuous_within_two_turns_and_noise_turns_nothing(turns):
    rng = np.random.default_rng(1)
    omega = np.linspace(1.0, 100.0, 400)
    values = np.exp(-1j * HZ * turns * omega / 100) * np.where((omega > 40) & (omega < 60), 0.01, 1)
    values = values + 0.01 * (rng.standard_normal(400) + 1j * rng.standard_normal(400))
    angle, (low, high) = frf_charts.phases(omega, values, np.full(400, 0.05))
    np.testing.assert_allclose(np.exp(1j * np.radians(angle)), values / np.abs(values), atol=1e-9)
    assert low <= angle.min()
    assert angle.max() <= high
    sure = np.abs(values) > 0.1
    if turns == 1.5:
        gradient = np.polyfit(omega[sure], angle[sure], 1)[0]
        assert gradient == pytest.approx(-360 * turns / 100, rel=0.01)
        assert np.abs(np.diff(angle[sure])).max() < 120  # over the lines that are left out
    else:
        assert (low, high) == (-225, 225)


def test_gaps_of_a_wrapped_phase_stay_gaps_in_the_area():
    omega = np.linspace(1.0, 100.0, 200)
    frf = FrequencyResponse(omega, np.exp(-1j * 0.5 * omega), bound=0.1, dt=0.01)
    chart = frf_charts.entry_charts(FrfView(frf))[0]
    band = layers(chart, 1)["response ± bound"]
    wraps = np.flatnonzero(np.abs(np.diff(np.angle(frf.values[:, 0, 0]))) > np.pi)
    assert wraps.size == 8
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(band.low)), wraps + 1)
    area = next(t for t in specs(render_report(frf))["entry-0-0-0"]["data"] if t.get("fill") and t["yaxis"] == "y2")
    assert area["y"].count(None) == wraps.size
    assert [v is None for v in area["x"]] == [v is None for v in area["y"]]


def test_singular_values_stay_within_their_bound(frf):
    view = FrfView(frf)
    true = np.linalg.svd(gain(frf.freq_hz), compute_uv=False)
    within = np.all(np.abs(frf.values - gain(frf.freq_hz)) <= frf.bound, axis=(1, 2))
    assert within.all()
    assert np.all(np.abs(view.singular_values - true) <= view.singular_bound[:, None] * (1 + 1e-9))
    drawn = layers(frf_charts.singular_chart(view))
    np.testing.assert_allclose(drawn["largest singular value"].y, view.singular_values[:, 0], rtol=1e-5)
    assert "mixed units" in frf_charts.singular_chart(view).panels[0].y.label
    one = FrequencyResponse([1.0], np.ones((1, 2, 2)), inputs=["a [V]", "b [V]"], outputs=["x [m]", "y [m]"])
    assert frf_charts.singular_chart(FrfView(one)).panels[0].y.label == "singular value [m/V]"
    assert [chart.name for chart in frf_charts.overview_charts(FrfView(frf.entry(0, 0)))] == ["coherence"]


def test_coherence_of_every_output(frf):
    drawn = layers(frf_charts.coherence_chart(FrfView(frf)))
    np.testing.assert_allclose(drawn["coherence of x"].y, frf.coherence[:, 0], rtol=1e-5)
    low, high = frf_charts.coherence_chart(FrfView(frf)).panels[0].y.range
    assert low < frf.coherence.min() < 1 < high


def test_spectra_are_amplitudes_with_the_lines_marked(frf, play, records):
    charts = frf_charts.spectrum_charts(FrfView(frf, records))
    assert [chart.panels[0].title for chart in charts] == [
        "input force [N]",
        "input torque [Nm]",
        "output x [mm]",
        f"output {NASTY}",
    ]
    drawn = layers(charts[0])
    np.testing.assert_allclose(drawn["lines of the response"].x, play.freq_hz, rtol=1e-5)
    # The same power at every line: rms^2 = sum of amplitude^2/2 over the lines.
    flat = np.sqrt(2 * np.mean(play.rms[:, 0] ** 2) / play.lines.size)
    np.testing.assert_allclose(drawn["lines of the response"].y, flat, rtol=1e-5)
    assert layers(charts[2])["between these lines"].y.max() < 0.1 * layers(charts[2])["lines of the response"].y.max()
    sine = np.cos(HZ * 10 * DT * np.arange(200))
    one = TimeRecord(3 * sine, 5 + 2 * sine, dt=DT)
    found = FrfView(FrequencyResponse([HZ * 10], [2 / 3], dt=DT), one).spectrum("y", 0)
    assert found.freq_hz[found.excited].tolist() == [10.0]
    assert found.amplitude[found.excited] == pytest.approx(2)
    assert found.amplitude[~found.excited].max() < 1e-12


def test_0_hz_is_left_out_of_a_logarithmic_axis_only():
    omega = np.append(0.0, np.geomspace(1, 1e3, 40))
    frf = FrequencyResponse(omega, 1 / (1 + 1j * omega), bound=0.01, coherence=np.full((41, 1), 0.9))
    for chart in (*frf_charts.entry_charts(FrfView(frf)), frf_charts.coherence_chart(FrfView(frf))):
        assert "0 Hz" in chart.panels[0].x.label
        assert all(np.all(layer.x > 0) for layer in chart.panels[0].layers)
    even = FrequencyResponse(np.arange(40.0), np.ones(40), bound=0.01)
    assert layers(frf_charts.entry_charts(FrfView(even))[0])["response"].x[0] == 0


def test_of_many_lines_the_extremes_are_kept():
    rng = np.random.default_rng(2)
    omega = np.linspace(1, 1000, 20000)
    values = np.exp(rng.standard_normal(20000)) * np.exp(1j * omega)
    frf = FrequencyResponse(omega, values, bound=0.01)
    view = FrfView(frf)
    drawn = layers(frf_charts.entry_charts(view)[0])
    shown = np.concatenate([drawn[name].y for name in ("response", "response below its bound") if name in drawn])
    assert np.nanmax(shown) == pytest.approx(np.abs(values).max(), rel=1e-5)
    assert np.nanmin(shown) == pytest.approx(np.abs(values).min(), rel=1e-5)
    assert drawn["response"].x.size <= frf_charts.drawn_lines(view) < 2000
    assert "Of the 20000 lines" in render_report(frf)


# ---------------------------------------------------------------- pages and figures


def test_page(frf, records, tmp_path):
    write_report(frf, tmp_path / "frf.html", records=records, title="Stage <3>")
    page = (tmp_path / "frf.html").read_text(encoding="utf-8")
    text = page.replace(get_plotlyjs(), "")
    for words in ("Stage &lt;3&gt;", "Statistical bound, 95 %", "Singular values (CMIF)", "mean square over all 4"):
        assert words in text, words
    assert NASTY not in text
    figures = specs(page)
    entries = [f"entry-{i}-{j}-0" for i in (0, 1) for j in (0, 1)]
    assert list(figures) == [
        *entries,
        "singular-0",
        "coherence-0",
        "input-0-0",
        "input-1-0",
        "output-0-0",
        "output-1-0",
    ]
    assert all(f'id="{name}"' in text for name in figures)
    import plotly.graph_objects as go

    for figure in figures.values():
        go.Figure(figure)  # refuses unknown or malformed properties
    titles = [figures["entry-0-1-0"]["layout"][axis]["title"]["text"] for axis in ("xaxis", "yaxis", "yaxis2")]
    assert titles == ["frequency [Hz]", "magnitude [mm/Nm]", "phase [°]"]
    bare = render_report(frf.entry(0, 0))
    assert "Spectra of the records" not in bare
    assert list(specs(bare)) == ["entry-0-0-0", "coherence-0"]


@pytest.mark.parametrize("lines", [1, 2, 3])
@pytest.mark.parametrize("values", [0.0, 1.0])
def test_any_response_can_be_drawn(lines, values):
    frf = FrequencyResponse(np.arange(lines, dtype=float), np.full(lines, values), bound=1e-3)
    plot_frf(frf)
    assert "Hard bound" in render_report(frf)
    assert "Hard bound" in str(render_summary(frf).renderables[0].renderable)


def test_matplotlib_figure(frf, records):
    figure = plot_frf(frf, records)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 8 + 2 + 2 + 2
    assert all(axes.get_ylabel() for axes in shown)
    assert [axes.get_xlabel() for axes in shown] == [""] * 12 + ["frequency [Hz]"] * 2
    ragged = plot_frf(dataclasses.replace(frf, coherence=None))
    shown = [axes for axes in ragged.axes if axes.get_visible()]
    # Nothing stands below the last entry of the second column: it has the axis.
    assert [axes.get_xlabel() for axes in shown[-3:]] == ["", "frequency [Hz]", "frequency [Hz]"]
    assert len(plot_frf(frf.entry(0, 0)).axes) == 3


def test_labels_of_narrow_columns_do_not_overlap():
    """Four columns of logarithmic frequency."""
    omega = HZ * np.geomspace(4, 1200, 60)
    values = np.array([[1, 2, 1, 0.5]]) / (1j * omega / 300 + 1)[:, None, None] ** 2
    frf = FrequencyResponse(omega, values, bound=1e-3)
    for figure in (plot_frf(frf), plot_fit(rid.fit_mfd(frf.select(slice(None, None, 2)), order=2))):
        renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else None
        figure.draw_without_rendering()
        for axes in figure.axes:
            for axis, side in ((axes.xaxis, 0), (axes.yaxis, 1)):
                boxes = [
                    label.get_window_extent(renderer)
                    for label in axis.get_majorticklabels()
                    if label.get_visible() and label.get_text()
                ]
                spans = sorted((box.min[side], box.max[side]) for box in boxes)
                assert all(end < start for (_, end), (start, _) in itertools.pairwise(spans))
                assert spans or not axis.get_tick_params().get("labelbottom", True)


@pytest.mark.parametrize("label", ["magnitude", "phase"])
def test_small_numbers_are_powers_of_ten_all_over_an_axis(label):
    from robustid.report.charts import Axis

    assert Axis(label=label, log=True, range=(0.02, 90.0)).in_full
    assert not Axis(label=label, log=True, range=(1e-7, 1e-4)).in_full
    assert not Axis(label=label, log=True, range=(1e-3, 1e2)).in_full
    assert not Axis(label=label, range=(0.0, 1.0)).in_full


def test_misuse_is_named(frf, records, tmp_path):
    path = tmp_path / "a.html"
    for wrong, error, sentence in (
        (3, rid.InputTypeError, "`records` must be a TimeRecord or a sequence of them; got int"),
        ([], rid.InputTypeError, "`records` must be a TimeRecord"),
        ([frf], rid.InputTypeError, "`records` must be a TimeRecord"),
        (TimeRecord(np.ones(4), np.ones(4), dt=DT), rid.InputError, "must have the 2 outputs and 2 inputs"),
        (dataclasses.replace(records[0], dt=0.02), rid.InputError, "dt = 0.01 s; got 0.02 s"),
        (
            [records[0], dataclasses.replace(records[1], u=records[1].u[:400], y=records[1].y[:400])],
            rid.InputError,
            "one length; got 800 and 400 samples",
        ),
    ):
        with pytest.raises(error, match=re.escape(sentence)):
            plot_frf(frf, wrong)
        with pytest.raises(error, match=re.escape(sentence)):
            write_report(frf, path, records=wrong)
    with pytest.raises(rid.InputTypeError, match="`frf` must be a FrequencyResponse"):
        plot_frf(records[0])
    with pytest.raises(rid.InputTypeError, match="`data` doesn't belong to a FrequencyResponse"):
        write_report(frf, path, data=frf)
    with pytest.raises(rid.InputError, match=r"continuous time; got 0\.01 s"):
        plot_frf(dataclasses.replace(frf, dt=None), records)
    assert not path.exists()
    assert draw(frf_charts.coherence_chart(FrfView(frf))).axes
