"""Robust stability margins and structured weights on a page, at the terminal and in figures: against the numbers of the results."""

import dataclasses
from types import SimpleNamespace

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import MarginStatus, RobustStabilityMargin
from robustid.report import plot, render_report
from robustid.report.stability import arc_table, stability_chart, stability_verdict, weights_chart
from support.report_pages import Page, layers, printed

pytestmark = pytest.mark.quick

NYQUIST = np.pi / 0.01


def margin_of(sizes, shares=((1.0,),), *, nyquist=NYQUIST):
    """Upper bounds on arcs of equal length, the largest at the middle of its arc."""
    sizes, edges = np.array(sizes, dtype=float), np.linspace(0, nyquist, len(sizes) + 1)
    worst = int(np.argmax(sizes))
    status = MarginStatus.GUARANTEED if sizes.max() < 1 else MarginStatus.OPEN
    frequency = float(edges[worst : worst + 2].mean())
    condition = SimpleNamespace(on_cells=lambda largest: sizes)
    return RobustStabilityMargin(float(1 / sizes.max()), frequency, status, "entry", np.array(shares), edges, condition)


UNSTABLE = RobustStabilityMargin(0.0, 5.0, MarginStatus.UNSTABLE, "full", np.zeros((1, 1)), np.array([0.0, NYQUIST]))


def test_the_upper_bound_is_the_reciprocal_of_the_margins_with_its_largest_value_marked():
    margin = margin_of([0.2, 0.5, 0.25, 0.125])
    drawn = layers(stability_chart(margin))
    curve = drawn["upper bound"]
    np.testing.assert_allclose(curve.y, [0.2, 0.2, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125])
    np.testing.assert_allclose(curve.x * 2 * np.pi, NYQUIST / 4 * np.array([0, 1, 1, 2, 2, 3, 3, 4]), atol=1e-9)
    mark = drawn["largest"]
    np.testing.assert_allclose([mark.x[0] * 2 * np.pi, mark.y[0]], [margin.frequency, 0.5])
    assert mark.hover == ("18.75 Hz: at most 0.5, margin 2",)
    assert (drawn["limit"].y == 1).all()


def test_arcs_of_one_size_beside_each_other_are_one_peak():
    rows = arc_table(margin_of([0.1, 0.5, 0.5, 0.2, 0.3])).rows
    assert rows == [["10", "30", "0.5", "2"], ["40", "50", "0.3", "3.333"]]
    assert len(arc_table(margin_of([0.5, 0.5])).rows) == 1


def test_margins_of_continuous_models_end_at_the_right_of_the_axis():
    model, gain = control.ss(-1.0, 1.0, 1.0, 0.0), control.ss([], [], [], 0.5)
    margin = rid.guarantee.robust_stability_margin(model, gain, [0.0, 1.0, 10.0, np.inf], [0.1, 0.2, 0.3])
    panel = stability_chart(margin).panels[0]
    curve = layers(stability_chart(margin))["upper bound"]
    assert curve.x[-1] == panel.x.range[1]
    assert np.all(np.diff(curve.x) >= 0)
    np.testing.assert_allclose(curve.y[::2], 1 / margin.margins)
    assert arc_table(margin).rows[0][1] == "∞"
    frf = rid.FrequencyResponse([0.5, 2.0], [0.7, 0.2 - 0.4j], bound=0.5)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=0.5)))
    assert "stability-0" in Page(render_report(result, stability=margin)).figures


@pytest.mark.parametrize(
    ("margin", "key", "words"),
    [
        (margin_of([0.2, 0.5]), "consistent", "could be 2 times as large"),
        (margin_of([0.2, 1.25]), "weak", "at most 0.8 times as large"),
        (UNSTABLE, "inconsistent", "not stable"),
    ],
)
def test_verdicts(margin, key, words):
    verdict = stability_verdict(margin)
    assert verdict.key == key
    assert words in verdict.sentence
    assert words in " ".join(printed(margin).split())


def test_the_page_shows_every_controller_and_one_figure_of_the_stable_ones(simple):
    one, nyquist = margin_of([0.2, 0.5], nyquist=np.pi / 0.1), np.pi / 0.1
    loose = dataclasses.replace(UNSTABLE, edges=np.array([0.0, nyquist]))
    page = Page(render_report(simple, stability={"soft": one, "<b>stiff": loose}))
    assert "soft" in page.text
    assert "<b>stiff" in page.text
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert {"stability-0", "stability-verdict-0", "stability-verdict-1"} <= set(ids)
    assert len(ids) == len(set(ids))
    alone = Page(render_report(simple, stability=loose))
    assert "stability-0" not in alone.figures
    assert "is not stable" in alone.text


def structures():
    nominal = control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 0.01)
    gain = control.ss([], [], [], 0.1 * np.eye(2), 0.01)
    edges, bound = [0.0, 100.0, NYQUIST], np.array([[[0.3, 0.01], [0.02, 0.1]], [[0.2, 0.01], [0.03, 0.1]]])
    return rid.guarantee.structured_weights(nominal, edges, bound, controller=gain)


def test_structures_stand_in_a_table_and_the_first_is_drawn(matrix_error):
    result, found = matrix_error.identification, structures()
    page = Page(render_report(result, weights=found, stability=found[0].margin))
    assert "stable, minimum-phase and above its bound" in page.text
    for one in found:
        assert f"{one.margin.margin:.3g}"[:4] in page.text
    assert {"weights-0", "structures-0", "stability-0"} <= set(page.figures)
    entry = next(one for one in found if one.structure == "entry")
    chart = weights_chart(entry)
    assert [panel.title for panel in chart.panels] == [f"output {i} / input {j}" for i in (1, 2) for j in (1, 2)]
    for k, (i, j) in enumerate(np.ndindex(2, 2)):
        drawn = layers(chart, k)
        np.testing.assert_array_equal(drawn["bound of the error"].y[::2], entry.bound[:, i, j])
        at = np.interp(drawn["bound of the error"].x[1:-1], drawn["|weight|"].x, drawn["|weight|"].y)
        assert (at >= entry.bound[:, i, j].max() * 0.99).all()
    assert len(entry.plot().axes) == 4
    assert "Structures" in printed(entry)
    forged = dataclasses.replace(entry, weights=(dataclasses.replace(entry.weights[0], bound=[9.0, 9.0]),) * 4)
    assert "such a weight leaves out plants" in " ".join(printed(forged).replace("│", " ").split())


def test_a_margin_and_weights_of_another_model_are_refused(simple):
    with pytest.raises(rid.InputError, match=r"`stability`\['a'\] must be about a model of 1 x 1 entries up to 5 Hz"):
        render_report(simple, stability={"a": margin_of([0.5])})
    with pytest.raises(rid.InputError, match="`weights` must be about a model of 1 x 1 entries"):
        render_report(simple, weights=structures())
    with pytest.raises(rid.InputError, match="nominal loops that are stable"):
        plot.stability(UNSTABLE)
