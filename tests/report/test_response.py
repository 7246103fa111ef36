"""The report of a measured frequency response: its words and its page."""

import dataclasses
import re

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

import robustid as rid
from robustid.data import FrequencyResponse, TimeRecord
from robustid.estimation import estimate_frf
from robustid.report import plot, render_report, render_summary, write_report
from robustid.report.response_charts import ResponseView, coherence_chart, entry_charts, overview_charts
from robustid.report.response_page import level_table, response_verdict, summary_rows, warning_sentences
from robustid.report.with_matplotlib import draw
from support.bounds import rebound
from support.frf_records import DT
from support.matrix_pages import measured, with_values
from support.report_pages import NASTY, Page, layers, printed

pytestmark = pytest.mark.quick


def test_the_kind_of_bound_is_said_in_words():
    base = FrequencyResponse([1.0, 2.0], [1.0, 2.0])
    said = {}
    for kind, probability in (("hard", None), ("noise_floor", None), ("confidence", None), ("confidence", 0.99)):
        frf = dataclasses.replace(base, bound=rid.Bound(0.1, kind=kind, probability=probability))
        said[kind, probability] = response_verdict(ResponseView(frf))
    assert [verdict.word for verdict in said.values()] == [
        "Hard bound",
        "Bound from the noise floor",
        "Confidence bound",
        "Confidence bound, 99 %",
    ]
    assert "isn't stated" in said["confidence", None].sentence
    assert "With a probability of 99 %" in said["confidence", 0.99].sentence
    assert all(verdict.key == "consistent" for verdict in said.values())
    assert response_verdict(ResponseView(base)).word == "No bound"


def test_levels_are_medians_relative_to_the_response(frf):
    table = level_table(ResponseView(frf))
    heads = [column.head for column in table.columns]
    assert heads == ["Response", "|G|", "Bound", "σ, noise", "σ, distortion", "Points below\ntheir bound"]
    rows = table.rows
    bound = np.median(frf.bound[:, 0, 1] / np.abs(frf.values[:, 0, 1]))
    assert float(rows[1][2].removesuffix(" %")) == pytest.approx(100 * bound, rel=0.05)
    assert rows[1][0] == "x [mm] / torque [Nm]"
    silent = np.sum(frf.bound[:, 1, 0] >= np.abs(frf.values[:, 1, 0]))
    assert rows[2][-1] == f"{silent} of {frf.omega.size}"
    assert len(level_table(ResponseView(FrequencyResponse([1.0], [0.0], bound=1.0))).rows) == 1


def test_lines_resolution_coherence_and_degrees_of_freedom(frf):
    rows = dict(summary_rows(ResponseView(frf)))
    assert rows["Frequency points"] == "79 points, 1 to 40 Hz, 0.5 Hz apart"
    worst = frf.freq_hz[np.argmin(frf.coherence[:, 0])]
    assert f"{worst:.5g} Hz" in rows["Coherence"].split(";")[0]
    assert rows["Degrees of freedom"].startswith("10" if frf.dof == 10 else f"{frf.dof:.4g}")
    assert rows["Bound"] == frf.bound.words(frf.note)
    gaps = frf.select([0, 1, 5])
    assert "at least 0.5 Hz apart" in dict(summary_rows(ResponseView(gaps)))["Frequency points"]
    assert dict(summary_rows(ResponseView(frf.select([3]))))["Frequency points"] == f"{frf.freq_hz[3]:.5g} Hz"


def test_warnings_name_what_is_wrong(frf):
    assert any(
        "bound exceeds the response" in w and f"of {NASTY} / force [N]" in w
        for w in warning_sentences(ResponseView(frf))
    )
    smooth = dataclasses.replace(
        frf, values=np.broadcast_to(1 / (1 + 0.01j * frf.omega)[:, None, None], frf.values.shape)
    )
    clean = dataclasses.replace(
        rebound(smooth, radius=0.001 * np.abs(smooth.values)), dof=100.0, coherence=np.ones((79, 2))
    )
    assert warning_sentences(ResponseView(clean)) == []
    coherence = np.ones((79, 2))
    coherence[:8, 1] = 0.3
    (low,) = warning_sentences(ResponseView(dataclasses.replace(clean, coherence=coherence)))
    assert f"below 0.8: {NASTY} at 8 of 79 frequency points" in low
    (few,) = warning_sentences(ResponseView(dataclasses.replace(clean, dof=1.0)))
    # sqrt(1/alpha - 1) against sqrt(-log alpha), alpha = 0.05/316
    alpha = 0.05 / frf.values.size
    assert f"only 1 degree of freedom: the bound is {np.sqrt((1 / alpha - 1) / -np.log(alpha)):.2g} times" in few


def test_what_the_estimate_itself_admits_is_a_warning():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(4000)
    smeared = estimate_frf(TimeRecord(u, u + 0.1 * rng.standard_normal(4000), dt=DT), method="welch")
    assert any("smeared" in w for w in warning_sentences(ResponseView(smeared)))
    verdict = response_verdict(ResponseView(smeared))
    assert verdict.key == "weak"
    assert verdict.sentence.endswith("The warnings say what this leaves out.")
    u = np.tile(rng.standard_normal(100), 8) + 1e-9 * rng.standard_normal(800)
    drift = np.exp(-1.5 * np.arange(800) / 100) * np.cos(np.arange(800))
    moving = estimate_frf(TimeRecord(u, u + drift, dt=DT), period=100)
    assert any("steady state" in w for w in warning_sentences(ResponseView(moving)))


def test_the_terminal_shows_the_same(frf):
    text = printed(frf)
    for words in (
        "Confidence bound of the mean response",
        "79 points, 1 to 40 Hz",
        "x [mm] / torque [Nm]",
        NASTY,
        "Warning: At",
    ):
        assert words in text


def test_page(frf, records, tmp_path):
    write_report(frf, tmp_path / "frf.html", records=records, title="Stage <3>")
    page = (tmp_path / "frf.html").read_text(encoding="utf-8")
    text = page.replace(get_plotlyjs(), "")
    for words in (
        "Stage &lt;3&gt;",
        "Confidence bound of the mean response, 95 %",
        "Singular values (CMIF)",
        "mean square over all 4",
    ):
        assert words in text, words
    assert NASTY not in text
    figures = Page(page).figures
    entries = [f"entry-{i}-{j}-0" for i in (0, 1) for j in (0, 1)]
    assert list(figures) == [
        *entries,
        "singular-0",
        "coherence-0",
        "input-0-0",
        "input-1-0",
        "output-0-0",
        "output-1-0",
    ]
    assert all(f'id="{name}"' in text for name in figures)
    import plotly.graph_objects as go

    for figure in figures.values():
        go.Figure(figure)  # refuses unknown or malformed properties
    titles = [figures["entry-0-1-0"]["layout"][axis]["title"]["text"] for axis in ("xaxis", "yaxis", "yaxis2")]
    assert titles == ["frequency [Hz]", "magnitude [mm/Nm]", "phase [°]"]
    bare = render_report(frf.entry(0, 0))
    assert "Spectra of the records" not in bare
    assert list(Page(bare).figures) == ["entry-0-0-0", "coherence-0"]


@pytest.mark.parametrize("lines", [1, 2, 3])
@pytest.mark.parametrize("values", [0.0, 1.0])
def test_any_response_can_be_drawn(lines, values):
    frf = FrequencyResponse(np.arange(lines, dtype=float), np.full(lines, values), bound=1e-3)
    plot.bode(frf)
    assert "Hard bound" in render_report(frf)
    assert "Hard bound" in str(render_summary(frf).renderables[0].renderable)


def test_misuse_is_named(frf, records, tmp_path):
    path = tmp_path / "a.html"
    for wrong, error, sentence in (
        (3, rid.errors.InputTypeError, "`records` must be a TimeRecord or a sequence of them; got int"),
        ([], rid.errors.InputTypeError, "`records` must be a TimeRecord"),
        ([frf], rid.errors.InputTypeError, "`records` must be a TimeRecord"),
        (TimeRecord(np.ones(4), np.ones(4), dt=DT), rid.InputError, "must have the 2 outputs and 2 inputs"),
        (dataclasses.replace(records[0], dt=0.02), rid.InputError, "dt = 0.01 s; got 0.02 s"),
        (
            [records[0], dataclasses.replace(records[1], u=records[1].u[:400], y=records[1].y[:400])],
            rid.InputError,
            "one length; got 800 and 400 samples",
        ),
    ):
        with pytest.raises(error, match=re.escape(sentence)):
            plot.bode(frf, records=wrong)
        with pytest.raises(error, match=re.escape(sentence)):
            write_report(frf, path, records=wrong)
    with pytest.raises(
        rid.errors.InputTypeError, match=r"`result` must be of class .*StateSpace, Family or ControllerDesign; got"
    ):
        plot.bode(records[0])
    with pytest.raises(rid.errors.InputTypeError, match="`data` doesn't belong to a FrequencyResponse"):
        write_report(frf, path, data=frf)
    with pytest.raises(rid.InputError, match=r"continuous time; got 0\.01 s"):
        plot.bode(dataclasses.replace(frf, dt=None), records=records)
    assert not path.exists()
    assert draw(coherence_chart(ResponseView(frf))).axes


def test_a_response_with_missing_entries_shows_what_was_measured():
    frf = with_values(measured(lines=9), (3, 1, 0), np.nan, np.inf)
    frf = with_values(frf, (slice(None), 0, 1), 7.0, np.inf)  # a number is no measurement where the bound is infinite
    view = ResponseView(frf)
    drawn = entry_charts(view)
    size = layers(drawn[2])["response"]
    used = np.arange(9) != 3
    np.testing.assert_allclose(size.x, frf.freq_hz[used], rtol=1e-5)
    np.testing.assert_allclose(size.y, np.abs(frf.values[used, 1, 0]), rtol=1e-5)
    assert drawn[1].panels[0].title == "y1 / u2: not measured"
    assert [chart.name for chart in overview_charts(view)] == []  # no line is complete
    said = dict(summary_rows(view))["Missing"]
    assert said.startswith("10 of 36 values: y1 / u2 at every point, y2 / u1 at 1 point.")
    assert "at 0 of the 9 frequency points" in said
    assert "in all entries measured there" in response_verdict(view).sentence
    levels = level_table(view).rows
    assert levels[1][1:3] == ("–", "–")
    assert float(levels[2][1]) == pytest.approx(np.median(np.abs(frf.values[used, 1, 0])), rel=0.01)
    assert "NaN" not in render_report(frf).split("<script")[0]
