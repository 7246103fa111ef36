"""What a guarantee depends on: a table of known numbers, and a computed one."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice import Sensitivity, Variation
from robustid.report import render_report
from robustid.report.sensitivity_section import sensitivity_chart
from support.report_pages import Page, named


def table(margin=1.3):
    """K = 1, rho = 1.1 and 8 lines as stated; half the gain bound is refuted, one variation isn't solved."""
    nan = float("nan")
    rows = [
        Variation("as stated", "stated", 1.0, 1.1, 8, margin, 0.02, 0.05),
        Variation("gain bound x 0.5", "gain", 0.5, 1.1, 8, 1.7, nan, nan),
        Variation("gain bound x 2", "gain", 2.0, 1.1, 8, 0.4, 0.03, 0.08),
        Variation("decay rate 1.05 (was 1.1)", "decay", 1.0, 1.05, 8, nan, nan, nan),
        Variation("every second frequency point", "lines", 1.0, 1.1, 4, 0.3, 0.05, 0.1),
    ]
    return Sensitivity(np.array([10.0, 20.0]), tuple(rows))


def test_every_panel_holds_its_variations_in_order_and_what_was_stated(simple):
    chart = sensitivity_chart(table(), simple)
    assert [panel.x.label for panel in chart.panels] == ["gain bound K [–]", "decay rate ρ [–]", "frequency points [–]"]
    expected = {0: ([0.5, 1, 2], [np.nan, 2, 3]), 1: ([1.05, 1.1], [np.nan, 2]), 2: ([4, 8], [5, 2])}
    for number, (x, median) in expected.items():
        panel = chart.panels[number]
        layer = named(panel, "median over the frequencies")
        np.testing.assert_allclose(layer.x, x)
        np.testing.assert_allclose(layer.y, median)
        rings = [ring for ring in panel.layers if ring.name == "as stated"]
        assert [(ring.x.tolist(), ring.y.tolist()) for ring in rings] == [
            ([[1.0], [1.1], [8.0]][number], [5.0]),
            ([[1.0], [1.1], [8.0]][number], [2.0]),
        ]
        assert panel.y == chart.panels[0].y  # one scale
    np.testing.assert_allclose(named(chart.panels[0], "worst of the frequencies").y, [np.nan, 5, 8])


def test_page_names_what_moves_most_and_what_is_refuted(simple):
    found = table(simple.margin)
    page = Page(render_report(simple, sensitivity=found))
    wanted = [
        "moves most with the number of frequency points: with every second frequency point the"
        " median half-width is 5 % of the response"
        " instead of 2 %",
        "at 2 frequencies from 1.592 to 3.183 Hz",
        "1.7: refuted",
        "not solved",
        "gain bound × 2",
        "× 1.5",
        "never prove them",
    ]
    assert [text for text in wanted if text not in page.text] == []
    assert {"sensitivity-0", "sensitivity-1", "sensitivity-2"} <= set(page.figures)


def test_nothing_to_compare_with_is_said(simple):
    stated = table(simple.margin).variations[1:2]
    refuted = Sensitivity(
        np.array([1.0]), (Variation("as stated", "stated", 1.0, 1.1, 8, simple.margin, *2 * [np.nan]), *stated)
    )
    text = Page(render_report(simple, sensitivity=refuted)).text
    assert "None of the variations leaves a guarantee to compare with" in text


def test_a_computed_table_belongs_to_its_problem(tmp_path):
    frf = rid.FrequencyResponse([10.0, 60.0], [1.0, -0.5], bound=0.1, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=9.0, decay_rate=1.2))
    result, found = rid.identify(problem), rid.advise.sensitivity(problem, omega=[30.0])
    rid.write_report(result, tmp_path / "page.html", sensitivity=found)
    text = Page((tmp_path / "page.html").read_text(encoding="utf-8")).text
    assert f"{100 * found.variations[0].worst:.2g}"[:3] in text
    wide = rid.identify(
        rid.MixedProblem(frequency=frf.with_bound(0.001), prior=rid.Prior(gain_bound=0.9, decay_rate=1.2))
    )
    assert wide.margin_lower > 1.01 * result.margin
    with pytest.raises(rid.InputError, match="`sensitivity` is about another problem"):
        rid.write_report(wide, tmp_path / "no.html", sensitivity=found)
    assert not (tmp_path / "no.html").exists()
