"""Controllers and connections from files: saved and loaded, the commands loop, connect and verify, candidates of a run file."""

import importlib

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run.run_file import read_run_file
from robustid.errors import FileFormatError, InputError
from support.command_line import main, one_screen, refused, to_paste, words
from support.forging import forge, kept
from support.interrupts import ctrl_c

DT = 0.01
OMEGA = np.linspace(5.0, 300.0, 12)
GAIN, NEAR, BAD = (control.ss([], [], [], gain, DT) for gain in (0.5, 0.6, 0.05))
PLANT = control.ss(1.1, 1.0, 1.0, 0.0, DT)  # unstable: gains from 0.1 to 2.1 stabilise it
STABLE = control.ss(0.5, 0.5, 1.0, 0.0, DT)


def band_of(system, bound):
    values = [system(np.exp(1j * DT * w)) for w in OMEGA]
    frf = rid.FrequencyResponse(OMEGA, values, bound=bound, dt=DT)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4)))
    return result, rid.band(result, model=rid.balanced_truncation(result.model, order=1).model, omega=OMEGA, knots=96)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A machine in its loop, a stable part that was measured alone, controllers, and what no controller is."""
    place, loop = tmp_path_factory.mktemp("loops"), rid.Loop(GAIN)
    result, band = band_of(loop.residual_of(PLANT), 0.02)
    rid.loop_bounds(band, loop).save(place / "loop")
    result.save(place / "identification")
    band_of(STABLE, 0.05)[1].save(place / "part")
    for name, model in (("near", NEAR), ("bad", BAD), ("known", 0.5 * GAIN), ("large", -4.2 * GAIN)):
        rid.save(place / f"{name}.npz", model)
    rid.save(place / "by-response.csv", rid.FrequencyResponse(OMEGA, [BAD(np.exp(1j * DT * w)) for w in OMEGA], dt=DT))
    rid.save(place / "slow.npz", control.ss(0.5, 1.0, 1.0, 0.0, 2 * DT))
    rid.save(place / "wide.npz", control.ss([], [], [], np.eye(2), DT))
    np.savez(place / "nan.npz", A=[[0.5]], B=[[1.0]], C=[[np.nan]], D=[[0.0]], dt=DT)
    return place


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def test_bounds_of_a_loop_come_back_with_the_plant_that_refutes_them(folder):
    ran = rid.load(folder / "loop")
    found = rid.loop_bounds(ran.band, ran.loop, BAD).refuted(rid.load(folder / "identification"))
    assert found.status.name == "UNSTABLE"
    again = kept(found, folder / "refuted")
    assert again.status is found.status
    assert again.stability.margin == found.stability.margin
    assert np.array_equal(again.refuted_by.loop_poles, found.refuted_by.loop_poles)
    assert again.loop.law == found.loop.law
    near = rid.loop_bounds(ran.band, ran.loop, NEAR)
    again = kept(near, folder / "kept")
    assert again.peaks == near.peaks
    assert again.margins == near.margins
    assert again.stability.guaranteed


def test_a_plant_that_does_not_refute_is_none_however_it_is_bound_to_the_rest(folder):
    ran = rid.load(folder / "loop")
    found = rid.loop_bounds(ran.band, ran.loop, BAD).refuted(rid.load(folder / "identification"))
    found.save(folder / "forged")
    forge(folder / "forged", lambda arrays: {"controller/D": NEAR.D})
    with pytest.raises(FileFormatError, match="proved for every one"):
        rid.load(folder / "forged")
    found.save(folder / "forged")
    forge(folder / "forged", lambda arrays: {"refuted_by/D": arrays["refuted_by/D"] + 1.0})
    with pytest.raises(FileFormatError, match="does not agree with the data"):
        rid.load(folder / "forged")
    found.save(folder / "forged")
    arrays = dict(np.load(folder / "forged.npz"))
    arrays["refuted_by/D"] = arrays["refuted_by/D"] + 1e-9
    np.savez(folder / "forged.npz", **arrays)
    with pytest.raises(FileFormatError, match="was edited"):
        rid.load(folder / "forged")


def test_a_plant_in_open_loop_is_the_loop_without_a_controller(folder):
    """The margin is that of the band, or more about own centres; S of values in its discs lies inside the discs of S."""
    band = rid.load(folder / "part")
    found = rid.loop_bounds(band, controller=NEAR)
    assert found.in_open_loop
    margin = band.robust_stability_margin(NEAR).margin
    assert margin * (1 - 1e-12) <= found.stability.margin <= 1.1 * margin
    (centre, radius), rng = band.at(OMEGA), np.random.default_rng(0)
    turns = np.exp(2j * np.pi * rng.uniform(size=(200, 1)))
    P = centre[:, 0, 0] + radius[:, 0, 0] * turns
    middle, reach = found.at(OMEGA)["sensitivity"]
    away = np.abs(1 / (1 + 0.6 * P) - middle[:, 0, 0])
    assert np.all(away <= reach * (1 + 1e-9))
    assert np.all(away.max(axis=0) > 0.99 * reach)
    assert rid.loop_bounds(band, controller=control.ss([], [], [], -4.0, DT)).status.name == "UNDECIDED"
    with pytest.raises(InputError, match="`controller` is missing"):
        rid.loop_bounds(band)


def test_what_is_not_bounded_is_told_by_its_reason_and_not_as_infinite(folder):
    ran = rid.load(folder / "loop")
    unstable = rid.loop_bounds(ran.band, ran.loop, BAD)
    assert unstable.unbounded == "nothing is bounded: the loop with the model itself is not stable"
    assert "inf" not in unstable.summary()
    edge = rid.loop_bounds(ran.band, ran.loop, control.ss([], [], [], 2.05, DT))  # 2.1 is the limit
    near = float(edge.unbounded.removeprefix("nothing is proved near ").split()[0])
    assert 45 < near <= 50  # where the truth, -1 at z = -1, comes near
    assert "inf" not in edge.summary()


def test_the_command_loop_proves_one_controller_and_refutes_the_other(here, capsys, monkeypatch):
    code, out, _ = words(["loop", ".", "--controller", "near.npz", "--report", "near.html", "-v"], capsys, monkeypatch)
    assert code == 0
    assert "every consistent plant is stabilised, proved on the whole axis" in out
    assert "Stable with every consistent plant" in (here / "near.html").read_text(encoding="utf-8")
    assert rid.load(here / "tried").guaranteed
    short = ["loop", ".", "--controller", "near.npz", "--controller", "bad.npz", "-o", "both"]
    code, out, _ = main(short, capsys, monkeypatch, columns=80)
    assert code == 3
    one_screen(out)
    assert "Controller near: stable with every consistent plant" in out
    assert "Controller bad: refused" in out
    asked = ["loop", "loop.npz", "--controller", "bad.npz", "-o", "two-bad", "-v"]
    code, out, _ = words(asked, capsys, monkeypatch)
    assert code == 3
    assert "whose closed loop has a pole at 0 Hz (real part +" in out
    plant = rid.load(here / "two-bad-plant.npz")
    assert np.abs(control.feedback(plant, BAD).poles()).max() > 1 > np.abs(control.feedback(plant, GAIN).poles()).max()
    code, out, _ = words(["verify", "two-bad"], capsys, monkeypatch)
    assert code == 0
    assert out.endswith("verified")


def test_a_controller_by_its_response_is_the_same_controller(here, capsys, monkeypatch):
    code, _, _ = words(["loop", ".", "--controller", "by-response.csv", "-o", "response"], capsys, monkeypatch)
    assert code == 3
    found = rid.load(here / "response").controller
    np.testing.assert_allclose(found.D, BAD.D, rtol=1e-6)
    assert found.nstates == 0


def interrupting(monkeypatch, module, name):
    """Ctrl-C in the next call of a function of a module of guarantees."""
    monkeypatch.setattr(importlib.import_module(f"robustid.guarantees.{module}"), name, ctrl_c)


def test_ctrl_c_keeps_the_controllers_that_were_tried(here, capsys, monkeypatch):
    asked = ["loop", ".", "--controller", "near.npz", "--controller", "bad.npz", "-o", "stopped"]
    with monkeypatch.context() as patch:
        interrupting(patch, "loop_bounds", "unstable_plant")  # of the second
        code, out, err = words([*asked, "--report", "stopped.html"], capsys, patch)
    assert code == 130
    assert "what was found by then is written" in err
    assert rid.load(here / "stopped-near").guaranteed
    assert rid.load(here / "stopped-bad").status.name == "UNDECIDED"  # refuted by none as yet
    assert "stopped.html" in out
    assert "Stable with every consistent plant" in (here / "stopped.html").read_text(encoding="utf-8")
    interrupting(monkeypatch, "loop_bounds", "LoopAxis")  # before there is anything
    code, _, err = words(["loop", ".", "--controller", "near.npz", "-o", "nothing"], capsys, monkeypatch)
    assert code == 130
    assert "interrupted before its end; nothing more is written" in err
    assert not (here / "nothing.npz").exists()


def test_ctrl_c_leaves_a_pair_undecided(here, capsys, monkeypatch):
    interrupting(monkeypatch, "interconnection", "unstable_pair")
    asked = ["connect", "part", "large.npz", "-o", "half", "--report", "half.html"]
    code, _, err = words(asked, capsys, monkeypatch)
    assert code == 130
    assert "what was found by then is written" in err
    assert rid.load(here / "half").pair is None
    assert "</html>" in (here / "half.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["loop", "loop", "--controller", "slow.npz"], "--controller slow.npz: it must have the sample time"),
        (["loop", "part", "--controller", "wide.npz", "-o", "o"], "--controller must have 1 output and 1 input"),
        (["loop", "part", "--controller", "nan.npz"], "C must be finite"),
        (["loop", "part", "--controller", "none.npz"], "--controller none.npz: there is no such file"),
        (["loop", "loop", "--controller", "near.npz", "-o", "loop"], "loop.npz is one of the files to be read"),
        (["loop", "part"], "--controller is missing"),
        (["loop", "missing"], "missing"),
        (["connect", "part", "none.npz"], "none.npz: there is no such file"),
        (["connect", "part", "slow.npz"], "slow.npz must have the time base of part"),
        (["connect", "part", "wide.npz"], "wide.npz must have 1 input and 1 output"),
        (["connect", ".", "known.npz"], "whose band is that of R and not of the plant"),
        (["connect", "part", "known.npz", "--keep-out", "6"], "--keep-out must be DB:DEGREES"),
    ],
)
def test_misuse_is_one_sentence(arguments, sentence, here, capsys, monkeypatch):
    refused(main([*arguments, "--force"], capsys, monkeypatch), sentence)


def test_the_command_connect_decides_and_verify_holds(here, capsys, monkeypatch):
    asked = ["connect", "part", "known.npz", "-o", "pair", "--report", "pair.html", "--keep-out", "6:30", "-v"]
    code, out, _ = words(asked, capsys, monkeypatch)
    assert code == 0
    assert "stable: every pair of consistent systems makes a stable loop" in out
    page = (here / "pair.html").read_text(encoding="utf-8")
    assert "Stable for every pair" in page
    assert "no eigenvalue of any pair is in it" in page
    code, out, _ = main([*asked[:3], "-o", "short"], capsys, monkeypatch, columns=80)
    assert code == 0
    one_screen(out)
    assert to_paste(out) == [["verify", "short"]]
    code, out, _ = words(["verify", "pair"], capsys, monkeypatch)
    assert (code, out.split()[-1]) == (0, "verified")
    refused(main(asked, capsys, monkeypatch), "pair.npz exists")
    # 0.5/(z - 0.5) has gain 1 at z = 1, and the loop of every pair is unstable.
    code, out, _ = words(["connect", "part", "large.npz", "-o", "unstable"], capsys, monkeypatch)
    assert code == 3
    found = rid.load(here / "unstable")
    assert found.status.name == "UNSTABLE"
    source = rid.load(here / "unstable-source.npz")
    assert np.abs(control.feedback(source, -4.2 * GAIN).poles()).max() > 1
    forge(here / "unstable", lambda arrays: {"pair/0/D": arrays["pair/0/D"] + 1.0})
    with pytest.raises(FileFormatError, match="does not agree with the data"):
        rid.load(here / "unstable")


def test_discs_keep_out_of_a_region_if_no_value_in_them_is_in_it(folder):
    found = rid.interconnection(rid.load(folder / "part"), control.ss(0.9, 1.0, 0.35, 0.0, DT), time_limit=0.1)
    gain, phase = 4.0, 35.0
    out = found.keeps_out(gain, phase)
    turns = np.exp(2j * np.pi * np.arange(180) / 180) * np.linspace(0.4, 1, 5)[:, None]
    values = found.loci[:, :1, None] + found.radius[:, :1, None] * turns.reshape(1, 1, -1)
    inside = (np.abs(values) >= 10 ** (-gain / 20)) & (np.abs(np.angle(-values)) <= np.radians(phase))
    reached = inside.any(axis=(1, 2))
    assert not np.any(out & reached)
    assert out.any()
    assert reached.any()
    assert np.mean(out == ~reached) > 0.98  # the test is exact; the values are a grid


def test_candidates_of_a_run_file_are_seen_from_its_folder(tmp_path):
    (tmp_path / "data").mkdir()
    text = '[[frequency]]\nfile = "frf.csv"\n[loop]\ncontroller = "c.npz"\ncandidates = ["new.npz"]\n'
    (tmp_path / "ask.toml").write_text(text)
    asked = read_run_file(tmp_path / "ask.toml")
    assert asked.moved(tmp_path, tmp_path / "data").loop.candidates == ("../new.npz",)
    (tmp_path / "ask.toml").write_text('[[frequency]]\nfile = "frf.csv"\n[loop]\ncandidates = ["new.npz"]\n')
    with pytest.raises(InputError, match="needs the controller that ran"):
        read_run_file(tmp_path / "ask.toml")
