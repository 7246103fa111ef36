"""The band of a page with polygons in it: one curve with dots, one sentence on what stands on what, one check of the proofs."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run.findings import band_words
from robustid.guarantees import WorstCaseOverPoles
from robustid.report import render_report, stands_on
from robustid.report.proved_band import band_chart, centre_chart
from support.edge_bands import edge_plant
from support.halvings import arcs_halved
from support.report_pages import Page, identified, named

pytestmark = pytest.mark.quick


@pytest.fixture(autouse=True, scope="module")
def _quick():
    """The bands of these pages have all that a band has."""


@pytest.fixture(autouse=True, scope="module")
def _unhalved():
    with arcs_halved(0):
        yield


HZ = np.array([4.0, 8.0, 17.6, 30.0, 48.0])
MODES = rid.datasets.flexible_structure().modes
BOX = MODES[:, :1] * [0.9999, 1.0001], MODES[:, 1:] * [0.99, 1.01]


@pytest.fixture(scope="module")
def result():
    return identified()


@pytest.fixture(scope="module")
def error(result):
    return rid.worst_case_error(result, omega=2 * np.pi * HZ[[0, 2, 4]], directions=12)


@pytest.fixture(scope="module")
def plain(result):
    return rid.band(result, omega=2 * np.pi * HZ)


@pytest.fixture(scope="module")
def refined(plain, error):
    found = plain.with_polygons(error)
    assert 0 < found.narrowed.sum() < 5
    return found


@pytest.fixture(scope="module")
def page(refined, error):
    return Page(render_report(error.identification, band=refined, worst_case=error))


def test_dots_are_the_refined_errors_and_the_line_is_proved_between_them(refined, plain):
    count = int(refined.narrowed.sum())
    words = f"narrowed by a polygon ({count} frequencies)"
    magnitude, errors = band_chart(refined.polygons.identification, refined).panels
    dots, bars, line = named(errors, words), named(magnitude, words), named(errors, "proved error")
    np.testing.assert_allclose(dots.x * 2 * np.pi, refined.omega[refined.narrowed])
    np.testing.assert_array_equal(dots.y, refined.sigma_upper[refined.narrowed])
    assert dots.marker
    at = line.x * 2 * np.pi
    alone = ~np.isin(at, refined.omega)
    np.testing.assert_allclose(line.y[alone], refined.error_at(at)[alone, 0, 0], rtol=1e-9)
    assert np.all(line.y <= plain.error_at(at)[:, 0, 0] * (1 + 1e-9))
    centre, radius = refined.at(dots.x * 2 * np.pi)
    size = np.abs(refined.nominal[refined.narrowed, 0, 0])
    high = np.minimum(size + dots.y, np.abs(centre[:, 0, 0]) + radius[:, 0, 0])
    np.testing.assert_allclose(bars.high, high, rtol=1e-9)
    assert words not in [layer.name for layer in band_chart(refined.polygons.identification, plain).panels[1].layers]


def test_one_sentence_says_what_stands_on_what(refined, plain, error, page):
    words = stands_on(refined, error)
    assert words.startswith(
        f"At {int(refined.narrowed.sum())} of 5 frequencies a semidefinite program narrows the band (to "
    )
    assert "everywhere else the band of sums stands" in words
    assert stands_on(plain, error) == ""
    assert page.text.count(words) == 2  # on the first screen, and in the section
    assert f"{error.claim_count} certificates of polygons were evaluated again" in page.text
    assert words in band_words(refined, error)
    assert "semidefinite" not in band_words(plain, None)


def test_a_sweep_at_exact_poles_is_said_to_be_no_part_of_a_band_over_a_box(result, error):
    band = rid.band(result, omega=2 * np.pi * HZ, box=BOX)
    exact = "the numbers of the sweep at 3 frequencies stand on exact poles and are not part of the curve."
    assert stands_on(band, error) == f"The band of sums stands at every frequency; {exact}"
    page = Page(render_report(result, band=band, worst_case=error))
    assert page.text.count(exact) == 2
    over = rid.guarantee.worst_case_over_poles(result, *BOX, omega=2 * np.pi * HZ[[0, 4]], directions=12, cells=1)
    found = band.with_polygons(over)
    assert isinstance(found.polygons, WorstCaseOverPoles)
    assert found.narrowed.any()
    assert "everywhere else the band of sums stands" in stands_on(found, error)
    assert stands_on(found, error).endswith(f"; {exact}")
    text = Page(render_report(result, band=found, worst_case=error, over_poles=over)).text
    assert "amplitudes of modes are assumed" not in text


def test_polygons_that_their_certificates_do_not_support_are_not_called_proved(refined, error, page):
    values = tuple(dataclasses.replace(one, support=one.support - 1e-3) for one in error.values)
    false = dataclasses.replace(error, values=values)
    other = Page(render_report(error.identification, band=refined.with_polygons(false), worst_case=false))
    for shown, key in ((page, "consistent"), (other, "failed")):
        for name in ("band-certificates", "certificates"):
            assert ("section", {"class": f"verdict {key}", "id": name}) in shown.tags


@pytest.mark.parametrize("kind", ["discrete", pytest.param("symmetric", marks=pytest.mark.slow)])
def test_a_band_draws_itself_about_its_centre_or_its_model(kind):
    plant = edge_plant(kind, 1)
    found = rid.band(plant.problem, box=plant.box, omega=[1.0])
    figure = found.plot()
    entries = plant.problem.entries.outputs * plant.problem.entries.inputs
    assert len(figure.axes) == 3 * entries
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert "centre of the band" in labels
    assert any(label.startswith("proved band, poles ") for label in labels)
    model = control.ss([], [], [], np.zeros(plant.problem.entries.shape), plant.problem.dt or 0)
    again = found.with_model(model).plot()
    assert "model, order 0" in {text.get_text() for text in again.legends[0].get_texts()}


def test_a_legend_says_how_many_poles_have_a_box():
    """A pole whose interval is a point is taken as exact, and is none of those that may lie anywhere."""
    omega, modes = np.linspace(20.0, 200.0, 18), rid.kautz([60.0, 120.0], [0.02, 0.03], dt=0.01)
    frf = rid.FrequencyResponse(omega, modes.response(0.01 * omega) @ [0.05, 0.02, 0.03, 0.01], bound=0.03, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.05), parametric=modes)
    for second, said in (
        ([120.0, 120.0], "poles of 1 of 2 modes anywhere in their box"),
        ([119.0, 121.0], "poles anywhere in their box"),
    ):
        box = np.array([[59.0, 61.0], second]), np.array([[0.02, 0.02], [0.03, 0.03]])
        names = [layer.name for panel in centre_chart(rid.band(problem, box=box)).panels for layer in panel.layers]
        assert f"proved band, {said}" in names
