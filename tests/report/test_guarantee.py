"""The guaranteed error in words, against the arrays of the result and against forged ones."""

import dataclasses
import re

import numpy as np
import pytest

import robustid as rid
from robustid.report import at_least, at_most, plot, render_report, write_report
from robustid.report.guarantee import entry_table, guarantee_sentence, parameter_table
from robustid.report.words import number
from support.matrix_pages import measured, problem
from support.report_pages import NASTY, NASTY_NAMES, Page, check_escaped, identified, with_circle


def test_page_says_what_is_guaranteed(error, error_page):
    page = Page(error_page)
    start, end = page.text.index("What is guaranteed"), page.text.index("\nFrequency response")
    section = page.text[start:end]
    count = sum(len(v.certificates) for v in error.values) + len(error.parameters.certificates)
    wanted = [
        guarantee_sentence(error),
        f"All {count} certificates",
        "Proved",
        "never prove",
        "conditional on the poles",
    ]
    wanted += [f"within {at_most(error.upper.max())} mm/N", "Tested", "Assumed", "mode at 17.67 Hz, real part"]
    for w, high, low, sample in error.worst(7):
        wanted += [number(w / (2 * np.pi), 5), at_most(high), at_least(low), f"response {sample.place}"]
    ends = zip(error.parameters.lower, error.parameters.upper, strict=True)
    wanted += [f"{at_least(low)} … {at_most(high)}" for low, high in ends]
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


def test_page_shows_the_circle_that_was_computed(error):
    shown = with_circle(error)
    text = Page(render_report(shown.identification, worst_case=shown)).text
    assert "Over the whole circle the error stays below 0.9001 mm/N" in text  # the double next to 0.9 is above it
    assert "Nothing is claimed" not in text
    assert "by 3 arcs" in text


def test_page_is_as_before_without_a_guarantee(error, error_page):
    alone, with_it = (
        re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d", "", one) for one in (render_report(error.identification), error_page)
    )
    parts = (text.split("Open all details</button>")[1] for text in (alone, with_it))
    alone_below, below = (text.split('id="figures">')[0] for text in parts)
    kept = re.sub(r"<h2>What is guaranteed.*?(?=<h2>Frequency response)", "", below, flags=re.S)
    assert kept == alone_below
    before, after = Page(alone).figures, Page(with_it).figures
    assert {name: after[name] for name in before} == before
    assert "guarante" not in Page(alone).text


def test_a_loaded_copy_is_the_same_identification(error, tmp_path):
    error.save(tmp_path / "bounds")
    loaded = rid.load(tmp_path / "bounds")
    assert loaded.identification is not error.identification
    assert guarantee_sentence(error) in Page(render_report(error.identification, worst_case=loaded)).text


def test_a_bound_below_its_certificate_is_not_called_proved(error):
    value = error.values[2]
    forged = dataclasses.replace(value, support=value.support * 0.99)
    false = dataclasses.replace(error, values=(*error.values[:2], forged, *error.values[3:]))
    page = Page(render_report(error.identification, worst_case=false))
    assert ("section", {"class": "verdict failed", "id": "certificates"}) in page.tags
    assert "Not proved" in page.text
    assert "each supports its bound" not in page.text


def test_text_of_strangers_is_escaped():
    result = identified(**NASTY_NAMES)
    labels = dataclasses.replace(result.problem.parametric, functions=("<b>a</b>", NASTY, "$c$", "d"))
    result = rid.identify(dataclasses.replace(result.problem, parametric=labels))
    found = rid.worst_case_error(result, omega=[60.0, 100.0], directions=4)
    page = Page(render_report(result, worst_case=found))
    check_escaped(page)
    for text in ("<b>a</b>", NASTY, "y\"'&", "<img src=x onerror=alert(2)>"):
        assert text in page.text
    assert {"guarantee-0", "nyquist-0", "nyquist-1"} <= set(page.figures)
    plot.bode(found).canvas.draw()
    plot.nyquist(found).canvas.draw()


def test_misuse_is_named(error, tmp_path):
    other = identified(np.full(7, 0.1))
    with pytest.raises(rid.InputError, match="`worst_case` is about another identification"):
        write_report(other, tmp_path / "a.html", worst_case=error)
    with pytest.raises(
        rid.errors.InputTypeError,
        match="`result` must be of class WorstCaseError or Interconnection; got Identification",
    ):
        plot.nyquist(other)
    assert list(tmp_path.iterdir()) == []


def test_the_guarantee_in_words(matrix_error):
    said = guarantee_sentence(matrix_error)
    assert f"within {at_most(matrix_error.sigma_upper.max())} of the nominal model" in said
    assert "(largest singular value of the difference)" in said
    rows = entry_table(matrix_error).rows
    assert [row[0] for row in rows][1] == "y1 / torque [Nm]"
    np.testing.assert_allclose([float(row[2]) for row in rows], matrix_error.upper.max(axis=0).ravel(), rtol=1e-3)
    found = parameter_table(matrix_error).rows
    assert len(found) == 2 * 4
    assert found[1][0].endswith(": y1 / torque [Nm]")
    assert float(found[1][3].replace("−", "-")) == pytest.approx(
        matrix_error.identification.parameters[0, 0, 1], rel=1e-3
    )


def test_the_page_holds_every_part_and_escapes_names(matrix_error):
    text = render_report(matrix_error.identification, worst_case=matrix_error)
    page = Page(text)
    ids = [attributes["id"] for tag, attributes in page.tags if tag == "figure"]
    assert ids.pop(0) == "first-0"
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
    page = Page(render_report(rid.identify(problem(measured(lines=4, **names)))))
    assert NASTY in page.text
    assert not any("alert" in script for script in page.scripts[-1:])
    assert sum(tag == "script" for tag, _ in page.tags) == 3
