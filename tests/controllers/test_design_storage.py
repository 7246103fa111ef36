"""Designs in files: what comes back is proved again, and what was changed by hand is not proved by what it says."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.controller_storage import design_again
from robustid.controllers.plants import Plants
from robustid.controllers.structure import as_structure, basis_of
from robustid.core import StateMatrices, described, made
from robustid.design import FIR, PID, Attenuation, Bandwidth, Fixed, LeadLag, LeastControl, Limits, LowPass, Notch
from robustid.errors import FileFormatError
from robustid.report.design_page import expensive_members
from support.cases import slow
from support.command_line import words
from support.design_cases import DT, band_of
from support.forging import forge, kept
from support.interrupts import ctrl_c
from support.one_design import LIMITS, PI, small_band, small_design

GAIN = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[1e-3]]))


def test_a_design_comes_back_proved_again(tmp_path, capsys, monkeypatch):
    design = small_design()
    again = kept(design, tmp_path / "design")
    assert again.status.name == "PROVED"
    assert again.shares == design.shares
    assert again.summary() == design.summary()
    for part in "ABCD":
        assert np.array_equal(getattr(again.controller, part), getattr(design.controller, part))
    assert again.proofs[0].peaks == design.proofs[0].peaks
    code, out, _ = words(["verify", str(tmp_path / "design")], capsys, monkeypatch)
    assert (code, out.split()[-1]) == (0, "verified")
    assert "proved: every consistent plant keeps the limits" in out


def test_a_controller_that_was_changed_is_not_proved(tmp_path):
    small_design().save(tmp_path / "design")
    arrays = dict(np.load(tmp_path / "design.npz"))
    np.savez(tmp_path / "design.npz", **arrays | {"controller/C": 1.5 * arrays["controller/C"]})
    with pytest.raises(FileFormatError, match="was edited"):
        rid.load(tmp_path / "design")
    small_design().save(tmp_path / "design")
    forge(tmp_path / "design", lambda arrays: {f"controller/{one}": 1.5 * arrays[f"controller/{one}"] for one in "CD"})
    assert rid.load(tmp_path / "design").status.name == "FOUND"
    forge(tmp_path / "design", lambda arrays: {"controller/A": 0.5 * arrays["controller/A"]})
    with pytest.raises(FileFormatError, match="none of its structure"):
        rid.load(tmp_path / "design")


@pytest.mark.parametrize(
    ("change", "status"),
    [
        (lambda text: text.update(level=1.5 * text["level"]), "FOUND"),
        slow(lambda text: text["limits"].update(sensitivity_peak=1.2), "FOUND", id="peak"),
        slow(lambda text: text.update(level=0.9 * text["level"]), "PROVED", id="less"),
    ],
)
def test_what_is_proved_is_what_the_file_asks(tmp_path, change, status):
    small_design().save(tmp_path / "design")
    forge(tmp_path / "design", text=change)
    assert rid.load(tmp_path / "design").status.name == status


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda text: text.update(searched=[3.0]), "not as many searched numbers"),
        (lambda text: text.update(bands=[], loops=[]), "needs the bands of its plants"),
        (lambda text: text["limits"].update(sensitivity_peak=0.5), "must be above 1"),
        (lambda text: text["goal"].update({"$class": "Notch"}), "is missing"),
    ],
)
def test_a_file_that_makes_no_design_is_refused(tmp_path, change, sentence):
    small_design().save(tmp_path / "design")
    forge(tmp_path / "design", text=change)
    with pytest.raises(FileFormatError, match=sentence):
        rid.load(tmp_path / "design")


def test_that_no_controller_was_found_is_kept(tmp_path, capsys, monkeypatch):
    limits = Limits(sensitivity_peak=1.5, attenuation=np.array([[1.0, 200.0, 0.01]]))
    found = rid.design_controller(small_band(), PID(integral=False), limits=limits)
    again = kept(found, tmp_path / "none")
    assert again.status.name == "NONE"
    assert again.limits.attenuation == ((1.0, 200.0, 0.01),)
    code, out, _ = words(["verify", str(tmp_path / "none")], capsys, monkeypatch)
    assert code == 0
    assert "recorded what a search found" in out


def test_structures_limits_and_goals_come_back():
    delay = control.ss(control.tf([1], [1, 0], DT))
    factors = (PID(filter=(20.0, 90.0)), Notch((30.0, 40.0), 0.3), LeadLag(5), LowPass(200.0, 2), FIR(3), Fixed(delay))
    arrays = {}
    text = described(as_structure(factors), "", arrays)
    again = made(text, arrays)
    assert again[:-1] == factors[:-1]
    at = [40.0, 35.0, 5.0, 200.0]
    omega = np.linspace(1.0, 300.0, 20)
    assert np.array_equal(basis_of(again, at, DT).response(omega), basis_of(factors, at, DT).response(omega))
    for goal in (Attenuation(1.0, 2.0), LeastControl()):
        assert made(described(goal, "", {}), {}) == goal
    gain = Fixed(control.ss([], [], [], 2.0))
    arrays = {}
    text = described(gain, "", arrays)
    assert np.asarray(made(text, arrays).model.D).item() == 2.0


def test_loading_tells_how_far_its_proofs_are_and_can_be_interrupted(tmp_path, capsys, monkeypatch):
    small_design().save(tmp_path / "design")
    told = []
    rid.load(tmp_path / "design", progress=lambda *one: told.append(one))
    text = "proving the controller on the whole axis"
    assert told == [(text, 0, 0), *((text, k, 3) for k in (1, 2, 3))]
    monkeypatch.setattr(Plants, "proved", ctrl_c)
    code, out, _ = words(["verify", str(tmp_path / "design")], capsys, monkeypatch)
    assert code == 130
    assert f"{text} …" in out


def test_the_first_line_says_what_the_bands_take_their_poles_to_be():
    omega = np.linspace(3.0, 312.0, 20)
    mode = control.tf([0.02], np.poly(0.97 * np.exp([0.3j, -0.3j])).real, DT)
    frf = rid.FrequencyResponse(omega, mode(np.exp(1j * omega * DT)), bound=0.02, dt=DT)
    s = np.log(0.97 * np.exp(0.3j)) / DT
    basis, prior = rid.kautz(abs(s), -s.real / abs(s), dt=DT), rid.Prior(gain_bound=0.5, decay_rate=1.2)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=basis)
    low, high = (np.array([[part * value] for value in (abs(s), -s.real / abs(s))]) for part in (0.999, 1.001))
    box = np.stack([low[0], high[0]], axis=1), np.stack([low[1], high[1]], axis=1)
    found = [rid.band(problem, model=control.ss(mode)), rid.band(problem, model=control.ss(mode), box=box)]
    words = ", poles of the parametric part taken as exact", ", poles of 1 mode anywhere in their box"
    for bands, said in (
        (found[:1], words[0]),
        (found[1:], words[1]),
        (found, ", for the plants of both bands" + words[0]),
    ):
        loops = tuple(Plants.of(one).loop for one in bands)
        design = design_again(tuple(bands), loops, GAIN, (PID(integral=False),), Limits(), Bandwidth(), 1e-3, ())
        assert design.summary().splitlines()[0].endswith(said)
        assert design.scope == said
    assert found[0].claim.splitlines()[0].endswith(words[0])
    assert design.proofs[1].summary().splitlines()[0].endswith(words[1])


def test_of_several_bands_the_one_whose_plants_take_most_of_a_limit_is_named():
    bands = small_band(), band_of(4)[1]
    loops = tuple(Plants.of(one).loop for one in bands)
    both = design_again(bands, loops, PI, (PID(),), LIMITS, Bandwidth(), 11.0, ())
    assert both.by_band[0] == small_design().shares
    for name, (share, _) in both.shares.items():
        assert share == max(one[name][0] for one in both.by_band)
    (number, limit, share), (other, _, less) = both.limiting_bands
    assert (number, other) == (1, 0)
    assert (limit, share) == (both.limited_by[0], both.shares[limit][0])
    assert share > less
    (said,) = expensive_members(both)
    assert said.text.startswith(f"Most of a limit is taken by the plants of the members 2 ({limit}, ")
    assert small_design().limiting_bands == ()
    assert expensive_members(small_design()) == []
