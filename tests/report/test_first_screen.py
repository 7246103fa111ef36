"""The first screen of a page, its size, and the page with pictures only."""

import io
import re

import control
import numpy as np
import pytest
from rich.console import Console

import robustid as rid
from robustid.app.answers.parts import of_guarantees
from robustid.guarantees import largest_error
from robustid.identification import fit_percent
from robustid.report import Verdict, head_at_terminal, render_report
from robustid.report.document import Document, Glance, Heading, Text
from robustid.report.html import MOST_WARNINGS, render
from robustid.report.largest_response import beyond_measured, is_resonance
from robustid.report.live import live_words
from robustid.report.proved_band import centre_chart
from support.report_pages import Page, problem

MOST_BYTES = 2_300_000  # of a page of a SISO identification: plotly, packed, is 1.9 MB of it
MOST_BYTES_STATIC = 500_000


def ids(page):
    return re.findall(r' id="([^"]+)"', page)


def test_parts_of_the_first_screen_stand_in_their_order(error_page):
    first, rest = error_page.split("Open all details</button>")
    body = first[first.index("<body>") :]
    places = [ids(body).index(name) for name in ("verdict", "numbers", "band", "glance", "first-0", "next")]
    assert places == sorted(places)
    assert "model order" in body
    assert "guaranteed error" in body
    assert "at the resonance, 17.6 Hz" in body
    assert body.count("<figure") == 1
    assert rest.count("<details") == rest.count("<h2>") > 8
    assert re.findall("<h[23]", body)[0] == "<h2"


def plant(kind, damping):
    """Responses with one pole, two real ones, a mode, and a pole beside a light mode that it all but hides."""
    s = control.tf("s")
    return {
        "first order": 1 / (1 + s),
        "lag that rises": (1 + 3 * s) / (1 + s) / (1 + 0.2 * s),
        "mode": 1 / (1 + 2 * damping * s + s**2),
        "hidden mode": 1 / (1 + s) * (s**2 + 0.02 * s + 0.0101) / (s**2 + 0.02 * s + 0.01),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "damping", "expected"),
    [
        ("first order", 1.0, False),
        ("lag that rises", 1.0, False),
        ("hidden mode", 1.0, False),
        *(("mode", damping, damping < 0.5) for damping in (0.001, 0.03, 0.3, 0.48, 0.6, 0.8)),
    ],
)
def test_only_the_peak_of_a_light_mode_is_a_resonance(kind, damping, expected):
    """In continuous and discrete time, on dense and on coarse grids, with an error of a per mille of the response."""
    rng, dt = np.random.default_rng(0), 0.05
    continuous = control.ss(plant(kind, damping))
    for model in (continuous, control.sample_system(continuous, dt, "zoh")):
        for count in (40, 400):
            omega = np.geomspace(0.005, 20.0, count)
            values = np.abs(control.frequency_response(model, omega).frdata.ravel())
            assert is_resonance(model, omega, values * (1 + 1e-3 * rng.standard_normal(count))) == expected
            assert not is_resonance(model, omega, values.min() * (1 + 1e-3 * rng.standard_normal(count)))


def test_the_page_of_a_process_does_not_speak_of_a_resonance():
    """A heating: 300 W heat it by 30 K, time constant 400 s; the largest response that is named is a measured one."""
    dt, omega = 10.0, 2 * np.pi * np.array([1e-5, 1.3e-5, 1.6e-5, 4e-4, 1e-3, 3e-3, 1e-2])
    values = 0.1 / (1 + 400j * omega) * (1 + 1e-2 * np.array([-1, 1, -1, 1, -1, 1, -1]))
    frf = rid.FrequencyResponse(omega, values, bound=0.005, dt=dt)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.3, decay_rate=1.02)))
    for at, where in ((omega, ""), (np.append(0.0, omega), " in the measured band")):  # 0 Hz is not measured
        page = render_report(result, worst_case=rid.worst_case_error(result, omega=at, directions=4))
        assert "resonance" not in Page(page).text
        assert f"at the largest response{where}, 1×10⁻⁵ Hz" in page


@pytest.mark.parametrize(
    ("hertz", "dt", "expected"),
    [
        (np.arange(0.0, 11.0), 0.05, ""),
        (np.arange(1.0, 10.0), 0.05, ""),
        (np.arange(1.0, 9.0), 0.05, "above 8 Hz"),
        (np.arange(3.0, 9.0), 0.05, "below 3 Hz and above 8 Hz"),
        (np.arange(1.0, 10.0), None, "above 9 Hz"),
        (np.array([5.0]), 0.05, "above 5 Hz"),
    ],
)
def test_what_no_sample_is_near_is_named(hertz, dt, expected):
    frf = rid.FrequencyResponse(2 * np.pi * hertz, 1 / (1 + 1j * hertz), bound=0.01, dt=dt)
    prior = rid.Prior(gain_bound=3.0, decay=0.3)
    assert beyond_measured(rid.MixedProblem(frequency=frf, prior=prior)) == expected
    if dt:
        step = rid.TimeRecord(np.ones(9), np.ones(9), bound=1.0, dt=dt)
        assert beyond_measured(rid.MixedProblem(frequency=frf, time=step, prior=prior)) == ""


@pytest.mark.parametrize("count", [0, 2, 3, 5])
def test_at_most_three_warnings_stand_on_it_and_none_is_lost(count):
    warnings = [Text(f"number {k} is wrong. Its remainder {k}.", "warning", head="Warning") for k in range(count)]
    page = render(Document("t", [Verdict("weak", "Word", "Sentence."), *warnings], [Heading("Part"), Text("body")]))
    first = page.split("Open all details</button>")[0]
    assert len(re.findall("Number . is wrong", first)) == min(count, MOST_WARNINGS)
    for k in range(count):
        assert page.count(f"Number {k} is wrong.") == page.count(f"Its remainder {k}.") == 1


@pytest.mark.parametrize("most", range(2, 12))
def test_words_that_a_small_terminal_has_no_place_for_show_that_they_go_on(most):
    """The guarantee ended in "that agrees with the data and the", and what is not covered after a comma."""
    words = "Proved at every frequency, with all poles: every plant that agrees with the data is near. Beside. Further."
    covered = "a machine outside the class, which was chosen from these data, samples with errors above their bounds"
    glance = Glance(numbers=[("model order", "4")], words=words, not_covered=covered)
    document = Document("t", [Verdict("consistent", "Good", "All.")], [Heading("Part")], glance=glance)
    with Console(width=40, file=io.StringIO()) as console, console.capture() as shown:
        console.print(head_at_terminal(document, 40, most))
    lines = shown.get().splitlines()
    assert len(lines) <= most
    assert all(len(line) <= 40 for line in lines)
    text = " ".join(line.strip() for line in lines)
    for whole, begins in ((words.partition(" Beside")[0], "Proved at"), (f"Not covered: {covered}.", "Not covered")):
        assert begins not in text or whole in text or re.search(rf"{begins}[^.…]*…", text), text


def test_a_verdict_that_warns_is_a_warning_and_another_stands_below():
    head = [Verdict("consistent", "Good", "A."), Verdict("weak", "Poor", "B."), Verdict("consistent", "Fine", "C.")]
    document = Document("t", head, [Text("lost heading"), Heading("Part")])
    assert document.warnings == ["Poor: B."]
    assert document.beside == head[2:]
    assert [part.title for part in document.parts] == ["Details", "Part"]


def test_a_verdict_ahead_of_the_others_stands_above_them_and_is_no_warning():
    ahead = Verdict(
        "undecided", "Fault of the data", "Off:", (("where", "output y"),), id="data-fault", ahead=True, more="by 3."
    )
    head = [ahead, Verdict("consistent", "Good", "A."), Verdict("weak", "Poor", "B.")]
    document = Document("t", head, [Heading("Part")])
    assert document.verdict is head[1]
    assert document.warnings == ["Poor: B."]
    assert document.beside == []
    page = render(document)
    first = page.split("Open all details</button>")[0]
    body = first[first.index("<body>") :]
    places = [ids(body).index(name) for name in ("data-fault", "verdict", "numbers", "warnings")]
    assert places == sorted(places)
    assert page.count("Fault of the data") == 1
    assert "where output y" in " ".join(Page(page).text.split())


def test_a_static_page_is_small_and_has_pictures_with_words_and_no_script(static_page):
    page = static_page
    assert len(page) < MOST_BYTES_STATIC
    assert "<script" not in page
    assert "script-src" not in page
    pictures = [attrs for tag, attrs in Page(page).tags if tag == "img"]
    assert len(pictures) == page.count("<figure") > 5
    for attrs in pictures:
        assert (attrs["src"] or "").startswith("data:image/png;base64,")
        assert " over " in (attrs["alt"] or "")
    assert not re.search(r"https?://|src=\"(?!data:)", page)


def test_the_default_page_is_packed_and_its_plots_have_words(consistent_page):
    page = consistent_page
    assert len(page) < MOST_BYTES
    figures = [attrs for tag, attrs in Page(page).tags if tag == "figure"]
    assert len(figures) > 5
    for attrs in figures:
        assert attrs["role"] == "img"
        assert " over " in (attrs["aria-label"] or "")
    outside = re.sub(r'<script type="text/plain".*?</script>', "", page, flags=re.S)
    assert not re.search(r"https?://", outside)


def test_an_inconsistent_page_leads_on(inconsistent):
    diagnosis = rid.diagnose(inconsistent)
    text = Page(render_report(inconsistent, diagnosis=diagnosis)).text
    first, lines = text.split("Open all details")[0], diagnosis.summary().splitlines()
    assert "What would help" in text
    assert diagnosis.next_steps == [lines[0], lines[-1]]
    assert all(line in first for line in diagnosis.next_steps)
    assert lines[2] not in first
    assert lines[2] in text
    assert "margin: factor on all bounds" in first


def test_fit_in_per_cent_is_that_of_the_residuals():
    asked = problem()
    frf, record, model = asked.frequency[0], asked.time[0], rid.datasets.flexible_structure().truth
    response = control.frequency_response(model, frf.omega).frdata[0, 0]
    values = frf.values[:, 0, 0]
    _, simulated = control.forced_response(model, record.time, record.u[:, 0])
    found = fit_percent(asked, model)
    for kind, measured, predicted in (("frequency", values, response), ("time", record.y[:, 0], simulated)):
        left, size = abs(measured - predicted) ** 2, abs(measured - measured.mean()) ** 2
        assert found[kind] == pytest.approx(100 * (1 - (left.sum() / size.sum()) ** 0.5), abs=1e-6)


def test_constant_values_with_errors_have_no_fit_in_per_cent():
    """A static plant that was found exactly: its fit was -7 %, since around their mean the values are nothing but errors."""
    values = 0.7 + 0.01 * np.exp(1j * np.arange(20.0))
    asked = rid.MixedProblem(
        frequency=rid.FrequencyResponse(np.linspace(1, 60, 20), values, bound=0.02, dt=0.05),
        time=rid.TimeRecord(np.eye(1, 5)[0], [0.7, 0.01, -0.01, 0.0, 0.005], dt=0.05, bound=0.02),
        prior=rid.Prior(gain_bound=1.0, decay_rate=1.1),
    )
    assert set(fit_percent(asked, control.ss([], [], [], 0.7, 0.05))) == {"time"}


def band_over(result, low, high, damping):
    """The band over a box of both modes: from `low` to `high` times their frequencies, and their damping ratios."""
    return rid.band(result, box=(2 * np.pi * np.outer([9.0, 17.67], [low, high]), np.array(damping)))


def legend(page):
    return [trace.get("name") for trace in page.every["first-0"]["data"]]


def test_a_band_that_is_nowhere_finite_is_told_as_no_proof(strong):
    """A box down to no damping at all: to bound the error was tried already, and there is no range to be drawn."""
    band = band_over(strong, 0.6, 1.4, [[1e-6, 0.3], [1e-6, 0.3]])
    assert not band.bounded.any()
    page = Page(render_report(strong, band=band))
    first = page.text.split("Open all details")[0]
    assert "Consistent, but no error is proved" in first
    assert ("section", {"class": "verdict weak", "id": "verdict"}) in page.tags
    assert f"Nothing is proved of the error: {band.why_nothing}" in first
    assert "Measure frequency points around the modes" in first
    assert "not bounded on this page yet" not in first
    assert not any("proved" in name for name in legend(page))
    assert "band-certificates" not in ids(render_report(strong, band=band))
    assert live_words(strong, band=band)[0] == "weak"
    assert not any("proved" in layer.name for panel in centre_chart(band).panels for layer in panel.layers)
    with pytest.raises(rid.errors.InputError, match="the error has no bound from 0 to 50 Hz"):
        band.weight()


def test_a_band_without_time_says_so_and_what_to_do(strong):
    band = rid.band(strong, time_limit=1e-6)
    first = Page(render_report(strong, band=band)).text.split("Open all details")[0]
    assert "the search was ended before every entry had its turn" in first
    assert "Bound the error of the model" in first
    assert "nothing bounds their modes" in band.unfinished


def test_a_range_is_drawn_only_where_it_is_proved(strong):
    """A mode that may be undamped leaves the band open near it alone."""
    band = band_over(strong, 0.98, 1.02, [[0.09, 0.11], [1e-9, 0.05]])
    assert 0 < band.bounded.sum() < band.omega.size
    assert np.isfinite(band.sigma_upper[~band.bounded]).any()
    page = Page(render_report(strong, band=band))
    assert f"proved range, but from {band.open_words}" in legend(page)
    area = next(trace for trace in page.every["first-0"]["data"] if trace["name"].startswith("proved range"))
    at = np.array([x for x in area["x"] if x is not None])
    assert at.size
    assert not band.is_open(2 * np.pi * at).any()
    row = of_guarantees([band])["guarantees"][0]
    assert row["at_most"] == largest_error(band).value >= band.sigma_upper[band.bounded].max()
    assert row["frequencies"] == band.bounded.sum()
