"""The guarantee over a pole-uncertainty box: against the arrays of real bands, and against forged ones."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import rounded_up
from robustid.report import at_most, render_report, write_report
from robustid.report.pole_box import box_entries, box_rows, box_table, box_verdict, pole_box_chart
from support import matrix_pages
from support.report_pages import NASTY_NAMES, Page, check_escaped, identified, named

pytestmark = pytest.mark.quick
HZ = np.array([4.0, 8.0, 17.6, 30.0])
MODES = rid.datasets.flexible_structure().modes
BOX = MODES[:, :1] * [0.999, 1.001], MODES[:, 1:] * [0.95, 1.05]
WORDS = "any pole in the box (4 frequencies)"


@pytest.fixture(scope="module")
def band():
    return rid.guarantee.worst_case_over_poles(identified(), *BOX, omega=2 * np.pi * HZ, directions=4, cells=1)


@pytest.fixture(scope="module")
def error(band):
    omega = 2 * np.pi * np.array([0.0, 4.0, 17.6, 40.0])
    return rid.worst_case_error(band.identification, omega=omega, directions=4)


def test_both_ranges_and_both_errors_are_those_of_the_results(band, error):
    magnitude, errors = pole_box_chart(band, error).panels
    inside = [1, 2]  # of the frequencies at the fixed poles: within those of the band
    for name, found, omega in (
        (WORDS, band.magnitude, band.omega),
        ("the fixed poles (2 frequencies)", error.magnitude[inside], error.omega[inside]),
    ):
        area = named(magnitude, name)
        index = np.searchsorted(area.x, omega / (2 * np.pi) * (1 - 1e-12))
        np.testing.assert_allclose(area.x[index] * 2 * np.pi, omega)
        np.testing.assert_allclose(area.high[index], found[:, 1], rtol=1e-9)
        np.testing.assert_allclose(area.low[index], np.maximum(found[:, 0], magnitude.y.range[0]), rtol=1e-9)
    over, fixed = named(errors, "error over the box"), named(errors, "error at the fixed poles")
    np.testing.assert_array_equal(over.y, band.upper.ravel())
    np.testing.assert_allclose(fixed.y, error.upper.ravel()[inside], rtol=1e-12)
    next_ = named(errors, f"measure next: {HZ[np.argmax(band.upper)]:.4g} Hz")
    np.testing.assert_allclose(next_.x, HZ[np.argmax(band.upper)])
    assert magnitude.x.range[0] <= HZ[0]
    assert HZ[-1] <= magnitude.x.range[1] < 40


def test_errors_beside_each_other_are_of_one_model(band, error):
    small = rid.balanced_truncation(band.model, order=4).model
    other = dataclasses.replace(band, model=small)
    magnitude, errors = pole_box_chart(other, error).panels
    assert named(magnitude, "model, order 4").y.size
    expected = error.with_model(small).upper.ravel()[[1, 2]]
    np.testing.assert_allclose(named(errors, "error at the fixed poles").y, expected, rtol=1e-12)
    assert np.all(expected != error.upper.ravel()[[1, 2]])
    area = named(magnitude, WORDS)  # the range does not depend on the model
    index = np.searchsorted(area.x, HZ * (1 - 1e-12))
    np.testing.assert_allclose(area.high[index], band.magnitude[:, 1], rtol=1e-9)


def test_one_frequency_and_none_beside_it_are_drawn(band, error):
    one = dataclasses.replace(band, omega=band.omega[1:2], kept=tuple(cell.at(band.omega[1:2]) for cell in band.kept))
    page = Page(render_report(band.identification, over_poles=one, worst_case=error))
    assert "over_poles-0" in page.figures
    assert "At the fixed poles" not in page.text
    assert "at 8 Hz" in page.text


def test_a_range_without_an_end_reaches_beyond_the_axis(band):
    (kept,) = band.kept
    damping = np.array([band.box.damping[0], [0.0005, 0.25]])  # of the mode at 17.6 Hz
    wide = dataclasses.replace(kept, cell=dataclasses.replace(kept.cell, damping=damping))
    open_ = dataclasses.replace(band, kept=(wide,))
    assert np.isinf(open_.upper).ravel().tolist() == [False, False, True, False]
    magnitude, errors = pole_box_chart(open_).panels
    area = named(magnitude, WORDS)
    index = np.searchsorted(area.x, 17.6 * (1 - 1e-12))
    assert area.high[index] > magnitude.y.range[1]
    assert area.low[index] == magnitude.y.range[0]
    assert np.isfinite(magnitude.y.range).all()
    assert np.isnan(named(errors, "error over the box").y).tolist() == [False, False, True, False]
    text = Page(render_report(band.identification, over_poles=open_)).text
    assert "The box is too wide: at 1 of the frequencies nothing is guaranteed (at 17.6 Hz)" in text
    rest = at_most(np.delete(open_.upper, 2).max())
    assert f"has a response within {rest} mm/N of the nominal model" in " ".join(text.split())
    assert "nothing is guaranteed at 1 of 4 frequencies, 17.6 Hz" in open_.summary()
    assert (
        f"within {rounded_up(np.delete(open_.upper, 2).max()):.4g} of the model at 3 of 4 frequencies"
        in open_.summary()
    )
    assert "A frequency point near 17.6 Hz" in text
    nothing = dataclasses.replace(band, kept=(dataclasses.replace(kept, values=()),))
    for one in (pole_box_chart(nothing), pole_box_chart(open_)):
        assert all(np.isfinite(panel.y.range).all() for panel in one.panels)


def test_page_says_what_is_guaranteed_over_the_box(band, error):
    page = Page(render_report(band.identification, over_poles=band, worst_case=error))
    fixed = error.upper.ravel()[1:3].max()
    wanted = [
        f"its poles anywhere in the box below, has a response within {at_most(band.upper.max())} mm/N",
        "at 4 frequencies from 4 to 30 Hz",
        f"the error at 2 frequencies in this range is at most {at_most(fixed)} mm/N",
        f"A frequency point near {band.next_line / (2 * np.pi):.4g} Hz",
        "covered in one piece",
        f"All {band.claim_count} certificates",
        "as many modes as the model has, and poles inside the box",
        "never prove",
    ]
    assert [text for text in wanted if text not in page.text] == []
    (row, _) = box_table(band).rows
    assert row[1:3] == ("8.991 … 9.009", "8.991 … 9.009")
    assert row[3:] == ("0.095 … 0.105", "0.095 … 0.105")
    assert all(text in page.text for text in row)


def test_the_box_before_and_after_the_refuted_cells(band):
    (kept,) = band.kept
    ends = np.array(band.box.omega)
    ends[1, 1] = ends[1].mean()
    left = dataclasses.replace(kept, cell=dataclasses.replace(kept.cell, omega=ends))
    split = dataclasses.replace(band, kept=(left,), refuted=(None,))
    first, second = box_table(split).rows
    assert first == box_table(band).rows[0]
    assert second[1] == box_table(band).rows[1][1] == "17.652 … 17.688"
    assert second[2] == "17.6523 … 17.67"
    assert "2 cells cover the box; 1 of them proved not to hold" in dict(box_rows(split, None))["Cells"]


def test_a_band_that_its_certificates_do_not_support_is_not_called_proved(band):
    page = Page(render_report(band.identification, over_poles=band))
    assert ("section", {"class": "verdict consistent", "id": "box-certificates"}) in page.tags
    (kept,) = band.kept
    tighter = dataclasses.replace(kept.values[0], support=kept.values[0].support - 0.1 * band.upper[0, 0, 0])
    false = dataclasses.replace(band, kept=(dataclasses.replace(kept, values=(tighter, *kept.values[1:])),))
    page = Page(render_report(band.identification, over_poles=false))
    assert ("section", {"class": "verdict failed", "id": "box-certificates"}) in page.tags
    assert "Not proved" in page.text
    ends = np.array(band.box.omega)
    ends[0, 1] *= 1.01
    wider = dataclasses.replace(band, box=dataclasses.replace(band.box, omega=ends))
    assert "leave out a part of the box" in box_verdict(wider).sentence


def test_text_of_strangers_is_escaped():
    result = identified(**NASTY_NAMES)
    found = rid.guarantee.worst_case_over_poles(result, *BOX, omega=[30.0], directions=4, cells=1)
    page = Page(render_report(result, over_poles=found))
    check_escaped(page)
    assert "over_poles-0" in page.figures


def test_misuse_is_named(band, tmp_path):
    with pytest.raises(rid.InputError, match="`over_poles` is about another identification"):
        write_report(identified(np.full(7, 0.1)), tmp_path / "a.html", over_poles=band)
    assert list(tmp_path.iterdir()) == []


def test_a_matrix_is_drawn_by_its_largest_singular_value_and_has_its_entries_in_a_table():
    frf, middle = matrix_pages.measured(1, 2, lines=5, modes=1), np.array([[6.0 * 2 * np.pi], [0.01]])
    basis = rid.kautz(*middle, dt=matrix_pages.DT, delay=1)
    result = rid.identify(
        rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2, decay_rate=1.1), parametric=basis)
    )
    box = (end[:, None] * [0.9999, 1.0001] for end in middle)
    found = rid.guarantee.worst_case_over_poles(result, *box, omega=frf.omega[2:3], directions=3)
    magnitude, errors = pole_box_chart(found).panels
    np.testing.assert_array_equal(named(errors, "error over the box").y, found.sigma_upper)
    assert magnitude.title == "Singular values"
    rows = box_entries(found).rows
    assert [row[:2] for row in rows] == [("y", "u1"), ("y", "u2")]
    assert rows[1][2] == at_most(found.upper[0, 0, 1])
    page = Page(render_report(result, over_poles=found))
    assert f"within {at_most(found.sigma_upper.max())} of the nominal model" in page.text
    assert "largest singular value of the difference" in page.text
    assert f"All {found.claim_count} certificates" in page.text
