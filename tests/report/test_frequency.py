"""Models and samples over frequency, against responses of python-control and numbers by hand."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.report.frequency import frequency_charts, measured_sigma, sigma_chart
from robustid.report.residual_charts import residual_chart
from support.matrix_pages import DT, HZ, measured, problem, response_of, with_values
from support.report_pages import layers

pytestmark = pytest.mark.quick


def test_curve_is_the_response_of_the_model_and_resolves_the_light_mode(consistent):
    truth = rid.datasets.flexible_structure().truth
    chart = frequency_charts(consistent, {"plant": truth})[0]
    for name, model in ((f"nominal model, order {consistent.order}", consistent.model), ("plant", truth)):
        magnitude, phase = (layers(chart, k)[name] for k in (0, 1))
        exact = model(np.exp(2j * np.pi * magnitude.x * 0.01))
        np.testing.assert_allclose(magnitude.y, np.abs(exact), rtol=1e-8)
        drawn = np.isfinite(phase.y)
        np.testing.assert_allclose(np.exp(1j * np.radians(phase.y[drawn])), (exact / np.abs(exact))[drawn], atol=1e-7)
    plant = layers(chart, 0)["plant"]
    fine = np.linspace(17.5, 17.8, 20001)
    peak = np.abs(truth(np.exp(2j * np.pi * fine * 0.01))).max()
    assert plant.y.max() > 0.999 * peak
    # Between neighbouring points around the peak the curve must look smooth.
    near = np.abs(plant.x - 17.67) < 0.2
    assert np.max(np.abs(np.diff(plant.y[near]))) < 0.15 * peak


def test_phase_is_continuous_where_it_stays_within_two_turns():
    experiment = rid.datasets.flexible_structure()
    prior = rid.Prior(gain_bound=1e-6, decay_rate=1.04)  # next to nothing beside the true modes
    pairs = rid.kautz(experiment.modes[:, 0], experiment.modes[:, 1], dt=0.01, delay=1)
    result = rid.identify(rid.MixedProblem(frequency=experiment.frequency, prior=prior, parametric=pairs))
    panel = frequency_charts(result)[0].panels[1]
    curve = panel.layers[0]
    assert np.all(np.isfinite(curve.y))
    assert np.max(np.abs(np.diff(curve.y))) < 90  # a wrapped curve jumps by 360
    assert curve.y.min() < -180  # past the second mode
    assert panel.y.range[0] < curve.y.min()
    assert panel.y.range[1] > curve.y.max()


def test_bars_are_the_discs_of_the_samples(consistent):
    frf = consistent.problem.frequency[0]
    chart = frequency_charts(consistent)[0]
    magnitude, phase = (layers(chart, k)["data with their bounds"] for k in (0, 1))
    np.testing.assert_allclose(magnitude.x, frf.freq_hz)
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 3601))
    for k, centre in enumerate(frf.values[:, 0, 0]):
        disc = centre + frf.bound[k, 0, 0] * turn
        assert magnitude.low[k] == pytest.approx(np.abs(disc).min(), rel=1e-5)
        assert magnitude.high[k] == pytest.approx(np.abs(disc).max(), rel=1e-5)
        angles = np.degrees(np.angle(disc / centre))
        assert phase.high[k] - phase.y[k] == pytest.approx(angles.max(), rel=1e-4)
        assert phase.y[k] - phase.low[k] == pytest.approx(-angles.min(), rel=1e-4)
        assert np.exp(1j * np.radians(phase.y[k])) == pytest.approx(centre / abs(centre))


def test_disc_around_zero_and_sample_at_zero_hertz():
    frf = rid.FrequencyResponse([0.0, 5.0, 10.0], [1.0, 0.01j, -0.4j], bound=0.05, dt=0.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=3.0, decay_rate=1.1)))
    chart = frequency_charts(result)[0]
    magnitude, phase = (layers(chart, k)["data with their bounds"] for k in (0, 1))
    assert phase.high[1] - phase.low[1] == 360
    assert magnitude.low[1] == chart.panels[0].y.range[0]
    assert magnitude.x[0] == chart.panels[0].x.range[0] > 0
    assert "0 Hz" in chart.panels[1].x.label
    axis = residual_chart(result).panels[0].x
    assert "0 Hz" in axis.label
    np.testing.assert_allclose(np.array(axis.range) * 2 * np.pi, [5.0 / 1.1, 10.0 * 1.1])  # that of the lines


def test_many_lines_are_drawn_as_an_area_behind_the_models():
    omega = np.linspace(1.0, 300.0, 400)
    frf = rid.FrequencyResponse(omega, 0.1 / (1.2 - np.exp(-0.01j * omega)), dt=0.01, bound=0.05)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.15)))
    assert result.consistent
    assert result.length
    assert "Taylor coefficients" in result.summary()
    for panel in frequency_charts(result)[0].panels:
        area, samples, model = panel.layers
        assert area.fill
        assert not samples.dash
        assert samples.low is None
        assert np.all(area.low <= samples.y)
        assert np.all(area.high >= samples.y)
        assert model.name.startswith("nominal model")


def test_every_entry_shows_its_model_and_its_samples(matrix_result):
    frf, found = matrix_result.problem.frequency[0], frequency_charts(matrix_result)
    assert [chart.panels[0].title for chart in found] == ["y1 / u1", "y1 / u2", "y2 / u1", "y2 / u2"]
    for chart, (i, j) in zip(found, np.ndindex(2, 2), strict=True):
        size, turn = layers(chart, 0), layers(chart, 1)
        curve, phase = (
            size[f"nominal model, order {matrix_result.order}"],
            turn[f"nominal model, order {matrix_result.order}"],
        )
        expected = response_of(matrix_result.model, HZ * curve.x)[:, i, j]
        np.testing.assert_allclose(curve.y, np.abs(expected), rtol=1e-8)
        known = np.isfinite(phase.y)
        angle = np.exp(1j * np.radians(phase.y[known]))
        np.testing.assert_allclose(angle, (expected / np.abs(expected))[known], atol=1e-7)
        used = np.isfinite(frf.bound[:, i, j])
        assert used.sum() == (9 if (i, j) == (1, 0) else 10)
        samples = size["data with their bounds"]
        np.testing.assert_allclose(samples.x, frf.omega[used] / HZ)
        np.testing.assert_allclose(samples.y, np.abs(frf.values[used, i, j]))
        np.testing.assert_allclose(samples.high - samples.y, 0.05)


def test_further_models_must_have_the_signals_of_the_data(matrix_result):
    found = frequency_charts(matrix_result, {"static": control.ss([], [], [], [[1.0, 2.0], [3.0, 4.0]], DT)})
    assert np.all(layers(found[2], 0)["static"].y == 3.0)
    with pytest.raises(rid.InputError, match="must have 2 outputs and 2 inputs; got 1 and 1"):
        frequency_charts(matrix_result, {"static": control.ss([], [], [], [[1.0]], DT)})


def test_singular_values_are_those_of_the_model_and_of_complete_lines(matrix_result):
    (panel,) = sigma_chart(matrix_result).panels
    curves = {layer.name: layer for layer in panel.layers}
    largest, second = (
        curves[f"σmax of the nominal model, order {matrix_result.order}"],
        curves["further singular values"],
    )
    expected = np.linalg.svd(response_of(matrix_result.model, HZ * largest.x), compute_uv=False)
    np.testing.assert_allclose(largest.y, expected[:, 0], rtol=1e-8)
    np.testing.assert_allclose(second.y, expected[:, 1], rtol=1e-6)
    frf, complete = matrix_result.problem.frequency[0], np.arange(10) != 3
    data = curves["σmax of the data"]
    np.testing.assert_allclose(data.x, frf.omega[complete] / HZ)
    np.testing.assert_allclose(data.y, np.linalg.norm(frf.values[complete], 2, axis=(1, 2)))
    np.testing.assert_allclose(data.high - data.y, 0.1)  # the norm of [[0.05, 0.05], [0.05, 0.05]]


def test_experiments_with_one_input_each_make_a_matrix_together():
    frf = measured(lines=4)
    parts = [with_values(frf, (slice(None), slice(None), 1 - j), np.nan, np.inf) for j in (0, 1)]
    omega, sigma, radius = measured_sigma(problem(parts))
    np.testing.assert_allclose(omega, frf.omega, rtol=1e-12)
    np.testing.assert_allclose(sigma, np.linalg.norm(frf.values, 2, axis=(1, 2)))
    np.testing.assert_allclose(radius, 0.1)
