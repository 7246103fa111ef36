"""The report of a matrix-fraction fit against numbers known independently, at full size, and in words."""

from __future__ import annotations

import dataclasses
import io
import json
import re

import control
import numpy as np
import pytest
import rich.console
from plotly.offline import get_plotlyjs

import robustid as rid
from robustid.mfd import FitStatus, FitStep, OrderSweep, fit_mfd
from robustid.report import (
    mfd_charts,
    mfd_facts,
    mfd_order_charts,
    plot_convergence,
    plot_fit,
    plot_fit_poles,
    plot_orders,
    plot_stabilisation,
    render_summary,
    write_report,
)
from robustid.report.html import render_report
from robustid.report.mfd_view import FitView
from support.mfd_systems import noisy, random_modal_system

HZ = 2 * np.pi
OMEGA = HZ * np.geomspace(4, 1200, 120)
NASTY = "<script>alert(1)</script>"


def measured(system, omega, **names):
    points = 1j * omega if system.dt is None else np.exp(1j * omega * system.dt)
    values = noisy(np.random.default_rng(0), system.response(points))
    return rid.FrequencyResponse(omega, values, dt=system.dt, **names)


SYSTEM = random_modal_system(1, 2, 2, 4)


@pytest.fixture(scope="module")
def data():
    return measured(SYSTEM, OMEGA, inputs=["force [N]", "torque [Nm]"], outputs=["x [mm]", NASTY])


@pytest.fixture(scope="module")
def fit(data):
    return fit_mfd(data, order=8)


@pytest.fixture(scope="module")
def left(data):
    return fit_mfd(data, order=8, form="left")


@pytest.fixture(scope="module")
def body():
    """2 inputs, 2 outputs, one rigid-body mode and two flexible ones."""
    s = 1j * OMEGA
    flexible = random_modal_system(3, 2, 2, 2).response(s)
    rigid = np.array([[1.0], [-0.3]]) @ np.array([[2.0, 1.0]]) * 1e4 / (s**2)[:, None, None]
    return fit_mfd(rid.FrequencyResponse(OMEGA, flexible + rigid), order=6, rigid_body=rid.RigidBody(1))


SMALL = random_modal_system(5, 1, 1, 2)


@pytest.fixture(scope="module")
def sweep():
    """Of fits of one channel, without the search for the orders."""
    fits = {order: fit_mfd(measured(SMALL, OMEGA), order=order) for order in (4, 5)}
    values = np.geomspace(100, 1, 12)
    parameters = np.array([2 * order for order in fits])
    return OrderSweep(fits, {12: "InputError: <b>no</b>"}, parameters, 2 * OMEGA.size, False, values, 20.0)


def layers(chart, panel):
    return {layer.name: layer for layer in chart.panels[panel].layers}


def printed(result, width=110, **options):
    console = rich.console.Console(file=io.StringIO(), width=width)
    console.print(render_summary(result, **options))
    return console.file.getvalue()


def specs(page):
    return json.loads(re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.S)[1])


# ---------------------------------------------------------------- what is drawn


@pytest.mark.parametrize("form", ["right", "left"])
def test_samples_model_and_residual_of_every_entry(form, fit, left, data):
    result = fit if form == "right" else left
    charts = mfd_charts.response_charts(FitView(result, data))
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
        np.testing.assert_allclose(drawn["residual |P_o − P|"].y, error, rtol=1e-4)
        angle = np.exp(1j * np.radians(turned["data"].y))
        np.testing.assert_allclose(angle, data.values[:, i, j] / np.abs(data.values[:, i, j]), atol=1e-4)
        peak = np.abs(SYSTEM.response(1j * HZ * np.geomspace(4, 1200, 200001))[:, i, j]).max()
        assert curve.y.max() > 0.99 * peak


def test_the_band_is_the_standard_deviation_of_the_model(fit, data):
    from robustid.mfd import fit_covariance

    chart = mfd_charts.response_charts(FitView(fit, data))[1]
    band = layers(chart, 0)["model ± σ"]
    deviation = fit_covariance(fit).response_std(HZ * band.x)[:, 0, 1]
    np.testing.assert_allclose(band.high - band.y, deviation, rtol=0.05, atol=2e-5 * band.y.max())
    np.testing.assert_allclose(layers(chart, 0)["σ of the model"].y, deviation, rtol=2e-3)


def test_noise_of_the_data_is_drawn_where_it_is_known():
    system = random_modal_system(4, 2, 1, 2)
    spread = 0.01 * np.abs(system.response(1j * OMEGA))
    known = dataclasses.replace(measured(system, OMEGA), covariance=np.eye(2) * spread[:, None, :, 0] ** 2)
    view = FitView(fit_mfd(known, order=4), known)
    chart = mfd_charts.response_charts(view)[1]
    np.testing.assert_allclose(layers(chart, 0)["σ of the data"].y, spread[:, 1, 0], rtol=1e-5)
    # whitened: half a unit of cost per free real equation, with the spread of a chi-squared mean
    free = view.equations - 4 * 3
    assert view.fit.cost / free == pytest.approx(0.5, abs=4 * 0.5 * np.sqrt(2 / free))


def test_masked_samples_are_drawn_apart():
    frf = measured(random_modal_system(4, 2, 1, 2), OMEGA)
    mask = np.ones(frf.values.shape)
    mask[::10, 0] = 0
    view = FitView(fit_mfd(frf, order=4, weight=rid.Weight.relative(frf.values).scaled(mask)), frf)
    drawn = layers(mfd_charts.response_charts(view)[0], 0)
    assert drawn["data without weight"].x.size == 12
    assert drawn["data"].x.size == drawn["residual |P_o − P|"].x.size == 108
    assert "data without weight" not in layers(mfd_charts.response_charts(view)[1], 0)


def test_the_axis_follows_the_lines():
    assert mfd_charts.log_axis(np.geomspace(1, 100, 50))
    assert not mfd_charts.log_axis(np.linspace(0, 100, 50))
    assert "0 Hz" in mfd_charts.frequency_axis(np.append(0.0, np.geomspace(1, 1e4, 50))).label


def test_thinning_keeps_every_extreme():
    rng = np.random.default_rng(2)
    size, error = rng.lognormal(size=5000), rng.lognormal(size=5000)
    position = np.sort(rng.uniform(0, 7, 5000))
    kept = mfd_charts.thinned(position, [size, error], 100)
    assert kept.size <= 300
    for k in range(99):
        inside = np.flatnonzero((position - position[0]) // ((position[-1] - position[0]) / 100) == k)
        assert {inside[size[inside].argmax()], inside[size[inside].argmin()], inside[error[inside].argmax()]} <= {*kept}
    np.testing.assert_array_equal(mfd_charts.thinned(position[:300], [size[:300], error[:300]], 100), np.arange(300))


def test_six_digits():
    values = np.array([0.0, 1.23456789e-30, -123456789.0, 3.0, np.nan, 1e-5 / 3])
    expected = [0.0, 1.23457e-30, -123457000.0, 3.0, np.nan, 3.33333e-6]
    np.testing.assert_allclose(mfd_charts.rounded(values), expected, rtol=1e-15)


def test_convergence_shows_the_history(fit):
    history = (FitStep("sk", 5.0, 1 + 1e-12, 1.0, np.nan), FitStep("lm", 2.0, 1.0, 1.0, 0.1), fit.history[-1])
    other = dataclasses.replace(fit, history=history, start_cost=9.0, reflected=2, unstable_cost=1.5)
    chart = mfd_charts.convergence_chart(FitView(other))
    cost, condition = layers(chart, 0), layers(chart, 1)
    np.testing.assert_array_equal(cost["start"].y, [9.0])
    np.testing.assert_array_equal(cost["sk"].y, [5.0, np.nan, np.nan])
    np.testing.assert_array_equal(cost["lm"].y, [np.nan, 2.0, fit.history[-1].cost])
    assert cost["best fit, with unstable poles"].y[0] == 1.5
    assert condition["sk"].y[0] == pytest.approx(1e-12, rel=1e-3)
    assert condition["lm"].y[1] == np.finfo(float).eps  # κ = 1 stands on the floor
    assert chart.panels[1].y.log
    assert chart.panels[1].y.range[0] < np.finfo(float).eps


def test_a_start_that_is_exact_has_no_iterations():
    exact = fit_mfd(rid.FrequencyResponse(OMEGA, SMALL.response(1j * OMEGA)), order=4)
    assert exact.status is FitStatus.EXACT
    assert FitView(exact).covariance is None
    if not exact.history:
        assert len(mfd_charts.convergence_chart(FitView(exact)).panels) == 1
    text = " ".join(printed(exact).split())
    assert "Exact" in text
    assert "±" not in text


def test_poles_and_modes(fit):
    rows = FitView(fit).modes
    upper = SYSTEM.poles[::2]
    np.testing.assert_allclose([row.hz for row in rows], np.abs(upper) / HZ, rtol=1e-3)
    plane, damping = (layers(mfd_charts.pole_chart(FitView(fit)), k) for k in (0, 1))
    np.testing.assert_allclose(plane["poles"].x + 1j * plane["poles"].y, upper / HZ, rtol=1e-3)
    np.testing.assert_allclose(damping["modes"].y, SYSTEM.damping, rtol=0.03)
    np.testing.assert_allclose(damping["modes"].high - damping["modes"].y, [row.damping_std for row in rows])
    # One standard deviation: 8 numbers of 2 % noise lie within four of them
    for row, pole in zip(rows, upper, strict=True):
        assert abs(row.hz - abs(pole) / HZ) < 4 * row.hz_std
        assert f"{row.hz:.3f}"[:5] in mfd_facts.mode_cells(FitView(fit), row)[0]


def test_discrete_time_and_linear_axis():
    system = random_modal_system(3, 1, 1, 2, band_hz=(20, 800), dt=5e-4)
    frf = measured(system, HZ * np.linspace(5, 950, 200))
    chart = mfd_charts.pole_chart(FitView(fit_mfd(frf, order=4, feedthrough=True)))
    assert chart.panels[0].square
    poles = layers(chart, 0)["poles"]
    assert np.abs(np.sort_complex(poles.x + 1j * poles.y) - np.sort_complex(system.poles)).max() < 1e-3
    assert not chart.panels[1].x.log


# ---------------------------------------------------------------- what is claimed


def test_checks_hold_and_find_what_is_wrong(fit, left, body):
    for result in (fit, left, body):
        assert all(check.holds for check in FitView(result).checks)
        assert mfd_facts.verdict(FitView(result)).key == "consistent"
    wrong = dataclasses.replace(fit, cost=fit.cost * 1.01)
    cost, stable, condition = FitView(wrong).checks
    assert (cost.holds, stable.holds, condition.holds) == (False, True, True)
    assert mfd_facts.verdict(FitView(wrong)).word == "Not verified"
    assert "the state-space model has the cost" in printed(wrong)
    worse = (*fit.history, FitStep("lm", fit.cost, 1.1, 1.0, 0.0))
    assert not FitView(dataclasses.replace(fit, history=worse)).checks[2].holds
    fraction = dataclasses.replace(fit.fraction, A=-fit.fraction.A)
    assert FitView(dataclasses.replace(fit, fraction=fraction)).checks[1].measured == 8


def test_rigid_body_is_verified_and_told(body):
    names = [check.name for check in FitView(body).checks]
    assert any("rigid body" in name for name in names)
    text = " ".join(printed(body).split())
    assert "1 undamped mode, 2 states, driven by the inputs in the directions (" in text
    first, second = re.search(r"directions \((\S+), (\S+)\)", text).groups()
    assert float(first) / float(second) == pytest.approx(2, rel=1e-3)
    assert "rigid body" in [mfd_facts.mode_cells(FitView(body), row)[0] for row in FitView(body).modes]
    page = render_report(body)
    assert "rigid body" in page
    assert "inf" not in {cell for row in FitView(body).modes for cell in mfd_facts.mode_cells(FitView(body), row)}


@pytest.mark.parametrize("status", list(FitStatus))
def test_every_status_has_its_word(fit, status):
    verdict = mfd_facts.verdict(FitView(dataclasses.replace(fit, status=status)))
    assert (verdict.key == "consistent") == status.converged
    assert verdict.sentence[0].isupper()
    assert "converged:" not in verdict.sentence


def test_summary_in_sixty_columns_keeps_its_numbers(fit, data):
    text = printed(fit, width=80, data=data)
    for row in FitView(fit, data).modes:
        assert mfd_facts.mode_cells(FitView(fit, data), row)[0] in text
    assert NASTY.split(">")[0] in " ".join(text.split())


# ---------------------------------------------------------------- order


def test_order_charts(sweep):
    singular, cost, criteria = mfd_order_charts.order_chart(sweep).panels
    assert {layer.name: layer.x.size for layer in singular.layers}["above the noise"] == sweep.subspace_order
    drawn = {layer.name: layer for layer in (*cost.layers, *criteria.layers)}
    np.testing.assert_array_equal(drawn["cost"].y, sweep.costs)
    np.testing.assert_allclose(drawn["MDL"].y, sweep.mdl - sweep.mdl.min() + 1)
    np.testing.assert_array_equal(drawn["suggested order 4"].x, [4, 4])
    words = mfd_facts.order_words(sweep)
    assert "Order 4" in words
    assert "Not fitted: order 12" in words
    assert "largest order tried" not in words
    alone = dataclasses.replace(sweep, noise_known=True, parameters=np.zeros(2))
    assert "largest order tried" in mfd_facts.order_words(alone)


def test_stabilisation_marks_every_pole_in_the_band(sweep):
    panel = mfd_order_charts.stabilisation_chart(sweep).panels[0]
    marks = [layer for layer in panel.layers if layer.marker]
    assert sum(layer.x.size for layer in marks) == len(sweep.stabilisation)
    stable = next(layer for layer in marks if layer.name.startswith("frequency and damping"))
    assert stable.x.size == 2
    assert np.all(stable.y == 5)
    for hz in stable.x:
        assert np.abs(SMALL.frequency / HZ - hz).min() < 0.01 * hz
    background = panel.layers[0]
    assert panel.y.range == (background.y.min(), background.y.max())


# ---------------------------------------------------------------- pages and figures


def test_page_of_a_fit(fit, data, sweep, tmp_path):
    write_report(fit, tmp_path / "fit.html", data=data, order_sweep=sweep, title="Stage <3>")
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    text = page.replace(get_plotlyjs(), "")
    for words in ("Stage &lt;3&gt;", "Converged", "McMillan degree 8", "Condition", "Stabilisation", "participation"):
        assert words.lower() in text.lower(), words
    assert NASTY not in text
    assert "<b>no</b>" not in text
    figures = specs(page)
    wanted = [f"entry-{i}-{j}-0" for i in (0, 1) for j in (0, 1)] + ["convergence-0", "poles-0", "poles-1"]
    assert list(figures) == [*wanted, "orders-0", "orders-1", "orders-2", "stabilisation-0"]
    assert all(f'id="{name}"' in text for name in figures)
    assert not re.search(r'(src|href)="http', text)
    import plotly.graph_objects as go

    for figure in figures.values():
        go.Figure(figure)  # refuses unknown or malformed properties
    titles = [figures["entry-0-1-0"]["layout"][axis]["title"]["text"] for axis in ("xaxis", "yaxis", "yaxis2")]
    assert titles == ["frequency [Hz]", "magnitude [mm/Nm]", "phase [°]"]
    area = next(trace for trace in figures["entry-0-0-0"]["data"] if trace.get("fill"))
    assert len(area["x"]) == len(area["y"])


def at_more_lines(fit, omega, values):
    """The same fraction on other lines, without a fit that would take long."""
    problem = dataclasses.replace(fit.problem, omega=omega, values=values, weight=rid.Weight.relative(values))
    nodes = type(fit.nodes)(fit.denominator(1j * omega), fit.numerator(1j * omega))
    return dataclasses.replace(fit, problem=problem, nodes=nodes, cost=problem.cost(nodes))


def test_a_large_page_stays_small_and_says_what_it_leaves_out():
    """4x4 with 5000 lines: below 6 MB beyond plotly itself."""
    omega = HZ * np.geomspace(4, 1200, 5000)
    system = random_modal_system(0, 4, 4, 1)
    frf = measured(system, omega)
    result = at_more_lines(fit_mfd(measured(system, OMEGA[::2]), order=2), omega, frf.values)
    assert all(check.holds for check in FitView(result).checks)
    page = render_report(result, data=frf)
    assert len(page.encode()) - len(get_plotlyjs().encode()) < 6e6
    assert "Of the 5000 lines of an entry at most" in page
    traces = {trace["name"]: trace for trace in specs(page)["entry-3-3-0"]["data"] if trace["yaxis"] == "y"}
    assert "model ± σ" in traces
    assert len(traces["data"]["x"]) <= mfd_charts.drawn_lines(FitView(result))
    assert max(traces["data"]["y"]) == pytest.approx(np.abs(frf.values[:, 3, 3]).max(), rel=1e-5)


def test_matplotlib_figures(fit, data, sweep, tmp_path):
    figure = plot_fit(fit, data)
    assert len(figure.axes) == 8
    lines = [line for line in figure.axes[0].lines if line.get_label() is not None]
    assert any(np.array_equal(line.get_ydata(), mfd_charts.rounded(np.abs(data.values[:, 0, 0]))) for line in lines)
    assert [axes.get_xlabel() for axes in figure.axes] == [""] * 6 + ["frequency [Hz]"] * 2
    for drawn in (figure, plot_fit_poles(fit), plot_convergence(fit), plot_orders(sweep)):
        assert all(axes.get_ylabel() for axes in drawn.axes)
    plot_convergence(fit).savefig(tmp_path / "figure.png", dpi=40)
    assert plot_stabilisation(sweep).axes[0].get_xlabel() == "frequency [Hz]"


def test_misuse_is_named(fit, data, sweep, tmp_path):
    other = dataclasses.replace(data, values=2 * data.values)
    path = tmp_path / "a.html"
    with pytest.raises(rid.InputError, match="`data` must be the response that was fitted"):
        write_report(fit, path, data=other)
    with pytest.raises(rid.InputTypeError, match="`data` must be a FrequencyResponse"):
        plot_fit(fit, data.values)
    with pytest.raises(rid.InputTypeError, match="`reduction` doesn't belong to a MatrixFraction"):
        write_report(fit, path, reduction=fit)
    with pytest.raises(rid.InputTypeError, match="`order_sweep` must be an OrderSweep"):
        write_report(fit, path, order_sweep=3)
    with pytest.raises(rid.InputTypeError, match="`order_sweep` must be an OrderSweep"):
        plot_stabilisation({8: fit})
    with pytest.raises(rid.InputTypeError, match="`fit` must be a MatrixFraction"):
        plot_convergence(control.ss(-1, 1, 1, 0))
    with pytest.raises(rid.InputTypeError, match="a MatrixFraction or a FrequencyResponse; got StateSpace"):
        write_report(fit.model, path)
    record = rid.TimeRecord(np.eye(1, 4)[0], [1.5, 0.2, 0.1, 0.05], dt=0.1, bound=0.2)
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)))
    with pytest.raises(rid.InputTypeError, match="`order_sweep` doesn't belong to a Identification"):
        write_report(result, path, order_sweep=sweep)
    assert not path.exists()
