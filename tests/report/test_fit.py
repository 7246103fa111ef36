"""The report of a matrix-fraction fit: what it claims and says."""

import dataclasses
import re

import control
import numpy as np
import pytest
from plotly.offline import get_plotlyjs

import robustid as rid
from robustid.fitting import FitStatus, FitStep, fit_mfd, suggest_order
from robustid.report import plot, render_report, write_report
from robustid.report import verdict as verdict_on
from robustid.report.curves import most_drawn, rounded
from robustid.report.fit_charts import convergence_chart, response_charts
from robustid.report.fit_page import _glance, fit_verdict, mode_cells
from robustid.report.fit_view import FitView
from support.fits import HZ, OMEGA, SMALL, measured
from support.mechanics import measured as frequency_response
from support.mechanics import mechanical
from support.mfd_systems import random_modal_system
from support.report_pages import NASTY, Page, printed


def test_the_data_give_the_names():
    omega = np.linspace(1, 9, 60)
    frf = rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16), outputs=["x [m]"])
    view = FitView(fit_mfd(frf, order=2), frf)
    assert view.entry(0, 0) == "x [m] / u"
    assert all(check.holds for check in view.checks)


def test_a_start_that_is_exact_has_no_iterations():
    exact = fit_mfd(rid.FrequencyResponse(OMEGA, SMALL.response(1j * OMEGA)), order=4)
    assert exact.status is FitStatus.EXACT
    assert FitView(exact).covariance is None
    if not exact.history:
        assert len(convergence_chart(FitView(exact)).panels) == 1
    text = " ".join(printed(exact).split())
    assert "Exact" in text
    assert "±" not in text


def test_checks_hold_and_find_what_is_wrong(fit, left, body):
    for result in (fit, left, body):
        assert all(check.holds for check in FitView(result).checks)
        assert fit_verdict(FitView(result)).key == "consistent"
    wrong = dataclasses.replace(fit, cost=fit.cost * 1.01)
    cost, stable, condition = FitView(wrong).checks
    assert (cost.holds, stable.holds, condition.holds) == (False, True, True)
    assert fit_verdict(FitView(wrong)).word == "Not verified"
    assert "the state-space model has the cost" in printed(wrong)
    worse = (*fit.history, FitStep("lm", fit.cost, 1.1, 1.0, 0.0))
    assert not FitView(dataclasses.replace(fit, history=worse)).checks[2].holds
    fraction = dataclasses.replace(fit.fraction, A=-fit.fraction.A)
    assert FitView(dataclasses.replace(fit, fraction=fraction)).checks[1].measured == 8


def test_a_fit_that_converged_is_as_good_as_what_it_says_of_the_data():
    """Four modes by models of one, two and four; the fit of an output by its definition, and an entry of noise decides nothing."""
    omega = np.linspace(1, 9, 60)
    s = 1j * omega
    values = sum(f / (s**2 + 0.02 * f * s + f**2) for f in (2.0, 4.0, 5.5, 7.0))
    for order, key in ((2, "failed"), (4, "weak"), (8, "consistent")):
        fit = fit_mfd(rid.FrequencyResponse(omega, values), order=order)
        view, verdict = FitView(fit), fit_verdict(FitView(fit))
        assert fit.status.converged
        assert verdict.key == key
        model = control.frequency_response(fit.model, omega).frdata.ravel()
        left = np.linalg.norm(values - model) / np.linalg.norm(values - values.mean())
        assert view.fit_percent == view.output_fit_percent == pytest.approx(100 * (1 - left), abs=1e-6)
    noise = 1e-6 * np.exp(2j * np.pi * np.random.default_rng(0).uniform(size=60))
    both = rid.FrequencyResponse(omega, np.stack([values, noise], axis=1)[:, None])
    view = FitView(fit_mfd(both, order=8, weight=np.ones((60, 1, 2))))
    assert view.fit_percent > 99  # the entry of noise is a millionth of the other
    assert view.output_fit_percent > 99
    assert fit_verdict(view).key == "consistent"


def two_modes(omega):
    s = 1j * omega
    return sum(f / (s**2 + 0.02 * f * s + f**2) for f in (2.0, 5.5))


@pytest.mark.parametrize(
    ("error", "key"), [(2.19, "failed"), (0.6, "weak"), (0.05, "consistent"), (np.nan, "consistent")]
)
def test_withheld_points_decide_the_colour_where_there_are_any(error, key):
    omega = np.linspace(1, 9, 60)
    frf = rid.FrequencyResponse(omega, two_modes(omega))
    sweep = suggest_order(frf, orders=[2, 4])
    sweep = dataclasses.replace(sweep, withheld=np.array([9.0, error]))
    view = FitView(sweep.fits[4], frf, sweep)
    said = fit_verdict(view)
    assert said.key == key
    assert sweep.fits[4].status.converged
    assert verdict_on(sweep.fits[4], sweep) == said
    shown = dict(_glance(view, response_charts(view)[0], {}).numbers)
    assert ("fit at withheld points" in shown) == np.isfinite(error)
    assert ("−119 % at frequency points that were withheld" in said.sentence) == (key == "failed")


def test_noise_that_a_fit_follows_is_not_green_where_points_are_withheld():
    """Three realisations of white noise: the fit of high order follows it, the withheld points do not."""
    omega = np.linspace(1, 20, 40)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        frf = rid.FrequencyResponse(omega, rng.standard_normal(40) + 1j * rng.standard_normal(40))
        sweep = suggest_order(frf, orders=[8])
        assert fit_verdict(FitView(sweep.fits[8], frf, sweep)).key != "consistent"
        assert FitView(sweep.fits[8], frf, sweep).withheld_percent < 50


@pytest.mark.parametrize(("size", "key"), [(0.1, "weak"), (0.001, "consistent")])
def test_an_entry_that_counts_and_is_missed_is_not_green(size, key):
    """The second entry has modes of its own, which a model with the poles of the first misses, by design: its weight is tiny."""
    omega = np.linspace(1, 9, 60)
    values = two_modes(omega)
    other = size * values[::-1].conj()
    weight = np.ones((60, 1, 2)) * [1.0, 1e-6]
    fit = fit_mfd(rid.FrequencyResponse(omega, np.stack([values, other], axis=1)[:, None]), order=4, weight=weight)
    view = FitView(fit)
    assert view.output_fit_percent > 50
    assert fit_verdict(view).key == key
    assert (view.fit_percent < 0) == (key == "weak")


def test_modal_structure_is_told():
    system = mechanical(0, 2, 2, 2, symmetric=True)
    data = frequency_response(system, 0, 0.02)
    result = fit_mfd(data, order=4, modal=rid.fits.Modal("proportional", symmetric=True))
    assert all(check.holds for check in FitView(result).checks)
    text = " ".join(printed(result).split())
    assert "Modes of rank one with real shapes (proportional damping), reciprocal: the response is symmetric" in text
    assert all(row.hz_std > 0 for row in FitView(result).modes)


def test_rigid_body_is_verified_and_told(body):
    names = [check.name for check in FitView(body).checks]
    assert any("rigid body" in name for name in names)
    text = " ".join(printed(body).split())
    assert "1 undamped mode, 2 states, driven by the inputs in the directions (" in text
    first, second = re.search(r"directions \((\S+), (\S+)\)", text).groups()
    assert float(first) / float(second) == pytest.approx(2, rel=1e-3)
    assert "rigid body" in [mode_cells(FitView(body), row)[0] for row in FitView(body).modes]
    page = render_report(body)
    assert "rigid body" in page
    assert "inf" not in {cell for row in FitView(body).modes for cell in mode_cells(FitView(body), row)}


@pytest.mark.parametrize("status", list(FitStatus))
def test_every_status_has_its_word(fit, status):
    verdict = fit_verdict(FitView(dataclasses.replace(fit, status=status)))
    assert (verdict.key == "consistent") == status.converged
    assert verdict.sentence[0].isupper()
    assert "converged:" not in verdict.sentence


def test_summary_in_sixty_columns_keeps_its_numbers(fit, data):
    text = printed(fit, width=80, data=data)
    for row in FitView(fit, data).modes:
        assert mode_cells(FitView(fit, data), row)[0] in text
    assert NASTY.split(">")[0] in " ".join(text.split())


def test_page_of_a_fit(fit, data, sweep, tmp_path):
    write_report(fit, tmp_path / "fit.html", data=data, order_sweep=sweep, title="Stage <3>")
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    text = page.replace(get_plotlyjs(), "")
    for words in ("Stage &lt;3&gt;", "Converged", "McMillan degree 8", "Condition", "Stabilisation", "participation"):
        assert words.lower() in text.lower(), words
    assert NASTY not in text
    assert "<b>no</b>" not in text
    figures = Page(page).figures
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
    problem = dataclasses.replace(fit.problem, omega=omega, values=values, weight=rid.fits.Weight.relative(values))
    nodes = type(fit.nodes)(fit.denominator(1j * omega), fit.numerator(1j * omega))
    return dataclasses.replace(fit, problem=problem, nodes=nodes, cost=problem.cost(nodes))


@pytest.mark.parametrize("lines", [2000, pytest.param(5000, marks=pytest.mark.slow)])
def test_a_large_page_stays_small_and_says_what_it_leaves_out(lines):
    """4x4 with thousands of lines: below 6 MB beyond plotly itself."""
    omega = HZ * np.geomspace(4, 1200, lines)
    system = random_modal_system(0, 4, 4, 1)
    frf = measured(system, omega)
    result = at_more_lines(fit_mfd(measured(system, OMEGA[::2]), order=2), omega, frf.values)
    assert all(check.holds for check in FitView(result).checks)
    page = render_report(result, data=frf)
    assert len(page.encode()) - len(get_plotlyjs().encode()) < 6e6
    assert f"Of the {lines} frequency points of an entry at most" in page
    traces = {trace["name"]: trace for trace in Page(page).figures["entry-3-3-0"]["data"] if trace["yaxis"] == "y"}
    assert "model ± σ" in traces
    assert len(traces["data"]["x"]) <= most_drawn(lines, 16)
    assert max(traces["data"]["y"]) == pytest.approx(np.abs(frf.values[:, 3, 3]).max(), rel=1e-5)


def test_matplotlib_figures(fit, data, sweep, tmp_path):
    figure = plot.bode(fit, data=data)
    assert len(figure.axes) == 8
    lines = [line for line in figure.axes[0].lines if line.get_label() is not None]
    assert any(np.array_equal(line.get_ydata(), rounded(np.abs(data.values[:, 0, 0]))) for line in lines)
    assert [axes.get_xlabel() for axes in figure.axes] == [""] * 6 + ["frequency [Hz]"] * 2
    for drawn in (figure, plot.poles(fit), plot.convergence(fit), plot.orders(sweep)):
        assert all(axes.get_ylabel() for axes in drawn.axes)
    plot.convergence(fit).savefig(tmp_path / "figure.png", dpi=40)
    assert plot.stabilisation(sweep).axes[0].get_xlabel() == "frequency [Hz]"


def test_misuse_is_named(fit, data, sweep, tmp_path):
    other = dataclasses.replace(data, values=2 * data.values)
    path = tmp_path / "a.html"
    with pytest.raises(rid.InputError, match="`data` must be the response that was fitted"):
        write_report(fit, path, data=other)
    with pytest.raises(rid.errors.InputTypeError, match="`data` must be a FrequencyResponse"):
        plot.bode(fit, data=data.values)
    with pytest.raises(rid.errors.InputTypeError, match="`order_sweep` must be an OrderSweep"):
        write_report(fit, path, order_sweep=3)
    with pytest.raises(rid.errors.InputTypeError, match="`result` must be of class OrderSweep; got dict"):
        plot.stabilisation({8: fit})
    with pytest.raises(rid.errors.InputTypeError, match="`result` must be of class MatrixFraction; got StateSpace"):
        plot.convergence(control.ss(-1, 1, 1, 0))
    with pytest.raises(
        rid.errors.InputTypeError, match="ControllerDesign, Comparison, CommonModes, Watch or Fleet; got StateSpace"
    ):
        write_report(fit.model, path)
    record = rid.TimeRecord(np.eye(1, 4)[0], [1.5, 0.2, 0.1, 0.05], dt=0.1, bound=0.2)
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)))
    with pytest.raises(rid.errors.InputTypeError, match="`order_sweep` doesn't belong to a Identification"):
        write_report(result, path, order_sweep=sweep)
    assert not path.exists()
