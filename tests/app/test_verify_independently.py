"""`robustid verify --export` and `--independent`: the proof as a file, and the checker in C beside the package's own checks."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import proof_texts
from support import command_line
from support.proof_loops import loop_of
from support.proofs import asked, built, problem

pytestmark = pytest.mark.quick


@pytest.fixture
def saved(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    posed = problem(1)
    rid.identify(posed).save("model")
    omega = posed.frequency[0].omega
    rid.band(posed, omega=np.linspace(omega[0], omega[-1], 4)[1:-1], knots=30).save("band")
    return tmp_path


def test_a_proof_is_written_once_and_checked_by_another_program(saved, run, monkeypatch):
    program = built()
    monkeypatch.setenv("ROBUSTID_PROOF", str(program))
    code, out, _ = run(["verify", "band", "--independent", "--export", "proof.json"])
    assert code == 0
    assert "verified   independently, in exact integers: question" in out
    assert out.splitlines()[-2:] == ["checked by this package, and by robustid-proof (independent)", "verified"]
    assert asked(program, (saved / "proof.json").read_text(), saved)[0] == 0
    command_line.refused(run(["verify", "band", "--export", "proof.json"]), "--force")
    code, out, _ = run(["verify", "model", "--independent"])
    assert code == 0
    assert "in exact integers: question" in out
    for given, by in (([], "this package."), (["--independent"], "robustid-proof (independent).")):
        code, out, _ = run(["verify", "band", "--json", *given])
        assert by in json.loads(out)["sentence"]


def test_a_controller_is_checked_by_another_program_with_every_plant_of_its_band(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(built()))
    loop_of(5).save("loop")
    code, out, _ = run(["verify", "loop", "--independent", "--export", "proof.json"])
    assert code == 0, out
    assert "in exact integers: question" in out
    assert '"kind": "loop"' in (saved / "proof.json").read_text()


def test_a_checker_that_is_not_there_or_says_no_is_named(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(saved / "none"))
    command_line.refused(run(["verify", "model", "--independent"]), "cc -O2 -o robustid-proof")
    liar = saved / "liar"
    for status, said in ((1, "not proved: the discs"), (2, "not readable: nothing")):
        liar.write_text(f"#!/bin/sh\necho question\necho '{said}'\nexit {status}\n")
        liar.chmod(0o755)
        monkeypatch.setenv("ROBUSTID_PROOF", str(liar))
        code, out, err = run(["verify", "model", "--independent"])
        assert code == status
        assert said in out + err


def test_the_page_says_by_which_program_it_was_checked(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(built()))
    rid.load(saved / "band.npz").with_model(rid.load(saved / "model.npz").model).save("judged")
    with_band = ["report", "model", "--bounds", "judged", "--no-reduce", "--independent"]
    code, out, _ = run([*with_band, "-o", "page.html"])
    assert "proves the identification and the band too" in (saved / "page.html").read_text()
    assert "\nproved by robustid-proof: the band\n" in out
    assert run([*with_band[:-1], "-o", "alone.html"])[0] == code
    alone = (saved / "alone.html").read_text()
    assert "This package evaluated every claim again" in alone
    assert "exact integers" not in alone
    liar = saved / "liar"
    liar.write_text("#!/bin/sh\necho question\nexit 1\n")
    liar.chmod(0o755)
    monkeypatch.setenv("ROBUSTID_PROOF", str(liar))
    denied, out, _ = run([*with_band, "-o", "denied.html"])
    assert denied == 1
    assert "NOT proved by robustid-proof: the identification" in out
    page = (saved / "denied.html").read_text()
    assert "does not prove the identification and the band" in page
    assert page.index('id="independent"') < page.index('id="verdict"')  # above what it denies, not folded below
    rid.compare(problem(1).frequency[0], problem(1).frequency[0]).save("same")
    command_line.refused(run(["report", "same", "--independent", "-o", "other.html"]), "needs proofs")


@pytest.mark.slow
def test_the_page_of_a_loop_says_by_which_program_it_was_checked(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(built()))
    loop_of(5).save("loop")
    assert run(["report", "loop", "--independent", "-o", "page.html"])[0] == 0
    assert "proves the loop too" in (saved / "page.html").read_text()


@pytest.mark.slow  # quick: a loop above, and members of a family below
def test_a_design_for_several_bands_has_a_proof_for_each(saved):
    both = SimpleNamespace(proofs=(loop_of(5), loop_of(6)))
    program = built()
    texts = proof_texts(both)
    assert [asked(program, text, saved)[0] for text in texts] == [0, 0]
    assert len(set(texts)) == 2


def test_a_family_has_a_proof_for_each_member(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(built()))
    omega, prior = np.array([0.5, 1.5, 2.5]), rid.Prior(gain_bound=2.0, decay_rate=1.5)
    members = []
    for gain in (0.8, 1.0):
        frf = rid.FrequencyResponse(omega, gain * (1 + 0.3 * np.exp(-1j * omega)), bound=0.05, dt=1.0)
        found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
        members.append(rid.guarantee.Member(found, amplitude=gain))
    rid.family(members, omega=omega[:1], directions=4).save("family")
    code, out, _ = run(["verify", "family", "--independent", "--export", "proof.json"])
    assert code == 0, out
    assert out.count("verified   independently, in exact integers: question") == 2
    assert "member     amplitude 0.8" in out
    assert (saved / "proof-2.json").exists()
