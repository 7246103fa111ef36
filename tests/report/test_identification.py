"""The page of an identification: what it says and what it draws."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import Choice, Source
from robustid.report import plot, render_report
from robustid.report.assumptions import CHOSEN
from robustid.report.frequency import frequency_charts
from robustid.report.identification_page import identification_verdict, margin_interval, margin_words
from robustid.report.residual_charts import residual_chart
from robustid.report.time_response import time_chart
from robustid.report.words import number
from support.report_pages import NASTY, Page, printed, problem

pytestmark = pytest.mark.quick


def test_page_of_a_consistent_result(consistent, reduction):
    page = Page(render_report(consistent, reduction=reduction, title="Torsion test 7"))
    assert page.text.count("Torsion test 7") == 2  # heading and title
    wanted = ["Consistent", "never prove", "K = 20 rad/A", "ρ = 1.04", "17.67 Hz with damping 0.004", "0.004"]
    wanted += ["simulated errors, uniform within the bound", f"order {consistent.order}", f"→ {reduction.order}"]
    wanted += ["numpy", "cvxpy", "control", "scipy", "Python", rid.__version__, "margin", "mode at 17.67 Hz, real part"]
    wanted += [check.name for check in consistent.verification.checks]
    wanted += [number(value, 6) for value in consistent.parameters]
    assert [text for text in wanted if text not in page.text] == []
    sections = [
        "Consistency margin",
        "What was assumed",
        "Frequency response",
        "Time response",
        "Residuals",
        "Active constraints",
    ]
    sections += ["Order", "Poles", "Verification", "Parameters", "Computed with"]
    places = [page.text.index(f"\n{section}") for section in sections]
    assert places == sorted(places)
    ids = {attrs["id"] for tag, attrs in page.tags if tag == "figure"}
    assert ids == set(page.figures) | {"first-0"}
    assert {"frequency-0", "time-0", "time-1", "time-2", "residuals-0", "residuals-1", "hankel-0", "poles-0"} <= ids
    names = {trace["name"] for figure in page.figures.values() for trace in figure["data"]}
    assert {f"nominal model, order {consistent.order}", f"reduced model, order {reduction.order}"} <= names


def test_units_reach_every_axis_of_the_page(consistent_page):
    figures = Page(consistent_page).figures
    for name, figure in figures.items():
        for axis, layout in figure["layout"].items():
            if axis[:5] in ("xaxis", "yaxis"):
                label = layout["title"]["text"]
                assert "[" in label or label == "|residual| / bound", (name, axis, label)
    assert figures["frequency-0"]["layout"]["yaxis"]["title"]["text"] == "torsion [rad] / current [A]"
    assert figures["time-0"]["layout"]["yaxis"]["title"]["text"] == "torsion [rad]"


def test_page_of_an_inconsistent_result(inconsistent):
    page = Page(render_report(inconsistent))
    assert "Inconsistent" in page.text
    assert "Samples that contradict the assumptions" in page.text
    kind, _, at, share = inconsistent.conflicting_samples()[0]
    assert kind == "frequency"
    assert f"{number(at / (2 * np.pi), 5)} Hz" in page.text
    assert f"{number(100 * share, 2)} %" in page.text
    assert margin_interval(inconsistent) in page.text
    assert number(inconsistent.margin) in margin_words(inconsistent)


@pytest.mark.parametrize("kept", ["time", "frequency"])
def test_page_of_one_kind_of_data(kept):
    result = rid.identify(problem(time=kept == "time", frequency=kept == "frequency"))
    page = Page(render_report(result))
    assert ("No frequency samples" in page.text) == (kept == "time")
    assert ("No time records" in page.text) == (kept == "frequency")
    assert [name for name in page.figures if name.startswith("residuals")] == ["residuals-0"]
    assert len([name for name in page.figures if name.startswith("time")]) == 2 + (kept == "time")


def test_undecided_and_unverified_results_are_not_called_consistent(simple):
    certificate = dataclasses.replace(simple.certificate, value=1 - 1e-6)
    claim = dataclasses.replace(simple.claim, margin=1 + 1e-6, certificate=certificate)
    undecided = dataclasses.replace(simple, claim=claim)
    assert identification_verdict(undecided).word == "Undecided"
    assert "smaller `accuracy`" in identification_verdict(undecided).sentence
    late = dataclasses.replace(undecided, claim=dataclasses.replace(claim, stopped="stopped at the time limit"))
    assert "more time" in identification_verdict(late).sentence
    for k, answered in (
        (0, True),
        (len(simple.verification.checks) - 1, False),
    ):  # the model; the certificate of the margin
        checks = list(simple.verification.checks)
        checks[k] = dataclasses.replace(checks[k], measured=np.inf)
        broken = dataclasses.replace(simple.verification, checks=tuple(checks))
        false = dataclasses.replace(simple, claim=dataclasses.replace(claim, margin=1.0), verification=broken)
        assert false.status is rid.Status.CONSISTENT
        assert false.verification.answered == answered
        page = Page(render_report(false)).text
        for text in (page, " ".join(printed(false).replace("│", " ").split())):
            assert "Not verified" in text
            assert checks[k].name in text
            assert ("keeps all" in text) == ("What is said of the data stands" in text) == answered
            assert ("neither that the data fit the class" in text) == (not answered)
        assert "✗ fails" in page
        assert "FAILS" in printed(false)


def test_a_class_that_says_little_is_amber_and_warned_of(consistent, consistent_page, strong):
    # K = 20 where the largest response is about 7.
    assert len(consistent.warnings) >= 1
    assert identification_verdict(consistent).key == "weak"
    page, text = Page(consistent_page), " ".join(printed(consistent).split())
    assert ("section", {"class": "verdict weak", "id": "verdict"}) in page.tags
    for words in ("Consistent, but the class says little", *consistent.warnings):
        assert words[1:] in page.text  # where it begins with a capital
        assert words in text
    assert strong.warnings == ()
    assert identification_verdict(strong).word == "Consistent"
    assert "Warning" not in printed(strong)


def test_choices_of_the_program_are_shown_and_escaped(simple):
    prior, rate = (Choice(1.0, Source.DATA, words) for words in (f"K = 1 from {NASTY}", "rho = 1.1"))
    noted = dataclasses.replace(simple, choices={"prior": prior, "rate": rate})
    page, text = Page(render_report(noted)), printed(noted)
    for words in (CHOSEN, *noted.notes):
        assert words[1:] in page.text  # where it begins with a capital
        assert words in text
    assert len(page.scripts) == 3
    assert CHOSEN not in Page(render_report(simple)).text
    assert CHOSEN not in printed(simple)


@pytest.mark.parametrize(
    ("lower", "upper", "text"),
    [
        (0.87, 0.870471, "0.870000 … 0.870471"),
        (0.0, 0.5, "0 … 0.500000"),
        (12.5, 12.50001, "12.5000"),
        (0.0, 2e-7, "0 … 2×10⁻⁷"),
    ],
)
def test_both_ends_of_the_margin_have_equal_digits(simple, lower, upper, text):
    certificate = dataclasses.replace(simple.certificate, value=lower)
    claim = dataclasses.replace(simple.claim, margin=upper, certificate=certificate)
    assert margin_interval(dataclasses.replace(simple, claim=claim)) == text


def test_units_of_time_and_amplitude_scale_what_is_drawn():
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
            (lambda result: frequency_charts(result)[0], 1 / t, a),
            (time_chart, t, a),
            (residual_chart, None, 1),
        ):
            for one, two in zip(chart(first).panels, chart(second).panels, strict=True):
                step = x if x is not None else (1 / t if "[Hz]" in one.x.label else t)
                rise = 1 if "°" in one.y.label else y
                for p, q in zip(one.layers, two.layers, strict=True):
                    size = np.nanmax(np.abs(p.y)) * rise
                    assert p.x.shape == q.x.shape
                    worst = max(worst, float(np.nanmax(np.abs(q.y - rise * p.y)) / size))
                    np.testing.assert_allclose(q.x, step * p.x, rtol=1e-9)
        plot.bode(second).canvas.draw()
        render_report(second)
    assert worst < 1e-9
