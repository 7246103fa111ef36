"""robustid compare; the page of whatever was saved; what fit writes is loaded as what it is."""

import control
import numpy as np
import pytest

import robustid as rid
from support import command_line
from support.answers import answered
from support.report_pages import Page

DT = 0.01
OMEGA = np.linspace(5.0, 250.0, 60)
PLANT = control.ss(control.tf([0.1, 0.05], [1.0, -1.6, 0.9], DT))
VALUES = PLANT(np.exp(1j * OMEGA * DT))


def response(seed, offset=0.0, **more):
    rng = np.random.default_rng(seed)
    values = VALUES + 0.01 * (rng.standard_normal(60) + 1j * rng.standard_normal(60)) + offset * (OMEGA > 200)
    return rid.FrequencyResponse(OMEGA, values, covariance=np.full((60, 1, 1), 2e-4), dt=DT, **more)


@pytest.fixture
def run(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, frf in {"one": response(1), "two": response(2), "far": response(3, 0.2)}.items():
        frf.with_joint_bound().save(f"{name}.npz")
    rid.save("plant.npz", PLANT)
    return lambda *arguments: command_line.words(arguments, capsys, monkeypatch)


@pytest.mark.quick
def test_two_files_are_alike_or_differ_and_a_model_is_validated(run, tmp_path):
    code, out, err = run("compare", "one.npz", "two.npz")
    assert code == 0, err
    assert "Noise explains every difference at the 60 frequency points" in out
    code, out, err = run("compare", "one.npz", "far.npz", "-o", "found", "--report", "page.html")
    assert code == 3, err
    assert "They differ" in out
    assert "written: found.npz, found.json, page.html" in out
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    for heading in ("They differ", "Both responses", "Where they differ", "How probable it is by chance"):
        assert heading in page.text
    assert rid.load("found").differ
    code, out, err = run("compare", "plant.npz", "one.npz")
    assert code == 0, err
    assert "all inside" in out
    # a comparison that was saved has its page too
    assert run("report", "found", "-o", "again.html")[0] == 0
    assert "They differ" in (tmp_path / "again.html").read_text(encoding="utf-8")


LIGHT = np.linspace(40.0, 90.0, 60)


def setup(first):
    values = 1 / (first**2 - LIGHT**2 + 0.02j * first * LIGHT) + 1 / (70**2 - LIGHT**2 + 1.4j * LIGHT)
    return rid.FrequencyResponse(LIGHT, values, bound=1e-5)


@pytest.mark.quick
def test_modes_of_several_setups(run, tmp_path, capsys, monkeypatch):
    for name, first in {"a": 50.0, "b": 50.0, "c": 49.5}.items():
        setup(first).save(f"{name}.npz")
    code, out, err = run("compare", "a.npz", "b.npz", "--modes", "-v")
    assert code == 0, err
    assert "all boxes have a part in common" in out
    code, out, err = run("compare", "a.npz", "b.npz", "c.npz", "--modes", "-o", "found", "--report", "page.html")
    assert code == 3, err
    assert "c contradicts the others in mode 1" in out
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    for heading in ("They contradict each other", "Modes", "c beside the others", "Modes without c", "Every setup"):
        assert heading in page.text
    assert rid.load("found").odd == "c"
    code, out, err = command_line.main(["compare", "a.npz", "b.npz", "c.npz", "--modes", "--json"], capsys, monkeypatch)
    assert code == 3, err
    found = answered((code, out, err))
    assert (found["status"], found["command"]) == ("differ", "compare")
    assert [one["hz"] is None for one in found["modes"]] == [bool(one["contradicting"]) for one in found["modes"]]
    assert "c" in found["modes"][0]["contradicting"]
    low, high = found["modes"][1]["hz"]
    assert low <= 70 / 2 / np.pi <= high
    assert run("report", "found", "-o", "again.html")[0] == 0
    code, _, err = run("compare", "a.npz", "b.npz", "c.npz")
    assert code == 2
    assert "give --modes" in err


@pytest.mark.quick
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("compare", "one.npz", "plant.npz", "--modes"),
            "plant.npz holds a StateSpace: of it no response is estimated",
        ),
        (("compare", "one.npz", "one.npz", "--modes"), "a file is named twice"),
        (("compare", "one.npz", "none.npz"), "none.npz: there is no such file"),
        (("compare", "plant.npz", "plant.npz"), "must be a measurement"),
        (("compare", "plant.npz", "one.npz", "-o", "x"), "--output is for two measurements"),
        (("compare", "one.npz", "plant.npz", "--period", "9"), "--period is for two measurements"),
        (("compare", "one.npz", "two.npz", "-o", "one"), "one of the files to be read"),
        (("compare", "one.npz", "two.npz", "--static"), "give --report FILE.html too"),
        (("report", "plant.npz"), "holds a StateSpace, which has no page of its own"),
        (
            ("report", "one.npz", "--step", "5"),
            "--step belongs to an identification; one.npz holds a FrequencyResponse",
        ),
    ],
)
def test_misuse_is_one_sentence(run, arguments, sentence):
    code, _, err = run(*arguments)
    assert code == 2
    assert sentence in err
    assert "Traceback" not in err


@pytest.mark.quick
def test_a_fit_is_loaded_as_what_it_is(run, tmp_path):
    code, out, err = run("fit", "one.npz", "--order", "2", "-o", "fitted")
    assert code == 0, err
    assert "written: fitted.npz, fitted.json" in out
    fit = rid.load("fitted")
    assert isinstance(fit, rid.fits.MatrixFraction)
    assert rid.validate(fit, response(4)).fit > 0.9
    assert run("report", "fitted", "-o", "fitted.html")[0] == 0
    assert "McMillan degree 2" in (tmp_path / "fitted.html").read_text(encoding="utf-8")
    assert run("export", "fitted", "-o", "fitted.m")[0] == 0
    # the model alone, also by its name without the ending
    assert run("fit", "one.npz", "--order", "2", "-o", "model.npz")[0] == 0
    assert rid.load("model").nstates == rid.load("model.npz").nstates == 2
