"""What a report says, in HTML and at the terminal: text, numbers, escapes, misuse."""

from __future__ import annotations

import dataclasses
import io
import json
import re
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.report import (
    charts,
    evidence,
    facts,
    plot_frequency_response,
    plot_poles,
    plot_residuals,
    plot_time_response,
    render_summary,
    write_report,
)
from robustid.report.html import _json, render_report
from robustid.report.plotly_figures import plotly_figure
from robustid.report.style import number
from support.report_pages import NASTY, Page, printed, problem

# ---------------------------------------------------------------- plotly and HTML


def test_plotly_accepts_and_holds_the_numbers_of_the_chart(consistent: rid.Identification) -> None:
    import plotly.graph_objects as go

    for chart in (
        charts.frequency_chart(consistent),
        evidence.residual_chart(consistent),
        evidence.pole_chart(consistent),
    ):
        figure = plotly_figure(chart.panels[:1], 400)
        go.Figure(figure)  # refuses unknown or malformed properties
        for trace, layer in zip(figure["data"], chart.panels[0].layers, strict=True):
            np.testing.assert_array_equal(np.array(trace["y"], float), layer.y)
            if layer.low is not None:
                np.testing.assert_allclose(layer.y - trace["error_y"]["arrayminus"], layer.low, atol=1e-12)


def test_page_of_a_consistent_result(consistent: rid.Identification, reduction: Any) -> None:
    page = Page(render_report(consistent, reduction=reduction, title="Torsion test 7"))
    assert page.text.count("Torsion test 7") == 2  # heading and title
    wanted = ["Consistent", "never prove", "K = 20 rad/A", "ρ = 1.04", "17.67 Hz with damping 0.004", "0.004"]
    wanted += ["simulated errors, uniform within the bound", f"order {consistent.order}", f"→ {reduction.order}"]
    wanted += ["numpy", "cvxpy", "control", "scipy", "Python", rid.__version__, "margin", "Re 17.67 Hz"]
    wanted += [check.name for check in consistent.verification.checks]
    wanted += [number(value, 6) for value in consistent.parameters]
    assert [text for text in wanted if text not in page.text] == []
    sections = ["Margin", "What was assumed", "Frequency response", "Time response", "Residuals", "Samples that"]
    sections += ["Order", "Poles", "Verification", "Parameters", "Computed with"]
    places = [page.text.index(f"\n{section}") for section in sections]
    assert places == sorted(places)
    ids = {attrs["id"] for tag, attrs in page.tags if tag == "figure"}
    assert ids == set(page.figures)
    assert {"frequency-0", "time-0", "time-1", "time-2", "residuals-0", "residuals-1", "hankel-0", "poles-0"} <= ids
    names = {trace["name"] for figure in page.figures.values() for trace in figure["data"]}
    assert {f"nominal model, order {consistent.order}", f"reduced model, order {reduction.order}"} <= names


def test_units_reach_every_axis_of_the_page(consistent: rid.Identification) -> None:
    figures = Page(render_report(consistent)).figures
    for name, figure in figures.items():
        for axis, layout in figure["layout"].items():
            if axis[:5] in ("xaxis", "yaxis"):
                label = layout["title"]["text"]
                assert "[" in label or label == "|residual| / bound", (name, axis, label)
    assert figures["frequency-0"]["layout"]["yaxis"]["title"]["text"] == "torsion [rad] / current [A]"
    assert figures["time-0"]["layout"]["yaxis"]["title"]["text"] == "torsion [rad]"


def test_page_of_an_inconsistent_result(inconsistent: rid.Identification) -> None:
    page = Page(render_report(inconsistent))
    assert "Inconsistent" in page.text
    assert "Samples that contradict the assumptions" in page.text
    kind, _, at, share = inconsistent.conflicting_samples()[0]
    assert kind == "frequency"
    assert f"{number(at / (2 * np.pi), 5)} Hz" in page.text
    assert f"{number(100 * share, 2)} %" in page.text
    assert facts.margin_interval(inconsistent) in page.text
    assert number(inconsistent.margin) in facts.margin_words(inconsistent)


@pytest.mark.parametrize("kept", ["time", "frequency"])
def test_page_of_one_kind_of_data(kept: str) -> None:
    result = rid.identify(problem(time=kept == "time", frequency=kept == "frequency"))
    page = Page(render_report(result))
    assert ("No frequency samples" in page.text) == (kept == "time")
    assert ("No time records" in page.text) == (kept == "frequency")
    assert [name for name in page.figures if name.startswith("residuals")] == ["residuals-0"]
    assert len([name for name in page.figures if name.startswith("time")]) == 2 + (kept == "time")


def test_undecided_and_unverified_results_are_not_called_consistent(simple: rid.Identification) -> None:
    certificate = dataclasses.replace(simple.certificate, value=1 - 1e-6)
    claim = dataclasses.replace(simple.claim, margin=1 + 1e-6, certificate=certificate)
    undecided = dataclasses.replace(simple, claim=claim)
    assert facts.verdict(undecided).word == "Undecided"
    check = dataclasses.replace(simple.verification.checks[0], measured=np.inf)
    broken = dataclasses.replace(simple.verification, checks=(check, *simple.verification.checks[1:]))
    false = dataclasses.replace(simple, claim=dataclasses.replace(claim, margin=1.0), verification=broken)
    assert false.status is rid.Status.CONSISTENT
    for text in (Page(render_report(false)).text, printed(false)):
        assert "Not verified" in text
        assert check.name in text
    assert "✗ fails" in Page(render_report(false)).text
    assert "FAILS" in printed(false)


def test_a_class_that_says_little_is_amber_and_warned_of(consistent: rid.Identification) -> None:
    # K = 20 where the largest response is about 7.
    assert len(consistent.warnings) >= 1
    assert facts.verdict(consistent).key == "weak"
    page, text = Page(render_report(consistent)), " ".join(printed(consistent).split())
    assert ("section", {"class": "verdict weak", "id": "verdict"}) in page.tags
    for words in ("Consistent, but the class says little", *consistent.warnings):
        assert words in page.text
        assert words in text
    narrow = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    pairs = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)
    strong = rid.identify(dataclasses.replace(consistent.problem, prior=narrow, parametric=pairs))
    assert strong.warnings == ()
    assert facts.verdict(strong).word == "Consistent"
    assert "Warning" not in printed(strong)


def test_choices_of_the_program_are_shown_and_escaped(simple: rid.Identification) -> None:
    noted = dataclasses.replace(simple, notes=(f"K = 1 from {NASTY}", "rho = 1.1"))
    page, text = Page(render_report(noted)), printed(noted)
    for words in (facts.CHOSEN, *noted.notes):
        assert words in page.text
        assert words in text
    assert len(page.scripts) == 3
    assert facts.CHOSEN not in Page(render_report(simple)).text
    assert facts.CHOSEN not in printed(simple)


@pytest.mark.parametrize(
    ("lower", "upper", "text"),
    [
        (0.87, 0.870471, "0.870000 … 0.870471"),
        (0.0, 0.5, "0 … 0.500000"),
        (12.5, 12.50001, "12.5000"),
        (0.0, 2e-7, "0 … 2×10⁻⁷"),
    ],
)
def test_both_ends_of_the_margin_have_equal_digits(
    simple: rid.Identification, lower: float, upper: float, text: str
) -> None:
    certificate = dataclasses.replace(simple.certificate, value=lower)
    claim = dataclasses.replace(simple.claim, margin=upper, certificate=certificate)
    assert facts.margin_interval(dataclasses.replace(simple, claim=claim)) == text


def test_poles_at_zero_are_called_a_delay() -> None:
    frf = rid.flexible_structure().frequency
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.04)
    for delay, words in ((1, None), (2, "delay, 2 samples"), (3, "delay, 3 samples")):
        pairs = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=delay)
        result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=pairs))
        said = dict(facts.assumptions(result))["Parametric part"]
        assert "time constant" not in said
        assert said.endswith(f"{words or 'damping 0.004'}.")
        assert said.count("delay") == (words is not None)
    twice = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1, repeat=2)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=twice))
    said = dict(facts.assumptions(result))["Parametric part"]
    assert said.count("17.67 Hz") == said.count("(2 times)") == 1
    import control

    taps = control.ss(np.eye(3, k=-1), np.eye(3, 1), np.eye(3), 0, 0.01)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=taps))
    assert dict(facts.assumptions(result))["Parametric part"].endswith("poles: none but delays, 1 to 3 samples.")
    assert "delay" in printed(result, rid.balanced_truncation(taps[0, 0], order=1))


def test_summary_is_readable_in_sixty_columns(consistent: rid.Identification, inconsistent: rid.Identification) -> None:
    import rich.console

    for result in (consistent, inconsistent):
        console = rich.console.Console(file=io.StringIO(), width=60)
        console.print(render_summary(result))
        lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
        table = lines[lines.index(next(line for line in lines if line.startswith("Verification"))) :]
        assert max(len(line) for line in lines) <= 60
        assert sum(line.rstrip().endswith("holds") for line in table) == len(result.verification.checks)
        for check in result.verification.checks:
            assert any(number(check.measured) in line and number(check.limit, 6) in line for line in table), check.name
        assert not any(line.rstrip().endswith("…") or "… " in line for line in table)


def test_text_of_strangers_is_escaped() -> None:
    names = {"inputs": [(NASTY, "</script>")], "outputs": [("y\"'&", "<img src=x onerror=alert(2)>")]}
    result = rid.identify(problem(**names, note=f"from {NASTY} & co"))
    models = {"</script><b>model</b>": rid.flexible_structure().truth}
    title = "He said \"no\" & 'yes' {{ 7 * 7 }} <h1>"
    page = Page(render_report(result, title=title, models=models))
    assert len(page.scripts) == 3
    assert not any("alert(1)" in script for script in (page.scripts[0], page.scripts[2]))
    assert [tag for tag, _ in page.tags if tag in ("img", "b")].count("img") == 0
    assert sum(tag == "h1" for tag, _ in page.tags) == 1
    for text in (NASTY, "</script>", "y\"'&", "<img src=x onerror=alert(2)>", title, "</script><b>model</b>"):
        assert text in page.text  # shown as it stands
    # In plotly's labels, which read a subset of HTML, no tag is left but our own line break.
    for label in _labels(page.figures):
        assert not re.search(r"<(?!br>)", label), label


def test_json_can_not_end_its_script_element() -> None:
    value = {"</script>": "<!-- & </SCRIPT>"}
    assert not set("<>&") & set(_json(value))
    assert json.loads(_json(value)) == value


def _labels(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [text for item in value.values() for text in _labels(item)]
    if isinstance(value, list):
        return [text for item in value for text in _labels(item)]
    return [value] if isinstance(value, str) else []


def test_page_needs_nothing_else(consistent: rid.Identification) -> None:
    page = Page(render_report(consistent))
    for tag, attrs in page.tags:
        assert tag not in ("iframe", "object", "embed", "img")
        assert not attrs.get("src")
        assert attrs.get("href", "data:,") == "data:,"
    policy = next(a["content"] for t, a in page.tags if t == "meta" and "http-equiv" in a)
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "showSendToCloud: false" in page.scripts[-1]


def test_a_failing_write_leaves_the_old_file(simple: rid.Identification, tmp_path: Any, monkeypatch: Any) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(rid.InputError, match="models"):
        write_report(simple, path, models={"late": rid.flexible_structure().truth})  # another dt
    assert path.read_text() == "old"

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_report(simple, path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_report(simple, path)
    assert "Inconsistent" in path.read_text()


# ---------------------------------------------------------------- terminal


def test_summary_at_the_terminal(
    consistent: rid.Identification, inconsistent: rid.Identification, reduction: Any
) -> None:
    text = printed(consistent, reduction)
    wanted = ["Consistent", "margin", "torsion [rad] / current [A]", "17.67 Hz with damping 0.004", "never prove them"]
    wanted += [check.name for check in consistent.verification.checks]
    wanted += [f"Order {reduction.order} instead of {consistent.order}"]
    assert [part for part in wanted if part not in " ".join(text.split())] == []
    text = printed(inconsistent)
    assert "Inconsistent" in text
    assert "17.67 Hz" in text
    assert facts.margin_interval(inconsistent) in text


def test_markup_in_names_is_shown_as_it_stands() -> None:
    result = rid.identify(problem(inputs=[("[red]u[/red]", "")], outputs=[("y", "")]))
    assert "[red]u[/red]" in printed(result)


# ---------------------------------------------------------------- misuse


def test_misuse_is_named(simple: rid.Identification, consistent: rid.Identification, tmp_path: Any) -> None:
    import control

    with pytest.raises(rid.InputTypeError, match="`models` must map names"):
        plot_poles(simple, [consistent.model])  # type: ignore[arg-type]
    with pytest.raises(rid.InputTypeError, match="names"):
        plot_poles(simple, {1: consistent.model})  # type: ignore[dict-item]
    with pytest.raises(rid.InputTypeError, match=r"models\['a'\].*StateSpace"):
        plot_residuals(simple, {"a": control.tf(1, [1, 0.5], 0.1)})
    with pytest.raises(rid.InputError, match="1 output and 1 input"):
        plot_time_response(simple, {"a": control.ss(0.5, [[1, 1]], 1, 0, 0.1)})
    with pytest.raises(rid.InputError, match=r"dt = 0.1 s.*control\.sample_system"):
        plot_frequency_response(simple, {"a": control.ss(-1.0, 1, 1, 0)})
    with pytest.raises(rid.InputTypeError, match="`title` must be text"):
        write_report(simple, tmp_path / "a.html", title=3)  # type: ignore[arg-type]
    with pytest.raises(rid.InputTypeError, match="`identification` must be an Identification"):
        write_report(simple.model, tmp_path / "a.html")
    with pytest.raises(rid.InputError, match="folder"):
        write_report(simple, tmp_path)
    assert list(tmp_path.iterdir()) == []
