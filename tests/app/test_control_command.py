"""robustid control, and [controller] in a run file: a controller with its proof, its page and its files."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.controller_design import DesignStatus
from support.command_line import main, one_screen, refused, to_paste, words
from support.design_cases import DT, band_of
from support.one_design import small_band, small_design


@pytest.fixture
def here(tmp_path, monkeypatch):
    small_band().save(tmp_path / "band")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def given(monkeypatch, design):
    """The search is that of other tests: the command is given this design; what it was asked."""
    asked = {}

    def found(bands, structure, **how):
        asked.update(how, bands=bands, structure=structure)
        return design

    monkeypatch.setattr("robustid.controllers.design_controller", found)
    return asked


def test_the_command_writes_design_model_and_page(here, capsys, monkeypatch):
    asked = given(monkeypatch, small_design())
    monkeypatch.setattr("robustid.report.design_charts._POINTS", 60)
    monkeypatch.setattr("robustid.report.design_charts._DISCS", 30)
    text = ["control", "band", "--structure", "PID(80), Notch(30..40)", "--peak", "1.9", "--phase-margin", "45"]
    text += ["--attenuate", "1:2:0.5", "--maximise", "attenuation:1:3", "-o", "new", "--report", "new.html"]
    code, out, _ = main(text, capsys, monkeypatch, columns=80)
    assert code == 0
    one_screen(out)
    assert "Proved  Every consistent plant keeps all limits" in out
    assert to_paste(out) == [["export", "new-controller.npz", "-o", "new-controller.c"]]
    assert rid.load(here / "new").status.name == "PROVED"
    model = rid.load(here / "new-controller.npz", kind="model")
    assert np.array_equal(model.C, small_design().controller.C)
    assert "Every consistent plant keeps all limits" in (here / "new.html").read_text(encoding="utf-8")
    assert len(asked["bands"]) == 1
    assert [type(one).__name__ for one in asked["structure"]] == ["PID", "Notch"]
    assert asked["limits"].sensitivity_peak == 1.9
    assert asked["limits"].phase_margin == pytest.approx(np.pi / 4)
    assert asked["limits"].attenuation == ((2 * np.pi, 4 * np.pi, 0.5),)
    assert asked["maximise"] == rid.design.Attenuation(2 * np.pi, 6 * np.pi)
    refused(main(text, capsys, monkeypatch), "new.npz exists")


def test_the_report_of_a_design_says_on_request_what_would_help(here, capsys, monkeypatch):
    small_design().save(here / "design")
    monkeypatch.setattr("robustid.report.design_charts._POINTS", 60)
    monkeypatch.setattr("robustid.report.design_charts._DISCS", 30)
    code, out, _ = words(["report", "design", "-o", "page.html"], capsys, monkeypatch)
    assert code == 0
    assert "What would help" not in (here / "page.html").read_text(encoding="utf-8")
    row = rid.design.Improvement("bounds", 0.5, 6.0, 13.0, 13.2, 1.2)
    monkeypatch.setattr(rid.design.ControllerDesign, "improvements", lambda self: (row,))
    code, out, _ = words(["report", "design", "-o", "page.html", "--sensitivity", "--force", "-v"], capsys, monkeypatch)
    assert code == 0
    assert row.sentence in out
    assert "Measure better from 0.9549 to 2.069 Hz first" in (here / "page.html").read_text(encoding="utf-8")
    refused(
        main(["report", "design", "--step", "9", "-o", "x.html"], capsys, monkeypatch),
        "--step is about an identification",
    )


def test_exit_codes_say_what_was_found(here, capsys, monkeypatch):
    design = small_design()
    none = dataclasses.replace(design, status=DesignStatus.NONE, controller=None, proofs=(), shares={}, level=0.0)
    found = dataclasses.replace(design, status=DesignStatus.FOUND)
    for one, wanted in ((found, 1), (none, 3)):
        given(monkeypatch, one)
        code, _, _ = words(["control", "band", "band", "--structure", "PI", "--force"], capsys, monkeypatch)
        assert code == wanted
        assert (here / "controller-controller.npz").is_file() == (one is found)  # none is left of an earlier design


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["band"], "--structure is missing"),
        (["band", "--structure", "PID"], "--structure 'PID': PID needs its number"),
        (["band", "--structure", "PI", "--peak", "0.5"], "--peak must be above 1"),
        (["band", "--structure", "PI", "--attenuate", "1:2"], "--attenuate must be LOW:HIGH:VALUE"),
        (["band", "--structure", "PI", "--phase-margin", "95"], "--phase-margin must be between 0 and pi/2 rad"),
        (["band", "--structure", "PI", "--maximise", "speed"], "--maximise must be one of"),
        (["band", "--structure", "PI", "--fixed", "none.npz"], "none.npz: there is no such file"),
        (["band", "--structure", "P", "--maximise", "integral-gain"], "--structure must hold an integrator"),
        (["missing", "--structure", "PI"], "missing"),
        (["band", "--structure", "PI", "-o", "band"], "band.npz is one of the files to be read"),
    ],
)
def test_misuse_is_one_sentence(arguments, sentence, here, capsys, monkeypatch):
    refused(main(["control", *arguments, "--force"], capsys, monkeypatch), sentence)


@pytest.mark.slow
def test_a_run_designs_a_controller_and_goes_on_with_it(tmp_path, monkeypatch):
    plant, band = band_of(1)
    (frf,) = band.problem.frequency
    rid.save(tmp_path / "frf.csv", frf)
    prior = band.problem.prior
    text = (
        '[[frequency]]\nfile = "frf.csv"\n[modes]\nhz = []\ndamping = []\n'
        f"[prior]\ngain_bound = {prior.gain_bound}\ndecay_rate = {prior.decay_rate}\n"
        '[controller]\nstructure = "PI"\ngain_margin = 2.0\n'
    )
    (tmp_path / "ask.toml").write_text(text)
    found = rid.run(tmp_path / "ask.toml", tmp_path / "out")
    assert found.design.status.name == "PROVED"
    assert any(one.startswith("Controller of order 1: bandwidth") for one in found.findings)
    again = rid.load(tmp_path / "out" / "controller")
    assert again.status.name == "PROVED"
    model = rid.load(tmp_path / "out" / "controller-model.npz", kind="model")
    assert np.abs(control.feedback(plant, model).poles()).max() < 1
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "The controller that was designed" in page
    assert model.dt == DT

    def refuse(*_, **__):
        raise AssertionError("it was designed before")

    monkeypatch.setattr("robustid.app.run.designed.design_controller", refuse)
    resumed = rid.run(tmp_path / "ask.toml", tmp_path / "out", resume=True)
    assert resumed.design.level == found.design.level


@pytest.mark.slow
def test_a_run_without_a_band_says_that_there_is_no_controller(tmp_path):
    frf = rid.FrequencyResponse([1.0, 2.0, 3.0], [1.0, 5.0, -3.0], bound=0.01, dt=1.0)
    rid.save(tmp_path / "frf.csv", frf)
    text = (
        '[[frequency]]\nfile = "frf.csv"\n[modes]\nhz = []\ndamping = []\n[prior]\ngain_bound = 0.5\ndecay_rate = 1.5\n'
    )
    (tmp_path / "ask.toml").write_text(text + '[controller]\nstructure = "PI"\n')
    found = rid.run(tmp_path / "ask.toml", tmp_path / "out")
    assert found.design is None
    assert any(one.startswith("No controller was designed") for one in found.findings)
