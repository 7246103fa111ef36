"""Reports of worst-case errors: artists and page against the arrays of the result, and against forged ones."""

from __future__ import annotations

import dataclasses
import decimal
import re
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import CircleBound
from robustid.report import plot_nyquist, plot_worst_case, write_report
from robustid.report import worst_case_charts as charts
from robustid.report import worst_case_facts as facts
from robustid.report.charts import Layer
from robustid.report.html import render_report
from robustid.report.style import number
from support.browser import CHROMIUM, opened, plots, widths
from support.report_pages import NASTY, Page, identified, named

HZ = np.array([0.0, 4.0, 9.0, 17.0, 17.6, 30.0, 50.0])


@pytest.fixture(scope="module")
def error() -> rid.WorstCaseError:
    return rid.worst_case_error(identified(), omega=2 * np.pi * HZ, directions=6)


def with_circle(error: rid.WorstCaseError) -> rid.WorstCaseError:
    """A copy whose bound on the whole circle is there already; three arcs, not computed."""
    edges = np.array([0.0, 10.0, 100.0, np.pi / error.identification.problem.dt])
    return error.with_circle(CircleBound(edges, np.array([0.4, 0.9, 0.123456]), 0.3, True, ()))


def at(layer: Layer, hz: np.ndarray) -> np.ndarray:
    index = np.searchsorted(layer.x, hz * (1 - 1e-12))
    np.testing.assert_allclose(layer.x[index], hz, rtol=1e-12)
    return index


# ---------------------------------------------------------------- what is drawn


def test_band_is_the_guaranteed_range_at_every_frequency(error: rid.WorstCaseError) -> None:
    magnitude, phase, _ = charts.worst_case_chart(error).panels
    band = named(magnitude, "guaranteed range (7 frequencies)")
    index = at(band, HZ[1:])
    bottom = magnitude.y.range[0]
    np.testing.assert_allclose(band.low[index], np.maximum(error.magnitude[1:, 0], bottom), rtol=1e-9)
    np.testing.assert_allclose(band.high[index], error.magnitude[1:, 1], rtol=1e-9)
    assert magnitude.y.range[1] > error.magnitude.max()
    turn = named(phase, "guaranteed range (7 frequencies)")
    drawn = np.radians(np.stack([turn.low, turn.high], axis=1)[at(turn, HZ[1:])])
    known = error.magnitude[1:, 0] > 0
    assert 0 < known.sum() < known.size  # both kinds are tested
    np.testing.assert_allclose(np.exp(1j * drawn[known]), np.exp(1j * error.phase[1:][known]), atol=1e-9)
    np.testing.assert_allclose(np.ptp(drawn[known], axis=1), np.ptp(error.phase[1:][known], axis=1), atol=1e-9)
    np.testing.assert_allclose(np.ptp(drawn[~known], axis=1), 2 * np.pi)
    assert phase.y.range[0] <= turn.low.min()
    assert phase.y.range[1] >= turn.high.max()


def test_band_is_next_to_the_curve_of_its_own_model(error: rid.WorstCaseError) -> None:
    small = error.with_model(rid.balanced_truncation(error.model, order=4).model)
    magnitude, phase, _ = charts.worst_case_chart(small).panels
    curve = named(magnitude, "model, order 4")
    np.testing.assert_allclose(curve.y[at(curve, HZ[1:])], np.abs(small.nominal[1:]), rtol=1e-9)
    band = named(magnitude, "guaranteed range (7 frequencies)")
    np.testing.assert_allclose(band.high[at(band, HZ[1:])], small.magnitude[1:, 1], rtol=1e-9)
    assert any(layer.name.startswith("nominal model") for layer in phase.layers)


def test_error_panel_shows_both_ends_and_the_circle_only_if_computed(error: rid.WorstCaseError) -> None:
    panel = charts.worst_case_chart(error).panels[2]
    left = panel.x.range[0]
    upper, lower = named(panel, "guaranteed error"), named(panel, charts.REACHED)
    np.testing.assert_allclose(upper.x, [left, *HZ[1:]])
    np.testing.assert_array_equal(upper.y, error.upper.ravel())
    np.testing.assert_array_equal(lower.y, error.lower.ravel())
    assert "0 Hz drawn at the left end" in panel.title
    assert error.known_circle is None
    assert [layer.name for layer in panel.layers] == [upper.name, lower.name]
    steps = named(charts.worst_case_chart(with_circle(error)).panels[2], "guaranteed between them too")
    circle = with_circle(error).circle
    np.testing.assert_allclose(steps.x[1:] * 2 * np.pi, np.repeat(circle.edges, 2)[2:-1])
    np.testing.assert_array_equal(steps.y, np.repeat(circle.bound, 2))


def test_areas_of_a_curve_with_gaps_have_none() -> None:
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    curve = Layer(name="phase", x=x, y=np.array([0.0, -170.0, np.nan, 170.0, 90.0, 80.0]), colour="")
    pieces = charts.band_around("band", curve, np.array([2.0, 5.0]), np.array([[-1.0, 2.0], [-3.0, 4.0]]))
    assert [piece.x.tolist() for piece in pieces] == [[2.0], [4.0, 5.0]]
    share = np.log(2) / np.log(2.5)
    np.testing.assert_allclose(pieces[1].low, [170 - 1 - 2 * share, 87])
    np.testing.assert_allclose(pieces[1].high, [170 + 2 + 2 * share, 94])
    anything = charts.band_around(
        "band", curve, np.array([2.0, 4.0, 5.0]), np.array([[-1.0, 2.0], [-3, 4], [np.nan, np.nan]])
    )
    assert [(piece.low.tolist(), piece.high.tolist()) for piece in anything[:1]] == [([-171.0], [-168.0])]
    np.testing.assert_allclose([anything[1].low, anything[1].high], [[167, -90], [174, 270]])
    dense = dataclasses.replace(curve, x=np.array([4.0, 4.5, 5.0]), y=np.zeros(3))
    (area,) = charts.band_around("band", dense, np.array([4.0, 5.0]), np.array([[-3.0, 4.0], [np.nan, np.nan]]))
    assert area.low.tolist() == [-3, -180, -180]  # not interpolated towards a phase that can be anything


def test_matplotlib_draws_these_numbers(error: rid.WorstCaseError) -> None:
    figure, chart = plot_worst_case(error), charts.worst_case_chart(error)
    figure.canvas.draw()
    for ax, panel in zip(figure.axes[:2], chart.panels[:2], strict=True):
        band = panel.layers[0]
        drawn = ax.collections[0].get_paths()[0].vertices
        for x, end in zip(np.tile(band.x, 2), np.concatenate([band.low, band.high]), strict=True):
            assert np.any(np.all(drawn == [x, end], axis=1))
    lines = {line.get_marker(): line.get_ydata() for line in figure.axes[2].lines}
    np.testing.assert_array_equal(lines["o"], error.upper.ravel())
    np.testing.assert_array_equal(lines["^"], error.lower.ravel())
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "displacement [mm] / force [N]",
        "phase [°] of\ndisplacement / force",
        "error |F − model| of\ndisplacement [mm] / force [N]",
    ]
    legend = figure.legends[0].get_window_extent()
    assert not any(legend.overlaps(ax.get_window_extent()) for ax in figure.axes)


def test_nyquist_holds_polygons_points_and_the_model(error: rid.WorstCaseError) -> None:
    figure, chart = plot_nyquist(error), charts.nyquist_chart(error)
    figure.canvas.draw()
    values = {layer.name: layer.x + 1j * layer.y for layer in chart.panels[0].layers}
    outlines = np.split(
        values["holds every consistent value"], np.flatnonzero(np.isnan(values["holds every consistent value"]))
    )
    for outline, found in zip(outlines, error.values, strict=False):
        outline = outline[~np.isnan(outline)]
        np.testing.assert_array_equal(outline, [*found.vertices, found.vertices[0]])
    points = values[charts.REACHED]
    np.testing.assert_array_equal(points, np.concatenate([v.points for v in error.values]))
    np.testing.assert_array_equal(values["model at the 7 frequencies"], error.nominal)
    drawn = [line.get_xdata() + 1j * line.get_ydata() for line in figure.axes[0].lines]
    assert any(np.array_equal(line, points) for line in drawn)
    # Beside it, the worst frequencies around the model: the farthest corner is the guaranteed error.
    worst = np.argsort(-error.upper.ravel())[0]
    layer = named(chart.panels[1], f"{number(HZ[worst], 5)} Hz")
    assert np.hypot(layer.x, layer.y).max() == pytest.approx(error.upper[worst, 0, 0], rel=1e-12)
    assert "[mm/N]" in figure.axes[1].get_xlabel()


@pytest.mark.parametrize("tilt", [None, 0.4 - 0.3j])
def test_outlines_of_the_data_are_their_borders(tilt: complex | None) -> None:
    result = identified(tilt=None if tilt is None else np.full(7, tilt))
    frf = result.problem.frequency[0]
    (layer,) = charts._data_discs(result.problem, (0, 0))
    for k, outline in enumerate((layer.x + 1j * layer.y).reshape(frf.omega.size, -1)[:, :-1]):
        offset = outline - frf.values[k, 0, 0]
        border = np.abs(offset + (tilt or 0) * offset.conj())
        np.testing.assert_allclose(border, frf.bound[k, 0, 0], rtol=1e-9)
        assert np.ptp(np.unwrap(np.angle(offset))) == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("hz", [0.0, 12.0])
def test_one_frequency_and_sets_without_attained_points_are_drawn(error: rid.WorstCaseError, hz: float) -> None:
    one = rid.worst_case_error(error.identification, omega=[2 * np.pi * hz], directions=4)
    empty = tuple(dataclasses.replace(v, points=np.full(v.points.shape, np.nan)) for v in one.values)
    for shown in (one, dataclasses.replace(one, values=empty)):
        plot_worst_case(shown).canvas.draw()
        plot_nyquist(shown).canvas.draw()
        page = Page(render_report(error.identification, worst_case=shown))
        assert f"at {number(hz)} Hz" in page.text
        assert "frequencies from" not in page.text


# ---------------------------------------------------------------- what is said


def read(text: str) -> decimal.Decimal:
    """A number of the page, exactly."""
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    mantissa, _, power = text.replace("−", "-").partition("×10")
    return decimal.Decimal(f"{mantissa}e{power.translate(raised) or 0}")


@pytest.mark.parametrize("value", [0.190549, 12345.678, -0.0012344999, 5.43211e-9, -7e-300, 0.05, 0.0])
def test_printed_ends_hold_too(value: float) -> None:
    exact = decimal.Decimal(value)
    low, high = read(facts.at_least(value)), read(facts.at_most(value))
    assert low <= exact <= high
    assert float(high - low) <= 1e-3 * abs(value)


def test_page_says_what_is_guaranteed(error: rid.WorstCaseError) -> None:
    page = Page(render_report(error.identification, worst_case=error))
    start, end = page.text.index("What is guaranteed"), page.text.index("\nFrequency response")
    section = page.text[start:end]
    count = sum(len(v.certificates) for v in error.values) + len(error.parameters.certificates)
    wanted = [facts.sentence(error), f"All {count} certificates", "Proved", "never prove", "conditional on the poles"]
    wanted += [f"within {facts.at_most(error.upper.max())} mm/N", "Tested", "Assumed", "Re 17.67 Hz"]
    for w, high, low, sample in error.worst(7):
        wanted += [number(w / (2 * np.pi), 5), facts.at_most(high), facts.at_least(low), sample]
    ends = zip(error.parameters.lower, error.parameters.upper, strict=True)
    wanted += [f"{facts.at_least(low)} … {facts.at_most(high)}" for low, high in ends]
    assert [text for text in wanted if text not in section] == []
    assert "Nothing is claimed here" in section
    assert error.known_circle is None  # minutes of work that nobody asked for
    figures = {name for name in page.figures if name.startswith(("guarantee", "nyquist"))}
    assert figures == {"guarantee-0", "nyquist-0", "nyquist-1"}
    assert figures <= {attrs["id"] for tag, attrs in page.tags if tag == "figure"}
    polygon = next(t for t in page.figures["nyquist-0"]["data"] if t["name"] == "holds every consistent value")
    first = error.values[1].vertices
    start = polygon["x"].index(None) + 1
    assert polygon["x"][start : start + first.size] == first.real.tolist()
    for figure in figures:
        for axis, layout in page.figures[figure]["layout"].items():
            assert axis[:5] not in ("xaxis", "yaxis") or "[" in layout["title"]["text"], axis


def test_page_shows_the_circle_that_was_computed(error: rid.WorstCaseError) -> None:
    shown = with_circle(error)
    text = Page(render_report(shown.identification, worst_case=shown)).text
    assert "Over the whole circle the error stays below 0.9001 mm/N" in text  # the double next to 0.9 is above it
    assert "Nothing is claimed" not in text
    assert "by 3 arcs" in text


def test_page_is_as_before_without_a_guarantee(error: rid.WorstCaseError) -> None:
    alone, with_it = (
        re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d", "", render_report(error.identification, worst_case=one))
        for one in (None, error)
    )
    kept = re.sub(r"<h2>What is guaranteed.*?(?=<h2>Frequency response)", "", with_it, flags=re.S)
    data = re.compile(r'(?<=id="figures">).*?(?=</script>)')
    assert data.sub("", kept) == data.sub("", alone)
    before, after = Page(alone).figures, Page(with_it).figures
    assert {name: after[name] for name in before} == before
    assert "guarante" not in Page(alone).text


def test_a_loaded_copy_is_the_same_identification(error: rid.WorstCaseError, tmp_path: Path) -> None:
    error.save(tmp_path / "bounds")
    loaded = rid.load(tmp_path / "bounds")
    assert loaded.identification is not error.identification
    assert facts.sentence(error) in Page(render_report(error.identification, worst_case=loaded)).text


def test_a_bound_below_its_certificate_is_not_called_proved(error: rid.WorstCaseError) -> None:
    value = error.values[2]
    forged = dataclasses.replace(value, support=value.support * 0.99)
    false = dataclasses.replace(error, values=(*error.values[:2], forged, *error.values[3:]))
    page = Page(render_report(error.identification, worst_case=false))
    assert ("section", {"class": "verdict failed", "id": "certificates"}) in page.tags
    assert "Not proved" in page.text
    assert "each supports its bound" not in page.text


def test_text_of_strangers_is_escaped() -> None:
    names = {"inputs": [(NASTY, "</script>")], "outputs": [("y\"'&", "<img src=x onerror=alert(2)>")]}
    result = identified(**names)
    labels = dataclasses.replace(result.problem.parametric, labels=("<b>a</b>", NASTY, "$c$", "d"))
    result = rid.identify(dataclasses.replace(result.problem, parametric=labels))
    found = rid.worst_case_error(result, omega=[60.0, 100.0], directions=4)
    page = Page(render_report(result, worst_case=found))
    assert len(page.scripts) == 3
    assert [tag for tag, _ in page.tags if tag == "img"] == []
    for text in ("<b>a</b>", NASTY, "y\"'&", "<img src=x onerror=alert(2)>"):
        assert text in page.text
    for name in ("guarantee-0", "nyquist-0", "nyquist-1"):
        for axis, layout in page.figures[name]["layout"].items():
            assert axis[:5] not in ("xaxis", "yaxis") or not re.search(r"<(?!br>)", layout["title"]["text"])
    plot_worst_case(found).canvas.draw()
    plot_nyquist(found).canvas.draw()


def test_misuse_is_named(error: rid.WorstCaseError, tmp_path: Path) -> None:
    other = identified(np.full(7, 0.1))
    with pytest.raises(rid.InputError, match="`worst_case` is about another identification"):
        write_report(other, tmp_path / "a.html", worst_case=error)
    with pytest.raises(rid.InputTypeError, match="`worst_case` must be a WorstCaseError"):
        write_report(other, tmp_path / "a.html", worst_case=other)  # type: ignore[arg-type]
    omega = np.linspace(1, 9, 60)
    fit = rid.fit_mfd(rid.FrequencyResponse(omega, 1 / (16 - omega**2 + 0.2j * omega)), order=2)
    with pytest.raises(rid.InputTypeError, match="`worst_case` doesn't belong to a MatrixFraction"):
        write_report(fit, tmp_path / "a.html", worst_case=error)
    for plot in (plot_worst_case, plot_nyquist):
        with pytest.raises(rid.InputTypeError, match="`error` must be a WorstCaseError"):
            plot(other)
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- in a browser


@pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")
def test_the_page_draws_the_guarantee_without_an_error_or_sideways_scroll(
    error: rid.WorstCaseError, tmp_path: Path
) -> None:
    report = tmp_path / "report.html"
    write_report(error.identification, report, worst_case=with_circle(error))
    dom, console = opened(report, tmp_path / "profile")
    assert console == []
    found = plots(dom)
    for name in ("guarantee-0", "nyquist-0", "nyquist-1"):
        assert re.search(r'<g class="trace scatter[^>]*>.*?<path[^>]* d="M[^"]{8,}', found[name], re.S), name
    client, scroll = widths(report, 390, tmp_path)
    assert 370 <= client <= 390
    assert scroll <= client
