"""What is drawn of a guarantee, against the arrays of the result."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.report import plot, render_report
from robustid.report.charts import REACHED, Layer
from robustid.report.guarantee import worst_case_charts, worst_case_sigma_chart
from robustid.report.magnitude_phase import band_around
from robustid.report.value_sets import data_discs, nyquist_chart
from robustid.report.words import number
from support.matrix_pages import response_of
from support.report_pages import Page, identified, layers, named, with_circle

pytestmark = pytest.mark.quick
HZ = np.array([0.0, 4.0, 9.0, 17.0, 17.6, 30.0, 50.0])


def at(layer, hz):
    index = np.searchsorted(layer.x, hz * (1 - 1e-12))
    np.testing.assert_allclose(layer.x[index], hz, rtol=1e-12)
    return index


def test_band_is_the_guaranteed_range_at_every_frequency(error):
    magnitude, phase, _ = worst_case_charts(error)[0].panels
    band = named(magnitude, "guaranteed range (7 frequencies)")
    index = at(band, HZ[1:])
    bottom = magnitude.y.range[0]
    np.testing.assert_allclose(band.low[index], np.maximum(error.magnitude[1:, 0], bottom), rtol=1e-9)
    np.testing.assert_allclose(band.high[index], error.magnitude[1:, 1], rtol=1e-9)
    assert magnitude.y.range[1] > error.magnitude.max()
    turn = named(phase, "guaranteed range (7 frequencies)")
    drawn = np.radians(np.stack([turn.low, turn.high], axis=1)[at(turn, HZ[1:])])
    known = error.magnitude[1:, 0] > 0
    assert 0 < known.sum() < known.size  # both kinds are tested
    np.testing.assert_allclose(np.exp(1j * drawn[known]), np.exp(1j * error.phase[1:][known]), atol=1e-9)
    np.testing.assert_allclose(np.ptp(drawn[known], axis=1), np.ptp(error.phase[1:][known], axis=1), atol=1e-9)
    np.testing.assert_allclose(np.ptp(drawn[~known], axis=1), 2 * np.pi)
    assert phase.y.range[0] <= turn.low.min()
    assert phase.y.range[1] >= turn.high.max()


def test_band_is_next_to_the_curve_of_its_own_model(error):
    small = error.with_model(rid.balanced_truncation(error.model, order=4).model)
    magnitude, phase, _ = worst_case_charts(small)[0].panels
    curve = named(magnitude, "model, order 4")
    np.testing.assert_allclose(curve.y[at(curve, HZ[1:])], np.abs(small.nominal[1:]), rtol=1e-9)
    band = named(magnitude, "guaranteed range (7 frequencies)")
    np.testing.assert_allclose(band.high[at(band, HZ[1:])], small.magnitude[1:, 1], rtol=1e-9)
    assert any(layer.name.startswith("nominal model") for layer in phase.layers)


def test_error_panel_shows_both_ends_and_the_circle_only_if_computed(error):
    panel = worst_case_charts(error)[0].panels[2]
    left = panel.x.range[0]
    upper, lower = named(panel, "guaranteed error"), named(panel, REACHED)
    np.testing.assert_allclose(upper.x, [left, *HZ[1:]])
    np.testing.assert_array_equal(upper.y, error.upper.ravel())
    np.testing.assert_array_equal(lower.y, error.lower.ravel())
    assert "0 Hz drawn at the left end" in panel.title
    assert error.known_circle is None
    assert [layer.name for layer in panel.layers] == [upper.name, lower.name]
    steps = named(worst_case_charts(with_circle(error))[0].panels[2], "guaranteed between them too")
    circle = with_circle(error).circle
    np.testing.assert_allclose(steps.x[1:] * 2 * np.pi, np.repeat(circle.edges, 2)[2:-1])
    np.testing.assert_array_equal(steps.y, np.repeat(circle.bound, 2))


def test_areas_of_a_curve_with_gaps_have_none():
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    curve = Layer("phase", x, np.array([0.0, -170.0, np.nan, 170.0, 90.0, 80.0]), "")
    pieces = band_around("band", curve, np.array([2.0, 5.0]), np.array([[-1.0, 2.0], [-3.0, 4.0]]))
    assert [piece.x.tolist() for piece in pieces] == [[2.0], [4.0, 5.0]]
    share = np.log(2) / np.log(2.5)
    np.testing.assert_allclose(pieces[1].low, [170 - 3**share, 87])  # offsets from -1 to -3 on logarithmic axes
    np.testing.assert_allclose(pieces[1].high, [170 + 2 * 2**share, 94])
    through = band_around("band", curve, np.array([2.0, 5.0]), np.array([[-1.0, 0.0], [1.0, 4.0]]))
    np.testing.assert_allclose([through[1].low[0], through[1].high[0]], [170 - 1 + 2 * share, 170 + 4 * share])
    anything = band_around("band", curve, np.array([2.0, 4.0, 5.0]), np.array([[-1.0, 2.0], [-3, 4], [np.nan, np.nan]]))
    assert [(piece.low.tolist(), piece.high.tolist()) for piece in anything[:1]] == [([-171.0], [-168.0])]
    np.testing.assert_allclose([anything[1].low, anything[1].high], [[167, -90], [174, 270]])
    dense = dataclasses.replace(curve, x=np.array([4.0, 4.5, 5.0]), y=np.zeros(3))
    (area,) = band_around("band", dense, np.array([4.0, 5.0]), np.array([[-3.0, 4.0], [np.nan, np.nan]]))
    assert area.low.tolist() == [-3, -180, -180]  # not interpolated towards a phase that can be anything


def test_matplotlib_draws_these_numbers(error):
    figure, chart = plot.bode(error), worst_case_charts(error)[0]
    figure.canvas.draw()
    for ax, panel in zip(figure.axes[:2], chart.panels[:2], strict=True):
        band = panel.layers[0]
        drawn = ax.collections[0].get_paths()[0].vertices
        for x, end in zip(np.tile(band.x, 2), np.concatenate([band.low, band.high]), strict=True):
            assert np.any(np.all(drawn == [x, end], axis=1))
    lines = {line.get_marker(): line.get_ydata() for line in figure.axes[2].lines}
    np.testing.assert_array_equal(lines["o"], error.upper.ravel())
    np.testing.assert_array_equal(lines["^"], error.lower.ravel())
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "displacement [mm] / force [N]",
        "phase [°] of\ndisplacement / force",
        "error |F − model| of\ndisplacement [mm] / force [N]",
    ]
    legend = figure.legends[0].get_window_extent()
    assert not any(legend.overlaps(ax.get_window_extent()) for ax in figure.axes)


def test_nyquist_holds_polygons_points_and_the_model(error):
    figure, chart = plot.nyquist(error), nyquist_chart(error)
    figure.canvas.draw()
    values = {layer.name: layer.x + 1j * layer.y for layer in chart.panels[0].layers}
    outlines = np.split(
        values["holds every consistent value"], np.flatnonzero(np.isnan(values["holds every consistent value"]))
    )
    for outline, found in zip(outlines, error.values, strict=False):
        outline = outline[~np.isnan(outline)]
        np.testing.assert_array_equal(outline, [*found.vertices, found.vertices[0]])
    points = values[REACHED]
    np.testing.assert_array_equal(points, np.concatenate([v.points for v in error.values]))
    np.testing.assert_array_equal(values["model at the 7 frequencies"], error.nominal)
    drawn = [line.get_xdata() + 1j * line.get_ydata() for line in figure.axes[0].lines]
    assert any(np.array_equal(line, points) for line in drawn)
    # Beside it, the worst frequencies around the model: the farthest corner is the guaranteed error.
    worst = np.argsort(-error.upper.ravel())[0]
    layer = named(chart.panels[1], f"{number(HZ[worst], 5)} Hz")
    assert np.hypot(layer.x, layer.y).max() == pytest.approx(error.upper[worst, 0, 0], rel=1e-12)
    assert "[mm/N]" in figure.axes[1].get_xlabel()


@pytest.mark.parametrize("tilt", [None, 0.4 - 0.3j])
def test_outlines_of_the_data_are_their_borders(tilt):
    result = identified(tilt=None if tilt is None else np.full(7, tilt))
    frf = result.problem.frequency[0]
    (layer,) = data_discs(result.problem, (0, 0))
    for k, outline in enumerate((layer.x + 1j * layer.y).reshape(frf.omega.size, -1)[:, :-1]):
        offset = outline - frf.values[k, 0, 0]
        border = np.abs(offset + (tilt or 0) * offset.conj())
        np.testing.assert_allclose(border, frf.bound[k, 0, 0], rtol=1e-9)
        assert np.ptp(np.unwrap(np.angle(offset))) == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("hz", [0.0, 12.0])
def test_one_frequency_and_sets_without_attained_points_are_drawn(error, hz):
    one = rid.worst_case_error(error.identification, omega=[2 * np.pi * hz], directions=4)
    empty = tuple(dataclasses.replace(v, points=np.full(v.points.shape, np.nan)) for v in one.values)
    for shown in (one, dataclasses.replace(one, values=empty)):
        plot.bode(shown).canvas.draw()
        plot.nyquist(shown).canvas.draw()
        page = Page(render_report(error.identification, worst_case=shown))
        assert f"at {number(hz)} Hz" in page.text
        assert "frequencies from" not in page.text


def test_guaranteed_ranges_of_entries_and_of_the_singular_values(matrix_error):
    at = matrix_error.omega / (2 * np.pi)
    for chart, (i, j) in zip(worst_case_charts(matrix_error), np.ndindex(2, 2), strict=True):
        area = layers(chart, 0)["guaranteed range (2 frequencies)"]
        index = np.searchsorted(area.x, at)
        np.testing.assert_allclose(area.high[index], matrix_error.magnitude[:, i, j, 1], rtol=1e-9)
        assert np.all(area.low[index] <= matrix_error.magnitude[:, i, j, 0] + chart.panels[0].y.range[0])
        drawn = layers(chart, 2)
        np.testing.assert_allclose(drawn["guaranteed error"].y, matrix_error.upper[:, i, j])
        np.testing.assert_allclose(drawn["reached by consistent systems"].y, matrix_error.lower[:, i, j])
    chart = worst_case_sigma_chart(matrix_error)
    area = layers(chart, 0)["guaranteed range of σmax (2 frequencies)"]
    sigma = np.linalg.norm(response_of(matrix_error.model, matrix_error.omega), 2, axis=(1, 2))
    np.testing.assert_allclose(area.high[np.searchsorted(area.x, at)], sigma + matrix_error.sigma_upper, rtol=1e-9)
    np.testing.assert_allclose(layers(chart, 1)["guaranteed error"].y, matrix_error.sigma_upper)


def test_guarantees_are_plotted(matrix_error):
    assert sum(ax.get_visible() for ax in plot.bode(matrix_error).axes) == 4 * 3 + 2
    assert len(plot.nyquist(matrix_error).axes) == 4 * 2
