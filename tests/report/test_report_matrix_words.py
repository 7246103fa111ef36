"""What pages and summaries say of identifications with several inputs and outputs, and of responses with missing entries."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.report import (
    evidence,
    facts,
    frf_charts,
    frf_facts,
    html,
    plot_nyquist,
    plot_worst_case,
    worst_case_facts,
)
from robustid.report import worst_case_charts as charts
from robustid.report.frf_view import FrfView
from robustid.report.modes import mode_rows
from robustid.report.style import number
from support.browser import opened, plots, widths
from support.matrix_pages import DT, HZ, measured, plant, problem, record, response_of, with_values
from support.report_pages import NASTY, Page, layers, printed


@pytest.fixture(scope="module")
def error() -> rid.WorstCaseError:
    frf = measured(lines=5, modes=1, inputs=["force [N]", "torque [Nm]"])
    result = rid.identify(problem(frf, modes=1, prior=rid.Prior(gain_bound=0.4, decay_rate=1.5)))
    return rid.worst_case_error(result, omega=HZ * np.array([10.0, 30.0]), directions=3, rtol=0.3)


# --- words --------------------------------------------------------------------------------------------------------------


def test_a_contradicting_sample_is_named_with_its_entry() -> None:
    frf = measured(lines=8)
    spiked = with_values(frf, (4, 1, 0), frf.values[4, 1, 0] + 3)
    result = rid.identify(problem(spiked))
    assert not result.consistent
    first = facts.limiting(result)[0]
    assert (first.experiment, first.channel) == ("frequency 1", "y2 / u1")
    assert first.place == f"{frf.freq_hz[4]:.5g} Hz"
    assert first.ratio == pytest.approx(abs(spiked.values - response_of(result.model, frf.omega))[4, 1, 0] / 0.05)
    assert "y2 / u1" in printed(result)


def test_a_contradicting_sample_of_a_record_is_named_with_its_output() -> None:
    time = record()
    y = np.array(time.y)
    y[5, 1] += 3
    result = rid.identify(problem(measured(lines=6), dataclasses.replace(time, y=y)))
    first = facts.limiting(result)[0]
    assert (first.experiment, first.channel, first.place) == ("time 1", "y2", "0.05 s")


def test_the_class_is_said_as_it_is_meant() -> None:
    frf = measured(lines=6, outputs=["x [mm]", "angle [rad]"], inputs=["force [N]", "torque [Nm]"])
    said = dict(facts.assumptions(rid.identify(problem(frf))))
    assert "σmax(G) ≤ K = 0.5 (largest singular value, in the different units of the entries)" in said["Prior"]
    assert "4 functions with free matrices as coefficients" in said["Parametric part"]
    assert set(said) == {"Prior", "Parametric part", "Bounds"}
    prior = rid.Prior(gain_bound=0.5, decay_rate=1.15, scaling=[[1.0, 2.0], [3.0, 6.0]])
    said = dict(facts.assumptions(rid.identify(problem(frf, prior=prior))))
    assert "σmax(G ./ S) ≤ K = 0.5 (" in said["Prior"]
    assert said["Scaling"].endswith("for force, torque: x: 1, 2; angle: 3, 6.")
    same = measured(lines=6, outputs=["x [mm]", "y [mm]"], inputs=["one [N]", "two [N]"])
    result = rid.identify(problem(same, symmetric=True, prior=rid.Prior(gain_bound=5.0, decay_rate=1.15)))
    said = dict(facts.assumptions(result))
    assert "σmax(G) ≤ K = 5 mm/N (largest singular value)" in said["Prior"]
    assert "symmetric matrix" in said["Symmetry"]


def test_shared_bounds_are_said_in_words() -> None:
    frf = measured(lines=6)
    column = rid.FrequencyResponse(frf.omega, frf.values, bound=0.1, dt=DT, joint="column")
    ellipsoid = np.broadcast_to(np.diag([0.01, 0.04, 0.04, 0.01]).astype(complex), (6, 4, 4))
    whole = rid.FrequencyResponse(frf.omega, frf.values, dt=DT, joint="matrix", ellipsoid=ellipsoid)
    for data, words, bounds in (
        (column, "The entries of a column share one bound", ["± 0.1 for one alone"] * 2),
        (whole, "All entries at a line share one bound", ["± 0.1 … 0.2 for one alone"]),
    ):
        result = rid.identify(problem(data))
        rows = facts.experiments(result)
        assert [row.bound for row in rows] == bounds
        assert sum(row.samples for row in rows) == result.problem.samples == 24
        assert words in dict(facts.assumptions(result))["Bounds"]
        assert words in " ".join(printed(result).split())
        assert words in dict(frf_facts.summary_rows(FrfView(data)))["Bound"]


def test_experiments_are_listed_together_where_they_are_alike() -> None:
    frf = with_values(measured(lines=6), (2, 0, 1), np.nan, np.inf)
    rows = facts.experiments(rid.identify(problem(frf, record())))
    assert [(row.channel, row.samples) for row in rows] == [
        ("each of 3 entries: y1 / u1; y2 / u1; y2 / u2", 6),
        ("y1 / u2", 5),
        ("y1", 10),
        ("y2", 20),
    ]


def test_samples_of_combinations_of_channels_are_told_from_entries() -> None:
    frf = measured(lines=6)
    both = frf.tangential(right=[[1.0, 1.0], [1.0, -1.0]])
    result = rid.identify(problem([frf.select(slice(0, 3)), both]))
    rows = facts.experiments(result)
    assert [row.samples for row in rows] == [3, 24]
    assert rows[1].channel == "combinations of outputs / combinations of inputs"
    assert "aren’t drawn here" in facts.bars_words(result)
    panel = evidence.residual_chart(result).panels[-1]
    error = np.abs(both.values - response_of(result.model, frf.omega) @ [[1.0, 1.0], [1.0, -1.0]]) / both.bound
    np.testing.assert_allclose(np.sort(panel.layers[0].y), np.sort(error.ravel()), rtol=1e-5, atol=1e-9)


def test_modes_are_listed_with_the_height_of_their_resonance_and_their_rank() -> None:
    frf = measured(lines=12, noise=1e-3)
    result = rid.identify(problem(frf))
    basis, residues, _ = plant(2, 2)
    peaks = np.linalg.norm(np.tensordot(basis.response(HZ * np.array([6.0, 17.0]) * DT), residues, 1), 2, axis=(1, 2))
    rows = mode_rows(result)
    assert [row.hz for row in rows] == ["6", "17"]
    np.testing.assert_allclose([float(row.peak) for row in rows], peaks, rtol=0.1)
    ratios = [mode.rank_ratio for mode in result.modes]
    assert max(ratios) < 0.05  # each of the true residues has rank one
    assert [row.rank_ratio for row in rows] == [number(ratio, 2) for ratio in ratios]
    largest = np.unravel_index(np.argmax(np.abs(residues[:2]).max(axis=0)), (2, 2))
    assert rows[0].largest == f"y{largest[0] + 1} / u{largest[1] + 1}"


# --- guarantees ---------------------------------------------------------------------------------------------------------


def test_guaranteed_ranges_of_entries_and_of_the_singular_values(error: rid.WorstCaseError) -> None:
    at = error.omega / HZ
    for chart, (i, j) in zip(charts.worst_case_charts(error), np.ndindex(2, 2), strict=True):
        area = layers(chart, 0)["guaranteed range (2 frequencies)"]
        index = np.searchsorted(area.x, at)
        np.testing.assert_allclose(area.high[index], error.magnitude[:, i, j, 1], rtol=1e-9)
        assert np.all(area.low[index] <= error.magnitude[:, i, j, 0] + chart.panels[0].y.range[0])
        drawn = layers(chart, 2)
        np.testing.assert_allclose(drawn["guaranteed error"].y, error.upper[:, i, j])
        np.testing.assert_allclose(drawn["reached by consistent systems"].y, error.lower[:, i, j])
    chart = charts.worst_case_sigma_chart(error)
    area = layers(chart, 0)["guaranteed range of σmax (2 frequencies)"]
    sigma = np.linalg.norm(response_of(error.model, error.omega), 2, axis=(1, 2))
    np.testing.assert_allclose(area.high[np.searchsorted(area.x, at)], sigma + error.sigma_upper, rtol=1e-9)
    np.testing.assert_allclose(layers(chart, 1)["guaranteed error"].y, error.sigma_upper)


def test_the_guarantee_in_words(error: rid.WorstCaseError) -> None:
    said = worst_case_facts.sentence(error)
    assert f"within {worst_case_facts.at_most(error.sigma_upper.max())} of the nominal model" in said
    assert "(largest singular value of the difference)" in said
    rows = worst_case_facts.entry_rows(error)
    assert [row.name for row in rows][1] == "y1 / torque [Nm]"
    np.testing.assert_allclose([float(row.upper) for row in rows], error.upper.max(axis=0).ravel(), rtol=1e-3)
    found = worst_case_facts.parameter_rows(error)
    assert len(found) == 2 * 4
    assert found[1].label.endswith(": y1 / torque [Nm]")
    assert float(found[1].value.replace("−", "-")) == pytest.approx(error.identification.parameters[0, 0, 1], rel=1e-3)


def test_guarantees_are_plotted(error: rid.WorstCaseError) -> None:
    assert sum(ax.get_visible() for ax in plot_worst_case(error).axes) == 4 * 3 + 2
    assert len(plot_nyquist(error).axes) == 4 * 2


# --- pages --------------------------------------------------------------------------------------------------------------


def test_the_page_holds_every_part_and_escapes_names(error: rid.WorstCaseError) -> None:
    text = html.render_report(error.identification, worst_case=error)
    page = Page(text)
    ids = [attributes["id"] for tag, attributes in page.tags if tag == "figure"]
    pairs = [f"{i}-{j}" for i in (0, 1) for j in (0, 1)]
    expected = {f"{kind}-{pair}-0" for kind in ("entry", "guarantee", "answer") for pair in pairs}
    expected |= {
        "sigma-0",
        "guarantee-sigma-0",
        *(f"residuals-{k}" for k in range(4)),
        "hankel-0",
        "poles-0",
        "poles-1",
    }
    assert sorted(ids) == sorted(expected) == sorted(page.figures)
    assert "Largest error of every entry" in page.text
    assert "rank ratio" in page.text
    names = {"inputs": [NASTY, "u"], "outputs": ["$a$", NASTY]}
    page = Page(html.render_report(rid.identify(problem(measured(lines=4, **names)))))
    assert NASTY in page.text
    assert not any("alert" in script for script in page.scripts[-1:])
    assert sum(tag == "script" for tag, _ in page.tags) == 3


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser `chromium` on the path")
def test_the_page_draws_every_plot_and_fits_a_phone(tmp_path: Path) -> None:
    names = [f"acceleration of the measuring beam at its position {k} [mm/s²]" for k in range(2)]
    result = rid.identify(problem(measured(lines=6, outputs=names), record()))
    rid.write_report(result, tmp_path / "report.html")
    dom, console = opened(tmp_path / "report.html", tmp_path / "profile")
    assert console == []
    found = plots(dom)
    assert len(found) == 4 + 1 + 2 + 4 + 6 + 3
    assert all('class="main-svg"' in markup for markup in found.values())
    client, scroll = widths(tmp_path / "report.html", 360, tmp_path)
    assert scroll <= client


# --- frequency responses ------------------------------------------------------------------------------------------------


def test_a_response_with_missing_entries_shows_what_was_measured() -> None:
    frf = with_values(measured(lines=9), (3, 1, 0), np.nan, np.inf)
    frf = with_values(frf, (slice(None), 0, 1), 7.0, np.inf)  # a number is no measurement where the bound is infinite
    view = FrfView(frf)
    drawn = frf_charts.entry_charts(view)
    size = layers(drawn[2])["response"]
    used = np.arange(9) != 3
    np.testing.assert_allclose(size.x, frf.freq_hz[used], rtol=1e-5)
    np.testing.assert_allclose(size.y, np.abs(frf.values[used, 1, 0]), rtol=1e-5)
    assert drawn[1].panels[0].title == "y1 / u2: not measured"
    assert [chart.name for chart in frf_charts.overview_charts(view)] == []  # no line is complete
    said = dict(frf_facts.summary_rows(view))["Missing"]
    assert said.startswith("10 of 36 values: y1 / u2 at every line, y2 / u1 at 1 line.")
    assert "at 0 of the 9 lines" in said
    assert "in all entries measured there" in frf_facts.verdict(view).sentence
    levels = frf_facts.level_rows(view)
    assert levels[1][1:3] == ("–", "–")
    assert float(levels[2][1]) == pytest.approx(np.median(np.abs(frf.values[used, 1, 0])), rel=0.01)
    assert "NaN" not in html.render_report(frf).split("<script>")[0]


def test_singular_values_of_a_response_are_those_of_its_complete_lines() -> None:
    frf = with_values(measured(lines=9), (3, 1, 0), np.nan, np.inf)
    (chart,) = frf_charts.overview_charts(FrfView(frf))
    used = np.arange(9) != 3
    drawn = layers(chart)
    np.testing.assert_allclose(drawn["largest singular value"].x, frf.freq_hz[used], rtol=1e-5)
    np.testing.assert_allclose(
        drawn["largest singular value"].y, np.linalg.norm(frf.values[used], 2, axis=(1, 2)), rtol=1e-5
    )
    np.testing.assert_allclose(drawn["bound of the singular values"].y, 0.1, rtol=1e-5)
