"""A controller that is tuned by hand, but for the browser: looks, the proof, files, what is refused."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.explore.tuning import Tuner, Tuning
from robustid.controllers.controller_design import DesignStatus
from robustid.controllers.proving import proof_of
from robustid.core import points_of, response_at
from robustid.design import PID, Matrix
from robustid.errors import InputError
from robustid.report import tuning_bode, tuning_limits, tuning_numbers, tuning_nyquist, tuning_words
from support.design_cases import DT
from support.explored import until
from support.one_design import LIMITS, PI, small_design


@pytest.fixture(name="tuning", scope="module")
def _tuning():
    return Tuning.of(small_design())


def layer(figure, name):
    return next(one for one in figure["data"] if one["name"].startswith(name))


def test_the_sections_are_those_of_the_controller(tuning):
    omega = np.geomspace(0.1, 300, 200)
    points = points_of(omega, DT)
    assert np.allclose(response_at(tuning.start.system, points), response_at(PI, points), rtol=1e-9, atol=0)
    assert tuning.start.numbers == pytest.approx({"gain": 1.0, "0-kp": 0.38, "0-ki": 12.9})


def test_a_look_takes_of_every_limit_what_the_proof_does_and_no_more(tuning):
    turned = tuning.start.turned({"0-kp": 0.3, "gain": 0.9})
    look, proof = tuning.look(turned), tuning.prove(turned)
    assert look.kept
    assert proof.kept
    assert list(look.shares) == list(proof.shares) == ["sensitivity peak", "gain margin", "attenuation", "roll-off"]
    for name, (share, _) in look.shares.items():
        assert 0.95 * proof.shares[name][0] <= share <= proof.shares[name][0] * (1 + 1e-9), name
    again = proof_of(tuning.plants, control.ss(*turned.system, DT), LIMITS)
    assert again.shares == proof.shares


def test_of_several_bands_the_worst_counts(tuning):
    design = small_design()
    both = Tuning.of(dataclasses.replace(design, proofs=design.proofs * 2))
    one, two = tuning.look(tuning.start), both.look(both.start)
    assert len(two.found) == 2
    assert two.shares == one.shares
    assert tuning_numbers(two.found) == tuning_numbers(one.found)


def test_what_is_exceeded_is_said_with_how_much_and_where(tuning):
    look = tuning.look(tuning.start.turned({"gain": 1.6}))
    assert not look.kept
    key, words = tuning_words(look.found, look.shares)
    assert key == "inconsistent"
    assert "Exceeded: sensitivity peak, " in words
    over = {name: kept for name, _, _, _, kept in tuning_limits(look.shares, tuning.limits)}
    assert over == {name: share <= 1 for name, (share, _) in look.shares.items()}
    assert not over["sensitivity peak"]
    unstable = tuning.look(tuning.start.turned({"gain": 40.0}))
    assert tuning_words(unstable.found, unstable.shares)[1].startswith("Not stable: the loop with the model")
    assert dict(tuning_numbers(unstable.found))["gain margin"] == "–"
    gain = look.found[0].margins.gain[1] * 1.6
    edge = tuning.look(tuning.start.turned({"gain": 1.01 * gain}))
    assert tuning_words(edge.found, edge.shares)[1].startswith("Not stable with every consistent plant: near")


def test_pictures_hold_worst_cases_limits_and_the_controller_before(tuning):
    before, look = tuning.look(tuning.start), tuning.look(tuning.start.turned({"gain": 0.7}))
    bode = tuning_bode(look.found, before.found, tuning.limits)
    (found,) = look.found
    drawn = [one for one in bode["data"] if one["name"].startswith("largest")]
    names = "sensitivity", "complementary_sensitivity", "process_sensitivity", "control_sensitivity"
    for one, name in zip(drawn, names, strict=True):
        assert np.allclose(one["y"], found.largest[name]), name
    assert {2.0, 0.5} <= set(layer(bode, "limit")["y"])
    assert np.allclose(layer(bode, "with the controller of the design")["y"], np.abs(before.found[0].centre))
    plane = tuning_nyquist(look.found, tuning.limits)
    discs = np.array([[x, y] for x, y in zip(*(layer(plane, "holds")[k] for k in "xy"), strict=True) if x is not None])
    assert np.min(np.hypot(discs[:, 0] + 1, discs[:, 1])) >= 1 / found.largest["sensitivity"].max() - 1e-9
    assert len(layer(plane, "|S| above 2")["x"]) > 20


def test_a_hand_turns_proves_takes_back_and_writes(tuning, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tuner = Tuner(tuning)
    try:
        tuner.turn(tuning.start.numbers)  # what the page begins with is no other choice
        assert tuner.found.number == 1
        tuner.turn({"gain": 0.7})
        tuner.turn({"gain": 0.6})  # at once: one movement of a hand
        assert tuner.look.sections.gain == 0.6
        tuner.prove()
        until(lambda: tuner.found.proof is not None)
        key, words = tuning_words(tuner.look.found, tuner.look.shares, tuner.found.proof)
        share = tuner.found.proof.shares["attenuation"][0]
        assert (key == "consistent") == (share <= 1)
        assert words.startswith("PROVED" if share <= 1 else "Not proved")
        tuner.turn(tuning.start.numbers)
        assert tuner.found.proof is None
    finally:
        tuner.close()
    sections = tuning.start.turned({"0-kp": 0.3})
    path = tuning.write(sections, "mine.npz")
    again = rid.load(path)
    assert (again.dt, np.array_equal(again.D, sections.controller().D)) == (DT, True)
    tuning.write(sections, "drive.c")
    assert "drive_step" in (tmp_path / "drive.c").read_text()
    for name, words in (("mine.npz", "exists"), ("mine", "needs a name"), ("no/x.npz", "does not exist")):
        with pytest.raises(InputError, match=words):
            tuning.write(sections, name)


def test_what_can_not_be_tuned_is_said(tmp_path, run):
    none = dataclasses.replace(small_design(), status=DesignStatus.NONE, controller=None, proofs=())
    with pytest.raises(InputError, match="nothing to tune"):
        Tuning.of(none)
    matrix = dataclasses.replace(small_design(), structure=Matrix([[PID()]]))
    with pytest.raises(InputError, match="a matrix"):
        Tuning.of(matrix)
    pytest.importorskip("dash")
    none.save(tmp_path / "none")
    path = str(tmp_path / "none.npz")
    for arguments, words in (([path], "nothing to tune"), ([path, "--dt", "0.1"], "leave the options")):
        code, _, err = run(["explore", *arguments])
        assert (code, words in " ".join(err.split())) == (2, True), err
