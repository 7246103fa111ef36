"""What is drawn of a fit, against numbers known independently."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import FitStep, fit_covariance, fit_mfd
from robustid.report.fit_charts import convergence_chart, fit_pole_chart, response_charts
from robustid.report.fit_page import mode_cells
from robustid.report.fit_view import FitView
from support.fits import HZ, OMEGA, SYSTEM, measured
from support.mfd_systems import random_modal_system
from support.report_pages import layers

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("form", ["right", "left"])
def test_samples_model_and_residual_of_every_entry(form, fit, left, data):
    result = fit if form == "right" else left
    charts = response_charts(FitView(result, data))
    assert [chart.panels[0].title for chart in charts][:2] == ["x [mm] / force [N]", "x [mm] / torque [Nm]"]
    exact = np.moveaxis(result.model(1j * OMEGA, squeeze=False), -1, 0)
    for k, chart in enumerate(charts):
        i, j = divmod(k, 2)
        drawn, turned = layers(chart, 0), layers(chart, 1)
        curve = drawn["model, order 8"]
        value = result.model(1j * HZ * curve.x, squeeze=False)[i, j]
        # x has six digits: near a light mode the response moves by 1e-6/damping
        np.testing.assert_allclose(curve.y, np.abs(value), rtol=2e-3)
        np.testing.assert_allclose(drawn["data"].y, np.abs(data.values[:, i, j]), rtol=1e-5)
        np.testing.assert_allclose(drawn["data"].x, data.freq_hz, rtol=1e-5)
        error = np.abs(data.values - exact)[:, i, j]
        np.testing.assert_allclose(drawn["residual |data − model|"].y, error, rtol=1e-4)
        angle = np.exp(1j * np.radians(turned["data"].y))
        np.testing.assert_allclose(angle, data.values[:, i, j] / np.abs(data.values[:, i, j]), atol=1e-4)
        peak = np.abs(SYSTEM.response(1j * HZ * np.geomspace(4, 1200, 200001))[:, i, j]).max()
        assert curve.y.max() > 0.99 * peak


def test_the_band_is_the_standard_deviation_of_the_model(fit, data):
    chart = response_charts(FitView(fit, data))[1]
    band = layers(chart, 0)["model ± σ"]
    deviation = fit_covariance(fit).response_std(HZ * band.x)[:, 0, 1]
    np.testing.assert_allclose(band.high - band.y, deviation, rtol=0.05, atol=2e-5 * band.y.max())
    np.testing.assert_allclose(layers(chart, 0)["σ of the model"].y, deviation, rtol=2e-3)


def test_noise_of_the_data_is_drawn_where_it_is_known():
    system = random_modal_system(4, 2, 1, 2)
    spread = 0.01 * np.abs(system.response(1j * OMEGA))
    known = dataclasses.replace(measured(system, OMEGA), covariance=np.eye(2) * spread[:, None, :, 0] ** 2)
    view = FitView(fit_mfd(known, order=4), known)
    chart = response_charts(view)[1]
    np.testing.assert_allclose(layers(chart, 0)["σ of the data"].y, spread[:, 1, 0], rtol=1e-5)
    # whitened: half a unit of cost per free real equation, with the spread of a chi-squared mean
    free = view.equations - 4 * 3
    assert view.fit.cost / free == pytest.approx(0.5, abs=4 * 0.5 * np.sqrt(2 / free))


def test_masked_samples_are_drawn_apart():
    frf = measured(random_modal_system(4, 2, 1, 2), OMEGA)
    mask = np.ones(frf.values.shape)
    mask[::10, 0] = 0
    view = FitView(fit_mfd(frf, order=4, weight=rid.fits.Weight.relative(frf.values).scaled(mask)), frf)
    drawn = layers(response_charts(view)[0], 0)
    assert drawn["data without weight"].x.size == 12
    assert drawn["data"].x.size == drawn["residual |data − model|"].x.size == 108
    assert "data without weight" not in layers(response_charts(view)[1], 0)


def test_convergence_shows_the_history(fit):
    history = (FitStep("sk", 5.0, 1 + 1e-12, 1.0, np.nan), FitStep("lm", 2.0, 1.0, 1.0, 0.1), fit.history[-1])
    other = dataclasses.replace(fit, history=history, start_cost=9.0, reflected=2, unstable_cost=1.5)
    chart = convergence_chart(FitView(other))
    cost, condition = layers(chart, 0), layers(chart, 1)
    np.testing.assert_array_equal(cost["start"].y, [9.0])
    np.testing.assert_array_equal(cost["sk"].y, [5.0, np.nan, np.nan])
    np.testing.assert_array_equal(cost["lm"].y, [np.nan, 2.0, fit.history[-1].cost])
    assert cost["best fit, with unstable poles"].y[0] == 1.5
    assert condition["sk"].y[0] == pytest.approx(1e-12, rel=1e-3)
    assert condition["lm"].y[1] == np.finfo(float).eps  # κ = 1 stands on the floor
    assert chart.panels[1].y.log
    assert chart.panels[1].y.range[0] < np.finfo(float).eps
    assert "end" not in cost


def test_steps_of_a_former_criterion_are_lines_of_their_own(fit):
    history = (FitStep("lm", 5.0, 1.0, 1.0, 0.1, "in weight 1"), FitStep("lm", 70.0, 1.0, 1.0, 0.1, "in weight 2"))
    view = FitView(dataclasses.replace(fit, history=history, start_cost=90.0, cost=60.0))
    cost = layers(convergence_chart(view), 0)
    np.testing.assert_array_equal(cost["lm in weight 1"].y, [5.0, np.nan])
    np.testing.assert_array_equal(cost["lm in weight 2"].y, [np.nan, 70.0])
    assert (cost["start"].y, cost["end"].x, cost["end"].y) == (90.0, 2, 60.0)


def test_poles_and_modes(fit):
    rows = FitView(fit).modes
    upper = SYSTEM.poles[::2]
    np.testing.assert_allclose([row.hz for row in rows], np.abs(upper) / HZ, rtol=1e-3)
    plane, damping = (layers(fit_pole_chart(FitView(fit)), k) for k in (0, 1))
    np.testing.assert_allclose(plane["poles"].x + 1j * plane["poles"].y, upper / HZ, rtol=1e-3)
    np.testing.assert_allclose(damping["modes"].y, SYSTEM.damping, rtol=0.03)
    np.testing.assert_allclose(damping["modes"].high - damping["modes"].y, [row.damping_std for row in rows])
    # One standard deviation: 8 numbers of 2 % noise lie within four of them
    for row, pole in zip(rows, upper, strict=True):
        assert abs(row.hz - abs(pole) / HZ) < 4 * row.hz_std
        assert f"{row.hz:.3f}"[:5] in mode_cells(FitView(fit), row)[0]


def test_discrete_time_and_linear_axis():
    system = random_modal_system(3, 1, 1, 2, band_hz=(20, 800), dt=5e-4)
    frf = measured(system, HZ * np.linspace(5, 950, 200))
    chart = fit_pole_chart(FitView(fit_mfd(frf, order=4, feedthrough=True)))
    assert chart.panels[0].square
    poles = layers(chart, 0)["poles"]
    assert np.abs(np.sort_complex(poles.x + 1j * poles.y) - np.sort_complex(system.poles)).max() < 1e-3
    assert not chart.panels[1].x.log
