"""What is drawn of identifications with several inputs and outputs, against responses of python-control and numbers by hand."""

from __future__ import annotations

import control
import numpy as np
import pytest

import robustid as rid
from robustid.report import charts, evidence, matrix_charts, plot_frequency_response, plot_residuals, plot_time_response
from support.matrix_pages import DT, HZ, measured, problem, record, response_of, with_values
from support.report_pages import layers


@pytest.fixture(scope="module")
def result() -> rid.Identification:
    """Of a response with a missing value, and a record with two inputs."""
    frf = with_values(measured(lines=10), (3, 1, 0), np.nan, np.inf)
    return rid.identify(problem(frf, record()))


@pytest.fixture(scope="module")
def shared() -> rid.Identification:
    """Of a bound on the errors of a column."""
    frf = measured(lines=8)
    return rid.identify(problem(rid.FrequencyResponse(frf.omega, frf.values, bound=0.1, dt=DT, joint="column")))


def test_every_entry_shows_its_model_and_its_samples(result: rid.Identification) -> None:
    frf, found = result.problem.frequency[0], charts.frequency_charts(result)
    assert [chart.panels[0].title for chart in found] == ["y1 / u1", "y1 / u2", "y2 / u1", "y2 / u2"]
    for chart, (i, j) in zip(found, np.ndindex(2, 2), strict=True):
        size, turn = layers(chart, 0), layers(chart, 1)
        curve, phase = size[f"nominal model, order {result.order}"], turn[f"nominal model, order {result.order}"]
        expected = response_of(result.model, HZ * curve.x)[:, i, j]
        np.testing.assert_allclose(curve.y, np.abs(expected), rtol=1e-8)
        known = np.isfinite(phase.y)
        angle = np.exp(1j * np.radians(phase.y[known]))
        np.testing.assert_allclose(angle, (expected / np.abs(expected))[known], atol=1e-7)
        used = np.isfinite(frf.bound[:, i, j])
        assert used.sum() == (9 if (i, j) == (1, 0) else 10)
        samples = size["data with their discs"]
        np.testing.assert_allclose(samples.x, frf.omega[used] / HZ)
        np.testing.assert_allclose(samples.y, np.abs(frf.values[used, i, j]))
        np.testing.assert_allclose(samples.high - samples.y, 0.05)


def test_lighter_charts_keep_every_peak_and_notch(result: rid.Identification) -> None:
    full = charts.frequency_charts(result)
    for one, other in zip(full, matrix_charts.lighter(full), strict=True):
        first, second = one.panels[0].layers[0], other.panels[0].layers[0]
        assert second.x.size <= 2 * 350
        assert second.x.size < first.x.size
        assert (second.y.min(), second.y.max()) == pytest.approx((first.y.min(), first.y.max()), rel=1e-5)
        np.testing.assert_allclose(other.panels[0].layers[1].y, one.panels[0].layers[1].y, rtol=1e-5)  # samples: all


def test_further_models_must_have_the_channels_of_the_data(result: rid.Identification) -> None:
    found = charts.frequency_charts(result, {"static": control.ss([], [], [], [[1.0, 2.0], [3.0, 4.0]], DT)})
    assert np.all(layers(found[2], 0)["static"].y == 3.0)
    with pytest.raises(rid.InputError, match="must have 2 outputs and 2 inputs; got 1 and 1"):
        charts.frequency_charts(result, {"static": control.ss([], [], [], [[1.0]], DT)})


def test_singular_values_are_those_of_the_model_and_of_complete_lines(result: rid.Identification) -> None:
    (panel,) = matrix_charts.sigma_chart(result).panels
    curves = {layer.name: layer for layer in panel.layers}
    largest, second = curves[f"σmax of the nominal model, order {result.order}"], curves["further singular values"]
    expected = np.linalg.svd(response_of(result.model, HZ * largest.x), compute_uv=False)
    np.testing.assert_allclose(largest.y, expected[:, 0], rtol=1e-8)
    np.testing.assert_allclose(second.y, expected[:, 1], rtol=1e-6)
    frf, complete = result.problem.frequency[0], np.arange(10) != 3
    data = curves["σmax of the data"]
    np.testing.assert_allclose(data.x, frf.omega[complete] / HZ)
    np.testing.assert_allclose(data.y, np.linalg.norm(frf.values[complete], 2, axis=(1, 2)))
    np.testing.assert_allclose(data.high - data.y, 0.1)  # the norm of [[0.05, 0.05], [0.05, 0.05]]


def test_experiments_with_one_input_each_make_a_matrix_together() -> None:
    frf = measured(lines=4)
    parts = [with_values(frf, (slice(None), slice(None), 1 - j), np.nan, np.inf) for j in (0, 1)]
    omega, sigma, radius = matrix_charts.measured_sigma(problem(parts))
    np.testing.assert_allclose(omega, frf.omega, rtol=1e-12)
    np.testing.assert_allclose(sigma, np.linalg.norm(frf.values, 2, axis=(1, 2)))
    np.testing.assert_allclose(radius, 0.1)


def test_every_output_of_a_record_has_its_panel(result: rid.Identification) -> None:
    time, found = result.problem.time[0], charts.time_chart(result).panels
    assert [panel.title for panel in found] == ["Record from rest: y1", "Record from rest: y2"]
    _, answer = control.forced_response(result.model, U=time.u.T)[:2]
    for i, panel in enumerate(found):
        drawn = {layer.name: layer for layer in panel.layers}
        used = np.isfinite(time.bound[:, i])
        np.testing.assert_allclose(drawn[f"nominal model, order {result.order}"].y, answer[i, used], atol=1e-9)
        np.testing.assert_allclose(drawn["data with their intervals"].y, time.y[used, i])
        assert ("not used" in drawn) == (i == 0)


def test_step_and_pulse_responses_of_every_entry(result: rid.Identification) -> None:
    for chart, (i, j) in zip(matrix_charts.answer_charts(result), np.ndindex(2, 2), strict=True):
        step, pulse = (panel.layers[0] for panel in chart.panels)
        _, expected = control.step_response(result.model, T=step.x, input=j, output=i)
        np.testing.assert_allclose(step.y, np.squeeze(expected), atol=1e-9)
        np.testing.assert_allclose(np.cumsum(pulse.y), step.y, atol=1e-9)


def test_residuals_stand_row_by_row_against_their_bounds(result: rid.Identification) -> None:
    found = evidence.residual_chart(result).panels
    assert [panel.title for panel in found] == ["y1 / u1", "y1 / u2", "y2 / u1", "y2 / u2", "y1", "y2"]
    frf = result.problem.frequency[0]
    error = np.abs(frf.values - response_of(result.model, frf.omega)) / 0.05
    for panel, (i, j) in zip(found, np.ndindex(2, 2), strict=False):
        used = np.isfinite(frf.bound[:, i, j])
        np.testing.assert_allclose(panel.layers[0].y, error[used, i, j], rtol=1e-5)
    assert len({panel.y.range for panel in found[:4]}) == 1  # one scale: they are compared


def test_samples_that_share_a_bound_are_measured_together(shared: rid.Identification) -> None:
    frf, found = shared.problem.frequency[0], evidence.residual_chart(shared).panels
    assert [panel.title for panel in found] == [f"all outputs / u{j}, one bound" for j in (1, 2)]
    error = frf.values - response_of(shared.model, frf.omega)
    for j, panel in enumerate(found):
        np.testing.assert_allclose(panel.layers[0].y, np.linalg.norm(error[:, :, j], axis=1) / 0.1, rtol=1e-5)
    samples = layers(charts.frequency_charts(shared)[1], 0)["data with their discs (shared bound)"]
    np.testing.assert_allclose(samples.high - samples.y, 0.1)


def test_figures_hold_the_grid_and_a_blank_place_leaves_its_column_logarithmic(result: rid.Identification) -> None:
    axes = plot_frequency_response(result).axes
    assert len(axes) == 10
    assert [ax.get_visible() for ax in axes] == [True] * 9 + [False]
    assert {ax.get_xscale() for ax in axes} == {"log"}
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["y1 / u1", "y1 / u2"]
    assert sum(ax.get_visible() for ax in plot_time_response(result).axes) == 2 + 8
    assert sum(ax.get_visible() for ax in plot_residuals(result).axes) == 6


def test_long_names_stay_inside_their_column() -> None:
    motors = [f"force of the left-hand voice-coil motor {k} [N]" for k in range(3)]
    data = measured(1, 3, lines=4, outputs=["acceleration of the measuring beam at its tip [mm/s²]"], inputs=motors)
    figure = plot_frequency_response(rid.identify(problem(data)))
    figure.draw_without_rendering()
    titles = [ax._left_title.get_window_extent() for ax in figure.axes[:3]]  # type: ignore[attr-defined]
    ends = [*(title.x0 for title in titles[1:]), figure.bbox.x1]
    assert all(title.x1 < end for title, end in zip(titles, ends, strict=True))
