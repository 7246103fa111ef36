"""robustid report with what was guaranteed: saved bounds, tubes, sensitivities."""

import sys

import numpy as np
import pytest

import robustid as rid
from robustid.advice.sensitivity import default_points
from robustid.guarantees import worst_case_over_poles
from support import command_line
from support.report_pages import Page

OMEGA = [30.0, 60.0]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    data = rid.datasets.flexible_structure(lines=5, samples=2, extra_hz=[17.6, 17.7])
    modes = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    problem = rid.MixedProblem(
        frequency=data.frequency, time=data.time, prior=rid.Prior(gain_bound=0.3, decay_rate=1.2), parametric=modes
    )
    result = rid.identify(problem)
    result.save(folder / "mine")
    rid.identify(problem.with_prior(gain_bound=0.4, decay_rate=1.2)).save(folder / "other")
    refuted = rid.MixedProblem(
        frequency=rid.FrequencyResponse([10.0, 60.0], [1.0, -1.0], bound=0.1, dt=0.01),
        prior=rid.Prior(gain_bound=0.5, decay_rate=1.2),
    )
    rid.identify(refuted).save(folder / "refuted")
    rid.worst_case_error(result, omega=OMEGA, directions=4).save(folder / "bounds")
    rid.band(result, box=None).save(folder / "bounds-band")
    box = data.modes[:, :1] * [0.999, 1.001], data.modes[:, 1:] * [0.95, 1.05]
    worst_case_over_poles(result, *box, omega=OMEGA, directions=4, cells=1).save(folder / "bounds-poles")
    return folder


@pytest.fixture
def run(stored, tmp_path, capsys, monkeypatch):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    for path in stored.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command_line.main(["report", *arguments], capsys, monkeypatch)


def test_the_page_holds_what_was_saved_and_what_is_asked_for(run, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[default_points.__module__], "default_points", lambda data: default_points(data)[:2])
    kinds = (
        "--bounds",
        "bounds.npz",
        "--bounds",
        "bounds-poles",
        "--bounds",
        "bounds-band",
        "--step",
        "3",
        "--sensitivity",
        "--no-reduce",
    )
    code, out, _ = run("mine", *kinds, "-o", "page.html")
    assert code == 0
    assert "written: page.html" in out
    assert out.endswith("next, the smallest model inside the bounds:\n  robustid reduce mine -o mine-small.npz\n")
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    for heading in (
        "What is guaranteed",
        "Guarantee over a pole-uncertainty box",
        "Guaranteed response in time",
        "What the guarantee depends on",
    ):
        assert heading in page.text
    assert "Not proved" not in page.text
    assert "at every frequency" in page.text
    upper = next(t for t in page.figures["guarantee-0"]["data"] if t["name"] == "guaranteed error")["y"]
    np.testing.assert_array_equal(upper, rid.load(tmp_path / "bounds").upper.ravel())
    assert "at every sample until 0.02 s" in page.text


def test_a_search_that_is_out_of_time_is_named_first_and_the_page_is_there(run, tmp_path):
    code, out, _ = run("mine", "--time-limit", "1e-6")
    assert code == 0
    words, said = " ".join(out.split()), "the time was over in: searching for the smallest order"
    assert words.index("Unfinished") < words.index(said) < words.index("Consistent")
    assert said in Page((tmp_path / "report.html").read_text(encoding="utf-8")).text


def test_without_options_no_guarantee_is_claimed(run, tmp_path):
    assert run("mine.json", "--no-reduce")[0] == 0
    assert "guarante" not in Page((tmp_path / "report.html").read_text(encoding="utf-8")).text


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("other", "--bounds", "bounds"), "--bounds bounds is about another identification"),
        (("other", "--bounds", "bounds-band"), "--bounds bounds-band is about another identification"),
        (("mine", "--bounds", "bounds", "--bounds", "bounds.json"), "--bounds bounds.json is the second of its kind"),
        (
            ("mine", "--bounds", "mine"),
            "--bounds mine holds no bounds, but a saved identification: robustid bounds RESULT",
        ),
        (("mine", "--bounds", "none"), "missing"),
        (("refuted", "--step", "3"), "identification is inconsistent (margin"),
        (("mine", "--bounds", "bounds", "-o", "bounds.json", "--force"), "is one of the files to be read"),
    ],
)
def test_misuse_ends_with_a_sentence_and_writes_nothing(run, arguments, sentence):
    with command_line.nothing_written():
        command_line.refused(run(*arguments, "--no-reduce"), sentence)


def test_a_finding_keeps_its_exit_code_and_its_sensitivity(run, tmp_path):
    code, _, _ = run("refuted", "--sensitivity", "--no-reduce")
    assert code == 3
    assert "refuted" in Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
