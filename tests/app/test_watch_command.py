"""robustid watch: a state in one file, alarms in exit codes, the page, and what is refused."""

import json
import shutil

import control
import numpy as np
import pytest

import robustid as rid
from robustid.report import watch_page
from support import command_line
from support.report_pages import Page

DT, OMEGA0, ZETA = 0.01, 60.0, 0.02
OMEGA = np.linspace(40.0, 80.0, 15)
PLANT = control.ss(control.c2d(control.tf([OMEGA0**2 * ZETA], [1, 2 * ZETA * OMEGA0, OMEGA0**2]), DT))
VALUES = PLANT(np.exp(1j * OMEGA * DT))


def response(seed, offset=0.0):
    rng = np.random.default_rng(seed)
    values = VALUES + 0.01 * (rng.standard_normal(15) + 1j * rng.standard_normal(15)) + offset * (OMEGA > 70)
    return rid.FrequencyResponse(OMEGA, values, covariance=np.full((15, 1, 1), 2e-4), dt=DT).with_joint_bound()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("watch")
    for name, frf in {"monday": response(2), "tuesday": response(3), "far": response(4, 0.3)}.items():
        frf.save(folder / f"{name}.npz")
    class_ = {"parametric": rid.kautz(OMEGA0, ZETA, dt=DT), "prior": rid.Prior(gain_bound=0.05, decay_rate=1.1)}
    identified = rid.identify(rid.MixedProblem(frequency=response(1), **class_))
    identified.save(folder / "result")
    rid.band(identified).save(folder / "known")
    return folder


@pytest.fixture
def run(files, tmp_path, capsys, monkeypatch):
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command_line.words(arguments, capsys, monkeypatch)


@pytest.mark.quick
def test_a_watch_goes_on_in_its_file_and_alarms_once(run, tmp_path, monkeypatch):
    asked, compared = [], watch_page.moved_modes
    monkeypatch.setattr(watch_page, "moved_modes", lambda found: asked.append(found) or compared(found))
    code, out, err = run("watch", "known", "--usual", "monday.npz", "--alarm-rate", "0.01", "-o", "stage")
    assert code == 0, err
    assert "Nothing watched yet" in out
    assert run("watch", "stage", "tuesday.npz")[0] == 0
    code, out, err = run("watch", "stage", "far.npz", "--json", "--report", "page.html")
    assert code == 3, err
    found = json.loads(out)
    assert (found["command"], found["status"]) == ("watch", "refuted")
    assert len(asked) == 1  # for screen and page together
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    for heading in ("Refuted", "History", "Where in frequency", "Which mode moved", "What the alarms mean"):
        assert heading in page.text
    kept = rid.load("stage")
    for panel in watch_page.history_chart(kept).panels:  # records are counted, from one before the watch to the second
        assert (panel.x.range, panel.x.tick) == ((-0.5, 2.5), 1)
    assert kept.names == ("tuesday.npz", "far.npz")
    assert kept.rate == 0.01
    code, out, err = run("watch", "stage", "far.npz")  # not twice, and nothing is lost
    assert code == 2
    assert "is watched already" in err
    assert rid.load("stage").names == kept.names


@pytest.mark.quick
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("watch", "known", "monday.npz"), "--output NAME"),
        (("watch", "result", "-o", "x"), "robustid bounds result -o result-bounds"),
        (("watch", "known", "none.npz", "-o", "x"), "none.npz: there is no such file"),
        (("watch", "known", "--alarm-rate", "3", "-o", "x"), "at most 1/2"),
        (("watch", "known", "monday.npz", "--condition", "warm", "-o", "x"), "--condition is a member of a family"),
    ],
)
def test_what_is_refused(run, arguments, sentence):
    code, _, err = run(*arguments)
    assert code == 2
    assert sentence in err
