"""Writing a page: what belongs to which result, and what a failure leaves."""

import control
import pytest

import robustid as rid
from robustid.report import plot, write_report
from support.interrupts import ctrl_c

pytestmark = pytest.mark.quick


def test_a_failing_write_leaves_the_old_file(simple, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(rid.InputError, match="models"):
        write_report(simple, path, models={"late": rid.datasets.flexible_structure().truth})  # another dt
    assert path.read_text() == "old"
    monkeypatch.setattr("os.replace", ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        write_report(simple, path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_report(simple, path)
    assert "Inconsistent" in path.read_text()


def test_a_page_tells_how_far_it_is_in_counts(simple, tmp_path, monkeypatch):
    monkeypatch.setattr("robustid.report.html._FINENESS", (20,))
    told = []
    write_report(simple, tmp_path / "page.html", static=True, progress=lambda *said: told.append(said))
    pictures = (tmp_path / "page.html").read_text().count("data:image/png")
    assert told[:2] == [("drawing the report", 0, 2), ("drawing the report", 1, 2)]
    assert told[2:] == [("drawing pictures of 20 dots per inch", k, pictures) for k in range(pictures)]
    assert pictures > 2


SECTIONS = {
    "worst_case": (3, "must be a WorstCaseError"),
    "over_poles": (1, "must be a WorstCaseOverPoles, from worst_case_over_poles"),
    "tube": (1, "must be a ResponseTube, from response_tube"),
    "sensitivity": (1, "must be a Sensitivity"),
    "stability": (3, "must be a RobustStabilityMargin, or map names"),
    "stability of names": ({"a": 3}, "must map names to RobustStabilityMargin; got 'a': int"),
    "weights": ([1], "must be a StructuredWeight or a sequence"),
    "reduction": (None, ""),
}


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_of_something_else_or_of_another_kind_of_result_is_refused(simple, fit, tmp_path, section):
    (wrong, sentence), name = SECTIONS[section], section.split()[0]
    if sentence:
        with pytest.raises(rid.errors.InputTypeError, match=f"`{name}` {sentence}"):
            write_report(simple, tmp_path / "a.html", **{name: wrong})
    with pytest.raises(rid.errors.InputTypeError, match=f"`{name}` doesn't belong to a MatrixFraction"):
        write_report(fit, tmp_path / "a.html", **{name: fit})
    assert list(tmp_path.iterdir()) == []


def test_misuse_is_named(simple, consistent, tmp_path):
    with pytest.raises(
        rid.errors.InputTypeError, match="`models` must be models, by names, in a list or one; got 'model'"
    ):
        plot.poles(simple, models="model")
    with pytest.raises(rid.errors.InputTypeError, match="names"):
        plot.poles(simple, models={1: consistent.model})
    with pytest.raises(rid.errors.InputTypeError, match=r"models\['a'\].*StateSpace"):
        plot.residuals(simple, models={"a": [1, 0.5]})
    with pytest.raises(rid.InputError, match="1 output and 1 input"):
        plot.time_response(simple, models={"a": control.ss(0.5, [[1, 1]], 1, 0, 0.1)})
    with pytest.raises(rid.InputError, match=r"dt = 0.1 s.*control\.sample_system"):
        plot.bode(simple, models={"a": control.ss(-1.0, 1, 1, 0)})
    with pytest.raises(rid.errors.InputTypeError, match="`title` must be text"):
        write_report(simple, tmp_path / "a.html", title=3)
    with pytest.raises(rid.errors.InputTypeError, match="`identification` must be of class Identification, Matrix"):
        write_report(simple.model, tmp_path / "a.html")
    with pytest.raises(rid.InputError, match="folder"):
        write_report(simple, tmp_path)
    assert list(tmp_path.iterdir()) == []
