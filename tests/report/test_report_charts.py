"""What is drawn in a report, in matplotlib too, against numbers known independently."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.report import (
    charts,
    evidence,
    facts,
    plot_frequency_response,
    plot_hankel,
    plot_poles,
    plot_residuals,
    plot_time_response,
    pole_table,
)
from robustid.report.html import render_report
from robustid.report.style import number
from support.report_pages import Page, layers, problem

# ---------------------------------------------------------------- poles and numbers


def test_pole_table_against_the_plant() -> None:
    plant = rid.flexible_structure().truth
    rows = pole_table(plant)
    np.testing.assert_allclose([row.hz for row in rows], [9.0, 17.67], rtol=1e-9)
    np.testing.assert_allclose([row.damping for row in rows], [0.1, 0.004], rtol=1e-8)
    tau = [1 / (2 * np.pi * 9 * 0.1), 1 / (2 * np.pi * 17.67 * 0.004)]
    np.testing.assert_allclose([row.time_constant for row in rows], tau, rtol=1e-8)
    np.testing.assert_allclose([row.modulus for row in rows], np.exp(-0.01 / np.array(tau)), rtol=1e-9)
    assert sum(row.count for row in rows) == plant.nstates


def test_pole_table_of_special_poles() -> None:
    import control

    model = control.ss(np.diag([1.0, 0.0, -0.5, 0.5]), np.ones((4, 1)), np.ones((1, 4)), 0, 0.1)
    rows = {row.pole: row for row in pole_table(model)}
    assert rows[1.0].hz == 0
    assert np.isinf(rows[1.0].time_constant)
    assert np.isnan(rows[0.0].hz)
    assert rows[0.0].time_constant == 0
    assert rows[0.5].time_constant == pytest.approx(0.1 / np.log(2))
    assert rows[0.5].damping == pytest.approx(1)
    assert rows[-0.5].hz == pytest.approx(abs(complex(-np.log(2), np.pi)) / 0.1 / (2 * np.pi))
    continuous = pole_table(control.ss([[0, 1], [-4, 0]], [[0], [1]], [[1, 0]], 0))
    assert [(row.hz, row.damping) for row in continuous] == [(pytest.approx(1 / np.pi), pytest.approx(0))]


def test_pole_table_refuses_a_model_without_sample_time() -> None:
    import control

    with pytest.raises(rid.InputError, match="without a sample time"):
        pole_table(control.ss(0.5, 1, 1, 0, True))


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (-1.5, "−1.5"), (1e-7, "1×10⁻⁷"), (123456.0, "1.235×10⁵"), (-np.inf, "−∞")]
)
def test_number(value: float, text: str) -> None:
    assert number(value) == text


# ---------------------------------------------------------------- what is drawn


def test_curve_is_the_response_of_the_model_and_resolves_the_light_mode(consistent: rid.Identification) -> None:
    truth = rid.flexible_structure().truth
    chart = charts.frequency_chart(consistent, {"plant": truth})
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


def test_phase_is_continuous_where_it_stays_within_two_turns() -> None:
    experiment = rid.flexible_structure()
    prior = rid.Prior(gain_bound=1e-6, decay_rate=1.04)  # next to nothing beside the true modes
    pairs = rid.kautz(experiment.modes[:, 0], experiment.modes[:, 1], dt=0.01, delay=1)
    result = rid.identify(rid.MixedProblem(frequency=experiment.frequency, prior=prior, parametric=pairs))
    panel = charts.frequency_chart(result).panels[1]
    curve = panel.layers[0]
    assert np.all(np.isfinite(curve.y))
    assert np.max(np.abs(np.diff(curve.y))) < 90  # a wrapped curve jumps by 360
    assert curve.y.min() < -180  # past the second mode
    assert panel.y.range[0] < curve.y.min()
    assert panel.y.range[1] > curve.y.max()


def test_bars_are_the_discs_of_the_samples(consistent: rid.Identification) -> None:
    frf = consistent.problem.frequency[0]
    chart = charts.frequency_chart(consistent)
    magnitude, phase = (layers(chart, k)["data with their discs"] for k in (0, 1))
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


def test_disc_around_zero_and_sample_at_zero_hertz() -> None:
    frf = rid.FrequencyResponse([0.0, 5.0, 10.0], [1.0, 0.01j, -0.4j], bound=0.05, dt=0.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=3.0, decay_rate=1.1)))
    chart = charts.frequency_chart(result)
    magnitude, phase = (layers(chart, k)["data with their discs"] for k in (0, 1))
    assert phase.high[1] - phase.low[1] == 360
    assert magnitude.low[1] == chart.panels[0].y.range[0]
    assert magnitude.x[0] == chart.panels[0].x.range[0] > 0
    assert "0 Hz" in chart.panels[1].x.label
    axis = evidence.residual_chart(result).panels[0].x
    assert "0 Hz" in axis.label
    np.testing.assert_allclose(np.array(axis.range) * 2 * np.pi, [5.0 / 1.1, 10.0 * 1.1])  # that of the lines


def test_records_and_step_response(consistent: rid.Identification) -> None:
    import control

    chart = charts.time_chart(consistent, {"plant": rid.flexible_structure().truth})
    record, bound = consistent.problem.time[0], consistent.problem.time[0].bound[:, 0]
    data, model = (
        layers(chart, 0)["data with their intervals"],
        layers(chart, 0)[f"nominal model, order {consistent.order}"],
    )
    np.testing.assert_allclose((data.y, data.low, data.high), [record.y[:, 0] + s * bound for s in (0, -1, 1)])
    simulated = control.forced_response(consistent.model, record.time, record.u[:, 0]).outputs
    np.testing.assert_allclose(model.y, simulated, atol=1e-9)
    assert np.all(np.abs(data.y - model.y) <= bound)
    step, pulse = (layers(chart, k)["plant"] for k in (1, 2))
    exact = control.step_response(rid.flexible_structure().truth, step.x)
    np.testing.assert_allclose(step.y, exact.outputs, atol=1e-10)
    np.testing.assert_allclose(np.cumsum(pulse.y), step.y, atol=1e-10)


def test_free_and_periodic_records_and_unused_samples() -> None:
    rng = np.random.default_rng(1)
    truth = rid.flexible_structure().truth
    parametric = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.05)
    import control

    period = rng.standard_normal(16)
    y = control.forced_response(truth, None, np.tile(period, 200)).outputs
    bound = np.full(16, 0.05)
    bound[:4] = np.inf
    for initial in ("free", "periodic"):
        record = rid.TimeRecord(period, y[-16:], dt=0.01, bound=bound, initial=initial)
        result = rid.identify(rid.MixedProblem(time=record, prior=prior, parametric=parametric))
        assert result.consistent
        panel = charts.time_chart(result).panels[0]
        drawn = {layer.name: layer for layer in panel.layers}
        data = drawn["data with their intervals"]
        assert drawn["not used"].x.size == 4
        assert np.all(np.abs(data.y - drawn[f"nominal model, order {result.order}"].y) <= data.high - data.y)
        assert facts.started(record) in panel.title
        assert ("widened" in panel.title) == (initial == "free")
        assert facts.started(record) in Page(render_report(result)).text
        assert plot_time_response(result).axes[0].get_title(loc="left") == panel.title


def test_residual_chart_marks_exactly_who_touches(inconsistent: rid.Identification) -> None:
    chart = evidence.residual_chart(inconsistent)
    ratios = [r.ratio for r in inconsistent.residuals]
    margin = inconsistent.margin
    assert margin > 10
    for k, ratio in enumerate(ratios):
        drawn = layers(chart, k)
        np.testing.assert_allclose(drawn[f"nominal model, order {inconsistent.order}"].y, ratio)
        touching = ratio >= 0.99 * margin
        assert drawn["touches margin × bound"].x.size == touching.sum() > 0
        assert drawn["outside its bound"].x.size == ((ratio > 1) & ~touching).sum()
        assert np.all(drawn["limit: residual = bound"].y == 1)
        assert np.all(drawn[f"smallest reachable: {number(margin)}"].y == margin)
        assert chart.panels[k].y.log


def test_residual_chart_of_consistent_data(simple: rid.Identification, consistent: rid.Identification) -> None:
    # |1.5 - x0| = s 0.2 with |x0| <= 1 at best: margin 2.5.
    assert simple.margin == pytest.approx(2.5, rel=1e-3)
    drawn = layers(evidence.residual_chart(simple), 0)
    np.testing.assert_allclose(drawn["touches margin × bound"].x[0], 0.0)
    assert not evidence.residual_chart(simple).panels[0].y.log
    assert facts.limiting(simple)[0].place == "0 s"
    assert facts.limiting(simple)[0].share > 0.9
    assert not any("touches" in name or "outside" in name for name in layers(evidence.residual_chart(consistent), 0))
    assert facts.limiting(consistent) == []


def test_hankel_chart_marks_the_order(consistent: rid.Identification, reduction: Any) -> None:
    from robustid.reduction import hankel_singular_values

    drawn = layers(evidence.hankel_chart(consistent, reduction), 0)
    values = hankel_singular_values(consistent.model)
    assert drawn["kept"].x.size == reduction.order
    np.testing.assert_allclose(np.concatenate([drawn["kept"].y, drawn["truncated"].y]), values, rtol=1e-6)
    assert np.all(drawn[f"chosen order {reduction.order}"].x == reduction.order + 0.5)
    assert list(layers(evidence.hankel_chart(consistent), 0)) == ["of the nominal model"]


def test_integrators_are_kept_aside() -> None:
    import control

    integrator = control.ss(1.0, 1.0, 1.0, 0, 0.1)
    record = rid.TimeRecord(np.ones(8), np.arange(8.0), dt=0.1, bound=0.1)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    result = rid.identify(rid.MixedProblem(time=record, prior=prior, parametric=integrator))
    chart = evidence.hankel_chart(result)
    assert "1 state on the stability boundary" in chart.panels[0].title
    assert layers(chart, 0)["of the nominal model"].x.size == result.order - 1
    assert "integrator" in dict(facts.assumptions(result))["Parametric part"]
    assert "∞" in Page(render_report(result)).text


def test_pole_chart(consistent: rid.Identification) -> None:
    chart = evidence.pole_chart(consistent)
    drawn = layers(chart, 0)
    circle = drawn["|z| = 1/ρ = 0.9615"]
    np.testing.assert_allclose(np.hypot(circle.x, circle.y), 1 / 1.04)
    poles = drawn[f"nominal model, order {consistent.order}"]
    np.testing.assert_allclose(np.sort_complex(poles.x + 1j * poles.y), np.sort_complex(consistent.model.poles()))
    damping = layers(chart, 1)[f"nominal model, order {consistent.order}"]
    assert damping.y.min() == pytest.approx(0.004, rel=1e-6)
    assert damping.x[np.argmin(damping.y)] == pytest.approx(17.67, rel=1e-9)


def test_units_of_time_and_amplitude_scale_what_is_drawn() -> None:
    base = problem()
    frf, record = base.frequency[0], base.time[0]
    first = rid.identify(base)
    worst = 0.0
    for t, a in ((2.0**60, 1.0), (2.0**-60, 1.0), (1.0, 2.0**60), (1.0, 2.0**-60)):
        scaled = rid.MixedProblem(
            frequency=dataclasses.replace(
                frf, omega=frf.omega / t, dt=frf.dt * t, values=frf.values * a, bound=frf.bound * a
            ),
            time=dataclasses.replace(record, dt=record.dt * t, y=record.y * a, bound=record.bound * a),
            prior=rid.Prior(gain_bound=20.0 * a, decay_rate=1.04),
            parametric=rid.kautz(2 * np.pi * 17.67 / t, 0.004, dt=0.01 * t, delay=1),
        )
        second = rid.identify(scaled)
        for chart, x, y in (
            (charts.frequency_chart, 1 / t, a),
            (charts.time_chart, t, a),
            (evidence.residual_chart, None, 1),
        ):
            for one, two in zip(chart(first).panels, chart(second).panels, strict=True):
                step = x if x is not None else (1 / t if "[Hz]" in one.x.label else t)
                rise = 1 if "°" in one.y.label else y
                for p, q in zip(one.layers, two.layers, strict=True):
                    size = np.nanmax(np.abs(p.y)) * rise
                    assert p.x.shape == q.x.shape
                    worst = max(worst, float(np.nanmax(np.abs(q.y - rise * p.y)) / size))
                    np.testing.assert_allclose(q.x, step * p.x, rtol=1e-9)
        plot_frequency_response(second).canvas.draw()
        render_report(second)
    assert worst < 1e-9


# ---------------------------------------------------------------- matplotlib


def all_plots(result: rid.Identification, models: Any = None) -> list[Any]:
    plots = (plot_frequency_response, plot_time_response, plot_residuals, plot_poles)
    return [*(plot(result, models) for plot in plots), plot_hankel(result)]


def test_every_axis_has_a_label_with_its_unit(consistent: rid.Identification) -> None:
    frequency, time, residuals, _, hankel = all_plots(consistent)
    assert frequency.axes[0].get_ylabel() == "torsion [rad] / current [A]"
    assert frequency.axes[1].get_ylabel() == "phase [°] of\ntorsion / current"
    assert frequency.axes[1].get_xlabel() == residuals.axes[0].get_xlabel() == "frequency [Hz]"
    assert [ax.get_xlabel() for ax in time.axes] == ["time [s]"] * 3
    assert [ax.get_ylabel() for ax in time.axes] == ["torsion [rad]"] * 3
    assert "1 A" in time.axes[1].get_title(loc="left")
    assert "torsion [rad] / current [A]" in hankel.axes[0].get_ylabel()
    assert [ax.get_title(loc="left") for ax in residuals.axes] == [
        "torsion [rad] / current [A]: frequency samples",
        "torsion [rad]: time samples",
    ]
    for figure in (*all_plots(consistent), plot_hankel(consistent)):
        figure.canvas.draw()
        assert all(ax.get_ylabel() for ax in figure.axes)
        assert figure.axes[-1].get_xlabel()


def test_matplotlib_draws_the_numbers_of_the_chart(consistent: rid.Identification) -> None:
    figure, chart = plot_frequency_response(consistent), charts.frequency_chart(consistent)
    for ax, panel in zip(figure.axes, chart.panels, strict=True):
        lines = {line.get_color(): line for line in ax.lines if line.get_linestyle() == "-"}
        for layer in panel.layers:
            if layer.dash:
                np.testing.assert_array_equal(lines[layer.colour].get_ydata(), layer.y)
        bars = ax.containers[0].lines[2][0].get_segments()
        data = panel.layers[-1]
        np.testing.assert_allclose([s[:, 1] for s in bars], np.stack([data.low, data.high], axis=1))


def test_the_legend_covers_no_data(inconsistent: rid.Identification) -> None:
    for figure in all_plots(inconsistent, {"plant": rid.flexible_structure().truth}):
        figure.canvas.draw()
        legend = figure.legends[0].get_window_extent()
        assert not any(legend.overlaps(ax.get_window_extent()) for ax in figure.axes)
        assert legend.x1 <= figure.bbox.x1


def test_plots_leave_no_global_state(simple: rid.Identification) -> None:
    import matplotlib
    import matplotlib._pylab_helpers as helpers

    open_figures = len(helpers.Gcf.figs)
    with matplotlib.rc_context({"font.size": 5.0, "axes.grid": False}):
        all_plots(simple)
        assert matplotlib.rcParams["font.size"] == 5.0
        assert not matplotlib.rcParams["axes.grid"]
    assert len(helpers.Gcf.figs) == open_figures


def test_text_of_the_user_is_not_mathematics() -> None:
    names = {"inputs": [("cost $a$ and $\\bad{", "$")], "outputs": [("y_1^2", "<b>m</b>")]}
    result = rid.identify(problem(**names))
    figure = plot_frequency_response(result, {"$\\nothing": rid.flexible_structure().truth})
    figure.canvas.draw()
    assert "a" in figure.axes[0].get_ylabel()


def test_many_lines_are_drawn_as_an_area_behind_the_models() -> None:
    omega = np.linspace(1.0, 300.0, 400)
    frf = rid.FrequencyResponse(omega, 0.1 / (1.2 - np.exp(-0.01j * omega)), dt=0.01, bound=0.05)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.15)))
    assert result.consistent
    assert result.length
    assert "Taylor coefficients" in result.summary()
    for panel in charts.frequency_chart(result).panels:
        area, samples, model = panel.layers
        assert area.fill
        assert not samples.dash
        assert samples.low is None
        assert np.all(area.low <= samples.y)
        assert np.all(area.high >= samples.y)
        assert model.name.startswith("nominal model")
