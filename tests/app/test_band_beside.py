"""The band that identify writes beside its result: other commands take it, over its box of poles, and prove nothing again."""

import shutil
from pathlib import Path

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.cli import main as cli
from robustid.app.cli.loops import MeasuredPlant
from support import command_line
from support.report_pages import Page

DT, OMEGA0 = 0.01, 60.0
OMEGA = np.linspace(5.0, 250.0, 50)
PLANT = control.c2d(control.ss(control.tf([OMEGA0**2], [1, 2 * 0.03 * OMEGA0, OMEGA0**2])), DT)


def response(seed, size=0.02):
    rng = np.random.default_rng(seed)
    error = rng.uniform(0, size, OMEGA.size) * np.exp(2j * np.pi * rng.uniform(size=OMEGA.size))
    return rid.FrequencyResponse(OMEGA, PLANT(np.exp(1j * OMEGA * DT)) + error, bound=size, dt=DT)


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The result of the command identify, with its page and its band; and the same result alone."""
    folder = tmp_path_factory.mktemp("beside")
    response(0).save(folder / "lines.npz")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(
            "sys.argv", ["robustid", "identify", "--frequency", "lines.npz", "-o", "mine", "--report", "mine.html"]
        )
        with pytest.raises(SystemExit) as stop:
            cli.main()
    assert not stop.value.code
    for ending in ("npz", "json"):
        shutil.copy(folder / f"mine.{ending}", folder / f"alone.{ending}")
    return folder


@pytest.fixture
def run(identified, tmp_path, capsys, monkeypatch):
    shutil.copytree(identified, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command_line.words(arguments, capsys, monkeypatch)


@pytest.fixture
def beside(run, monkeypatch):
    """Commands which may prove no band."""
    monkeypatch.setattr("robustid.app.run.sequence.band", None)
    monkeypatch.setattr("robustid.guarantees.band", None)
    return run


def test_the_page_of_a_saved_result_says_what_the_first_one_said(beside):
    code, out, _ = beside("report", "mine", "-o", "again.html")
    assert code == 0
    first, again = (Page(Path(name).read_text()).text for name in ("mine.html", "again.html"))
    begin = "Proved at every frequency, with the pole of 1 mode anywhere"
    assert first[first.index(begin) :][:300] == again[again.index(begin) :][:300]
    assert "a narrower band" in out


def test_bounds_narrow_the_band_that_is_there(beside):
    code, _, err = beside("bounds", "mine", "--omega", "60", "--directions", "4", "-o", "more")
    assert code == 0, err
    narrowed, kept = rid.load("more-band"), rid.load("mine-band").with_model(rid.load("mine").model)
    assert np.array_equal(narrowed.box[0], kept.box[0])
    assert narrowed.hinf <= kept.hinf


def test_a_band_that_time_has_cut_short_is_proved_again(run, monkeypatch):
    proved, band = [], rid.band
    monkeypatch.setattr(type(rid.load("mine-band")), "unfinished", "it was ended early")
    monkeypatch.setattr(
        "robustid.app.run.sequence.band", lambda *given, **how: proved.append(how["box"]) or band(*given, **how)
    )
    monkeypatch.setattr(
        "robustid.guarantees.band", lambda *given, **how: proved.append(how["box"]) or band(*given, **how)
    )
    code, _, err = run("bounds", "mine", "--omega", "60", "--directions", "4", "-o", "more")
    assert code == 0, err
    MeasuredPlant.of(Path("mine"), lambda *_: None)
    assert [box is not None for box in proved] == [True, True]


def test_a_loop_and_a_watch_stand_on_the_band_over_the_box(beside):
    plant = MeasuredPlant.of(Path("mine"), lambda *_: None)
    assert plant.band.box is not None
    response(1).save("other-day.npz")
    code, _, err = beside("watch", "mine", "--usual", "other-day.npz", "--alarm-rate", "0.01", "-o", "stage")
    assert code in (0, 3), err


def test_a_result_alone_is_bounded_over_the_box_of_poles_that_came_from_the_data(run):
    plant = MeasuredPlant.of(Path("alone"), lambda *_: None)
    assert plant.band.box is not None
    assert plant.identification is not None


def test_the_band_of_other_data_is_not_taken(run):
    poles = rid.kautz(OMEGA0, 0.03, dt=DT, delay=1)
    problem = rid.MixedProblem(frequency=response(5), prior=rid.Prior(gain_bound=1.0, decay_rate=1.1), parametric=poles)
    rid.band(rid.identify(problem)).save("alone-band")
    code, out, _ = run("report", "alone", "-o", "alone.html", "--no-reduce")
    assert code == 0
    assert "not bounded" in out or "guaranteed error" not in out
